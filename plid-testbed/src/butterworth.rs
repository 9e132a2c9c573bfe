//! The discrete Butterworth low-pass filter that shapes the command.

use std::f64::consts::PI;

/// A Butterworth low-pass filter of even order: the analogue filter mapped by the bilinear transform,
/// pre-warped so that the gain at the cut-off is exactly that of the analogue one (-3.01 dB).
#[derive(Clone, Debug)]
pub struct Butterworth {
    sections: Vec<Section>,
}

/// y_k = b (x_k + 2 x_{k-1} + x_{k-2}) - a_1 y_{k-1} - a_2 y_{k-2}, in transposed direct form II.
#[derive(Clone, Debug)]
struct Section {
    b: f64,
    a: [f64; 2],
    state: [f64; 2],
}

impl Butterworth {
    /// Creates a filter of `pairs` pole pairs (order `2 * pairs`), at rest. The cut-off must lie between 0 and half
    /// the sample rate.
    #[must_use]
    pub fn low_pass(pairs: usize, cutoff_hz: f64, sample_rate_hz: f64) -> Self {
        let k = (PI * cutoff_hz / sample_rate_hz).tan();
        let sections = (0..pairs)
            .map(|i| {
                // 1 / Q of the pair's analogue section s^2 + s / Q + 1.
                let damping = 2.0 * (PI * (2 * i + 1) as f64 / (4 * pairs) as f64).sin();
                let scale = 1.0 / (1.0 + damping * k + k * k);
                Section {
                    b: k * k * scale,
                    a: [2.0 * (k * k - 1.0) * scale, (1.0 - damping * k + k * k) * scale],
                    state: [0.0; 2],
                }
            })
            .collect();
        Self { sections }
    }

    /// Returns the next filtered sample.
    pub fn filter(&mut self, input: f64) -> f64 {
        self.sections.iter_mut().fold(input, |x, s| {
            let y = s.b * x + s.state[0];
            s.state[0] = 2.0 * s.b * x - s.a[0] * y + s.state[1];
            s.state[1] = s.b * x - s.a[1] * y;
            y
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the gain at a frequency, computed from the impulse response and thus independent of the coefficients.
    fn gain_db(pairs: usize, cutoff_hz: f64, sample_rate_hz: f64, f: f64) -> f64 {
        let mut filter = Butterworth::low_pass(pairs, cutoff_hz, sample_rate_hz);
        let (mut re, mut im) = (0.0, 0.0);
        for k in 0..4000 {
            let h = filter.filter(if k == 0 { 1.0 } else { 0.0 });
            let phase = 2.0 * PI * f / sample_rate_hz * k as f64;
            re += h * phase.cos();
            im -= h * phase.sin();
        }
        10.0 * (re * re + im * im).log10()
    }

    #[test]
    fn sixth_order_at_200_hz_is_three_decibels_down_there_and_flat_below() {
        assert!((gain_db(3, 200.0, 1600.0, 200.0) + 10.0 * 2.0_f64.log10()).abs() < 1e-9);
        assert!(gain_db(3, 200.0, 1600.0, 0.0).abs() < 1e-9);
        assert!(gain_db(3, 200.0, 1600.0, 100.0).abs() < 1e-3);
    }

    #[test]
    fn magnitude_is_the_analogue_one_at_the_warped_frequency() {
        for f in [50.0, 150.0, 190.0, 210.0, 300.0, 400.0] {
            let warped = (PI * f / 1600.0).tan() / (PI * 200.0 / 1600.0).tan();
            let expected = -10.0 * (1.0 + warped.powi(12)).log10();
            assert!((gain_db(3, 200.0, 1600.0, f) - expected).abs() < 1e-6, "{f} Hz");
        }
    }

    #[test]
    fn slope_is_36_decibels_an_octave_where_the_sampling_is_fine() {
        let slope = gain_db(3, 200.0, 51_200.0, 400.0) - gain_db(3, 200.0, 51_200.0, 800.0);
        assert!((slope - 36.1).abs() < 0.2, "{slope} dB an octave");
    }
}
