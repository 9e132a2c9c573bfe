use nalgebra::DMatrix;
use ndarray::{Array2, Array3, ArrayView2, s};
use plid_fourier::Complex64;

use super::error::{SignalError, check_record, check_rows};
use super::spectra::{WelchOptions, joint_spectra};

/// A frequency response estimated by Welch's method, with its accuracy.
///
/// At frequencies where an input has no power, or where inputs are linearly dependent, the entries are NaN.
#[derive(Debug, Clone, PartialEq)]
pub struct WelchFrf {
    /// Frequencies in Hz. Zero is left out, since the mean of each segment is removed.
    pub frequency_hz: Vec<f64>,
    /// `lines x outputs x inputs`: H1 = S_yu S_uu^{-1}, in output units per input unit.
    pub response: Array3<Complex64>,
    /// Standard deviation of |H| from output noise (`lines x outputs x inputs`), which is also that of the real and
    /// of the imaginary part. It does not include the bias of a frequency resolution that is too coarse for a
    /// resonance.
    pub response_std: Array3<f64>,
    /// Multiple coherence (`lines x outputs`): the fraction of the output's power that all inputs together explain.
    pub multiple_coherence: Array2<f64>,
    /// Ordinary coherence of output and input (`lines x outputs x inputs`), which ignores the other inputs.
    pub ordinary_coherence: Array3<f64>,
    /// Partial coherence of output and input (`lines x outputs x inputs`), after the parts explained by the other
    /// inputs are removed from both.
    pub partial_coherence: Array3<f64>,
    /// One-sided auto-spectral densities of the inputs (`lines x inputs`), in unit^2/Hz.
    pub input_density: Array2<f64>,
    /// One-sided auto-spectral densities of the outputs (`lines x outputs`), in unit^2/Hz.
    pub output_density: Array2<f64>,
    /// Samples in a segment.
    pub segment_length: usize,
    /// Segments averaged.
    pub segments_used: usize,
    /// Segments skipped because a sample was missing.
    pub segments_skipped: usize,
    /// Equivalent number of independent averages.
    pub averages: f64,
}

/// The inputs at a line count as linearly dependent if a squared diagonal entry of the Cholesky factor of the scaled
/// S_uu is below this.
const DEPENDENT: f64 = 1e-10;

/// Estimates the H1 frequency response from `inputs` (`samples x m`) to `outputs` (`samples x p`). The inputs may be
/// correlated.
///
/// With n independent averages, m inputs and multiple coherence g^2, the variance of a complex element is (1 - g^2)
/// S_yy \[S_uu^{-1}\]_jj / (n - m), half of which lies along |H|. For one input this is the random error sqrt((1 - g^2)
/// / (2 n)) / g of Bendat and Piersol (Random Data, table 9.6), except that each input costs one degree of freedom.
///
/// # Errors
/// Returns [`SignalError::TooShort`] unless there are more averages than inputs, [`SignalError::Constant`] for a
/// constant input, and the errors of [`welch_spectra`](crate::signal::welch_spectra).
pub fn welch_frf(
    inputs: ArrayView2<f64>,
    outputs: ArrayView2<f64>,
    options: &WelchOptions,
) -> Result<WelchFrf, SignalError> {
    check_record("the input", inputs)?;
    check_record("the output", outputs)?;
    check_rows("the output", outputs, inputs.nrows())?;
    check_varies(inputs)?;
    let (m, p) = (inputs.ncols(), outputs.ncols());
    let spectra = joint_spectra(&[inputs, outputs], options)?;
    let freedom = spectra.averages - m as f64;
    if freedom <= 0.0 {
        return Err(SignalError::TooShort {
            what: "a frequency response by Welch's method",
            unit: "segments without a missing sample",
            needed: m + 2,
            available: spectra.segments_used,
        });
    }

    let lines = spectra.frequency_hz.len() - 1;
    let auto = |first: usize, count: usize| {
        Array2::from_shape_fn((lines, count), |(line, i)| spectra.density[[line + 1, first + i, first + i]].re)
    };
    let mut frf = WelchFrf {
        frequency_hz: spectra.frequency_hz[1..].to_vec(),
        response: Array3::from_elem((lines, p, m), Complex64::new(f64::NAN, f64::NAN)),
        response_std: Array3::from_elem((lines, p, m), f64::NAN),
        multiple_coherence: Array2::from_elem((lines, p), f64::NAN),
        ordinary_coherence: Array3::from_elem((lines, p, m), f64::NAN),
        partial_coherence: Array3::from_elem((lines, p, m), f64::NAN),
        input_density: auto(0, m),
        output_density: auto(m, p),
        segment_length: spectra.segment_length,
        segments_used: spectra.segments_used,
        segments_skipped: spectra.segments_skipped,
        averages: spectra.averages,
    };
    let strongest: Vec<f64> = (0..m).map(|j| frf.input_density.column(j).fold(0.0, |a: f64, b| a.max(*b))).collect();
    for line in 0..lines {
        let density = spectra.density.slice(s![line + 1, .., ..]);
        // The inverse does not exist if an input has no power at this line, that is, less than the rounding errors of
        // its peak.
        if (0..m).any(|j| density[[j, j]].re <= 1e-28 * strongest[j]) {
            continue;
        }
        let Some(inverse) = inverse_of_inputs(density, m) else {
            continue;
        };
        frf.fill_line(line, density, &inverse, freedom);
    }
    Ok(frf)
}

