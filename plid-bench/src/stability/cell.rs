//! One cell: a form in one scalar processes the record of a group and is inspected at intervals.

use std::time::{Duration, Instant};

use plid_catalogue::{CovarianceName, Recursion, ScalarName, VariantError};
use plid_core::{Dense, IdentifiedModel, IdentifierError, ObservableForm};
use plid_identify::{Samples, free_run_error};
use plid_testbed::OUTPUTS;
use serde::{Deserialize, Serialize};

use super::covariance::{bad_pivot, estimate_errors, nees, quads, scaled_difference};
use super::group::{Group, word};
use super::problem::Problem;
use super::record::Check;
use super::reference::Reference;

/// The results of a cell.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Cell {
    /// The group.
    pub group: Group,
    /// The covariance form.
    pub form: CovarianceName,
    /// The number type.
    pub scalar: ScalarName,
    /// Number of steps.
    pub done: usize,
    /// The error of the recursion, if it stopped.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stop: Option<Stop>,
    /// The first inspection at which P was not positive definite, if any.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub indefinite: Option<Indefinite>,
    /// Errors relative to double-double on the same record from the start.
    pub errors: Vec<ErrorAt>,
    /// Rounding errors of single steps, relative to one step of the same form in double-double from the same s and P.
    /// For a form that orthogonalises, they include the loss of orthogonality: U D U^T is no longer W D_w W^T.
    pub local: Vec<LocalAt>,
    /// Symmetry defect of P at the end, as defined in [`plid_core::Health`].
    pub symmetry_defect: f64,
    /// Smallest pivot of P at the end, as defined there; `None` if it is not finite.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub smallest_pivot: Option<f64>,
    /// Condition of P at the end, as defined there; `None` if it is not finite.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub condition: Option<f64>,
    /// RMS of the free-run error over RMS of the output, on the check; `None` if the free run diverges or the run
    /// stopped.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub free_run: Option<f64>,
    /// Normalised estimation error squared of the parameters per degree of freedom, if the plant is of the model's
    /// class.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub nees: Option<f64>,
    /// The estimate s after the step at which frequency responses are compared; empty if the run stopped before this
    /// step.
    pub estimate: Vec<f64>,
    /// The band in Hz in which the inputs of the check have power.
    pub band_hz: [f64; 2],
    /// Sample rate in Hz.
    pub rate_hz: f64,
    /// Time per step, excluding inspections. It is indicative only, because cells run in parallel.
    pub microseconds_per_step: f64,
}

/// The premature end of a run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Stop {
    /// The step, from 1.
    pub step: usize,
    /// The place in the step and the reason.
    pub reason: String,
}

/// The loss of positive definiteness of P.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Indefinite {
    /// The last inspection at which P was sound; 0 for the start.
    pub after: usize,
    /// The first inspection at which it was not.
    pub by: usize,
    /// The entry of s at which the factorisation failed, in words.
    pub entry: String,
    /// The pivot of the correlation matrix or of the factor.
    pub pivot: f64,
}

/// The distance from double-double.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ErrorAt {
    /// Number of steps.
    pub step: usize,
    /// Relative error |s - r| / |r|.
    pub estimate: f64,
    /// The largest |s_i - r_i| in standard deviations.
    pub deviations: f64,
    /// The largest |P_ij - R_ij| / sqrt(R_ii R_jj); `None` if P has entries that are not finite.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub covariance: Option<f64>,
}

/// The rounding error of one step.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LocalAt {
    /// The step, from 1.
    pub step: usize,
    /// The largest change of s by rounding, in standard deviations.
    pub deviations: f64,
    /// The largest scaled change of P by rounding.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub covariance: Option<f64>,
}

impl Cell {
    /// Creates a cell without results.
    pub fn new(group: &Group, form: CovarianceName, scalar: ScalarName, band_hz: [f64; 2], rate_hz: f64) -> Self {
        Self {
            group: group.clone(),
            form,
            scalar,
            done: 0,
            stop: None,
            indefinite: None,
            errors: Vec::new(),
            local: Vec::new(),
            symmetry_defect: 0.0,
            smallest_pivot: None,
            condition: None,
            free_run: None,
            nees: None,
            estimate: Vec::new(),
            band_hz,
            rate_hz,
            microseconds_per_step: 0.0,
        }
    }

    /// Returns the name in the journal.
    pub fn key(group: &Group, form: CovarianceName, scalar: ScalarName) -> String {
        format!("{}, {} {}", group.key(), word(&form), word(&scalar))
    }
}

/// Returns the description of an entry of s in words.
pub fn entry_name(index: usize, states: usize) -> String {
    let (column, row) = (index / states, index % states + 1);
    match column {
        0 => format!("state {row}"),
        c if c <= OUTPUTS => format!("a_{c}, row {row}"),
        c => format!("b_{}, row {row}", c - OUTPUTS),
    }
}

