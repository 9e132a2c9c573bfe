//! The answer of a diagnosis with a simulator in the loop.

use std::collections::BTreeMap;

use plid_report::percent;
use plid_simulator::Description;
use serde::{Deserialize, Serialize};

use crate::answer::range::FittedRange;
use crate::answer::schema::{
    Bound, Change, Explanation, Located, NamedEffect, Remainder, Used, Value, Where, WrittenEffect,
};
use crate::answer::statements::{expected, what_remains};
use crate::case::FmuSource;
use crate::fit::candidate::{in_words, joined};
use crate::fit::problem::Placed;
use crate::in_loop::bounds::Cut;
use crate::in_loop::coupling::Response;
use crate::in_loop::judge::{Judged, confidence};
use crate::in_loop::problem::{Fit, Problem};
use crate::judge::family::Family;
use crate::judge::locate::Estimate;
use crate::judge::verdict::{Verdict, Weighted};
use crate::settings::{GapSettings, LoopSettings};

/// The contents of diagnosis.json for a simulator in the loop. Keys that it shares with a diagnosis of a linear
/// simulation have the same meaning.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LoopDiagnosis {
    /// The verdict.
    pub verdict: Verdict,
    /// The verdict as a sentence.
    pub sentence: String,
    /// The effects, in decreasing order of their shares of the gap.
    pub effects: Vec<NamedEffect>,
    /// The explanations, the most probable first.
    pub candidates: Vec<Explanation>,
    /// Explanations that these records cannot separate.
    pub not_separable: Vec<Vec<String>>,
    /// The location of the gap.
    #[serde(rename = "where")]
    pub place: Where,
    /// The gaps before and after, relative to the outputs.
    pub gap: LoopGap,
    /// The remainder of the best explanation.
    pub remainder: Remainder,
    /// The simulator and its calls.
    pub simulator: Used,
    /// Changes of the simulator's parameters by the bounded refit: the old value, the new value, and the change in
    /// standard deviations of the limit.
    pub refit: BTreeMap<String, [f64; 3]>,
    /// Thresholds of the diagnosis.
    pub settings: GapSettings,
    /// The evidence in sentences.
    #[serde(default)]
    pub evidence: Vec<String>,
    /// Warnings.
    pub warnings: Vec<String>,
}

/// The gaps on held-out records, or on the fitted records if none was held out.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct LoopGap {
    /// Gap of the simulator as given.
    pub as_given: f64,
    /// Gap after a fit of the simulator's parameters within their limits.
    pub refit: f64,
    /// Gap with the effects.
    pub with_effect: f64,
    /// Gap of noise alone.
    pub noise_floor: f64,
    /// One minus the ratio of `with_effect` to `as_given`, both beyond the noise.
    pub shrink: f64,
    /// The 95 % interval of `shrink`.
    pub shrink_ci95: [f64; 2],
    /// One minus the ratio of `with_effect` to `refit`, both beyond the noise.
    pub shrink_over_refit: f64,
    /// The gap to expect of the simulation that is written, at the highest level: that with which the fitted records
    /// are predicted from one another. No held-out record enters this figure.
    pub predicted_held_out_gap: f64,
    /// The 80 % interval of the prediction.
    pub predicted_ci80: [f64; 2],
    /// Names of the records on which these gaps were measured.
    pub measured_on: Vec<String>,
}

/// The contents of sim-with-effect.json for a simulator in the loop: all that a prediction uses besides the simulator.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SimulatorWithEffects {
    /// The name of the format, "simulator-with-effects".
    pub format: String,
    /// The description of the simulator.
    pub simulator: Description,
    /// The command that starts the simulator, if the simulator is a program.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub command: Vec<String>,
    /// The FMU, if the simulator is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fmu: Option<FmuSource>,
    /// Values of the simulator's parameters, by name.
    pub parameters: BTreeMap<String, f64>,
    /// The response of each port to a force.
    pub ports: Vec<WrittenPort>,
    /// The effects around the simulator and at its ports.
    pub effects: Vec<WrittenEffect>,
    /// End of the last record, in s since the first began.
    pub t0: f64,
    /// RMS of the noise of each output, in its unit.
    pub noise_rms: Vec<f64>,
    /// The expected gap on new records at the level of the loudest fitted record.
    pub expected_gap: f64,
    /// The range of the fitted records; files of earlier versions lack it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fitted: Option<FittedRange>,
}

