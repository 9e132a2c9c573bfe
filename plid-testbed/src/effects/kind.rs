//! The description of an effect in addition to its law, from which cases with the effect are drawn and their answers
//! compared.

use std::ops::Range;

use rand::RngExt;
use rand_chacha::ChaCha12Rng;
use serde_json::{Map, Value, json};

use super::at::At;
use super::family::{Families, Shape};
use super::law::Law;
use super::own::{Level, OWN, Truth};
use crate::axes::Own;
use crate::plant::Truss;
use crate::structure::Mode;

/// A family of similar effects.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Family {
    /// Nonlinear forces inside the structure.
    NonlinearStructure,
    /// A mode, or a load that moves modes.
    LinearStructure,
    /// Nonlinear laws of an actuator.
    NonlinearActuator,
    /// Linear laws of an actuator.
    LinearActuator,
    /// Nonlinear laws of a sensor.
    NonlinearSensor,
    /// Linear laws of a sensor.
    LinearSensor,
    /// Signals that a sensor adds.
    AddedBySensor,
    /// Changes with time.
    Time,
    /// Forces that no command causes.
    Disturbance,
    /// Effects that are not in the vocabulary of a diagnosis.
    Outside(Half),
    /// Effects that the program has added.
    Added,
}

/// The half to which an effect outside the vocabulary belongs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Half {
    /// The half with which the diagnosis was developed.
    Development,
    /// The half for reported trials, with which nothing was developed.
    Reported,
}

impl Family {
    /// Returns its name.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::NonlinearStructure => "structure-nonlinear",
            Self::LinearStructure => "structure-linear",
            Self::NonlinearActuator => "actuator-nonlinear",
            Self::LinearActuator => "actuator-linear",
            Self::NonlinearSensor => "sensor-nonlinear",
            Self::LinearSensor => "sensor-linear",
            Self::AddedBySensor => "sensor-additive",
            Self::Time => "time",
            Self::Disturbance => "disturbance",
            Self::Outside(_) => "outside",
            Self::Added => "own",
        }
    }

    /// Returns whether its effects are those of the testbed, and not the program's own.
    #[must_use]
    pub const fn is_built_in(self) -> bool {
        !matches!(self, Self::Added)
    }
}

/// A property of a plant that an effect needs to make sense. For example, a motor has no spring to stiffen, and a
/// beam has no encoder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum On {
    /// Modes, accelerometers, and up to three channels. Loads, stops and friction that sticks are not considered
    /// there: the effect of a mass, a damper or a spring is contained in the frequencies and damping ratios of all
    /// modes, and nothing on a structure swings or runs against a stop.
    Structure,
    /// An axis, whose motion can be resisted.
    Axis,
    /// A position to which the axis returns or that it may not leave.
    Position,
    /// An elastic joint.
    Joint,
    /// An axis on which gravity exerts a torque.
    Swing,
    /// A command that becomes a force or a torque. With one input and one output, a gain, a lag or a delay of the
    /// sensor is equivalent to that of the actuator, and is not considered.
    Command,
    /// A gain of the command that is not equivalent to another parameter of the axis. Without a damper and a spring,
    /// a gain is equivalent to a mass.
    Gain,
    /// The reference of a controller.
    Reference,
    /// A sensor that no controller reads. The sample rates are so far above the motion that the loss of a few samples
    /// hardly causes a gap.
    Sensor,
    /// Several channels.
    Channels,
}

impl On {
    /// Every plant: each is a structure or has axes.
    pub(crate) const EVERY: &[Self] = &[Self::Structure, Self::Axis];
}

/// The description of an effect for the draw of cases.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Kind {
    /// Its name in configs, specs and labels; outsiders' begin with `x-`.
    pub name: &'static str,
    /// Its family of similar effects.
    pub family: Family,
    /// Its kind of place.
    pub at: At,
    /// The plants on which it makes sense: those that have at least one of these properties.
    pub on: &'static [On],
    /// The names of its parameters in the vocabulary's equation, in the order of a label. In a label, the index of
    /// the other channel of a pair follows the first parameter; this index has no name. The parameters of outsiders
    /// have no names, either.
    pub parameters: &'static [&'static str],
    /// Other laws of the same physics, which differ in shape from the vocabulary's own equation.
    pub near_misses: &'static [&'static str],
    /// The numbers of the shapes of these laws that are drawn from families.
    pub shapes: &'static [Shape],
    /// The least number of inputs of a case with it.
    pub least_inputs: usize,
    /// The least number of outputs of a case with it.
    pub least_outputs: usize,
    /// Whether it is one of the small imperfections that every structure has.
    pub imperfection: bool,
}

