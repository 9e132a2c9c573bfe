//! What was measured, as the diagnosis uses it.

pub use plid_model::signal::rms;

/// One channel after the other, each over all samples.
pub type Channels = Vec<Vec<f64>>;

/// What drove a record.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Excitation {
    /// Nothing.
    Zero,
    /// A signal that does not repeat.
    Random,
    /// A signal that repeats after so many samples.
    Periodic(usize),
}

/// A record of a case.
#[derive(Debug, Clone, PartialEq)]
pub struct Record {
    /// The file's name.
    pub name: String,
    /// What drove it.
    pub excitation: Excitation,
    /// Whether all states are zero at its start; otherwise the initial state is fitted.
    pub from_rest: bool,
    /// Since the first record began, in s.
    pub start_s: f64,
    /// Held out from all fitting.
    pub held_out: bool,
    /// m channels.
    pub u: Channels,
    /// p channels.
    pub y: Channels,
    /// p channels of the engineer's own simulator, if given.
    pub simulated: Option<Channels>,
}

impl Record {
    /// Number of samples.
    pub fn samples(&self) -> usize {
        self.y.first().map_or(0, Vec::len)
    }

    /// RMS over all inputs.
    pub fn level(&self) -> f64 {
        rms(self.u.iter().flatten())
    }

    /// Measured minus simulated (p channels); zero where nothing was measured.
    pub fn error(&self, simulated: &[Vec<f64>]) -> Channels {
        let one = |(y, s): (&Vec<f64>, &Vec<f64>)| {
            y.iter().zip(s).map(|(y, s)| if y.is_finite() { y - s } else { 0.0 }).collect()
        };
        self.y.iter().zip(simulated).map(one).collect()
    }
}
