//! `plid identify`: the main task without an experiment file.

use std::path::PathBuf;

use plid::catalogue::VariantChoice;
use plid::catalogue::{BackendName, CovarianceName, ExpectationName, ScalarName};
use plid::lab::data::MissingPolicy;
use plid::lab::experiment::{
    DataConfig, Experiment, IdentificationConfig, IndicesChoice, NoiseConfig, Refinement, StartConfig, StructureConfig,
    ValidationConfig, to_toml,
};
use plid::lab::prepare::{Advance, Preparation};
use plid::lab::report::write_atomic;
use plid::lab::run::{CHECKPOINT, require_own};

use super::directory::Output;
use super::{Failure, Voice};

/// Identify a model from records.
///
/// The equivalent experiment is written to DIR/experiment.toml, so that `plid run DIR/experiment.toml` repeats it. With
/// several records, the end of the last one is held out. Everything else has the defaults of an experiment file: noise
/// covariances tuned on the training data, input advance decided by a test, channels scaled.
#[derive(clap::Args)]
#[command(
    after_help = concat!(
        "Examples:\n",
        "  plid identify record.csv --inputs force --outputs left,right --states 8 --out out/record\n",
        "  plid identify flexible.mat --inputs 1-2 --outputs 3-5 --states 48 --rate 100 --out out/flexible\n",
        "  plid identify record.csv --inputs u --outputs y --scan 2,4,8,12 --out out/scan\n",
        "  plid identify long.npy --inputs 1-2 --outputs 3-4 --states 8 --rate 100 --stream --out out/long",
    )
)]
pub struct Arguments {
    /// Data files: CSV and similar text, MATLAB .mat (v4, v5), NumPy .npz, columns without a header.
    #[arg(required = true)]
    data: Vec<PathBuf>,
    /// Input columns, such as u1,u2, or 1-2 for numbered columns.
    #[arg(long, value_name = "NAMES")]
    inputs: String,
    /// Output columns.
    #[arg(long, value_name = "NAMES")]
    outputs: String,
    /// Number of states [default with --scan: the recommended order].
    #[arg(long, value_name = "N")]
    states: Option<usize>,
    /// Observability indices, one per output, or `search`.
    #[arg(long, value_name = "N1,N2,..")]
    indices: Option<String>,
    /// Numbers of states to compare on the training data.
    #[arg(long, value_name = "N,..", value_delimiter = ',')]
    scan: Vec<usize>,
    /// Sample rate [default: that of the file].
    #[arg(long, value_name = "HZ", allow_negative_numbers = true)]
    rate: Option<f64>,
    /// Decimate to this rate.
    #[arg(long, value_name = "HZ", allow_negative_numbers = true)]
    decimate: Option<f64>,
    /// Number of samples by which the input is advanced, for a plant with direct feedthrough; `auto`: decided by a
    /// test.
    #[arg(long, default_value = "auto", value_parser = ["auto", "0", "1"])]
    advance: String,
    /// Treat a NaN among the outputs as an error, or as a missing sample (nan).
    #[arg(long, default_value = "error", value_parser = ["error", "nan"])]
    missing: String,
    /// Variable of a .mat or .npz file that holds the record.
    #[arg(long, value_name = "NAME")]
    variable: Option<String>,
    /// Read the one file, text or .npy, block by block instead of holding it in memory.
    #[arg(long)]
    stream: bool,
    /// Samples before and after the end of the training part that --stream holds in memory [default: 100000].
    #[arg(long, value_name = "SAMPLES", requires = "stream")]
    window: Option<usize>,
    /// Covariance form: direct, joseph, bierman-ud or array-sqrt [default: recommended for size, scalar and length].
    #[arg(long, value_parser = parse::<CovarianceName>)]
    covariance: Option<CovarianceName>,
    /// Conditional expectation: prior, posterior, moment-matched, certainty-equivalent or joint-ekf.
    #[arg(long, value_parser = parse::<ExpectationName>, default_value = "moment-matched")]
    expectations: ExpectationName,
    /// Matrix library: plain, nalgebra or faer.
    #[arg(long, value_parser = parse::<BackendName>, default_value = "plain")]
    backend: BackendName,
    /// Number type: f32, f64 or double-double.
    #[arg(long, value_parser = parse::<ScalarName>, default_value = "f64")]
    scalar: ScalarName,
    /// Leading share of the last record used for training; the rest is held out.
    #[arg(long, value_name = "SHARE", default_value_t = 0.75)]
    training_share: f64,
    /// Period of a periodic input, in samples of the file; the report then shows the noise floor.
    #[arg(long, value_name = "SAMPLES")]
    period: Option<usize>,
    /// Number of passes over the training data.
    #[arg(long, value_name = "N", default_value_t = 1)]
    passes: usize,
    /// Second model, refined for simulation: output-error or off.
    #[arg(long, value_parser = parse::<Refinement>, default_value = "output-error")]
    refine: Refinement,
    /// Name of the experiment in the report [default: name of the first file].
    #[arg(long)]
    name: Option<String>,
    #[command(flatten)]
    output: Output,
}