impl WelchFrf {
    /// Returns the response of channels that were divided by these scales, in the units that they had before.
    #[must_use]
    pub fn in_units(mut self, input_scales: &[f64], output_scales: &[f64]) -> Self {
        for (j, u) in input_scales.iter().enumerate() {
            for (i, y) in output_scales.iter().enumerate() {
                self.response.slice_mut(s![.., i, j]).mapv_inplace(|h| h * (y / u));
                self.response_std.slice_mut(s![.., i, j]).mapv_inplace(|std| std * (y / u));
            }
            self.input_density.column_mut(j).mapv_inplace(|density| density * u * u);
        }
        for (i, y) in output_scales.iter().enumerate() {
            self.output_density.column_mut(i).mapv_inplace(|density| density * y * y);
        }
        self
    }

    /// Fills one line from its joint density matrix ((m + p) x (m + p), inputs first), S_uu^{-1} (m x m), and the
    /// number of averages less that of the inputs.
    fn fill_line(&mut self, line: usize, density: ArrayView2<Complex64>, inverse: &DMatrix<Complex64>, freedom: f64) {
        let (p, m) = (self.output_density.ncols(), self.input_density.ncols());
        for i in 0..p {
            let power = density[[m + i, m + i]].re;
            let row: Vec<Complex64> =
                (0..m).map(|j| (0..m).map(|l| density[[m + i, l]] * inverse[(l, j)]).sum()).collect();
            let explained: f64 = (0..m).map(|j| (row[j] * density[[j, m + i]]).re).sum();
            let noise = (power - explained).max(0.0);
            if power > 0.0 {
                self.multiple_coherence[[line, i]] = (explained / power).clamp(0.0, 1.0);
            }
            for j in 0..m {
                self.response[[line, i, j]] = row[j];
                let variance = noise * inverse[(j, j)].re;
                self.response_std[[line, i, j]] = (variance / freedom / 2.0).sqrt();
                if power > 0.0 {
                    let ordinary = density[[m + i, j]].norm_sqr() / (power * density[[j, j]].re);
                    self.ordinary_coherence[[line, i, j]] = ordinary.min(1.0);
                    // This is the partial coherence from the inverse of the joint density matrix of the output and all
                    // inputs.
                    self.partial_coherence[[line, i, j]] = row[j].norm_sqr() / (row[j].norm_sqr() + variance);
                }
            }
        }
    }
}

/// Checks that no input is constant.
fn check_varies(inputs: ArrayView2<f64>) -> Result<(), SignalError> {
    for (channel, column) in inputs.columns().into_iter().enumerate() {
        let present = || column.iter().copied().filter(|x| !x.is_nan());
        if present().fold(f64::INFINITY, f64::min) >= present().fold(f64::NEG_INFINITY, f64::max) {
            return Err(SignalError::Constant { what: "the input", channel });
        }
    }
    Ok(())
}

