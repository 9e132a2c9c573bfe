//! The formats of diagnosis.json and sim-with-effect.json.

use std::collections::BTreeMap;
use std::fmt;

use plid_report::Cell;
use serde::{Deserialize, Serialize};

use crate::answer::range::FittedRange;
use crate::answer::shape::Shape;
use crate::answer::statements::{expected, of_records, what_remains};
use crate::case::Intersample;
use crate::effects::Side;
pub use crate::judge::family::Family;
use crate::judge::locate::LevelGap;
pub use crate::judge::shrink::{Gap, ShrinkOver};
pub use crate::judge::side::PlaceShare;
pub use crate::judge::statement::{About, Statement};
pub use crate::judge::statistics::Statistics;
pub use crate::judge::verdict::Verdict;
use crate::settings::{GapSettings, PlantSettings};

/// A parameter's value with its 95 % interval.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Value {
    /// The estimate.
    pub value: f64,
    /// The interval, if the fit gives one.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub ci95: Option<[f64; 2]>,
    /// Unit, in terms of the units of channels and ports.
    pub unit: String,
}

/// A change of a parameter of the simulation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Change {
    /// The parameter in words.
    pub number: String,
    /// Its value in the simulation.
    pub from: f64,
    /// Its corrected value.
    pub to: Value,
}

/// Writes, for example, "factor of output y2 from 1.0000 to 1.0721 (1.0602 to 1.0840)".
impl fmt::Display for Change {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let short = |x: f64| Cell::significant(x, 5);
        let unit = if self.to.unit == "1" { String::new() } else { format!(" {}", self.to.unit) };
        write!(f, "{} from {}{unit} to {}{unit}", self.number, short(self.from), short(self.to.value))?;
        self.to.ci95.map_or(Ok(()), |[low, high]| write!(f, " ({} to {})", short(low), short(high)))
    }
}

/// An effect of the answer.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct NamedEffect {
    /// Its identifier.
    pub effect: String,
    /// Its location.
    pub location: String,
    /// Probability that it acts there.
    pub confidence: f64,
    /// The family of effects to which it belongs, if any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub family: Option<Family>,
    /// Share of the squared gap beyond noise and limits that this effect closes on held-out records, while the others
    /// stay; absent for a stochastic effect.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub share: Option<f64>,
    /// The 95 % interval of `share`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub share_ci95: Option<[f64; 2]>,
    /// Parameters by name.
    pub parameters: BTreeMap<String, Value>,
    /// The parameter of the simulation that changes, if the effect is merely such a change.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub change: Option<Change>,
    /// Whether the location is right, but the shape only resembles that of this effect.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub shape_differs: bool,
}

impl NamedEffect {
    /// Returns a line of text for each parameter, with its interval.
    pub fn lines(&self) -> String {
        let short = |x: f64| Cell::significant(x, 4);
        let line = |(name, value): (&String, &Value)| {
            let interval = value.ci95.map(|[a, b]| format!(" ({} to {})", short(a), short(b))).unwrap_or_default();
            // The unit of a pure number is not printed.
            let unit = if value.unit == "1" { String::new() } else { format!(" {}", value.unit) };
            format!("  {} at {}: {name} = {}{unit}{interval}\n", self.effect, self.location, short(value.value))
        };
        self.parameters.iter().map(line).collect()
    }
}

/// An effect at a location.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Located {
    /// Its identifier.
    pub effect: String,
    /// Its location.
    pub location: String,
}

/// An explanation that the data do not exclude.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Explanation {
    /// Its effects; empty for no effect or for something else.
    pub effects: Vec<Located>,
    /// Whether it is something outside the vocabulary.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub unknown: bool,
    /// Its probability; all probabilities add up to one.
    pub probability: f64,
    /// Expected gap with it, if it is a fit.
    pub gap_after: Option<f64>,
    /// The treatment of the channels, if it differs from that of the answer: as recorded, or with a mismatch
    /// corrected.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wiring: Option<String>,
}