/// Parses a word as in an experiment file.
pub(super) fn parse<T: serde::de::DeserializeOwned>(word: &str) -> Result<T, String> {
    use serde::de::IntoDeserializer;
    let word: serde::de::value::StrDeserializer<'_, serde::de::value::Error> = word.into_deserializer();
    T::deserialize(word).map_err(|e| e.to_string())
}

/// No record has that many columns; a longer range is a mistake.
const LONGEST_RANGE: usize = 10_000;

/// Parses a list such as `u1,u2`, or ranges of numbers such as `3-5`.
fn columns(list: &str) -> Result<Vec<String>, Failure> {
    let mut names = Vec::new();
    for word in list.split(',').map(str::trim).filter(|word| !word.is_empty()) {
        match word.split_once('-').map(|(first, last)| (first.parse::<usize>(), last.parse::<usize>())) {
            Some((Ok(first), Ok(last))) if first > last || last - first > LONGEST_RANGE => {
                return Err(Failure::input(format!("{word}: not a range of columns; one is 3-5")));
            }
            Some((Ok(first), Ok(last))) => names.extend((first..=last).map(|column| column.to_string())),
            _ => names.push(word.to_string()),
        }
    }
    Ok(names)
}

fn indices(word: Option<&str>) -> Result<IndicesChoice, Failure> {
    match word {
        None => Ok(IndicesChoice::Balanced),
        Some("search") => Ok(IndicesChoice::Search),
        Some(list) => {
            let numbers: Result<Vec<usize>, _> = list.split(',').map(|n| n.trim().parse()).collect();
            numbers
                .map(IndicesChoice::Given)
                .map_err(|_| Failure::input(format!("--indices {list}: give whole numbers such as 8,8,8, or `search`")))
        }
    }
}

/// Runs the command.
pub fn execute(arguments: Arguments, voice: Voice) -> Result<(), Failure> {
    let stem = arguments.data[0].file_stem().map(|s| s.to_string_lossy().into_owned());
    let name = arguments.name.clone().or(stem).unwrap_or_else(|| "record".into());
    let out = arguments.output.directory(&name)?;
    let experiment = arguments.experiment(name)?;
    if let Some((key, reason)) = experiment.problems().into_iter().next() {
        return Err(Failure::input(format!("{key}: {reason}")));
    }
    let Output { resume, force, .. } = arguments.output;
    if resume && !force {
        require_own(&experiment, &out, &out)?;
    }
    let checkpoint = || std::fs::read(out.join(CHECKPOINT)).ok();
    let before = checkpoint();
    let result = super::run::carry_out(&experiment, &out, &out, resume, voice);
    // An experiment that fails leaves nothing; one that is interrupted leaves a checkpoint and may be continued.
    if result.is_ok() || checkpoint() != before {
        let path = out.join("experiment.toml");
        write_atomic(&path, to_toml(&experiment).as_bytes()).map_err(|error| Failure::file(&path, &error))?;
    }
    result
}

impl Arguments {
    /// Returns the equivalent experiment.
    fn experiment(&self, name: String) -> Result<Experiment, Failure> {
        Ok(Experiment {
            name,
            data: self.data()?,
            preparation: Preparation {
                decimate_to_hz: self.decimate,
                advance: match self.advance.as_str() {
                    "0" => Advance::No,
                    "1" => Advance::Yes,
                    _ => Advance::Auto,
                },
                ..Preparation::default()
            },
            structure: StructureConfig {
                states: self.states,
                indices: indices(self.indices.as_deref())?,
                scan: self.scan.clone(),
                ..StructureConfig::default()
            },
            noise: NoiseConfig::default(),
            variant: VariantChoice {
                covariance: self.covariance,
                expectations: self.expectations,
                backend: self.backend,
                scalar: self.scalar,
            },
            start: StartConfig::default(),
            identification: IdentificationConfig {
                passes: self.passes,
                refine: self.refine,
                ..IdentificationConfig::default()
            },
            validation: ValidationConfig {
                training_share: self.training_share,
                period: self.period,
                ..ValidationConfig::default()
            },
        })
    }

    fn data(&self) -> Result<DataConfig, Failure> {
        // The written file may be run from any folder.
        let absolute = |path: &PathBuf| std::fs::canonicalize(path).map_err(|error| Failure::file(path, &error));
        Ok(DataConfig {
            files: self.data.iter().map(absolute).collect::<Result<_, _>>()?,
            inputs: columns(&self.inputs)?,
            outputs: columns(&self.outputs)?,
            sample_rate_hz: self.rate,
            missing: if self.missing == "nan" { MissingPolicy::Nan } else { MissingPolicy::Error },
            stream: self.stream,
            window: self.window,
            variable: self.variable.clone(),
            ..DataConfig::default()
        })
    }
}
