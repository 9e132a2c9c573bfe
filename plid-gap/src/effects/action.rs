use crate::case::record::Channels;
use crate::plant::Plant;

/// The command on its way to the structure: m channels, each with `parts` values a sample (held over that part of the sample).
#[derive(Debug, Clone, PartialEq)]
pub struct Drive {
    /// Values a sample.
    pub parts: usize,
    /// m channels of samples x parts values.
    pub u: Channels,
    /// Samples a second.
    pub rate: f64,
    /// Time of the first sample.
    pub t0: f64,
}

impl Drive {
    /// A held command.
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
            *channel = channel.iter().flat_map(|&x| std::iter::repeat_n(x, each)).collect();
        }
        self.parts *= each;
    }

    /// Length of a part in s.
    pub fn step(&self) -> f64 {
        1.0 / (self.rate * self.parts as f64)
    }
}

/// Changes the command.
pub trait Command: Send + Sync {
    /// In place, from the start of a record.
    fn apply(&self, drive: &mut Drive);
}

/// A force inside the structure, of the displacement d and the velocity v that its port sees.
pub trait Force: Send + Sync {
    /// The force with an internal state (zero at rest; unused by most).
    fn force(&self, d: f64, v: f64, state: f64) -> f64;

    /// The internal state after the displacement has gone from one value to another.
    fn advance(&self, _from: f64, _to: f64, state: f64) -> f64 {
        state
    }
}

/// Changes what a sensor gives, after the filter and before noise.
pub trait Sensor: Send + Sync {
    /// In place, p channels from time `t0`.
    fn apply(&self, y: &mut [Vec<f64>], t0: f64, rate: f64);
}

/// What an effect does to a simulation.
pub enum Action {
    /// Changes the command.
    Command(Box<dyn Command>),
    /// Changes the plant before a run.
    Plant(Box<dyn Fn(&mut Plant) + Send + Sync>),
    /// Multiplies every mode's w^2 by a function of the time.
    Stiffness(Box<dyn Fn(f64) -> f64 + Send + Sync>),
    /// A force at a port (its number) that depends on the structure's motion.
    Force(usize, Box<dyn Force>),
    /// A force at a port (its number) that depends on the time alone, held over a sample.
    Disturbance(usize, Box<dyn Fn(f64) -> f64 + Send + Sync>),
    /// Changes the outputs.
    Sensor(Box<dyn Sensor>),
    /// Nothing that a free run shows: more noise, coarser values.
    Noise,
}
