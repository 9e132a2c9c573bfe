//! A mass without a spring, with a pole at the origin. The slider runs in a bearing with a damper, and its position
//! is measured. The free slider floats on air, and its speed is measured.

use std::f64::consts::TAU;

use rand::RngExt;
use rand_chacha::ChaCha12Rng;

use super::Layout;
use crate::axes::{Axes, Shown};
use crate::gap::rig::{Rig, axis_rate_hz};

/// The pole (damping over mass) in Hz, over the sample rate.
const POLE: std::ops::Range<f64> = 0.002..0.005;
/// Cut-off of the commands over the pole.
const BAND: std::ops::Range<f64> = 3.0..6.0;

pub(super) fn layout(rng: &mut ChaCha12Rng) -> Layout {
    let rate_hz = axis_rate_hz(rng);
    let pole = rng.random_range(POLE);
    let band = pole * rng.random_range(BAND);
    Layout::of_axes(bearing(pole * rate_hz), Rig::of_axes(rate_hz, band, rng))
}

/// Creates a slider whose damper gives a pole at `pole_hz`.
pub(super) fn bearing(pole_hz: f64) -> Axes {
    Axes::single(TAU * pole_hz, 0.0, Shown::Position)
}

pub(super) fn floating(rng: &mut ChaCha12Rng) -> Layout {
    let rate_hz = axis_rate_hz(rng);
    let band = rng.random_range(POLE) * rng.random_range(BAND);
    Layout::of_axes(Axes::single(0.0, 0.0, Shown::Velocity), Rig::of_axes(rate_hz, band, rng))
}
