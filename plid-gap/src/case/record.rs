//! Measured records.

pub use plid_model::signal::rms;

/// Channels, each with the values of all samples.
pub type Channels = Vec<Vec<f64>>;

/// The excitation of a record.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Excitation {
    /// No input.
    Zero,
    /// A signal that does not repeat.
    Random,
    /// A signal that repeats after this number of samples.
    Periodic(usize),
}

/// A record of a case.
#[derive(Debug, Clone, PartialEq)]
pub struct Record {
    /// Name of the file.
    pub name: String,
    /// The excitation.
    pub excitation: Excitation,
    /// Whether all states are zero at its start; otherwise the initial state is fitted.
    pub from_rest: bool,
    /// Start in s since the first record began.
    pub start_s: f64,
    /// Whether the record is held out from all fits.
    pub held_out: bool,
    /// Inputs (m channels).
    pub u: Channels,
    /// Measured outputs (p channels).
    pub y: Channels,
    /// Outputs of the engineer's own simulator (p channels), if they are given.
    pub simulated: Option<Channels>,
}

impl Record {
    /// Returns the number of samples.
    pub fn samples(&self) -> usize {
        self.y.first().map_or(0, Vec::len)
    }

    /// Returns a range of the samples as a separate record. The new record begins in motion, unless it begins with
    /// this record and this record begins at rest.
    pub fn part(&self, samples: std::ops::Range<usize>, rate: f64) -> Self {
        let cut = |channels: &Channels| channels.iter().map(|x| x[samples.clone()].to_vec()).collect();
        Self {
            u: cut(&self.u),
            y: cut(&self.y),
            simulated: None,
            from_rest: self.from_rest && samples.start == 0,
            start_s: self.start_s + samples.start as f64 / rate,
            ..self.clone()
        }
    }

    /// Returns the number of samples in which an output was measured. The end of a record that is held out has no
    /// outputs before it begins.
    pub fn measured(&self) -> usize {
        (0..self.samples()).filter(|&k| self.y.iter().any(|y| y[k].is_finite())).count()
    }

    /// Returns the RMS over all inputs.
    pub fn level(&self) -> f64 {
        rms(self.u.iter().flatten())
    }

    /// Returns whether an input drives the record. The inputs of a record without excitation may still have been
    /// measured, with noise.
    pub fn is_driven(&self) -> bool {
        self.excitation != Excitation::Zero && self.level() > 0.0
    }

    /// Returns measured minus simulated outputs (p channels); zero where a sample is missing.
    pub fn error(&self, simulated: &[Vec<f64>]) -> Channels {
        self.error_or(0.0, simulated)
    }

    /// Returns measured minus simulated outputs (p channels); NaN where a sample is missing.
    pub(crate) fn error_where_measured(&self, simulated: &[Vec<f64>]) -> Channels {
        self.error_or(f64::NAN, simulated)
    }

    /// Returns measured minus simulated outputs (p channels), with this value where a sample is missing.
    fn error_or(&self, missing: f64, simulated: &[Vec<f64>]) -> Channels {
        let one = |(y, s): (&Vec<f64>, &Vec<f64>)| {
            y.iter().zip(s).map(|(y, s)| if y.is_finite() { y - s } else { missing }).collect()
        };
        self.y.iter().zip(simulated).map(one).collect()
    }

    /// Returns measured minus simulated values of one output, without the samples that are missing.
    pub(crate) fn measured_error<'r>(&'r self, output: usize, simulated: &'r [f64]) -> impl Iterator<Item = f64> + 'r {
        self.y[output].iter().zip(simulated).filter(|(y, _)| y.is_finite()).map(|(y, s)| y - s)
    }
}
