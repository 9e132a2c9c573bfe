//! Discrete Fourier transforms of real signals.
//!
//! The transforms of the library `rustfft` are generic, so each crate that calls them would compile all of them. Only
//! this crate calls them.

use std::cell::RefCell;

use realfft::RealFftPlanner;

pub use realfft::num_complex::Complex64;

/// A complex number. The short name keeps equations short.
pub type C = Complex64;

thread_local! {
    static PLANNER: RefCell<RealFftPlanner<f64>> = RefCell::new(RealFftPlanner::new());
}

/// Returns lines 0 to n/2 of the unscaled transform of `x` (n samples); none if `x` is empty.
pub fn forward(x: &[f64]) -> Vec<Complex64> {
    forward_of(&mut x.to_vec())
}

/// Computes [`forward`] without a copy: `x` is used as scratch space.
pub fn forward_of(x: &mut [f64]) -> Vec<Complex64> {
    if x.is_empty() {
        return Vec::new();
    }
    let plan = PLANNER.with(|planner| planner.borrow_mut().plan_fft_forward(x.len()));
    let mut lines = plan.make_output_vec();
    plan.process(x, &mut lines).expect("the buffers have the lengths of the plan");
    lines
}

/// Returns the real signal of `n` samples whose transform has the lines 0 to n/2.
///
/// # Panics
/// Panics if there are fewer than n/2 + 1 lines.
pub fn backward(lines: &[Complex64], n: usize) -> Vec<f64> {
    if n == 0 {
        return Vec::new();
    }
    let plan = PLANNER.with(|planner| planner.borrow_mut().plan_fft_inverse(n));
    let mut lines = lines[..=n / 2].to_vec();
    // The lines at zero and at half the rate of a real signal are real.
    lines[0].im = 0.0;
    if n.is_multiple_of(2) {
        lines[n / 2].im = 0.0;
    }
    let mut signal = plan.make_output_vec();
    plan.process(&mut lines, &mut signal).expect("the buffers have the lengths of the plan");
    signal.iter().map(|x| x / n as f64).collect()
}

/// Returns sum_t x_t x_{t+k} for k = 0 .. n - 1, by a transform long enough to avoid wrap-around.
pub fn sums_of_products(x: &[f64]) -> Vec<f64> {
    let mut padded = x.to_vec();
    padded.resize((2 * x.len()).next_power_of_two(), 0.0);
    let power: Vec<Complex64> = forward(&padded).iter().map(|z| z.norm_sqr().into()).collect();
    let mut sums = backward(&power, padded.len());
    sums.truncate(x.len());
    sums
}

/// Returns the smallest length from `least` on that has no prime factor above 5.
pub fn good_length(least: usize) -> usize {
    (least.max(1)..).find(|&n| smooth(n)).expect("there is always one")
}

/// Returns the largest length up to `most` that has no prime factor above 5.
pub fn good_length_below(most: usize) -> usize {
    (1..=most).rev().find(|&n| smooth(n)).unwrap_or(0)
}

fn smooth(mut n: usize) -> bool {
    for prime in [2, 3, 5] {
        while n.is_multiple_of(prime) {
            n /= prime;
        }
    }
    n == 1
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    #[test]
    fn the_transform_is_its_definition_and_has_an_inverse() {
        for n in [1, 2, 3, 8, 15, 60] {
            let x: Vec<f64> = (0..n).map(|k| ((k * k) % 7) as f64 - 2.5).collect();
            let lines = forward(&x);
            assert_eq!(lines.len(), n / 2 + 1);
            for (line, found) in lines.iter().enumerate() {
                let term = |(k, x): (usize, &f64)| Complex64::cis(-TAU * (line * k % n) as f64 / n as f64) * x;
                let expected: Complex64 = x.iter().enumerate().map(term).sum();
                assert!((found - expected).norm() < 1e-12 * n as f64, "{n}, line {line}: {found} for {expected}");
            }
            for (again, x) in backward(&lines, n).iter().zip(&x) {
                assert!((again - x).abs() < 1e-13 * n as f64);
            }
        }
        assert!(forward(&[]).is_empty() && backward(&[], 0).is_empty());
    }

    #[test]
    fn products_worked_by_hand() {
        for (sum, expected) in sums_of_products(&[1.0, -2.0, 3.0]).iter().zip([14.0, -8.0, 3.0]) {
            assert!((sum - expected).abs() < 1e-12);
        }
    }
}
