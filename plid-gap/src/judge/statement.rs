//! The statements of an answer that a trial can prove right or wrong, each with what its probability rests on.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::judge::explained::Explained;
use crate::judge::shares::Share;
use crate::judge::shrink::Gap;
use crate::settings::JudgeSettings;

/// The kind of a statement.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum About {
    /// The first effect of the answer acts at its place.
    Effect,
    /// A further effect of the answer acts at its place.
    Further,
    /// Nothing is missing.
    Nothing,
    /// Something outside the vocabulary is at work.
    Unknown,
}

/// A statement.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Statement {
    /// Its kind.
    pub about: About,
    /// Its probability by likelihoods and by what is left, before calibration.
    pub before: f64,
    /// What the calibration considers beside that probability.
    pub basis: BTreeMap<String, f64>,
}

/// Returns what the calibration considers of an explanation.
pub(crate) fn basis(explained: &Explained, gaps: &Gap) -> BTreeMap<String, f64> {
    let Explained { ready, refitted, found, .. } = explained;
    let (fit, settings) = (explained.fit(), &ready.problem.settings.judge);
    let is = |so: bool| f64::from(u8::from(so));
    let effects = &found.best.effects;
    let at_limit = effects.iter().any(|placed| placed.effect.caveat(&placed.parameters).is_some());
    let explains = (refitted.cost.max(explained.given_cost) - fit.cost) / fit.cost;
    let few = ready.problem.few();
    BTreeMap::from(
        [
            ("imperfect", is(ready.widened.is_some())),
            ("scale", ready.widened.unwrap_or(1.0).max(1e-3).ln()),
            ("free-shape", is(explained.free_shape.is_some())),
            ("at-limit", is(at_limit)),
            ("faint", if effects.is_empty() { 0.0 } else { faint(explains, settings) }),
            ("noise-unseen", is(!explained.level.seen)),
            ("unpredicted", is(explained.unpredicted.is_some())),
            ("left", gaps.left().clamp(0.0, 1.0)),
            ("left-of-fitted", explained.judged.left.max(0.0).sqrt().clamp(0.0, 1.0)),
            ("in-refit", is(effects.first().is_some_and(|placed| placed.effect.is_in_refit()))),
            ("linear", is(effects.first().is_some_and(|placed| placed.effect.is_linear()))),
            ("effects", effects.len() as f64),
            ("few", is(few)),
            ("refused", explained.refused.len() as f64),
            ("above-noise", (gaps.within_limits / gaps.noise_floor.max(1e-9)).max(1e-3).ln().min(10.0)),
            ("gain-over-refit", (gaps.refit / gaps.with_effect.max(1e-9)).max(1e-3).ln().min(10.0)),
            ("gain-over-free-refit", (gaps.free_refit / gaps.with_effect.max(1e-9)).max(1e-3).ln().min(10.0)),
        ]
        .map(|(name, value)| (name.to_owned(), value)),
    )
}

/// Returns what the calibration considers of one effect, beside what it considers of the explanation.
pub(crate) fn of_effect(share: Option<&Share>) -> [(String, f64); 2] {
    [
        ("share".to_owned(), share.map_or(1.0, |share| share.value.clamp(0.0, 1.0))),
        ("left-by-it".to_owned(), share.map_or(0.0, |share| share.left.clamp(0.0, 1.0))),
    ]
}

/// Returns how small the power that effects explain is beside that of the noise: one for nothing, and one half at
/// `faint_power`.
fn faint(explained: f64, settings: &JudgeSettings) -> f64 {
    1.0 / (1.0 + (explained.max(0.0) / settings.faint_power).powi(2))
}
