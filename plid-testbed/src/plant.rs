//! The truss with actuators, accelerometers and anti-alias filters as one linear model: the truth.

use std::f64::consts::{PI, SQRT_2};

use nalgebra::DMatrix;

use crate::axes::Axes;
use crate::config::{TrussConfig, within};
use crate::converter::Converter;
use crate::covariance;
use crate::effects;
use crate::effects::law::{Load, Plant};
use crate::error::{TestbedError, Warning};
use crate::state_space::StateSpace;
use crate::structure::{self, Mode};
use crate::{ACTUATOR_POLE_HZ, ANTI_ALIAS_HZ, INPUTS, OUTPUTS};

/// The plant: its modes, its true model, and the noise that an identifier meets.
///
/// The states are, in this order: the output of each actuator (V); for each mode w q and dq/dt; for each output the
/// filtered voltage y and (dy/dt) / w_c, with w_c the filter's corner in rad/s. All blocks are scaled so that the
/// entries of A are of the order of the frequencies.
#[derive(Clone, Debug)]
pub struct Truss {
    /// Sample rate of `discrete`, Hz.
    pub sample_rate_hz: f64,
    /// The modes, in the order of their states. There are none for bodies on axes, whose states are their positions
    /// and velocities.
    pub modes: Vec<Mode>,
    /// The axes in place of modes.
    pub(crate) axes: Option<Axes>,
    /// Pole of each actuator with its amplifier, Hz; infinite where there is none.
    pub actuator_poles_hz: [f64; INPUTS],
    /// The continuous model; D = 0.
    pub continuous: StateSpace,
    /// The model of the samples, with inputs held over a sample and outputs read before the new input acts; D = 0.
    pub discrete: StateSpace,
    /// The noise of the samples.
    pub noise: NoiseCovariances,
    /// The places where a force may act, at the strut of each input.
    pub ports: Vec<StrutPort>,
    /// Unusual properties of this plant at this rate.
    pub warnings: Vec<Warning>,
}

/// The noise that enters x_{k+1} = A x_k + B (u_k + v_k) + xi_k, z_k = C x_k + w_k; all three independent of each other
/// and white. `u_k` is the command as the DAC gives it, so its rounding is not noise.
#[derive(Clone, Debug, PartialEq)]
pub struct NoiseCovariances {
    /// Covariance of w (p x p, V^2): sensor noise and the rounding of the ADC.
    pub sensor: DMatrix<f64>,
    /// Covariance of v (m x m, V^2): amplifier noise.
    pub actuator: DMatrix<f64>,
    /// Covariance of xi (n x n): the ambient force over a sample, in the states of `discrete`.
    pub state: DMatrix<f64>,
    /// Covariance of x (n x n) when only the ambient force acts; also that at the start of a record.
    pub at_rest: DMatrix<f64>,
}

/// The strut of an input as a place where an internal force acts. The units are volts: a force of 1 V pushes as the
/// output of an actuator of 1 V does, and a displacement of 1 V is that under a constant command of 1 V.
#[derive(Clone, Debug, PartialEq)]
pub struct StrutPort {
    /// The input, from 0.
    pub input: usize,
    /// Contribution of a force of 1 V to dx/dt (n entries).
    pub force: Vec<f64>,
    /// Row that gives the displacement, V (n entries).
    pub displacement: Vec<f64>,
    /// Row that gives the velocity, V/s (n entries).
    pub velocity: Vec<f64>,
}

/// Returns the index of a mode's first state.
pub(crate) fn mode_state(mode: usize) -> usize {
    INPUTS + 2 * mode
}

/// Returns the vector by which a modal force enters dx/dt: as the mode's acceleration, and directly at the
/// accelerometers.
pub(crate) fn modal_force(modes: &[Mode], mode: usize) -> Vec<f64> {
    let mut force = vec![0.0; states(modes)];
    force[mode_state(mode) + 1] = 1.0;
    for i in 0..OUTPUTS {
        force[filter_state(modes, i) + 1] = filter_corner() * modes[mode].output_shape[i];
    }
    force
}

/// Returns the index of an output's first filter state.
pub(crate) fn filter_state(modes: &[Mode], output: usize) -> usize {
    INPUTS + 2 * modes.len() + 2 * output
}

fn states(modes: &[Mode]) -> usize {
    INPUTS + 2 * modes.len() + 2 * OUTPUTS
}

fn filter_corner() -> f64 {
    2.0 * PI * ANTI_ALIAS_HZ
}

