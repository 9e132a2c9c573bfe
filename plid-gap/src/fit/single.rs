//! Columns in single precision.
//!
//! The derivatives of runs with effects are the largest array of a diagnosis: a value for each row of all records and
//! each linear parameter. Single precision halves it. The rounding of 6e-8 is small beside the error of a difference
//! of simulations over a step of a thousandth, and products are summed in double precision. The exact derivatives
//! without effects stay in double precision: if they were rounded, the locations of an error could no longer be
//! distinguished.

use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, MatMut, MatRef, Par};
use nalgebra::DMatrix;
use rayon::prelude::*;

/// Number of rows that are computed together. In double precision, they fit into the cache.
const CHUNK: usize = 1024;

/// Columns (rows x columns) in single precision.
#[derive(Clone)]
pub(super) struct Single {
    rows: usize,
    values: Vec<f32>,
}

impl Single {
    /// Returns columns with this number of rows, each of which `write` fills.
    pub fn filled(rows: usize, columns: usize, write: impl Fn(usize, &mut [f32]) + Sync) -> Self {
        let mut values = vec![0.0; rows * columns];
        values.par_chunks_mut(rows.max(1)).enumerate().for_each(|(k, column)| write(k, column));
        Self { rows, values }
    }

    /// Returns the number of columns.
    pub fn columns(&self) -> usize {
        self.values.len() / self.rows.max(1)
    }

    /// Calls `take` with consecutive rows in double precision. Its arguments are the number of the first row and the
    /// rows, in which the columns of `beside` follow those of this matrix.
    pub fn for_each_chunk(&self, beside: MatRef<'_, f64>, mut take: impl FnMut(usize, MatRef<'_, f64>)) {
        let own = self.columns();
        let mut chunk = Mat::zeros(CHUNK, own + beside.ncols());
        for from in (0..self.rows).step_by(CHUNK) {
            let height = CHUNK.min(self.rows - from);
            for (j, column) in self.values.chunks_exact(self.rows).enumerate() {
                (0..height).for_each(|i| chunk[(i, j)] = f64::from(column[from + i]));
            }
            chunk.get_mut(..height, own..).copy_from(beside.subrows(from, height));
            take(from, chunk.subrows(0, height));
        }
    }

    /// Returns the product of the transposed columns with `v`, which has the same rows.
    pub fn product(&self, v: MatRef<'_, f64>) -> DMatrix<f64> {
        let own = self.columns();
        self.sum(own, v.ncols(), v, |chunk| chunk.split_at_col(own))
    }

    /// Returns the product of the transposed columns with themselves.
    pub fn square(&self) -> DMatrix<f64> {
        let own = self.columns();
        let none = MatRef::from_column_major_slice(&[], self.rows, 0);
        self.sum(own, own, none, |chunk| (chunk, chunk))
    }

    /// Returns the sum over all chunks of A'B, in which `of` selects A and B.
    fn sum(
        &self,
        height: usize,
        width: usize,
        beside: MatRef<'_, f64>,
        of: impl for<'c> Fn(MatRef<'c, f64>) -> (MatRef<'c, f64>, MatRef<'c, f64>),
    ) -> DMatrix<f64> {
        let mut sum = DMatrix::zeros(height, width);
        if !sum.is_empty() {
            self.for_each_chunk(beside, |_, chunk| {
                let (a, b) = of(chunk);
                let to = MatMut::from_column_major_slice_mut(sum.as_mut_slice(), height, width);
                matmul(to, Accum::Add, a.transpose(), b, 1.0, Par::Seq);
            });
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn products_are_those_of_the_columns() {
        let (rows, value) = (2500, |i: usize, k: usize| ((i * (k + 3) + 7 * k) % 11) as f64 - 5.0);
        let single = Single::filled(rows, 3, |k, column| (0..rows).for_each(|i| column[i] = value(i, k) as f32));
        let v: Vec<f64> = (0..2 * rows).map(|i| value(i % rows, 5 + i / rows)).collect();
        let exact = |j: usize, k: usize| (0..rows).map(|i| value(i, j) * value(i, k)).sum::<f64>();
        let product = single.product(MatRef::from_column_major_slice(&v, rows, 2));
        assert_eq!(product, DMatrix::from_fn(3, 2, |j, k| exact(j, 5 + k)));
        assert_eq!(single.square(), DMatrix::from_fn(3, 3, exact));
    }
}
