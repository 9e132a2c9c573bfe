//! The statements of an answer that a trial can prove right or wrong, each with the quantities on which its
//! probability rests.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::fit::problem::Placed;
use crate::judge::explained::Explained;
use crate::settings::JudgeSettings;

/// The name, in the basis, of the quantity that states whether a parameter is at the limit of the range in which its
/// effect's name applies.
pub(crate) const AT_LIMIT: &str = "at-limit";

/// The kind of a statement.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum About {
    /// The first effect of the answer acts at its place.
    Effect,
    /// The effects of the first explanation act at their places, and no others do. Answers do not record this
    /// statement, because it has the same basis as the statement about the first effect.
    Explanation,
    /// A further effect of the answer acts at its place.
    Further,
    /// Nothing is missing.
    Nothing,
    /// Something outside the vocabulary is at work.
    Unknown,
    /// A cause that the answer does not name makes a larger gap than the case calls material.
    Remainder,
}

impl About {
    /// All kinds.
    pub const ALL: [Self; 6] =
        [Self::Effect, Self::Explanation, Self::Further, Self::Nothing, Self::Unknown, Self::Remainder];

    /// Returns its name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Effect => "effect",
            Self::Explanation => "explanation",
            Self::Further => "further",
            Self::Nothing => "nothing",
            Self::Unknown => "unknown",
            Self::Remainder => "remainder",
        }
    }
}

/// A statement.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Statement {
    /// Its kind.
    pub about: About,
    /// Its probability from likelihoods and from the remaining gap, before calibration.
    pub before: f64,
    /// The quantities that the calibration considers in addition to that probability.
    pub basis: BTreeMap<String, f64>,
}

/// Returns the quantities that the calibration considers for an explanation, all between zero and one: whether the
/// simulation is imperfect as a whole, how faint the effects are, and whether a parameter is at the limit of the range
/// in which the effect's name applies.
pub(crate) fn basis(explained: &Explained) -> BTreeMap<String, f64> {
    let Explained { ready, refitted, found, .. } = explained;
    let (fit, settings) = (explained.fit(), &ready.problem.settings.judge);
    let is = |so: bool| f64::from(u8::from(so));
    let effects = &found.best.effects;
    let explains = (refitted.cost.max(explained.given_cost) - fit.cost) / fit.cost;
    let basis = [
        ("imperfect", is(ready.widened.is_some())),
        ("faint", if effects.is_empty() { 0.0 } else { faint(explains, settings) }),
        (AT_LIMIT, is(are_at_limit(effects))),
    ];
    basis.map(|(name, value)| (name.to_owned(), value)).into()
}

/// Returns whether a parameter of an effect is at the limit of the range in which the effect's name applies.
pub(crate) fn are_at_limit(effects: &[Placed]) -> bool {
    effects.iter().any(|placed| placed.effect.caveat(&placed.parameters).is_some())
}

/// Returns how faint effects are: one if they explain no power, and one half if they explain the power of the noise
/// times `faint_power`.
fn faint(explained: f64, settings: &JudgeSettings) -> f64 {
    1.0 / (1.0 + (explained.max(0.0) / settings.faint_power).powi(2))
}