/// Builds the plant of a config.
///
/// # Errors
/// Returns an error if a key of the config is wrong.
pub fn truss(config: &TrussConfig) -> Result<Truss, TestbedError> {
    config.check()?;
    let modes = structure::modes(config.structure.strut_modes_per_tube);
    Ok(assemble(config, Plant::of_modes(modes, [ACTUATOR_POLE_HZ; INPUTS])))
}

/// Assembles this plant under a checked config, without effects.
pub(crate) fn assemble(config: &TrussConfig, plant: Plant) -> Truss {
    let units = compliances(&plant.modes);
    assemble_in(config, plant, units)
}

/// Returns the plant as changed by the linear effects of a checked config. The units of its ports stay those of the
/// unchanged plant.
pub(crate) fn altered(config: &TrussConfig, truss: &Truss) -> Truss {
    let unchanged = Plant { modes: truss.modes.clone(), axes: truss.axes.clone(), poles_hz: truss.actuator_poles_hz };
    let mut plant = unchanged.clone();
    effects::alter(&config.effects, &mut plant);
    let altered =
        if plant == unchanged { truss.clone() } else { assemble_in(config, plant, compliances(&truss.modes)) };
    effects::loads(&config.effects).into_iter().fold(altered, |truss, load| loaded(config, truss, load))
}

/// Returns the plant with a force f = -m dv/dt - c v - k d at a port. With b for the contribution of a force to dx/dt
/// and r for the row of the velocity, dv/dt = r dx/dt, so m takes away the share m r b / (1 + m r b) of everything
/// that moves the port. All of m, c and k are positive or zero, so a stable plant stays stable.
fn loaded(config: &TrussConfig, mut truss: Truss, load: Load) -> Truss {
    let port = truss.ports[load.port].clone();
    let n = truss.continuous.states();
    let row = |entries: &[f64]| DMatrix::from_row_slice(1, n, entries);
    let (force, displacement, velocity) =
        (DMatrix::from_column_slice(n, 1, &port.force), row(&port.displacement), row(&port.velocity));
    let share = load.mass / (1.0 + load.mass * (&velocity * &force)[(0, 0)]);
    let resisted = |m: &DMatrix<f64>| m - &force * share * (&velocity * m);
    let StateSpace { a, b, .. } = &mut truss.continuous;
    (*a, *b) = (resisted(a), resisted(b));
    for port in &mut truss.ports {
        port.force = resisted(&DMatrix::from_column_slice(n, 1, &port.force)).as_slice().to_vec();
    }
    let force = DMatrix::from_column_slice(n, 1, &truss.ports[load.port].force);
    *a -= force * (displacement * load.stiffness + velocity * load.damping);
    let step_s = 1.0 / truss.sample_rate_hz;
    truss.discrete = truss.continuous.sampled(step_s);
    truss.noise = noise(config, &truss.modes, &truss.continuous, &truss.discrete, step_s);
    truss
}

/// Builds the plant of a config without one mode (numbered from 0) and without effects: the model of an engineer who
/// has missed this mode.
///
/// # Errors
/// Returns an error if a key of the config is wrong, or if there is no such mode.
pub fn truss_without_mode(config: &TrussConfig, mode: usize) -> Result<Truss, TestbedError> {
    let mut modes = truss(config)?.modes;
    within("mode", mode, 0, modes.len() - 1)?;
    let units = compliances(&modes);
    modes.remove(mode);
    Ok(assemble_in(config, Plant::of_modes(modes, [ACTUATOR_POLE_HZ; INPUTS]), units))
}

/// Assembles the truss of a plant, where `units` are the displacements that count as 1 V at each port, in the modes'
/// units.
pub(crate) fn assemble_in(config: &TrussConfig, plant: Plant, units: [f64; INPUTS]) -> Truss {
    let Plant { modes, axes, poles_hz } = plant;
    let step_s = 1.0 / config.sample_rate_hz;
    let continuous = axes.as_ref().map_or_else(|| continuous(&modes, poles_hz), |axes| axes.model(poles_hz));
    let discrete = continuous.sampled(step_s);
    let noise = noise(config, &modes, &continuous, &discrete, step_s);
    let ports = match &axes {
        Some(axes) => axes.ports(continuous.states()),
        None => (0..INPUTS).map(|input| strut_port(&modes, input, units[input])).collect(),
    };
    let warnings = folded_modes(&modes, config.sample_rate_hz / 2.0).into_iter().collect();
    Truss {
        sample_rate_hz: config.sample_rate_hz,
        modes,
        axes,
        actuator_poles_hz: poles_hz,
        continuous,
        discrete,
        noise,
        ports,
        warnings,
    }
}

