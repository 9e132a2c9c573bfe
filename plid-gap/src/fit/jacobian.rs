//! Derivatives of the whitened outputs, and the normal equations.

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};
use nalgebra::{DMatrix, DVector};
use plid_lsq::Normal;
use rayon::prelude::*;

use crate::fit::descent::{Fit, Point};
use crate::fit::problem::{Placed, Problem};
use crate::fit::scale::{Scale, stepped};
use crate::plant::{Plant, Spectrum};
use crate::simulate::Fineness;

/// Derivatives of the whitened outputs (rows x linear parameters) at one linear model, with their normal matrix.
#[derive(Clone)]
pub struct Jacobian {
    rows: usize,
    columns: usize,
    values: Vec<f64>,
    /// The normal matrix J'J + 1/std^2.
    pub normal: DMatrix<f64>,
}

impl Jacobian {
    /// Creates the Jacobian from its columns; the parameters have a prior of these standard deviations.
    pub fn new(values: Vec<f64>, rows: usize, std: &[f64]) -> Self {
        let columns = std.len();
        let mut jacobian = Self { rows, columns, values, normal: DMatrix::zeros(columns, columns) };
        jacobian.normal = jacobian.cross(&jacobian.values, columns);
        for (j, std) in std.iter().enumerate() {
            jacobian.normal[(j, j)] += 1.0 / (std * std);
        }
        jacobian
    }

    /// The derivatives as a matrix.
    pub(super) fn matrix(&self) -> MatRef<'_, f64> {
        MatRef::from_column_major_slice(&self.values, self.rows, self.columns)
    }

    /// Returns J' V for V of `count` columns.
    pub fn cross(&self, v: &[f64], count: usize) -> DMatrix<f64> {
        product(self.matrix(), MatRef::from_column_major_slice(v, self.rows, count))
    }
}

/// Returns A'B.
fn product(a: MatRef<'_, f64>, b: MatRef<'_, f64>) -> DMatrix<f64> {
    let mut product = DMatrix::zeros(a.ncols(), b.ncols());
    if !product.is_empty() {
        let to = MatMut::from_column_major_slice_mut(product.as_mut_slice(), a.ncols(), b.ncols());
        matmul(to, Accum::Replace, a.transpose(), b, 1.0, Par::Seq);
    }
    product
}

/// Derivatives of the whitened outputs by the effects' parameters, each in its scale.
pub(super) struct EffectColumns {
    rows: usize,
    values: Vec<f64>,
}

impl EffectColumns {
    pub(super) fn matrix(&self) -> MatRef<'_, f64> {
        MatRef::from_column_major_slice(&self.values, self.rows, self.values.len() / self.rows)
    }
}

impl Problem {
    /// Computes the derivatives by the linear parameters at a linear model.
    pub fn jacobian(&self, plant: &Plant) -> Jacobian {
        let (rows, columns) = (self.rows(), self.nuisance.len());
        let mut values = vec![0.0; rows * columns];
        let spectrum = Spectrum::of(plant);
        let blocks: Vec<Vec<(usize, Vec<f64>)>> = (0..self.records.len())
            .into_par_iter()
            .map(|index| {
                let mut found = Vec::new();
                self.nuisance.derivatives(plant, spectrum.as_ref(), &self.records[index], index, |column, outputs| {
                    let mut white = vec![0.0; self.whiteners[index].rows()];
                    self.whiteners[index].apply(outputs, &mut white);
                    found.push((column, white));
                });
                found
            })
            .collect();
        for (index, found) in blocks.into_iter().enumerate() {
            let range = self.rows_of(index);
            for (column, white) in found {
                values[column * rows + range.start..column * rows + range.end].copy_from_slice(&white);
            }
        }
        Jacobian::new(values, rows, &self.nuisance.std)
    }

