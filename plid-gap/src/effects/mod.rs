//! The vocabulary: effects that a simulation may lack, one file for each.
//!
//! An effect says where it may act ([`Effect::places`]), from which values a fit starts ([`Effect::starts`]) and how it
//! changes a simulation ([`Effect::act`]). Everything else (screen, fit, comparison, report, prediction) works on any
//! effect. An effect of another crate is therefore one type, which [`Library::with`] adds. A built-in one is its file,
//! the line that declares it, and one entry of the list `vocabulary!` below. Tests then name what is still missing: its
//! check against an independent answer, its law in the testbed and in blind trials, and its equation in the script that
//! repeats predictions.

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
mod added_damping;
mod added_mass;
mod added_stiffness;
mod backlash;
mod clearance;
mod clip;
mod coloured_disturbance;
mod coulomb_friction;
mod cubic_stiffness;
mod end_stop;
mod flexible;
mod gravity_sine;
mod iwan_joint;
mod joint_hysteresis;
mod library;
mod mains_hum;
mod missing_mode;
mod modal_damping;
mod modal_frequency;
mod narrowband_disturbance;
mod one_sided_stop;
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
mod stick_friction;
mod stiffness_drift;
mod stop;
mod tanh;
mod unit;
mod units;

use crate::case::Limits;
pub use crate::plant::Load;
pub use crate::signal::peaks::MissingModeStart;
pub use action::{Action, Command, Drive, Force, Sampling, Sensor};
pub use flexible::Flexible;
pub use library::Library;
pub use place::{Names, Place};
pub use setting::Setting;
pub use units::{ARBITRARY, Units};

/// Exports the effects of the list, and makes the whole vocabulary of them.
macro_rules! vocabulary {
    ($($file:ident::$effect:ident,)+) => {
        $(pub use $file::$effect;)+

        /// Returns every built-in effect, in the order of the list.
        fn built_in() -> Vec<Box<dyn Effect>> {
            vec![$(Box::new($effect)),+]
        }
    };
}

// The one list of built-in effects. Where two of them gain equally, the first is preferred.
vocabulary! {
    actuator_crosstalk::ActuatorCrosstalk,
    actuator_dead_zone::ActuatorDeadZone,
    actuator_delay::ActuatorDelay,
    actuator_gain::ActuatorGain,
    actuator_gain_drift::ActuatorGainDrift,
    actuator_hysteresis::ActuatorHysteresis,
    actuator_lag::ActuatorLag,
    actuator_saturation::ActuatorSaturation,
    actuator_slew_limit::ActuatorSlewLimit,
    added_damping::AddedDamping,
    added_mass::AddedMass,
    added_stiffness::AddedStiffness,
    backlash::Backlash,
    clearance::Clearance,
    coulomb_friction::CoulombFriction,
    cubic_stiffness::CubicStiffness,
    end_stop::EndStop,
    gravity_sine::GravitySine,
    iwan_joint::IwanJoint,
    joint_hysteresis::JointHysteresis,
    mains_hum::MainsHum,
    missing_mode::MissingMode,
    modal_damping::ModalDamping,
    modal_frequency::ModalFrequency,
    narrowband_disturbance::NarrowbandDisturbance,
    one_sided_stop::OneSidedStop,
    quadratic_damping::QuadraticDamping,
    quadratic_stiffness::QuadraticStiffness,
    sensor_crosstalk::SensorCrosstalk,
    sensor_delay::SensorDelay,
    sensor_drift::SensorDrift,
    sensor_gain::SensorGain,
    sensor_lag::SensorLag,
    sensor_offset::SensorOffset,
    sensor_saturation::SensorSaturation,
    stick_friction::StickFriction,
    stiffness_drift::StiffnessDrift,
    coloured_disturbance::ColouredDisturbance,
    sensor_dropout::SensorDropout,
    sensor_noise::SensorNoise,
    sensor_quantisation::SensorQuantisation,
}

