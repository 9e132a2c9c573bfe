//! Gap cases with a known answer: a truss with effects, the nominal simulation that lacks them, and records.
//!
//! [`draw`] draws one from a seed and a [`GapSpec`]; [`GapCase::write`] writes what a diagnosis may see in one folder and the
//! answer in another. The trusses have ten modes from 57 to 345 Hz, three piezo actuators with a pole at 260 Hz, three
//! accelerometers behind a two-pole filter at 1 kHz, 12-bit converters of +-5 V, 5 mV of noise on each sensor and amplifier, and
//! an ambient force that gives 2 mV.

mod effect;
mod excitation;
mod label;
mod plant;
mod strength;
mod write;

use ndarray::Array2;
use serde::{Deserialize, Serialize};

use crate::config::{ConverterConfig, EffectsConfig, NoiseConfig, TrussConfig};
use crate::effects::Effect;
use crate::effects::chain::Clock;
use crate::error::TestbedError;
use crate::plant::{Truss, altered};
use crate::record::{Noise, record};

pub use excitation::Excitation;
pub use label::{Label, LabelledEffect};
pub use write::SimulationFile;

/// What is to be drawn.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GapSpec {
    /// The effects at work; empty for none.
    #[serde(default)]
    pub effects: Vec<EffectSpec>,
    /// Whether the nominal simulation is slightly off beside them: one standard deviation is 0.05 % of a frequency, 3 % of a
    /// damping ratio and 0.5 % of a shape's entry.
    #[serde(default)]
    pub perturbed: bool,
    /// Whether the nominal simulation says where internal forces may act.
    #[serde(default)]
    pub ports: bool,
}

/// One effect to be drawn.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EffectSpec {
    /// Its name, as in a config's list.
    pub kind: String,
    /// Its place, as in a config's list; drawn where left out.
    #[serde(default)]
    pub at: Option<String>,
    /// Its law, as in a config's list; the vocabulary's own where left out.
    #[serde(default)]
    pub law: Option<String>,
    /// The gap that it is to make alone: RMS(y with it - y without) / RMS(y without) on the held-out record without noise, each
    /// output scaled to unit RMS.
    pub gap: f64,
}

/// Why a case could not be drawn or written.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum GapError {
    /// A kind, place or law that does not exist.
    #[error("effect {number} of the spec ({kind}): {reason}")]
    Spec {
        /// Which of the spec's, from 1.
        number: usize,
        /// Its kind.
        kind: String,
        /// What is wrong.
        reason: String,
    },
    /// No strength of this draw makes the gap asked for.
    #[error("{kind}: no strength makes a gap of {target}; the nearest found is {nearest}. Another seed may")]
    Unreachable {
        /// The effect.
        kind: String,
        /// The gap asked for.
        target: f64,
        /// The nearest found.
        nearest: f64,
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
}

/// A record: what was commanded and what was measured.
#[derive(Clone, Debug, PartialEq)]
pub struct GapRecord {
    /// How it was excited.
    pub excitation: Excitation,
    /// As the DAC gave them (K x m), V.
    pub commands: Array2<f64>,
    /// As the ADC gave them (K x p), V.
    pub outputs: Array2<f64>,
}

/// A drawn case.
#[derive(Clone, Debug)]
pub struct GapCase {
    /// The nominal simulation, in arbitrary coordinates.
    pub simulation: SimulationFile,
    /// In the order in which they were taken, each from rest, back to back.
    pub records: Vec<GapRecord>,
    /// Follows the last of them.
    pub held_out: GapRecord,
    /// The answer.
    pub label: Label,
    /// The effects with their parameters, as a config's list has them.
    pub effects: Vec<Effect>,
}

/// Steps within a sample for effects inside the structure and for slewing voltages.
const STEPS_PER_SAMPLE: usize = 8;
/// Rate of the cases, Hz.
const SAMPLE_RATE_HZ: f64 = 1600.0;
/// Standard deviation of sensor noise and of amplifier noise, V.
const NOISE_V: f64 = 0.005;

