//! A mass that no spring holds, with a pole at the origin. The slider runs in a bearing with a damper and shows its
//! position; the free slider floats on air and shows its speed.

use std::f64::consts::TAU;

use rand::RngExt;
use rand_chacha::ChaCha12Rng;

use super::Layout;
use crate::axes::{Axes, Shown};
use crate::gap::rig::{Rig, axis_rate_hz};

/// Damping over mass and the sample rate, in periods.
const POLE: std::ops::Range<f64> = 0.002..0.005;
/// Cut-off of the commands over that.
const BAND: std::ops::Range<f64> = 3.0..6.0;

pub(super) fn layout(rng: &mut ChaCha12Rng) -> Layout {
    let rate_hz = axis_rate_hz(rng);
    let pole = rng.random_range(POLE);
    let band = pole * rng.random_range(BAND);
    Layout::of_axes(bearing(pole * rate_hz), Rig::of_axes(rate_hz, band, rng))
}

/// A slider whose damper has its pole there, Hz.
pub(super) fn bearing(pole_hz: f64) -> Axes {
    Axes::single(TAU * pole_hz, 0.0, Shown::Position)
}

pub(super) fn floating(rng: &mut ChaCha12Rng) -> Layout {
    let rate_hz = axis_rate_hz(rng);
    let band = rng.random_range(POLE) * rng.random_range(BAND);
    Layout::of_axes(Axes::single(0.0, 0.0, Shown::Velocity), Rig::of_axes(rate_hz, band, rng))
}
