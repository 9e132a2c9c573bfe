//! Gap cases with a known answer: a plant with effects, the nominal simulation that lacks them, and records.
//!
//! [`draw`] draws a case from a seed and a [`GapSpec`]. [`GapCase::write`] writes the files that a diagnosis may see
//! to one folder, and the answer to another. Structures have up to three actuators (with a pole at 260 Hz; a drone's
//! motors are slower), up to three accelerometers behind a two-pole filter at 1 kHz, 12-bit converters of +-5 V, 5 mV
//! of noise on each sensor and amplifier, and an ambient force that gives 2 mV. Bodies on axes (motors, servos,
//! sliders, pendulums, arms and closed loops) have one or two inputs and as many outputs. The outputs are positions
//! or speeds, which encoders count or which have 5 mV of noise; they are sampled at 200 to 1000 Hz.

mod asked;
mod background;
mod effect;
mod excitation;
mod label;
mod plant;
mod plants;
mod rig;
mod spec;
mod strength;
mod write;

use ndarray::{Array2, s};
use rand::RngExt;

use crate::config::{EffectsConfig, NoiseConfig, TrussConfig};
use crate::effects::Effect;
use crate::effects::chain::Clock;
use crate::error::TestbedError;
use crate::noise::Noise;
use crate::plant::{Truss, altered};
use crate::record::record;
use crate::streams::{Purpose, stream};
use background::Scene;
use rig::Rig;
use strength::Bench;

pub use excitation::Excitation;
pub use label::{Label, LabelledBackground, LabelledEffect};
pub use spec::{Channels, EffectSpec, Experiment, GapSpec, PlantKind, Simulator};
pub use write::SimulationFile;

/// The reasons why a case cannot be drawn or written.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum GapError {
    /// An effect of the spec has an invalid kind, place, law or value.
    #[error("effect {number} of the spec ({kind}): {reason}")]
    Spec {
        /// The number of the effect in the spec, from 1.
        number: usize,
        /// The kind of effect.
        kind: String,
        /// What is wrong.
        reason: String,
    },
    /// A number of the spec is outside its range.
    #[error("`{key}` must be from {least} to {most}, not {value}")]
    OutOfRange {
        /// The key.
        key: &'static str,
        /// Its value.
        value: f64,
        /// Least allowed value.
        least: f64,
        /// Largest allowed value.
        most: f64,
    },
    /// Two keys of the spec contradict each other.
    #[error("`{key}` cannot be combined with `{other}`: {reason}")]
    Apart {
        /// The key.
        key: &'static str,
        /// The key with which it cannot be combined.
        other: &'static str,
        /// Why.
        reason: &'static str,
    },
    /// No strength of this draw causes the requested gap.
    #[error("{kind}: no strength makes a gap of {target}; the nearest found is {nearest}. Another seed may")]
    Unreachable {
        /// The effect.
        kind: String,
        /// The requested gap.
        target: f64,
        /// The nearest gap found.
        nearest: f64,
    },
    /// No record of the case shows the effect. For example, a stop may be reached only in the held-out record.
    #[error("{kind}: no record but the held-out one shows it, with a gap of {most} at most. Another seed may")]
    Unseen {
        /// The effect.
        kind: String,
        /// The largest gap that it causes in the other records.
        most: f64,
    },
    /// The structure moves beyond the range of its converter and stays there.
    #[error(
        "y{}: the converter clips {samples} of {of} samples; a softening joint may be too strong. Another seed may not",
        channel + 1
    )]
    Escaped {
        /// Channel, from 0.
        channel: usize,
        /// Number of samples clipped.
        samples: usize,
        /// Number of samples of the record.
        of: usize,
    },
    /// The truss cannot be simulated.
    #[error(transparent)]
    Testbed(#[from] TestbedError),
    /// A file cannot be written.
    #[error("{path}: {reason}")]
    File {
        /// The file.
        path: String,
        /// Why.
        reason: String,
    },
    /// A number of a case is not finite.
    #[error("{path}: {source}; it is not written")]
    NotFinite {
        /// The file that would hold it.
        path: String,
        /// The number and its key.
        source: plid_file::NotFinite,
    },
}

/// A record: the commands and the measurements.
#[derive(Clone, Debug, PartialEq)]
pub struct GapRecord {
    /// The excitation.
    pub excitation: Excitation,
    /// Commands as the DAC gives them (K x m), V.
    pub commands: Array2<f64>,
    /// Outputs as the ADC gives them (K x p), V.
    pub outputs: Array2<f64>,
    /// Outputs of the nominal simulation for these commands (K x p), V.
    pub simulated: Array2<f64>,
}

