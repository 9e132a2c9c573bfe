//! diagnosis.json and sim-with-effect.json.

use std::collections::BTreeMap;
use std::fmt;

use plid_report::Cell;
use serde::{Deserialize, Serialize};

use crate::answer::range::FittedRange;
use crate::effects::Side;
use crate::judge::locate::LevelGap;
pub use crate::judge::shrink::{Gap, ShrinkOver};
pub use crate::judge::verdict::Verdict;
use crate::settings::{GapSettings, PlantSettings};

/// A parameter's value with its 95 % interval.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Value {
    /// The estimate.
    pub value: f64,
    /// Its interval, where the fit gives one.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub ci95: Option<[f64; 2]>,
    /// In the channels' and ports' own units.
    pub unit: String,
}

/// A number of the simulation that is to change.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Change {
    /// Which one, in words.
    pub number: String,
    /// As the simulation has it.
    pub from: f64,
    /// As it should be.
    pub to: Value,
}

/// "factor of output y2 from 1.0000 to 1.0721 (1.0602 to 1.0840)".
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
    /// Where.
    pub location: String,
    /// Probability that it is at work there.
    pub confidence: f64,
    /// Of the squared gap beyond noise and limits, what this effect closes on held-out records, the others staying. None of what no free run shows.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub share: Option<f64>,
    /// Its 95 % interval.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub share_ci95: Option<[f64; 2]>,
    /// By name.
    pub parameters: BTreeMap<String, Value>,
    /// Which number of the simulation is to change, where the effect is no more than that.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub change: Option<Change>,
    /// The same place but a shape near this one.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub shape_differs: bool,
}

/// An effect at a place.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Located {
    /// Its identifier.
    pub effect: String,
    /// Where.
    pub location: String,
}

/// An explanation that the data leave open.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Explanation {
    /// Empty for nothing or for something else.
    pub effects: Vec<Located>,
    /// Something outside the vocabulary.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub unknown: bool,
    /// All add up to one.
    pub probability: f64,
    /// Expected gap with it, where it is a fit.
    pub gap_after: Option<f64>,
}

/// Where the gap lies.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Where {
    /// Side of the chain.
    pub side: Side,
    /// Share of the squared gap of each output.
    pub channels: BTreeMap<String, f64>,
    /// From, to (Hz), share: the bands that hold most of it.
    pub bands_hz: Vec<[f64; 3]>,
    /// Share of the squared gap of each of eight stretches of time.
    pub time: Vec<f64>,
    /// Slope of log relative gap against log level, where levels differ.
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
    #[serde(default)]
    pub level_slope_ci95: Option<[f64; 2]>,
    /// Gap beyond the noise of each record that `level_slope` rests on.
    #[serde(default)]
    pub levels: Vec<LevelGap>,
}

/// What the best explanation leaves, on the records where the gap was measured.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Remainder {
    /// The gap, noise included.
    pub gap: f64,
    /// What noise alone makes.
    pub noise: f64,
    /// Of the squared gap as given beyond the noise, what is left.
    pub share_of_gap: f64,
    /// Probability that what is left beyond the noise is more than what the case calls material.
    pub further_cause: f64,
    /// Where it lies on the fitted records.
    #[serde(rename = "where", default)]
    pub place: RemainderPlace,
    /// Effects that would explain most of it, though none of them enough.
    pub nearest: Vec<Located>,
}

/// Where a remainder lies.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct RemainderPlace {
    /// Share of each output.
    pub channels: BTreeMap<String, f64>,
    /// From, to (Hz), share: the bands that hold most of it.
    pub bands_hz: Vec<[f64; 3]>,
}

/// Whether the records could part an explanation from the best one. Differences are in log likelihood, the best explanation taken for true.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Comparison {
    /// As in `not_separable`.
    pub explanation: String,
    /// Share of its trace that a bounded refit absorbs, where it is one entry of the first screen.
    pub absorbed: Option<f64>,
    /// Cosine between what is left of its trace and of that of the best explanation's effect, in whose place it would stand.
    pub cosine: Option<f64>,
    /// Expected difference, to first order, before any fit.
    pub expected_before: Option<f64>,
    /// Expected difference with the explanation fitted to what the best one foretells.
    pub expected: Option<f64>,
    /// The difference that the records made.
    pub realised: Option<f64>,
}

/// The answer.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Diagnosis {
    /// In a word.
    pub verdict: Verdict,
    /// In a sentence.
    pub sentence: String,
    /// Largest share of the gap first.
    pub effects: Vec<NamedEffect>,
    /// Most probable first.
    pub candidates: Vec<Explanation>,
    /// Causes that these records cannot part.
    pub not_separable: Vec<Vec<String>>,
    /// Whether they could: the best explanation first.
    #[serde(default)]
    pub separability: Vec<Comparison>,
    /// Where.
    #[serde(rename = "where")]
    pub place: Where,
    /// How far.
    pub gap: Gap,
    /// What the best explanation leaves.
    #[serde(default)]
    pub remainder: Remainder,
    /// What would part what is left.
    pub next_experiment: Option<String>,
    /// Thresholds of the diagnosis.
    #[serde(default)]
    pub settings: GapSettings,
    /// The evidence in words.
    pub evidence: Vec<String>,
    /// What was noticed.
    pub warnings: Vec<String>,
}

/// An effect as another program can use it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct WrittenEffect {
    /// Its identifier.
    pub effect: String,
    /// Where.
    pub location: String,
    /// By name.
    pub parameters: BTreeMap<String, Value>,
    /// Numbers of the simulation that the equation uses: the pole that moves.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub given: BTreeMap<String, Value>,
    /// What it does.
    pub equation: String,
}

/// sim-with-effect.json: all that a prediction uses.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SimulationWithEffects {
    /// "simulation-with-effects".
    pub format: String,
    /// A model.json object after the bounded refit, in modal coordinates: the first 2 `modes` states are (Re z, Im z) of each mode, with
    /// dz/dt = pole z + b u.
    pub linear: serde_json::Value,
    /// Modes of `linear`.
    pub modes: usize,
    /// The same with the effects that change the linear model itself (modal effects): simulate this one where there is any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub linear_with_modal_effects: Option<serde_json::Value>,
    /// What was changed, in words and figures.
    pub refit: Vec<String>,
    /// Those on commands, and those on outputs, act in this order.
    pub effects: Vec<WrittenEffect>,
    /// End of the last record, in s since the first began.
    pub t0: f64,
    /// RMS of the noise of each output, in its unit.
    pub noise_rms: Vec<f64>,
    /// What it was fitted to; files of former versions do not have it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fitted: Option<FittedRange>,
    /// The thresholds by which `linear` was decomposed; absent if they are the defaults.
    #[serde(default, skip_serializing_if = "is_default")]
    pub plant: PlantSettings,
}

fn is_default(settings: &PlantSettings) -> bool {
    *settings == PlantSettings::default()
}
