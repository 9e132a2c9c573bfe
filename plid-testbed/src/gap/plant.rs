//! The plant of a case and the nominal simulation of it.

use std::ops::Range;

use nalgebra::DMatrix;
use ndarray::s;
use rand::RngExt;
use rand_chacha::ChaCha12Rng;
use rand_distr::{Distribution, StandardNormal};

use super::excitation::{Excitation, Planned};
use super::plants::{Layout, layout};
use super::spec::GapSpec;
use crate::INPUTS;
use crate::config::TrussConfig;
use crate::effects::law::Plant;
use crate::plant::{Truss, assemble, assemble_in, compliances};
use crate::streams::{Purpose, stream};
use crate::structure::Mode;

/// The plant without effects, and the nominal simulation of it.
pub(crate) struct Drawn {
    pub base: Truss,
    pub nominal: Truss,
    /// Modes at which modal effects are drawn, from 0.
    pub dominant: Range<usize>,
    /// A mode that the plant has and both of these lack, where the spec asks for one.
    pub left_out: Option<Mode>,
}

/// RMS over the outputs that a random record of 1 V RMS gives, V.
const OUTPUT_V: f64 = 0.45;

/// The numbers of the random streams of a draw.
const PLANT: usize = 0;
const NUISANCE: usize = 1;
const COORDINATES: usize = 2;
/// The kind of noise that an imperfect truth has.
pub(crate) const NOISE: usize = 3;
/// Small imperfections; their own streams follow it.
pub(crate) const BACKGROUND: usize = 1 << 12;
/// The first of the effects' streams.
pub(crate) const EFFECTS: usize = 16;

pub(crate) fn drawn(config: &TrussConfig, spec: &GapSpec, schedule: &[Planned]) -> Drawn {
    let mut rng = stream(config.seed, Purpose::Draw, PLANT);
    let Layout { plant: Plant { mut modes, poles_hz }, dominant, missable } = layout(spec.plant, &mut rng);
    // The number is drawn in any case: the same seed gives the same plant with every effect.
    let missed = rng.random_range(missable);
    let left_out = spec.effects.iter().any(|e| e.kind == "missing-mode").then(|| modes[missed].clone());
    let with = |modes: &[Mode]| Plant { modes: modes.to_vec(), poles_hz };

    // Both shapes of every mode alike, so that 1 V RMS gives what is wanted.
    let random = schedule.iter().find(|planned| matches!(planned.excitation, Excitation::Random { .. }));
    let commands = random.expect("every experiment has one").commands.view();
    let outputs = assemble(config, with(&modes)).discrete.simulate(commands);
    let outputs = outputs.slice(s![.., ..spec.channels.outputs]);
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
    let off = Off::of(spec);
    let nominal = assemble_in(config, off.simulation(config.seed, &modes, poles_hz), units);
    Drawn { base: assemble(config, with(&modes)), nominal, dominant, left_out }
}

fn normal(rng: &mut ChaCha12Rng) -> f64 {
    StandardNormal.sample(rng)
}

/// The errors of a simulation: relative standard deviations.
struct Off {
    frequency: f64,
    damping: f64,
    shape: f64,
    /// Relative standard deviation of the actuators' poles, for which no limits are stated.
    pole: f64,
}

impl Off {
    /// Returns errors within the stated limits, or the given multiple of their standard deviations.
    fn of(spec: &GapSpec) -> Self {
        let factor = spec.beyond_limits;
        if factor > 0.0 {
            let [frequency, damping, shape, pole] = [1e-3, 0.05, 0.01, 0.02].map(|std| factor * std);
            return Self { frequency, damping, shape, pole };
        }
        if spec.perturbed {
            return Self { frequency: 5e-4, damping: 0.03, shape: 0.005, pole: 0.0 };
        }
        Self { frequency: 0.0, damping: 0.0, shape: 0.0, pole: 0.0 }
    }

    /// Draws the plant of a simulation with these errors.
    fn simulation(&self, seed: u64, modes: &[Mode], poles_hz: [f64; INPUTS]) -> Plant {
        let mut rng = stream(seed, Purpose::Draw, NUISANCE);
        let mut about = |value: f64, std: f64| value * (1.0 + std * normal(&mut rng));
        let modes = modes
            .iter()
            .map(|mode| Mode {
                frequency_hz: about(mode.frequency_hz, self.frequency),
                damping_ratio: about(mode.damping_ratio, self.damping),
                input_shape: mode.input_shape.map(|b| about(b, self.shape)),
                output_shape: mode.output_shape.map(|c| about(c, self.shape)),
                group: mode.group,
            })
            .collect();
        Plant { modes, poles_hz: poles_hz.map(|pole| about(pole, self.pole)) }
    }
}

/// T of x' = T x: a rotation drawn uniformly, with each new state scaled by up to some tens of per cent.
pub(crate) fn coordinates(seed: u64, states: usize) -> DMatrix<f64> {
    let mut rng = stream(seed, Purpose::Draw, COORDINATES);
    let rotation = DMatrix::from_fn(states, states, |_, _| normal(&mut rng)).qr().q();
    let scales = DMatrix::from_fn(states, 1, |_, _| (0.3 * normal(&mut rng)).exp());
    DMatrix::from_diagonal(&scales.column(0).into_owned()) * rotation
}
