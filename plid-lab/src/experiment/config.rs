//! The keys of an experiment file with their defaults, which `manifest.json` records.

use std::fmt;
use std::path::PathBuf;

use plid_testbed::TrussConfig;
use serde::de::value::MapAccessDeserializer;
use serde::de::{self, IntoDeserializer, MapAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};

use plid_catalogue::VariantChoice;
use plid_data::MissingPolicy;
use plid_data::prepare::Preparation;

/// An experiment.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Experiment {
    /// The name used in reports and directories.
    #[serde(default = "unnamed")]
    pub name: String,
    /// The source of the data.
    pub data: DataConfig,
    /// The preparation of the data before identification.
    #[serde(default)]
    pub preparation: Preparation,
    /// The canonical form.
    #[serde(default, deserialize_with = "word_or_table")]
    pub structure: StructureConfig,
    /// The noise covariances.
    #[serde(default)]
    pub noise: NoiseConfig,
    /// The scalar type, covariance form and expectation of the recursion.
    #[serde(default)]
    pub variant: VariantChoice,
    /// The initial estimate and its covariance.
    #[serde(default)]
    pub start: StartConfig,
    /// The settings of the recursion.
    #[serde(default)]
    pub identification: IdentificationConfig,
    /// The validation data and tests.
    #[serde(default)]
    pub validation: ValidationConfig,
}

fn unnamed() -> String {
    "experiment".into()
}

/// The source of the data: either files or the simulated truss.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DataConfig {
    /// Data files, each one record; paths are relative to the experiment file.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub files: Vec<PathBuf>,
    /// The columns used as inputs.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub inputs: Vec<String>,
    /// The columns used as outputs.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub outputs: Vec<String>,
    /// Sample rate in Hz. The default is the file's own `Fs` or time column.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sample_rate_hz: Option<f64>,
    /// The unit of the inputs, for the axes of the report.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub input_unit: Option<String>,
    /// The unit of the outputs.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub output_unit: Option<String>,
    /// The treatment of NaN among the outputs: `error`, or `nan` for a missing sample.
    pub missing: MissingPolicy,
    /// Whether the one file is read block by block instead of held in memory.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub stream: bool,
    /// Samples before and after the end of the training part that a streamed run holds in memory. The default is
    /// 100000.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub window: Option<usize>,
    /// The variable of a .mat or .npz file that contains the record.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub variable: Option<String>,
    /// The simulated truss, instead of files.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub testbed: Option<TestbedData>,
}

/// The simulated truss and its input.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TestbedData {
    /// An input from a file (columns u1, u2, u3, in V) instead of `truss.input`; it determines the length of the
    /// record.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub input_file: Option<PathBuf>,
    /// The truss with its converters, noise and seed.
    pub truss: TrussConfig,
}

/// The canonical form, given by a number of states or by the indices.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct StructureConfig {
    /// Whether all inputs are identified together or each in a separate run.
    #[serde(skip_serializing_if = "StructureKind::is_default")]
    pub kind: StructureKind,
    /// Number of states n, distributed evenly over the outputs unless `indices` specifies otherwise. The default is the
    /// recommendation of the scan.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub states: Option<usize>,
    /// The observability indices n_1, ..., n_p, `"balanced"` (the default), or `"search"`, which selects them from
    /// the data.
    pub indices: IndicesChoice,
    /// Orders to be compared on the training data. Without `states`, the recommended one is used.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub scan: Vec<usize>,
}

/// How the inputs are identified.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum StructureKind {
    /// All together, from records in which they may act simultaneously (the default).
    #[default]
    Mimo,
    /// Each in a separate run, from a record in which only this input acts; the runs are then merged.
    SimoMerge,
}

impl StructureKind {
    fn is_default(&self) -> bool {
        *self == Self::default()
    }
}

/// Reads a structure. A word such as `structure = "simo-merge"` gives only the kind; a table may contain further
/// keys.
fn word_or_table<'de, D: Deserializer<'de>>(deserializer: D) -> Result<StructureConfig, D::Error> {
    struct Either;
    impl<'de> Visitor<'de> for Either {
        type Value = StructureConfig;

        fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
            formatter.write_str("a table, or the word \"simo-merge\"")
        }

        fn visit_str<E: de::Error>(self, word: &str) -> Result<StructureConfig, E> {
            let kind = StructureKind::deserialize(word.into_deserializer())?;
            Ok(StructureConfig { kind, ..StructureConfig::default() })
        }

        fn visit_map<M: MapAccess<'de>>(self, map: M) -> Result<StructureConfig, M::Error> {
            StructureConfig::deserialize(MapAccessDeserializer::new(map))
        }
    }
    deserializer.deserialize_any(Either)
}

