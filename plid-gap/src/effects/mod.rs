//! The vocabulary: what may be missing from a simulation, one file an effect.
//!
//! An effect says where it may act ([`Effect::places`]), from which values a fit starts ([`Effect::starts`]) and what it does to a
//! simulation ([`Effect::act`]). Everything else (screen, fit, comparison, report, prediction) works on any effect, so that an
//! effect of your own is one file and one line in [`Library::standard`] or [`Library::with`].

mod action;
mod actuator_crosstalk;
mod actuator_dead_zone;
mod actuator_delay;
mod actuator_gain;
mod actuator_gain_drift;
mod actuator_hysteresis;
mod actuator_lag;
mod actuator_saturation;
mod actuator_slew_limit;
mod clearance;
mod coloured_disturbance;
mod coulomb_friction;
mod cubic_stiffness;
mod flexible;
mod joint_hysteresis;
mod library;
mod mains_hum;
mod missing_mode;
mod modal_damping;
mod modal_frequency;
mod narrowband_disturbance;
mod place;
mod quadratic_damping;
mod quadratic_stiffness;
mod sensor_crosstalk;
mod sensor_delay;
mod sensor_drift;
mod sensor_dropout;
mod sensor_gain;
mod sensor_lag;
mod sensor_noise;
mod sensor_offset;
mod sensor_quantisation;
mod sensor_saturation;
mod setting;
mod slip;
mod stiffness_drift;

pub use crate::signal::peaks::MissingModeStart;
pub use action::{Action, Command, Drive, Force, Sensor};
pub use actuator_crosstalk::ActuatorCrosstalk;
pub use actuator_dead_zone::ActuatorDeadZone;
pub use actuator_delay::ActuatorDelay;
pub use actuator_gain::ActuatorGain;
pub use actuator_gain_drift::ActuatorGainDrift;
pub use actuator_hysteresis::ActuatorHysteresis;
pub use actuator_lag::ActuatorLag;
pub use actuator_saturation::ActuatorSaturation;
pub use actuator_slew_limit::ActuatorSlewLimit;
pub use clearance::Clearance;
pub use coloured_disturbance::ColouredDisturbance;
pub use coulomb_friction::CoulombFriction;
pub use cubic_stiffness::CubicStiffness;
pub use flexible::Flexible;
pub use joint_hysteresis::JointHysteresis;
pub use library::Library;
pub use mains_hum::MainsHum;
pub use missing_mode::MissingMode;
pub use modal_damping::ModalDamping;
pub use modal_frequency::ModalFrequency;
pub use narrowband_disturbance::NarrowbandDisturbance;
pub use place::{Names, Place};
pub use quadratic_damping::QuadraticDamping;
pub use quadratic_stiffness::QuadraticStiffness;
pub use sensor_crosstalk::SensorCrosstalk;
pub use sensor_delay::SensorDelay;
pub use sensor_drift::SensorDrift;
pub use sensor_dropout::SensorDropout;
pub use sensor_gain::SensorGain;
pub use sensor_lag::SensorLag;
pub use sensor_noise::SensorNoise;
pub use sensor_offset::SensorOffset;
pub use sensor_quantisation::SensorQuantisation;
pub use sensor_saturation::SensorSaturation;
pub use setting::Setting;
pub use stiffness_drift::StiffnessDrift;

/// Where in the chain an effect acts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Side {
    /// Between the command and the structure.
    Actuator,
    /// Inside.
    Structure,
    /// Between the structure and the record.
    Sensor,
    /// A force that no command causes.
    Disturbance,
    /// Something that changes while the records are taken.
    Time,
}

/// Where an effect can be observed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Observation {
    /// In free runs, whose outputs it changes: the search fits it.
    FreeRun,
    /// In raw values: the steps of a converter. Parameters: step, and the share of it that is cut off (0 or 0.5).
    Quantisation,
    /// In raw values: samples that repeat. Parameter: their rate.
    Dropouts,
    /// In quiet records: the noise of one sensor. Parameter: its standard deviation.
    SensorNoise,
    /// In quiet records: a random force in a frequency band. Parameters: its standard deviation and its frequency.
    Band,
}

/// What values a parameter can take, and how a fit steps through them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Range {
    /// Any sign; zero means no effect. Steps are a share of the start.
    Signed,
    /// Above zero; steps in the logarithm.
    Positive,
    /// A frequency in Hz: steps are a small share of a line's width over all records.
    Hz,
    /// An angle in rad.
    Angle,
    /// An entry of a vector of which only the direction counts; steps as of [`Range::Signed`].
    Direction,
}