fn continuous(modes: &[Mode], poles_hz: [f64; INPUTS]) -> StateSpace {
    let n = states(modes);
    let mut a = DMatrix::zeros(n, n);
    let mut b = DMatrix::zeros(n, INPUTS);
    let mut c = DMatrix::zeros(OUTPUTS, n);
    for j in 0..INPUTS {
        let pole = 2.0 * PI * poles_hz[j];
        a[(j, j)] = -pole;
        b[(j, j)] = pole;
    }
    for (m, mode) in modes.iter().enumerate() {
        let (w, q) = (mode.angular_frequency(), mode_state(m));
        a[(q, q + 1)] = w;
        // Each part of the modal acceleration also drives the filters directly.
        for (row, &share) in modal_force(modes, m).iter().enumerate().filter(|(_, share)| **share != 0.0) {
            a[(row, q)] -= share * w;
            a[(row, q + 1)] -= share * 2.0 * mode.damping_ratio * w;
            for j in 0..INPUTS {
                a[(row, j)] += share * mode.input_shape[j];
            }
        }
    }
    let corner = filter_corner();
    for i in 0..OUTPUTS {
        let y = filter_state(modes, i);
        a[(y, y + 1)] = corner;
        a[(y + 1, y)] = -corner;
        a[(y + 1, y + 1)] = -SQRT_2 * corner;
        c[(i, y)] = 1.0;
    }
    StateSpace { a, b, c, d: DMatrix::zeros(OUTPUTS, INPUTS) }
}

/// Returns the noise of the samples. The ambient force consists of independent white forces on the platform's
/// corners, where the accelerometers sit, scaled so that the outputs have the requested RMS. Bodies on axes have
/// none.
fn noise(
    config: &TrussConfig,
    modes: &[Mode],
    continuous: &StateSpace,
    discrete: &StateSpace,
    step_s: f64,
) -> NoiseCovariances {
    let mut corners = DMatrix::<f64>::zeros(continuous.states(), OUTPUTS);
    for (m, mode) in modes.iter().enumerate() {
        for (row, share) in modal_force(modes, m).into_iter().enumerate() {
            for l in 0..OUTPUTS {
                corners[(row, l)] += share * mode.output_shape[l];
            }
        }
    }
    let unit = covariance::sampled(&continuous.a, &(&corners * corners.transpose()), step_s);
    let at_rest = covariance::stationary(&discrete.a, &unit);
    let mean_square = (&discrete.c * &at_rest * discrete.c.transpose()).trace() / OUTPUTS as f64;
    let scale = if mean_square > 0.0 { config.noise.ambient_rms_v.powi(2) / mean_square } else { 0.0 };
    let white = |rms: f64, size: usize| DMatrix::from_diagonal_element(size, size, rms * rms);
    let adc = Converter { step_v: config.converters.step_v, range_v: config.converters.range_v };
    NoiseCovariances {
        sensor: white(config.noise.sensor_rms_v.hypot(adc.rounding_std()), OUTPUTS),
        actuator: white(config.noise.amplifier_rms_v, INPUTS),
        state: unit * scale,
        at_rest: at_rest * scale,
    }
}

/// Returns the static displacement under a force of 1 V at the strut of each input, in the modes' units.
pub(crate) fn compliances(modes: &[Mode]) -> [f64; INPUTS] {
    std::array::from_fn(|j| modes.iter().map(|mode| (mode.input_shape[j] / mode.angular_frequency()).powi(2)).sum())
}

/// Returns the port of an input, where `compliance` is the displacement, in the modes' units, that counts as 1 V.
fn strut_port(modes: &[Mode], input: usize, compliance: f64) -> StrutPort {
    let n = states(modes);
    let shape = |mode: &Mode| mode.input_shape[input];
    let (mut force, mut displacement, mut velocity) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
    for (m, mode) in modes.iter().enumerate() {
        for (total, share) in force.iter_mut().zip(modal_force(modes, m)) {
            *total += share * shape(mode);
        }
        displacement[mode_state(m)] = shape(mode) / mode.angular_frequency() / compliance;
        velocity[mode_state(m) + 1] = shape(mode) / compliance;
    }
    StrutPort { input, force, displacement, velocity }
}

fn folded_modes(modes: &[Mode], nyquist_hz: f64) -> Option<Warning> {
    let above: Vec<f64> = modes.iter().map(|m| m.frequency_hz).filter(|f| *f >= nyquist_hz).collect();
    let highest_hz = above.iter().copied().reduce(f64::max)?;
    Some(Warning::ModesAboveNyquist { count: above.len(), highest_hz, nyquist_hz })
}
