//! The frequency band of a channel, and whether the sample rate is high compared with it.
use super::Segment;
use crate::Warning;
use ndarray::ArrayView1;
use plid_model::signal::mean;
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// The frequency band with 99 % of a channel's power. Half a per cent of the power lies on either side of it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Band {
    /// The channel.
    pub channel: String,
    /// Lower edge in Hz.
    pub low_hz: f64,
    /// Upper edge in Hz.
    pub high_hz: f64,
}

/// A band narrower than this share of the Nyquist frequency causes a warning.
const NARROW: f64 = 0.2;
/// The rate is high if the data are below this share of it.
const OVERSAMPLED: f64 = 0.125;
/// Ratio of the suggested rate to the upper edge of the band. The anti-alias filter passes frequencies up to 0.4 of the
/// new rate, and a quarter more leaves room for the power beyond the edge.
const RATE_OVER_BAND: f64 = 3.125;

/// Returns the bands of the inputs and of the outputs.
pub fn bands(segments: &[Segment], input_names: &[String], output_names: &[String], rate_hz: f64) -> [Vec<Band>; 2] {
    let inputs = input_names
        .iter()
        .enumerate()
        .map(|(j, name)| band(name, segments.iter().map(|s| s.inputs.column(j)), rate_hz));
    let outputs = output_names
        .iter()
        .enumerate()
        .map(|(j, name)| band(name, segments.iter().map(|s| s.outputs.column(j)), rate_hz));
    [inputs.collect(), outputs.collect()]
}

/// Returns warnings about narrow inputs, and about a rate that is high compared with the band of the data.
///
/// A model can be identified only where both the inputs and the outputs have power, so the band of the data is the
/// lower one of the widest input's and the widest output's.
pub fn warnings(inputs: &[Band], outputs: &[Band], rate_hz: f64) -> Vec<Warning> {
    let nyquist = rate_hz / 2.0;
    let mut warnings: Vec<Warning> = inputs
        .iter()
        .filter(|b| b.high_hz > 0.0 && b.high_hz - b.low_hz < NARROW * nyquist)
        .map(|b| Warning::NarrowBand { channel: b.channel.clone(), low_hz: b.low_hz, high_hz: b.high_hz })
        .collect();
    if let Some((band_hz, ratio)) = oversampled(inputs, outputs, rate_hz) {
        warnings.push(Warning::Oversampled { rate_hz, band_hz, suggested_hz: rate_hz / ratio });
    }
    warnings
}

/// Returns the upper edge of the band of the data in Hz and the factor by which the rate should be lower, if it is high
/// compared with that band.
pub fn oversampled(inputs: &[Band], outputs: &[Band], rate_hz: f64) -> Option<(f64, f64)> {
    let widest = |bands: &[Band]| bands.iter().map(|b| b.high_hz).fold(0.0, f64::max);
    let band_hz = widest(inputs).min(widest(outputs));
    let high = band_hz > 0.0 && band_hz < OVERSAMPLED * rate_hz;
    high.then(|| (band_hz, (rate_hz / (RATE_OVER_BAND * band_hz)).floor().max(1.0)))
}

/// Computes the band from the accumulated power spectrum of the longest part. A constant channel has the band from 0 to
/// 0 Hz.
fn band<'a>(channel: &str, parts: impl Iterator<Item = ArrayView1<'a, f64>>, rate_hz: f64) -> Band {
    let power = parts.max_by_key(|part| part.len()).map(periodogram).unwrap_or_default();
    let total: f64 = power.iter().sum();
    let edge = |share: f64| {
        let mut sum = 0.0;
        let line = power.iter().position(|p| {
            sum += p;
            sum >= share * total
        });
        // The lines go from 0 to the Nyquist frequency.
        let lines = power.len().saturating_sub(1).max(1);
        line.unwrap_or(0) as f64 * rate_hz / 2.0 / lines as f64
    };
    let (low_hz, high_hz) = if total > 0.0 { (edge(0.005), edge(0.995)) } else { (0.0, 0.0) };
    Band { channel: channel.into(), low_hz, high_hz }
}

