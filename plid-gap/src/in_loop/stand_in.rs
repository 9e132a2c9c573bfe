//! A stand-in for the simulator near its trajectory: its linearisation, as a difference equation.
//!
//! One run with small random signals at all inputs and ports shows how the outputs respond near the trajectory. With
//! this response, the trace of a starting value costs no run: a command changes by what the effect adds to it, and a
//! port is pushed by the force that the law has along the trajectory. The stand-in only selects starting values of one
//! effect at one location. Effects and locations are compared by runs of the simulator itself.

use nalgebra::{DMatrix, DVector};
use plid_simulator::Motion;
use rand::RngExt as _;
use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;

use crate::case::record::{Channels, rms};
use crate::effects::{Action, Drive, Force};
use crate::fit::problem::Placed;
use crate::in_loop::problem::{Fit, Problem};
use crate::in_loop::runs::{Runs, regrouped};
use crate::in_loop::slopes::difference;
use crate::plant::Load;

/// Size of the random signals, over the RMS of an input and over the force that moves a port as much as the inputs do.
/// A smaller signal would be lost in the rounding of a program's output, a larger one leaves the trajectory.
const PROBE: f64 = 0.02;

/// Number of past outputs in the difference equation, and of past values of each input and force.
const LAGS: usize = 12;

/// Samples of the probe for each coefficient: fewer do not determine them.
const SAMPLES_EACH: usize = 4;

/// Largest error of the stand-in in the probe itself, in free run, over the response. A simulator that is not nearly
/// linear near its trajectory has no stand-in.
const WORST: f64 = 0.3;

/// Ridge, relative to the mean square of the regressors, against outputs that repeat each other.
const RIDGE: f64 = 1e-12;

/// The linearisation of a simulator about its trajectory in one record.
pub(super) struct StandIn {
    /// Coefficients of past outputs and of the inputs and forces, one difference equation for each output (p).
    equations: Vec<DVector<f64>>,
    /// The command with the standing effects.
    drive: Drive,
    /// The motion of each port before each step.
    motions: Vec<Vec<Motion>>,
    /// Steps in a sample.
    steps: usize,
    /// Length of a step in s, and the time of the first.
    step: f64,
    t0: f64,
}

impl StandIn {
    /// The runs that a linearisation takes.
    pub const RUNS: usize = 2;

    /// Linearises the simulator about an explanation of the one record of a problem. Returns `None` if the simulator
    /// fails, or is not nearly linear there.
    pub fn about<'a>(problem: &Problem<'a>, runs: &mut Runs, beside: &Fit<'a>) -> Option<Self> {
        let [record] = problem.records.as_slice() else { return None };
        let setting = &problem.setting;
        let sizes: Vec<f64> = setting.u_rms.iter().chain(&setting.force).map(|size| PROBE * size).collect();
        let samples = record.samples();
        let unknowns = LAGS + (LAGS + 1) * sizes.len();
        if sizes.iter().all(|size| *size == 0.0) || samples < SAMPLES_EACH * unknowns {
            return None;
        }
        let mut rng = ChaCha8Rng::seed_from_u64(0);
        let mut signs = |size: f64| (0..samples).map(|_| if rng.random() { size } else { -size }).collect();
        let pushed: Channels = sizes.iter().map(|size| signs(*size)).collect();
        let effects = problem.with_nuisances(&beside.effects, &beside.eta);
        let still = vec![vec![0.0; samples]; pushed.len()];
        let (y, motions) = runs.pushed(setting, &effects, record, &still).ok()?;
        let (moved, _) = runs.pushed(setting, &effects, record, &pushed).ok()?;
        let response = difference(&[moved], &[y]).remove(0);
        let equations: Option<Vec<_>> = response.iter().map(|y| equation(y, &pushed)).collect();
        let (rate, steps) = (setting.plant.rate, runs.description().steps_per_sample.max(1));
        Some(Self {
            equations: equations?,
            drive: runs.drive(setting, &effects, record),
            motions,
            steps,
            step: 1.0 / (rate * steps as f64),
            t0: record.start_s,
        })
    }

    /// Returns the change of the outputs (p channels) by an effect, to first order; `None` if it acts on a measurement
    /// or on the simulator's own parameters, of which the stand-in knows nothing.
    pub fn change(&self, problem: &Problem, placed: &Placed) -> Option<Channels> {
        let (m, samples) = (self.drive.u.len(), self.drive.u.first()?.len() / self.drive.parts);
        let mut pushed = vec![vec![0.0; samples]; m + problem.setting.force.len()];
        for action in placed.effect.act(&problem.setting, &placed.place, &placed.parameters) {
            match action {
                Action::Command(command) => {
                    let mut drive = self.drive.clone();
                    command.apply(&mut drive);
                    let changed = difference(&[regrouped(&drive, 1)], &[regrouped(&self.drive, 1)]).remove(0);
                    for (to, by) in pushed.iter_mut().zip(changed) {
                        *to = by;
                    }
                }
                Action::Force(port, law) => self.along(port, &mut pushed[m + port], law_of(law.as_ref())),
                Action::Load(port, load) => self.along(port, &mut pushed[m + port], load_of(load, self.step)),
                Action::Disturbance(port, force) => self.along(port, &mut pushed[m + port], |_, t| force(t)),
                _ => return None,
            }
        }
        Some(self.equations.iter().map(|equation| response(equation, &pushed)).collect())
    }

    /// Adds the force of a law along the trajectory of a port, averaged over each sample.
    fn along(&self, port: usize, to: &mut [f64], mut force: impl FnMut(Motion, f64) -> f64) {
        for (k, motion) in self.motions.iter().enumerate() {
            let at = self.t0 + k as f64 * self.step;
            if let Some(sample) = to.get_mut(k / self.steps) {
                *sample += force(motion[port], at) / self.steps as f64;
            }
        }
    }
}

