//! What a covariance of which the lower triangle is stored goes through in a step.

use super::Pack;
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

/// As many columns of C as share the loads of A.
const FOUR: usize = 4;

/// Entries of a cache line in f64; a half of one in f32.
const LINE: usize = 8;

#[inline(always)]
fn product_of_rank<S: Scalar, const K: usize>(mut c: ViewMut<'_, S>, alpha: S, a: View<'_, S>, b: View<'_, S>) {
    let n = c.columns();
    let tiled = n - n % LINE;
    for j in (0..tiled).step_by(LINE) {
        corner::<S, K>(c.reborrow(), j, alpha, a, b);
        // Below the corner a line begins, if the matrix does on one.
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

/// The LINE x LINE entries from (j, j) on: what is above the diagonal stays.
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

/// Column q of four gets the sum of `weights[k][q]` `a[k]`.
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
                16.. => rows_of_product::<S, 16>(m, phi, b, at, y, mirrored),
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

/// Rows at .. at + W of each block; returns W.
#[inline(always)]
fn rows_of_product<S: Scalar, const W: usize>(
    m: View<'_, S>,
    phi: &[S],
    b: usize,
    at: usize,
    y: &mut [S],
    mirrored: &mut [S],
) -> usize {
    // As many sums as registers may hold, in straight code; more parameter columns take turns.
    match phi.len() {
        2 => columns_of_product::<S, W, 2>(m, phi, 0, b, at, y, mirrored),
        3 => columns_of_product::<S, W, 3>(m, phi, 0, b, at, y, mirrored),
        4 => columns_of_product::<S, W, 4>(m, phi, 0, b, at, y, mirrored),
        5 => columns_of_product::<S, W, 5>(m, phi, 0, b, at, y, mirrored),
        6 => columns_of_product::<S, W, 6>(m, phi, 0, b, at, y, mirrored),
        k => (0..k).for_each(|left| columns_of_product::<S, W, 1>(m, phi, left, b, at, y, mirrored)),
    }
    W
}

/// Columns b of the K blocks from block `left` on, of all blocks of rows from theirs on.
#[inline(always)]
fn columns_of_product<S: Scalar, const W: usize, const K: usize>(
    m: View<'_, S>,
    phi: &[S],
    left: usize,
    b: usize,
    at: usize,
    y: &mut [S],
    mirrored: &mut [S],
) {
    let (n, k) = (mirrored.len() / phi.len(), phi.len());
    let mut sums = [Pack::<S, W>::zero(); K];
    // The K block rows that belong to the columns too, and then those below them.
    for l in 0..K {
        let row = (left + l) * n + at;
        let mut straight = Pack::load(&y[row..]);
        // A loop of K terms is unrolled, so that the sums stay in registers; one up to l would not be.
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
}

#[inline(always)]
pub fn add_mirrored<S: Scalar>(mirrored: View<'_, S>, first: usize, mut y: ViewMut<'_, S>) {
    let n = mirrored.rows();
    let (k, columns) = (mirrored.columns() / n, y.columns());
    let stride = y.stride();
    let (z, y) = (mirrored.data(), y.data_mut());
    for block in 0..k {
        for b in (0..n).step_by(EDGE) {
            for a in (0..columns).step_by(EDGE) {
                let from = &z[(b * k + block) * n + first + a..];
                let to = &mut y[a * stride + block * n + b..];
                if b + EDGE <= n && a + EDGE <= columns {
                    add_transposed_tile(from, k * n, to, stride);
                } else {
                    for i in 0..EDGE.min(columns - a) {
                        for q in 0..EDGE.min(n - b) {
                            to[i * stride + q] += from[q * k * n + i];
                        }
                    }
                }
            }
        }
    }
}

/// Adds the transpose of a tile, whose columns are `step` apart, to a tile whose columns are `stride` apart.
#[inline(always)]
fn add_transposed_tile<S: Scalar>(from: &[S], step: usize, to: &mut [S], stride: usize) {
    let mut tile = [[S::zero(); EDGE]; EDGE];
    for q in 0..EDGE {
        tile[q].copy_from_slice(&from[q * step..q * step + EDGE]);
    }
    // Three rounds of swaps of off-diagonal blocks, each half the size of the one before: shuffles of whole registers.
    let mut size = EDGE / 2;
    while size > 0 {
        for q in 0..EDGE {
            if q & size == 0 {
                for i in 0..EDGE {
                    if i & size != 0 {
                        let kept = tile[q][i];
                        tile[q][i] = tile[q + size][i - size];
                        tile[q + size][i - size] = kept;
                    }
                }
            }
        }
        size /= 2;
    }
    for i in 0..EDGE {
        let to = &mut to[i * stride..i * stride + EDGE];
        for q in 0..EDGE {
            to[q] += tile[i][q];
        }
    }
}

/// The side of a tile that is transposed at a time.
const EDGE: usize = 8;

#[inline(always)]
pub fn add_block_sums<S: Scalar>(mut x: ViewMut<'_, S>, theta: View<'_, S>, phi: &[S]) {
    for c in 0..x.columns() {
        add_blocks(x.column_mut(c), theta.column(c), phi);
    }
}

/// x <- x + sum_k phi_k theta_k over the blocks theta_k of x's length.
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
    // K L^T first, column by column, then K.
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
    shift_source: &[Option<usize>],
    rows: &[usize],
    abar: View<'_, S>,
    work: &mut [S],
) {
    for c in 0..x.columns() {
        let x = x.column_mut(c);
        for (y, &row) in work.iter_mut().zip(rows) {
            *y = x[row];
        }
        for i in (0..x.len()).rev() {
            x[i] = shift_source[i].map_or(S::zero(), |from| x[from]);
        }
        for k in 0..rows.len() {
            subtract(-work[k], abar.column(k), x);
        }
    }
}

#[inline(always)]
pub fn advance_rows<S: Scalar>(
    mut x: ViewMut<'_, S>,
    shift_source: &[Option<usize>],
    rows: &[usize],
    abar: View<'_, S>,
    mut kept: ViewMut<'_, S>,
) {
    for (k, &row) in rows.iter().enumerate() {
        kept.column_mut(k).copy_from_slice(x.column(row));
    }
    // From the last column to the first, since J takes column i from one before it.
    for i in (0..x.columns()).rev() {
        for first in (0..rows.len()).step_by(3) {
            let source = if first == 0 { shift_source[i] } else { Some(i) };
            match rows.len() - first {
                1 => column_of_sum::<S, 1>(x.reborrow(), i, source, abar, kept.view(), first),
                2 => column_of_sum::<S, 2>(x.reborrow(), i, source, abar, kept.view(), first),
                _ => column_of_sum::<S, 3>(x.reborrow(), i, source, abar, kept.view(), first),
            }
        }
    }
}

/// Column i of X becomes column `source`, or nothing, plus the sum of `abar(i, k)` times column k of `kept`, K of them.
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
    let (n, k) = (out.columns(), weights.columns());
    let mut mirrored = false;
    for c in 0..n {
        let sum = work.column_mut(c);
        sum.fill(S::zero());
        for t in 0..k {
            let column = m.column(t * n + c);
            for s in t..k {
                let weight = -weights.at(s, t);
                if weight == S::zero() {
                    continue;
                }
                let block = &column[s * n..(s + 1) * n];
                if s == t {
                    subtract(weight, &block[c..], &mut out.column_mut(c)[c..]);
                } else {
                    subtract(weight, block, sum);
                    mirrored = true;
                }
            }
        }
    }
    if mirrored {
        // M_ts is M_st transposed.
        for c in 0..n {
            let to = out.column_mut(c);
            for r in c..n {
                to[r] += work.at(r, c) + work.at(c, r);
            }
        }
    }
}
