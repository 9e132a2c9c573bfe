//! The truss of a case and the nominal simulation of it.

use nalgebra::DMatrix;
use rand::RngExt;
use rand_chacha::ChaCha12Rng;
use rand_distr::{Distribution, StandardNormal};

use super::GapSpec;
use super::excitation::Planned;
use crate::config::TrussConfig;
use crate::plant::{Truss, assemble, assemble_in, compliances};
use crate::streams::{Purpose, stream};
use crate::structure::{DOMINANT, Mode, ModeGroup, TRUNCATED, platform_mode, tube_mode};

/// The truss without effects, and what a simulation holds it for.
pub(crate) struct Drawn {
    pub base: Truss,
    pub nominal: Truss,
    /// A mode that the truss has and both of these lack, where the spec asks for one.
    pub left_out: Option<Mode>,
}

/// Frequencies about which the ten modes are drawn, Hz.
const FREQUENCIES_HZ: [f64; 10] = [57.0, 60.5, 64.0, 136.0, 168.0, 186.0, 210.0, 240.0, 295.0, 345.0];
/// Standard deviation of a frequency about them, relative.
const SCATTER: f64 = 0.02;
/// RMS over the outputs that a random record of 1 V RMS gives, V.
const OUTPUT_V: f64 = 0.45;

/// What the streams of the draw are for.
const TRUSS: usize = 0;
const NUISANCE: usize = 1;
const COORDINATES: usize = 2;
/// The first of the effects' streams.
pub(crate) const EFFECTS: usize = 16;

pub(crate) fn drawn(config: &TrussConfig, spec: &GapSpec, schedule: &[Planned]) -> Drawn {
    let mut rng = stream(config.seed, Purpose::Draw, TRUSS);
    let mut modes = modes(&mut rng);
    // The number is drawn in any case: the same seed gives the same truss with every effect.
    let missed = rng.random_range(3..8);
    let left_out = spec.effects.iter().any(|e| e.kind == "missing-mode").then(|| modes[missed].clone());

    // Both shapes of every mode alike, so that 1 V RMS gives what is wanted.
    let outputs = assemble(config, modes.clone()).discrete.simulate(schedule[1].commands.view());
    let rms = (outputs.iter().map(|y| y * y).sum::<f64>() / outputs.len() as f64).sqrt();
    let scaled = |mode: &Mode| {
        let scale = (OUTPUT_V / rms).sqrt();
        let (input_shape, output_shape) = (mode.input_shape.map(|b| scale * b), mode.output_shape.map(|c| scale * c));
        Mode { input_shape, output_shape, ..mode.clone() }
    };
    modes = modes.iter().map(scaled).collect();
    let left_out = left_out.map(|mode| scaled(&mode));
    if left_out.is_some() {
        modes.remove(missed);
    }

    let units = compliances(&modes);
    let nominal_modes = if spec.perturbed { perturbed(config.seed, &modes) } else { modes.clone() };
    let nominal = assemble_in(config, nominal_modes, units);
    Drawn { base: assemble(config, modes), nominal, left_out }
}

fn normal(rng: &mut ChaCha12Rng) -> f64 {
    StandardNormal.sample(rng)
}

/// One mode of three of the tubes, the five dominant modes and the two above them, each drawn about the truss's own.
fn modes(rng: &mut ChaCha12Rng) -> Vec<Mode> {
    let tubes = [0, 2, 4].map(|tube| tube_mode(tube, 0));
    let dominant = DOMINANT.iter().map(|row| platform_mode(row, ModeGroup::Dominant));
    let truncated = TRUNCATED[..2].iter().map(|row| platform_mode(row, ModeGroup::Truncated));
    tubes
        .into_iter()
        .chain(dominant)
        .chain(truncated)
        .zip(FREQUENCIES_HZ)
        .map(|(mode, frequency_hz)| {
            let mut entry = |value: f64| value * (1.0 + 0.1 * normal(rng));
            let (input_shape, output_shape) = (mode.input_shape.map(&mut entry), mode.output_shape.map(&mut entry));
            let frequency_hz = frequency_hz * (1.0 + SCATTER * normal(rng).clamp(-2.5, 2.5));
            let damping_ratio = rng.random_range(0.005..0.015);
            Mode { frequency_hz, damping_ratio, input_shape, output_shape, ..mode }
        })
        .collect()
}

fn perturbed(seed: u64, modes: &[Mode]) -> Vec<Mode> {
    let mut rng = stream(seed, Purpose::Draw, NUISANCE);
    modes
        .iter()
        .map(|mode| {
            let mut about = |value: f64, std: f64| value * (1.0 + std * normal(&mut rng));
            Mode {
                frequency_hz: about(mode.frequency_hz, 5e-4),
                damping_ratio: about(mode.damping_ratio, 0.03),
                input_shape: mode.input_shape.map(|b| about(b, 0.005)),
                output_shape: mode.output_shape.map(|c| about(c, 0.005)),
                group: mode.group,
            }
        })
        .collect()
}

/// T of x' = T x: a rotation drawn uniformly, with each new state scaled by up to some tens of per cent.
pub(crate) fn coordinates(seed: u64, states: usize) -> DMatrix<f64> {
    let mut rng = stream(seed, Purpose::Draw, COORDINATES);
    let rotation = DMatrix::from_fn(states, states, |_, _| normal(&mut rng)).qr().q();
    let scales = DMatrix::from_fn(states, 1, |_, _| (0.3 * normal(&mut rng)).exp());
    DMatrix::from_diagonal(&scales.column(0).into_owned()) * rotation
}
