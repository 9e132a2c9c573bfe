//! The search for a minimum by damped steps. Only steps that lower the cost are taken.

use nalgebra::DVector;
use rayon::prelude::*;

use crate::problem::{Equations, Problem};

/// The rule by which the damping follows the success of the steps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Damping {
    /// The damping of the first step.
    pub start: f64,
    /// Factor on the damping after a step that lowers the cost.
    pub shrink: f64,
    /// Factor on the damping after a step that does not lower the cost.
    pub grow: f64,
    /// Lower limit of the damping.
    pub least: f64,
    /// Number of dampings that are tried from one point, each `grow` times the last, before the search gives up.
    pub tries: usize,
    /// Dampings that are tried in parallel each time, relative to the current one. The best step is taken.
    pub factors: &'static [f64],
}

/// By default, the start is cautious and the factors up and down are equal. The search then solves all problems of the
/// NIST collection from both of their starting points.
impl Default for Damping {
    fn default() -> Self {
        Self { start: 1e3, shrink: 0.3, grow: 3.0, least: 1e-15, tries: 40, factors: &[1.0] }
    }
}

/// The conditions under which a search ends, if it does not stall first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stop {
    /// Largest number of steps.
    pub steps: usize,
    /// A step that lowers the cost by less than this is small.
    pub gain: f64,
    /// A step that lowers the cost by less than this share of the cost is small, too.
    pub share: f64,
    /// The search ends after this many small steps in a row.
    pub patience: usize,
}

/// By default, the search continues as long as the cost falls, for the best attainable accuracy.
impl Default for Stop {
    fn default() -> Self {
        Self { steps: 10_000, gain: 0.0, share: 0.0, patience: 1 }
    }
}

/// The reason why a search ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ended {
    /// The last steps were small.
    Gain,
    /// No step with any of the dampings lowered the cost.
    Stalled,
    /// The largest number of steps was reached first.
    Steps,
    /// The problem did not allow the search to continue ([`Problem::may_go_on`]).
    Stopped,
}

impl Ended {
    /// Returns whether the search has reached a minimum, as far as it can tell.
    pub fn converged(self) -> bool {
        matches!(self, Self::Gain | Self::Stalled)
    }
}

/// The result of a search.
#[derive(Clone, Debug)]
pub struct Minimum<P: Problem> {
    /// The point with the lowest cost.
    pub point: P::Point,
    /// Its cost.
    pub cost: f64,
    /// The equations of the last linearisation, or those of [`Problem::equations`] if there was none. They belong to
    /// [`Minimum::point`] if the search stalled, and otherwise to the point before it.
    pub equations: P::Equations,
    /// Number of linearisations.
    pub steps: usize,
    /// The reason why the search ended.
    pub ended: Ended,
}

/// A step that is tried, and the point at its end.
struct Trial<P: Problem> {
    factor: f64,
    step: DVector<f64>,
    point: P::Point,
    /// Infinite if there is no such step.
    cost: f64,
    work: <P::Equations as Equations>::Work,
}

impl<P: Problem> Trial<P> {
    fn new(factor: f64, point: &P::Point) -> Self {
        let (step, work) = (DVector::zeros(0), Default::default());
        Self { factor, step, point: point.clone(), cost: f64::INFINITY, work }
    }

    fn run(&mut self, problem: &P, equations: &P::Equations, from: &P::Point, damping: f64) {
        self.cost = f64::INFINITY;
        if equations.solve(self.factor * damping, &mut self.work, &mut self.step) {
            problem.advance(from, &self.step, &mut self.point);
            let cost = problem.cost(&self.point);
            self.cost = if cost.is_nan() { f64::INFINITY } else { cost };
        }
    }
}

/// Minimises the cost of a problem from a starting point.
///
/// # Errors
/// Returns the problem's own error if a point cannot be linearised.
pub fn minimise<P: Problem>(
    problem: &mut P,
    start: P::Point,
    damping: Damping,
    stop: Stop,
) -> Result<Minimum<P>, P::Error> {
    let equations = problem.equations();
    let mut trials: Vec<Trial<P>> = damping.factors.iter().map(|&factor| Trial::new(factor, &start)).collect();
    let cost = problem.cost(&start);
    let mut found = Minimum { point: start, cost, equations, steps: 0, ended: Ended::Steps };
    let mut current = damping.start;
    let mut small = 0;
    while found.steps < stop.steps {
        if !problem.may_go_on(&found.point) {
            found.ended = Ended::Stopped;
            break;
        }
        problem.linearise(&found.point, &mut found.equations)?;
        found.steps += 1;
        let Some(better) = descend(problem, &found, &mut trials, &mut current, damping) else {
            found.ended = Ended::Stalled;
            break;
        };
        let gain = found.cost - better.cost;
        std::mem::swap(&mut found.point, &mut better.point);
        found.cost = better.cost;
        problem.accepted(&mut found.point);
        current = (current * better.factor * damping.shrink).max(damping.least);
        small = if gain < stop.gain.max(stop.share * found.cost) { small + 1 } else { 0 };
        if small >= stop.patience {
            found.ended = Ended::Gain;
            break;
        }
    }
    Ok(found)
}

/// Raises the damping until a step lowers the cost, and returns the best such step.
fn descend<'a, P: Problem>(
    problem: &P,
    at: &Minimum<P>,
    trials: &'a mut [Trial<P>],
    current: &mut f64,
    damping: Damping,
) -> Option<&'a mut Trial<P>> {
    for attempt in 0..damping.tries {
        if attempt > 0 {
            *current *= damping.grow;
        }
        let run = |trial: &mut Trial<P>| trial.run(problem, &at.equations, &at.point, *current);
        match &mut *trials {
            [one] => run(one),
            several => several.par_iter_mut().for_each(run),
        }
        let best = (0..trials.len()).min_by(|&a, &b| trials[a].cost.total_cmp(&trials[b].cost))?;
        if trials[best].cost < at.cost {
            return Some(&mut trials[best]);
        }
    }
    None
}
