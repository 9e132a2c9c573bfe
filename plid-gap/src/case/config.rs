use std::collections::BTreeMap;

use plid_model::{Model, OutputKind};
use serde::{Deserialize, Serialize};

use crate::case::Limits;
use crate::settings::GapSettings;
use plid_data::prepare::decimate;
use plid_data::prepare::trend::Trend;

/// CASE.toml.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CaseConfig {
    /// A model.json; left out, the best linear model of the records stands in.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sim: Option<String>,
    /// Order of that model.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub states: Option<usize>,
    /// Of the records and of the simulation.
    pub sample_rate_hz: f64,
    /// Records are decimated to this rate, which then is that of the simulation; left out, they are not.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub decimate_to_hz: Option<f64>,
    /// What is taken from every channel of the records: `none` (if left out), `mean` or `linear`.
    #[serde(default = "no_trend", skip_serializing_if = "is_no_trend")]
    pub trend: Trend,
    /// Frequencies that are fitted and judged, from and to in Hz; left out, all are.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub band_hz: Option<[f64; 2]>,
    /// Columns of the records.
    pub inputs: Vec<String>,
    /// Columns of the records.
    pub outputs: Vec<String>,
    /// What outputs measure, by name; left out, as the simulation declares or shows it.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub output_kinds: BTreeMap<String, OutputKind>,
    /// Effects or locations that the engineer suspects.
    #[serde(default)]
    pub suspects: Vec<String>,
    /// Effects or locations that cannot be.
    #[serde(default)]
    pub exclude: Vec<String>,
    /// How far the simulation may be off.
    #[serde(default)]
    pub nuisance: Limits,
    /// A gap beyond the noise that matters, relative to the output.
    #[serde(default = "material")]
    pub material: f64,
    /// Thresholds of the diagnosis.
    #[serde(default, skip_serializing_if = "GapSettings::is_default")]
    pub settings: GapSettings,
    /// In the order in which they were taken.
    #[serde(default)]
    pub record: Vec<RecordConfig>,
}

/// Two per cent of the output.
fn material() -> f64 {
    0.02
}

fn no_trend() -> Trend {
    Trend::None
}

fn is_no_trend(trend: &Trend) -> bool {
    *trend == Trend::None
}

/// A record of a case.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RecordConfig {
    /// Beside the case.
    pub file: String,
    /// First row of the file that counts, from 0, and the one behind the last; left out, all do.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub samples: Option<[usize; 2]>,
    /// What drove it.
    #[serde(default = "random")]
    pub excitation: ExcitationKind,
    /// Samples; periodic only. Left out, it is found.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub period: Option<usize>,
    /// The state at its start.
    #[serde(default)]
    pub start: StartKind,
    /// Since the first record began; left out, records are back to back.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub start_s: Option<f64>,
    /// For fitting, held out, or for the simulation that is missing; left out, the diagnosis chooses.
    #[serde(default, rename = "use", skip_serializing_if = "Option::is_none")]
    pub r#use: Option<Use>,
    /// What the engineer's own simulator gave for this input.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub simulated: Option<String>,
}

/// What drove a record.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ExcitationKind {
    /// Nothing.
    Zero,
    /// A signal that does not repeat.
    Random,
    /// A signal that repeats.
    Periodic,
}

fn random() -> ExcitationKind {
    ExcitationKind::Random
}

/// The state at the start of a record.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum StartKind {
    /// Zero.
    #[default]
    Rest,
    /// Fitted.
    Unknown,
}

/// What a record is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Use {
    /// Fitting.
    Fit,
    /// Held out.
    Test,
    /// The simulation is identified from it, and nothing else is done with it.
    Sim,
}

impl RecordConfig {
    /// What is wrong with the values, as key and reason; one sample in `ratio` is kept.
    fn problems(&self, ratio: usize) -> Vec<(&'static str, String)> {
        let mut problems = Vec::new();
        if let Some([from, to]) = self.samples
            && from >= to
        {
            problems.push(("samples", format!("{}: no sample lies from {from} to {to}", self.file)));
        }
        let wrong = match (self.excitation, self.period) {
            (ExcitationKind::Periodic, Some(period)) if period < 2 => format!("{period} is no period"),
            (ExcitationKind::Periodic, Some(period)) if !period.is_multiple_of(ratio) => {
                format!("{period} samples are no multiple of the {ratio} of which one is kept")
            }
            (ExcitationKind::Zero | ExcitationKind::Random, Some(_)) => "only a periodic record has one".to_string(),
            _ => return problems,
        };
        problems.push(("period", format!("{}: {wrong}", self.file)));
        problems
    }