/// Returns the power at the lines from 0 to the Nyquist frequency. The mean is subtracted, a Hann window is applied,
/// and missing samples count as the mean.
fn periodogram(values: ArrayView1<f64>) -> Vec<f64> {
    // With an even number of samples, one line is at the Nyquist frequency.
    let samples = values.len() / 2 * 2;
    if samples == 0 {
        return Vec::new();
    }
    let mean = mean(values);
    let windowed: Vec<f64> = values
        .iter()
        .take(samples)
        .enumerate()
        .map(|(k, v)| {
            let window = 0.5 - 0.5 * (2.0 * PI * k as f64 / samples as f64).cos();
            let about = if v.is_nan() { 0.0 } else { v - mean };
            window * about
        })
        .collect();
    plid_fourier::forward(&windowed).iter().map(|z| z.norm_sqr()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prepare::test_plants::Gaussian;
    use ndarray::Array2;

    fn names(name: &str) -> Vec<String> {
        vec![name.into()]
    }

    /// Returns sines from `low` to `high` Hz, in steps of 0.5 Hz, with random phases and sampled at 400 Hz.
    fn multisine(low: f64, high: f64) -> Array2<f64> {
        let mut g = Gaussian::new(4);
        let tones: Vec<(f64, f64)> =
            (0..).map(|i| low + 0.5 * i as f64).take_while(|hz| *hz <= high).map(|hz| (hz, 6.0 * g.draw())).collect();
        Array2::from_shape_fn((8000, 1), |(k, _)| {
            tones.iter().map(|(hz, phase)| (2.0 * PI * hz * k as f64 / 400.0 + phase).sin()).sum::<f64>()
        })
    }

    fn found(u: &Array2<f64>, y: &Array2<f64>) -> ([Vec<Band>; 2], Vec<Warning>) {
        let segment = Segment { inputs: u.view(), outputs: y.view() };
        let both = bands(&[segment], &names("u"), &names("y"), 400.0);
        let said = warnings(&both[0], &both[1], 400.0);
        (both, said)
    }

    #[test]
    fn a_multisine_of_2_to_15_hz_has_that_band_and_suggests_50_hz() {
        let u = multisine(2.0, 15.0);
        let ([inputs, _], warnings) = found(&u, &u);
        assert!((inputs[0].low_hz - 2.0).abs() < 0.1, "{inputs:?}");
        assert!((inputs[0].high_hz - 15.0).abs() < 0.1, "{inputs:?}");
        assert!(matches!(&warnings[0], Warning::NarrowBand { channel, .. } if channel == "u"));
        assert!(
            matches!(warnings[1], Warning::Oversampled { suggested_hz, .. } if suggested_hz == 50.0),
            "{warnings:?}"
        );
    }

    #[test]
    fn white_data_are_not_oversampled() {
        let mut g = Gaussian::new(6);
        let u = Array2::from_shape_simple_fn((80_000, 1), || g.draw());
        let ([inputs, _], warnings) = found(&u, &u);
        // 99 % of white power lies between 0.5 and 99.5 % of the Nyquist frequency.
        assert!((inputs[0].low_hz - 1.0).abs() < 0.5, "{inputs:?}");
        assert!((inputs[0].high_hz - 199.0).abs() < 0.5, "{inputs:?}");
        assert_eq!(warnings, []);
        // A slow plant has white excitation, so the output decides.
        let u = u.slice(ndarray::s![..8000, ..]).to_owned();
        let (_, warnings) = found(&u, &multisine(1.0, 10.0));
        assert!(matches!(warnings[..], [Warning::Oversampled { .. }]), "{warnings:?}");
    }

    #[test]
    fn constant_and_missing_data_do_not_break_it() {
        let mut y = multisine(2.0, 15.0);
        y[[7, 0]] = f64::NAN;
        let ([inputs, outputs], warnings) = found(&Array2::ones((8000, 1)), &y);
        assert_eq!((inputs[0].low_hz, inputs[0].high_hz), (0.0, 0.0));
        assert!(outputs[0].high_hz < 20.0);
        assert_eq!(warnings, []);
    }
}
