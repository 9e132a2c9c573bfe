use nalgebra::{Complex, DMatrix};

use super::eigen::balance;
use super::state_space::Model;

/// A model in coordinates in which A is upper Hessenberg, x = T x_h with T = D Q (balancing followed by Householder
/// reflections). In these coordinates z I - A is factored in O(n^2).
pub(super) struct HessenbergModel {
    h: DMatrix<f64>,
    b: DMatrix<Complex<f64>>,
    c: DMatrix<Complex<f64>>,
    /// T^{-1}, which maps rows back to the original coordinates.
    inverse: DMatrix<f64>,
}

impl HessenbergModel {
    pub fn of(model: &Model) -> Self {
        let (balanced, scale) = balance(&model.a);
        let (q, h) = if model.n() == 1 { (DMatrix::identity(1, 1), balanced) } else { balanced.hessenberg().unpack() };
        let change = DMatrix::from_fn(model.n(), model.n(), |i, j| scale[i] * q[(i, j)]);
        let inverse = DMatrix::from_fn(model.n(), model.n(), |i, j| q[(j, i)] / scale[j]);
        Self { h, b: (&inverse * &model.b).map(Complex::from), c: (&model.c * change).map(Complex::from), inverse }
    }

    /// Returns C (z I - A)^{-1} B (p x m). If z is a pole the result is very large or not finite.
    pub fn transfer(&self, z: Complex<f64>) -> DMatrix<Complex<f64>> {
        let mut x = self.b.clone();
        Factors::of(&self.h, z).solve(&mut x);
        &self.c * x
    }

    /// Returns W = C (z I - A)^{-1} in the model's own coordinates (p x n).
    pub fn resolvent_rows(&self, z: Complex<f64>) -> DMatrix<Complex<f64>> {
        let mut x = self.c.transpose();
        Factors::of(&self.h, z).solve_transposed(&mut x);
        let rows = x.transpose();
        let real = rows.map(|w| w.re) * &self.inverse;
        let imaginary = rows.map(|w| w.im) * &self.inverse;
        real.zip_map(&imaginary, Complex::new)
    }
}

/// The factorisation of z I - H into row operations and an upper triangular matrix. The subdiagonal is eliminated with
/// partial pivoting.
struct Factors {
    upper: DMatrix<Complex<f64>>,
    /// For each row from the second on: whether it was swapped with the row above, and the multiple of that row that
    /// was subtracted.
    operations: Vec<(bool, Complex<f64>)>,
}

impl Factors {
    fn of(h: &DMatrix<f64>, z: Complex<f64>) -> Self {
        let n = h.nrows();
        let mut upper = h.map(|h| Complex::from(-h));
        for i in 0..n {
            upper[(i, i)] += z;
        }
        let mut operations = Vec::with_capacity(n);
        for i in 1..n {
            let swap = upper[(i, i - 1)].norm_sqr() > upper[(i - 1, i - 1)].norm_sqr();
            if swap {
                upper.swap_rows(i - 1, i);
            }
            let mut factor = upper[(i, i - 1)];
            if factor != Complex::ZERO {
                factor /= upper[(i - 1, i - 1)];
                for j in i..n {
                    let above = upper[(i - 1, j)];
                    upper[(i, j)] -= factor * above;
                }
            }
            operations.push((swap, factor));
        }
        Self { upper, operations }
    }

    /// Computes x <- (z I - H)^{-1} x column by column.
    fn solve(&self, x: &mut DMatrix<Complex<f64>>) {
        let n = self.upper.nrows();
        for mut column in x.column_iter_mut() {
            for (i, &(swap, factor)) in (1..n).zip(&self.operations) {
                if swap {
                    column.swap_rows(i - 1, i);
                }
                let above = column[i - 1];
                column[i] -= factor * above;
            }
            for i in (0..n).rev() {
                let value = column[i] / self.upper[(i, i)];
                column[i] = value;
                for k in 0..i {
                    column[k] -= self.upper[(k, i)] * value;
                }
            }
        }
    }

    /// Computes x <- (z I - H)^{-T} x column by column: first the triangular solve, then the row operations in reverse
    /// order.
    fn solve_transposed(&self, x: &mut DMatrix<Complex<f64>>) {
        let n = self.upper.nrows();
        for mut column in x.column_iter_mut() {
            for j in 0..n {
                let mut value = column[j];
                for k in 0..j {
                    value -= self.upper[(k, j)] * column[k];
                }
                column[j] = value / self.upper[(j, j)];
            }
            for (i, &(swap, factor)) in (1..n).zip(&self.operations).rev() {
                let below = column[i];
                column[i - 1] -= factor * below;
                if swap {
                    column.swap_rows(i - 1, i);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::{canonical, random, two_modes};
    use super::*;

    #[test]
    fn it_agrees_with_a_dense_inverse() {
        let mut wild = canonical(5, &[3, 2, 2], 2);
        wild.a.row_mut(0).scale_mut(1e6);
        wild.a.column_mut(0).scale_mut(1e-6);
        let one = Model::new(1.0, random(1, 1, 1), random(2, 1, 2), random(3, 2, 1), random(4, 2, 2));
        for model in [canonical(3, &[4, 3], 2), two_modes(), wild, one.unwrap()] {
            let fast = HessenbergModel::of(&model);
            for angle in [0.0, 0.4, 1.9, std::f64::consts::PI] {
                let z = Complex::from_polar(1.0, angle);
                let shifted = DMatrix::identity(model.n(), model.n()) * z - model.a.map(Complex::from);
                let rows = model.c.map(Complex::from) * shifted.try_inverse().unwrap();
                let transfer = &rows * model.b.map(Complex::from);
                let close = |a: DMatrix<Complex<f64>>, b: &DMatrix<Complex<f64>>| {
                    assert!((a - b).norm() < 1e-11 * b.norm());
                };
                close(fast.resolvent_rows(z), &rows);
                close(fast.transfer(z), &transfer);
            }
        }
    }
}
