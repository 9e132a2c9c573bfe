//! The forward simulation of commands, structure and sensors, with any effects.
//!
//! The structure's modes are advanced exactly for a held input. A force that depends on the motion is approximated as
//! linear in time over each part of a sample, by a predictor and a corrector in continuous time (exponential time
//! differencing, second order: Cox and Matthews, J. Comput. Phys. 176, 2002). [`Fineness`] states the number of parts
//! of a sample. Where a stop is reached ([`Force::at_end`]), or dry friction sticks or slips (`friction`), the instant
//! within the part is located.

mod between;
mod block;
mod feedback;
mod friction;
pub(crate) mod lanes;
mod runner;
mod together;

use std::borrow::Cow;

use crate::case::record::Channels;
use crate::effects::{Action, Drive, Force, Memory, Sampling};
use crate::plant::{Plant, Port};
pub use crate::simulate::together::{Run, before_sensors};
use plid_fourier::C;

/// Subdivision of a sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Fineness {
    /// Number of parts of a sample, over each of which a motion-dependent force is linear in time.
    pub force: usize,
    /// Number of samples after which a drifting pole is updated.
    pub drift: usize,
}

impl Fineness {
    /// For fits and predictions.
    pub const FINE: Self = Self { force: 8, drift: 16 };
    /// For the screen, which only ranks, for quick fits and for derivatives.
    pub const COARSE: Self = Self { force: 4, drift: 64 };
}

/// A state of the plant.
#[derive(Debug, Clone, PartialEq)]
pub struct State {
    /// State of each mode.
    pub modes: Vec<C>,
    /// State of the rest.
    pub rest: Vec<f64>,
    /// State of the controller, if there is one.
    pub controller: Vec<f64>,
}

impl State {
    /// Returns the same state for a changed plant. If the modes of the changed plant are coupled, they are among the
    /// other states: (Re z, Im z) of each mode comes first. Added states begin at rest.
    fn of(&self, changed: &Plant) -> Self {
        let added = changed.rest.a.nrows().saturating_sub(self.rest.len() + 2 * self.modes.len());
        if !changed.modes.is_empty() || changed.rest.a.nrows() == self.rest.len() {
            return self.clone();
        }
        let modes = self.modes.iter().flat_map(|z| [z.re, z.im]);
        let rest = modes.chain(std::iter::repeat_n(0.0, added)).chain(self.rest.iter().copied()).collect();
        Self { modes: Vec::new(), rest, controller: self.controller.clone() }
    }

    /// Returns the state at rest.
    pub fn rest(plant: &Plant) -> Self {
        let controller = plant.controller.as_ref().map_or(0, |controller| controller.a.nrows());
        Self {
            modes: vec![C::ZERO; plant.modes.len()],
            rest: vec![0.0; plant.rest.a.nrows()],
            controller: vec![0.0; controller],
        }
    }
}

/// Returns the outputs (p channels) for held inputs (m channels) from time `t0`, with effects.
pub fn simulate(
    plant: &Plant,
    actions: &[Action],
    u: &[Vec<f64>],
    t0: f64,
    start: Option<&State>,
    fineness: Fineness,
) -> Channels {
    let mut y = before_sensors(plant, &[Run { actions, u, t0, start }], fineness).swap_remove(0);
    let sampling = Sampling { t0, rate: plant.rate, at_rest: start.is_none() };
    apply_sensors(actions, &mut y, sampling);
    y
}

/// Returns the commands of the plant (m channels) in a linear run from rest: the inputs `u`, plus the feedback in
/// closed loop.
pub fn commands<'u>(plant: &Plant, u: &'u [Vec<f64>]) -> Cow<'u, [Vec<f64>]> {
    let Some(controller) = &plant.controller else { return u.into() };
    controller.commands(u, &simulate(plant, &[], u, 0.0, None, Fineness::COARSE)).into()
}

/// Applies the effects on the sensors, in their order.
pub fn apply_sensors(actions: &[Action], y: &mut Channels, sampling: Sampling) {
    for action in actions {
        if let Action::Sensor(sensor) = action {
            sensor.apply(y, sampling, &mut Memory::default());
        }
    }
}

