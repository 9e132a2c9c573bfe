//! Fits on runs of the simulator itself.

use std::convert::Infallible;
use std::sync::{Mutex, MutexGuard, PoisonError};

use nalgebra::{DMatrix, DVector, DVectorView};
use plid_lsq::{Damping, Ended, Minimum, Normal, Stop, minimise};

use crate::case::record::Channels;
use crate::effects::Range;
use crate::fit::candidate::in_words;
use crate::fit::problem::{Placed, sum_of_squares};
use crate::in_loop::problem::{Fit, Problem};
use crate::in_loop::runs::Runs;
use crate::in_loop::slopes::{Slopes, difference, unit};

/// Step of a finite difference, in the logarithm of a positive parameter. It is large compared with the rounding
/// errors of a simulator with contacts, and small compared with the range over which the laws are curved.
const DIFFERENCE: f64 = 0.01;

/// Longest step of a parameter, in its unit or logarithm. The derivative says little about values farther away.
const LONGEST: f64 = 1.5;

/// The damping starts small because starting values are close, and few dampings are tried because each takes a run of
/// every record.
const DAMPING: Damping = Damping { start: 1e-3, shrink: 0.1, grow: 10.0, least: 1e-15, tries: TRIES, factors: &[1.0] };

/// Number of dampings that are tried for a step. A step is begun only if the bounds allow a run of every record for
/// each of them.
pub(super) const TRIES: usize = 3;

/// A problem together with the runs of the simulator.
struct Fitting<'f, 'a, 's> {
    problem: &'f Problem<'a>,
    runs: Mutex<&'f mut Runs<'s>>,
    /// The derivatives at the point from which steps are taken.
    slopes: Option<Slopes>,
}

