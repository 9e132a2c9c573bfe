//! Triangular factors of small or singular covariances.

use super::axpy;
use crate::{Scalar, View, ViewMut};

/// The failing pivot of a factorisation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BadPivot {
    /// Its index in the matrix that was factored, from 0.
    pub index: usize,
    /// Its value: not positive, or zero within the tolerance, or not finite.
    pub value: f64,
}

/// Replaces the lower triangle of a positive definite matrix by its Cholesky factor L, A = L L^T. The strict upper
/// triangle is neither read nor written.
///
/// # Errors
/// Returns the first pivot that is not positive and finite.
pub fn cholesky<S: Scalar>(mut a: ViewMut<'_, S>) -> Result<(), BadPivot> {
    for j in 0..a.rows() {
        for k in 0..j {
            let factor = a.at(j, k);
            let (from, to) = a.column_pair(k, j);
            axpy(-factor, &from[j..], &mut to[j..]);
        }
        let pivot = a.at(j, j);
        if !(pivot > S::zero() && pivot.is_finite()) {
            return Err(BadPivot { index: j, value: pivot.to_f64() });
        }
        let root = pivot.sqrt();
        for x in &mut a.column_mut(j)[j..] {
            *x /= root;
        }
    }
    Ok(())
}

/// Solves L x = b in place, where L is the lower triangle of `l`.
pub fn solve_lower<S: Scalar>(l: View<'_, S>, x: &mut [S]) {
    for j in 0..l.rows() {
        x[j] /= l.at(j, j);
        let xj = x[j];
        axpy(-xj, &l.column(j)[j + 1..], &mut x[j + 1..]);
    }
}

/// Factorises a positive semidefinite matrix as A = T D T^T. The unit lower triangular T is written over the strict
/// lower triangle, and D to `d`. A pivot of at most `zero` times its diagonal entry counts as zero, and so do the
/// entries below it, which are zero in a semidefinite matrix.
///
/// # Errors
/// Returns a pivot that is not finite or is below minus `refuse` times its diagonal entry, or a pivot that counts as
/// zero with an entry below it whose square exceeds `refuse` times the product of the diagonal entries.
pub fn semidefinite_ldl<S: Scalar>(mut a: ViewMut<'_, S>, d: &mut [S], zero: f64, refuse: f64) -> Result<(), BadPivot> {
    let (zero, refuse) = (S::from_f64(zero), S::from_f64(refuse));
    for j in 0..a.rows() {
        let diagonal = a.at(j, j);
        for k in 0..j {
            let factor = a.at(j, k) * d[k];
            let (from, to) = a.column_pair(k, j);
            axpy(-factor, &from[j..], &mut to[j..]);
        }
        let pivot = a.at(j, j);
        let bad = BadPivot { index: j, value: pivot.to_f64() };
        if !pivot.is_finite() || pivot < -refuse * diagonal.abs() {
            return Err(bad);
        }
        if pivot > zero * diagonal.abs() {
            d[j] = pivot;
            for x in &mut a.column_mut(j)[j + 1..] {
                *x /= pivot;
            }
        } else {
            for i in j + 1..a.rows() {
                if a.at(i, j) * a.at(i, j) > refuse * diagonal.abs() * a.at(i, i).abs() {
                    return Err(bad);
                }
            }
            d[j] = S::zero();
            a.column_mut(j)[j + 1..].fill(S::zero());
        }
    }
    Ok(())
}

/// Computes the Cholesky factorisation with diagonal pivoting of a positive semidefinite matrix, A = L L^T. L is
/// written to `l`, with its rows in their own order and its columns in the order of the pivots; the columns from the
/// returned rank on are zero. `a`, whose lower triangle is used, is destroyed; `scale` has n entries. The
/// factorisation ends when every remaining pivot is at most `zero` times the diagonal entry of A in its row. Each row
/// is compared with itself, because rows may have different units.
///
/// # Errors
/// Returns a pivot that is below minus `refuse` times its diagonal entry, or one that is not finite.
pub fn pivoted_cholesky<S: Scalar>(
    mut a: ViewMut<'_, S>,
    mut l: ViewMut<'_, S>,
    scale: &mut [S],
    zero: f64,
    refuse: f64,
) -> Result<usize, BadPivot> {
    let n = a.rows();
    l.fill(S::zero());
    let (zero, lowest) = (S::from_f64(zero), -S::from_f64(refuse));
    // A = diag(scale) C diag(scale) with ones on the diagonal of C.
    for i in 0..n {
        let entry = a.at(i, i);
        if !entry.is_finite() || entry < lowest * entry.abs() {
            return Err(BadPivot { index: i, value: entry.to_f64() });
        }
        scale[i] = if entry > S::zero() { entry.sqrt() } else { S::zero() };
    }
    for j in 0..n {
        for i in j..n {
            let product = scale[i] * scale[j];
            let entry = a.at(i, j);
            *a.at_mut(i, j) = if product > S::zero() { entry / product } else { S::zero() };
        }
    }
    for k in 0..n {
        let mut best = 0;
        for i in 0..n {
            let entry = a.at(i, i);
            if !entry.is_finite() || entry < lowest {
                return Err(BadPivot { index: i, value: (entry * scale[i] * scale[i]).to_f64() });
            }
            if entry > a.at(best, best) {
                best = i;
            }
        }
        let pivot = a.at(best, best);
        if pivot <= zero {
            return Ok(k);
        }
        let root = pivot.sqrt();
        for i in 0..n {
            let entry = if i >= best { a.at(i, best) } else { a.at(best, i) };
            *l.at_mut(i, k) = entry / root;
        }
        let column = l.column_mut(k);
        for j in 0..n {
            let factor = column[j];
            axpy(-factor, &column[j..], &mut a.column_mut(j)[j..]);
        }
        for (x, &scale) in column.iter_mut().zip(&*scale) {
            *x *= scale;
        }
        // The rows already eliminated hold only rounding errors, which must not enter the factor again.
        for i in 0..n {
            if i >= best {
                *a.at_mut(i, best) = S::zero();
            } else {
                *a.at_mut(best, i) = S::zero();
            }
        }
    }
    Ok(n)
}
