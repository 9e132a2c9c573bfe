//! One run for each effect, location and start: how much of the gap its trace explains.

use plid_simulator::SimulatorError;

use crate::effects::{Action, Effect, Range};
use crate::fit::problem::{Placed, dot, sum_of_squares};
use crate::in_loop::problem::{Fit, Problem};
use crate::in_loop::runs::Runs;
use crate::search::rules::Scope;

/// An effect at a location and with a size that the screen found.
#[derive(Clone)]
pub(super) struct Entry<'a> {
    /// The effect.
    pub placed: Placed<'a>,
    /// Decrease of the sum of squares that its trace promises.
    pub gain: f64,
    /// Factor on its trace that explains most.
    pub factor: f64,
}

/// Range of the factors on a trace: beyond it, the shape of a trace says little about that of a larger effect.
const STRETCHED: [f64; 2] = [0.2, 5.0];

/// Returns whether a foreign simulator can be run with an effect.
fn possible(effect: &dyn Effect, placed: &Placed, problem: &Problem) -> bool {
    let actions = effect.act(&problem.setting, &placed.place, &placed.parameters);
    !actions.is_empty()
        && actions.iter().all(|action| !matches!(action, Action::Plant(_) | Action::Stiffness(_) | Action::Noise))
}

/// Screens all effects beside an explanation. Entries are sorted, the largest gain first; of each effect at each
/// location all starts are kept. `problem` has the records that are screened.
pub(super) fn screen<'a>(
    problem: &Problem<'a>,
    runs: &mut Runs,
    effects: &[&'a dyn Effect],
    beside: &Fit<'a>,
    scope: &Scope,
    may_call: impl Fn(&Runs) -> bool,
    say: &mut dyn FnMut(String),
) -> Result<Vec<Entry<'a>>, SimulatorError> {
    let residual = problem.beyond_limits(&beside.residual[..problem.rows()]);
    let before = sum_of_squares(&residual);
    let mut entries: Vec<Entry> = Vec::new();
    for &effect in effects {
        for place in effect.places(&problem.setting) {
            for parameters in effect.starts(&problem.setting, &place) {
                let placed = Placed { effect, place: place.clone(), parameters };
                let known = beside.effects.iter().any(|other| crate::fit::candidate::same(other, &placed));
                if known || !scope.allows(&placed) || !possible(effect, &placed, problem) {
                    continue;
                }
                if !may_call(runs) {
                    say("no calls are left for the rest of the screen".into());
                    entries.sort_by(|a, b| b.gain.total_cmp(&a.gain));
                    return Ok(entries);
                }
                entries.extend(entry(problem, runs, placed, beside, (&residual, before)));
            }
        }
        say(format!("screened {}, {} runs so far", effect.name(), runs.calls().runs));
    }
    entries.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    Ok(entries)
}

/// Returns the trace of an effect beside an explanation, without what the nuisances explain. `None` if the simulator
/// cannot be run with it.
fn trace<'a>(problem: &Problem<'a>, runs: &mut Runs, placed: &Placed<'a>, beside: &Fit<'a>) -> Option<Vec<f64>> {
    let mut effects = beside.effects.clone();
    effects.push(placed.clone());
    let simulated = problem.simulate(runs, &effects, &beside.eta).ok()?;
    Some(problem.beyond_limits(&problem.trace(&beside.simulated, &simulated)))
}

fn entry<'a>(
    problem: &Problem<'a>,
    runs: &mut Runs,
    placed: Placed<'a>,
    beside: &Fit<'a>,
    (residual, before): (&[f64], f64),
) -> Option<Entry<'a>> {
    let trace = trace(problem, runs, &placed, beside)?;
    let size = dot(&trace, &trace);
    if !(size.is_finite() && size > 0.0) {
        return None;
    }
    let factor = dot(residual, &trace) / size;
    let linear = placed.effect.amplitude().is_some();
    let positive = is_positive(&placed, problem);
    let used = if !linear {
        factor.clamp(STRETCHED[0], STRETCHED[1])
    } else if positive {
        factor.max(0.0)
    } else {
        factor
    };
    let left: f64 = residual.iter().zip(&trace).map(|(r, t)| (r - used * t).powi(2)).sum();
    Some(Entry { placed, gain: before - left, factor })
}

/// Whether the amplitude of an effect cannot change its sign.
fn is_positive(placed: &Placed, problem: &Problem) -> bool {
    let Some((index, none)) = placed.effect.amplitude() else { return true };
    none == 0.0 && placed.effect.parameters(&problem.setting)[index].range == Range::Positive
}

impl<'a> Entry<'a> {
    /// Returns the effect at the sizes from which a fit may start: as it was screened, at the size that its trace
    /// suggests, and between the two. A large effect answers less than a small one, so the suggestion is too large or
    /// too small.
    pub fn sizes(&self, problem: &Problem) -> Vec<Placed<'a>> {
        let Some((index, none)) = self.placed.effect.amplitude() else { return vec![self.placed.clone()] };
        let range = self.placed.effect.parameters(&problem.setting)[index].range;
        let from = self.placed.parameters[index];
        let sized = |power: f64| {
            let factor = self.factor.abs().clamp(1.0 / MOST, MOST).powf(power).copysign(self.factor);
            let mut changed = self.placed.clone();
            // A positive number that is multiplied stays positive.
            changed.parameters[index] = if range == Range::Positive && none != 0.0 {
                none * (from / none).powf(factor.clamp(-STRETCHED[1], STRETCHED[1]))
            } else {
                none + factor * (from - none)
            };
            changed
        };
        let positive = is_positive(&self.placed, problem);
        if self.factor == 0.0 || !self.factor.is_finite() || positive && self.factor < 0.0 {
            return vec![self.placed.clone()];
        }
        [0.0, 0.5, 1.0].map(sized).to_vec()
    }
}

/// Largest factor on the size of an effect.
const MOST: f64 = 1e3;
