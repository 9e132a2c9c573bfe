//! The course of the inputs between their samples.

use crate::case::record::Channels;

/// The intersample behaviour of the inputs.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Intersample {
    /// Zero-order hold: an input keeps its value until the next sample, as behind a converter.
    #[default]
    Zoh,
    /// First-order hold: an input varies linearly until its next sample, nearly as a measured input does.
    Foh,
}

impl Intersample {
    /// Returns whether inputs keep their values between the samples.
    #[allow(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
    pub fn is_zoh(&self) -> bool {
        *self == Self::Zoh
    }

    /// Returns the inputs (m channels) for a simulation with a zero-order hold: the mean of each input from each
    /// sample to the next. The last sample has no successor and is held.
    pub fn held(self, u: &[Vec<f64>]) -> Channels {
        match self {
            Self::Zoh => u.to_vec(),
            Self::Foh => u
                .iter()
                .map(|u| (0..u.len()).map(|k| f64::midpoint(u[k], u[(k + 1).min(u.len() - 1)])).collect())
                .collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A ramp drives an integrator to k^2 / 2, which its values at the samples alone miss by k / 2.
    #[test]
    fn the_mean_of_a_ramp_is_its_middle() {
        let u = vec![vec![0.0, 1.0, 2.0, 3.0]];
        assert_eq!(Intersample::Foh.held(&u), [[0.5, 1.5, 2.5, 3.0]]);
        assert_eq!(Intersample::Zoh.held(&u), u);
        assert!(Intersample::Foh.held(&[Vec::new()])[0].is_empty());
    }
}