impl<'a> Problem<'a> {
    /// Fits the parameters of effects, and the nuisances within their limits, by damped Gauss-Newton steps on runs of
    /// the simulator itself. The derivatives are finite differences at first and are then updated along the steps,
    /// until no step lowers the cost any more; then they are computed as finite differences again. The derivatives
    /// with respect to the nuisances are those of the simulator as given. The cost of a run that fails is infinite. A
    /// step is begun only if the bounds on the runs allow it with all of its dampings.
    pub fn fit(&self, runs: &mut Runs, mut start: Fit<'a>, steps: usize, gain: f64) -> Fit<'a> {
        start.slopes = None;
        let mut fitting = Fitting { problem: self, runs: Mutex::new(runs), slopes: None };
        let stop = |steps: usize| Stop { steps, gain, ..Stop::default() };
        let Ok(mut found) = minimise(&mut fitting, start, DAMPING, stop(steps));
        let mut left = steps - found.steps;
        while left > 0 && found.ended == Ended::Stalled && found.point.slopes.is_some() {
            found.point.slopes = None;
            let Ok(again) = minimise(&mut fitting, found.point, DAMPING, stop(left));
            left -= again.steps;
            // If the bounds do not allow this search to begin, it has no equations; the previous equations belong to
            // the same point.
            let equations = if again.steps == 0 { found.equations } else { again.equations };
            found = Minimum { equations, ..again };
        }
        found.point.slopes = None;
        if left == steps {
            return found.point;
        }
        let spread = (found.point.cost / self.values()).max(1.0);
        Fit { covariance: self.covariance(&found.equations, &found.point, spread), ..found.point }
    }

    /// Takes one Gauss-Newton step from a point with known derivatives, if the step lowers the cost. It takes one run
    /// of every record.
    pub fn stepped(&self, runs: &mut Runs, start: Fit<'a>) -> Fit<'a> {
        let mut fitting = Fitting { problem: self, runs: Mutex::new(runs), slopes: None };
        let once = Stop { steps: 1, ..Stop::default() };
        let Ok(found) = minimise(&mut fitting, start, Damping { tries: 1, ..DAMPING }, once);
        found.point
    }

    /// Returns the covariance that an answer states. Noise (p standard deviations) averages out over a record. The
    /// remainder of an explanation beyond the noise does not: it is the error of a law or of an integrator, and it is
    /// as coherent as the trace of a parameter. The remainder is assumed to hide an error of its own size in the
    /// direction of each parameter.
    pub fn stated_covariance(&self, runs: &mut Runs, fit: &Fit<'a>, noise: &[f64]) -> Option<DMatrix<f64>> {
        let plain = self.by_noise_alone(noise);
        let at = plain.as_is(fit.effects.clone(), fit.eta.clone(), fit.simulated.clone());
        let equations = plain.linearised(&at, &plain.slopes(runs, &at));
        let beyond = (sum_of_squares(&at.residual[..plain.rows()]) - plain.values()).max(0.0);
        plain.covariance(&equations, &at, 1.0 + beyond)
    }

    fn linearised(&self, at: &Fit<'a>, slopes: &Slopes) -> Normal {
        let jacobian = self.jacobian(at, slopes);
        let mut equations = Normal::without_memory(jacobian.ncols());
        equations.add(jacobian.as_view(), DVectorView::from_slice(&at.residual, at.residual.len()));
        equations
    }

    /// Returns the finite differences of the outputs for small steps of each parameter of the effects.
    pub fn slopes(&self, runs: &mut Runs, at: &Fit<'a>) -> Slopes {
        let by_one = |simulated: Result<Vec<Channels>, _>| {
            // If a parameter at its bound does not move, or if the simulator fails there, the derivative is zero.
            let moved = simulated.unwrap_or_else(|_| at.simulated.clone());
            let mut change = difference(&moved, &at.simulated);
            change.iter_mut().flatten().flatten().for_each(|x| *x /= DIFFERENCE);
            change
        };
        let by_parameter = self.simulate_all(runs, &self.shifted(at)).into_iter().map(by_one).collect();
        Slopes { by_parameter }
    }

    /// Returns the derivatives of the whitened outputs, and of the nuisances' prior, with respect to all parameters.
    fn jacobian(&self, at: &Fit<'a>, slopes: &Slopes) -> DMatrix<f64> {
        let (rows, nuisances, count) = (self.rows(), self.nuisances.len(), at.parameters());
        let mut jacobian = DMatrix::zeros(rows + nuisances, count + nuisances);
        for (k, slope) in slopes.by_parameter.iter().enumerate() {
            jacobian.view_mut((0, k), (rows, 1)).copy_from_slice(&self.whiten(slope));
        }
        for (k, nuisance) in self.nuisances.iter().enumerate() {
            if !self.is_replaced(nuisance, &at.effects) {
                jacobian.view_mut((0, count + k), (rows, 1)).copy_from_slice(&nuisance.trace);
            }
            jacobian[(rows + k, count + k)] = 1.0;
        }
        jacobian
    }

    /// Returns the effects and nuisances after a small step of each parameter of the effects in turn.
    fn shifted(&self, at: &Fit<'a>) -> Vec<(Vec<Placed<'a>>, Vec<f64>)> {
        let (count, nuisances) = (at.parameters(), self.nuisances.len());
        let unit = |k: usize| DVector::from_fn(count + nuisances, |i, _| if i == k { DIFFERENCE } else { 0.0 });
        (0..count).map(|k| self.moved(at, unit(k).as_slice())).collect()
    }

    /// Returns the number of runs that the derivatives at a point take.
    pub fn runs_of_slopes(&self, runs: &Runs, at: &Fit<'a>) -> usize {
        self.needed(runs, &self.shifted(at))
    }

    /// Returns the number of runs that the derivatives and a step with all of its dampings take.
    fn runs_of_step(&self, runs: &Runs, at: &Fit<'a>) -> usize {
        let all = vec![DIFFERENCE; at.parameters() + self.nuisances.len()];
        let step = self.needed(runs, &[self.moved(at, &all)]);
        let derivatives = if at.slopes.is_some() { 0 } else { self.runs_of_slopes(runs, at) };
        derivatives + TRIES * step
    }

    /// Returns the effects and nuisances after a step, which is in the logarithm of a positive parameter and in the
    /// unit of any other.
    fn moved(&self, from: &Fit<'a>, step: &[f64]) -> (Vec<Placed<'a>>, Vec<f64>) {
        let mut effects = from.effects.clone();
        let mut steps = step.iter();
        for placed in &mut effects {
            let parameters = placed.effect.parameters(&self.setting);
            for ((value, parameter), step) in placed.parameters.iter_mut().zip(parameters).zip(&mut steps) {
                let step = step.clamp(-LONGEST, LONGEST);
                *value =
                    if parameter.range == Range::Positive { *value * step.exp() } else { *value + step * unit(*value) };
            }
        }
        let eta = from.eta.iter().zip(steps).map(|(eta, step)| eta + step).collect();
        (effects, eta)
    }

    /// Returns the covariance of the effects' parameters, in their own units, for a residual of variance `spread`.
    fn covariance(&self, equations: &Normal, at: &Fit, spread: f64) -> Option<DMatrix<f64>> {
        let count = at.parameters();
        let inverse = equations.covariance()? * spread;
        let mut slopes = Vec::new();
        for placed in &at.effects {
            for (value, parameter) in placed.parameters.iter().zip(placed.effect.parameters(&self.setting)) {
                slopes.push(if parameter.range == Range::Positive { *value } else { unit(*value) });
            }
        }
        Some(DMatrix::from_fn(count, count, |i, j| inverse[(i, j)] * slopes[i] * slopes[j]))
    }
}

impl<'f, 's> Fitting<'f, '_, 's> {
    fn runs(&self) -> MutexGuard<'_, &'f mut Runs<'s>> {
        self.runs.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl<'a> plid_lsq::Problem for Fitting<'_, 'a, '_> {
    type Point = Fit<'a>;
    type Equations = Normal;
    type Error = Infallible;

    fn equations(&self) -> Normal {
        Normal::without_memory(0)
    }

    fn linearise(&mut self, at: &Fit<'a>, equations: &mut Normal) -> Result<(), Infallible> {
        let slopes = at.slopes.clone().unwrap_or_else(|| self.problem.slopes(&mut self.runs(), at));
        *equations = self.problem.linearised(at, &slopes);
        self.slopes = Some(slopes);
        Ok(())
    }

    fn may_go_on(&self, at: &Fit<'a>) -> bool {
        let runs = &mut **self.runs();
        let names = &self.problem.setting.names;
        let what = || match &at.effects[..] {
            [] => "steps of the fit of the parameters within their limits".into(),
            effects => format!("steps of the fit of {}", in_words(effects, names)),
        };
        runs.may(self.problem.runs_of_step(runs, at), self.problem.samples(), what)
    }

    fn advance(&self, from: &Fit<'a>, step: &DVector<f64>, to: &mut Fit<'a>) {
        let (effects, eta) = self.problem.moved(from, step.as_slice());
        *to = match self.problem.simulate(&mut self.runs(), &effects, &eta) {
            Ok(simulated) => {
                let mut at = self.problem.as_is(effects, eta, simulated);
                at.slopes = self.slopes.as_ref().and_then(|slopes| slopes.carry(self.problem, from, &at));
                at
            }
            Err(_) => Fit { cost: f64::INFINITY, ..from.clone() },
        };
    }

    fn cost(&self, at: &Fit<'a>) -> f64 {
        at.cost
    }
}
