//! The testbed against formulas and integrations of its physics that share no code with it.

mod config;
mod effects;
mod experiment;
mod families;
mod gap;
mod gap_axes;
mod gap_imperfect;
mod gap_kinds;
mod golden;
mod laws;
mod noise;
mod physics;
mod plant;

use ndarray::ArrayView2;
use plid_testbed::{ConverterConfig, NoiseConfig, TrussConfig};

/// Without noise and with ideal converters.
fn ideal() -> TrussConfig {
    TrussConfig {
        noise: NoiseConfig::NONE,
        converters: ConverterConfig { step_v: 0.0, range_v: f64::INFINITY },
        ..TrussConfig::default()
    }
}

fn rms(values: impl IntoIterator<Item = f64>) -> f64 {
    let (mut sum, mut count) = (0.0, 0);
    for v in values {
        sum += v * v;
        count += 1;
    }
    (sum / f64::from(count)).sqrt()
}

fn largest(signal: ArrayView2<f64>) -> f64 {
    signal.iter().fold(0.0, |most, v| v.abs().max(most))
}
