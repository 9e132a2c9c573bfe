//! The screen: for each effect, location and promising starting value, one run shows how much of the gap the trace
//! explains.

use crate::case::record::Channels;
use crate::effects::{Action, Effect, Range};
use crate::fit::candidate::{in_words, same};
use crate::fit::problem::{Placed, dot, sum_of_squares};
use crate::in_loop::bounds::Bounds;
use crate::in_loop::problem::{Fit, Problem};
use crate::in_loop::runs::Runs;
use crate::in_loop::search::Search;
use crate::in_loop::slopes::difference;
use crate::in_loop::stand_in::StandIn;
use crate::search::rules::Scope;

/// An effect at a location, with the result of its run in the screen.
#[derive(Clone)]
pub(super) struct Entry<'a> {
    /// The effect.
    pub placed: Placed<'a>,
    /// Expected decrease of the sum of squares along its trace.
    pub gain: f64,
    /// Factor on its trace that explains most of the residual.
    pub factor: f64,
    /// The change of the outputs that the effect causes, which is its trace before whitening.
    pub change: Vec<Channels>,
}

/// Range of the factors on a trace. Beyond this range, the shape of a trace says little about that of a larger
/// effect.
pub(super) const STRETCHED: [f64; 2] = [0.2, 5.0];

/// Returns whether an external simulator can be run with an effect.
fn possible(effect: &dyn Effect, placed: &Placed, problem: &Problem) -> bool {
    let actions = effect.act(&problem.setting, &placed.place, &placed.parameters);
    !actions.is_empty() && actions.iter().all(|action| action.suits_any_simulator() && !matches!(action, Action::Noise))
}

impl<'a> Search<'_, 'a> {
    /// Screens all effects in the presence of an explanation within bounds on the runs. The entries are sorted by
    /// their gain, the largest first, and contain the most promising starting values of each effect at each location.
    /// `problem` contains the record that is screened.
    pub(super) fn screen(
        &self,
        problem: &Problem<'a>,
        runs: &mut Runs,
        beside: &Fit<'a>,
        bounds: Bounds,
        say: &mut dyn FnMut(String),
    ) -> Vec<Entry<'a>> {
        let residual = problem.beyond_limits(&beside.residual[..problem.rows()]);
        let affordable = bounds.left(runs.spent(), problem.samples()).0 > StandIn::RUNS;
        let stand_in = if affordable { StandIn::about(problem, runs, beside) } else { None };
        let mut entries: Vec<Entry> = Vec::new();
        for (k, &effect) in self.effects.iter().enumerate() {
            let mut all = starts(problem, effect, beside, &self.scope);
            if let Some(stand_in) = &stand_in {
                all = promising(problem, stand_in, all, &residual, self.settings.starts);
            }
            let (left, by) = bounds.left(runs.spent(), problem.samples());
            let cut = all.len() > left;
            all.truncate(left);
            let with = |placed: &Placed<'a>| {
                (beside.effects.iter().cloned().chain([placed.clone()]).collect(), beside.eta.clone())
            };
            let asked: Vec<(Vec<Placed>, Vec<f64>)> = all.iter().map(with).collect();
            for (placed, simulated) in all.into_iter().zip(problem.simulate_all(runs, &asked)) {
                // An effect with which the simulator fails is left out.
                let Ok(simulated) = simulated else { continue };
                entries.extend(entry(problem, placed, &residual, difference(&simulated, &beside.simulated)));
            }
            if cut {
                say("no runs are left for the rest of the screen".into());
                let mut names: Vec<&str> = self.effects[k..].iter().map(|effect| effect.name()).collect();
                names.dedup();
                runs.leave_out(by, format!("the screen of {}{}", names.join(", "), in_presence(problem, beside)));
                break;
            }
            say(format!("screened {}, {} runs so far", effect.name(), runs.calls().runs));
        }
        entries.sort_by(|a, b| b.gain.total_cmp(&a.gain));
        entries
    }
}

