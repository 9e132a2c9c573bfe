use std::collections::BTreeMap;

use plid_model::{Model, OutputKind};
use serde::{Deserialize, Serialize};

use crate::case::{ControllerConfig, Limits, SimulatorConfig};
use crate::settings::GapSettings;
use plid_data::nearest;
use plid_data::prepare::decimate;
use plid_data::prepare::trend::Trend;

/// Prefix of the names of ports on single modes; the mode's frequency follows. No case may declare a port with such a
/// name.
pub(crate) const ON_A_MODE: &str = "mode:";

/// The contents of a case file, CASE.toml.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CaseConfig {
    /// File of the simulation, a model.json. If absent, the best linear model of the records serves as a surrogate.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sim: Option<String>,
    /// The engineer's own simulator, which is run during the diagnosis.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub simulator: Option<SimulatorConfig>,
    /// The controller that was active while the records were taken.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub controller: Option<ControllerConfig>,
    /// Number of states of the surrogate model.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub states: Option<usize>,
    /// Sample rate of the records, and of the simulation unless `decimate_to_hz` is given.
    pub sample_rate_hz: f64,
    /// Sample rate to which the records are decimated, which is that of the simulation. If absent, they are not
    /// decimated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub decimate_to_hz: Option<f64>,
    /// Trend that is removed from every channel of the records: `none` (default), `mean` or `linear`.
    #[serde(default = "no_trend", skip_serializing_if = "is_no_trend")]
    pub trend: Trend,
    /// Frequency band in Hz that is fitted and judged. If absent, all frequencies are used.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub band_hz: Option<[f64; 2]>,
    /// Columns of the records that are inputs.
    pub inputs: Vec<String>,
    /// Columns of the records that are outputs.
    pub outputs: Vec<String>,
    /// Quantities that the outputs measure, by name. If absent, they are those that the simulation declares or that
    /// are inferred from it.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub output_kinds: BTreeMap<String, OutputKind>,
    /// Units of the channels, by name. Quantities of the answer are given in these units.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub units: BTreeMap<String, String>,
    /// Places where forces that depend on the motion may act, each declared by an input and an output.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub port: Vec<PortConfig>,
    /// Effects or locations that the engineer suspects.
    #[serde(default)]
    pub suspects: Vec<String>,
    /// Effects or locations that are ruled out.
    #[serde(default)]
    pub exclude: Vec<String>,
    /// Limits of the simulation's errors.
    #[serde(default)]
    pub nuisance: Limits,
    /// The smallest gap beyond the noise that matters, relative to the output.
    #[serde(default = "material")]
    pub material: f64,
    /// Thresholds of the diagnosis.
    #[serde(default, skip_serializing_if = "GapSettings::is_default")]
    pub settings: GapSettings,
    /// The records in the order in which they were taken.
    #[serde(default)]
    pub record: Vec<RecordConfig>,
}

/// A place where a force may act. The force acts on the same states as an input, and an output shows the motion of the
/// place.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PortConfig {
    /// Its name.
    pub name: String,
    /// The input that acts there.
    pub input: String,
    /// The output that shows the motion there.
    pub output: String,
}

/// Returns the default: two per cent of the output.
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
    /// The file, relative to the case.
    pub file: String,
    /// First row of the file that is used, counted from 0, and the row after the last one. If absent, all rows are
    /// used.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub samples: Option<[usize; 2]>,
    /// The excitation.
    #[serde(default = "random")]
    pub excitation: ExcitationKind,
    /// Period in samples, for periodic excitation only. If absent, it is estimated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub period: Option<usize>,
    /// The state at its start.
    #[serde(default)]
    pub start: StartKind,
    /// Start in s since the first record began. If absent, the record follows the previous one immediately.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub start_s: Option<f64>,
    /// Use of the record: for fitting, held out, or for a missing simulation. If absent, the diagnosis chooses.
    #[serde(default, rename = "use", skip_serializing_if = "Option::is_none")]
    pub r#use: Option<Use>,
    /// File of the outputs that the engineer's own simulator gives for this input.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub simulated: Option<String>,
}