/// The part of the signal path in which an effect acts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Side {
    /// Between the command and the structure.
    Actuator,
    /// Inside the structure.
    Structure,
    /// Between the structure and the record.
    Sensor,
    /// A force that no command causes.
    Disturbance,
    /// A change during the records.
    Time,
}

/// Where an effect can be observed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Observation {
    /// In free runs, whose outputs it changes: the search fits it.
    FreeRun,
    /// In raw values: the steps of a converter. Parameters: step, and the share of it that is truncated (0 or 0.5).
    Quantisation,
    /// In raw values: repeated samples. Parameter: their rate.
    Dropouts,
    /// In quiet records: the noise of one sensor. Parameter: its standard deviation.
    SensorNoise,
    /// In quiet records: a random force in a frequency band. Parameters: its standard deviation and its frequency.
    Band,
}

/// The values that a parameter can take, and the steps of a fit in it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Range {
    /// Any sign; zero means no effect. Steps are a share of the start.
    Signed,
    /// Positive; steps in the logarithm.
    Positive,
    /// A frequency in Hz; steps are a small share of a line's width over all records.
    Hz,
    /// An angle in rad.
    Angle,
    /// An entry of a vector of which only the direction counts; steps as for [`Range::Signed`].
    Direction,
}

/// A parameter of an effect.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameter {
    /// Its name in the equation.
    pub name: String,
    /// Its unit, in terms of the units of channels and ports.
    pub unit: String,
    /// Its range.
    pub range: Range,
    /// Whether it may be left out, together with later ones; the equation then uses a default.
    pub optional: bool,
}

impl Parameter {
    /// Creates a parameter.
    pub fn new(name: impl Into<String>, unit: impl Into<String>, range: Range) -> Self {
        Self { name: name.into(), unit: unit.into(), range, optional: false }
    }

    /// Returns the same parameter as one that may be left out.
    fn or_left_out(self) -> Self {
        Self { optional: true, ..self }
    }
}

/// A parameter of the simulation, as it is and as it should be.
#[derive(Debug, Clone, PartialEq)]
pub struct Change {
    /// Its name in words.
    pub number: String,
    /// Its value in the simulation.
    pub from: f64,
    /// Its value in the records.
    pub to: f64,
    /// The unit of both.
    pub unit: String,
}

impl Change {
    /// Creates a change of a number without unit.
    fn of(number: String, from: f64, to: f64) -> Option<Self> {
        Some(Self { number, from, to, unit: "1".into() })
    }
}

/// An effect that a simulation may lack.
pub trait Effect: Send + Sync {
    /// Its identifier.
    fn name(&self) -> &'static str;

    /// Returns the part of the signal path in which it acts.
    fn side(&self) -> Side;

    /// Returns its equation in one line.
    fn equation(&self) -> &'static str;

    /// Returns its parameters in the order in which [`Effect::act`] takes them.
    fn parameters(&self, setting: &Setting) -> Vec<Parameter>;

    /// Returns all locations at which it may act, in this simulation and these records.
    fn places(&self, setting: &Setting) -> Vec<Place>;

    /// Returns values from which a fit starts at a location: a coarse grid over parameters in which the output is
    /// nonlinear, with moderate sizes.
    fn starts(&self, setting: &Setting, place: &Place) -> Vec<Vec<f64>>;

    /// Returns values from which a fit starts in the place of another effect (its name) that was found with these
    /// parameters, if they follow from them. Where a clearance was found, a stop may be: records show how far an axis
    /// moves freely better than any grid does.
    fn starts_from(&self, _setting: &Setting, _place: &Place, _found: (&str, &[f64])) -> Vec<Vec<f64>> {
        Vec::new()
    }

    /// Returns the parameter in which the output is linear near the value at which the effect vanishes, with that
    /// value, if there is one. The screen then finds the size without a fit.
    fn amplitude(&self) -> Option<(usize, f64)> {
        None
    }

    /// Returns whether the bounded refit has its parameter too, within the stated limits.
    fn is_in_refit(&self) -> bool {
        false
    }

