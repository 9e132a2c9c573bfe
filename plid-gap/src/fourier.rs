//! Complex numbers and Fourier transforms of real signals.

use std::cell::RefCell;

use realfft::RealFftPlanner;
use realfft::num_complex::Complex;

/// A complex number.
pub type C = Complex<f64>;

thread_local! {
    static PLANNER: RefCell<RealFftPlanner<f64>> = RefCell::new(RealFftPlanner::new());
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
    forward_of(&mut x.to_vec())
}

/// Returns the same as [`forward`], and leaves other values in `x`.
pub fn forward_of(x: &mut [f64]) -> Vec<C> {
    if x.is_empty() {
        return Vec::new();
    }
    let transform = PLANNER.with(|planner| planner.borrow_mut().plan_fft_forward(x.len()));
    let mut bins = transform.make_output_vec();
    transform.process(x, &mut bins).expect("the lengths are those of the plan");
    bins
}

/// Returns the real signal of length `n` whose transform has these bins from 0 to n/2.
pub fn backward(bins: &[C], n: usize) -> Vec<f64> {
    let mut bins = bins.to_vec();
    // The transform of a real signal is real at zero and at half the sample rate.
    bins[0].im = 0.0;
    if n.is_multiple_of(2) {
        bins[n / 2].im = 0.0;
    }
    let transform = PLANNER.with(|planner| planner.borrow_mut().plan_fft_inverse(n));
    let mut x = transform.make_output_vec();
    transform.process(&mut bins, &mut x).expect("the lengths are those of the plan");
    x.iter_mut().for_each(|x| *x /= n as f64);
    x
}
