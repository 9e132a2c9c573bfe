//! Derivatives of the whitened outputs, and the normal equations.

use std::sync::Arc;

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};
use nalgebra::{DMatrix, DVector};
use plid_lsq::Normal;
use rayon::prelude::*;

use crate::case::record::Channels;
use crate::fit::derivatives::Derivatives;
use crate::fit::descent::{Fit, Point};
use crate::fit::problem::{Placed, Problem};
use crate::fit::scale::{Scale, stepped};
use crate::fit::single::Single;
use crate::plant::{Plant, Spectrum};
use crate::simulate::Fineness;

/// Derivatives of the whitened outputs (rows x linear parameters) at one linear model, with their normal matrix.
#[derive(Clone)]
pub struct Jacobian {
    /// The normal matrix J'J + 1/std^2.
    pub normal: DMatrix<f64>,
    kept: Kept,
}

/// The part of the derivatives that is kept for further products.
#[derive(Clone)]
enum Kept {
    /// All of them.
    Values(Single),
    /// Those of each record before whitening. Hundreds of whitened derivatives take many times the memory of the
    /// records.
    Signals(Vec<Arc<OfRecord>>),
}

/// The derivatives of the outputs of one record before whitening.
pub struct OfRecord {
    derivatives: Derivatives,
    /// The products of the whitened derivatives, without the prior.
    products: DMatrix<f64>,
}

impl Jacobian {
    /// Creates the Jacobian from its columns; the parameters have a prior of these standard deviations.
    fn new(columns: Single, std: &[f64]) -> Self {
        let mut normal = columns.square();
        add_prior(&mut normal, std);
        Self { normal, kept: Kept::Values(columns) }
    }

    /// Creates the Jacobian from the derivatives of each record; the parameters have a prior of these standard
    /// deviations.
    pub fn of_records(records: Vec<Arc<OfRecord>>, std: &[f64]) -> Self {
        let mut normal = DMatrix::zeros(std.len(), std.len());
        add_prior(&mut normal, std);
        for OfRecord { derivatives, products } in records.iter().map(Arc::as_ref) {
            for (i, row) in derivatives.columns.iter().enumerate() {
                for (j, column) in derivatives.columns.iter().enumerate() {
                    normal[(row.parameter, column.parameter)] += products[(i, j)];
                }
            }
        }
        Self { normal, kept: Kept::Signals(records) }
    }

    /// Returns the derivatives themselves, if they are kept as values.
    pub(super) fn columns(&self) -> Option<&Single> {
        match &self.kept {
            Kept::Values(columns) => Some(columns),
            Kept::Signals(_) => None,
        }
    }

    /// Returns J' V for V of several columns, whose rows are those of the problem.
    pub(super) fn cross(&self, problem: &Problem, v: MatRef<'_, f64>) -> DMatrix<f64> {
        let of_records = match &self.kept {
            Kept::Values(columns) => return columns.product(v),
            Kept::Signals(of_records) => of_records,
        };
        let mut products = DMatrix::zeros(problem.nuisance.len(), v.ncols());
        for (index, of_record) in of_records.iter().enumerate() {
            let channels = |j: usize| {
                let white = v.col(j).try_as_col_major().expect("columns are contiguous").as_slice();
                problem.whiteners[index].adjoint(&white[problem.rows_of(index)])
            };
            let all: Vec<Channels> = (0..v.ncols()).into_par_iter().map(channels).collect();
            of_record.derivatives.add_products(&problem.records[index].u, &all, &mut products);
        }
        products
    }
}