/// How the states are distributed over the outputs.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "IndicesWord", into = "IndicesWord")]
pub enum IndicesChoice {
    /// As evenly as possible.
    #[default]
    Balanced,
    /// Selected from the data.
    Search,
    /// As specified.
    Given(Vec<usize>),
}

#[derive(Serialize, Deserialize)]
#[serde(untagged)]
enum IndicesWord {
    Given(Vec<usize>),
    Word(String),
}

impl TryFrom<IndicesWord> for IndicesChoice {
    type Error = String;

    fn try_from(word: IndicesWord) -> Result<Self, String> {
        match word {
            IndicesWord::Given(indices) => Ok(Self::Given(indices)),
            IndicesWord::Word(word) if word == "balanced" => Ok(Self::Balanced),
            IndicesWord::Word(word) if word == "search" => Ok(Self::Search),
            IndicesWord::Word(word) => Err(format!("indices are a list, \"balanced\" or \"search\", not \"{word}\"")),
        }
    }
}

impl From<IndicesChoice> for IndicesWord {
    fn from(choice: IndicesChoice) -> Self {
        match choice {
            IndicesChoice::Balanced => Self::Word("balanced".into()),
            IndicesChoice::Search => Self::Word("search".into()),
            IndicesChoice::Given(indices) => Self::Given(indices),
        }
    }
}

/// The source of the noise covariances.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum NoiseSource {
    /// A filter bank, scored by simulation error on training data (the default).
    #[default]
    Tuned,
    /// The keys `sensor`, `actuator`, `state` and the cross-covariances.
    Given,
    /// The paper's values 0.005, 0.005, 0.010, read as covariances.
    PaperLiteral,
    /// The paper's values read as RMS in volts.
    PaperSquared,
    /// R from the spread of averaged repeats; Sigma from the filter bank.
    Repeats,
    /// R from a record at rest, `zero_input_file`; Sigma from the filter bank.
    ZeroInput,
    /// R from the quantisation step of the converter, estimated from the data; Sigma from the filter bank.
    Converter,
}

/// The meaning of the numbers under `[noise]`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum NoiseReading {
    /// Covariances, in the square of the channel's unit.
    #[default]
    Covariance,
    /// Standard deviations, for single numbers and lists only.
    Rms,
}

/// A covariance: one number for all channels, one number per channel, or a full matrix (rows).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Covariance {
    /// Independent channels with equal variances.
    Common(f64),
    /// Independent channels with one variance each.
    Diagonal(Vec<f64>),
    /// A full matrix, row by row.
    Full(Vec<Vec<f64>>),
}

/// The noise model of the paper's Eq. 5, in the units of the data.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct NoiseConfig {
    /// The source of the covariances.
    pub from: NoiseSource,
    /// Whether the numbers are covariances or RMS values.
    pub read_as: NoiseReading,
    /// R (p x p). With `from = "tuned"`, a given R is taken as known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sensor: Option<Covariance>,
    /// Q (m x m); the default is 0.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub actuator: Option<Covariance>,
    /// Sigma (n x n).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub state: Option<Covariance>,
    /// S^{vw} (m x p).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub actuator_sensor: Option<Vec<Vec<f64>>>,
    /// S^{w xi} (p x n).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sensor_state: Option<Vec<Vec<f64>>>,
    /// S^{v xi} (m x n).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub actuator_state: Option<Vec<Vec<f64>>>,
    /// The record at rest for `from = "zero-input"`, with outputs of the same names as in the data.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub zero_input_file: Option<PathBuf>,
}

/// The initial estimate and its covariance, for channels of unit RMS.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct StartConfig {
    /// Prior variance of each entry of x.
    pub state_variance: f64,
    /// Prior variance of each parameter.
    pub parameter_variance: f64,
    /// An earlier model.json in observable canonical form to start from, with its parameter covariance if it has one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub model: Option<PathBuf>,
    /// Factor on the parameter covariance of the earlier model: above 1 for a plant that has changed.
    pub widen: f64,
}

impl Default for StartConfig {
    fn default() -> Self {
        Self { state_variance: 1.0, parameter_variance: 1.0, model: None, widen: 1.0 }
    }
}

/// Whether a second model is refined for simulation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Refinement {
    /// By the simulation error on the training data (the default).
    #[default]
    OutputError,
    /// No second model; the subspace estimate is still computed for comparison.
    Off,
}

/// The settings of the recursion.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct IdentificationConfig {
    /// Number of passes over the training data.
    pub passes: usize,
    /// Exponential forgetting factor by which P is divided at each step; 1 for none.
    pub forgetting: f64,
    /// Variance added to each parameter's variance at each step; 0 for none.
    pub parameter_noise: f64,
    /// The refinement of a second model for simulation: `output-error` or `off`.
    pub refine: Refinement,
}

