//! The limits of the simulation's errors.

/// Limits of the simulation's relative errors, as two standard deviations.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Limits {
    /// Limit of each mode's frequency.
    pub frequency: f64,
    /// Limit of each mode's damping ratio.
    pub damping: f64,
    /// Limit of each entry of a mode's shapes, relative to the shape's largest entry.
    pub shape: f64,
}

/// The limit that applies to a parameter of the simulation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Limit {
    /// That of frequencies.
    Frequency,
    /// That of damping ratios.
    Damping,
    /// That of shapes.
    Shape,
}

impl Limits {
    /// Returns the standard deviation that a limit stands for.
    pub(crate) fn std(&self, of: Limit) -> f64 {
        match of {
            Limit::Frequency => self.frequency / 2.0,
            Limit::Damping => self.damping / 2.0,
            Limit::Shape => self.shape / 2.0,
        }
    }
}

impl Default for Limits {
    fn default() -> Self {
        Self { frequency: 0.002, damping: 0.10, shape: 0.02 }
    }
}
