//! A linear model of records with a given number of states: a subspace estimate and its output-error refinement.

use ndarray::Array2;
use plid_refine::{Candidate, Choice, Noise, Options, RefineError, Start};

use crate::case::record::{Channels, Record};

/// Largest number of steps of the refinement.
const ITERATIONS: usize = 60;

/// Inputs and target outputs of records, as matrices with a row for each sample.
pub(crate) struct Arrays<'r> {
    records: Vec<&'r Record>,
    matrices: Vec<[Array2<f64>; 2]>,
}

impl<'r> Arrays<'r> {
    /// Takes the inputs of records, and the outputs that a model is to reproduce.
    pub(crate) fn new(records: Vec<&'r Record>, target: impl Fn(&'r Record) -> &'r Channels) -> Self {
        let matrices = records.iter().map(|record| [&record.u, target(record)].map(matrix)).collect();
        Self { records, matrices }
    }

    /// Returns the target outputs of each record.
    pub(crate) fn outputs(&self) -> impl Iterator<Item = &Array2<f64>> {
        self.matrices.iter().map(|[_, y]| y)
    }

    /// Returns the records in the form of the refinement.
    pub(crate) fn records(&self) -> Vec<plid_refine::Record<'_>> {
        let start = |record: &Record| if record.from_rest { Start::Rest } else { Start::Unknown };
        let all = self.records.iter().zip(&self.matrices);
        all.map(|(record, [u, y])| plid_refine::Record { inputs: u.view(), outputs: y.view(), start: start(record) })
            .collect()
    }
}

/// Returns the options for these records. Direct feedthrough is allowed, because it is unknown whether the plant has
/// any.
pub(crate) fn options(records: &[plid_refine::Record]) -> Options {
    Options {
        radius: plid_refine::slowest_radius(records),
        feedthrough: true,
        iterations: ITERATIONS,
        noise: Noise::White,
    }
}

/// Identifies the best model with this number of states. `head` contains the records without the part that decides
/// between candidates.
///
/// # Errors
/// [`RefineError`] if the records do not determine such a model.
pub(crate) fn of_states(
    head: &[plid_refine::Record],
    records: &[plid_refine::Record],
    states: usize,
    rate: f64,
    options: &Options,
) -> Result<Choice, RefineError> {
    let model = plid_refine::subspace(head, states, None, rate, options)?.model;
    let starts = [Candidate { name: "subspace".into(), model }];
    plid_refine::best_of(&starts, records, options, &|_, _| true)
}

/// Returns channels as a matrix with a row for each sample.
pub(crate) fn matrix(channels: &Channels) -> Array2<f64> {
    Array2::from_shape_fn((channels[0].len(), channels.len()), |(k, c)| channels[c][k])
}