/// A drawn case.
#[derive(Clone, Debug)]
pub struct GapCase {
    /// The nominal simulation, in arbitrary coordinates.
    pub simulation: SimulationFile,
    /// The form in which the case gives the nominal simulation.
    pub simulator: Simulator,
    /// The records in the order in which they were taken, each from rest, without pauses.
    pub records: Vec<GapRecord>,
    /// The held-out record, which follows the last of them.
    pub held_out: GapRecord,
    /// The truth.
    pub label: Label,
    /// The main effects with their parameters, in the notation of a config's list.
    pub effects: Vec<Effect>,
}

/// Steps within a sample for effects inside the structure and for voltages that change within a sample.
const STEPS_PER_SAMPLE: usize = 8;

/// Smallest gap that an effect must cause in one of the records of a case, relative to its gap in the held-out one.
const SEEN: f64 = 0.2;

/// Largest share of a record that its converter may clip.
const MOST_CLIPPED: f64 = 0.05;

/// Draws a case. The same seed and spec give the same bits.
///
/// # Errors
/// Returns an error if the spec names an effect, a place or a law that does not exist or does not suit the plant and
/// its channels, if a number is outside its range, if keys contradict each other, if an effect cannot cause its gap
/// or is not visible in another record, or if a converter clips too many samples.
pub fn draw(seed: u64, spec: &GapSpec) -> Result<GapCase, GapError> {
    spec.check()?;
    let mut rng = stream(seed, Purpose::Draw, plant::PLANT);
    let layout = plants::layout(spec.plant, &mut rng);
    let rig = layout.rig.clone();
    let config = config(seed, spec, &rig);
    let mut schedule = excitation::schedule(seed, spec, &rig);
    let drawn = plant::drawn(&config, spec, layout, &schedule, &mut rng);
    let held_out = schedule.pop().expect("one is planned at least");
    let signals = strength::Signals::of(&drawn.base, held_out.commands.view());
    let scene = Scene { seed, spec, config: &config, drawn: &drawn, held_out: &held_out, signals: &signals };
    let (effects, labelled) = main_effects(&scene, &schedule)?;
    let background = background::drawn(&scene, &effects)?;

    let all: Vec<Effect> = effects.iter().chain(&background.effects).cloned().collect();
    let config = with_effects(&config, &all);
    let records = schedule.iter().map(|planned| taken(&config, spec, &drawn, planned)).collect::<Result<_, _>>()?;
    let last = taken(&config, spec, &drawn, &held_out)?;
    let foretold = foretold(&config, &drawn.base, &held_out)?;
    let label = Label {
        effects: labelled,
        perturbed: spec.perturbed || spec.beyond_limits > 0.0,
        ports: spec.ports,
        plant: spec.plant,
        inputs: spec.channels.inputs,
        outputs: spec.channels.outputs,
        experiment: spec.experiment,
        simulator: spec.simulator,
        misjudged: spec.noise_misjudged != 1.0,
        gap_sim: strength::gap(&last.outputs, &last.simulated),
        gap_floor: strength::gap(&last.outputs, &measured(foretold, spec.channels.outputs)),
        background: labelled_background(&scene, background)?,
    };
    let simulation = SimulationFile::of(seed, &drawn.nominal, spec, &rig);
    let simulator = spec.simulator;
    Ok(GapCase { simulation, simulator, records, held_out: last, label: label.or_none(), effects })
}

/// Returns the effects that the spec asks for, each at the strength that causes its gap in the held-out record. At
/// least one of the other records, `schedule`, must show the effect.
fn main_effects(
    scene: &Scene<'_>,
    schedule: &[excitation::Planned],
) -> Result<(Vec<Effect>, Vec<LabelledEffect>), GapError> {
    let Scene { seed, spec, drawn, signals, .. } = *scene;
    let mut effects = Vec::new();
    let mut labels = Vec::new();
    for (i, wanted) in spec.effects.iter().enumerate() {
        let first = effect::drawn(seed, i, wanted, spec, drawn, signals)?;
        let (effect, gap) = scene.bench(i).reach(&first, wanted.gap)?;
        check_seen(&scene.bench(i), &effect, SEEN * wanted.gap, schedule)?;
        labels.push(label::labelled(&effect, wanted.gap, gap, &drawn.base, &drawn.nominal));
        effects.push(effect);
    }
    Ok((effects, labels))
}

/// Checks that an effect causes at least the gap `least` in one of the driven records.
fn check_seen(
    bench: &Bench<'_>,
    effect: &Effect,
    least: f64,
    schedule: &[excitation::Planned],
) -> Result<(), GapError> {
    let mut most = 0.0_f64;
    for planned in schedule.iter().rev().filter(|planned| planned.excitation != Excitation::Zero) {
        most = most.max(bench.on(planned).gap_of_one(effect)?);
        if most >= least {
            return Ok(());
        }
    }
    Err(GapError::Unseen { kind: effect.kind().to_owned(), most })
}