impl Kind {
    /// Returns whether it is an effect of the vocabulary, built in or added by the program.
    #[must_use]
    pub const fn is_in_vocabulary(&self) -> bool {
        !matches!(self.family, Family::Outside(_))
    }
}

/// The description of a built-in effect: the contents of its [`Kind`], and its initial parameters.
pub(crate) trait Described: Law {
    /// Its family.
    const FAMILY: Family;
    /// Its kind of place.
    const AT: At;
    /// The properties of which a plant must have at least one.
    const ON: &'static [On];
    /// The names of its parameters; none for an outsider. Unit tests compare their number with [`Law::parameters`].
    const PARAMETERS: &'static [&'static str] = &[];
    /// Its other laws, as a config's list names them.
    const NEAR_MISSES: &'static [&'static str] = &[];
    /// The numbers of the shapes of these laws, with the ranges from which they are drawn.
    const SHAPES: &'static [Shape] = &[];
    /// The least numbers of channels; two for a pair.
    const LEAST_INPUTS: usize = if matches!(Self::AT, At::InputPair) { 2 } else { 1 };
    const LEAST_OUTPUTS: usize = if matches!(Self::AT, At::OutputPair) { 2 } else { 1 };
    /// Whether it is one of the small imperfections that every structure has.
    const IMPERFECTION: bool = false;

    /// Returns the effect's keys in a config's list except `kind`, `at` and `law`. They contain parameters of an
    /// initial strength, which the draw of a case then changes with [`Law::strengthen`]. The order of the random
    /// numbers is part of the meaning of a seed.
    fn start(draw: &mut Draw<'_>) -> Value;
}

/// The case for which an effect is drawn.
pub(crate) struct Draw<'a> {
    /// The plant without effects.
    pub truss: &'a Truss,
    /// Modes at which modal effects are drawn, from 0.
    pub dominant: Range<usize>,
    /// The mode that the plant has and `truss` lacks, if an effect of the case needs one.
    pub left_out: Option<&'a Mode>,
    /// The channel of the effect's place, from 0; the first if it has none.
    pub channel: usize,
    /// The RMS values at this channel without effects.
    pub level: Level,
    /// A sign drawn at random.
    pub sign: f64,
    /// The set from which shapes are drawn.
    pub families: Families,
    /// Further random numbers.
    pub rng: &'a mut ChaCha12Rng,
}

impl Draw<'_> {
    /// Draws a number uniformly.
    pub(crate) fn within(&mut self, range: Range<f64>) -> f64 {
        self.rng.random_range(range)
    }

    /// Returns the inertia, damping and stiffness of the axis of the channel.
    pub(crate) fn axis(&self) -> Own {
        self.truss.axes.as_ref().expect("it makes sense only on axes").own(self.channel)
    }
}

/// An effect of the table: its description, and the source of its initial parameters.
#[derive(Clone, Copy)]
pub(crate) struct Entry {
    pub kind: Kind,
    start: Start,
}

#[derive(Clone, Copy)]
enum Start {
    BuiltIn(fn(&mut Draw<'_>) -> Value),
    Added(&'static dyn Truth),
}

impl Entry {
    /// Creates the entry of a built-in effect from the description in its own file.
    pub(crate) const fn built_in<E: Described>(name: &'static str) -> Self {
        let kind = Kind {
            name,
            family: E::FAMILY,
            at: E::AT,
            on: E::ON,
            parameters: E::PARAMETERS,
            near_misses: E::NEAR_MISSES,
            shapes: E::SHAPES,
            least_inputs: E::LEAST_INPUTS,
            least_outputs: E::LEAST_OUTPUTS,
            imperfection: E::IMPERFECTION,
        };
        Self { kind, start: Start::BuiltIn(E::start) }
    }

    /// Creates the entry of an effect that the program has added. Such an effect makes sense on every plant.
    pub(crate) fn added(truth: &'static dyn Truth) -> Self {
        let kind = Kind {
            name: truth.name(),
            family: Family::Added,
            at: truth.side().at(),
            on: On::EVERY,
            parameters: truth.parameters(),
            near_misses: truth.near_misses(),
            shapes: &[],
            least_inputs: 1,
            least_outputs: 1,
            imperfection: false,
        };
        Self { kind, start: Start::Added(truth) }
    }

    /// Returns the effect's keys in a config's list except `at` and `law`.
    pub(crate) fn start(&self, draw: &mut Draw<'_>) -> Map<String, Value> {
        let (tag, keys) = match self.start {
            Start::BuiltIn(start) => (self.kind.name, start(draw)),
            Start::Added(truth) => (OWN, json!({ "name": truth.name(), "parameters": truth.start(&draw.level) })),
        };
        let Value::Object(mut keys) = keys else { unreachable!("`{tag}` starts as an object of keys") };
        keys.insert("kind".to_owned(), tag.into());
        keys
    }
}
