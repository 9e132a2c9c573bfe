//! Complex numbers and Fourier transforms of real signals.

use nalgebra::Complex;
pub use plid_model::signal::fourier::{backward, forward};

/// A complex number.
pub type C = Complex<f64>;

/// The smallest length from `least` on that has no prime factor above 5.
pub fn good_length(least: usize) -> usize {
    (least.max(1)..).find(|&n| smooth(n)).expect("there is always one")
}

/// The largest length up to `most` that has no prime factor above 5.
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
