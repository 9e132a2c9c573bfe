//! Sums of blocks of U diag(d) U^T between parameter columns: what expectations ask of a factored form.

use plid_core::kernels::{self, Kernels, PanelLayout, pivoted_cholesky, semidefinite_ldl};
use plid_core::{Backend, Dense, Matrix, View, ViewMut};

/// With weights = V V^T, V lower triangular, the sum is one of M_k diag(d_theta) M_k^T with M_k = sum_s V_sk U_s, U_s
/// the panel of parameter column s: M_k begins with the columns of panel k.
#[derive(Clone, Debug)]
pub struct ParameterBlocks<S> {
    layout: PanelLayout,
    /// The columns before this one are half of the work.
    half: usize,
    factor: Dense<S>,
    rest: Dense<S>,
    scale: Vec<S>,
    sums: [Dense<S>; 2],
    work: [Dense<S>; 2],
}

impl<S: Kernels> ParameterBlocks<S> {
    /// Room for the sums.
    pub fn new(layout: PanelLayout) -> Self {
        let (columns, rows) = (layout.count() - 1, layout.rows());
        // Column c is in c / n + 1 of the M_k. In steps, so that packs of columns stay whole.
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

    /// `out` += the sum, lower triangle; `theta` holds the panels from the second on, `d` their weights.
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

    /// V into `factor`; returns its rank. Weights are moments; what rounding leaves below zero is dropped.
    fn factor_weights(&mut self, weights: &Dense<S>) -> usize {
        let count = weights.rows();
        let tolerance = 16.0 * count as f64 * S::EPSILON;
        for j in 0..count {
            self.factor.column_mut(j).copy_from_slice(weights.column(j));
        }
        // Clearly definite, up to channels that are not there: a triangular factor as it comes.
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
        // Else the pivots have to be sought.
        for j in 0..count {
            self.rest.column_mut(j).copy_from_slice(weights.column(j));
        }
        let (rest, factor) = (self.rest.view_mut(), self.factor.view_mut());
        pivoted_cholesky(rest, factor, &mut self.scale, tolerance, f64::INFINITY).unwrap_or(0)
    }
}
