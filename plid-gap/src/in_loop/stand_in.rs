//! A stand-in for the simulator near its trajectory: its linearisation, as a difference equation.
//!
//! One run with small random signals at all inputs and ports shows the response of the outputs near the trajectory.
//! Given this response, the trace of a starting value takes no run: a command changes by the amount that the effect
//! adds to it, and a port is driven by the force of the law along the trajectory. The stand-in is used only to select
//! among the starting values of one effect at one location. Effects and locations are compared by runs of the
//! simulator itself.

use nalgebra::{DMatrix, DVector};
use plid_simulator::Motion;
use rand::RngExt as _;
use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;

use crate::case::record::{Channels, rms};
use crate::effects::{Action, Drive, Force, Memory};
use crate::fit::problem::Placed;
use crate::in_loop::problem::{Fit, Problem};
use crate::in_loop::runs::{Runs, regrouped};
use crate::in_loop::slopes::difference;
use crate::plant::Load;

/// Size of the random signals, relative to the RMS of an input, or to the force that moves a port as much as the
/// inputs do. A smaller signal would be lost in the rounding of a program's output; a larger one would leave the
/// neighbourhood of the trajectory.
const PROBE: f64 = 0.02;

/// Number of past outputs in the difference equation, and of past values of each input and force.
const LAGS: usize = 12;

/// Smallest number of samples of the probe per coefficient. Fewer samples do not determine the coefficients.
const SAMPLES_EACH: usize = 4;

/// Largest error of the stand-in in free run on the probe itself, relative to the response. A simulator that is not
/// nearly linear near its trajectory has no stand-in.
const WORST: f64 = 0.3;

/// Ridge, relative to the mean square of the regressors, for regressors that are linearly dependent.
const RIDGE: f64 = 1e-12;

/// The linearisation of a simulator about its trajectory in one record.
pub(super) struct StandIn {
    /// One difference equation for each output (p): the coefficients of its past values and of the inputs and forces.
    equations: Vec<DVector<f64>>,
    /// The command with the effects of the explanation.
    drive: Drive,
    /// The motion of each port before each step.
    motions: Vec<Vec<Motion>>,
    /// Number of steps per sample.
    steps: usize,
    /// Length of a step in s, and the time of the first step.
    step: f64,
    t0: f64,
}

impl StandIn {
    /// Largest number of runs that a linearisation takes.
    pub const RUNS: usize = 2;

    /// Linearises the simulator about an explanation of the only record of a problem. Returns `None` if the simulator
    /// fails or is not nearly linear there, or if the record is too short.
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
        // Without ports there is no motion to observe, and the outputs are already available.
        let (y, motions) = if setting.force.is_empty() {
            (beside.simulated.first()?.clone(), Vec::new())
        } else {
            runs.pushed(setting, &effects, record, &vec![vec![0.0; samples]; pushed.len()]).ok()?
        };
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

    /// Returns the first-order change of the outputs (p channels) that an effect causes; `None` if the effect acts on
    /// a measurement or on the simulator's own parameters, which the stand-in does not represent.
    pub fn change(&self, problem: &Problem, placed: &Placed) -> Option<Channels> {
        let (m, samples) = (self.drive.u.len(), self.drive.u.first()?.len() / self.drive.parts);
        let mut pushed = vec![vec![0.0; samples]; m + problem.setting.force.len()];
        for action in placed.effect.act(&problem.setting, &placed.place, &placed.parameters) {
            match action {
                Action::Command(command) => {
                    let mut drive = self.drive.clone();
                    command.apply(&mut drive, &mut Memory::default());
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

#[cfg(test)]
mod tests {
    use plid_simulator::Checked;

    use super::*;
    use crate::case::levels::loudest;
    use crate::case::split::split;
    use crate::effects::{Library, Place};
    use crate::in_loop::survey::{Survey, survey};
    use crate::testing::arm::{Arm, NOMINAL, case, nothing};

    /// For weak effects on the command and at a port, the change that the stand-in predicts is close to that of the
    /// nonlinear arm, which is not simulated by a difference equation.
    #[test]
    fn the_change_by_a_weak_effect_is_foretold_without_a_run() {
        let case = case(&NOMINAL, nothing, |u| u.to_vec(), |_| {});
        let mut arm = Arm::new();
        let mut simulator = Checked::new(&mut arm).unwrap();
        let (records, _) = split(&case.records, &case.config.settings.case);
        let loud = loudest(&records, case.config.settings.case.same_level).clone();
        let Survey { setting, responses, .. } = survey(&mut simulator, &case.config, &records, &loud).unwrap();
        let mut runs = Runs::new(simulator, responses);
        let given = vec![runs.simulate(&setting, &[], &loud).unwrap()];
        let problem = Problem::new(vec![loud], &given, setting, &[1e-3; 2], None);
        let beside = problem.as_is(Vec::new(), Vec::new(), given);
        let before = runs.calls().runs;
        let stand_in = StandIn::about(&problem, &mut runs, &beside).unwrap();
        assert_eq!(runs.calls().runs, before + StandIn::RUNS);
        let library = Library::standard();
        let effect = |name: &str| library.effects().find(|effect| effect.name() == name).unwrap();
        let link = Place::Port(problem.setting.names.ports.iter().position(|port| port == "link").unwrap());
        for (name, place, parameters) in [
            ("actuator-gain", Place::Input(0), vec![1.02]),
            ("actuator-lag", Place::Input(0), vec![30.0]),
            ("cubic-stiffness", link.clone(), vec![0.5]),
            ("coulomb-friction", link.clone(), vec![0.005, 0.2]),
            ("added-damping", link.clone(), vec![0.01]),
        ] {
            let placed = Placed { effect: effect(name), place, parameters };
            let foretold = stand_in.change(&problem, &placed).unwrap();
            let with = problem.simulate(&mut runs, &[placed], &[]).unwrap();
            let actual = difference(&with, &beside.simulated).remove(0);
            for (foretold, actual) in foretold.iter().zip(&actual) {
                let apart = rms(foretold.iter().zip(actual).map(|(f, a)| f - a).collect::<Vec<f64>>());
                assert!(apart < 0.4 * rms(actual), "{name}: {}", apart / rms(actual));
            }
        }
        let of_sensor = Placed { effect: effect("sensor-gain"), place: Place::Output(0), parameters: vec![1.1] };
        assert!(stand_in.change(&problem, &of_sensor).is_none());
    }

    /// A response that is not a linear function of the inputs has no difference equation.
    #[test]
    fn what_is_not_linear_has_no_equation() {
        let mut rng = ChaCha8Rng::seed_from_u64(7);
        let pushed: Channels = vec![(0..400).map(|_| if rng.random() { 1.0 } else { -1.0 }).collect()];
        let mut state = 0.0;
        let linear: Vec<f64> = pushed[0]
            .iter()
            .map(|u| {
                state = 0.9 * state + u;
                state
            })
            .collect();
        let found = equation(&linear, &pushed).unwrap();
        let apart: Vec<f64> = response(&found, &pushed).iter().zip(&linear).map(|(a, b)| a - b).collect();
        assert!(rms(apart) < 1e-6 * rms(&linear));
        let other: Vec<f64> = (0..400).map(|k| pushed[0][k] * pushed[0][(k + 200) % 400]).collect();
        assert!(equation(&other, &pushed).is_none());
    }
}