/// Returns the steps at which P is inspected: all up to 8, then about eight per decade, and the last.
fn looks(last: usize) -> Vec<usize> {
    let mut steps: Vec<usize> = (0..80).map(|k| 10_f64.powf(f64::from(k) / 8.0).round() as usize).collect();
    steps.extend(1..=8);
    steps.retain(|&step| step < last);
    steps.push(last);
    steps.sort_unstable();
    steps.dedup();
    steps
}

/// Runs a cell. Returns `None` if the user interrupts it.
///
/// # Errors
/// Returns an error if the recursion cannot be built.
pub fn run(
    problem: &Problem,
    (form, scalar): (CovarianceName, ScalarName),
    reference: Option<&Reference>,
    may_go_on: &dyn Fn() -> bool,
) -> Result<Option<Cell>, VariantError> {
    let group = &problem.group;
    let mut recursion = problem.recursion(form, scalar)?;
    let check = &problem.record.check;
    let mut cell = Cell::new(group, form, scalar, check.band_hz, check.rate_hz);
    let last = group.steps_of(scalar);
    let looks = looks(last);
    let (begin, mut looking) = (Instant::now(), Duration::ZERO);
    let mut sound = 0;
    for step in 1..=last {
        if !may_go_on() {
            return Ok(None);
        }
        let decade = step >= 10 && step == 10_usize.pow(step.ilog10());
        let before = decade.then(|| recursion.checkpoint());
        if let Err(error) = problem.step(recursion.as_mut(), step - 1) {
            cell.stop = Some(Stop { step, reason: reason(&error, group.states) });
            break;
        }
        cell.done = step;
        let since = Instant::now();
        if looks.binary_search(&step).is_ok() && cell.indefinite.is_none() {
            match look(recursion.as_ref(), form, group) {
                None => sound = step,
                Some((entry, pivot)) => cell.indefinite = Some(Indefinite { after: sound, by: step, entry, pivot }),
            }
        }
        let snapshot = reference.and_then(|r| r.snapshots.iter().find(|s| s.step == step));
        if let Some(snapshot) = snapshot {
            let p = recursion.exact_covariance();
            let estimate = quads(&recursion.estimate());
            let (relative, deviations) = estimate_errors(&estimate, &snapshot.estimate, &snapshot.deviations);
            let covariance = finite(scaled_difference(&p, &snapshot.covariance, &snapshot.deviations));
            cell.errors.push(ErrorAt { step, estimate: relative, deviations, covariance });
        }
        if let Some(before) = before {
            cell.local.extend(local(problem, recursion.as_ref(), form, &before, step)?);
        }
        if step == group.compared_at {
            cell.estimate = recursion.estimate().iter().map(|x| x[0] + x[1]).collect();
        }
        looking += since.elapsed();
    }
    let time = begin.elapsed().saturating_sub(looking);
    cell.microseconds_per_step = 1e6 * time.as_secs_f64() / cell.done.max(1) as f64;
    let health = recursion.health();
    cell.symmetry_defect = health.symmetry_defect;
    cell.smallest_pivot = finite(health.smallest_pivot);
    cell.condition = finite(health.condition);
    if cell.stop.is_none() {
        let estimate = quads(&recursion.estimate());
        let rounded: Vec<f64> = estimate.iter().map(|&x| plid_core::Scalar::to_f64(x)).collect();
        cell.free_run = finite(free_run(&rounded, &problem.form, &problem.record.check));
        if let Some(truth) = &problem.record.truth {
            let p = recursion.exact_covariance();
            cell.nees = nees(&p, &estimate, truth, group.states);
        }
    }
    Ok(Some(cell))
}

/// Returns a number that JSON can represent.
fn finite(x: f64) -> Option<f64> {
    x.is_finite().then_some(x)
}

/// Returns the entry and pivot at which P is not positive definite, if there is one. A factor is judged by its own
/// pivots, because U D U^T is positive as long as D is.
fn look(recursion: &dyn Recursion, form: CovarianceName, group: &Group) -> Option<(String, f64)> {
    let bad = if form.is_factored() {
        let health = recursion.health();
        let good = health.smallest_pivot > 0.0 && health.smallest_pivot.is_finite();
        (!good).then_some((health.index, health.smallest_pivot))
    } else {
        bad_pivot(&recursion.exact_covariance()).map(|bad| (bad.index, bad.value))
    };
    // JSON cannot represent a value that is not finite; the entry still states where it occurs.
    bad.map(|(index, pivot)| (entry_name(index, group.states), finite(pivot).unwrap_or(f64::MIN)))
}

