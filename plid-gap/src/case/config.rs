use serde::{Deserialize, Serialize};

use crate::nuisance::Limits;
use crate::record::Excitation;

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
    /// Columns of the records.
    pub inputs: Vec<String>,
    /// Columns of the records.
    pub outputs: Vec<String>,
    /// Effects or locations that the engineer suspects.
    #[serde(default)]
    pub suspects: Vec<String>,
    /// Effects or locations that cannot be.
    #[serde(default)]
    pub exclude: Vec<String>,
    /// How far the simulation may be off.
    #[serde(default)]
    pub nuisance: Limits,
    /// In the order in which they were taken.
    #[serde(default)]
    pub record: Vec<RecordConfig>,
}

/// A record of a case.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RecordConfig {
    /// Beside the case.
    pub file: String,
    /// What drove it.
    #[serde(default = "random")]
    pub excitation: ExcitationKind,
    /// Samples; periodic only.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub period: Option<usize>,
    /// The state at its start.
    #[serde(default)]
    pub start: StartKind,
    /// Since the first record began; left out, records are back to back.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub start_s: Option<f64>,
    /// For fitting or held out; left out, the diagnosis chooses.
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
}

impl RecordConfig {
    /// With the period.
    pub fn excitation(&self) -> Excitation {
        match self.excitation {
            ExcitationKind::Zero => Excitation::Zero,
            ExcitationKind::Random => Excitation::Random,
            ExcitationKind::Periodic => Excitation::Periodic(self.period.unwrap_or(0)),
        }
    }
}

impl CaseConfig {
    /// What is wrong with the values, as key and reason.
    pub fn problems(&self) -> Vec<(&'static str, String)> {
        let mut problems = Vec::new();
        if !(self.sample_rate_hz.is_finite() && self.sample_rate_hz > 0.0) {
            problems.push(("sample_rate_hz", format!("{} is not positive", self.sample_rate_hz)));
        }
        if self.record.is_empty() {
            problems.push(("record", "a case needs at least one [[record]]".to_string()));
        }
        for record in &self.record {
            match (record.excitation, record.period) {
                (ExcitationKind::Periodic, None) => {
                    problems.push((
                        "excitation",
                        format!("{}: a periodic record needs its `period` in samples", record.file),
                    ));
                }
                (ExcitationKind::Periodic, Some(period)) if period < 2 => {
                    problems.push(("period", format!("{}: {period} is no period", record.file)));
                }
                (ExcitationKind::Zero | ExcitationKind::Random, Some(_)) => {
                    problems.push(("period", format!("{}: only a periodic record has one", record.file)));
                }
                _ => {}
            }
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
        problems
    }
}