/// Returns the effects beside which others are screened, in words.
fn in_presence(problem: &Problem, beside: &Fit) -> String {
    if beside.effects.is_empty() {
        return String::new();
    }
    format!(" beside {}", in_words(&beside.effects, &problem.setting.names))
}

/// Returns an effect with all of its starting values at all locations at which it may be added to an explanation.
fn starts<'a>(problem: &Problem<'a>, effect: &'a dyn Effect, beside: &Fit<'a>, scope: &Scope) -> Vec<Placed<'a>> {
    let at = |place: crate::effects::Place| {
        let sizes = effect.starts(&problem.setting, &place);
        sizes.into_iter().map(move |parameters| Placed { effect, place: place.clone(), parameters })
    };
    let may_stand = |placed: &Placed| {
        let known = beside.effects.iter().any(|other| same(other, placed));
        !known && scope.allows(placed) && possible(effect, placed, problem)
    };
    effect.places(&problem.setting).into_iter().flat_map(at).filter(may_stand).collect()
}

/// Returns the starting values to be run: at each location, the `kept` ones whose traces by the stand-in explain most
/// of the residual. Starting values whose traces the stand-in cannot give are all run.
fn promising<'a>(
    problem: &Problem<'a>,
    stand_in: &StandIn,
    all: Vec<Placed<'a>>,
    residual: &[f64],
    kept: usize,
) -> Vec<Placed<'a>> {
    let gain = |placed: &Placed<'a>| {
        let change = vec![stand_in.change(problem, placed)?];
        Some(entry(problem, placed.clone(), residual, change).map_or(0.0, |entry| entry.gain))
    };
    let gains: Vec<Option<f64>> = all.iter().map(gain).collect();
    let better = |at: usize, than: f64| {
        let rivals = all.iter().zip(&gains).enumerate().filter(|(k, (placed, _))| *k != at && same(placed, &all[at]));
        rivals.filter(|(k, (_, gain))| gain.is_some_and(|gain| gain > than || gain == than && *k < at)).count()
    };
    let runs: Vec<bool> = (0..all.len()).map(|at| gains[at].is_none_or(|gain| better(at, gain) < kept)).collect();
    all.into_iter().zip(runs).filter_map(|(placed, runs)| runs.then_some(placed)).collect()
}

/// Returns the entry of an effect that causes this change of the outputs, or `None` if its trace is zero or not
/// finite.
fn entry<'a>(problem: &Problem<'a>, placed: Placed<'a>, residual: &[f64], change: Vec<Channels>) -> Option<Entry<'a>> {
    let trace = problem.beyond_limits(&problem.whiten(&change));
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
    Some(Entry { placed, gain: sum_of_squares(residual) - left, factor, change })
}

/// Returns whether the amplitude of an effect cannot change its sign.
pub(super) fn is_positive(placed: &Placed, problem: &Problem) -> bool {
    let Some((index, none)) = placed.effect.amplitude() else { return true };
    none == 0.0 && placed.effect.parameters(&problem.setting)[index].range == Range::Positive
}

impl<'a> Entry<'a> {
    /// Returns the effect at the sizes from which a fit may start: as it was screened, at the size that its trace
    /// suggests, and between the two. The response usually grows less than in proportion to the size of an effect, so
    /// the suggested size is too large or too small.
    pub fn sizes(&self, problem: &Problem) -> Vec<Placed<'a>> {
        let Some((index, none)) = self.placed.effect.amplitude() else { return vec![self.placed.clone()] };
        let range = self.placed.effect.parameters(&problem.setting)[index].range;
        let from = self.placed.parameters[index];
        let sized = |power: f64| {
            let factor = self.factor.abs().clamp(1.0 / MOST, MOST).powf(power).copysign(self.factor);
            let mut changed = self.placed.clone();
            // The factor on a positive number is an exponent, so that the number stays positive.
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
