//! A motor on a bench: torque in, speed out. Its pole is its damping over its inertia.

use std::f64::consts::TAU;

use rand::RngExt;
use rand_chacha::ChaCha12Rng;

use super::Layout;
use crate::axes::{Axes, Shown};
use crate::gap::rig::{Rig, axis_rate_hz};

/// The pole over the sample rate.
const POLE: std::ops::Range<f64> = 0.003..0.008;
/// Cut-off of the commands over the pole.
const BAND: std::ops::Range<f64> = 3.0..5.0;

pub(super) fn layout(rng: &mut ChaCha12Rng) -> Layout {
    let rate_hz = axis_rate_hz(rng);
    let pole = rng.random_range(POLE);
    let axes = Axes::single(TAU * pole * rate_hz, 0.0, Shown::Velocity);
    let band = pole * rng.random_range(BAND);
    Layout::of_axes(axes, Rig::of_axes(rate_hz, band, rng))
}
