//! Motors with a slow lag, a body that is held in heave, roll and pitch, and arms that flex. Above all, the response
//! to a command is late.

use rand::RngExt;
use rand_chacha::ChaCha12Rng;

use super::{Layout, about, normal};
use crate::structure::{Mode, ModeGroup, Row, platform_mode};

/// Value about which the motors' poles are drawn, Hz.
const MOTOR_HZ: f64 = 12.0;
/// The body in heave, roll and pitch, then the arms: frequency (Hz), damping ratio, shapes at the sensors and the
/// motors.
const MODES: [Row; 7] = [
    (2.4, 0.70, [1.00, 0.05, 0.00], [1.00, 0.00, 0.05]),
    (3.7, 0.50, [0.05, 1.00, 0.10], [0.00, 1.00, 0.05]),
    (4.6, 0.55, [0.00, 0.10, 1.00], [0.05, 0.05, 1.00]),
    (48.0, 0.020, [0.30, 0.25, -0.50], [0.35, 0.20, -0.45]),
    (71.0, 0.025, [-0.40, 0.45, 0.20], [-0.35, 0.50, 0.15]),
    (96.0, 0.020, [0.20, -0.55, 0.30], [0.25, -0.50, 0.30]),
    (133.0, 0.030, [-0.45, -0.20, -0.40], [-0.40, -0.25, -0.45]),
];

pub(super) fn layout(rng: &mut ChaCha12Rng) -> Layout {
    let modes = MODES
        .iter()
        .map(|row| {
            let mode = platform_mode(row, ModeGroup::Dominant);
            let mut entry = |value: f64| value * (1.0 + 0.1 * normal(rng));
            let (input_shape, output_shape) = (mode.input_shape.map(&mut entry), mode.output_shape.map(&mut entry));
            let frequency_hz = about(mode.frequency_hz, 0.03, rng);
            let damping_ratio = mode.damping_ratio * rng.random_range(0.8..1.25);
            Mode { frequency_hz, damping_ratio, input_shape, output_shape, ..mode }
        })
        .collect();
    let mut layout = Layout::new(modes, 3..7, 3..7);
    layout.plant.poles_hz = [MOTOR_HZ; 3].map(|hz| about(hz, 0.05, rng));
    layout
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    #[test]
    fn the_motors_are_slower_than_every_arm_and_the_body_does_not_ring() {
        for seed in 0..10 {
            let plant = layout(&mut ChaCha12Rng::seed_from_u64(seed)).plant;
            for pole_hz in plant.poles_hz {
                assert!(
                    plant.modes[3..].iter().all(|arm| arm.frequency_hz > 3.0 * pole_hz && arm.damping_ratio < 0.05)
                );
                assert!(plant.modes[..3].iter().all(|body| body.frequency_hz < pole_hz && body.damping_ratio > 0.3));
            }
        }
    }
}
