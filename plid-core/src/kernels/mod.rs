//! Loops over slices and small matrices that the recursion is made of.
//!
//! Those that a step spends its time in are methods of [`Kernels`]; the short ones here are for use anywhere.

mod compiled;
mod pack;
mod shift;
mod symmetric;

pub use compiled::Kernels;
pub use pack::Pack;
pub use shift::Shift;

use crate::{Scalar, View, ViewMut};

/// y += alpha x.
#[inline]
pub fn axpy<S: Scalar>(alpha: S, x: &[S], y: &mut [S]) {
    for (y, &x) in y.iter_mut().zip(x) {
        *y += alpha * x;
    }
}

/// The sum of x_i y_i, in four partial sums so that it vectorises.
#[inline]
pub fn dot<S: Scalar>(x: &[S], y: &[S]) -> S {
    let mut sums = [S::zero(); 4];
    let (xs, ys) = (x.chunks_exact(4), y[..x.len()].chunks_exact(4));
    let tail = xs.remainder().iter().zip(ys.remainder()).fold(S::zero(), |t, (&a, &b)| t + a * b);
    for (a, b) in xs.zip(ys) {
        for k in 0..4 {
            sums[k] += a[k] * b[k];
        }
    }
    (sums[0] + sums[1]) + (sums[2] + sums[3]) + tail
}

/// The failing pivot of a factorisation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BadPivot {
    /// Its index in the matrix that was factored, from 0.
    pub index: usize,
    /// Its value, not above zero or not a number.
    pub value: f64,
}

/// Replaces the lower triangle of a positive definite matrix by its Cholesky factor L, A = L L^T.
/// The strict upper triangle is neither read nor written.
///
/// # Errors
/// The first pivot that is not positive.
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

/// Solves L x = b in place, L the lower triangle of `l`.
pub fn solve_lower<S: Scalar>(l: View<'_, S>, x: &mut [S]) {
    for j in 0..l.rows() {
        x[j] /= l.at(j, j);
        let xj = x[j];
        axpy(-xj, &l.column(j)[j + 1..], &mut x[j + 1..]);
    }
}

/// A = T D T^T of a positive semidefinite matrix, T unit lower triangular, written over the strict lower triangle;
/// D into `d`. A pivot of at most `zero` times its diagonal entry counts as zero and takes its column along:
/// in a semidefinite matrix nothing else can stand under it.
///
/// # Errors
/// A pivot below minus `refuse` times the diagonal entry, or not finite; a pivot that counts as zero with an entry under
/// it whose square is above `refuse` times the product of the diagonal entries.
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

/// Cholesky with diagonal pivoting of a positive semidefinite matrix: A = L L^T with L (in the rows' own order, its
/// columns in the order of the pivots) written into `l`, zero from the returned rank on. `a`, whose lower triangle is
/// used, is destroyed; `scale` holds n entries. What is left with no pivot above `zero` times its diagonal entry counts
/// as zero: relative to each entry's own, since rows of A may have different units.
///
/// # Errors
/// A pivot below minus `refuse` times its diagonal entry, or one that is not finite.
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
        // Rows already eliminated hold rounding errors of zero; the factor must not take them up again.
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

/// Modified weighted Gram-Schmidt (Thornton; Bierman 1977, ch. VI): given the array W (n x r) as its transpose
/// `wt` (r x n), and the weights of W's columns, finds U unit upper triangular and d with
/// U diag(d) U^T = W diag(weights) W^T. `wt` is destroyed; `u` is n x n and is overwritten.
pub fn weighted_gram_schmidt<S: Scalar>(
    mut wt: ViewMut<'_, S>,
    weights: &[S],
    mut u: ViewMut<'_, S>,
    d: &mut [S],
    work: &mut [S],
) {
    let n = wt.columns();
    let weighted = &mut work[..wt.rows()];
    let smallest = S::from_f64(S::SMALLEST / (S::EPSILON * S::EPSILON));
    u.fill(S::zero());
    for j in (0..n).rev() {
        for ((x, &v), &w) in weighted.iter_mut().zip(wt.column(j)).zip(weights) {
            *x = v * w;
        }
        d[j] = dot(weighted, wt.column(j));
        *u.at_mut(j, j) = S::one();
        // Products near underflow have few digits: a direction made of them would spoil the rows above.
        if d[j] <= smallest {
            d[j] = S::zero();
            continue;
        }
        for i in 0..j {
            let (vj, vi) = wt.column_pair(j, i);
            let factor = dot(weighted, vi) / d[j];
            axpy(-factor, vj, vi);
            *u.at_mut(i, j) = factor;
        }
    }
}

/// The upper triangular S (n x n) with S S^T = W W^T, by Householder reflections of the transposed array `wt`
/// (r x n, r >= n), whose columns are taken from the last to the first. `wt` is destroyed.
pub fn triangular_factor<S: Scalar>(mut wt: ViewMut<'_, S>, mut s: ViewMut<'_, S>, work: &mut [S]) {
    let (r, n) = (wt.rows(), wt.columns());
    s.fill(S::zero());
    // Step k works on column n-1-k and leaves its entries 0..=k: row k of the factor R of a QR factorisation.
    for k in 0..n {
        let pivot = n - 1 - k;
        let reflector = &mut work[..r - k];
        reflector.copy_from_slice(&wt.column(pivot)[k..]);
        let norm = dot(reflector, reflector).sqrt();
        if norm == S::zero() {
            // Nothing to reflect; row k of the other columns still belongs to R.
            for j in 0..pivot {
                *s.at_mut(j, pivot) = wt.at(k, j);
            }
            continue;
        }
        // The sign that does not cancel; the diagonal of S is then made positive by flipping column k of S.
        let head = reflector[0];
        let alpha = if head > S::zero() { -norm } else { norm };
        reflector[0] = head - alpha;
        let scale = -(alpha * reflector[0]);
        let sign = if alpha < S::zero() { -S::one() } else { S::one() };
        *s.at_mut(pivot, pivot) = alpha * sign;
        for j in 0..pivot {
            let column = &mut wt.column_mut(j)[k..];
            let factor = dot(reflector, column) / scale;
            axpy(-factor, reflector, column);
            *s.at_mut(j, pivot) = column[0] * sign;
        }
    }
}
