//! A uniform beam on two supports, in bending: w_n = n^2 w_1 with the shapes sqrt(2) sin(n pi x), x from 0 to 1.

use std::f64::consts::{PI, SQRT_2};

use rand::RngExt;
use rand_chacha::ChaCha12Rng;

use super::{Layout, about};
use crate::structure::{Mode, ModeGroup};

/// Number of modes, up to 490 Hz, which is beyond the band of the commands.
const MODES: usize = 6;
/// Value about which the first frequency is drawn, Hz.
const FIRST_HZ: f64 = 13.5;
/// Places of the actuators: at no node of a low mode, and on both sides of the middle.
const ACTUATORS: [f64; 3] = [0.11, 0.37, 0.71];
/// Distance of each accelerometer from its actuator.
const BESIDE: f64 = 0.02;

pub(super) fn layout(rng: &mut ChaCha12Rng) -> Layout {
    let first_hz = about(FIRST_HZ, 0.03, rng);
    let actuators = ACTUATORS.map(|x| x + rng.random_range(-0.03..0.03));
    let modes = (1..=MODES)
        .map(|n| {
            let shape = |x: f64| SQRT_2 * (n as f64 * PI * x).sin();
            Mode {
                frequency_hz: (n * n) as f64 * first_hz,
                damping_ratio: rng.random_range(0.005..0.015),
                input_shape: actuators.map(shape),
                output_shape: actuators.map(|x| shape(x + BESIDE)),
                group: ModeGroup::Dominant,
            }
        })
        .collect();
    Layout::new(modes, 1..4, 1..4)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    /// A constant force of 1 at x gives a displacement of x^2 (1 - x)^2 / (3 E I) there, where w_1^2 = pi^4 E I for
    /// unit length and mass.
    #[test]
    fn it_is_as_compliant_as_a_beam() {
        for seed in 0..5 {
            let modes = layout(&mut ChaCha12Rng::seed_from_u64(seed)).plant.modes;
            let rigidity = modes[0].angular_frequency().powi(2) / PI.powi(4);
            for j in 0..3 {
                // The first two shapes determine x: sin(2 a) / sin(a) = 2 cos(a).
                let x = (modes[1].input_shape[j] / modes[0].input_shape[j] / 2.0).acos() / PI;
                let found: f64 = modes.iter().map(|m| (m.input_shape[j] / m.angular_frequency()).powi(2)).sum();
                let expected = (x * (1.0 - x)).powi(2) / (3.0 * rigidity);
                // Each mode n above the sixth would add at most 2 / ((pi n)^4 E I).
                let rest = (7..1000).map(|n| 2.0 / (PI * f64::from(n)).powi(4)).sum::<f64>() / rigidity;
                assert!(found < expected && expected < found + rest, "{seed}, {j}: {found} for {expected}");
                assert!((x - ACTUATORS[j]).abs() < 0.03);
            }
        }
    }
}