/// The location of the gap.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Where {
    /// The part of the signal path; `None` for what remains after the effects.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub side: Option<Side>,
    /// Whether the residual identifies this side clearly, because places of the other sides explain much less of it.
    #[serde(default)]
    pub side_is_clear: bool,
    /// The places that explain most of the residual, each alone and with free functions, in decreasing order.
    #[serde(default)]
    pub places: Vec<PlaceShare>,
    /// Share of each output in the squared gap.
    pub channels: BTreeMap<String, f64>,
    /// The bands with most of the squared gap: from, to (Hz), share.
    pub bands_hz: Vec<[f64; 3]>,
    /// Share of each of eight stretches of time in the squared gap.
    pub time: Vec<f64>,
    /// Slope of the logarithm of the relative gap over that of the level, if levels differ.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub level_slope: Option<f64>,
    /// Intervals of `channels`.
    #[serde(default)]
    pub channels_ci95: BTreeMap<String, [f64; 2]>,
    /// Intervals of the shares of `bands_hz`.
    #[serde(default)]
    pub bands_ci95: Vec<[f64; 2]>,
    /// Intervals of `time`.
    #[serde(default)]
    pub time_ci95: Vec<[f64; 2]>,
    /// Interval of `level_slope`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub level_slope_ci95: Option<[f64; 2]>,
    /// Gap beyond the noise of each record on which `level_slope` rests.
    #[serde(default)]
    pub levels: Vec<LevelGap>,
}

/// The remainder of the best explanation, on the records on which the gap was measured.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Remainder {
    /// The remaining gap, including noise.
    pub gap: f64,
    /// The gap of noise alone.
    pub noise: f64,
    /// Whether `noise` is only declared or estimated, because no record shows the noise level.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub noise_unseen: bool,
    /// Remaining share of the squared gap as given, both beyond the noise.
    pub share_of_gap: f64,
    /// Probability that the remainder beyond the noise exceeds what the case calls material.
    pub further_cause: f64,
    /// The gap that the case calls material.
    #[serde(default)]
    pub material: f64,
    /// Share of its power, noise included, that repeats in every period of the periodic records: a cause that the input
    /// drives. `None` if no record shows two periods after the first one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub repeats: Option<f64>,
    /// Its location on the fitted records.
    #[serde(rename = "where", default)]
    pub place: RemainderPlace,
    /// The effects that would explain most of the remainder, although none of them explains enough.
    pub nearest: Vec<Located>,
}

/// The location of a remainder.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct RemainderPlace {
    /// Share of each output.
    pub channels: BTreeMap<String, f64>,
    /// The bands with most of the remainder: from, to (Hz), share.
    pub bands_hz: Vec<[f64; 3]>,
}

/// The separability of an explanation from the best one on the records. Differences are in log likelihood, if the best
/// explanation is true.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Comparison {
    /// The explanation, as in `not_separable`.
    pub explanation: String,
    /// Share of its trace that a bounded refit absorbs, if it is one entry of the first screen.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub absorbed: Option<f64>,
    /// Cosine between the remaining part of its trace and that of the effect of the best explanation that it would
    /// replace.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cosine: Option<f64>,
    /// Expected difference to first order, before any fit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub expected_before: Option<f64>,
    /// Expected difference with the explanation fitted to the prediction of the best one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub expected: Option<f64>,
    /// The difference on the measured records.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub realised: Option<f64>,
}

/// The contents of diagnosis.json.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Diagnosis {
    /// The verdict in a word.
    pub verdict: Verdict,
    /// The verdict in a sentence.
    pub sentence: String,
    /// The effects, the largest share of the gap first.
    pub effects: Vec<NamedEffect>,
    /// The explanations, the most probable first. In an imperfect simulation, explanations that differ only in effects
    /// too small to be named count as one.
    pub candidates: Vec<Explanation>,
    /// Explanations that these records cannot separate.
    pub not_separable: Vec<Vec<String>>,
    /// The separability of explanations on the records, the best explanation first.
    #[serde(default)]
    pub separability: Vec<Comparison>,
    /// The statements of the verdict, of further effects and of the remainder, with the basis of their probabilities.
    #[serde(default)]
    pub statements: Vec<Statement>,
    /// The curves of the named laws without memory at ports.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub shapes: Vec<Shape>,
    /// Statistics of the first explanation, for trials of what separates right causes from wrong ones. `None` if the
    /// verdict is "none", or if the first effect is stochastic.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub statistics: Option<Statistics>,
    /// The location of the gap.
    #[serde(rename = "where")]
    pub place: Where,
    /// The gaps.
    pub gap: Gap,
    /// The remainder of the best explanation.
    #[serde(default)]
    pub remainder: Remainder,
    /// The experiment that would best separate the remaining explanations.
    pub next_experiment: Option<String>,
    /// The simulator whose linear model was diagnosed, if there was one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub simulator: Option<Used>,
    /// Thresholds of the diagnosis.
    #[serde(default)]
    pub settings: GapSettings,
    /// The evidence in sentences.
    pub evidence: Vec<String>,
    /// Warnings.
    pub warnings: Vec<String>,
}

