//! Decimation after a linear-phase anti-alias filter.
//!
//! The filter is a sinc with a Kaiser window (Oppenheim and Schafer, Discrete-Time Signal Processing, 7.5.3). It passes
//! frequencies up to 0.8 of the new Nyquist frequency and attenuates those above the new Nyquist frequency by at least
//! 60 dB, which prevents aliasing. The filter is symmetric about each kept sample, so it causes no delay. It is the
//! same for inputs and outputs, so it preserves their relation. Samples for which the filter would extend beyond the
//! record are dropped at both ends.
use super::PrepareError;
use crate::{Record, Warning};
use ndarray::{Array2, ArrayView1, ArrayView2};
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// Pass-band edge relative to the new Nyquist frequency.
const PASS: f64 = 0.8;
/// Design attenuation in dB; the documented attenuation is 60 dB.
const ATTENUATION_DB: f64 = 70.0;

/// The parameters of a decimation.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Decimation {
    /// Sample rate before decimation, in Hz.
    pub from_hz: f64,
    /// Sample rate after decimation, in Hz.
    pub to_hz: f64,
    /// One sample in `ratio` is kept.
    pub ratio: usize,
    /// Number of samples that are dropped at each end: half the filter's length.
    pub edge: usize,
}

/// Plans the decimation from one rate to another.
///
/// # Errors
/// Returns an error if the ratio is not an integer to within 0.1 %. The error names the nearest possible rates.
pub fn plan(from_hz: f64, to_hz: f64) -> Result<Decimation, PrepareError> {
    if !(to_hz > 0.0 && to_hz.is_finite()) || to_hz > from_hz * 1.001 {
        return Err(PrepareError::DecimationRate { from_hz, to_hz });
    }
    let exact = from_hz / to_hz;
    let ratio = exact.round().max(1.0);
    if (exact / ratio - 1.0).abs() > 1e-3 {
        return Err(PrepareError::DecimationRatio {
            from_hz,
            to_hz,
            below_hz: from_hz / exact.ceil(),
            above_hz: from_hz / exact.floor(),
        });
    }
    let ratio = ratio as usize;
    Ok(Decimation {
        from_hz,
        to_hz: from_hz / ratio as f64,
        ratio,
        edge: if ratio == 1 { 0 } else { half_length(ratio) },
    })
}

/// Applies a planned decimation. `number` is the number of the record, from 1, for messages.
///
/// A filtered sample is missing (NaN) if any sample under the filter is missing; [`masked`] counts these samples.
///
/// # Errors
/// Returns [`PrepareError::TooShort`] if fewer than two samples would remain.
pub fn decimate(record: &Record, plan: &Decimation, number: usize) -> Result<Record, PrepareError> {
    if plan.ratio == 1 {
        return Ok(record.clone());
    }
    let needed = 2 * plan.edge + 1 + plan.ratio;
    if record.samples() < needed {
        return Err(PrepareError::TooShort {
            record: number,
            samples: record.samples(),
            step: "the anti-alias filter",
            needed,
        });
    }
    let taps = taps(plan.ratio);
    Ok(Record {
        sample_rate_hz: record.sample_rate_hz / plan.ratio as f64,
        inputs: filter(record.inputs.view(), &taps, plan.ratio),
        outputs: filter(record.outputs.view(), &taps, plan.ratio),
        ..record.clone()
    })
}

/// Returns a warning for each output with missing samples, which states the number of samples that the filter masked.
/// `number` is the number of the record, from 1.
pub fn masked(raw: &Record, decimated: &Record, number: usize) -> Vec<Warning> {
    let missing = |column: ArrayView1<f64>| column.iter().filter(|x| x.is_nan()).count();
    let channels = decimated.output_names.iter().zip(raw.outputs.columns()).zip(decimated.outputs.columns());
    let lost = channels.map(|((channel, before), after)| (channel, missing(before), missing(after)));
    lost.filter(|(_, before, _)| *before > 0)
        .map(|(channel, missing, masked)| Warning::MaskedByFilter {
            channel: channel.clone(),
            record: number,
            missing,
            masked,
            samples: decimated.samples(),
        })
        .collect()
}

/// Returns half the length of the filter, by Kaiser's formula.
fn half_length(ratio: usize) -> usize {
    let transition = (1.0 - PASS) * PI / ratio as f64;
    ((ATTENUATION_DB - 7.95) / (2.285 * transition) / 2.0).ceil() as usize
}

/// Returns the symmetric filter, whose middle is at `half_length`. Its gain at zero frequency is one.
fn taps(ratio: usize) -> Vec<f64> {
    let half = half_length(ratio) as i64;
    let beta = 0.1102 * (ATTENUATION_DB - 8.7);
    let cutoff = 0.5 * (1.0 + PASS) / ratio as f64;
    let raw: Vec<f64> = (-half..=half)
        .map(|k| {
            let x = k as f64 * cutoff * PI;
            let sinc = if k == 0 { 1.0 } else { x.sin() / x };
            let across = k as f64 / half as f64;
            sinc * bessel_i0(beta * (1.0 - across * across).max(0.0).sqrt())
        })
        .collect();
    let sum: f64 = raw.iter().sum();
    raw.iter().map(|tap| tap / sum).collect()
}