/// Returns S_uu^{-1} at one line, computed from the matrix scaled to a unit diagonal, or `None` if the inputs are
/// linearly dependent.
fn inverse_of_inputs(density: ArrayView2<Complex64>, m: usize) -> Option<DMatrix<Complex64>> {
    let scale: Vec<f64> = (0..m).map(|j| density[[j, j]].re.sqrt()).collect();
    let scaled = DMatrix::from_fn(m, m, |i, j| density[[i, j]] / (scale[i] * scale[j]));
    let cholesky = scaled.cholesky()?;
    if cholesky.l_dirty().diagonal().iter().any(|pivot| pivot.norm_sqr() < DEPENDENT) {
        return None;
    }
    let inverse = cholesky.inverse();
    Some(DMatrix::from_fn(m, m, |i, j| inverse[(i, j)] / (scale[i] * scale[j])))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::signal::test_noise::white;
    use std::f64::consts::TAU;

    const RATE: f64 = 100.0;

    fn options(length: usize) -> WelchOptions {
        WelchOptions { sample_rate_hz: RATE, segment_length: Some(length) }
    }

    /// Simulates y_k = a y_{k-1} + b u_{k-1}, whose response is b z^{-1} / (1 - a z^{-1}).
    fn first_order(u: impl Iterator<Item = f64>, a: f64, b: f64) -> Vec<f64> {
        let (mut y, mut last) = (0.0, 0.0);
        u.map(|now| {
            y = a * y + b * last;
            last = now;
            y
        })
        .collect()
    }

    fn first_order_response(f: f64, a: f64, b: f64) -> Complex64 {
        let z = Complex64::from_polar(1.0, TAU * f / RATE);
        b / (z - a)
    }

    /// Returns two correlated inputs and one output with white noise of a known standard deviation.
    fn two_inputs(seed: u64, samples: usize, noise: f64) -> (Array2<f64>, Array2<f64>) {
        let source = white(seed, samples, 3);
        let u = Array2::from_shape_fn((samples, 2), |(k, j)| {
            source[[k, j]] + if j == 1 { 0.8 * source[[k, 0]] } else { 0.0 }
        });
        let parts =
            [first_order(u.column(0).iter().copied(), 0.5, 1.0), first_order(u.column(1).iter().copied(), -0.3, 0.6)];
        let y = Array2::from_shape_fn((samples, 1), |(k, _)| parts[0][k] + parts[1][k] + noise * source[[k, 2]]);
        (u, y)
    }

    #[test]
    fn correlated_inputs_give_the_known_responses_within_the_stated_error() {
        let (u, y) = two_inputs(11, 60_000, 0.5);
        let frf = welch_frf(u.view(), y.view(), &options(256)).unwrap();
        let (mut chi, mut count) = (0.0, 0.0);
        for line in 1..126 {
            for (j, (a, b)) in [(0.5, 1.0), (-0.3, 0.6)].into_iter().enumerate() {
                let error = frf.response[[line, 0, j]] - first_order_response(frf.frequency_hz[line], a, b);
                chi += error.norm_sqr() / (2.0 * frf.response_std[[line, 0, j]].powi(2));
                count += 1.0;
            }
        }
        // Neighbouring lines of a Hann window are correlated, so 250 lines are worth about 120.
        assert!((chi / count - 1.0f64).abs() < 0.3, "{}", chi / count);
    }

    #[test]
    fn coherences_are_those_of_the_closed_form() {
        let noise = 0.5;
        let (u, y) = two_inputs(12, 120_000, noise);
        let frf = welch_frf(u.view(), y.view(), &options(128)).unwrap();
        for line in [5, 20, 40, 60] {
            let f = frf.frequency_hz[line];
            let (h1, h2) = (first_order_response(f, 0.5, 1.0), first_order_response(f, -0.3, 0.6));
            // Inputs s1 and 0.8 s1 + s2 with unit s1, s2.
            let power = (h1 + 0.8 * h2).norm_sqr() + h2.norm_sqr() + noise * noise;
            let multiple = 1.0 - noise * noise / power;
            let ordinary = (h1 + 0.8 * h2).norm_sqr() / power;
            // Given the second input, the first has variance 1 - 0.64 / 1.64.
            let left = h1.norm_sqr() * (1.0 - 0.64 / 1.64);
            let partial = left / (left + noise * noise);
            assert!((frf.multiple_coherence[[line, 0]] - multiple).abs() < 0.02);
            assert!((frf.ordinary_coherence[[line, 0, 0]] - ordinary).abs() < 0.03);
            assert!((frf.partial_coherence[[line, 0, 0]] - partial).abs() < 0.04);
        }
    }

    #[test]
    fn one_input_has_the_random_error_of_bendat_and_piersol() {
        let (u, y) = two_inputs(13, 50_000, 0.5);
        let one = u.slice(s![.., ..1]);
        let frf = welch_frf(one, y.view(), &options(256)).unwrap();
        for line in [3, 50, 100] {
            let coherence = frf.ordinary_coherence[[line, 0, 0]];
            assert!((coherence - frf.multiple_coherence[[line, 0]]).abs() < 1e-12);
            let relative = ((1.0 - coherence) / (2.0 * (frf.averages - 1.0) * coherence)).sqrt();
            let stated = frf.response_std[[line, 0, 0]] / frf.response[[line, 0, 0]].norm();
            assert!((stated / relative - 1.0).abs() < 1e-9);
        }
    }

    #[test]
    fn copies_and_constants_are_told_apart() {
        let (u, y) = two_inputs(14, 5000, 0.1);
        let twice = Array2::from_shape_fn((5000, 2), |(k, _)| u[[k, 0]]);
        let frf = welch_frf(twice.view(), y.view(), &options(128)).unwrap();
        assert!(frf.response.iter().all(|z| z.re.is_nan()));
        let mut still = u.clone();
        still.column_mut(1).fill(2.0);
        let error = welch_frf(still.view(), y.view(), &options(128)).unwrap_err();
        assert_eq!(error, SignalError::Constant { what: "the input", channel: 1 });
        let error = welch_frf(u.slice(s![..300, ..]), y.slice(s![..300, ..]), &options(256)).unwrap_err();
        assert!(matches!(error, SignalError::TooShort { needed: 4, available: 1, .. }));
        let error = welch_frf(u.view(), y.slice(s![..10, ..]), &options(256)).unwrap_err();
        assert_eq!(error, SignalError::LengthMismatch { what: "the output", expected: 5000, found: 10 });
    }
}