/// Takes a record of the selected channels, and simulates the outputs of the nominal simulation for it.
fn taken(
    config: &TrussConfig,
    spec: &GapSpec,
    drawn: &plant::Drawn,
    planned: &excitation::Planned,
) -> Result<GapRecord, GapError> {
    let Channels { inputs, outputs } = spec.channels;
    let plant = altered(config, &drawn.base);
    config.check_for(drawn.base.modes.len(), planned.end())?;
    let noise = Noise::new(config, &plant, planned.index).of_inputs(inputs);
    let taken = record(config, &plant, planned.commands.view(), planned.clock(), Some(noise))?;
    let of = taken.outputs.nrows();
    let most = MOST_CLIPPED * of as f64;
    if let Some(channel) = taken.clipped.iter().position(|&samples| samples as f64 > most) {
        return Err(GapError::Escaped { channel, samples: taken.clipped[channel], of });
    }
    Ok(GapRecord {
        excitation: planned.excitation,
        commands: planned.commands.slice(s![.., ..inputs]).to_owned(),
        outputs: measured(taken.outputs, outputs),
        simulated: measured(drawn.nominal.discrete.simulate(planned.commands.view()), outputs),
    })
}

/// Returns the imperfections of the label. The held-out record is taken again without the main effects.
fn labelled_background(
    scene: &Scene<'_>,
    background: background::Background,
) -> Result<Option<LabelledBackground>, GapError> {
    if scene.spec.imperfections == 0.0 {
        return Ok(None);
    }
    // Idle effects stand in for the main ones, so that the others draw from the streams that they have in the case.
    let mut list = vec![Effect::idle(); scene.spec.effects.len()];
    list.extend(background.effects);
    let without = taken(&with_effects(scene.config, &list), scene.spec, scene.drawn, scene.held_out)?;
    let linear = scene.drawn.base.discrete.simulate(scene.held_out.commands.view());
    let linear = measured(linear, scene.spec.channels.outputs);
    let mut background_effects = background.labels;
    if scene.spec.beyond_limits > 0.0 {
        background_effects.extend(label::off_limits(
            &scene.drawn.base,
            &scene.drawn.nominal,
            scene.spec.channels.inputs,
        ));
    }
    Ok(Some(LabelledBackground {
        imperfect: true,
        imperfections: background.gap,
        gap_background: strength::gap(&without.outputs, &linear),
        gap_background_as_given: strength::gap(&without.outputs, &without.simulated),
        background_effects,
    }))
}

/// Returns the first outputs, which are those that a case measures.
fn measured(outputs: Array2<f64>, count: usize) -> Array2<f64> {
    if count == outputs.ncols() { outputs } else { outputs.slice(s![.., ..count]).to_owned() }
}

/// Predicts the held-out record from the plant and its effects, without knowledge of the random numbers.
fn foretold(config: &TrussConfig, base: &Truss, last: &excitation::Planned) -> Result<Array2<f64>, TestbedError> {
    let effects: Vec<Effect> = config.effects.list.iter().filter(|e| e.foretold()).cloned().collect();
    let config = with_effects(config, &effects);
    let plant = altered(&config, base);
    Ok(record(&config, &plant, last.commands.view(), last.clock(), None)?.outputs)
}

fn config(seed: u64, spec: &GapSpec, rig: &Rig) -> TrussConfig {
    let noise = rig.noise.clone();
    TrussConfig {
        sample_rate_hz: rig.sample_rate_hz,
        seed,
        noise: if spec.imperfections > 0.0 { imperfect(seed, noise) } else { noise },
        converters: rig.adc.clone(),
        effects: EffectsConfig { steps_per_sample: rig.steps_per_sample, ..EffectsConfig::default() },
        ..TrussConfig::default()
    }
}

/// Returns noise of the same RMS, of which one part is coloured and another has heavy tails.
fn imperfect(seed: u64, noise: NoiseConfig) -> NoiseConfig {
    let mut rng = stream(seed, Purpose::Draw, plant::NOISE);
    NoiseConfig {
        coloured_share: rng.random_range(0.1..0.5),
        coloured_hz: rng.random_range(5.0..100.0),
        heavy_share: rng.random_range(0.05..0.4),
        ..noise
    }
}

fn with_effects(config: &TrussConfig, effects: &[Effect]) -> TrussConfig {
    let mut config = config.clone();
    config.effects.list = effects.to_vec();
    config
}

impl excitation::Planned {
    fn clock(&self) -> Clock {
        Clock { record: self.index, start: self.start, sample_rate_hz: self.sample_rate_hz }
    }
}