/// Computes the modified Bessel function of the first kind and order zero by its power series.
fn bessel_i0(x: f64) -> f64 {
    let mut term = 1.0;
    let mut sum = 1.0;
    for k in 1..200 {
        term *= (x / 2.0 / k as f64).powi(2);
        sum += term;
        if term < 1e-17 * sum {
            break;
        }
    }
    sum
}

fn filter(samples: ArrayView2<f64>, taps: &[f64], ratio: usize) -> Array2<f64> {
    let kept = (samples.nrows() - taps.len()) / ratio + 1;
    let mut out = Array2::zeros((kept, samples.ncols()));
    for (j, column) in samples.columns().into_iter().enumerate() {
        let column = column.to_vec();
        for k in 0..kept {
            let under = &column[k * ratio..k * ratio + taps.len()];
            out[[k, j]] = under.iter().zip(taps).map(|(a, b)| a * b).sum();
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array2;

    /// Returns a record with a sine of amplitude 1 as its input, and the same sine delayed by one raw sample as its
    /// output.
    fn sine(hz: f64, samples: usize) -> Record {
        let at = |k: f64| (2.0 * PI * hz * k / 400.0 + 0.3).sin();
        Record {
            sample_rate_hz: 400.0,
            input_names: vec!["u".into()],
            output_names: vec!["y".into()],
            inputs: Array2::from_shape_fn((samples, 1), |(k, _)| at(k as f64)),
            outputs: Array2::from_shape_fn((samples, 1), |(k, _)| at(k as f64 - 1.0)),
        }
    }

    #[test]
    fn the_band_passes_without_delay() {
        for (to, ratio) in [(50.0, 8), (133.33, 3), (200.0, 2)] {
            let plan = plan(400.0, to).unwrap();
            assert_eq!(plan.ratio, ratio);
            for share in [0.0, 0.1, 0.5, 0.79] {
                let hz = share * plan.to_hz / 2.0;
                let raw = sine(hz, 4000);
                let out = decimate(&raw, &plan, 1).unwrap();
                assert_eq!(out.sample_rate_hz, 400.0 / ratio as f64);
                for k in 0..out.samples() {
                    let raw_k = plan.edge + k * ratio;
                    assert!((out.inputs[[k, 0]] - raw.inputs[[raw_k, 0]]).abs() < 1e-3);
                    assert!((out.outputs[[k, 0]] - raw.outputs[[raw_k, 0]]).abs() < 1e-3);
                }
                let last = plan.edge + (out.samples() - 1) * ratio;
                assert!(last + plan.edge < 4000 && last + plan.edge + ratio >= 4000);
            }
        }
    }

    #[test]
    fn what_would_fold_back_is_stopped_by_60_db() {
        for to in [50.0, 400.0 / 3.0, 200.0] {
            let plan = plan(400.0, to).unwrap();
            for step in 0..40 {
                let nyquist = plan.to_hz / 2.0;
                let hz = nyquist + (199.0 - nyquist) * step as f64 / 39.0;
                let out = decimate(&sine(hz, 4000), &plan, 1).unwrap();
                let largest = out.inputs.iter().fold(0.0, |a: f64, b| a.max(b.abs()));
                assert!(largest < 1e-3, "{hz} Hz: {largest}");
            }
        }
    }

    #[test]
    fn other_ratios_name_the_nearest_rates() {
        let error = plan(400.0, 150.0).unwrap_err();
        let PrepareError::DecimationRatio { below_hz, above_hz, .. } = error else {
            panic!("{error}");
        };
        assert!((below_hz - 400.0 / 3.0).abs() < 1e-9 && above_hz == 200.0);
        for to in [0.0, -50.0, f64::NAN, 500.0] {
            assert!(matches!(plan(400.0, to), Err(PrepareError::DecimationRate { .. })));
        }
        assert_eq!(plan(400.0, 400.0).unwrap().edge, 0);
    }

    #[test]
    fn missing_samples_spread_over_the_filter_only() {
        let plan = plan(400.0, 50.0).unwrap();
        let mut raw = sine(5.0, 4000);
        raw.outputs[[2000, 0]] = f64::NAN;
        let out = decimate(&raw, &plan, 1).unwrap();
        for k in 0..out.samples() {
            let middle = plan.edge + k * 8;
            let touched = middle.abs_diff(2000) <= plan.edge;
            assert_eq!(out.outputs[[k, 0]].is_nan(), touched);
            assert!(out.inputs[[k, 0]].is_finite());
        }
        let count = out.outputs.iter().filter(|y| y.is_nan()).count();
        let said = masked(&raw, &out, 3);
        let said: Vec<String> = said.iter().map(ToString::to_string).collect();
        let words = format!("{count} of {} samples at the new rate", out.samples());
        assert!(
            said.len() == 1 && said[0].contains("record 3 lacks 1 samples") && said[0].contains(&words),
            "{said:?}"
        );
        assert!(count > 1 && masked(&sine(5.0, 4000), &out, 1).is_empty());
    }

    #[test]
    fn a_record_shorter_than_the_filter_is_an_error() {
        let plan = plan(400.0, 50.0).unwrap();
        let error = decimate(&sine(5.0, 100), &plan, 2).unwrap_err().to_string();
        assert!(error.contains("record 2 has 100 samples"), "{error}");
    }
}
