//! The limits of the machine: a pass over a matrix, and multiplications in registers, measured together with the
//! recursion.

use std::hint::black_box;
use std::time::Instant;

use multiversion::multiversion;
use plid_core::Scalar;

/// Computes x <- a x + b for every entry. No step that reads and writes all of P can be faster.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+fma", "x86_64+avx2+fma"))]
fn sweep<S: Scalar>(x: &mut [S], a: S, b: S) {
    for x in x {
        *x = a.mul_add(*x, b);
    }
}

/// Updates the lower triangle of an n x n column-major matrix as [`sweep`] updates a vector.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+fma", "x86_64+avx2+fma"))]
fn sweep_triangle<S: Scalar>(x: &mut [S], n: usize, a: S, b: S) {
    for (j, column) in x.chunks_exact_mut(n).enumerate() {
        for x in &mut column[j..] {
            *x = a.mul_add(*x, b);
        }
    }
}

/// Number of independent sums. It is large enough to fill the pipeline of every instruction set.
const SUMS: usize = 128;

/// Carries out `rounds` multiplications and additions in each of [`SUMS`] numbers that stay in registers.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+fma", "x86_64+avx2+fma"))]
fn multiply_and_add<S: Scalar>(sums: &mut [S; SUMS], rounds: usize, a: S, b: S) {
    let mut inside = *sums;
    for _ in 0..rounds {
        for x in &mut inside {
            *x = a.mul_add(*x, b);
        }
    }
    *sums = inside;
}

/// An N x N matrix that is traversed repeatedly. Its entries converge to 1, so that they stay ordinary numbers.
pub struct Pass<S> {
    matrix: Vec<S>,
    size: usize,
    a: S,
    b: S,
}

impl<S: Scalar> Pass<S> {
    /// Creates a matrix of `size` x `size`.
    pub fn new(size: usize) -> Self {
        Self { matrix: vec![S::zero(); size * size], size, a: S::from_f64(0.9), b: S::from_f64(0.1) }
    }

    /// Reads and writes the whole matrix once.
    pub fn full(&mut self) {
        sweep(&mut self.matrix, self.a, self.b);
        black_box(&mut self.matrix);
    }

    /// Reads and writes the lower triangle once.
    pub fn triangle(&mut self) {
        sweep_triangle(&mut self.matrix, self.size, self.a, self.b);
        black_box(&mut self.matrix);
    }
}

/// Smallest duration of a measurement of a limit in s, and the number of measurements whose median is used.
const LEAST_S: f64 = 1e-3;
const REPEATS: usize = 9;

/// Returns the median time of one call of `work` in s.
pub fn time(mut work: impl FnMut()) -> f64 {
    // The first call brings the matrix into the caches.
    work();
    let mut calls = 1_usize;
    loop {
        let start = Instant::now();
        (0..calls).for_each(|_| work());
        if start.elapsed().as_secs_f64() >= LEAST_S {
            break;
        }
        calls *= 2;
    }
    let mut times: [f64; REPEATS] = std::array::from_fn(|_| {
        let start = Instant::now();
        (0..calls).for_each(|_| work());
        start.elapsed().as_secs_f64() / calls as f64
    });
    times.sort_by(f64::total_cmp);
    times[REPEATS / 2]
}

/// Returns the time in s of a pass over a whole N x N matrix, and over one triangle.
pub fn passes<S: Scalar>(size: usize) -> [f64; 2] {
    let mut pass = Pass::<S>::new(size);
    [time(|| pass.full()), time(|| pass.triangle())]
}

/// Returns the number of multiplications and additions per second of one core in registers.
pub fn peak<S: Scalar>() -> f64 {
    const ROUNDS: usize = 1000;
    let mut sums = [S::one(); SUMS];
    let seconds = time(|| {
        multiply_and_add(&mut sums, ROUNDS, S::from_f64(0.9), S::from_f64(0.1));
        black_box(&mut sums);
    });
    (2 * SUMS * ROUNDS) as f64 / seconds
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pass_reads_and_writes_every_entry_of_what_it_goes_over() {
        let mut pass = Pass::<f64>::new(5);
        pass.matrix.fill(2.0);
        pass.triangle();
        for j in 0..5 {
            for i in 0..5 {
                assert!((pass.matrix[i + 5 * j] - if i >= j { 1.9 } else { 2.0 }).abs() < 1e-15);
            }
        }
        pass.full();
        assert!((pass.matrix[24] - 1.81).abs() < 1e-15 && (pass.matrix[20] - 1.9).abs() < 1e-15);
    }

    #[test]
    fn the_peak_does_all_its_sums() {
        let mut sums = [2.0_f32; SUMS];
        multiply_and_add(&mut sums, 2, 0.5, 1.0);
        assert_eq!(sums, [2.0; SUMS]);
        let mut sums = [4.0_f32; SUMS];
        multiply_and_add(&mut sums, 3, 0.5, 1.0);
        assert_eq!(sums, [2.25; SUMS]);
    }
}