/// A parameter of an effect.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameter {
    /// As in the equation.
    pub name: String,
    /// In the channels' and ports' own units.
    pub unit: String,
    /// What it can be.
    pub range: Range,
}

impl Parameter {
    /// A parameter.
    pub fn new(name: impl Into<String>, unit: impl Into<String>, range: Range) -> Self {
        Self { name: name.into(), unit: unit.into(), range }
    }
}

/// A number of the simulation, as it is and as it should be.
#[derive(Debug, Clone, PartialEq)]
pub struct Change {
    /// Which one, in words.
    pub number: String,
    /// As the simulation has it.
    pub from: f64,
    /// As the records have it.
    pub to: f64,
    /// Of both.
    pub unit: &'static str,
}

impl Change {
    /// A number without unit.
    fn of(number: String, from: f64, to: f64) -> Option<Self> {
        Some(Self { number, from, to, unit: "1" })
    }
}

/// Something that a simulation may lack.
pub trait Effect: Send + Sync {
    /// Its identifier.
    fn name(&self) -> &'static str;

    /// Where in the chain it acts.
    fn side(&self) -> Side;

    /// What it does, as a line of mathematics.
    fn equation(&self) -> &'static str;

    /// In the order in which [`Effect::act`] takes them.
    fn parameters(&self, setting: &Setting) -> Vec<Parameter>;

    /// All places where it may act on this simulation and these records.
    fn places(&self, setting: &Setting) -> Vec<Place>;

    /// Values from which to look for it there: a coarse grid over what is not linear, with moderate sizes.
    fn starts(&self, setting: &Setting, place: &Place) -> Vec<Vec<f64>>;

    /// The parameter in which the output is linear near the value at which the effect vanishes, and that value, if there is one:
    /// the screen finds the size without a fit.
    fn amplitude(&self) -> Option<(usize, f64)> {
        None
    }

    /// Whether its number is one that the bounded refit has too, within the stated limits.
    fn is_in_refit(&self) -> bool {
        false
    }

    /// Whether it is no more than a number of the simulation. A refit can spread such a number over the shapes of all modes, so it is tried again beside an
    /// explanation that leaves more than noise.
    fn is_number(&self) -> bool {
        self.is_in_refit()
    }

    /// Where it can be observed. All but effects in free runs are stochastic: a free run cannot show them.
    fn observed_in(&self) -> Observation {
        Observation::FreeRun
    }

    /// The free shape that is fitted beside it or in its place where its own shape does not suffice; none for an effect without a shape.
    fn free_shape(&self) -> Option<&'static Flexible> {
        None
    }

    /// The parameter that is the phase of a sinusoidal disturbance. Such a phase may change from record to record; the line is then named, but no
    /// simulation predicts it.
    fn phase(&self) -> Option<usize> {
        None
    }

    /// Whether it adds a resonance to the simulation. Its places come from the frequency response of random records, which needs as many stretches as there
    /// are inputs.
    fn adds_mode(&self) -> bool {
        false
    }

    /// Numbers of the simulation or of the records that its equation uses, as name, value and unit. They are written beside its parameters.
    fn given(&self, _setting: &Setting, _place: &Place) -> Vec<(&'static str, f64, &'static str)> {
        Vec::new()
    }

    /// Whether the parameters still mean what the name says: a hysteresis that never yields is a gain, a gap that is never closed is
    /// nothing.
    fn sound(&self, _setting: &Setting, _place: &Place, _parameters: &[f64]) -> bool {
        true
    }

    /// Why something else may be at work although these parameters fit: they are at the limit of what the name means. One clause, for a report.
    fn caveat(&self, _parameters: &[f64]) -> Option<&'static str> {
        None
    }

    /// Where it is once it is fitted: a frequency that is looked for may have moved far from its start.
    fn fitted_place(&self, place: &Place, _parameters: &[f64]) -> Place {
        place.clone()
    }

    /// Which number of the simulation it changes, where it does no more; none for what takes an equation of its own.
    fn change(&self, _setting: &Setting, _place: &Place, _parameters: &[f64]) -> Option<Change> {
        None
    }

    /// What it does with these parameters there.
    fn act(&self, setting: &Setting, place: &Place, parameters: &[f64]) -> Vec<Action>;
}

impl dyn Effect + '_ {
    /// Whether a free run cannot show it.
    pub fn is_stochastic(&self) -> bool {
        self.observed_in() != Observation::FreeRun
    }
}

/// All ordered pairs of different channels.
fn pairs(count: usize, of: fn(usize, usize) -> Place) -> Vec<Place> {
    (0..count).flat_map(|i| (0..count).filter(move |&j| j != i).map(move |j| of(i, j))).collect()
}
