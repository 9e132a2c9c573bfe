//! The operations of a step on a covariance whose lower triangle is stored.

use super::{Pack, Shift};
use crate::{Scalar, View, ViewMut};

#[inline(always)]
pub fn symmetric_product_lower<S: Scalar>(mut c: ViewMut<'_, S>, alpha: S, a: View<'_, S>, b: View<'_, S>) {
    let (rows, ranks) = (a.rows(), a.columns());
    let mut k = 0;
    while k < ranks {
        let taken = (ranks - k).min(4);
        let (a, b) = (a.block(0, k, rows, taken), b.block(0, k, rows, taken));
        match taken {
            1 => product_of_rank::<S, 1>(c.reborrow(), alpha, a, b),
            2 => product_of_rank::<S, 2>(c.reborrow(), alpha, a, b),
            3 => product_of_rank::<S, 3>(c.reborrow(), alpha, a, b),
            _ => product_of_rank::<S, 4>(c.reborrow(), alpha, a, b),
        }
        k += taken;
    }
}

/// The number of columns of C that share the loads of A.
const FOUR: usize = 4;

/// The number of entries in a cache line in `f64`; in `f32` they are half a line.
const LINE: usize = 8;

#[inline(always)]
fn product_of_rank<S: Scalar, const K: usize>(mut c: ViewMut<'_, S>, alpha: S, a: View<'_, S>, b: View<'_, S>) {
    let n = c.columns();
    let tiled = n - n % LINE;
    for j in (0..tiled).step_by(LINE) {
        corner::<S, K>(c.reborrow(), j, alpha, a, b);
        // A cache line begins below the corner if the columns begin on one.
        let below = j + LINE;
        for first in (j..below).step_by(FOUR) {
            let weights: [[S; FOUR]; K] = std::array::from_fn(|k| std::array::from_fn(|q| alpha * b.at(first + q, k)));
            let [c0, c1, c2, c3] = c.four_columns_mut(first);
            let columns = [&mut c0[below..], &mut c1[below..], &mut c2[below..], &mut c3[below..]];
            let mut factors: [&[S]; K] = [&[]; K];
            for k in 0..K {
                factors[k] = &a.column(k)[below..];
            }
            add_to_four(columns, factors, weights);
        }
    }
    for j in tiled..n {
        for k in 0..K {
            let weight = alpha * b.at(j, k);
            for (x, &a) in c.column_mut(j)[j..].iter_mut().zip(&a.column(k)[j..]) {
                *x = a.mul_add(weight, *x);
            }
        }
    }
}

/// Updates the LINE x LINE entries from (j, j) on; those above the diagonal are not changed.
#[inline(always)]
fn corner<S: Scalar, const K: usize>(mut c: ViewMut<'_, S>, j: usize, alpha: S, a: View<'_, S>, b: View<'_, S>) {
    for q in 0..LINE {
        let column = &mut c.column_mut(j + q)[j..j + LINE];
        let before = Pack::<S, LINE>::load(column);
        let mut sum = before;
        for k in 0..K {
            sum = sum.add_scaled(Pack::load(&a.column(k)[j..]), alpha * b.at(j + q, k));
        }
        for i in 0..LINE {
            sum.0[i] = if i < q { before.0[i] } else { sum.0[i] };
        }
        sum.store(column);
    }
}

/// Adds the sum over k of `weights[k][q]` `a[k]` to each column q of the four.
#[inline(always)]
fn add_to_four<S: Scalar, const K: usize>(columns: [&mut [S]; FOUR], a: [&[S]; K], weights: [[S; FOUR]; K]) {
    let [c0, c1, c2, c3] = columns;
    let n = c0.len();
    let (c1, c2, c3) = (&mut c1[..n], &mut c2[..n], &mut c3[..n]);
    for i in 0..n {
        let mut sums = [c0[i], c1[i], c2[i], c3[i]];
        for k in 0..K {
            for q in 0..FOUR {
                sums[q] = a[k][i].mul_add(weights[k][q], sums[q]);
            }
        }
        [c0[i], c1[i], c2[i], c3[i]] = sums;
    }
}