impl Default for IdentificationConfig {
    fn default() -> Self {
        Self { passes: 1, forgetting: 1.0, parameter_noise: 0.0, refine: Refinement::default() }
    }
}

/// The validation data and tests.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ValidationConfig {
    /// The leading fraction of the last record used for training; the rest is held out. Earlier records are used for
    /// training.
    pub training_share: f64,
    /// The fraction of the training data on which the filters of the noise bank run; the rest scores them.
    pub learning_share: f64,
    /// With `structure.kind = "simo-merge"`, a record in which all inputs act. Its leading `training_share`
    /// determines the state, and the rest scores the merged model. By default, the testbed simulates one; for files
    /// there is none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub file: Option<PathBuf>,
    /// Whether only the recursive model is computed, as in a study of many runs. No predictor gain is fitted then, so
    /// there are no one-step errors on held-out data and no residual tests, and no other model is estimated. The gain
    /// and the other models take longer than the recursion.
    pub model_only: bool,
    /// Largest lag of the residual tests; the default depends on the length of the record.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lags: Option<usize>,
    /// Period of a periodic input in samples of the original data, for the noise floor; by default none is assumed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub period: Option<usize>,
    /// The band of the report's frequency responses in Hz; the default is the band in which the inputs have power.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub band_hz: Option<[f64; 2]>,
}

impl Default for ValidationConfig {
    fn default() -> Self {
        Self {
            training_share: 0.75,
            learning_share: 0.75,
            file: None,
            model_only: false,
            lags: None,
            period: None,
            band_hz: None,
        }
    }
}

impl Experiment {
    /// Returns every file that the experiment names, relative to the experiment file.
    pub fn files(&self) -> impl Iterator<Item = &PathBuf> {
        let input = self.data.testbed.as_ref().and_then(|testbed| testbed.input_file.as_ref());
        let others =
            [input, self.noise.zero_input_file.as_ref(), self.start.model.as_ref(), self.validation.file.as_ref()];
        self.data.files.iter().chain(others.into_iter().flatten())
    }

    /// Returns the invalid values as pairs of key and reason; unknown words are rejected when the file is read.
    pub fn problems(&self) -> Vec<(&'static str, String)> {
        let mut problems = Vec::new();
        let data = &self.data;
        match (&data.testbed, data.files.is_empty()) {
            (Some(_), false) => problems.push(("data", "give files or a testbed, not both".into())),
            (None, true) => problems.push(("data", "give `files`, or a table `[data.testbed]`".into())),
            (None, false) if data.inputs.is_empty() => problems.push(("data", "`inputs` are missing".into())),
            (None, false) if data.outputs.is_empty() => problems.push(("data", "`outputs` are missing".into())),
            _ => {}
        }
        self.problems_of_numbers(&mut problems);
        let structure = &self.structure;
        let is_open = structure.states.is_none() && !matches!(structure.indices, IndicesChoice::Given(_));
        if is_open && structure.scan.is_empty() && structure.kind == StructureKind::Mimo {
            problems.push(("structure", "give `states`, `indices` or orders to `scan`".into()));
        }
        if let (IndicesChoice::Given(indices), Some(states)) = (&structure.indices, structure.states) {
            let sum = indices.iter().copied().fold(0, usize::saturating_add);
            if sum != states {
                problems.push(("indices", format!("they add up to {sum}, but `states` is {states}")));
            }
        }
        let IdentificationConfig { forgetting, parameter_noise, .. } = self.identification;
        if let Err(error) = self.variant.check(forgetting, parameter_noise) {
            problems.push(("variant", error.to_string()));
        }
        self.problems_of_noise(&mut problems);
        self.problems_of_a_stream(&mut problems);
        match structure.kind {
            StructureKind::SimoMerge => self.problems_of_a_merge(is_open, &mut problems),
            StructureKind::Mimo if self.validation.file.is_some() => {
                problems.push(("file", "a separate record for validation requires `kind = \"simo-merge\"`".into()));
            }
            StructureKind::Mimo => {}
        }
        problems
    }