/// Adds the force due to a motion that is an input to the outputs that measure this force. The velocity is that of a
/// parabola through three samples.
fn on_a_given_motion(port: &Port, law: &dyn Force, drive: &Drive, y: &mut Channels) {
    let Some(input) = port.moved_by() else { return };
    let d: Vec<f64> = drive.u[input].iter().step_by(drive.parts).copied().collect();
    let v = slope(&d, drive.rate);
    let (mut state, mut before) = (vec![0.0; law.states()], d.first().copied().unwrap_or(0.0));
    for (k, (&d, &v)) in d.iter().zip(&v).enumerate() {
        law.advance(before, d, &mut state);
        before = d;
        let force = law.force(d, v, &state);
        y.iter_mut().zip(&port.output).for_each(|(y, share)| y[k] += share * force);
    }
}

/// Returns the derivative of a signal at its samples, by central differences.
pub fn slope(x: &[f64], rate: f64) -> Vec<f64> {
    let last = x.len().saturating_sub(1);
    let at = |k: usize| {
        let (from, to) = (k.saturating_sub(1), (k + 1).min(last));
        if from == to { 0.0 } else { (x[to] - x[from]) * rate / (to - from) as f64 }
    };
    (0..x.len()).map(at).collect()
}

/// Largest phase advance, in a part of a sample, of a port's oscillation against a stiff law, in rad.
const TURN: f64 = 0.25;

/// Largest phase advance, in a part of a sample, of a port's oscillation against a smooth law, in rad. The relative
/// error of the oscillation's frequency is a twenty-fourth of the square of the phase advance.
const SMOOTH_TURN: f64 = 0.08;

/// Distance from the largest motion, relative to it, at which a law is evaluated for its slope.
const BESIDE: f64 = 1e-3;

/// Largest number of parts of a sample.
const MOST_PARTS: f64 = 32.0;

/// Returns the largest number of parts of a block, a power of two. Each force acts on the motion at all later parts
/// of its block, and each block costs a product with the state, so blocks are short for a plant with few states.
/// (Processor time for a servo with a stop: 25 s with two parts, 34 s with four and 51 s with eight; for a truss, 23,
/// 18 and 17 s.)
fn most_in_a_block(plant: &Plant) -> usize {
    plant.n().div_ceil(lanes::WIDE).next_power_of_two().clamp(2, 8)
}

/// Returns the number of blocks of a sample for a number of values of the command, each of which is held over a
/// number of parts. The number of parts of a block is limited only if forces act.
fn blocks_of(plant: &Plant, (values, parts): (usize, usize), forced: bool) -> usize {
    let most = if forced { (most_in_a_block(plant) / parts).max(1) } else { values };
    (1..=values).find(|blocks| values.is_multiple_of(*blocks) && values / blocks <= most).unwrap_or(values)
}

/// Returns the number of parts of a sample that a law needs: a power of two.
fn parts_of(plant: &Plant, port: usize, law: &dyn Force) -> usize {
    let [stiffness, damper] = law.steepest();
    if stiffness == 0.0 && damper == 0.0 {
        return 1;
    }
    let mobility = plant.mobility(port).max(0.0);
    let rate = (stiffness.abs() * mobility).sqrt() + damper.abs() * mobility;
    power_of_two(rate / (TURN * plant.rate))
}

/// Returns the number of parts of a sample that a smooth law needs if these are the largest magnitudes of
/// displacement and velocity at its port: a power of two. A law that states its steepest part has enough parts
/// anyway.
fn parts_at(plant: &Plant, port: usize, law: &dyn Force, [d, v]: [f64; 2]) -> usize {
    if law.states() > 0 || law.holds().is_some() || law.steepest() != [0.0; 2] {
        return 1;
    }
    let slope = |of: &dyn Fn(f64) -> f64, at: f64| {
        let beside = BESIDE * at;
        if beside > 0.0 { (of(at + beside) - of(at - beside)).abs() / (2.0 * beside) } else { 0.0 }
    };
    let by_displacement = |d: f64| law.force(d, 0.0, &[]);
    let stiffness = slope(&by_displacement, d).max(slope(&|d: f64| by_displacement(-d), d));
    let damper = slope(&|v: f64| law.force(0.0, v, &[]), v);
    let mobility = plant.mobility(port).max(0.0);
    power_of_two(((stiffness * mobility).sqrt() + damper * mobility) / (SMOOTH_TURN * plant.rate))
}

fn power_of_two(parts: f64) -> usize {
    parts.clamp(1.0, MOST_PARTS).log2().ceil().exp2() as usize
}