/// Repeats the step just done in double-double from the same checkpoint. Returns `None` if the form has no
/// double-double.
fn local(
    problem: &Problem,
    recursion: &dyn Recursion,
    form: CovarianceName,
    before: &plid_core::Checkpoint,
    step: usize,
) -> Result<Option<LocalAt>, VariantError> {
    let mut exact = match problem.recursion(form, ScalarName::DoubleDouble) {
        Err(VariantError::Absent { .. }) => return Ok(None),
        other => other?,
    };
    exact.restore(before)?;
    // If the exact step fails, the reason is the state from which it starts, and not a rounding error of this step.
    if problem.step(exact.as_mut(), step - 1).is_err() {
        return Ok(None);
    }
    let reference = exact.exact_covariance();
    let Ok(deviations) = super::covariance::deviations(&reference) else { return Ok(None) };
    let found = recursion.exact_covariance();
    let (_, moved) = estimate_errors(&quads(&recursion.estimate()), &quads(&exact.estimate()), &deviations);
    let covariance = finite(scaled_difference(&found, &reference, &deviations));
    Ok(Some(LocalAt { step, deviations: moved, covariance }))
}

/// Returns the error of the recursion without the step, which is reported separately.
fn reason(error: &IdentifierError, states: usize) -> String {
    match error {
        IdentifierError::Indefinite { phase, index, value, .. } => {
            format!("{phase}: pivot {value:.1e} at {}", entry_name(*index, states))
        }
        IdentifierError::Diverged { index, .. } => {
            format!("the estimate is not finite at {}", entry_name(*index, states))
        }
        other => other.to_string(),
    }
}

/// Returns the model of an estimate, at rest.
pub fn model(estimate: &[f64], form: &ObservableForm) -> IdentifiedModel {
    let mut model = IdentifiedModel::from_estimate(form, estimate, &Dense::<f64>::from_diagonal(&[]));
    model.state.fill(0.0);
    model
}

fn free_run(estimate: &[f64], form: &ObservableForm, check: &Check) -> f64 {
    let samples = Samples { inputs: check.inputs.view(), outputs: check.outputs.view(), nan_is_missing: false };
    free_run_error(&model(estimate, form), form, samples)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stability::config::Config;
    use crate::stability::reference::reference;
    use std::sync::Arc;

    fn problem(states: usize, steps: usize) -> Problem {
        let config = Config { states: vec![states], steps, ..Config::default() };
        let group = config.groups().into_iter().find(|g| g.part == crate::stability::group::Part::Map).unwrap();
        let record = group.scenario.record(states, steps).unwrap();
        Problem::new(group, Arc::new(record)).unwrap()
    }

    #[test]
    fn looks_are_dense_at_first_and_end_with_the_last_step() {
        let looks = looks(1000);
        assert_eq!(looks[..9], [1, 2, 3, 4, 5, 6, 7, 8, 10]);
        assert_eq!(*looks.last().unwrap(), 1000);
        assert!(looks.windows(2).all(|w| w[0] < w[1]) && looks.len() < 40);
    }

    #[test]
    fn double_precision_is_nearer_to_double_double_than_single() {
        let problem = problem(6, 300);
        let go = || true;
        let reference = reference(&problem, CovarianceName::Direct, &go).unwrap().unwrap();
        assert_eq!(reference.summary.steps, 300);
        let (at, own) = reference.summary.own_error.unwrap();
        assert!(at == 100 && own < 1e-24, "{own}");
        let mut last = Vec::new();
        for scalar in [ScalarName::F32, ScalarName::F64] {
            let cell = run(&problem, (CovarianceName::BiermanUd, scalar), Some(&reference), &go).unwrap().unwrap();
            assert_eq!((cell.done, cell.stop.clone(), cell.indefinite.clone()), (300, None, None));
            assert_eq!(cell.local.iter().map(|l| l.step).collect::<Vec<_>>(), [10, 100]);
            assert!(cell.free_run.unwrap() < 1.0);
            last.push((cell.errors.last().unwrap().clone(), cell.local[1].clone()));
        }
        let ratio = |f: &dyn Fn(&(ErrorAt, LocalAt)) -> f64| f(&last[0]) / f(&last[1]);
        assert!(ratio(&|x| x.0.estimate) > 1e6 && ratio(&|x| x.0.covariance.unwrap()) > 1e6);
        // The rounding error of one step is at most a few hundred units in the last place.
        let (single, double) = (last[0].1.covariance.unwrap(), last[1].1.covariance.unwrap());
        assert!(single < 1e-4 && double < 1e-13 && single > 1e-9, "{single} {double}");
    }

    #[test]
    fn a_cell_stops_where_the_user_asks_for_it() {
        let problem = problem(6, 50);
        let found = run(&problem, (CovarianceName::Direct, ScalarName::F64), None, &|| false).unwrap();
        assert_eq!(found, None);
    }

    #[test]
    fn entries_have_the_names_of_the_canonical_form() {
        assert_eq!([0, 6, 24, 41].map(|i| entry_name(i, 6)), ["state 1", "a_1, row 1", "b_1, row 1", "b_3, row 6"]);
    }
}