    /// Returns the numbers that are out of range.
    fn problems_of_numbers(&self, problems: &mut Vec<(&'static str, String)>) {
        let mut share = |key: &'static str, value: f64| {
            if !(value > 0.0 && value < 1.0) {
                problems.push((key, format!("{value} is not between 0 and 1")));
            }
        };
        share("training_share", self.validation.training_share);
        share("learning_share", self.validation.learning_share);
        let mut positive = |key: &'static str, value: f64| {
            if !(value > 0.0 && value.is_finite()) {
                problems.push((key, format!("{value} is not above 0")));
            }
        };
        positive("state_variance", self.start.state_variance);
        positive("parameter_variance", self.start.parameter_variance);
        positive("widen", self.start.widen);
        let forgetting = self.identification.forgetting;
        if !(forgetting > 0.0 && forgetting <= 1.0) {
            problems.push(("forgetting", format!("{forgetting} is not above 0 and at most 1")));
        }
        let noise = self.identification.parameter_noise;
        if !(noise >= 0.0 && noise.is_finite()) {
            problems.push(("parameter_noise", format!("{noise} is not 0 or above")));
        }
        if self.identification.passes == 0 {
            problems.push(("passes", "at least one pass over the data is needed".into()));
        }
    }

    /// Returns the missing keys of a source of noise covariances.
    fn problems_of_noise(&self, problems: &mut Vec<(&'static str, String)>) {
        if self.noise.from == NoiseSource::Given {
            for (key, value) in [("sensor", &self.noise.sensor), ("state", &self.noise.state)] {
                if value.is_none() {
                    problems.push(("noise", format!("from = \"given\" needs `{key}`")));
                }
            }
        }
        if self.noise.from == NoiseSource::ZeroInput && self.noise.zero_input_file.is_none() {
            problems.push(("noise", "from = \"zero-input\" needs `zero_input_file`".into()));
        }
        if self.noise.from == NoiseSource::Repeats
            && self.preparation.repeats.is_none()
            && self.data.testbed.as_ref().is_none_or(|t| t.truss.repeats < 2)
        {
            problems
                .push(("noise", "from = \"repeats\" needs `[preparation.repeats]` or a testbed with repeats".into()));
        }
    }

    /// Returns the settings that a streamed run must not have, because they need the whole record.
    fn problems_of_a_stream(&self, problems: &mut Vec<(&'static str, String)>) {
        let data = &self.data;
        if !data.stream {
            if data.window.is_some() {
                problems.push(("window", "only a run with `stream = true` has a window".into()));
            }
            return;
        }
        let mut refuse = |is_set: bool, reason: &str| {
            if is_set {
                problems.push(("stream", reason.into()));
            }
        };
        refuse(data.testbed.is_some(), "the testbed simulates its record in memory; give a file");
        refuse(data.testbed.is_none() && data.files.len() != 1, "exactly one file can be streamed");
        refuse(data.variable.is_some(), "only text and .npy files can be streamed, and they have no `variable`");
        refuse(data.window == Some(0), "`window` must be at least 1");
        refuse(self.structure.kind == StructureKind::SimoMerge, "the runs of a merge cannot be streamed");
        refuse(self.validation.period.is_some(), "the noise floor from `period` needs the whole record");
        let source = self.noise.from;
        refuse(
            matches!(source, NoiseSource::Repeats | NoiseSource::ZeroInput | NoiseSource::Converter),
            "noise that is measured on the data needs the whole record; give it, or have it tuned",
        );
        if let Some(step) = self.preparation.not_in_blocks() {
            problems.push(("stream", format!("the step `{step}` of the preparation needs the whole record")));
        }
    }

    /// Returns the settings that runs for a merge must not have.
    fn problems_of_a_merge(&self, is_open: bool, problems: &mut Vec<(&'static str, String)>) {
        let structure = &self.structure;
        if is_open || !structure.scan.is_empty() || structure.indices == IndicesChoice::Search {
            let reason = "all runs of a merge need the same: give `states` or a list of `indices`, as in structure = { \
                kind = \"simo-merge\", states = 30 }";
            problems.push(("structure", reason.into()));
        }
        let identification = &self.identification;
        if identification.forgetting < 1.0 || identification.parameter_noise > 0.0 {
            problems.push((
                "identification",
                "runs with forgetting have no common A: a merge requires forgetting = 1 and no parameter noise".into(),
            ));
        }
        if self.start.model.is_some() {
            problems.push((
                "model",
                "runs that start from an earlier model have no common prior, so they cannot be merged".into(),
            ));
        }
        if matches!(self.noise.actuator, Some(Covariance::Full(_))) {
            problems.push(("actuator", "runs with one input have a scalar variance: give a number or a list".into()));
        }
        let data = &self.data;
        if data.testbed.as_ref().is_some_and(|testbed| testbed.input_file.is_some()) {
            problems.push((
                "input_file",
                "for a merge the testbed generates records in which one input acts: omit the file".into(),
            ));
        }
        if data.testbed.is_none() && data.files.len() == 1 {
            problems.push(("files", "a merge requires one file for each run, with one active input each".into()));
        }
    }
}