    fn is_for_simulation(&self) -> bool {
        self.r#use == Some(Use::Sim)
    }
}

impl CaseConfig {
    /// A case of channels at a rate, with nothing else said.
    pub fn new(sample_rate_hz: f64, inputs: Vec<String>, outputs: Vec<String>) -> Self {
        Self {
            sim: None,
            states: None,
            sample_rate_hz,
            decimate_to_hz: None,
            trend: Trend::None,
            band_hz: None,
            inputs,
            outputs,
            output_kinds: BTreeMap::new(),
            suspects: Vec::new(),
            exclude: Vec::new(),
            nuisance: Limits::default(),
            material: material(),
            settings: GapSettings::default(),
            record: Vec::new(),
        }
    }

    /// What is wrong with the values, as key and reason.
    pub fn problems(&self) -> Vec<(&'static str, String)> {
        let mut problems = Vec::new();
        if !(self.sample_rate_hz.is_finite() && self.sample_rate_hz > 0.0) {
            problems.push(("sample_rate_hz", format!("{} is not positive", self.sample_rate_hz)));
        }
        if !(self.material.is_finite() && self.material >= 0.0) {
            problems.push(("material", format!("{} is no share of the output", self.material)));
        }
        if self.record.iter().all(RecordConfig::is_for_simulation) {
            let message = "a case needs at least one [[record]] that is not for the simulation";
            problems.push(("record", message.to_string()));
        }
        if self.sim.is_some() && self.record.iter().any(RecordConfig::is_for_simulation) {
            problems.push(("use", "\"sim\" is for a case without `sim`: here the simulation is given".to_string()));
        }
        if let Some(name) = self.output_kinds.keys().find(|name| !self.outputs.contains(name)) {
            problems.push(("output_kinds", format!("`{name}` is none of the outputs")));
        }
        let ratio = match self.ratio() {
            Ok(ratio) => ratio,
            Err(message) => {
                problems.push(("decimate_to_hz", message));
                1
            }
        };
        problems.extend(self.record.iter().flat_map(|record| record.problems(ratio)));
        if let Some([from, to]) = self.band_hz
            && !(0.0 <= from && from < to && to <= 0.5 * self.rate())
        {
            let message = format!("{from} to {to} is no band from 0 to half the rate, {}", 0.5 * self.rate());
            problems.push(("band_hz", message));
        }
        let limits = [
            ("frequency", self.nuisance.frequency),
            ("damping", self.nuisance.damping),
            ("shape", self.nuisance.shape),
        ];
        for (key, value) in limits {
            if !(value.is_finite() && value > 0.0) {
                problems.push((key, format!("{value} is not positive")));
            }
        }
        let simulated = self.record.iter().filter(|record| record.simulated.is_some()).count();
        if simulated != 0 && simulated != self.record.len() {
            problems.push(("simulated", "either every record has its simulated outputs or none".to_string()));
        }
        problems.extend(self.settings.problems());
        problems
    }

    /// Of the samples of a file one in so many is kept.
    ///
    /// # Errors
    /// If `decimate_to_hz` is no integer fraction of the rate.
    pub fn ratio(&self) -> Result<usize, String> {
        let Some(to) = self.decimate_to_hz else { return Ok(1) };
        decimate::plan(self.sample_rate_hz, to).map(|plan| plan.ratio).map_err(|error| error.to_string())
    }

    /// Lets a model know what the case says of its outputs.
    pub(crate) fn declare_kinds(&self, model: &mut Model) {
        for (declared, output) in model.output_kinds.iter_mut().zip(&self.outputs) {
            *declared = self.output_kinds.get(output).copied().or(*declared);
        }
    }

    /// Samples a second of what is diagnosed.
    pub fn rate(&self) -> f64 {
        self.sample_rate_hz / self.ratio().unwrap_or(1) as f64
    }
}
