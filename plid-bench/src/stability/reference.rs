//! The same recursion in double-double, with snapshots at a series of steps.

use std::time::Instant;

use plid_catalogue::{CovarianceName, ScalarName, VariantError};
use plid_core::Dense;
use qd::Quad;
use serde::{Deserialize, Serialize};

use super::covariance::{condition, deviations, quads, scaled_difference};
use super::group::{FACTORED_PEER, one_three};
use super::problem::Problem;

/// s and P after a number of steps.
#[derive(Clone, Debug)]
pub struct Snapshot {
    /// Number of steps.
    pub step: usize,
    /// The estimate s.
    pub estimate: Vec<Quad>,
    /// The covariance P.
    pub covariance: Dense<Quad>,
    /// The standard deviations sqrt(P_ii).
    pub deviations: Vec<Quad>,
}

/// A run in double-double.
#[derive(Clone, Debug)]
pub struct Reference {
    /// Snapshots at the steps 1, 3, 10, 30 ...
    pub snapshots: Vec<Snapshot>,
    /// Its description.
    pub summary: ReferenceSummary,
}

/// The entry of a reference in the journal.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ReferenceSummary {
    /// The group.
    pub group: String,
    /// The form.
    pub form: CovarianceName,
    /// Number of states n.
    pub states: usize,
    /// Number of steps up to its last snapshot.
    pub steps: usize,
    /// Duration of a step.
    pub microseconds_per_step: f64,
    /// The condition of the correlation matrix of P at the last snapshot (a lower bound); `None` if P is no longer
    /// positive.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub condition: Option<f64>,
    /// The largest scaled difference between this P and that of Bierman UD in double-double, and the step at which it
    /// was taken. It is the error of the reference itself.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub own_error: Option<(usize, f64)>,
}

/// Steps after which the two double-double runs are compared.
const COMPARED_AT: usize = 100;
/// Cost of a step of Bierman UD relative to the direct form in double-double; its references are shorter by this
/// factor.
const DEARER: usize = 10;

/// Returns the reference of the matrix forms, or that of the factored forms, which add parameter noise differently.
/// Returns `None` if the user interrupts it. A reference that breaks down ends at its last snapshot before the
/// failure.
///
/// # Errors
/// Returns an error for an invalid start.
pub fn reference(
    problem: &Problem,
    form: CovarianceName,
    may_go_on: &dyn Fn() -> bool,
) -> Result<Option<Reference>, VariantError> {
    let factored = form.is_factored();
    let last = problem.group.reference_steps / if factored { DEARER } else { 1 };
    let begin = Instant::now();
    let Some(snapshots) = run(problem, form, &one_three(last), may_go_on)? else { return Ok(None) };
    let elapsed = begin.elapsed().as_secs_f64();
    let steps = snapshots.last().map_or(0, |s| s.step);
    let mut own_error = None;
    if !factored && problem.group.parameter_noise == 0.0 {
        let at: Vec<usize> = one_three(COMPARED_AT.min(steps)).into_iter().next_back().into_iter().collect();
        let Some(others) = run(problem, FACTORED_PEER, &at, may_go_on)? else { return Ok(None) };
        own_error = others.first().and_then(|other| {
            let same = snapshots.iter().find(|s| s.step == other.step)?;
            let difference = scaled_difference(&same.covariance, &other.covariance, &other.deviations);
            difference.is_finite().then_some((other.step, difference))
        });
    }
    let summary = ReferenceSummary {
        group: problem.group.key(),
        form,
        states: problem.group.states,
        steps,
        microseconds_per_step: 1e6 * elapsed / steps.max(1) as f64,
        condition: snapshots.last().and_then(|s| condition(&s.covariance)),
        own_error,
    };
    Ok(Some(Reference { snapshots, summary }))
}

/// Runs in double-double up to the last step of `at`.
fn run(
    problem: &Problem,
    form: CovarianceName,
    at: &[usize],
    may_go_on: &dyn Fn() -> bool,
) -> Result<Option<Vec<Snapshot>>, VariantError> {
    let mut recursion = problem.recursion(form, ScalarName::DoubleDouble)?;
    let mut snapshots = Vec::new();
    for step in 1..=at.last().copied().unwrap_or(0) {
        if !may_go_on() {
            return Ok(None);
        }
        if problem.step(recursion.as_mut(), step - 1).is_err() {
            break;
        }
        if at.contains(&step) {
            let covariance = recursion.exact_covariance();
            let Ok(deviations) = deviations(&covariance) else { break };
            snapshots.push(Snapshot { step, estimate: quads(&recursion.estimate()), covariance, deviations });
        }
    }
    Ok(Some(snapshots))
}