    /// Returns whether it only changes a parameter of the simulation. A refit can distribute such a change over the
    /// shapes of all modes, so the effect is tried again with an explanation that leaves more than noise.
    fn is_number(&self) -> bool {
        self.is_in_refit()
    }

    /// Returns whether it is a contact with something at rest. What follows a contact depends on when it happens, so
    /// the run at a start that is slightly off resembles nothing, and the effect is fitted whatever its rank in the
    /// screen.
    fn is_contact(&self) -> bool {
        false
    }

    /// Returns whether it is linear and does not change with time. A linear model that was identified from the same
    /// records already contains such an effect.
    fn is_linear(&self) -> bool {
        false
    }

    /// Returns where it can be observed. An effect that does not change a free run is stochastic.
    fn observed_in(&self) -> Observation {
        Observation::FreeRun
    }

    /// Returns the free shape that is fitted with it or in its place if its own shape does not suffice; `None` for an
    /// effect without a shape. It is one of those built in: the one on the same signal, at a place of the same kind,
    /// such as `Some(&Flexible::Command)` for a static curve of a command.
    fn free_shape(&self) -> Option<&'static Flexible> {
        None
    }

    /// Returns the family to which it belongs: effects of one kind that records often cannot tell apart at one place,
    /// such as laws of dry friction. An answer states the probability of the family as well as that of the effect.
    fn family(&self) -> Option<&'static str> {
        None
    }

    /// Returns the effect of which it is a finer law, with more parameters. It is then tried only in the place of that
    /// effect, once the search has found it, or where the case suspects it.
    fn refines(&self) -> Option<&'static str> {
        None
    }

    /// Returns the parameter that is the phase of a sinusoidal disturbance. Such a phase may change from record to
    /// record; the line is then named, but no simulation can predict it.
    fn phase(&self) -> Option<usize> {
        None
    }

    /// Returns whether it adds a resonance to the simulation. Its locations come from the frequency response of random
    /// records, which needs at least as many stretches as inputs.
    fn adds_mode(&self) -> bool {
        false
    }

    /// Returns the numbers of the simulation or of the records that its equation uses, as name, value and unit. They
    /// are written together with its parameters.
    fn given(&self, _setting: &Setting, _place: &Place) -> Vec<(&'static str, f64, &'static str)> {
        Vec::new()
    }

    /// Returns whether the parameters are within the meaning of the name. A hysteresis that never yields is a gain, and
    /// a gap that never closes does not act.
    fn sound(&self, _setting: &Setting, _place: &Place, _parameters: &[f64]) -> bool {
        true
    }

    /// Returns why something else may be the cause although these parameters fit: they are at the limit of what the
    /// name means. One clause, for a report.
    fn caveat(&self, _parameters: &[f64]) -> Option<&'static str> {
        None
    }

    /// Returns its location after the fit: a fitted frequency may be far from its start.
    fn fitted_place(&self, place: &Place, _parameters: &[f64]) -> Place {
        place.clone()
    }

    /// Returns the parameter of the simulation that it changes, if that is all; `None` for an effect with an equation
    /// of its own.
    fn change(&self, _setting: &Setting, _place: &Place, _parameters: &[f64]) -> Option<Change> {
        None
    }

    /// Returns the relative standard deviation of the simulation's own number of this kind at a port, by its limits:
    /// such an error acts as the effect does. Zero for an effect that is no such number.
    fn own_std(&self, _limits: &Limits) -> f64 {
        0.0
    }

    /// Returns its actions with these parameters at a location.
    fn act(&self, setting: &Setting, place: &Place, parameters: &[f64]) -> Vec<Action>;
}

impl dyn Effect + '_ {
    /// Returns whether a free run cannot show it.
    pub fn is_stochastic(&self) -> bool {
        self.observed_in() != Observation::FreeRun
    }
}

/// Returns all ordered pairs of different channels.
fn pairs(count: usize, of: fn(usize, usize) -> Place) -> Vec<Place> {
    (0..count).flat_map(|i| (0..count).filter(move |&j| j != i).map(move |j| of(i, j))).collect()
}
