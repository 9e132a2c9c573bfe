//! The reasons why runs cannot be merged.

use std::path::PathBuf;

use crate::run::RunError;

/// The reasons why runs cannot be merged into one model.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
pub enum MergeError {
    /// The parameter covariance of a run is not positive definite.
    #[error(
        "run {run}: the covariance of its parameters is not positive definite (entry {entry} of the parameters, from 0)"
    )]
    #[diagnostic(help(
        "repeat the run in double precision with `covariance = \"bierman-ud\"`, which keeps it positive \
        definite"
    ))]
    Indefinite {
        /// The run.
        run: String,
        /// The parameter at which the factorisation fails, from 0.
        entry: usize,
    },
    /// A posterior variance exceeds the prior variance.
    #[error(
        "run {run}: a variance of its parameters is {factor:.3} times the prior variance, but data can only reduce \
        it"
    )]
    AbovePrior {
        /// The run.
        run: String,
        /// The largest ratio of posterior to prior variance.
        factor: f64,
    },
    /// The numbers of a run do not describe a Gaussian distribution.
    #[error("run {run}: {problem}")]
    Unusable {
        /// The run.
        run: String,
        /// The problem with the numbers.
        problem: String,
    },
    /// One run fixes a parameter at zero that another run estimates.
    #[error("run {held} fixes parameter {place} (from 0) at zero but run {free} does not: their structures differ")]
    Priors {
        /// The run that fixes the parameter.
        held: String,
        /// The run that estimates it.
        free: String,
        /// The index of the parameter, from 0.
        place: usize,
    },
    /// A file of a finished run lacks a key or has an invalid one.
    #[error("{}: key `{key}` {problem}", file.display())]
    Key {
        /// The file.
        file: PathBuf,
        /// The key.
        key: String,
        /// The problem with the key.
        problem: String,
    },
    /// Two runs differ in a property that they must share.
    #[error("{run}: its {what} {found}, that of {first} {expected}")]
    Differ {
        /// The run.
        run: String,
        /// The property that differs.
        what: &'static str,
        /// Its value in this run.
        found: String,
        /// The run used for comparison.
        first: String,
        /// Its value in the run used for comparison.
        expected: String,
    },
    /// More than one input acts in a record.
    #[error(
        "{record}: `{acting}` is active there, and so is `{other}` ({share:.2e} of its RMS elsewhere); in a record \
         for a merge, one input is active and the others are at rest"
    )]
    #[diagnostic(help(
        "a run with several active inputs must model all of them: identify that record with all inputs"
    ))]
    AnotherActs {
        /// The file or run.
        record: String,
        /// The input that the run identifies.
        acting: String,
        /// The input that should be at rest.
        other: String,
        /// Its RMS in this record over its RMS in the run that identifies it.
        share: f64,
    },
    /// No input acts in a record.
    #[error("{record}: none of the inputs {inputs} is active there")]
    NoneActs {
        /// The file.
        record: String,
        /// The inputs.
        inputs: String,
    },
    /// No record has this input active.
    #[error("input `{input}` is active in none of {records}")]
    NeverActs {
        /// The input.
        input: String,
        /// The files.
        records: String,
    },
    /// One of the runs failed.
    #[error("run {run}: {source}")]
    Run {
        /// The run.
        run: String,
        /// The error of the run.
        source: Box<RunError>,
    },
    /// There is only one run.
    #[error("a merge requires at least two runs")]
    TooFew,
}