/// The excitation of a record.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ExcitationKind {
    /// No input.
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
    /// The state is zero.
    #[default]
    Rest,
    /// The state is fitted.
    Unknown,
}

/// The use of a record.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Use {
    /// It is fitted.
    Fit,
    /// It is held out.
    Test,
    /// The simulation is identified from it; it has no other use.
    Sim,
}

impl RecordConfig {
    /// Returns whether the case holds the record out.
    pub fn is_held_out(&self) -> bool {
        self.r#use == Some(Use::Test)
    }

    /// Returns the invalid values, as key and reason. One sample in `ratio` is kept.
    fn problems(&self, ratio: usize) -> Vec<(&'static str, String)> {
        let mut problems = Vec::new();
        if let Some([from, to]) = self.samples
            && from >= to
        {
            problems.push(("samples", format!("{}: no sample lies from {from} to {to}", self.file)));
        }
        let wrong = match (self.excitation, self.period) {
            (ExcitationKind::Periodic, Some(period)) if period < 2 => format!("{period} is not a period"),
            (ExcitationKind::Periodic, Some(period)) if !period.is_multiple_of(ratio) => {
                format!("{period} samples are not a multiple of the decimation ratio {ratio}")
            }
            (ExcitationKind::Zero | ExcitationKind::Random, Some(_)) => {
                "only a periodic record has a period".to_string()
            }
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
    /// Returns whether the case states which records are held out.
    pub fn names_held_out(&self) -> bool {
        self.record.iter().any(RecordConfig::is_held_out)
    }

    /// Returns the names of the files of a case: simulation, controller and records, as they are written in the case.
    pub fn files(&self) -> Vec<&str> {
        let given = self.sim.iter().chain(self.controller.iter().map(|controller| &controller.model));
        let records = self.record.iter().flat_map(|record| std::iter::once(&record.file).chain(&record.simulated));
        given.chain(records).map(String::as_str).collect()
    }

    /// Creates a case with these channels and this sample rate, and with default values otherwise.
    pub fn new(sample_rate_hz: f64, inputs: Vec<String>, outputs: Vec<String>) -> Self {
        Self {
            sim: None,
            simulator: None,
            controller: None,
            states: None,
            sample_rate_hz,
            decimate_to_hz: None,
            trend: Trend::None,
            band_hz: None,
            inputs,
            outputs,
            output_kinds: BTreeMap::new(),
            units: BTreeMap::new(),
            port: Vec::new(),
            suspects: Vec::new(),
            exclude: Vec::new(),
            nuisance: Limits::default(),
            material: material(),
            settings: GapSettings::default(),
            record: Vec::new(),
        }
    }

    /// Returns the invalid values, as key and reason.
    pub fn problems(&self) -> Vec<(&'static str, String)> {
        let mut problems = Vec::new();
        if !(self.sample_rate_hz.is_finite() && self.sample_rate_hz > 0.0) {
            problems.push(("sample_rate_hz", format!("{} is not positive", self.sample_rate_hz)));
        }
        if !(self.material.is_finite() && self.material >= 0.0) {
            problems.push(("material", format!("{} is not a share of the output", self.material)));
        }
        if self.record.iter().all(RecordConfig::is_for_simulation) {
            let message = "a case needs at least one [[record]] that is not for the simulation";
            problems.push(("record", message.to_string()));
        }
        if self.sim.is_some() && self.record.iter().any(RecordConfig::is_for_simulation) {
            problems.push(("use", "\"sim\" is for a case without `sim`: here the simulation is given".to_string()));
        }
        problems.extend(self.simulator.iter().flat_map(|simulator| simulator.problems(self.sim.is_some())));
        if let Some(name) = self.output_kinds.keys().find(|name| !self.outputs.contains(name)) {
            problems.push(("output_kinds", format!("`{name}` is not one of the outputs")));
        }
        problems.extend(self.controller_problems());
        if self.controller.is_none() {
            problems.extend(self.channel_problems(&[]));
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
            let message = format!("{from} to {to} is not a band from 0 to half the sample rate, {}", 0.5 * self.rate());
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

    /// Returns the keys that cannot be combined with a controller, with reasons.
    fn controller_problems(&self) -> Vec<(&'static str, String)> {
        if self.controller.is_none() {
            return Vec::new();
        }
        let mut problems = Vec::new();
        if self.simulator.is_some() {
            let message = "a simulator in the loop contains its controller: its inputs are the references";
            problems.push(("controller", message.to_string()));
        } else if self.sim.is_none() {
            let message = "it needs `sim`: a model of the records would contain the controller";
            problems.push(("controller", message.to_string()));
        }
        if self.decimate_to_hz.is_some() {
            let message = "a controller acts at every sample: give records and simulation at its rate";
            problems.push(("decimate_to_hz", message.to_string()));
        }
        problems
    }

    /// Returns the units and ports that do not name channels, as key and reason. `references` are further channels
    /// that have units. In closed loop, this check has to wait until the inputs are those of the simulation.
    pub(super) fn channel_problems(&self, references: &[String]) -> Vec<(&'static str, String)> {
        let mut problems = self.unit_problems(references);
        problems.extend(self.port_problems());
        problems
    }

    /// Returns the invalid units, as key and reason.
    fn unit_problems(&self, references: &[String]) -> Vec<(&'static str, String)> {
        let names: Vec<String> = self.inputs.iter().chain(&self.outputs).chain(references).cloned().collect();
        let problem = |(name, unit): (&String, &String)| {
            if unit.trim().is_empty() {
                return Some(("units", format!("the unit of `{name}` is empty")));
            }
            let meant = || nearest(name, &names).map(|name| format!("; did you mean `{name}`?")).unwrap_or_default();
            (!names.contains(name)).then(|| ("units", format!("`{name}` is not one of the channels{}", meant())))
        };
        self.units.iter().filter_map(problem).collect()
    }

    /// Returns the invalid values of the ports, as key and reason.
    fn port_problems(&self) -> Vec<(&'static str, String)> {
        let mut problems = Vec::new();
        for (at, port) in self.port.iter().enumerate() {
            let PortConfig { name, input, output } = port;
            if name.is_empty() || name.starts_with(ON_A_MODE) {
                problems.push((
                    "name",
                    format!("`{name}` is not the name of a port: it is empty or begins with {ON_A_MODE}"),
                ));
            }
            if self.port[..at].iter().any(|other| other.name == *name) {
                problems.push(("name", format!("two ports are called `{name}`")));
            }
            for (key, given, names) in [("input", input, &self.inputs), ("output", output, &self.outputs)] {
                if !names.contains(given) {
                    let meant = nearest(given, names).map(|name| format!("; did you mean `{name}`?"));
                    let message = format!("port `{name}`: `{given}` is not one of the {key}s");
                    problems.push((key, message + &meant.unwrap_or_default()));
                }
            }
        }
        problems
    }

    /// Returns the decimation ratio k: every k-th sample is kept.
    ///
    /// # Errors
    /// Returns a message if `decimate_to_hz` is not an integer fraction of the rate.
    pub fn ratio(&self) -> Result<usize, String> {
        let Some(to) = self.decimate_to_hz else { return Ok(1) };
        decimate::plan(self.sample_rate_hz, to).map(|plan| plan.ratio).map_err(|error| error.to_string())
    }

    /// Returns the units of these channels, where the case declares them.
    pub(crate) fn units_of(&self, names: &[String]) -> Vec<Option<String>> {
        names.iter().map(|name| self.units.get(name).cloned()).collect()
    }

    /// Sets the kinds of a model's outputs as the case declares them.
    pub(crate) fn declare_kinds(&self, model: &mut Model) {
        for (declared, output) in model.output_kinds.iter_mut().zip(&self.outputs) {
            *declared = self.output_kinds.get(output).copied().or(*declared);
        }
    }

    /// Returns the sample rate of the diagnosis in Hz.
    pub fn rate(&self) -> f64 {
        self.sample_rate_hz / self.ratio().unwrap_or(1) as f64
    }
}
