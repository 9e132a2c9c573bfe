//! Numbers in lanes of four, padded with zeros. Loops over them have no remainder, so they vectorise.

use crate::fourier::C;

const WIDE: usize = 4;

/// Real numbers.
pub type Quad = [f64; WIDE];

/// Complex numbers, one for each mode.
#[derive(Debug, Clone, Copy, Default)]
#[repr(align(64))]
pub struct Lane {
    re: Quad,
    im: Quad,
}

impl Lane {
    /// self * by + more.
    #[inline(always)]
    pub fn turned(self, by: Self, more: Self) -> Self {
        let mut to = more;
        for l in 0..WIDE {
            to.re[l] += self.re[l] * by.re[l] - self.im[l] * by.im[l];
            to.im[l] += self.im[l] * by.re[l] + self.re[l] * by.im[l];
        }
        to
    }

    #[inline(always)]
    fn add(&mut self, from: Self, factor: f64) {
        for l in 0..WIDE {
            self.re[l] += from.re[l] * factor;
            self.im[l] += from.im[l] * factor;
        }
    }
}

/// Complex numbers in their lanes.
pub fn complex(values: impl IntoIterator<Item = C>) -> Vec<Lane> {
    let mut lanes = Vec::new();
    for (k, z) in values.into_iter().enumerate() {
        if k % WIDE == 0 {
            lanes.push(Lane::default());
        }
        set(&mut lanes, k, z);
    }
    lanes
}

/// The k-th number.
pub fn set(lanes: &mut [Lane], k: usize, z: C) {
    (lanes[k / WIDE].re[k % WIDE], lanes[k / WIDE].im[k % WIDE]) = (z.re, z.im);
}

/// to += from * factor.
#[inline(always)]
pub fn add(to: &mut [Lane], from: &[Lane], factor: f64) {
    for (to, from) in to.iter_mut().zip(from) {
        to.add(*from, factor);
    }
}

/// Real part of the sum of products.
#[inline(always)]
pub fn real_dot(a: &[Lane], b: &[Lane]) -> f64 {
    let mut sum = [0.0; WIDE];
    for (a, b) in a.iter().zip(b) {
        for l in 0..WIDE {
            sum[l] += a.re[l] * b.re[l] - a.im[l] * b.im[l];
        }
    }
    whole(sum)
}

/// Real numbers in their lanes.
pub fn real(values: &[f64]) -> Vec<Quad> {
    values.chunks(WIDE).map(|some| std::array::from_fn(|l| some.get(l).copied().unwrap_or(0.0))).collect()
}

/// to += from * factor.
#[inline(always)]
pub fn add_real(to: &mut [Quad], from: &[Quad], factor: f64) {
    for (to, from) in to.iter_mut().zip(from) {
        // All values are read before any is written, so the compiler need not assume that they overlap.
        *to = std::array::from_fn(|l| to[l] + from[l] * factor);
    }
}

/// The sum of products.
#[inline(always)]
pub fn dot(a: &[Quad], b: &[Quad]) -> f64 {
    let mut sum = [0.0; WIDE];
    for (a, b) in a.iter().zip(b) {
        for l in 0..WIDE {
            sum[l] += a[l] * b[l];
        }
    }
    whole(sum)
}

#[inline(always)]
fn whole(sum: Quad) -> f64 {
    (sum[0] + sum[2]) + (sum[1] + sum[3])
}

/// A matrix, in groups of four rows.
#[derive(Debug, Clone)]
pub struct Rows {
    columns: usize,
    /// The columns of each group of four rows.
    values: Vec<Quad>,
}

impl Rows {
    /// Of a matrix.
    pub fn new(matrix: &nalgebra::DMatrix<f64>) -> Self {
        let (rows, columns) = matrix.shape();
        let entry = |i: usize, j: usize| if i < rows { matrix[(i, j)] } else { 0.0 };
        let values = (0..rows.div_ceil(WIDE))
            .flat_map(|four| (0..columns).map(move |j| std::array::from_fn(|l| entry(WIDE * four + l, j))))
            .collect();
        Self { columns, values }
    }

    /// to = matrix * x + more, for an x in its lanes.
    #[inline(always)]
    pub fn times(&self, x: &[Quad], more: &[Quad], to: &mut [Quad]) {
        let x = &x.as_flattened()[..self.columns];
        for ((rows, more), to) in self.values.chunks_exact(self.columns.max(1)).zip(more).zip(to) {
            let mut sum = *more;
            for (column, x) in rows.iter().zip(x) {
                for l in 0..WIDE {
                    sum[l] += column[l] * x;
                }
            }
            *to = sum;
        }
    }
}