impl Diagnosis {
    /// Returns the answer as text: the sentence, each parameter with its interval, the changes of the simulation, what
    /// remains, how good a prediction will be, the use of the records, and the next experiment.
    pub fn text(&self) -> String {
        let mut text = format!("{}\n", self.sentence);
        for effect in &self.effects {
            text += &effect.lines();
            if let Some(change) = &effect.change {
                text += &format!("  in the simulation: {change}\n");
            }
        }
        let Gap { predicted_held_out_gap, predicted_ci80, measured_on, measured_on_fitted, .. } = &self.gap;
        text += &format!("{}\n", what_remains(&self.remainder, &self.settings.answer));
        text += &format!("{}\n", expected(*predicted_held_out_gap, *predicted_ci80));
        text += &format!("{}\n", of_records(measured_on, *measured_on_fitted));
        if let Some(next) = &self.next_experiment {
            text += &format!("next: {next}\n");
        }
        if let Some(Used { name, runs, seconds, .. }) = &self.simulator {
            text += &format!("  {runs} runs of {name} in {seconds:.1} s\n");
        }
        text
    }
}

/// A simulator and its calls.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Used {
    /// Its name.
    pub name: String,
    /// Number of runs, on one record each.
    pub runs: usize,
    /// Time in the simulator, in s.
    pub seconds: f64,
    /// Whether a bound on the runs ended the search early.
    pub cut_short: bool,
    /// The bound that ended the search.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ended_by: Option<Bound>,
    /// The steps that were left out because of the bound.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub left_out: Vec<String>,
}

/// A bound on the runs of a simulator, by its key in `[settings.in_loop]`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Bound {
    /// The number of runs.
    Calls,
    /// The time of the runs.
    Seconds,
}

/// An effect in a form for other programs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct WrittenEffect {
    /// Its identifier.
    pub effect: String,
    /// Its location.
    pub location: String,
    /// Parameters by name.
    pub parameters: BTreeMap<String, Value>,
    /// Numbers of the simulation that the equation uses, such as the pole that the effect moves.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub given: BTreeMap<String, Value>,
    /// Its equation.
    pub equation: String,
}

/// The contents of sim-with-effect.json: all that a prediction uses.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SimulationWithEffects {
    /// The name of the format, "simulation-with-effects".
    pub format: String,
    /// The linear model after the bounded refit, a model.json object in modal coordinates: the first 2 `modes` states
    /// are (Re z, Im z) of each mode, with dz/dt = pole z + b u.
    pub linear: serde_json::Value,
    /// Number of modes of `linear`.
    pub modes: usize,
    /// `linear` with the effects that change the linear model itself (modal effects). If present, this model is to be
    /// simulated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub linear_with_modal_effects: Option<serde_json::Value>,
    /// The simulation as given, a model.json object; files of former versions do not have it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub as_given: Option<serde_json::Value>,
    /// The controller that closes a loop around the model, a model.json object; absent without one. It reads the
    /// outputs at each sample, and its commands are added to the inputs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub controller: Option<serde_json::Value>,
    /// The changes by the refit in words and figures.
    pub refit: Vec<String>,
    /// The course of the inputs between the samples; absent if they are held.
    #[serde(default, skip_serializing_if = "Intersample::is_zoh")]
    pub intersample: Intersample,
    /// The effects. Those on commands act in this order, and so do those on outputs.
    pub effects: Vec<WrittenEffect>,
    /// End of the last record, in s since the first began.
    pub t0: f64,
    /// RMS of the noise of each output, in its unit.
    pub noise_rms: Vec<f64>,
    /// The range of the fitted records; files of former versions do not have it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fitted: Option<FittedRange>,
    /// The thresholds by which `linear` was decomposed; absent if they are the defaults.
    #[serde(default, skip_serializing_if = "is_default")]
    pub plant: PlantSettings,
}

fn is_default(settings: &PlantSettings) -> bool {
    *settings == PlantSettings::default()
}
