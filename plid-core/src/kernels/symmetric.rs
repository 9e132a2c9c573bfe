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
const TILE: usize = 4;

#[inline(always)]
fn product_of_rank<S: Scalar, const K: usize>(mut c: ViewMut<'_, S>, alpha: S, a: View<'_, S>, b: View<'_, S>) {
    let n = c.columns();
    let tiled = n - n % TILE;
    for j in (0..tiled).step_by(TILE) {
        let weights: [[S; TILE]; K] = std::array::from_fn(|k| std::array::from_fn(|q| alpha * b.at(j + q, k)));
        // The corner above row j + TILE is a small triangle.
        for q in 0..TILE {
            for i in j + q..j + TILE {
                let entry = c.at_mut(i, j + q);
                *entry = (0..K).fold(*entry, |sum, k| a.at(i, k).mul_add(weights[k][q], sum));
            }
        }
        let columns = c.four_columns_mut(j).map(|column| &mut column[j + TILE..]);
        add_to_four(columns, std::array::from_fn(|k| &a.column(k)[j + TILE..]), weights);
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

/// Column q of four gets the sum of `weights[k][q]` `a[k]`.
#[inline(always)]
fn add_to_four<S: Scalar, const K: usize>(columns: [&mut [S]; TILE], a: [&[S]; K], weights: [[S; TILE]; K]) {
    let [c0, c1, c2, c3] = columns;
    let n = c0.len();
    let (c1, c2, c3) = (&mut c1[..n], &mut c2[..n], &mut c3[..n]);
    let a = a.map(|a| &a[..n]);
    for i in 0..n {
        let mut sums = [c0[i], c1[i], c2[i], c3[i]];
        for k in 0..K {
            for q in 0..TILE {
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
    for b in 0..y.columns() {
        let y = y.column_mut(b);
        let mut mirrored = mirrored.block_mut(0, b * k, n, k);
        let mut at = 0;
        while at < n {
            at += match n - at {
                16.. => rows_of_product::<S, 16>(m, phi, first + b, at, y, mirrored.reborrow()),
                8.. => rows_of_product::<S, 8>(m, phi, first + b, at, y, mirrored.reborrow()),
                4.. => rows_of_product::<S, 4>(m, phi, first + b, at, y, mirrored.reborrow()),
                _ => rows_of_product::<S, 1>(m, phi, first + b, at, y, mirrored.reborrow()),
            };
        }
    }
}

/// Rows at .. at + W of each block. Returns W.
#[inline(always)]
fn rows_of_product<S: Scalar, const W: usize>(
    m: View<'_, S>,
    phi: &[S],
    b: usize,
    at: usize,
    y: &mut [S],
    mut mirrored: ViewMut<'_, S>,
) -> usize {
    let mut first = 0;
    while first < phi.len() {
        first += match phi.len() - first {
            1 => columns_of_product::<S, W, 1>(m, phi, b, at, first, y, mirrored.reborrow()),
            2 => columns_of_product::<S, W, 2>(m, phi, b, at, first, y, mirrored.reborrow()),
            3 => columns_of_product::<S, W, 3>(m, phi, b, at, first, y, mirrored.reborrow()),
            _ => columns_of_product::<S, W, 4>(m, phi, b, at, first, y, mirrored.reborrow()),
        };
    }
    W
}

/// Columns b of the blocks first .. first + G, of all blocks of rows at or below them. Returns G.
#[inline(always)]
fn columns_of_product<S: Scalar, const W: usize, const G: usize>(
    m: View<'_, S>,
    phi: &[S],
    b: usize,
    at: usize,
    first: usize,
    y: &mut [S],
    mut mirrored: ViewMut<'_, S>,
) -> usize {
    let n = mirrored.rows();
    let columns: [&[S]; G] = std::array::from_fn(|g| m.column((first + g) * n + b));
    let weights: [S; G] = std::array::from_fn(|g| phi[first + g]);
    let mut sums = [Pack::<S, W>::zero(); G];
    for row in first..phi.len() {
        let at_row = row * n + at;
        let mut straight = Pack::<S, W>::load(&y[at_row..]);
        for g in 0..G {
            if first + g < row {
                let entries = Pack::load(&columns[g][at_row..]);
                straight = straight.add_scaled(entries, weights[g]);
                sums[g] = sums[g].add_scaled(entries, phi[row]);
            } else if first + g == row {
                // A block on the diagonal: rows from b on are stored, and those below b have a mirror image.
                if at + W > b {
                    let mut entries = Pack::<S, W>::load(&columns[g][at_row..]);
                    let mut below = entries;
                    for i in 0..W {
                        entries.0[i] = if at + i < b { S::zero() } else { entries.0[i] };
                        below.0[i] = if at + i <= b { S::zero() } else { below.0[i] };
                    }
                    straight = straight.add_scaled(entries, weights[g]);
                    sums[g] = sums[g].add_scaled(below, phi[row]);
                }
            }
        }
        straight.store(&mut y[at_row..]);
    }
    for g in 0..G {
        sums[g].store(&mut mirrored.column_mut(first + g)[at..]);
    }
    G
}

#[inline(always)]
pub fn add_mirrored<S: Scalar>(mirrored: View<'_, S>, first: usize, mut y: ViewMut<'_, S>) {
    let n = mirrored.rows();
    let k = mirrored.columns() / n;
    let tiled = y.columns() - y.columns() % EDGE;
    for a in (0..tiled).step_by(EDGE) {
        for block in 0..k {
            let whole = n - n % EDGE;
            for b in (0..whole).step_by(EDGE) {
                let tile: [[S; EDGE]; EDGE] =
                    std::array::from_fn(|q| Pack::load(&mirrored.column((b + q) * k + block)[first + a..]).0);
                for i in 0..EDGE {
                    let to = &mut y.column_mut(a + i)[block * n + b..][..EDGE];
                    for q in 0..EDGE {
                        to[q] += tile[q][i];
                    }
                }
            }
            for i in 0..EDGE {
                for b in whole..n {
                    *y.at_mut(block * n + b, a + i) += mirrored.at(first + a + i, b * k + block);
                }
            }
        }
    }
    for a in tiled..y.columns() {
        for block in 0..k {
            for b in 0..n {
                *y.at_mut(block * n + b, a) += mirrored.at(first + a, b * k + block);
            }
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
        match shift_source[i] {
            Some(from) => {
                let (from, to) = x.column_pair(from, i);
                to.copy_from_slice(from);
            }
            None => x.column_mut(i).fill(S::zero()),
        }
        for k in 0..rows.len() {
            subtract(-abar.at(i, k), kept.column(k), x.column_mut(i));
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
