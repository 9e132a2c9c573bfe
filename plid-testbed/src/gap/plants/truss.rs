//! One mode of each of three tubes of the truss, its five dominant modes and the two above them. The shapes are drawn
//! about the truss's own, and the frequencies about those below.

use rand::RngExt;
use rand_chacha::ChaCha12Rng;

use super::{Layout, about, normal};
use crate::structure::{DOMINANT, Mode, ModeGroup, TRUNCATED, platform_mode, tube_mode};

/// Frequencies about which the ten modes are drawn, Hz.
const FREQUENCIES_HZ: [f64; 10] = [57.0, 60.5, 64.0, 136.0, 168.0, 186.0, 210.0, 240.0, 295.0, 345.0];
/// Relative standard deviation of a frequency.
const SCATTER: f64 = 0.02;

pub(super) fn layout(rng: &mut ChaCha12Rng) -> Layout {
    Layout::new(modes(rng), 3..7, 3..8)
}

pub(super) fn modes(rng: &mut ChaCha12Rng) -> Vec<Mode> {
    let tubes = [0, 2, 4].map(|tube| tube_mode(tube, 0));
    let dominant = DOMINANT.iter().map(|row| platform_mode(row, ModeGroup::Dominant));
    let truncated = TRUNCATED[..2].iter().map(|row| platform_mode(row, ModeGroup::Truncated));
    tubes
        .into_iter()
        .chain(dominant)
        .chain(truncated)
        .zip(FREQUENCIES_HZ)
        .map(|(mode, frequency_hz)| {
            let mut entry = |value: f64| value * (1.0 + 0.1 * normal(rng));
            let (input_shape, output_shape) = (mode.input_shape.map(&mut entry), mode.output_shape.map(&mut entry));
            let frequency_hz = about(frequency_hz, SCATTER, rng);
            let damping_ratio = rng.random_range(0.005..0.015);
            Mode { frequency_hz, damping_ratio, input_shape, output_shape, ..mode }
        })
        .collect()
}
