//! Free runs: simulations from the input alone, with at most the initial state fitted to the output.

use crate::case::Limits;
use crate::case::record::{Channels, Record};
use crate::effects::Action;
use crate::fit::nuisance::Nuisance;
use crate::fit::problem::{Placed, Problem, sum_of_squares};
use crate::plant::Plant;
use crate::simulate::{Fineness, State, simulate};

/// Factor by which an output must exceed its peak in the linear simulation, or in the records if that is larger, for a
/// run to have diverged. No physical effect reaches it.
const OUT_OF_BOUNDS: f64 = 1e3;

/// Largest number of corrections of an initial state by the error of the run with effects. The derivatives are those
/// of the linear response, so a single correction leaves a transient where the effects are strong.
const MOST_CORRECTIONS: usize = 6;

/// Share of the squared error below which another correction is worth a run.
const WORTH_ANOTHER: f64 = 0.98;

/// Returns whether a value of an output belongs to a run that diverges. `peak` is the largest magnitude of this output
/// in the linear simulation and in the records; a zero gives no bound.
pub(crate) fn diverges(y: f64, peak: f64) -> bool {
    !y.is_finite() || peak > 0.0 && y.abs() > OUT_OF_BOUNDS * peak
}

/// Returns the free runs of all fitted records.
pub(crate) fn outputs(problem: &Problem, eta: &[f64], effects: &[Placed]) -> Vec<Channels> {
    let plant = problem.nuisance.apply(&problem.plant, eta);
    let actions = problem.actions(effects);
    let run = |k| problem.outputs(&plant, eta, &actions, k, Fineness::FINE);
    (0..problem.records.len()).map(run).collect()
}

/// Returns the errors of the free runs.
pub(crate) fn errors(problem: &Problem, eta: &[f64], effects: &[Placed]) -> Vec<Channels> {
    problem.records.iter().zip(outputs(problem, eta, effects)).map(|(record, y)| record.error(&y)).collect()
}

/// Returns the free run of a record. An unknown initial state is fitted first.
pub(crate) fn run(plant: &Plant, actions: &[Action], record: &Record) -> Channels {
    let start = (!record.from_rest).then(|| fitted_start(plant, actions, record));
    simulate(plant, actions, &record.u, record.start_s, start.as_ref(), Fineness::FINE)
}

/// Returns the initial state that explains a record best, by least squares on the linear response. It is fitted first
/// without effects, and then corrected by the error of the run with them. A run from rest would begin with a
/// transient that the record does not have, and that effects may amplify.
fn fitted_start(plant: &Plant, actions: &[Action], record: &Record) -> State {
    let nuisance = Nuisance::new(plant, std::slice::from_ref(record), &Limits::default());
    let (first, states) = (nuisance.of_simulation(), nuisance.states());
    let mut columns = nalgebra::DMatrix::zeros(record.y.len() * record.samples(), states);
    let mut y = vec![vec![0.0; record.samples()]; record.y.len()];
    let derivatives = nuisance.by_start(plant, record.samples(), 0);
    derivatives.write(&derivatives.columns, &record.u, &mut y, |column, y| {
        let flat: Vec<f64> = y.iter().flatten().copied().collect();
        columns.column_mut(column.parameter - first).copy_from_slice(&flat);
    });
    let mut normal = columns.tr_mul(&columns);
    let ridge = 1e-9 * normal.trace().max(f64::MIN_POSITIVE);
    (0..states).for_each(|i| normal[(i, i)] += ridge);
    let Some(factor) = normal.cholesky() else { return State::rest(plant) };
    let state = |eta: &[f64]| nuisance.start(0, eta).unwrap_or_else(|| State::rest(plant));
    let left = |eta: &[f64], actions: &[Action]| -> Vec<f64> {
        let y = simulate(plant, actions, &record.u, record.start_s, Some(&state(eta)), Fineness::FINE);
        record.error(&y).into_iter().flatten().collect()
    };
    let corrected = |eta: &[f64], error: Vec<f64>| -> Vec<f64> {
        let step = factor.solve(&columns.tr_mul(&nalgebra::DVector::from_vec(error)));
        let mut eta = eta.to_vec();
        eta[first..].iter_mut().zip(step.iter()).for_each(|(x, dx)| *x += dx);
        eta
    };
    let rest = vec![0.0; nuisance.len()];
    let mut best = corrected(&rest, left(&rest, &[]));
    if actions.is_empty() {
        return state(&best);
    }
    let mut error = left(&best, actions);
    for _ in 0..MOST_CORRECTIONS {
        let before = sum_of_squares(&error);
        let next = corrected(&best, error);
        error = left(&next, actions);
        let after = sum_of_squares(&error);
        if after < before {
            best = next;
        }
        // A run that diverges ends in NaN.
        if after.is_nan() || after > WORTH_ANOTHER * before {
            break;
        }
    }
    state(&best)
}
