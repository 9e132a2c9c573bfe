//! The plant of a case and the nominal simulation of it.

use std::ops::Range;

use nalgebra::DMatrix;
use ndarray::s;
use rand::RngExt;
use rand_chacha::ChaCha12Rng;
use rand_distr::{Distribution, StandardNormal};

use super::excitation::{Excitation, Planned};
use super::plants::Layout;
use super::spec::{EffectSpec, GapSpec};
use crate::axes::Axes;
use crate::config::TrussConfig;
use crate::effects::law::Plant;
use crate::effects::{self, At};
use crate::plant::{Truss, assemble, assemble_in, compliances};
use crate::streams::{Purpose, stream};
use crate::structure::Mode;

/// The plant without effects, and the nominal simulation of it.
pub(crate) struct Drawn {
    pub base: Truss,
    pub nominal: Truss,
    /// Modes at which modal effects are drawn, from 0.
    pub dominant: Range<usize>,
    /// A mode that the plant has and that `base` and `nominal` lack, if the spec asks for one.
    pub left_out: Option<Mode>,
}

/// The numbers of the random streams of a draw.
pub(crate) const PLANT: usize = 0;
const NUISANCE: usize = 1;
const COORDINATES: usize = 2;
/// The kind of noise of an imperfect truth.
pub(crate) const NOISE: usize = 3;
/// Small imperfections; their own streams follow this one.
pub(crate) const BACKGROUND: usize = 1 << 12;
/// The first stream of the effects.
pub(crate) const EFFECTS: usize = 16;

/// Draws the rest of a layout's plant, and scales it.
pub(crate) fn drawn(
    config: &TrussConfig,
    spec: &GapSpec,
    layout: Layout,
    schedule: &[Planned],
    rng: &mut ChaCha12Rng,
) -> Drawn {
    let Layout { mut plant, dominant, missable, rig } = layout;
    // The number is drawn in any case, so that the same seed gives the same plant with every effect.
    let missed = (!missable.is_empty()).then(|| rng.random_range(missable));
    let lacks = |wanted: &EffectSpec| effects::kind(&wanted.kind).is_some_and(|kind| kind.at == At::NewMode);
    let missing = missed.filter(|_| spec.effects.iter().any(lacks));

    if let Some(output_v) = rig.output_v {
        let random = schedule.iter().find(|planned| matches!(planned.excitation, Excitation::Random { .. }));
        let commands = random.expect("every experiment has one").commands.view();
        let outputs = assemble(config, plant.clone()).discrete.simulate(commands);
        let outputs = outputs.slice(s![.., ..spec.channels.outputs]);
        let rms = (outputs.iter().map(|y| y * y).sum::<f64>() / outputs.len() as f64).sqrt();
        plant = plant.amplified(output_v / rms);
    }
    let left_out = missing.map(|mode| plant.modes.remove(mode));

    let units = compliances(&plant.modes);
    let off = Off::of(spec);
    let nominal = assemble_in(config, off.simulation(config.seed, &plant), units);
    Drawn { base: assemble(config, plant), nominal, dominant, left_out }
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
    fn simulation(&self, seed: u64, plant: &Plant) -> Plant {
        let mut rng = stream(seed, Purpose::Draw, NUISANCE);
        let mut about = |value: f64, std: f64| value * (1.0 + std * normal(&mut rng));
        let modes = plant.modes.iter().map(|mode| Mode {
            frequency_hz: about(mode.frequency_hz, self.frequency),
            damping_ratio: about(mode.damping_ratio, self.damping),
            input_shape: mode.input_shape.map(|b| about(b, self.shape)),
            output_shape: mode.output_shape.map(|c| about(c, self.shape)),
            group: mode.group,
        });
        let modes = modes.collect();
        let axes = plant.axes.clone().map(|axes| Axes {
            // A frequency is proportional to the square root of the stiffness.
            stiffness: axes.stiffness * about(1.0, 2.0 * self.frequency),
            damping: axes.damping * about(1.0, self.damping),
            drive: axes.drive.iter().map(|drive| about(*drive, self.shape)).collect(),
            ..axes
        });
        Plant { modes, axes, poles_hz: plant.poles_hz.map(|pole| about(pole, self.pole)) }
    }
}

/// Draws T of x' = T x: a uniformly distributed rotation, with each new state scaled by up to some tens of per cent.
pub(crate) fn coordinates(seed: u64, states: usize) -> DMatrix<f64> {
    let mut rng = stream(seed, Purpose::Draw, COORDINATES);
    let rotation = DMatrix::from_fn(states, states, |_, _| normal(&mut rng)).qr().q();
    let scales = DMatrix::from_fn(states, 1, |_, _| (0.3 * normal(&mut rng)).exp());
    DMatrix::from_diagonal(&scales.column(0).into_owned()) * rotation
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::converter::Converter;
    use crate::effects::Effect;
    use crate::effects::place::Input;
    use crate::effects::structure::{CoulombFriction, FrictionLaw};
    use crate::gap::plants::layout;
    use crate::gap::spec::PlantKind;
    use crate::gap::{config, excitation, with_effects};
    use crate::record::record;

    /// Without an effect and without noise, the truth is the free run of the nominal simulation. The two are equal to
    /// the bit, and agree to rounding if a force that is nearly zero makes the integrator take its small steps.
    #[test]
    fn without_an_effect_the_truth_is_the_free_run_of_the_simulation() {
        let nothing = Effect::CoulombFriction(CoulombFriction {
            at: Input(0),
            friction_v: 1e-30,
            transition_v_per_s: 1.0,
            law: FrictionLaw::Tanh,
        });
        for (kind, seed) in PlantKind::ALL.into_iter().flat_map(|kind| (20..23).map(move |seed| (kind, seed))) {
            let spec = GapSpec { plant: kind, channels: kind.channels(), length: 0.1, ..GapSpec::default() };
            let mut rng = stream(seed, Purpose::Draw, PLANT);
            let layout = layout(kind, &mut rng);
            let config = config(seed, &spec, &layout.rig);
            let schedule = excitation::schedule(seed, &spec, &layout.rig);
            let drawn = drawn(&config, &spec, layout, &schedule, &mut rng);
            let exact = |planned: &Planned, config: &TrussConfig| {
                record(config, &drawn.base, planned.commands.view(), planned.clock(), None).unwrap().outputs
            };
            for planned in &schedule {
                let free = drawn.nominal.discrete.simulate(planned.commands.view());
                assert_eq!(exact(planned, &config), free, "{kind:?}, {seed}");
                let stepped = exact(planned, &with_effects(&config, std::slice::from_ref(&nothing)));
                let size = free.iter().fold(1.0_f64, |most, y| most.max(y.abs()));
                let off = (&stepped - &free).iter().fold(0.0_f64, |most, e| most.max(e.abs()));
                assert!(off < 1e-9 * size, "{kind:?}, {seed}: {off} of {size}");
                let dac = Converter { step_v: 10.0 / 4096.0, range_v: 5.0 };
                assert!(planned.commands.iter().all(|u| dac.convert(*u) == (*u, false)));
            }
        }
    }
}
