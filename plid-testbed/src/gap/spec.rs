//! The specification of a case.

use serde::{Deserialize, Serialize};

use super::GapError;
use crate::effects::Families;
use crate::{INPUTS, OUTPUTS};

/// The specification of a case. Keys that are left out have the values of [`GapSpec::default`]: a truss with all its
/// channels, no effect, six records of full length and an exact simulation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct GapSpec {
    /// The effects at work; empty for none.
    pub effects: Vec<EffectSpec>,
    /// Whether the nominal simulation also has small errors in its parameters: one standard deviation is 0.05 % of a
    /// frequency, 3 % of a damping ratio and 0.5 % of a shape's entry.
    pub perturbed: bool,
    /// Whether the nominal simulation states where internal forces may act.
    pub ports: bool,
    /// The plant.
    pub plant: PlantKind,
    /// The numbers of channels; at most those that the plant has.
    pub channels: Channels,
    /// The records.
    pub experiment: Experiment,
    /// The form in which the case gives the nominal simulation.
    pub simulator: Simulator,
    /// Ratio of the noise of sensors and amplifiers to the noise that the nominal simulation declares; from 2/3 to 3/2.
    pub noise_misjudged: f64,
    /// Length of the records relative to full ones; from 0.1 to 1. At 0.16, a record without input has 512 samples.
    /// The period of the multisine shortens with the record, so that there are six periods in any case.
    pub length: f64,
    /// The gap that further small effects, of random kind, place and size, cause together; 0 for none, at most 0.2.
    /// With them, the noise has coloured and heavy-tailed parts.
    #[serde(skip_serializing_if = "is_zero")]
    pub imperfections: f64,
    /// The size of the errors of the nominal simulation, in standard deviations of the limits that a case states (0.1
    /// % of a frequency, 5 % of a damping ratio, 1 % of a shape's entry) and, for the pole of an actuator, in units
    /// of 2 %; at most 3. With 0, `perturbed` decides.
    #[serde(skip_serializing_if = "is_zero")]
    pub beyond_limits: f64,
    /// The shapes of laws other than the vocabulary's own, of the harmonics of a hum and of the width of a random
    /// force.
    #[serde(skip_serializing_if = "is_fixed")]
    pub families: Families,
}

#[allow(clippy::trivially_copy_pass_by_ref)] // serde asks for a reference.
fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

#[allow(clippy::trivially_copy_pass_by_ref)] // serde asks for a reference.
fn is_fixed(families: &Families) -> bool {
    *families == Families::Fixed
}

impl Default for GapSpec {
    fn default() -> Self {
        Self {
            effects: Vec::new(),
            perturbed: false,
            ports: false,
            plant: PlantKind::default(),
            channels: Channels::default(),
            experiment: Experiment::default(),
            simulator: Simulator::default(),
            noise_misjudged: 1.0,
            length: 1.0,
            imperfections: 0.0,
            beyond_limits: 0.0,
            families: Families::default(),
        }
    }
}

/// One effect to be drawn.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EffectSpec {
    /// The name of the effect, as in a config's list, or of one that the program has added.
    pub kind: String,
    /// Its place, as in a config's list. If it is left out, the place is drawn among the channels that there are.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub at: Option<String>,
    /// Its law, as in a config's list; the vocabulary's own if it is left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub law: Option<String>,
    /// The gap that it must cause alone: RMS(y with it - y without) / RMS(y without) on the held-out record without
    /// noise, each output scaled to unit RMS.
    pub gap: f64,
}

/// A kind of plant; each seed draws a different plant of the kind.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PlantKind {
    /// Ten modes from 57 to 345 Hz.
    #[default]
    Truss,
    /// A uniform beam on two supports in bending: six modes, at 1, 4, 9, ... times the first.
    Beam,
    /// Seven inertias in a row on shafts, as in a gearbox.
    Chain,
    /// Motors whose lag dominates the response, a body that is held in its attitude, and its arms.
    Drone,
    /// The truss with two pairs of modes that lie closer than their half-power widths.
    CloseModes,
    /// A motor on a bench: torque to speed, of first order.
    Motor,
    /// A position servo: of second order and well damped.
    Servo,
    /// A mass without a spring, in a bearing: force to position.
    Slider,
    /// Such a mass without a damper: force to speed.
    FreeSlider,
    /// A pendulum that is driven at its axis: torque to angle, in radians.
    Pendulum,
    /// Two links with elastic joints: torques to angles.
    Arm,
    /// A slider under a controller: reference to position.
    SliderLoop,
    /// An arm with stiff joints, each under a controller: references to angles.
    ArmLoop,
}

/// The numbers of inputs and outputs: the first ones of the plant, of which a structure has three each. Further
/// inputs are neither driven nor noisy, further outputs are not measured, and effects are drawn only where there is a
/// channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Channels {
    /// Number of inputs, from 1 to 3.
    pub inputs: usize,
    /// Number of outputs, from 1 to 3.
    pub outputs: usize,
}

impl Default for Channels {
    fn default() -> Self {
        Self { inputs: INPUTS, outputs: OUTPUTS }
    }
}

/// The kind of experiment.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Experiment {
    /// One record without input, four random records at three levels, and a multisine.
    #[default]
    Active,
    /// A single random record of twice the length.
    Passive,
}

/// The form in which a case gives the nominal simulation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Simulator {
    /// As a model, in sim.json.
    #[default]
    Model,
    /// As its outputs alone, for the input of each record.
    Outputs,
}

/// Largest factor by which a declared noise may be wrong, either way.
const MOST_MISJUDGED: f64 = 1.5;
/// Shortest length of a record, relative to a full one.
const SHORTEST: f64 = 0.1;
/// Largest gap of imperfections.
const MOST_IMPERFECT: f64 = 0.2;
/// Largest error of a simulation, in standard deviations of the stated limits.
const MOST_BEYOND: f64 = 3.0;

impl GapSpec {
    /// Checks all keys except the effects.
    pub(crate) fn check(&self) -> Result<(), GapError> {
        let most = self.plant.channels();
        within("channels.inputs", self.channels.inputs as f64, 1.0, most.inputs as f64)?;
        within("channels.outputs", self.channels.outputs as f64, 1.0, most.outputs as f64)?;
        within("noise_misjudged", self.noise_misjudged, 1.0 / MOST_MISJUDGED, MOST_MISJUDGED)?;
        within("length", self.length, SHORTEST, 1.0)?;
        within("imperfections", self.imperfections, 0.0, MOST_IMPERFECT)?;
        within("beyond_limits", self.beyond_limits, 0.0, MOST_BEYOND)?;
        if self.plant.has_axes() && (self.imperfections > 0.0 || self.beyond_limits > 0.0) {
            return Err(GapError::Apart {
                key: if self.imperfections > 0.0 { "imperfections" } else { "beyond_limits" },
                other: "plant",
                reason: "the imperfections that are drawn are those of a structure",
            });
        }
        if self.simulator == Simulator::Outputs {
            let apart = |key, reason| Err(GapError::Apart { key, other: "simulator = \"outputs\"", reason });
            if self.ports {
                return apart("ports", "outputs do not say where internal forces may act");
            }
            if self.noise_misjudged != 1.0 {
                return apart("noise_misjudged", "outputs declare no noise");
            }
        }
        Ok(())
    }
}

fn within(key: &'static str, value: f64, least: f64, most: f64) -> Result<(), GapError> {
    if (least..=most).contains(&value) { Ok(()) } else { Err(GapError::OutOfRange { key, value, least, most }) }
}
