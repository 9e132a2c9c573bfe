//! A slider or an arm under position control (proportional, and derivative on the measured motion), whose reference
//! is the input. The controller is continuous, and it is part of the simulation.

use std::f64::consts::TAU;

use nalgebra::DMatrix;
use rand::RngExt;
use rand_chacha::ChaCha12Rng;

use super::{Layout, arm, slider};
use crate::axes::{Axes, Shown};
use crate::gap::rig::{Rig, axis_rate_hz};

/// Natural frequency of the loop of an axis over the sample rate.
const FREQUENCY: std::ops::Range<f64> = 0.006..0.012;
const DAMPING_RATIO: std::ops::Range<f64> = 0.4..0.8;
/// The bearing's pole over the natural frequency.
const BEARING: std::ops::Range<f64> = 0.05..0.2;
/// Cut-off of the references over the natural frequency.
const BAND: std::ops::Range<f64> = 1.5..2.5;

pub(super) fn of_slider(rng: &mut ChaCha12Rng) -> Layout {
    let rate_hz = axis_rate_hz(rng);
    let frequency = rng.random_range(FREQUENCY);
    let slider = slider::bearing(rng.random_range(BEARING) * frequency * rate_hz);
    held(slider, rate_hz, frequency, rng)
}

pub(super) fn of_arm(rng: &mut ChaCha12Rng) -> Layout {
    let rate_hz = axis_rate_hz(rng);
    let frequency = rng.random_range(FREQUENCY);
    let inertia = arm::inertia(rng);
    let bearings = &inertia * (TAU * rng.random_range(BEARING) * frequency * rate_hz);
    let damping = DMatrix::from_diagonal(&bearings.diagonal());
    let stiffness = DMatrix::zeros(2, 2);
    let arm = Axes { inertia, damping, stiffness, drive: vec![1.0; 2], shown: Shown::Position };
    held(arm, rate_hz, frequency, rng)
}

/// Closes the loops. Each axis has its own controller, with gains for the axis alone. The output is in the unit of the
/// reference.
fn held(axes: Axes, rate_hz: f64, frequency: f64, rng: &mut ChaCha12Rng) -> Layout {
    let w = TAU * frequency * rate_hz;
    let ratio = rng.random_range(DAMPING_RATIO);
    let gains: Vec<(f64, f64)> = axes.inertia.diagonal().iter().map(|m| (m * w * w, 2.0 * ratio * m * w)).collect();
    let band = frequency * rng.random_range(BAND);
    Layout::of_axes(axes.held(&gains), Rig { output_v: None, ..Rig::of_axes(rate_hz, band, rng) })
}
