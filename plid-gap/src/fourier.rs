//! Complex numbers and Fourier transforms of real signals.
//!
//! The transforms are complex ones of `rustfft`. Its real transforms (`realfft`) need half the operations, but no less
//! code here, and they round differently. The searches of a diagnosis end at a finite gain, so a difference of rounding
//! would show in the digits that a diagnosis states.

use std::cell::RefCell;

use rustfft::{FftPlanner, num_complex::Complex};

/// A complex number.
pub type C = Complex<f64>;

thread_local! {
    static PLANNER: RefCell<FftPlanner<f64>> = RefCell::new(FftPlanner::new());
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

/// Returns bins 0 to n/2 of the transform of `x`, unscaled.
pub fn forward(x: &[f64]) -> Vec<C> {
    let mut whole: Vec<Complex<f64>> = x.iter().map(|&x| Complex::new(x, 0.0)).collect();
    PLANNER.with(|planner| planner.borrow_mut().plan_fft_forward(x.len())).process(&mut whole);
    whole.truncate(x.len() / 2 + 1);
    whole.into_iter().map(|z| C::new(z.re, z.im)).collect()
}

/// Returns the real signal of length `n` whose transform has these bins from 0 to n/2.
pub fn backward(bins: &[C], n: usize) -> Vec<f64> {
    let at = |k: usize| {
        let z = if k < bins.len() { bins[k] } else { bins[n - k].conj() };
        Complex::new(z.re, z.im)
    };
    let mut whole: Vec<Complex<f64>> = (0..n).map(at).collect();
    // The transform of a real signal is real at zero and at half the sample rate.
    whole[0].im = 0.0;
    if n.is_multiple_of(2) {
        whole[n / 2].im = 0.0;
    }
    PLANNER.with(|planner| planner.borrow_mut().plan_fft_inverse(n)).process(&mut whole);
    whole.iter().map(|z| z.re / n as f64).collect()
}