/// Returns the force of a law as a function of the motion, step after step.
fn law_of(law: &dyn Force) -> impl FnMut(Motion, f64) -> f64 {
    let (mut state, mut from) = (vec![0.0; law.states()], 0.0);
    move |Motion { displacement, velocity }, _| {
        law.advance(from, displacement, &mut state);
        from = displacement;
        law.force(displacement, velocity, &state)
    }
}

/// Returns the force of an added mass, damper and spring as a function of the motion, step after step.
fn load_of(load: Load, step: f64) -> impl FnMut(Motion, f64) -> f64 {
    let mut before = None;
    move |Motion { displacement, velocity }, _| {
        let acceleration = before.replace(velocity).map_or(0.0, |before: f64| (velocity - before) / step);
        -load.stiffness * displacement - load.damping * velocity - load.mass * acceleration
    }
}

/// Fits y(k) = sum a_i y(k - i) + sum b_si w_s(k - i) by least squares, and returns the coefficients (a, then b of each
/// source from i = 0); `None` if the equation does not reproduce the response in free run.
fn equation(y: &[f64], pushed: &[Vec<f64>]) -> Option<DVector<f64>> {
    let count = LAGS + (LAGS + 1) * pushed.len();
    let size = rms(y);
    if size == 0.0 {
        return Some(DVector::zeros(count));
    }
    // Sources of different units have equal weight.
    let scale: Vec<f64> = pushed.iter().map(rms).map(|size| if size > 0.0 { size } else { 1.0 }).collect();
    let scale_of = |column: usize| if column < LAGS { size } else { scale[(column - LAGS) / (LAGS + 1)] };
    let regressors = DMatrix::from_fn(y.len(), count, |k, column| regressor(y, pushed, k, column) / scale_of(column));
    let mut normal = regressors.tr_mul(&regressors);
    let ridge = RIDGE * normal.trace() / count as f64;
    (0..count).for_each(|i| normal[(i, i)] += ridge);
    let right = regressors.tr_mul(&DVector::from_column_slice(y));
    let mut found = normal.cholesky()?.solve(&right);
    (0..count).for_each(|column| found[column] /= scale_of(column));
    let apart: Vec<f64> = response(&found, pushed).iter().zip(y).map(|(own, y)| own - y).collect();
    (rms(apart) <= WORST * size).then_some(found)
}

/// Returns the value that a coefficient multiplies at a sample.
fn regressor(y: &[f64], pushed: &[Vec<f64>], k: usize, column: usize) -> f64 {
    if column < LAGS {
        return if k > column { y[k - column - 1] } else { 0.0 };
    }
    let (source, lag) = ((column - LAGS) / (LAGS + 1), (column - LAGS) % (LAGS + 1));
    if k >= lag { pushed[source][k - lag] } else { 0.0 }
}

/// Returns the free run of a difference equation from rest.
fn response(equation: &DVector<f64>, pushed: &[Vec<f64>]) -> Vec<f64> {
    let samples = pushed.first().map_or(0, Vec::len);
    let mut y = vec![0.0; samples];
    for k in 0..samples {
        y[k] = (0..equation.len()).map(|column| equation[column] * regressor(&y, pushed, k, column)).sum();
    }
    y
}
