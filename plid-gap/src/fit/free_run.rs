//! Free runs: simulations from the input alone, with at most the initial state fitted to the output.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

use crate::case::Limits;
use crate::case::record::{Channels, Record, rms};
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

/// Step of the differences with respect to a displacement that no output depends on, over its size.
const UNSEEN_STEP: f64 = 1e-3;

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

/// The least-squares correction of an initial state by the error of a run.
struct Correction {
    /// Derivatives of all outputs with respect to the entries of the state.
    columns: DMatrix<f64>,
    factor: Cholesky<f64, Dyn>,
}

impl Correction {
    /// Returns the correction by these derivatives; `None` if the outputs do not depend on the state.
    fn new(columns: DMatrix<f64>) -> Option<Self> {
        let mut normal = columns.tr_mul(&columns);
        let ridge = 1e-9 * normal.trace().max(f64::MIN_POSITIVE);
        (0..normal.nrows()).for_each(|i| normal[(i, i)] += ridge);
        Some(Self { factor: normal.cholesky()?, columns })
    }

    fn of(&self, error: &[f64]) -> DVector<f64> {
        self.factor.solve(&self.columns.tr_mul(&DVector::from_column_slice(error)))
    }
}

/// Returns outputs (p channels) one after the other, each divided by its size. Samples that the record lacks are zero,
/// so that they neither count nor respond.
fn joined(record: &Record, y: &[Vec<f64>], sizes: &[f64]) -> Vec<f64> {
    let of_output = |((y, measured), size): ((&Vec<f64>, &Vec<f64>), &f64)| -> Vec<f64> {
        y.iter().zip(measured).map(|(y, measured)| if measured.is_finite() { y / size } else { 0.0 }).collect()
    };
    y.iter().zip(&record.y).zip(sizes).flat_map(of_output).collect()
}