    /// Computes the derivatives by the linear parameters of the simulation with a fit's effects, as differences of
    /// simulations. For an initial state, only its own record is simulated.
    pub(super) fn jacobian_with_effects(&self, at: &Point, fineness: Fineness) -> Jacobian {
        // Step in standard deviations of the prior. The sum of squares is close to quadratic within a hundredth of one.
        const STEP: f64 = 1e-2;
        // A wide prior says nothing about that; the parameters are relative changes.
        const MOST: f64 = 1e-3;
        let (rows, actions) = (self.rows(), self.actions(&at.effects));
        let mut values = vec![0.0; rows * self.nuisance.len()];
        values.par_chunks_mut(rows).enumerate().for_each(|(k, column)| {
            let step = (STEP * self.nuisance.std[k]).min(MOST);
            let mut eta = at.eta.clone();
            eta[k] += step;
            let mut put = |range: std::ops::Range<usize>, moved: &[f64]| {
                let before = &at.residual[range.clone()];
                column[range].iter_mut().zip(moved).zip(before).for_each(|((to, m), r)| *to = (r - m) / step);
            };
            match self.nuisance.record_of(k) {
                Some(record) => {
                    put(self.rows_of(record), &self.residual_of(record, &at.plant, &eta, &actions, fineness))
                }
                None if k < self.nuisance.of_simulation() => {
                    let plant = self.nuisance.apply(&self.plant, &eta);
                    put(0..rows, &self.residual(&plant, &eta, &at.effects, fineness));
                }
                // The initial state of a record that is not fitted.
                None => {}
            }
        });
        Jacobian::new(values, rows, &self.nuisance.std)
    }

    /// Computes the derivatives by each effect parameter, as differences of simulations.
    pub(super) fn effect_columns(
        &self,
        plant: &Plant,
        eta: &[f64],
        effects: &[Placed],
        residual: &[f64],
        scales: &[Scale],
        fineness: Fineness,
    ) -> EffectColumns {
        const STEP: f64 = 1e-3;
        let mut values = Vec::with_capacity(residual.len() * scales.len());
        for j in 0..scales.len() {
            let mut step = vec![0.0; scales.len()];
            step[j] = STEP;
            let moved = self.residual(plant, eta, &stepped(effects, &step, scales), fineness);
            values.extend(residual.iter().zip(&moved).map(|(r, m)| (r - m) / STEP));
        }
        EffectColumns { rows: residual.len(), values }
    }

    /// Fills the normal equations of the linear parameters and the effects' parameters, with the prior.
    pub(super) fn assemble(
        &self,
        jacobian: &Jacobian,
        effects: &EffectColumns,
        residual: &[f64],
        eta: &[f64],
        to: &mut Normal,
    ) {
        let (linear, effects) = (jacobian.matrix(), effects.matrix());
        let (n, k) = (linear.ncols(), effects.ncols());
        let residual = MatRef::from_column_major_slice(residual, residual.len(), 1);
        let across = product(linear, effects);
        to.matrix.view_mut((0, 0), (n, n)).copy_from(&jacobian.normal);
        to.matrix.view_mut((0, n), (n, k)).copy_from(&across);
        to.matrix.view_mut((n, 0), (k, n)).copy_from(&across.transpose());
        to.matrix.view_mut((n, n), (k, k)).copy_from(&product(effects, effects));
        to.right.rows_mut(0, n).copy_from(&product(linear, residual));
        to.right.rows_mut(n, k).copy_from(&product(effects, residual));
        for (i, std) in self.nuisance.std.iter().enumerate() {
            to.right[i] -= eta[i] / std.powi(2);
        }
    }

    /// Returns the direction of a refit from a residual: J' r less the gradient of the prior.
    pub fn gradient(&self, jacobian: &Jacobian, residual: &[f64], eta: &[f64]) -> DMatrix<f64> {
        let mut gradient = jacobian.cross(residual, 1);
        for ((g, x), std) in gradient.iter_mut().zip(eta).zip(&self.nuisance.std) {
            *g -= x / (std * std);
        }
        gradient
    }

    /// Returns the information of the records on a fit's linear parameters and effect parameters (each in the fit's own
    /// scale): the normal matrix with the prior, and J' residual without it.
    pub fn information(&self, fit: &Fit, residual: &[f64]) -> (DMatrix<f64>, DVector<f64>) {
        let plant = self.nuisance.apply(&self.plant, &fit.eta);
        let jacobian = self.jacobian(&self.changed(&plant, &fit.effects).unwrap_or_else(|| plant.clone()));
        let scales = self.scales(&fit.effects);
        let effects = self.effect_columns(&plant, &fit.eta, &fit.effects, residual, &scales, Fineness::COARSE);
        let mut normal = Normal::new(self.nuisance.len() + scales.len());
        self.assemble(&jacobian, &effects, residual, &vec![0.0; self.nuisance.len()], &mut normal);
        (normal.matrix, normal.right)
    }
}