/// Returns the plant as changed by the actions before a run; `None` if no action changes it.
pub fn changed_plant(plant: &Plant, actions: &[Action]) -> Option<Plant> {
    let mut changed = changed_modes(plant, actions);
    // Loads couple the modes, whose states come first. Those of the lags follow.
    let modal = 2 * changed.as_ref().unwrap_or(plant).modes.len();
    for action in actions {
        if let Action::Load(port, load) = action {
            changed.get_or_insert_with(|| plant.clone()).load(*port, load);
        }
    }
    for action in actions {
        if let Action::Lag(port, pole) = action {
            changed.get_or_insert_with(|| plant.clone()).lag_drive(*port, *pole, modal);
        }
    }
    changed
}

/// Returns the plant as changed by the actions, except for loads and lags, which couple the modes; `None` if no
/// action changes it.
pub fn changed_modes(plant: &Plant, actions: &[Action]) -> Option<Plant> {
    let mut changed = None;
    for action in actions {
        if let Action::Plant(change) = action {
            change(changed.get_or_insert_with(|| plant.clone()));
        }
    }
    changed
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::Effect;
    use crate::plant::Load;
    use crate::testing;

    fn run(plant: &Plant, seed: u64) -> Channels {
        simulate(plant, &[], &testing::random_input(seed, 600, 2), 0.0, None, Fineness::FINE)
    }

    fn state_space(model: &plid_model::Model, seed: u64) -> Channels {
        let u = testing::random_input(seed, 600, 2);
        let inputs = ndarray::Array2::from_shape_fn((600, 2), |(k, i)| u[i][k]);
        let y = plid_model::simulate(model, inputs.view(), &model.rest()).unwrap().outputs;
        crate::case::columns(&y)
    }

    /// Returns the RMS difference relative to the expected RMS.
    fn difference(found: &Channels, expected: &Channels) -> f64 {
        let error: Vec<f64> = found.iter().flatten().zip(expected.iter().flatten()).map(|(a, b)| a - b).collect();
        crate::case::record::rms(&error) / crate::case::record::rms(expected.iter().flatten())
    }

    /// The modal simulation agrees with x+ = A x + B u in the simulation's own basis.
    #[test]
    fn without_effects_it_is_the_state_space_simulation() {
        for seed in 0..3 {
            let model = testing::truss(seed);
            let far = difference(&run(&Plant::new(&model).unwrap(), seed), &state_space(&model, seed));
            assert!(far < 1e-6, "{far}");
        }
    }

    /// A run begins from the same state with a lag beside a load of no size as with the lag alone.
    #[test]
    fn a_state_keeps_its_place_beside_a_load_and_a_lag() {
        let plant = Plant::new(&testing::truss(1)).unwrap();
        let mut begun = State::rest(&plant);
        begun.modes.iter_mut().zip(1..).for_each(|(z, k)| *z = C::new(1e-3 * f64::from(k), -2e-3));
        begun.rest.iter_mut().zip(1..).for_each(|(x, k)| *x = 1e-3 * f64::from(k));
        let u = vec![vec![0.0; 100]; 2];
        let run = |actions: &[Action]| simulate(&plant, actions, &u, 0.0, Some(&begun), Fineness::FINE);
        let lag = || Action::Lag(0, 1e5);
        let far = difference(&run(&[Action::Load(0, Load::default()), lag()]), &run(&[lag()]));
        assert!(far < 1e-6, "{far}");
    }

    /// A mode that is moved, reshaped or added in modal form agrees with a structure that is built with that mode.
    #[test]
    fn a_changed_mode_is_a_structure_built_so() {
        let nominal = Plant::new(&testing::truss(1)).unwrap();
        let (hz, zeta) = testing::MODES[2];
        let mut moved = nominal.clone();
        let w = std::f64::consts::TAU * hz * 1.03;
        let zeta_moved = 1.5 * zeta;
        moved.move_pole(2, C::new(-zeta_moved * w, w * (1.0 - zeta_moved * zeta_moved).sqrt()));
        let built = testing::truss_with(1, |modes, _, _| modes[2] = (1.03 * hz, zeta_moved));
        let far = difference(&run(&moved, 5), &state_space(&built, 5));
        assert!(far < 1e-5, "{far}");

        let mut shaped = nominal.clone();
        shaped.change(1, |mode| mode.b[0] *= 1.1);
        let built = testing::truss_with(1, |_, beta, _| beta[(1, 0)] *= 1.1);
        let far = difference(&run(&shaped, 6), &state_space(&built, 6));
        assert!(far < 1e-5, "{far}");

        let mut more = Plant::new(&testing::truss_with(1, |_, beta, _| beta.row_mut(2).fill(0.0))).unwrap();
        let (mut b, mut c) = (vec![0.0; 2], vec![0.0; 2]);
        let whole = testing::truss_with(1, |_, beta, gamma| {
            b = beta.row(2).iter().copied().collect();
            c = gamma.column(2).iter().copied().collect();
        });
        let w = std::f64::consts::TAU * hz;
        more.add_mode(C::new(-zeta * w, w * (1.0 - zeta * zeta).sqrt()), &b, &c);
        let far = difference(&run(&more, 7), &state_space(&whole, 7));
        assert!(far < 1e-5, "{far}");
    }

    /// If the sensors are at the ports, the inferred ports respond to a force as the declared ones do, up to a scale.
    #[test]
    fn inferred_ports_answer_as_declared_ones() {
        let mut model = testing::truss_with(2, |_, beta, gamma| *gamma = beta.transpose() * 0.05);
        let u = testing::random_input(3, 600, 2);
        let declared = Plant::new(&model).unwrap();
        model.ports.clear();
        let inferred = Plant::new(&model).unwrap();
        let effect = crate::effects::CubicStiffness;
        let respond = |plant: &Plant, k: f64| {
            let setting = crate::prepare::tests::setting_of(plant, &model);
            let actions = effect.act(&setting, &crate::effects::Place::Input(0), &[k]);
            let with = simulate(plant, &actions, &u, 0.0, None, Fineness::FINE);
            let without = simulate(plant, &[], &u, 0.0, None, Fineness::FINE);
            let change: Channels =
                with.iter().zip(&without).map(|(a, b)| a.iter().zip(b).map(|(a, b)| a - b).collect()).collect();
            change
        };
        // Displacements at inferred ports have other units: the sensors' shapes are 0.05 of those of the inputs.
        let k = 1e12;
        let expected = respond(&declared, k);
        let best = (0..400)
            .map(|j| difference(&respond(&inferred, k * 10_f64.powf(f64::from(j) / 50.0 - 4.0)), &expected))
            .fold(f64::INFINITY, f64::min);
        assert!(best < 0.05, "{best}");
    }

    /// The force due to a motion that is an input is its law at that motion, added to the linear response.
    #[test]
    fn a_force_on_a_given_motion_is_its_law() {
        use crate::effects::{CoulombFriction, CubicStiffness, JointHysteresis, Place};
        use nalgebra::dmatrix;
        let model = plid_model::Model::new(500.0, dmatrix![0.2], dmatrix![0.8], dmatrix![-7.0], dmatrix![7.0]).unwrap();
        let plant = Plant::new(&model).unwrap();
        let setting = crate::effects::Setting::bare(&plant, &model);
        let (amplitude, w) = (0.02, 4.0);
        let at = |k: usize| k as f64 / 500.0;
        let u = vec![(0..1500).map(|k| amplitude * (w * at(k)).sin()).collect::<Vec<f64>>()];
        let added = |effect: &dyn Effect, parameters: &[f64]| -> Vec<f64> {
            let actions = effect.act(&setting, &Place::Input(0), parameters);
            let run = |actions: &[Action]| simulate(&plant, actions, &u, 0.0, None, Fineness::FINE).remove(0);
            run(&actions).iter().zip(run(&[])).map(|(with, without)| with - without).collect()
        };
        let cubic = added(&CubicStiffness, &[3e4]);
        assert!(cubic.iter().zip(&u[0]).all(|(f, d)| (f - 3e4 * d.powi(3)).abs() < 1e-12));
        // Friction follows the velocity, whose relative error by central differences is (w h)^2 / 6.
        let (force, v0) = (5.0, 0.01);
        let friction = added(&CoulombFriction, &[force, v0]);
        let velocity = |k: usize| amplitude * w * (w * at(k)).cos();
        let far = (1..1499).map(|k| (friction[k] - force * (velocity(k) / v0).tanh()).abs()).fold(0.0, f64::max);
        assert!(far < 1e-3, "{far}");
        // A joint that has yielded has the force k dy in the direction of the motion.
        let joint = added(&JointHysteresis, &[1e3, 1e-3]);
        let quarter = (0.5 * std::f64::consts::PI / w * 500.0) as usize;
        assert!((joint[3 * quarter - 5] + 1.0).abs() < 1e-6 && (joint[5 * quarter - 5] - 1.0).abs() < 1e-6);
    }
}