#[inline(always)]
pub fn block_product_lower<S: Scalar>(
    m: View<'_, S>,
    phi: &[S],
    first: usize,
    mut y: ViewMut<'_, S>,
    mut mirrored: ViewMut<'_, S>,
) {
    let (n, k) = (mirrored.rows(), phi.len());
    for column in 0..y.columns() {
        let b = first + column;
        let y = y.column_mut(column);
        let mirrored = &mut mirrored.data_mut()[column * k * n..(column + 1) * k * n];
        let mut at = 0;
        while at < n {
            at += match n - at {
                32.. => rows_of_product::<S, 32>(m, phi, b, at, y, mirrored),
                8.. => rows_of_product::<S, 8>(m, phi, b, at, y, mirrored),
                4.. => rows_of_product::<S, 4>(m, phi, b, at, y, mirrored),
                _ => rows_of_product::<S, 1>(m, phi, b, at, y, mirrored),
            };
        }
        for block in 0..k {
            // The diagonal is its own mirror image.
            mirrored[block * n + b] -= m.at(block * n + b, block * n + b) * phi[block];
        }
    }
}

/// Processes rows at .. at + W of each block. Returns W.
#[inline(always)]
fn rows_of_product<S: Scalar, const W: usize>(
    m: View<'_, S>,
    phi: &[S],
    b: usize,
    at: usize,
    y: &mut [S],
    mirrored: &mut [S],
) -> usize {
    // As many sums as the registers hold, in straight-line code.
    let mut left = 0;
    while left < phi.len() {
        left += match phi.len() - left {
            1 => columns_of_product::<S, W, 1>(m, phi, left, b, at, y, mirrored),
            2 | 4 => columns_of_product::<S, W, 2>(m, phi, left, b, at, y, mirrored),
            _ => columns_of_product::<S, W, 3>(m, phi, left, b, at, y, mirrored),
        };
    }
    W
}

/// Processes column b of each of the K blocks from block `left` on, in the rows of these blocks and below. Returns K.
#[inline(always)]
fn columns_of_product<S: Scalar, const W: usize, const K: usize>(
    m: View<'_, S>,
    phi: &[S],
    left: usize,
    b: usize,
    at: usize,
    y: &mut [S],
    mirrored: &mut [S],
) -> usize {
    let (n, k) = (mirrored.len() / phi.len(), phi.len());
    let mut sums = [Pack::<S, W>::zero(); K];
    // First the K blocks of rows that belong to these columns, then those below them.
    for l in 0..K {
        let row = (left + l) * n + at;
        let mut straight = Pack::load(&y[row..]);
        // A loop over K terms is unrolled, so that the sums stay in registers; a loop up to l would not be.
        for g in 0..K {
            if g <= l {
                let entry = Pack::load(&m.column((left + g) * n + b)[row..]);
                straight = straight.add_scaled(entry, phi[left + g]);
                sums[g] = sums[g].add_scaled(entry, phi[left + l]);
            }
        }
        straight.store(&mut y[row..]);
    }
    for l in left + K..k {
        let row = l * n + at;
        let mut straight = Pack::load(&y[row..]);
        for g in 0..K {
            let entry = Pack::load(&m.column((left + g) * n + b)[row..]);
            straight = straight.add_scaled(entry, phi[left + g]);
            sums[g] = sums[g].add_scaled(entry, phi[l]);
        }
        straight.store(&mut y[row..]);
    }
    for g in 0..K {
        sums[g].store(&mut mirrored[(left + g) * n + at..]);
    }
    K
}

#[inline(always)]
pub fn add_mirrored<S: Scalar>(mirrored: View<'_, S>, k: usize, row: usize, first: usize, mut y: ViewMut<'_, S>) {
    let n = mirrored.rows();
    let (height, columns) = (mirrored.columns() / k, y.columns());
    let stride = y.stride();
    let (z, y) = (mirrored.data(), y.data_mut());
    // The columns of Y are far apart, in separate memory pages, so only a few of them are filled from top to bottom
    // at a time.
    for a in (0..columns).step_by(EDGE) {
        for block in 0..k {
            for b in (0..height).step_by(EDGE) {
                let from = &z[(b * k + block) * n + first + a..];
                let to = &mut y[a * stride + block * n + row + b..];
                if b + EDGE <= height && a + EDGE <= columns {
                    add_transposed_tile(from, k * n, to, stride);
                } else {
                    for i in 0..EDGE.min(columns - a) {
                        for q in 0..EDGE.min(height - b) {
                            to[i * stride + q] += from[q * k * n + i];
                        }
                    }
                }
            }
        }
    }
}

