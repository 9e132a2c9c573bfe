//! The vocabulary: effects that a simulation may lack, one file for each.
//!
//! An effect states where it may act ([`Effect::places`]), from which values a fit starts ([`Effect::starts`]) and
//! how it changes a simulation ([`Effect::act`]). Everything else (screen, fit, comparison, report, prediction) works
//! with any effect. An effect from another crate is therefore a single type, which [`Library::with`] adds. A built-in
//! effect consists of its file, the line that declares the file, and an entry in the list `vocabulary!` below. Tests
//! then name what is still missing: its check against an independent solution, its law in the testbed and in blind
//! trials, and its equation in the script that repeats predictions.

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
mod mix;
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
mod taps;
mod unit;
mod units;

use crate::case::Limits;
pub use crate::plant::Load;
pub use crate::signal::peaks::MissingModeStart;
pub use action::{Action, Command, Drive, Force, Memory, Sampling, Sensor};
pub use flexible::Flexible;
pub use library::Library;
pub use place::{Names, Place};
pub use setting::Setting;
pub use units::{ARBITRARY, Units};

/// Exports the effects in the list and builds the whole vocabulary from them.
macro_rules! vocabulary {
    ($($file:ident::$effect:ident,)+) => {
        $(pub use $file::$effect;)+

        /// Returns every built-in effect, in the order of the list.
        fn built_in() -> Vec<Box<dyn Effect>> {
            vec![$(Box::new($effect)),+]
        }
    };
}

// The only list of built-in effects. If two of them gain equally, the first one is preferred.
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

/// The data in which an effect can be observed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Observation {
    /// In free runs, whose outputs the effect changes. The search fits such an effect.
    FreeRun,
    /// In raw values: the steps of a converter. Parameters: the step, and the share of it by which truncation reduces
    /// a value on average (0 or 0.5).
    Quantisation,
    /// In raw values: repeated samples. Parameter: their rate.
    Dropouts,
    /// In quiet records: the noise of one sensor. Parameter: its standard deviation.
    SensorNoise,
    /// In quiet records: a random force in a frequency band. Parameters: its standard deviation and its frequency.
    Band,
}

/// The values that a parameter can take, and the steps in which a fit changes it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Range {
    /// Any sign. Steps are a share of the start.
    Signed,
    /// Positive. Steps are in the logarithm, or, for an amplitude ([`Effect::amplitude`]), a share of the value.
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
    /// Whether it may be omitted together with all later ones. The equation then uses a default value.
    pub optional: bool,
}

impl Parameter {
    /// Creates a parameter.
    pub fn new(name: impl Into<String>, unit: impl Into<String>, range: Range) -> Self {
        Self { name: name.into(), unit: unit.into(), range, optional: false }
    }

    /// Returns the same parameter as one that may be omitted.
    fn or_left_out(self) -> Self {
        Self { optional: true, ..self }
    }
}

/// A parameter of the simulation, with its present and its corrected value.
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
    /// Creates a change of a dimensionless parameter.
    fn of(number: String, from: f64, to: f64) -> Option<Self> {
        Some(Self { number, from, to, unit: "1".into() })
    }
}

/// An effect that a simulation may lack.
pub trait Effect: Send + Sync {
    /// Returns its identifier.
    fn name(&self) -> &'static str;

    /// Returns the part of the signal path in which it acts.
    fn side(&self) -> Side;

    /// Returns its equation in one line.
    fn equation(&self) -> &'static str;

    /// Returns its parameters in the order in which [`Effect::act`] takes them.
    fn parameters(&self, setting: &Setting) -> Vec<Parameter>;

    /// Returns all locations at which it may act, in this simulation and these records.
    fn places(&self, setting: &Setting) -> Vec<Place>;

    /// Returns values from which a fit starts at a location: a coarse grid over the parameters in which the output is
    /// nonlinear, with moderate sizes.
    fn starts(&self, setting: &Setting, place: &Place) -> Vec<Vec<f64>>;

