//! The covariance of the effects' parameters.

use nalgebra::DMatrix;
use plid_lsq::Normal;

use crate::fit::descent::Fit;
use crate::fit::jacobian::Jacobian;
use crate::fit::problem::{Placed, Problem};
use crate::fit::robust::widened;
use crate::fit::scale::Scale;
use crate::simulate::Fineness;

impl Problem {
    /// Returns the covariance under the noise model, in the parameters' own units. It is the effects' block of the
    /// inverse of the normal matrix.
    pub(super) fn model_covariance(&self, normal: &Normal, effects: &[Placed], scales: &[Scale]) -> DMatrix<f64> {
        match self.inverse(normal, effects, scales) {
            Some(inverse) => in_units(&inverse, effects, scales),
            None => DMatrix::from_diagonal_element(scales.len(), scales.len(), f64::INFINITY),
        }
    }

    /// Returns the covariance at a fit with these derivatives. It is as wide as the residuals indicate, but no
    /// narrower than under the noise model.
    pub(super) fn robust_covariance(&self, jacobian: &Jacobian, fit: &Fit, fineness: Fineness) -> DMatrix<f64> {
        let Fit { eta, effects, residual, .. } = fit;
        let plant = self.nuisance.apply(&self.plant, eta);
        let scales = self.scales(effects);
        let columns = self.effect_columns(&plant, eta, effects, residual, &scales, fineness);
        let mut normal = Normal::new(self.nuisance.len() + scales.len());
        self.assemble(jacobian, &columns, eta, &mut normal);
        let (Some(inverse), Some(linear)) = (self.inverse(&normal, effects, &scales), jacobian.columns()) else {
            return self.model_covariance(&normal, effects, &scales);
        };
        let prior: Vec<f64> = self.nuisance.std.iter().map(|std| std.powi(-2)).collect();
        let (own, most_leverage) = (columns.matrix().subcols(0, scales.len()), self.settings.fit.most_leverage);
        let by = widened(linear, own, &prior, residual, &inverse, most_leverage);
        let model = in_units(&inverse, effects, &scales);
        DMatrix::from_fn(by.len(), by.len(), |i, j| by[i] * by[j] * model[(i, j)])
    }

    /// Returns the inverse of a fit's normal matrix. Lengths that no data determine are constrained in it.
    fn inverse(&self, normal: &Normal, effects: &[Placed], scales: &[Scale]) -> Option<DMatrix<f64>> {
        let mut held = normal.matrix.clone();
        let first = held.nrows() - scales.len();
        for length in self.lengths(effects, scales) {
            for i in 0..scales.len() {
                (0..scales.len()).for_each(|j| held[(first + i, first + j)] += length[i] * length[j]);
            }
        }
        held.cholesky().map(|factor| factor.inverse())
    }
}

/// Converts the effects' block of a covariance from the fit's scales to the parameters' own units.
fn in_units(covariance: &DMatrix<f64>, effects: &[Placed], scales: &[Scale]) -> DMatrix<f64> {
    let first = covariance.nrows() - scales.len();
    let values = effects.iter().flat_map(|placed| placed.parameters.iter());
    let slope: Vec<f64> = scales.iter().zip(values).map(|(scale, value)| scale.slope(*value)).collect();
    DMatrix::from_fn(slope.len(), slope.len(), |i, j| covariance[(first + i, first + j)] * slope[i] * slope[j])
}