/// Adds the transpose of a tile whose columns are `step` apart to a tile whose columns are `stride` apart.
#[inline(always)]
fn add_transposed_tile<S: Scalar>(from: &[S], step: usize, to: &mut [S], stride: usize) {
    let mut tile = [[S::zero(); EDGE]; EDGE];
    for q in 0..EDGE {
        tile[q].copy_from_slice(&from[q * step..][..EDGE]);
    }
    // Each round moves the first bit of a column's number behind the bits of the row's number, and the reverse. After
    // three rounds the two numbers have changed places. In this form the code becomes shuffles of whole registers.
    for _ in 0..3 {
        let before = tile;
        for q in 0..EDGE / 2 {
            let (a, b) = (before[q], before[q + EDGE / 2]);
            tile[2 * q] = [a[0], b[0], a[1], b[1], a[2], b[2], a[3], b[3]];
            tile[2 * q + 1] = [a[4], b[4], a[5], b[5], a[6], b[6], a[7], b[7]];
        }
    }
    for i in 0..EDGE {
        for (to, &from) in to[i * stride..][..EDGE].iter_mut().zip(&tile[i]) {
            *to += from;
        }
    }
}

/// The side of the tiles that are transposed.
const EDGE: usize = 8;

#[inline(always)]
pub fn add_block_sums<S: Scalar>(mut x: ViewMut<'_, S>, theta: View<'_, S>, phi: &[S]) {
    for c in 0..x.columns() {
        add_blocks(x.column_mut(c), theta.column(c), phi);
    }
}

/// Computes x <- x + sum_k phi_k theta_k over the blocks theta_k of x's length.
#[inline(always)]
fn add_blocks<S: Scalar>(x: &mut [S], theta: &[S], phi: &[S]) {
    let n = x.len();
    let mut k = 0;
    while k < phi.len() {
        let block = |k: usize| &theta[k * n..(k + 1) * n];
        k += match &phi[k..] {
            [p0, p1, p2, ..] => {
                let (t0, t1, t2) = (block(k), block(k + 1), block(k + 2));
                for i in 0..n {
                    x[i] = t2[i].mul_add(*p2, t1[i].mul_add(*p1, t0[i].mul_add(*p0, x[i])));
                }
                3
            }
            [p0, ..] => {
                let t0 = block(k);
                for i in 0..n {
                    x[i] = t0[i].mul_add(*p0, x[i]);
                }
                1
            }
            [] => 0,
        };
    }
}

#[inline(always)]
pub fn solve_gain<S: Scalar>(cross: View<'_, S>, factor: View<'_, S>, mut gain: ViewMut<'_, S>) {
    let k = cross.columns();
    // First K L, column by column, then K.
    for j in 0..k {
        gain.column_mut(j).copy_from_slice(cross.column(j));
        for i in 0..j {
            let (from, to) = gain.column_pair(i, j);
            subtract(factor.at(j, i), from, to);
        }
        divide(factor.at(j, j), gain.column_mut(j));
    }
    for j in (0..k).rev() {
        for i in j + 1..k {
            let (from, to) = gain.column_pair(i, j);
            subtract(factor.at(i, j), from, to);
        }
        divide(factor.at(j, j), gain.column_mut(j));
    }
}

#[inline(always)]
fn subtract<S: Scalar>(weight: S, from: &[S], to: &mut [S]) {
    for (y, &x) in to.iter_mut().zip(from) {
        *y = x.mul_add(-weight, *y);
    }
}

#[inline(always)]
fn divide<S: Scalar>(by: S, x: &mut [S]) {
    x.iter_mut().for_each(|x| *x /= by);
}

#[inline(always)]
pub fn advance_columns<S: Scalar>(
    mut x: ViewMut<'_, S>,
    shift: &Shift,
    rows: &[usize],
    abar: View<'_, S>,
    work: &mut [S],
) {
    for c in 0..x.columns() {
        let x = x.column_mut(c);
        for (y, &row) in work.iter_mut().zip(rows) {
            *y = x[row];
        }
        shift.apply(x);
        let mut k = 0;
        while k < rows.len() {
            k += match rows.len() - k {
                1 => add_columns::<S, 1>(x, abar, &work[k..], k),
                2 => add_columns::<S, 2>(x, abar, &work[k..], k),
                _ => add_columns::<S, 3>(x, abar, &work[k..], k),
            };
        }
    }
}

/// Adds K columns of `terms`, from `first` on, times `weights`, to x. Returns K.
#[inline(always)]
fn add_columns<S: Scalar, const K: usize>(x: &mut [S], terms: View<'_, S>, weights: &[S], first: usize) -> usize {
    let n = x.len();
    let mut columns: [&[S]; K] = [&[]; K];
    for k in 0..K {
        columns[k] = &terms.column(first + k)[..n];
    }
    for i in 0..n {
        x[i] = (0..K).fold(x[i], |sum, k| columns[k][i].mul_add(weights[k], sum));
    }
    K
}