/// The response of a port to a force.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct WrittenPort {
    /// The name of the port.
    pub name: String,
    /// Change of the velocity over a step per unit of force.
    pub mobility: f64,
    /// Weight of the velocity after a step in the change of the displacement over that step.
    pub weight: f64,
}

impl WrittenPort {
    /// Returns the responses of a simulator's ports.
    pub(super) fn all(description: &Description, responses: &[Response]) -> Vec<Self> {
        let ports = description.ports.iter().zip(responses);
        ports.map(|(p, r)| Self { name: p.name.clone(), mobility: r.mobility, weight: r.weight }).collect()
    }
}

/// Returns the effects of an explanation with intervals and confidence, the largest share first.
pub(super) fn named(problem: &Problem, best: &Fit, weighted: &[Weighted], shares: &[Estimate]) -> Vec<NamedEffect> {
    let setting = &problem.setting;
    let mut at = 0;
    let mut named = Vec::new();
    for (placed, share) in best.effects.iter().zip(shares) {
        let half = |at: usize| best.covariance.as_ref().map(|c| 1.96 * c[(at, at)].max(0.0).sqrt());
        let stated = |value: f64, half: Option<f64>, unit: String| {
            let ci95 = half.filter(|half| half.is_finite()).map(|half| [value - half, value + half]);
            Value { value, ci95, unit }
        };
        let first = at;
        let mut parameters = BTreeMap::new();
        for (parameter, value) in placed.effect.parameters(setting).into_iter().zip(&placed.parameters) {
            let unit = setting.unit_of(&parameter, &placed.place);
            parameters.insert(parameter.name, stated(*value, half(at), unit));
            at += 1;
        }
        let change = placed.effect.change(setting, &placed.place, &placed.parameters).map(|change| Change {
            number: change.number,
            from: change.from,
            to: stated(change.to, half(first), setting.unit(&change.unit, &placed.place)),
        });
        named.push(NamedEffect {
            effect: placed.effect.name().into(),
            location: placed.place.location(&setting.names),
            confidence: confidence(weighted, placed),
            family: Family::of(placed, weighted),
            share: Some(share.value),
            share_ci95: Some(share.ci95),
            parameters,
            change,
            shape_differs: false,
        });
    }
    named.sort_by(|a, b| b.share.unwrap_or(0.0).total_cmp(&a.share.unwrap_or(0.0)));
    named
}

/// Returns the explanations for the answer.
pub(super) fn candidates(
    problem: &Problem,
    weighted: &[Weighted],
    gap_after: impl Fn(&Weighted) -> Option<f64>,
) -> Vec<Explanation> {
    let names = &problem.setting.names;
    let located =
        |placed: &Placed| Located { effect: placed.effect.name().into(), location: placed.place.location(names) };
    let one = |w: &Weighted| Explanation {
        effects: w.effects.iter().map(located).collect(),
        unknown: w.unknown,
        probability: w.probability,
        gap_after: gap_after(w),
        wiring: None,
    };
    weighted.iter().map(one).collect()
}

/// Returns the best explanation together with those that cannot be separated from it.
pub(super) fn class(problem: &Problem, best: &Fit, judged: &Judged) -> Vec<Vec<String>> {
    if judged.not_separable.is_empty() {
        return Vec::new();
    }
    let names = &problem.setting.names;
    let all = std::iter::once(best.effects.as_slice()).chain(judged.not_separable.iter().map(Vec::as_slice));
    vec![all.map(|effects| joined(effects, names, "@")).collect()]
}

