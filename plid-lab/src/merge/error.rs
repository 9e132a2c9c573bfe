//! What keeps runs from being merged.

use std::path::PathBuf;

use crate::run::RunError;

/// Runs that cannot become one model.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
pub enum MergeError {
    /// A covariance that is none.
    #[error(
        "run {run}: the covariance of its parameters is not positive definite (entry {entry} of the parameters, from 0)"
    )]
    #[diagnostic(help("run it in double precision with `covariance = \"bierman-ud\"`, which cannot lose it"))]
    Indefinite {
        /// The run.
        run: String,
        /// The parameter at which the factorisation ends.
        entry: usize,
    },
    /// Less is known after the data than before.
    #[error("run {run}: a variance of its parameters is {factor:.3} times the prior's; data can only lessen it")]
    AbovePrior {
        /// The run.
        run: String,
        /// The largest variance over the prior's.
        factor: f64,
    },
    /// Numbers that make no Gaussian.
    #[error("run {run}: {problem}")]
    Unusable {
        /// The run.
        run: String,
        /// What is wrong.
        problem: String,
    },
    /// One run holds a parameter at zero that another one leaves free.
    #[error("run {held} holds parameter {place} (from 0) at zero, run {free} does not: their structures differ")]
    Priors {
        /// The run that holds it.
        held: String,
        /// The run that does not.
        free: String,
        /// The parameter.
        place: usize,
    },
    /// A file of a finished run that lacks something.
    #[error("{}: key `{key}` {problem}", file.display())]
    Key {
        /// The file.
        file: PathBuf,
        /// The key.
        key: String,
        /// What is wrong with it.
        problem: String,
    },
    /// Runs that differ in what they must have in common.
    #[error("{run}: its {what} {found}, that of {first} {expected}")]
    Differ {
        /// The run.
        run: String,
        /// What differs.
        what: &'static str,
        /// What it has.
        found: String,
        /// The run that it was put beside.
        first: String,
        /// What that has.
        expected: String,
    },
    /// A record in which more than one input acts.
    #[error(
        "{record}: `{acting}` acts there, and `{other}` too ({share:.2e} of its RMS elsewhere); a record for a merge has one input at work and the others at rest"
    )]
    #[diagnostic(help(
        "with another input known to act, a run is as large as one of all inputs: identify that record with all of them"
    ))]
    AnotherActs {
        /// The file or run.
        record: String,
        /// The input that the run is about.
        acting: String,
        /// The input that should be at rest.
        other: String,
        /// Its RMS there over its RMS in the run that it belongs to.
        share: f64,
    },
    /// A record in which no input acts.
    #[error("{record}: none of the inputs {inputs} acts there")]
    NoneActs {
        /// The file.
        record: String,
        /// The inputs.
        inputs: String,
    },
    /// An input without a record.
    #[error("input `{input}` acts in none of {records}")]
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
        /// Why.
        source: Box<RunError>,
    },
    /// One run alone.
    #[error("a merge needs at least two runs")]
    TooFew,
}