/// Returns the initial state that explains a record best, by least squares on the linear response. It is fitted first
/// without effects, and then corrected by the error of the run with them. A run from rest would begin with a
/// transient that the record does not have, and that effects may amplify. A displacement that no output depends on
/// shows in the effects alone, so its derivatives are differences of runs with them. Each output counts relative to its
/// RMS, because the units of outputs may differ by many orders of magnitude.
fn fitted_start(plant: &Plant, actions: &[Action], record: &Record) -> State {
    let nuisance = Nuisance::new(plant, std::slice::from_ref(record), &Limits::default());
    let (first, states) = (nuisance.of_simulation(), nuisance.states());
    let size = |y: &Vec<f64>| rms(y.iter().filter(|y| y.is_finite()));
    let sizes: Vec<f64> = record.y.iter().map(size).map(|size| if size > 0.0 { size } else { 1.0 }).collect();
    let mut columns = DMatrix::zeros(record.y.len() * record.samples(), states);
    let mut y = vec![vec![0.0; record.samples()]; record.y.len()];
    let derivatives = nuisance.by_start(plant, record.samples(), 0);
    derivatives.write(&derivatives.columns, &record.u, &mut y, |column, y| {
        columns.column_mut(column.parameter - first).copy_from_slice(&joined(record, y, &sizes));
    });
    let Some(linear) = Correction::new(columns) else { return State::rest(plant) };
    let state = |eta: &[f64]| nuisance.start(0, eta).unwrap_or_else(|| State::rest(plant));
    let left = |eta: &[f64], actions: &[Action]| -> Vec<f64> {
        let y = simulate(plant, actions, &record.u, record.start_s, Some(&state(eta)), Fineness::FINE);
        joined(record, &record.error(&y), &sizes)
    };
    let corrected = |eta: &[f64], by: &Correction, error: &[f64]| -> Vec<f64> {
        let mut eta = eta.to_vec();
        eta[first..].iter_mut().zip(by.of(error).iter()).for_each(|(x, dx)| *x += dx);
        eta
    };
    let rest = vec![0.0; nuisance.len()];
    let mut best = corrected(&rest, &linear, &left(&rest, &[]));
    if actions.is_empty() {
        return state(&best);
    }
    let mut error = left(&best, actions);
    for _ in 0..MOST_CORRECTIONS {
        let before = sum_of_squares(&error);
        let with_effects = with_unseen(plant, &linear, &error, &|entry| {
            let mut moved = best.clone();
            moved[first + entry] += UNSEEN_STEP;
            left(&moved, actions)
        });
        let next = corrected(&best, with_effects.as_ref().unwrap_or(&linear), &error);
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

/// Returns the correction of the linear response with the derivatives, by differences, with respect to the states that
/// no output depends on; `None` if there are none. `moved` gives the error after a step of an entry.
fn with_unseen(
    plant: &Plant,
    linear: &Correction,
    error: &[f64],
    moved: &dyn Fn(usize) -> Vec<f64>,
) -> Option<Correction> {
    let (first, seen, all) = (2 * plant.modes.len(), plant.rest.seen(), plant.rest.a.nrows());
    if seen == all {
        return None;
    }
    let mut columns = linear.columns.clone();
    for entry in first + seen..first + all {
        let slopes = error.iter().zip(moved(entry)).map(|(now, moved)| (now - moved) / UNSEEN_STEP);
        columns.column_mut(entry).iter_mut().zip(slopes).for_each(|(to, slope)| *to = slope);
    }
    Correction::new(columns)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::{Library, Place, Setting};
    use crate::testing::{held, random_input, record};
    use nalgebra::dmatrix;
    use plid_model::{Model, OutputKind};

    /// Returns a plant of two lags with these poles, each with an input and an output, and the end of its record after
    /// a large constant command.
    fn two_lags(poles: [f64; 2], units: [f64; 2]) -> (Plant, Record) {
        let a = dmatrix![poles[0], 0.0; 0.0, poles[1]];
        let (b, c) = (dmatrix![1.0, 0.0; 0.0, 1.0], dmatrix![units[0], 0.0; 0.0, units[1]]);
        let model = Model::new(100.0, a, b, c, dmatrix![0.0, 0.0; 0.0, 0.0]).unwrap();
        let mut u = random_input(3, 600, 2);
        u.iter_mut().for_each(|u| u[..200].fill(5.0));
        let y = crate::testing::run(&model, &u);
        let cut = |x: &Channels| -> Channels { x.iter().map(|x| x[200..].to_vec()).collect() };
        (Plant::new(&model).unwrap(), Record { from_rest: false, ..record(cut(&u), cut(&y)) })
    }

    /// Returns the relative error of each output.
    fn far(plant: &Plant, start: &Record, y: &Channels) -> Vec<f64> {
        let error = Record { y: y.clone(), ..start.clone() }.error(&run(plant, &[], start));
        error.iter().zip(y).map(|(error, y)| rms(error) / rms(y)).collect()
    }

    /// An output in a small unit shows its part of the initial state as well as one in a large unit.
    #[test]
    fn the_unit_of_an_output_does_not_hide_the_start_at_another() {
        let (plant, measured) = two_lags([0.98, 0.95], [1e6, 1.0]);
        let far = far(&plant, &measured, &measured.y);
        assert!(far.iter().all(|far| *far < 1e-4), "{far:?}");
    }

    /// Samples that are missing, as at the beginning of a record whose end is held out, say nothing about the start.
    #[test]
    fn missing_samples_do_not_hold_the_start_at_rest() {
        let (plant, measured) = two_lags([0.998, 0.995], [1.0, 1.0]);
        let mut late = measured.clone();
        late.y.iter_mut().for_each(|y| y[..100].fill(f64::NAN));
        let far = far(&plant, &late, &measured.y);
        assert!(far.iter().all(|far| *far < 1e-4), "{far:?}");
    }

    /// The position of a motor at the beginning of a record shows in the force of a stiffening spring alone.
    #[test]
    fn a_position_that_no_output_shows_is_fitted_by_the_effect() {
        let (a, b) = held(&dmatrix![-4.0], &dmatrix![1.0], 4e-3);
        let mut model = Model::new(250.0, a, b, dmatrix![1.0], dmatrix![0.0]).unwrap();
        model.output_kinds = vec![Some(OutputKind::Velocity)];
        let plant = Plant::new(&model).unwrap();
        let library = Library::standard();
        let spring = library.get("cubic-stiffness").unwrap();
        let actions = spring.act(&Setting::bare(&plant, &model), &Place::Input(0), &[400.0]);
        let u = vec![random_input(1, 50, 1)[0].iter().flat_map(|u| [*u; 10]).collect::<Vec<f64>>()];
        let mut start = State::rest(&plant);
        start.rest[plant.rest.seen()] = 0.15;
        let y = simulate(&plant, &actions, &u, 0.0, Some(&start), Fineness::FINE);
        let measured = Record { from_rest: false, ..record(u, y) };
        let far = |y: &Channels| sum_of_squares(&measured.error(y)[0]) / sum_of_squares(&measured.y[0]);
        let still = simulate(&plant, &actions, &measured.u, 0.0, None, Fineness::FINE);
        let found = run(&plant, &actions, &measured);
        assert!(far(&found) < 1e-6 && far(&still) > 1e-3, "{} {}", far(&found), far(&still));
    }
}