#[inline(always)]
pub fn advance_rows<S: Scalar>(
    mut x: ViewMut<'_, S>,
    shift: &Shift,
    rows: &[usize],
    abar: View<'_, S>,
    mut kept: ViewMut<'_, S>,
) {
    for (k, &row) in rows.iter().enumerate() {
        kept.column_mut(k).copy_from_slice(x.column(row));
    }
    // From the last column to the first, because J takes column i from a column before it.
    for i in (0..x.columns()).rev() {
        for first in (0..rows.len()).step_by(3) {
            let source = if first == 0 { shift.source(i) } else { Some(i) };
            match rows.len() - first {
                1 => column_of_sum::<S, 1>(x.reborrow(), i, source, abar, kept.view(), first),
                2 => column_of_sum::<S, 2>(x.reborrow(), i, source, abar, kept.view(), first),
                _ => column_of_sum::<S, 3>(x.reborrow(), i, source, abar, kept.view(), first),
            }
        }
    }
}

/// Sets column i of X to column `source`, or to zero without one, plus the sum of `abar(i, k)` times column k of
/// `kept` over K columns from `first` on.
#[inline(always)]
fn column_of_sum<S: Scalar, const K: usize>(
    mut x: ViewMut<'_, S>,
    i: usize,
    source: Option<usize>,
    abar: View<'_, S>,
    kept: View<'_, S>,
    first: usize,
) {
    let (rows, stride) = (x.rows(), x.stride());
    let mut weights = [S::zero(); K];
    let mut terms: [&[S]; K] = [&[]; K];
    for k in 0..K {
        weights[k] = abar.at(i, first + k);
        terms[k] = &kept.column(first + k)[..rows];
    }
    let sum = |start: S, r: usize| (0..K).fold(start, |sum, k| terms[k][r].mul_add(weights[k], sum));
    match source {
        Some(from) if from != i => {
            let (before, to) = x.data_mut()[from * stride..].split_at_mut((i - from) * stride);
            let (before, to) = (&before[..rows], &mut to[..rows]);
            for r in 0..rows {
                to[r] = sum(before[r], r);
            }
        }
        Some(_) => {
            let to = x.column_mut(i);
            for r in 0..rows {
                to[r] = sum(to[r], r);
            }
        }
        None => {
            let to = x.column_mut(i);
            for r in 0..rows {
                to[r] = sum(S::zero(), r);
            }
        }
    }
}

#[inline(always)]
pub fn add_weighted_blocks_lower<S: Scalar>(
    m: View<'_, S>,
    weights: View<'_, S>,
    mut out: ViewMut<'_, S>,
    mut work: ViewMut<'_, S>,
) {
    let n = out.columns();
    for c in 0..n {
        let mut at = 0;
        while at < n {
            let (out, work) = (out.column_mut(c), work.column_mut(c));
            // The sums of a few packs are formed side by side, so that they hide each other's latency.
            at += match n - at {
                32.. => rows_of_blocks::<S, 32>(m, weights, c, at, out, work),
                16.. => rows_of_blocks::<S, 16>(m, weights, c, at, out, work),
                4.. => rows_of_blocks::<S, 4>(m, weights, c, at, out, work),
                _ => rows_of_blocks::<S, 1>(m, weights, c, at, out, work),
            };
        }
    }
    for c in 0..n {
        for (to, &from) in out.column_mut(c).iter_mut().zip(work.column(c)) {
            *to += from;
        }
    }
    // M_ts is the transpose of M_st.
    add_mirrored(work.view(), 1, 0, 0, out);
}

/// Adds rows at .. at + W of column c of the blocks on the diagonal to `out`, and writes the sum of those of the
/// blocks below it to `work`. Returns W.
#[inline(always)]
fn rows_of_blocks<S: Scalar, const W: usize>(
    m: View<'_, S>,
    weights: View<'_, S>,
    c: usize,
    at: usize,
    out: &mut [S],
    work: &mut [S],
) -> usize {
    let n = out.len();
    let (mut diagonal, mut below) = (Pack::<S, W>::load(&out[at..]), Pack::<S, W>::zero());
    for t in 0..weights.columns() {
        let column = m.column(t * n + c);
        if at + W > c {
            diagonal = diagonal.add_scaled(Pack::load(&column[t * n + at..]), weights.at(t, t));
        }
        for s in t + 1..weights.columns() {
            if weights.at(s, t) != S::zero() {
                below = below.add_scaled(Pack::load(&column[s * n + at..]), weights.at(s, t));
            }
        }
    }
    diagonal.store(&mut out[at..]);
    below.store(&mut work[at..]);
    W
}
