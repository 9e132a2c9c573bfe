//! `plid identify`: the main job without an experiment file.

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

use super::{Failure, Voice, directory};

/// Identify a model from records.
///
/// The experiment that the arguments stand for is written to DIR/experiment.toml, so that `plid run DIR/experiment.toml`
/// repeats it. With several records the last one's tail is held out. Everything not given here has the defaults of an
/// experiment file: noise covariances tuned on the training data, an input advance found by a test, channels scaled.
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  plid identify record.csv --inputs force --outputs left,right --states 8 --out out/record\n  plid identify flexible.mat --inputs 1-2 --outputs 3-5 --states 48 --rate 100 --out out/flexible\n  plid identify record.csv --inputs u --outputs y --scan 2,4,8,12 --out out/scan"
)]
pub struct Arguments {
    /// Data files: CSV and its relatives, MATLAB .mat (v4, v5), NumPy .npz, headerless columns.
    #[arg(required = true)]
    data: Vec<PathBuf>,
    /// The columns that are inputs, such as u1,u2 or, of numbered columns, 1-2.
    #[arg(long, value_name = "NAMES")]
    inputs: String,
    /// The columns that are outputs.
    #[arg(long, value_name = "NAMES")]
    outputs: String,
    /// The number of states; left out with --scan, the recommended one.
    #[arg(long, value_name = "N")]
    states: Option<usize>,
    /// The observability indices, one an output; or `search`.
    #[arg(long, value_name = "N1,N2,..")]
    indices: Option<String>,
    /// Orders to compare.
    #[arg(long, value_name = "N,..", value_delimiter = ',')]
    scan: Vec<usize>,
    /// Samples a second; left out, the file's own.
    #[arg(long, value_name = "HZ", allow_negative_numbers = true)]
    rate: Option<f64>,
    /// Decimate to this rate.
    #[arg(long, value_name = "HZ", allow_negative_numbers = true)]
    decimate: Option<f64>,
    /// Advance the input by this many samples, for a plant that answers at once; `auto`: by a test.
    #[arg(long, default_value = "auto", value_parser = ["auto", "0", "1"])]
    advance: String,
    /// What a NaN among the outputs is.
    #[arg(long, default_value = "error", value_parser = ["error", "nan"])]
    missing: String,
    /// The variable of a .mat or .npz file that holds the record.
    #[arg(long, value_name = "NAME")]
    variable: Option<String>,
    /// How the covariance is carried: direct, joseph, bierman-ud or array-sqrt; left out, what is recommended for the size, scalar and length.
    #[arg(long, value_parser = parse::<CovarianceName>)]
    covariance: Option<CovarianceName>,
    /// The conditional expectation: prior, posterior, moment-matched, certainty-equivalent or joint-ekf.
    #[arg(long, value_parser = parse::<ExpectationName>, default_value = "moment-matched")]
    expectations: ExpectationName,
    /// The matrix library: plain, nalgebra or faer.
    #[arg(long, value_parser = parse::<BackendName>, default_value = "plain")]
    backend: BackendName,
    /// The number type: f32, f64 or double-double.
    #[arg(long, value_parser = parse::<ScalarName>, default_value = "f64")]
    scalar: ScalarName,
    /// The leading share of the last record that is learnt from; the rest is held out.
    #[arg(long, value_name = "SHARE", default_value_t = 0.75)]
    training_share: f64,
    /// Period of a periodic input, in samples of the data as given; shows the noise floor.
    #[arg(long, value_name = "SAMPLES")]
    period: Option<usize>,
    /// How often the training data are gone through.
    #[arg(long, value_name = "N", default_value_t = 1)]
    passes: usize,
    /// A second model, refined for simulation: output-error, or off.
    #[arg(long, value_parser = parse::<Refinement>, default_value = "output-error")]
    refine: Refinement,
    /// What the experiment is called in the report; left out, the first file's name.
    #[arg(long)]
    name: Option<String>,
    /// Where the results go; out/NAME if left out.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Go on from the checkpoint of an interrupted run in the output directory.
    #[arg(long)]
    resume: bool,
    /// Write into a directory that is not empty.
    #[arg(long)]
    force: bool,
}

/// A word as an experiment file has it.
pub(super) fn parse<T: serde::de::DeserializeOwned>(word: &str) -> Result<T, String> {
    use serde::de::IntoDeserializer;
    let word: serde::de::value::StrDeserializer<'_, serde::de::value::Error> = word.into_deserializer();
    T::deserialize(word).map_err(|e| e.to_string())
}

/// No record has so many columns; a longer range is a slip.
const LONGEST_RANGE: usize = 10_000;

/// `u1,u2`, or ranges of numbers such as `3-5`.
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
    let out = arguments.out.clone().unwrap_or_else(|| directory::default_for(&name));
    directory::check(&out, arguments.force || arguments.resume)?;
    // The file that is written may be run from anywhere.
    let absolute = |path: &PathBuf| std::fs::canonicalize(path).map_err(|error| Failure::file(path, &error));
    let experiment = Experiment {
        name,
        data: DataConfig {
            files: arguments.data.iter().map(absolute).collect::<Result<_, _>>()?,
            inputs: columns(&arguments.inputs)?,
            outputs: columns(&arguments.outputs)?,
            sample_rate_hz: arguments.rate,
            missing: if arguments.missing == "nan" { MissingPolicy::Nan } else { MissingPolicy::Error },
            variable: arguments.variable.clone(),
            ..DataConfig::default()
        },
        preparation: Preparation {
            decimate_to_hz: arguments.decimate,
            advance: match arguments.advance.as_str() {
                "0" => Advance::No,
                "1" => Advance::Yes,
                _ => Advance::Auto,
            },
            ..Preparation::default()
        },
        structure: StructureConfig {
            states: arguments.states,
            indices: indices(arguments.indices.as_deref())?,
            scan: arguments.scan.clone(),
            ..StructureConfig::default()
        },
        noise: NoiseConfig::default(),
        variant: VariantChoice {
            covariance: arguments.covariance,
            expectations: arguments.expectations,
            backend: arguments.backend,
            scalar: arguments.scalar,
        },
        start: StartConfig::default(),
        identification: IdentificationConfig {
            passes: arguments.passes,
            refine: arguments.refine,
            ..IdentificationConfig::default()
        },
        validation: ValidationConfig {
            training_share: arguments.training_share,
            period: arguments.period,
            ..ValidationConfig::default()
        },
    };
    if let Some((key, reason)) = experiment.problems().into_iter().next() {
        return Err(Failure::input(format!("{key}: {reason}")));
    }
    if arguments.resume && !arguments.force {
        require_own(&experiment, &out, &out)?;
    }
    let result = super::run::carry_out(&experiment, &out, &out, arguments.resume, voice);
    // An experiment that could not be begun leaves nothing behind; one that was interrupted may be taken up.
    if result.is_ok() || out.join(CHECKPOINT).exists() {
        let path = out.join("experiment.toml");
        write_atomic(&path, to_toml(&experiment).as_bytes()).map_err(|error| Failure::file(&path, &error))?;
    }
    result
}
