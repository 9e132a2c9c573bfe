//! A position servo: commanded position in, position out, of second order and well damped.

use std::f64::consts::TAU;

use rand::RngExt;
use rand_chacha::ChaCha12Rng;

use super::Layout;
use crate::axes::{Axes, Shown};
use crate::gap::rig::{Rig, axis_rate_hz};

/// Natural frequency over the sample rate.
const FREQUENCY: std::ops::Range<f64> = 0.006..0.015;
const DAMPING_RATIO: std::ops::Range<f64> = 0.5..0.9;
/// Cut-off of the commands over the natural frequency.
const BAND: std::ops::Range<f64> = 1.5..3.0;

pub(super) fn layout(rng: &mut ChaCha12Rng) -> Layout {
    let rate_hz = axis_rate_hz(rng);
    let frequency = rng.random_range(FREQUENCY);
    let w = TAU * frequency * rate_hz;
    let damping = 2.0 * rng.random_range(DAMPING_RATIO) * w;
    let mut axes = Axes::single(damping, w * w, Shown::Position);
    // At rest, the servo is at its commanded position.
    axes.drive = vec![w * w];
    let band = frequency * rng.random_range(BAND);
    Layout::of_axes(axes, Rig { output_v: None, ..Rig::of_axes(rate_hz, band, rng) })
}
