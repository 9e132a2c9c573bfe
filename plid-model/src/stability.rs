use nalgebra::Complex;

use super::eigen::eigenvalues;
use super::error::ModelError;
use super::state_space::Model;

/// The location of a model's poles relative to the unit circle.
#[derive(Debug, Clone, PartialEq)]
pub struct Stability {
    /// Largest magnitude of an eigenvalue of A.
    pub spectral_radius: f64,
    /// Eigenvalues on or outside the unit circle, in order of decreasing magnitude.
    pub unstable: Vec<Complex<f64>>,
    /// The natural frequencies of these eigenvalues in Hz.
    pub unstable_hz: Vec<f64>,
}

/// The warning that a model is unstable: its simulation grows without bound.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[cfg_attr(feature = "diagnostics", derive(miette::Diagnostic))]
#[error(
    "the model is unstable: {count} of its poles are on or outside the unit circle (largest magnitude {radius:.6}, \
         near {hz:.3} Hz)"
)]
#[cfg_attr(feature = "diagnostics", diagnostic(severity(Warning)))]
pub struct UnstableModel {
    /// Number of poles on or outside the unit circle.
    pub count: usize,
    /// The largest magnitude of a pole.
    pub radius: f64,
    /// Natural frequency of that pole in Hz.
    pub hz: f64,
}

impl Stability {
    /// Returns the warning if the model is unstable.
    pub fn warning(&self) -> Option<UnstableModel> {
        let hz = *self.unstable_hz.first()?;
        Some(UnstableModel { count: self.unstable.len(), radius: self.spectral_radius, hz })
    }
}

/// Computes the spectral radius and the unstable poles.
///
/// # Errors
/// Returns [`ModelError::Eigenvalues`] if the eigenvalue iteration does not converge.
pub fn stability(model: &Model) -> Result<Stability, ModelError> {
    let mut poles = eigenvalues(&model.a)?;
    poles.sort_by(|x, y| y.norm().total_cmp(&x.norm()));
    let spectral_radius = poles.first().map_or(0.0, |z| z.norm());
    let unstable: Vec<_> = poles.into_iter().filter(|z| z.norm() >= 1.0).collect();
    let natural = |z: &Complex<f64>| z.ln().norm() * model.sample_rate_hz / std::f64::consts::TAU;
    let unstable_hz = unstable.iter().map(natural).collect();
    Ok(Stability { spectral_radius, unstable, unstable_hz })
}

#[cfg(test)]
mod tests {
    use super::super::testing::{pole, two_modes};
    use super::*;
    use approx::assert_relative_eq;

    #[test]
    fn radius_and_warning() {
        let mut model = two_modes();
        let found = stability(&model).unwrap();
        let radius = pole(12.0, 0.01, 100.0).0.max(pole(31.0, 0.004, 100.0).0);
        assert_relative_eq!(found.spectral_radius, radius, max_relative = 1e-12);
        assert!(found.unstable.is_empty() && found.warning().is_none());
        let growth = 1.0 + 1e-6;
        model.a.view_mut((0, 0), (2, 2)).scale_mut(growth / pole(12.0, 0.01, 100.0).0);
        let warning = stability(&model).unwrap().warning().unwrap();
        assert_eq!(warning.count, 2);
        assert_relative_eq!(warning.radius, growth, max_relative = 1e-12);
        assert_relative_eq!(warning.hz, 12.0, max_relative = 1e-3);
    }
}
