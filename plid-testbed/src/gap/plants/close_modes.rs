//! The truss with two pairs of modes that lie closer than their half-power widths.

use rand::RngExt;
use rand_chacha::ChaCha12Rng;

use super::{Layout, truss};

/// The lower mode of each pair, from 0; the next mode is moved close to it.
const PAIRS: [usize; 2] = [3, 5];
/// Distance of the two modes, relative to the half-power width 2 zeta f of the lower one.
const APART: std::ops::Range<f64> = 0.3..1.0;

pub(super) fn layout(rng: &mut ChaCha12Rng) -> Layout {
    let mut modes = truss::modes(rng);
    for lower in PAIRS {
        let below = &modes[lower];
        let width_hz = 2.0 * below.damping_ratio * below.frequency_hz;
        modes[lower + 1].frequency_hz = below.frequency_hz + rng.random_range(APART) * width_hz;
    }
    Layout::new(modes, 3..7, 3..8)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    #[test]
    fn each_pair_is_closer_than_its_modes_are_wide_and_no_other_is() {
        for seed in 0..20 {
            let modes = layout(&mut ChaCha12Rng::seed_from_u64(seed)).plant.modes;
            for w in 3..7 {
                let apart_hz = modes[w + 1].frequency_hz - modes[w].frequency_hz;
                let width_hz = 2.0 * modes[w].damping_ratio * modes[w].frequency_hz;
                assert!(apart_hz > 0.0, "seed {seed}");
                assert_eq!(apart_hz < width_hz, PAIRS.contains(&w), "seed {seed}: {apart_hz} of {width_hz} Hz");
            }
        }
    }
}
