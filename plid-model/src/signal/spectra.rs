use ndarray::{Array2, Array3, ArrayView1, ArrayView2, s};
use plid_fourier::Complex64;

use super::error::{SignalError, check_positive, check_record};

/// The segmentation of a record for Welch's method. Segments have a Hann window and overlap by half.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WelchOptions {
    /// Sample rate in Hz.
    pub sample_rate_hz: f64,
    /// Samples in a segment. `None` selects the largest power of two that gives about 15 segments, or a smaller one
    /// where the density matrices of all lines would exceed 64 MiB.
    pub segment_length: Option<usize>,
}

/// Auto- and cross-spectral densities of all channels of a record.
#[derive(Debug, Clone, PartialEq)]
pub struct Spectra {
    /// Frequencies in Hz, from 0 to half the sample rate.
    pub frequency_hz: Vec<f64>,
    /// Spectral densities (`lines x channels x channels`): `density[[f, i, j]]` is the one-sided density E[X_i
    /// conj(X_j)], in units of channel i times channel j per Hz.
    pub density: Array3<Complex64>,
    /// Samples in a segment.
    pub segment_length: usize,
    /// Segments averaged.
    pub segments_used: usize,
    /// Segments skipped because a sample was missing.
    pub segments_skipped: usize,
    /// Equivalent number of independent averages of the overlapping segments (Welch 1967, Eq. 12 for the Hann window).
    pub averages: f64,
}

/// Largest number of entries in the density matrices of all lines, with the default segment length.
const MOST_ENTRIES: usize = 1 << 22;
/// Smallest segment length in samples.
const SHORTEST_SEGMENT: usize = 8;

/// Estimates the spectral density matrix of `data` (`samples x channels`) by Welch's method.
///
/// The mean of each segment is removed. A segment with a missing sample in any channel is skipped and counted.
///
/// # Errors
/// Returns [`SignalError::TooShort`] with fewer samples than a segment or no complete segment,
/// [`SignalError::Setting`], [`SignalError::Infinite`] or [`SignalError::NoChannels`].
pub fn welch_spectra(data: ArrayView2<f64>, options: &WelchOptions) -> Result<Spectra, SignalError> {
    check_record("the record", data)?;
    joint_spectra(&[data], options)
}

/// Estimates the spectral density matrix of the channels of several arrays (`samples x channels` each, with the same
/// samples), in their order, as [`welch_spectra`] does for one. No array is copied.
pub(super) fn joint_spectra(arrays: &[ArrayView2<f64>], options: &WelchOptions) -> Result<Spectra, SignalError> {
    check_positive("sample rate", options.sample_rate_hz)?;
    let samples = arrays.iter().map(|array| array.nrows()).min().unwrap_or(0);
    let channels = arrays.iter().map(|array| array.ncols()).sum();
    let length = options.segment_length.unwrap_or_else(|| default_segment_length(samples, channels));
    if length < SHORTEST_SEGMENT || length % 2 == 1 {
        return Err(SignalError::Setting {
            name: "segment length",
            value: length as f64,
            allowed: "an even number of samples, at least 8",
        });
    }
    let too_short = |unit, needed, available| SignalError::TooShort { what: "Welch's method", unit, needed, available };
    if samples < length {
        return Err(too_short("samples", length, samples));
    }

    let window = hann(length);
    let power: f64 = window.iter().map(|w| w * w).sum();
    let lines = length / 2 + 1;
    let mut sum = Array3::<Complex64>::zeros((lines, channels, channels));
    let (mut used, mut skipped, mut neighbours) = (0, 0, 0);
    let mut last_used = false;
    let mut spectrum = Array2::<Complex64>::zeros((channels, lines));
    for start in (0..=samples - length).step_by(length / 2) {
        let segment: Vec<_> = arrays.iter().map(|array| array.slice(s![start..start + length, ..])).collect();
        if segment.iter().flatten().any(|value| value.is_nan()) {
            skipped += 1;
            last_used = false;
            continue;
        }
        used += 1;
        neighbours += usize::from(last_used);
        last_used = true;
        add_periodogram(&segment, &window, &mut spectrum, &mut sum);
    }
    if used == 0 {
        return Err(too_short("segments without a missing sample", 1, 0));
    }

    // The densities are one-sided, so all lines except the first and the last are doubled.
    let scale = 1.0 / (options.sample_rate_hz * power * used as f64);
    for line in 0..lines {
        let fold = if line == 0 || line == lines - 1 { 1.0 } else { 2.0 };
        sum.slice_mut(s![line, .., ..]).mapv_inplace(|z| z * (scale * fold));
    }
    let shared: f64 = (0..length / 2).map(|k| window[k] * window[k + length / 2]).sum::<f64>() / power;
    let averages = used as f64 / (1.0 + 2.0 * shared * shared * neighbours as f64 / used as f64);
    Ok(Spectra {
        frequency_hz: (0..lines).map(|line| line as f64 * options.sample_rate_hz / length as f64).collect(),
        density: sum,
        segment_length: length,
        segments_used: used,
        segments_skipped: skipped,
        averages,
    })
}

/// Adds the cross-periodograms of a segment after its mean is removed and the window is applied. `spectrum` (channels
/// x lines) is overwritten.
fn add_periodogram(
    segment: &[ArrayView2<f64>],
    window: &[f64],
    spectrum: &mut Array2<Complex64>,
    sum: &mut Array3<Complex64>,
) {
    let length = window.len();
    let (channels, lines) = spectrum.dim();
    for (channel, column) in segment.iter().flat_map(|array| array.columns()).enumerate() {
        let mean = column.sum() / length as f64;
        let windowed: Vec<f64> = column.iter().zip(window).map(|(x, w)| (x - mean) * w).collect();
        spectrum.row_mut(channel).assign(&ArrayView1::from(&plid_fourier::forward(&windowed)));
    }
    for line in 0..lines {
        for i in 0..channels {
            for j in 0..channels {
                sum[[line, i, j]] += spectrum[[i, line]] * spectrum[[j, line]].conj();
            }
        }
    }
}