/// States an effect in words: "coulomb-friction at port:hinge", or the change of a parameter.
fn stated(effect: &NamedEffect) -> String {
    match &effect.change {
        Some(change) if effect.effect == super::parameter::NAME => change.to_string(),
        _ => format!("{} at {}", effect.effect, effect.location),
    }
}

/// Returns the answer as a sentence.
pub(super) fn sentence(
    problem: &Problem,
    judged: &Judged,
    best: &Fit,
    effects: &[NamedEffect],
    gap: &LoopGap,
    held_out: bool,
) -> String {
    let records = if held_out { "held-out records" } else { "the fitted records" };
    let noise = percent(gap.noise_floor);
    let course = format!("{} to {}", percent(gap.as_given), percent(gap.with_effect));
    match judged.verdict {
        Verdict::None => format!(
            "Nothing is missing: within its stated limits the simulator explains {records} down to {} (noise {noise}).",
            percent(gap.refit)
        ),
        Verdict::Effects => {
            let all: Vec<String> = effects.iter().map(stated).collect();
            let sure = effects.iter().map(|effect| effect.confidence).fold(1.0, f64::min);
            let them = if all.len() == 1 { "it" } else { "them" };
            let others = match judged.not_separable.first() {
                None => String::new(),
                Some(other) => {
                    format!(" These records cannot distinguish it from {}.", in_words(other, &problem.setting.names))
                }
            };
            format!(
                "{} ({:.0} % sure): with {them} the gap on {records} falls from {course}, and {noise} is \
                noise.{others}",
                capital(&all.join(" and ")),
                100.0 * sure
            )
        }
        Verdict::Unknown if best.effects.is_empty() => format!(
            "Something outside the vocabulary: no effect and no parameter explains the gap of {} (noise {noise}).",
            percent(gap.as_given)
        ),
        Verdict::Unknown => format!(
            "Something outside the vocabulary: with the nearest explanation, {}, the gap on {records} goes from \
            {course} (noise {noise}).",
            in_words(&best.effects, &problem.setting.names)
        ),
    }
}

/// Largest number of omitted items that a warning names; diagnosis.json lists all of them.
const NAMED: usize = 4;

/// Returns the warning that a bound ended the search early.
pub(super) fn cut_short(cut: &Cut, settings: &LoopSettings) -> String {
    let named = cut.what[..cut.what.len().min(NAMED)].join("; ");
    let more = match cut.what.len().saturating_sub(NAMED) {
        0 => String::new(),
        more => format!("; and {more} more, which `simulator.left_out` in diagnosis.json lists"),
    };
    format!("{} ended the search early. Left out: {named}{more}.", capital(&bound(cut.by, settings)))
}

/// States a bound in words.
fn bound(by: Bound, settings: &LoopSettings) -> String {
    match by {
        Bound::Calls => format!("the bound on the runs (`calls` = {})", settings.calls),
        Bound::Seconds => format!("the bound on the time in the simulator (`seconds` = {})", settings.seconds),
    }
}

fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}

impl LoopDiagnosis {
    /// Returns the answer as text: the sentence, each parameter with its interval, what remains, and how good a
    /// prediction will be.
    pub fn text(&self) -> String {
        let lines: String = self.effects.iter().map(NamedEffect::lines).collect();
        let Used { name, runs, seconds, ended_by, .. } = &self.simulator;
        let cut = ended_by.map(|by| format!("; {} ended the search early", bound(by, &self.settings.in_loop)));
        format!(
            "{}\n{lines}{}\n{}\n  {runs} runs of {name} in {seconds:.1} s{}\n",
            self.sentence,
            what_remains(&self.remainder, &self.settings.answer),
            expected(self.gap.predicted_held_out_gap, self.gap.predicted_ci80),
            cut.unwrap_or_default()
        )
    }
}
