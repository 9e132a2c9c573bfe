use crate::case::record::Channels;
use crate::plant::{Load, Plant};

/// The command on its way to the structure: m channels with `parts` values per sample, each of which is held over its
/// part of the sample.
#[derive(Debug, Clone, PartialEq)]
pub struct Drive {
    /// Number of values in a sample.
    pub parts: usize,
    /// Commands: m channels of samples x parts values.
    pub u: Channels,
    /// Sample rate in Hz.
    pub rate: f64,
    /// Time of the first sample in s.
    pub t0: f64,
}

impl Drive {
    /// Creates a command that is held over each sample.
    pub fn new(u: &[Vec<f64>], rate: f64, t0: f64) -> Self {
        Self { parts: 1, u: u.to_vec(), rate, t0 }
    }

    /// Repeats each value so that a sample has at least `parts` of them.
    pub fn refine(&mut self, parts: usize) {
        if self.parts >= parts {
            return;
        }
        let each = parts / self.parts;
        for channel in &mut self.u {
            let mut refined = Vec::with_capacity(each * channel.len());
            channel.iter().for_each(|&x| refined.extend(std::iter::repeat_n(x, each)));
            *channel = refined;
        }
        self.parts *= each;
    }

    /// Returns the length of a part in s.
    pub fn step(&self) -> f64 {
        1.0 / (self.rate * self.parts as f64)
    }
}

/// What an effect on commands or on measurements remembers of the earlier samples of a record. It is empty at the start
/// of the record.
#[derive(Debug, Clone, Default)]
pub struct Memory {
    values: Vec<f64>,
    /// Earlier values of each channel.
    past: Vec<Vec<f64>>,
}

impl Memory {
    /// Returns the remembered values. At the start of a record, they are `first`.
    pub fn values<const N: usize>(&mut self, first: [f64; N]) -> &mut [f64; N] {
        if self.values.is_empty() {
            self.values.extend(first);
        }
        self.values.first_chunk_mut().expect("an effect remembers the same number of values at each sample")
    }

    /// Appends the next values of a channel to its earlier ones, of which at least the last `reach` are kept.
    pub fn followed_by(&mut self, channel: usize, next: &[f64], reach: usize) -> Followed<'_> {
        if self.past.len() <= channel {
            self.past.resize(channel + 1, Vec::new());
        }
        let past = &mut self.past[channel];
        if past.len() > 2 * reach {
            past.drain(..past.len() - reach);
        }
        let start = past.len();
        past.extend_from_slice(next);
        Followed { values: past, start }
    }
}

/// The values of a signal, of which the present ones begin at an index.
pub struct Followed<'m> {
    values: &'m [f64],
    start: usize,
}

impl Followed<'_> {
    /// Returns the value that lies `back` steps before the present one of index `k`; `None` before the record. After
    /// the last value, it is held.
    pub fn back(&self, k: usize, back: isize) -> Option<f64> {
        let at = (self.start + k).checked_add_signed(-back)?;
        self.values.get(at).or(self.values.last()).copied()
    }

    /// Returns the values that lie `back` steps before the present ones, and the number of present values before which
    /// there is none.
    pub fn all_back(&self, back: usize) -> (&[f64], usize) {
        let before = back.saturating_sub(self.start);
        (&self.values[(self.start + before).saturating_sub(back)..], before)
    }
}

/// A change of the command. It is causal: no value depends on later ones.
pub trait Command: Send + Sync {
    /// Changes the command in place. The drive is a whole record in open loop, and one sample after the other in closed
    /// loop; `memory` keeps what the next sample needs.
    fn apply(&self, drive: &mut Drive, memory: &mut Memory);
}

/// A force inside the structure that depends on the displacement d and the velocity v of its port.
pub trait Force: Send + Sync {
    /// Returns the force; `state` is an internal state of [`Force::states`] numbers.
    fn force(&self, d: f64, v: f64, state: &[f64]) -> f64;

    /// Returns the force at the end of a step from one displacement and velocity to another. The force is assumed to
    /// change linearly over the step. A law that switches within the step returns the value that gives its mean force
    /// over the step.
    fn at_end(&self, _from: [f64; 2], [d, v]: [f64; 2], state: &[f64]) -> f64 {
        self.force(d, v, state)
    }

