//! A delay by any number of steps, as a sum of earlier values.

use super::action::Memory;

/// Largest number of consecutive edges over which a step between two edges is distributed.
const EDGES: usize = 6;

/// Number of values for a measurement that is late by less than two samples.
const FEW: usize = 4;

/// The weights of the earlier values.
pub(super) struct Taps {
    /// The number of steps to the latest of the values.
    first: usize,
    /// Weights of Lagrange interpolation, whose moments are exact up to the fifth with six values. With two edges, a
    /// command that was late by a tenth of a sample was wrong by 6 %, and with three edges, every delay was up to 1 %
    /// too short.
    weights: Vec<f64>,
}

impl Taps {
    /// Creates a delay of a held command by a number of steps.
    pub fn of_command(steps: f64) -> Self {
        Self::new(steps, EDGES)
    }

    /// Creates a delay of a measurement by a number of samples. With six values, a delay by half a sample would lie
    /// near their end and amplify high frequencies by 2.5, which could make a loop unstable. With four, the gain is at
    /// most 1.2.
    pub fn of_measurement(samples: f64) -> Self {
        Self::new(samples, if samples < 2.0 { FEW } else { EDGES })
    }

    fn new(steps: f64, edges: usize) -> Self {
        let first = (steps.floor() as usize).saturating_sub(edges / 2 - 1);
        let at = steps - first as f64;
        let weight = |j: usize| {
            let others = (0..edges).filter(|i| *i != j).map(|i| i as f64);
            others.map(|i| (at - i) / (j as f64 - i)).product()
        };
        Self { first, weights: (0..edges).map(weight).collect() }
    }

    /// Delays a channel in place. It had the value `before` before the record.
    pub fn apply(&self, (channel, signal): (usize, &mut [f64]), before: f64, memory: &mut Memory) {
        let whole = memory.followed_by(channel, signal, self.first + self.weights.len());
        signal.fill(0.0);
        for (weight, back) in self.weights.iter().zip(self.first..) {
            let (from, missing) = whole.all_back(back);
            let missing = missing.min(signal.len());
            signal[..missing].iter_mut().for_each(|to| *to += weight * before);
            signal[missing..].iter_mut().zip(from).for_each(|(to, from)| *to += weight * from);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moments_of_a_spread_step_are_those_of_a_sharp_one() {
        for steps in [0.0, 0.3, 1.0, 1.9, 2.0, 2.7, 40.25] {
            for Taps { first, weights } in [Taps::of_command(steps), Taps::of_measurement(steps)] {
                for power in 0..weights.len() as i32 {
                    let moment: f64 =
                        weights.iter().enumerate().map(|(j, w)| w * ((first + j) as f64 - steps).powi(power)).sum();
                    let expected = if power == 0 { 1.0 } else { 0.0 };
                    assert!((moment - expected).abs() < 1e-10, "{steps} {power} {moment}");
                }
            }
        }
    }

    /// Up to a tenth of the sample rate, a delayed measurement is wrong by at most 0.7 %. No frequency is amplified by
    /// more than 1.2.
    #[test]
    fn a_delayed_measurement_is_hardly_amplified() {
        for samples in (1..50).map(|k| 0.1 * f64::from(k)) {
            let Taps { first, weights } = Taps::of_measurement(samples);
            for share in (0..=50).map(|k| 0.01 * f64::from(k)) {
                let turn = |by: f64| plid_fourier::C::cis(-std::f64::consts::TAU * share * by);
                let gain: plid_fourier::C =
                    weights.iter().enumerate().map(|(j, weight)| turn((first + j) as f64) * *weight).sum();
                assert!(gain.norm() < 1.2, "{samples} {share}: {gain}");
                assert!(share > 0.1 || (gain - turn(samples)).norm() < 7e-3, "{samples} {share}: {gain}");
            }
        }
    }

    /// A signal that is delayed in short pieces is delayed as a whole, also by more than its length.
    #[test]
    fn pieces_are_delayed_as_the_whole() {
        let signal: Vec<f64> = (0..40).map(|k| (f64::from(k) * 0.7).sin()).collect();
        for taps in [0.4, 1.5, 7.25, 100.0].into_iter().flat_map(|by| [Taps::of_command(by), Taps::of_measurement(by)])
        {
            let mut whole = signal.clone();
            taps.apply((0, &mut whole), 0.3, &mut Memory::default());
            let (mut pieces, mut memory) = (signal.clone(), Memory::default());
            pieces.chunks_mut(3).for_each(|piece| taps.apply((0, piece), 0.3, &mut memory));
            assert_eq!(whole, pieces);
        }
    }
}