    /// Returns values from which a fit starts in place of another effect, which is given by its name and its fitted
    /// parameters; empty if none follow from these. For example, a stop may be the cause where a clearance was found,
    /// and the fitted gap gives the free travel of the axis better than any grid.
    fn starts_from(&self, _setting: &Setting, _place: &Place, _found: (&str, &[f64])) -> Vec<Vec<f64>> {
        Vec::new()
    }

    /// Returns the index of the parameter in which the output is linear near the value at which the effect vanishes,
    /// and that value, if there is such a parameter. The screen then determines the size without a fit.
    fn amplitude(&self) -> Option<(usize, f64)> {
        None
    }

    /// Returns whether the bounded refit also adjusts its parameter, within the stated limits.
    fn is_in_refit(&self) -> bool {
        false
    }

    /// Returns whether it only changes a parameter of the simulation. A refit can distribute such a change over the
    /// shapes of all modes. If an explanation leaves more than noise, the search therefore also looks for such an
    /// effect behind the changes of the linear parameters.
    fn is_number(&self) -> bool {
        self.is_in_refit()
    }

    /// Returns whether it can act between a plant and its controller even if both respond within a sample. In closed
    /// loop, its action must then be a change of the plant.
    fn acts_in_loop(&self) -> bool {
        false
    }

    /// Returns whether it is a contact with a body at rest. The motion after a contact depends on when the contact
    /// happens, so a run from slightly wrong starting values does not resemble the record. Such an effect is fitted
    /// whatever its rank in the screen.
    fn is_contact(&self) -> bool {
        false
    }

    /// Returns whether it is linear and time-invariant. A linear model that was identified from the same records
    /// already contains such an effect.
    fn is_linear(&self) -> bool {
        false
    }

    /// Returns the data in which it can be observed. An effect that does not change a free run is stochastic.
    fn observed_in(&self) -> Observation {
        Observation::FreeRun
    }

    /// Returns the free shape that is fitted with it, or in its place, if its own shape does not suffice; `None` for
    /// an effect without a shape. The free shape is the built-in one on the same signal, at a place of the same kind,
    /// such as `Some(&Flexible::Command)` for a static curve of a command.
    fn free_shape(&self) -> Option<&'static Flexible> {
        None
    }

    /// Returns the family to which it belongs: effects of one kind that records often cannot tell apart at one place,
    /// such as laws of dry friction. An answer states the probability of the family as well as that of the effect.
    fn family(&self) -> Option<&'static str> {
        None
    }

    /// Returns the effect whose law it refines with more parameters. It is then tried only in place of that effect
    /// once the search has found that one, or where the case suspects the finer law.
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

    /// Returns the values from the simulation or the records that its equation uses, as name, value and unit. They
    /// are written together with its parameters.
    fn given(&self, _setting: &Setting, _place: &Place) -> Vec<(&'static str, f64, &'static str)> {
        Vec::new()
    }

    /// Returns whether the parameters are in the range in which the name applies. A hysteresis that never yields is a
    /// gain, and a gap that never closes has no effect.
    fn sound(&self, _setting: &Setting, _place: &Place, _parameters: &[f64]) -> bool {
        true
    }

    /// Returns why another cause is possible although these parameters fit: they are at the limit of the range in
    /// which the name applies. The text is one clause for a report.
    fn caveat(&self, _parameters: &[f64]) -> Option<&'static str> {
        None
    }

    /// Returns its location after the fit, because a fitted frequency may be far from its start.
    fn fitted_place(&self, place: &Place, _parameters: &[f64]) -> Place {
        place.clone()
    }

    /// Returns the parameter of the simulation that it changes, if it does nothing else; `None` for an effect with an
    /// equation of its own.
    fn change(&self, _setting: &Setting, _place: &Place, _parameters: &[f64]) -> Option<Change> {
        None
    }

    /// Returns the relative standard deviation, according to the limits, of the simulation's own inertia, damping or
    /// stiffness at a port, because an error of that value acts like the effect. Zero for an effect that does not
    /// change such a value.
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