    /// Returns the length of the internal state, which is zero at rest. Most laws have none.
    fn states(&self) -> usize {
        0
    }

    /// Returns the stiffness and the damping coefficient of the steepest part of the law. They determine the number
    /// of steps of a run.
    fn steepest(&self) -> [f64; 2] {
        [0.0; 2]
    }

    /// Returns the largest force that holds the port where it is while its velocity is zero, as dry friction does;
    /// `None` for a force that depends on the motion alone.
    fn holds(&self) -> Option<f64> {
        None
    }

    /// Advances the internal state while the displacement changes from one value to another.
    fn advance(&self, _from: f64, _to: f64, _state: &mut [f64]) {}
}

/// The times of the samples of a run, and the state before the first one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sampling {
    /// Time of the first sample in s.
    pub t0: f64,
    /// Sample rate in Hz.
    pub rate: f64,
    /// Whether all signals were zero before the first sample. Otherwise the plant's history is not known.
    pub at_rest: bool,
}

impl Sampling {
    /// Returns the time of a sample in s.
    pub fn time(&self, sample: usize) -> f64 {
        self.t0 + sample as f64 / self.rate
    }

    /// Returns the value at which a sensor had settled before the first sample of this signal: zero at rest, or else
    /// that of the first sample, so that the record does not begin with a transient of the sensor.
    pub fn before(&self, y: &[f64]) -> f64 {
        if self.at_rest { 0.0 } else { y.first().copied().unwrap_or(0.0) }
    }
}

/// A change of the sensors' signals, after the filter and before noise. In closed loop, it is causal.
pub trait Sensor: Send + Sync {
    /// Changes the outputs (p channels) in place: those of a whole record, or of one sample after the other where a
    /// controller reads them. `memory` keeps what the next sample needs.
    fn apply(&self, y: &mut [Vec<f64>], sampling: Sampling, memory: &mut Memory);

    /// Returns whether the change also concerns what a controller reads, and not the records alone.
    fn reaches_controller(&self) -> bool {
        true
    }
}

/// The change of a simulation by an effect.
pub enum Action {
    /// Changes the command.
    Command(Box<dyn Command>),
    /// Changes the plant before a run.
    Plant(Box<dyn Fn(&mut Plant) + Send + Sync>),
    /// Adds a linear force at a port (its number). It acts after the changes by [`Action::Plant`], because it couples
    /// the modes.
    Load(usize, Load),
    /// Passes the force that accelerates a port (its number) through a lag with this pole in rad/s. It acts after all
    /// loads.
    Lag(usize, f64),
    /// Multiplies every mode's w^2 by a function of time. Modes that a load couples are not changed.
    Stiffness(Box<dyn Fn(f64) -> f64 + Send + Sync>),
    /// Applies a force at a port (its number) that depends on the structure's motion.
    Force(usize, Box<dyn Force>),
    /// Applies a force at a port (its number) that depends on time alone, held over a sample.
    Disturbance(usize, Box<dyn Fn(f64) -> f64 + Send + Sync>),
    /// Changes the outputs.
    Sensor(Box<dyn Sensor>),
    /// Gives a parameter of the engineer's own simulator (its number) another value.
    Parameter(usize, f64),
    /// Leaves free runs unchanged: more noise, or coarser values.
    Noise,
}

impl Action {
    /// Returns whether the action can be applied to a simulator of which only runs are available, because the action
    /// does not change the modes of the plant.
    pub fn suits_any_simulator(&self) -> bool {
        !matches!(self, Self::Plant(_) | Self::Stiffness(_) | Self::Lag(..))
    }

    /// Returns whether the action acts between a controller and its plant.
    pub fn is_between(&self) -> bool {
        match self {
            Self::Command(_) => true,
            Self::Sensor(sensor) => sensor.reaches_controller(),
            _ => false,
        }
    }

    /// Returns whether the action changes nothing before the sensors. In open loop, a run without it suffices.
    pub fn is_on_sensors(&self) -> bool {
        matches!(self, Self::Sensor(_) | Self::Noise)
    }
}
