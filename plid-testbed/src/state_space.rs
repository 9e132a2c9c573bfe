//! A linear model as four matrices, and its exact discretisation.

use nalgebra::DMatrix;
use ndarray::{Array2, ArrayView2};

/// dx/dt = A x + B u, y = C x + D u; or x_{k+1} = A x_k + B u_k, y_k = C x_k + D u_k.
#[derive(Clone, Debug, PartialEq)]
pub struct StateSpace {
    /// n x n.
    pub a: DMatrix<f64>,
    /// n x m.
    pub b: DMatrix<f64>,
    /// p x n.
    pub c: DMatrix<f64>,
    /// p x m.
    pub d: DMatrix<f64>,
}

impl StateSpace {
    /// Returns the number of states.
    #[must_use]
    pub fn states(&self) -> usize {
        self.a.nrows()
    }

    /// Returns this continuous model sampled every `step_s` seconds, with inputs held in between: exact, from the
    /// matrix exponential of [A B; 0 0].
    #[must_use]
    pub fn sampled(&self, step_s: f64) -> Self {
        let (n, m) = self.b.shape();
        let mut augmented = DMatrix::zeros(n + m, n + m);
        augmented.view_mut((0, 0), (n, n)).copy_from(&self.a);
        augmented.view_mut((0, n), (n, m)).copy_from(&self.b);
        let transition = (augmented * step_s).exp();
        Self {
            a: transition.view((0, 0), (n, n)).into_owned(),
            b: transition.view((0, n), (n, m)).into_owned(),
            c: self.c.clone(),
            d: self.d.clone(),
        }
    }

    /// Returns the outputs (K x p) of this discrete model for inputs (K x m), from rest.
    ///
    /// # Panics
    /// Panics if the inputs do not have m columns.
    #[must_use]
    pub fn simulate(&self, inputs: ArrayView2<f64>) -> Array2<f64> {
        assert_eq!(inputs.ncols(), self.b.ncols(), "one column an input");
        let mut x = vec![0.0; self.states()];
        let mut next = x.clone();
        let mut outputs = Array2::zeros((inputs.nrows(), self.c.nrows()));
        for (u, mut y) in inputs.rows().into_iter().zip(outputs.rows_mut()) {
            let (u, y) = (u.to_vec(), y.as_slice_mut().expect("rows of a new array are contiguous"));
            y.fill(0.0);
            multiply_add(&self.c, &x, y);
            multiply_add(&self.d, &u, y);
            next.fill(0.0);
            multiply_add(&self.a, &x, &mut next);
            multiply_add(&self.b, &u, &mut next);
            std::mem::swap(&mut x, &mut next);
        }
        outputs
    }
}

/// Computes `y += M x`, column by column in a fixed order, which gives the same bits on every processor.
pub(crate) fn multiply_add(m: &DMatrix<f64>, x: &[f64], y: &mut [f64]) {
    debug_assert_eq!((m.nrows(), m.ncols()), (y.len(), x.len()));
    for (column, &xj) in m.as_slice().chunks_exact(y.len()).zip(x) {
        for (yi, &mij) in y.iter_mut().zip(column) {
            *yi += mij * xj;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_pole_sampled_is_the_closed_form() {
        let one = |v: f64| DMatrix::from_element(1, 1, v);
        let model = StateSpace { a: one(-3.0), b: one(6.0), c: one(1.0), d: one(0.0) }.sampled(0.1);
        assert!((model.a[0] - (-0.3_f64).exp()).abs() < 1e-15);
        assert!((model.b[0] - 2.0 * (1.0 - (-0.3_f64).exp())).abs() < 1e-15);
    }

    #[test]
    fn product_agrees_with_nalgebra() {
        let m = DMatrix::from_fn(3, 2, |i, j| (i + 2 * j) as f64 + 0.5);
        let x = [1.5, -2.0];
        let mut y = [1.0; 3];
        multiply_add(&m, &x, &mut y);
        let expected = &m * DMatrix::from_row_slice(2, 1, &x);
        for i in 0..3 {
            assert!((y[i] - 1.0 - expected[i]).abs() < 1e-15);
        }
    }
}