fn add_prior(normal: &mut DMatrix<f64>, std: &[f64]) {
    for (j, std) in std.iter().enumerate() {
        normal[(j, j)] += 1.0 / (std * std);
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

/// Columns with the same rows as a whitened residual.
#[derive(Clone)]
pub(super) struct Columns {
    rows: usize,
    values: Vec<f64>,
}

impl Columns {
    pub(super) fn matrix(&self) -> MatRef<'_, f64> {
        MatRef::from_column_major_slice(&self.values, self.rows, self.values.len() / self.rows)
    }

    /// Replaces the residual.
    pub(super) fn set_residual(&mut self, residual: &[f64]) {
        let start = self.values.len() - self.rows;
        self.values[start..].copy_from_slice(residual);
    }
}

impl Problem {
    /// Computes the derivatives with respect to the linear parameters at a linear model.
    pub fn jacobian(&self, plant: &Plant) -> Jacobian {
        Jacobian::of_records(self.derivatives(plant), &self.nuisance.std)
    }

    /// Computes the derivatives of each record.
    pub fn derivatives(&self, plant: &Plant) -> Vec<Arc<OfRecord>> {
        let spectrum = Spectrum::of(plant);
        (0..self.records.len()).map(|index| self.derivatives_of(index, plant, spectrum.as_ref())).collect()
    }

    /// Computes the derivatives of one record. `spectrum` is that of the plant.
    pub fn derivatives_of(&self, index: usize, plant: &Plant, spectrum: Option<&Spectrum>) -> Arc<OfRecord> {
        let derivatives = self.nuisance.derivatives(plant, spectrum, &self.records[index], index);
        let products = self.whitened_products(index, &derivatives);
        Arc::new(OfRecord { derivatives, products })
    }

    /// Returns the products of the whitened derivatives of one record.
    fn whitened_products(&self, index: usize, derivatives: &Derivatives) -> DMatrix<f64> {
        let (whitener, record) = (&self.whiteners[index], &self.records[index]);
        let rows = whitener.rows();
        let mut values = vec![0.0; rows * derivatives.columns.len()];
        let mut left = values.as_mut_slice();
        let mut groups = Vec::new();
        for group in derivatives.groups() {
            let (of_group, others) = left.split_at_mut(rows * group.len());
            groups.push((group, of_group));
            left = others;
        }
        let outputs = || vec![vec![0.0; record.samples()]; self.plant.p];
        groups.into_par_iter().for_each_init(outputs, |y, (group, values)| {
            let mut columns = values.chunks_mut(rows.max(1));
            derivatives.write(group, &record.u, y, |_, y| {
                if let Some(white) = columns.next() {
                    whitener.apply(y, white);
                }
            });
        });
        let columns = Columns { rows, values };
        product(columns.matrix(), columns.matrix())
    }

    /// Computes the derivatives of the simulation with a fit's effects, with respect to the linear parameters, as
    /// differences of simulations. For an initial state, only its own record is simulated.
    pub(super) fn jacobian_with_effects(&self, at: &Point, fineness: Fineness) -> Jacobian {
        // Step in standard deviations of the prior. The sum of squares is close to quadratic within a hundredth of one.
        const STEP: f64 = 1e-2;
        // A wide prior does not limit the step. The parameters are relative changes.
        const MOST: f64 = 1e-3;
        let (rows, actions) = (self.rows(), self.actions(&at.effects));
        let columns = Single::filled(rows, self.nuisance.len(), |k, column| {
            let step = (STEP * self.nuisance.std[k]).min(MOST);
            let mut eta = at.eta.clone();
            eta[k] += step;
            let mut put = |range: std::ops::Range<usize>, moved: &[f64]| {
                let before = &at.residual[range.clone()];
                column[range].iter_mut().zip(moved).zip(before).for_each(|((to, m), r)| *to = ((r - m) / step) as f32);
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
        Jacobian::new(columns, &self.nuisance.std)
    }

    /// Computes the derivatives with respect to each effect parameter, as differences of simulations. The residual is
    /// the last column. Parameters of effects on the sensors share one run.
    pub(super) fn effect_columns(
        &self,
        plant: &Plant,
        eta: &[f64],
        effects: &[Placed],
        residual: &[f64],
        scales: &[Scale],
        fineness: Fineness,
    ) -> Columns {
        const STEP: f64 = 1e-3;
        let moved = |j: usize| {
            let mut step = vec![0.0; scales.len()];
            step[j] = STEP;
            self.actions(&stepped(effects, &step, scales))
        };
        let on_sensors = |placed: &Placed| self.are_on_sensors(&self.actions(std::slice::from_ref(placed)));
        let shared: Vec<bool> = (effects.iter())
            .flat_map(|placed| std::iter::repeat_n(on_sensors(placed), placed.parameters.len()))
            .collect();
        let own: Vec<_> = (0..scales.len()).filter(|&j| !shared[j]).map(moved).collect();
        let mut own = self.residuals(plant, eta, &own, fineness).into_iter();
        let run = || self.before_sensors(plant, eta, &[self.actions(effects)], fineness);
        let run = if shared.contains(&true) { run() } else { Vec::new() };
        let mut values = Vec::with_capacity(residual.len() * (scales.len() + 1));
        for (j, shared) in shared.iter().enumerate() {
            let run = || self.residual_from(run.iter().cloned(), &moved(j));
            let moved = if *shared { run() } else { own.next().expect("one for each parameter that takes a run") };
            values.extend(residual.iter().zip(&moved).map(|(r, m)| (r - m) / STEP));
        }
        values.extend_from_slice(residual);
        Columns { rows: residual.len(), values }
    }

    /// Fills the normal equations of the linear parameters and the effects' parameters, with the prior. The last
    /// column is the residual; the other columns are the derivatives with respect to the effects' parameters.
    pub(super) fn assemble(&self, jacobian: &Jacobian, columns: &Columns, eta: &[f64], to: &mut Normal) {
        let (all, n) = (columns.matrix(), self.nuisance.len());
        let k = all.ncols() - 1;
        let across = jacobian.cross(self, all);
        let own = product(all.subcols(0, k), all);
        to.matrix.view_mut((0, 0), (n, n)).copy_from(&jacobian.normal);
        to.matrix.view_mut((0, n), (n, k)).copy_from(&across.columns(0, k));
        to.matrix.view_mut((n, 0), (k, n)).copy_from(&across.columns(0, k).transpose());
        to.matrix.view_mut((n, n), (k, k)).copy_from(&own.columns(0, k));
        self.set_right(&across.column(k).into_owned(), &own.column(k).into_owned(), eta, to);
    }

    /// Renews the right-hand side of the normal equations, for a new residual and the same derivatives.
    pub(super) fn assemble_right(&self, jacobian: &Jacobian, columns: &Columns, eta: &[f64], to: &mut Normal) {
        let all = columns.matrix();
        let k = all.ncols() - 1;
        let (across, own) = (jacobian.cross(self, all.subcols(k, 1)), product(all.subcols(0, k), all.subcols(k, 1)));
        self.set_right(&across.column(0).into_owned(), &own.column(0).into_owned(), eta, to);
    }

    /// Sets the right-hand side from the products of the residual with the derivatives, and the prior.
    fn set_right(&self, across: &DVector<f64>, own: &DVector<f64>, eta: &[f64], to: &mut Normal) {
        let n = across.len();
        to.right.rows_mut(0, n).copy_from(across);
        to.right.rows_mut(n, own.len()).copy_from(own);
        for (i, std) in self.nuisance.std.iter().enumerate() {
            to.right[i] -= eta[i] / std.powi(2);
        }
    }

    /// Returns the descent direction of a refit from a residual: J' r less the gradient of the prior.
    pub fn gradient(&self, jacobian: &Jacobian, residual: &[f64], eta: &[f64]) -> DMatrix<f64> {
        let mut gradient = self.cross(jacobian, residual);
        for ((g, x), std) in gradient.iter_mut().zip(eta).zip(&self.nuisance.std) {
            *g -= x / (std * std);
        }
        gradient
    }

    /// Returns J' V for V with these columns.
    pub fn cross_all(&self, jacobian: &Jacobian, columns: &[Vec<f64>]) -> DMatrix<f64> {
        let Some(rows) = columns.first().map(Vec::len) else { return DMatrix::zeros(self.nuisance.len(), 0) };
        jacobian.cross(self, MatRef::from_column_major_slice(&columns.concat(), rows, columns.len()))
    }

    /// Returns J' v.
    pub fn cross(&self, jacobian: &Jacobian, v: &[f64]) -> DMatrix<f64> {
        jacobian.cross(self, MatRef::from_column_major_slice(v, v.len(), 1))
    }

    /// Returns the information of the records on a fit's linear parameters and effect parameters (each in the fit's own
    /// scale): the normal matrix with the prior, and J' residual without it.
    pub fn information(&self, fit: &Fit, residual: &[f64]) -> (DMatrix<f64>, DVector<f64>) {
        let plant = self.nuisance.apply(&self.plant, &fit.eta);
        let jacobian = self.jacobian(&self.changed(&plant, &fit.effects).unwrap_or_else(|| plant.clone()));
        let scales = self.scales(&fit.effects);
        let columns = self.effect_columns(&plant, &fit.eta, &fit.effects, residual, &scales, Fineness::COARSE);
        let mut normal = Normal::new(self.nuisance.len() + scales.len());
        self.assemble(&jacobian, &columns, &vec![0.0; self.nuisance.len()], &mut normal);
        (normal.matrix, normal.right)
    }
}
