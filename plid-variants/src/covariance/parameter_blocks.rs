//! Sums of blocks of U diag(d) U^T between parameter columns: the quantities that expectations request from a
//! factored form.

use plid_core::kernels::{self, Kernels, PanelLayout, pivoted_cholesky, semidefinite_ldl};
use plid_core::{Backend, Dense, Matrix, View, ViewMut};

/// With weights = V V^T and V lower triangular, the result is the sum over k of M_k diag(d_theta) M_k^T, where M_k =
/// sum_s V_sk U_s and U_s is the panel of parameter column s. M_k begins with the columns of panel k.
#[derive(Clone, Debug)]
pub struct ParameterBlocks<S> {
    layout: PanelLayout,
    /// The column before which half of the work lies.
    half: usize,
    factor: Dense<S>,
    rest: Dense<S>,
    scale: Vec<S>,
    sums: [Dense<S>; 2],
    work: [Dense<S>; 2],
}

impl<S: Kernels> ParameterBlocks<S> {
    /// Allocates the sums.
    pub fn new(layout: PanelLayout) -> Self {
        let (columns, rows) = (layout.count() - 1, layout.rows());
        // Column c occurs in c / n + 1 of the M_k. The division is at a multiple of eight, so that packs of columns
        // remain whole.
        let before = |c: usize| (0..c).map(|c| c / layout.n() + 1).sum::<usize>();
        let total = before(columns * layout.n());
        let half = (0..columns * layout.n()).step_by(8).min_by_key(|&c| (2 * before(c)).abs_diff(total)).unwrap_or(0);
        Self {
            layout,
            half,
            factor: Dense::zeros(columns, columns),
            rest: Dense::zeros(columns, columns),
            scale: vec![S::zero(); columns],
            sums: std::array::from_fn(|_| Dense::zeros(rows, rows)),
            work: std::array::from_fn(|_| Dense::zeros(rows, kernels::DEPTH)),
        }
    }

    /// Adds the lower triangle of the sum to `out`. `theta` holds the panels from the second one on, and `d` their
    /// weights.
    pub fn add<B: Backend<Scalar = S>>(
        &mut self,
        weights: &Dense<S>,
        theta: View<'_, S>,
        d: &[S],
        mut out: ViewMut<'_, S>,
    ) {
        let rank = self.factor_weights(weights);
        let (layout, half) = (self.layout, self.half);
        let factor = self.factor.view().block(0, 0, weights.rows(), rank);
        let ([first_sum, second_sum], [first_work, second_work]) = (&mut self.sums, &mut self.work);
        let add = |from: usize, to: usize, sum: &mut Dense<S>, work: &mut Dense<S>| {
            sum.fill(S::zero());
            S::add_parameter_blocks(layout, theta, d, factor, from, to, sum.view_mut(), work.view_mut());
        };
        B::join(|| add(0, half, first_sum, first_work), || add(half, d.len(), second_sum, second_work));
        for c in 0..layout.n() {
            let both = first_sum.column(c)[c..].iter().zip(&second_sum.column(c)[c..]);
            for (to, (&a, &b)) in out.column_mut(c)[c..].iter_mut().zip(both) {
                *to += a + b;
            }
        }
    }

    /// Writes V to `factor` and returns its rank. The weights are second moments, so negative remainders are rounding
    /// errors and are dropped.
    fn factor_weights(&mut self, weights: &Dense<S>) -> usize {
        let count = weights.rows();
        let tolerance = 16.0 * count as f64 * S::EPSILON;
        for j in 0..count {
            self.factor.column_mut(j).copy_from_slice(weights.column(j));
        }
        // If the weights are clearly definite, apart from absent channels, the triangular factor is used as it is.
        let done = semidefinite_ldl(self.factor.view_mut(), &mut self.scale, tolerance, f64::INFINITY);
        let lost = |j: usize| self.scale[j] == S::zero() && weights.at(j, j) != S::zero();
        if done.is_ok() && !(0..count).any(lost) {
            for j in 0..count {
                let root = self.scale[j].sqrt();
                let column = self.factor.column_mut(j);
                column[..j].fill(S::zero());
                column[j] = S::one();
                column[j..].iter_mut().for_each(|x| *x *= root);
            }
            return count;
        }
        // Otherwise, the factorisation needs pivoting.
        for j in 0..count {
            self.rest.column_mut(j).copy_from_slice(weights.column(j));
        }
        let (rest, factor) = (self.rest.view_mut(), self.factor.view_mut());
        pivoted_cholesky(rest, factor, &mut self.scale, tolerance, f64::INFINITY).unwrap_or(0)
    }
}