/// Draws a case: the same seed and spec give the same bits.
///
/// # Errors
/// If the spec names an effect, place or law that does not exist, or asks for a gap that its effect cannot make.
pub fn draw(seed: u64, spec: &GapSpec) -> Result<GapCase, GapError> {
    let config = config(seed);
    let schedule = excitation::schedule(seed);
    let drawn = plant::drawn(&config, spec, &schedule);
    let held_out = schedule.len() - 1;

    let mut effects = Vec::new();
    let mut labelled = Vec::new();
    let signals = strength::Signals::of(&drawn.base, schedule[held_out].commands.view());
    for (i, wanted) in spec.effects.iter().enumerate() {
        let first = effect::drawn(seed, i, wanted, &drawn, &signals)?;
        let bench = strength::Bench { config: &config, truss: &drawn.base, planned: &schedule[held_out], number: i };
        let (effect, gap) = bench.reach(&first, wanted.gap)?;
        labelled.push(label::labelled(&effect, wanted, gap, &drawn.base));
        effects.push(effect);
    }

    let config = with_effects(&config, &effects);
    let plant = altered(&config, &drawn.base);
    let last = &schedule[held_out];
    config.check_for(drawn.base.modes.len(), last.start + last.commands.nrows())?;
    let mut records = schedule
        .iter()
        .enumerate()
        .map(|(index, planned)| {
            let noise = Noise::new(&config, &plant, index);
            let clock = planned.clock(index);
            let outputs = record(&config, &plant, planned.commands.view(), clock, Some(noise))?.outputs;
            Ok(GapRecord { excitation: planned.excitation, commands: planned.commands.clone(), outputs })
        })
        .collect::<Result<Vec<_>, TestbedError>>()?;
    let held_out_record = records.pop().expect("seven were planned");

    let nominal = drawn.nominal.discrete.simulate(last.commands.view());
    let foretold = foretold(&config, &drawn.base, last, held_out)?;
    let label = Label {
        effects: labelled,
        perturbed: spec.perturbed,
        ports: spec.ports,
        gap_sim: strength::gap(&held_out_record.outputs, &nominal),
        gap_floor: strength::gap(&held_out_record.outputs, &foretold),
    };
    let simulation =
        SimulationFile::of(&drawn.nominal, plant::coordinates(seed, drawn.nominal.discrete.states()), spec.ports);
    Ok(GapCase { simulation, records, held_out: held_out_record, label: label.or_none(), effects })
}

/// The held-out record as somebody would foretell it who knows the truss and its effects, but no random numbers.
fn foretold(
    config: &TrussConfig,
    base: &Truss,
    last: &excitation::Planned,
    index: usize,
) -> Result<Array2<f64>, TestbedError> {
    let effects: Vec<Effect> = config.effects.list.iter().filter(|e| e.foretold()).cloned().collect();
    let config = with_effects(config, &effects);
    let plant = altered(&config, base);
    Ok(record(&config, &plant, last.commands.view(), last.clock(index), None)?.outputs)
}

fn config(seed: u64) -> TrussConfig {
    TrussConfig {
        sample_rate_hz: SAMPLE_RATE_HZ,
        seed,
        noise: NoiseConfig { sensor_rms_v: NOISE_V, amplifier_rms_v: NOISE_V, ambient_rms_v: 0.002 },
        converters: ConverterConfig { step_v: 10.0 / 4096.0, range_v: 5.0 },
        effects: EffectsConfig { steps_per_sample: STEPS_PER_SAMPLE, ..EffectsConfig::default() },
        ..TrussConfig::default()
    }
}

fn with_effects(config: &TrussConfig, effects: &[Effect]) -> TrussConfig {
    let mut config = config.clone();
    config.effects.list = effects.to_vec();
    config
}

impl excitation::Planned {
    fn clock(&self, record: usize) -> Clock {
        Clock { record, start: self.start, sample_rate_hz: SAMPLE_RATE_HZ }
    }
}
