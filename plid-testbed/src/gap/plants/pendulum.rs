//! A pendulum that is driven at its axis, and whose angle is measured. The simulation is that of small angles.

use std::f64::consts::TAU;

use rand::RngExt;
use rand_chacha::ChaCha12Rng;

use super::Layout;
use crate::axes::{Axes, Shown};
use crate::gap::rig::{Rig, axis_rate_hz};

/// Natural frequency over the sample rate.
const FREQUENCY: std::ops::Range<f64> = 0.004..0.008;
const DAMPING_RATIO: std::ops::Range<f64> = 0.03..0.12;
/// Cut-off of the commands over the natural frequency.
const BAND: std::ops::Range<f64> = 1.3..2.5;
/// RMS of its angle, rad.
const SWING: std::ops::Range<f64> = 0.3..0.7;

pub(super) fn layout(rng: &mut ChaCha12Rng) -> Layout {
    let rate_hz = axis_rate_hz(rng);
    let frequency = rng.random_range(FREQUENCY);
    let w = TAU * frequency * rate_hz;
    let axes = Axes::single(2.0 * rng.random_range(DAMPING_RATIO) * w, w * w, Shown::Position);
    let band = frequency * rng.random_range(BAND);
    let swing = rng.random_range(SWING);
    Layout::of_axes(axes, Rig { output_v: Some(swing), ..Rig::of_axes(rate_hz, band, rng) })
}