/// Returns the Hann window in its periodic form, which sums to a constant at half overlap.
fn hann(length: usize) -> Vec<f64> {
    (0..length).map(|k| 0.5 - 0.5 * (std::f64::consts::TAU * k as f64 / length as f64).cos()).collect()
}

fn default_segment_length(samples: usize, channels: usize) -> usize {
    let mut length = SHORTEST_SEGMENT;
    // A segment of twice this length has `length` + 1 lines.
    while length * 2 <= samples / 8 && length * channels * channels <= MOST_ENTRIES {
        length *= 2;
    }
    length
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::signal::test_noise::white;

    fn options(segment_length: Option<usize>) -> WelchOptions {
        WelchOptions { sample_rate_hz: 1600.0, segment_length }
    }

    #[test]
    fn white_noise_has_the_density_of_its_variance() {
        // Variance s^2 spread over fs / 2: 2 s^2 / fs.
        let data = white(1, 40_000, 2) * 0.3;
        let spectra = welch_spectra(data.view(), &options(Some(256))).unwrap();
        let expected = 2.0 * 0.09 / 1600.0;
        let inner: Vec<f64> = (2..127).map(|line| spectra.density[[line, 0, 0]].re).collect();
        let mean = inner.iter().sum::<f64>() / inner.len() as f64;
        assert!((mean / expected - 1.0).abs() < 0.03, "{mean} {expected}");
        // Each line has a relative standard deviation of 1/sqrt(averages), which checks the equivalent number of
        // averages.
        let spread = (inner.iter().map(|x| (x / mean - 1.0).powi(2)).sum::<f64>() / inner.len() as f64).sqrt();
        assert!((spread * spectra.averages.sqrt() - 1.0).abs() < 0.25, "{spread}");
        // For independent channels the cross density is of the order 1/sqrt(averages).
        let cross = (2..127).map(|line| spectra.density[[line, 0, 1]].norm()).sum::<f64>() / 125.0;
        assert!(cross / mean < 1.5 / spectra.averages.sqrt());
    }

    #[test]
    fn the_density_integrates_to_the_power_of_a_sine() {
        // A sine at the centre of a line of a Hann window has all its power within two lines on each side.
        let data =
            Array2::from_shape_fn((8192, 1), |(k, _)| 0.7 * (std::f64::consts::TAU * 200.0 * k as f64 / 1600.0).sin());
        let spectra = welch_spectra(data.view(), &options(Some(1024))).unwrap();
        let power: f64 = spectra.density.iter().map(|z| z.re).sum::<f64>() * spectra.frequency_hz[1];
        assert!((power - 0.245).abs() < 1e-12, "{power}");
        let peak = (0..spectra.frequency_hz.len())
            .max_by(|&a, &b| spectra.density[[a, 0, 0]].re.total_cmp(&spectra.density[[b, 0, 0]].re));
        assert_eq!(spectra.frequency_hz[peak.unwrap()], 200.0);
    }

    #[test]
    fn a_hann_segment_at_half_overlap_counts_almost_whole() {
        // With rho = 1/6, K / (1 + 2 (K - 1) / (36 K)): 9 segments are worth 8.577 averages.
        let spectra = welch_spectra(white(3, 5 * 64, 1).view(), &options(Some(64))).unwrap();
        assert_eq!(spectra.segments_used, 9);
        assert!((spectra.averages - 9.0 / (1.0 + 2.0 * 8.0 / 9.0 / 36.0)).abs() < 1e-12);
    }

    #[test]
    fn a_missing_sample_costs_the_segments_that_hold_it() {
        let mut data = white(2, 10 * 64, 2);
        data[[200, 1]] = f64::NAN;
        let spectra = welch_spectra(data.view(), &options(Some(64))).unwrap();
        assert_eq!((spectra.segments_used, spectra.segments_skipped), (17, 2));
        assert!(spectra.density.iter().all(|z| z.re.is_finite()));
    }

    #[test]
    fn bad_records_are_refused() {
        let short = welch_spectra(white(2, 20, 1).view(), &options(Some(64))).unwrap_err();
        assert_eq!(short, SignalError::TooShort { what: "Welch's method", unit: "samples", needed: 64, available: 20 });
        let gaps = Array2::from_elem((128, 1), f64::NAN);
        assert!(matches!(
            welch_spectra(gaps.view(), &options(Some(64))),
            Err(SignalError::TooShort { available: 0, .. })
        ));
        let mut infinite = white(2, 100, 2);
        infinite[[3, 1]] = f64::INFINITY;
        assert_eq!(
            welch_spectra(infinite.view(), &options(None)).unwrap_err(),
            SignalError::Infinite { what: "the record", channel: 1, sample: 3 }
        );
        assert!(matches!(welch_spectra(white(2, 100, 1).view(), &options(Some(63))), Err(SignalError::Setting { .. })));
        let no_rate = WelchOptions { sample_rate_hz: 0.0, segment_length: None };
        assert!(matches!(welch_spectra(white(2, 100, 1).view(), &no_rate), Err(SignalError::Setting { .. })));
        assert!(matches!(
            welch_spectra(Array2::<f64>::zeros((9, 0)).view(), &options(None)),
            Err(SignalError::NoChannels { .. })
        ));
    }
}
