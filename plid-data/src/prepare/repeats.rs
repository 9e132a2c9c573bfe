//! Repeated records of one input: their average, and the noise that is estimated from their spread.
use super::PrepareError;
use super::noise::NoiseCovariance;
use crate::{Record, require_alike};
use ndarray::{Array1, Array2, ArrayView1, s};
use plid_model::signal::rms;
use serde::{Deserialize, Serialize};

/// The definition of the repeats in the data.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Repeats {
    /// Number of samples in a period of each record. Without it, the records are repeats of one another.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub period: Option<usize>,
    /// Number of periods or records at the beginning that are left out because of the transient.
    #[serde(default)]
    pub skip: usize,
    /// Largest permissible RMS difference between the input of a repeat and the mean input, relative to the mean input.
    #[serde(default = "default_tolerance")]
    pub tolerance: f64,
}

fn default_tolerance() -> f64 {
    0.01
}

/// The average of repeats, and the noise that is estimated from their spread.
#[derive(Debug, Clone)]
pub struct Averaged {
    /// The mean over the repeats. A sample is missing if it is missing in all repeats.
    pub record: Record,
    /// Number of repeats.
    pub repeats: usize,
    /// Noise of a single repeat. The covariance of the average's noise is `repeats` times smaller.
    pub noise: NoiseCovariance,
    /// The largest relative RMS difference between a repeat and the mean for each input.
    pub input_mismatch: Vec<f64>,
}

/// Cuts a record into periods. The first `skip` periods and an incomplete last one are left out.
///
/// # Errors
/// Returns an error if fewer than two periods remain.
pub fn periods(record: &Record, period: usize, skip: usize) -> Result<Vec<Record>, PrepareError> {
    let whole = record.samples().checked_div(period).unwrap_or(0);
    let found = whole.saturating_sub(skip);
    if found < 2 {
        return Err(PrepareError::TooFewRepeats { found });
    }
    Ok((skip..whole)
        .map(|r| {
            let range = r * period..(r + 1) * period;
            Record {
                inputs: record.inputs.slice(s![range.clone(), ..]).to_owned(),
                outputs: record.outputs.slice(s![range, ..]).to_owned(),
                ..record.clone()
            }
        })
        .collect())
}

/// Averages repeats of one input.
///
/// # Errors
/// Returns an error if there are fewer than two repeats, if they differ in channels, rate or length, or if the inputs
/// do not repeat to within `tolerance`.
pub fn average(repeats: &[Record], tolerance: f64) -> Result<Averaged, PrepareError> {
    let [first, _, ..] = repeats else {
        return Err(PrepareError::TooFewRepeats { found: repeats.len() });
    };
    require_alike(repeats)?;
    if let Some(i) = repeats.iter().position(|r| r.samples() != first.samples()) {
        return Err(PrepareError::RepeatLength {
            repeat: i + 1,
            samples: repeats[i].samples(),
            expected: first.samples(),
        });
    }
    let inputs = mean_of(repeats, |r| &r.inputs);
    let input_mismatch = mismatch(repeats, &inputs, tolerance)?;
    let record = Record { inputs, outputs: mean_of(repeats, |r| &r.outputs), ..first.clone() };
    Ok(Averaged { noise: noise_from_repeats(repeats)?, record, repeats: repeats.len(), input_mismatch })
}

/// Estimates the covariance of the outputs' noise in a single repeat from the spread about the mean of the repeats.
/// Samples that are missing in any repeat are left out.
///
/// # Errors
/// Returns an error if there are fewer than two repeats or too few complete samples.
pub fn noise_from_repeats(repeats: &[Record]) -> Result<NoiseCovariance, PrepareError> {
    let [first, _, ..] = repeats else {
        return Err(PrepareError::TooFewRepeats { found: repeats.len() });
    };
    let p = first.outputs.ncols();
    let mut sum = Array2::<f64>::zeros((p, p));
    let mut complete = 0;
    for k in 0..first.samples() {
        let rows: Vec<ArrayView1<f64>> = repeats.iter().map(|r| r.outputs.row(k)).collect();
        if rows.iter().any(|row| row.iter().any(|v| v.is_nan())) {
            continue;
        }
        let mean = rows.iter().fold(Array1::zeros(p), |a: Array1<f64>, b| a + b) / repeats.len() as f64;
        for row in rows {
            let d = &row - &mean;
            for i in 0..p {
                for j in 0..p {
                    sum[[i, j]] += d[i] * d[j];
                }
            }
        }
        complete += 1;
    }
    // The mean over the repeats takes one degree of freedom of each sample.
    NoiseCovariance::new(sum, complete * (repeats.len() - 1))
}

fn mean_of(repeats: &[Record], side: fn(&Record) -> &Array2<f64>) -> Array2<f64> {
    Array2::from_shape_fn(side(&repeats[0]).dim(), |at| {
        let present: Vec<f64> = repeats.iter().map(|r| side(r)[at]).filter(|v| !v.is_nan()).collect();
        // If no repeat has a value, 0 / 0 gives NaN, which marks the sample as missing.
        present.iter().sum::<f64>() / present.len() as f64
    })
}

fn mismatch(repeats: &[Record], mean: &Array2<f64>, tolerance: f64) -> Result<Vec<f64>, PrepareError> {
    let mut largest = vec![0.0_f64; mean.ncols()];
    for (r, repeat) in repeats.iter().enumerate() {
        for (j, channel) in repeat.input_names.iter().enumerate() {
            let off = &repeat.inputs.column(j) - &mean.column(j);
            let (off, size) = (rms(off.view()), rms(mean.column(j)));
            let difference = if off == 0.0 { 0.0 } else { off / size };
            if difference.is_nan() || difference > tolerance {
                return Err(PrepareError::NotRepeated {
                    channel: channel.clone(),
                    repeat: r + 1,
                    difference,
                    tolerance,
                });
            }
            largest[j] = largest[j].max(difference);
        }
    }
    Ok(largest)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prepare::test_plants::Gaussian;

    /// Returns ten periods of one input. The outputs' noise has the covariance [[0.04, 0.02], [0.02, 0.05]].
    fn record(input_noise: f64) -> Record {
        let mut g = Gaussian::new(7);
        let (period, repeats) = (500, 10);
        let u: Vec<f64> = (0..period).map(|_| g.draw()).collect();
        let mut inputs = Array2::zeros((period * repeats, 1));
        let mut outputs = Array2::zeros((period * repeats, 2));
        for k in 0..period * repeats {
            let v = u[k % period];
            inputs[[k, 0]] = v + input_noise * g.draw();
            let (a, b) = (g.draw(), g.draw());
            outputs[[k, 0]] = 3.0 * v + 0.2 * a;
            outputs[[k, 1]] = -v + 0.1 * a + 0.2 * b;
        }
        Record {
            sample_rate_hz: 1.0,
            input_names: vec!["u".into()],
            output_names: vec!["y".into(), "z".into()],
            inputs,
            outputs,
        }
    }

    #[test]
    fn the_spread_gives_the_noise_and_the_mean_has_less_of_it() {
        let raw = record(0.0);
        let averaged = average(&periods(&raw, 500, 0).unwrap(), 0.01).unwrap();
        assert_eq!(averaged.repeats, 10);
        assert!(averaged.input_mismatch[0] < 1e-12);
        let c = &averaged.noise.covariance;
        // With 4500 degrees of freedom, the standard error is sqrt(2 / 4500) = 2 %.
        for (at, truth) in [([0, 0], 0.04), ([1, 1], 0.05), ([0, 1], 0.02), ([1, 0], 0.02)] {
            assert!((c[at] - truth).abs() < 0.004, "{at:?} {}", c[at]);
        }
        assert_eq!(averaged.noise.freedom, 4500);
        let clean = &raw.inputs.slice(s![..500, 0]) * 3.0;
        let left = &averaged.record.outputs.column(0) - &clean;
        let expected = 0.2 / 10_f64.sqrt();
        assert!((rms(left.view()) / expected - 1.0).abs() < 0.1);
    }

    #[test]
    fn missing_samples_are_left_out_of_the_mean() {
        let mut raw = record(0.0);
        let complete = average(&periods(&raw, 500, 1).unwrap(), 0.01).unwrap();
        raw.outputs[[503, 0]] = f64::NAN;
        for r in 1..10 {
            raw.outputs[[r * 500 + 4, 1]] = f64::NAN;
        }
        let gappy = average(&periods(&raw, 500, 1).unwrap(), 0.01).unwrap();
        assert!((gappy.record.outputs[[3, 0]] - complete.record.outputs[[3, 0]]).abs() < 0.2);
        assert!(gappy.record.outputs[[4, 1]].is_nan());
        assert_eq!(gappy.noise.freedom, 498 * 8);
    }

    #[test]
    fn inputs_that_do_not_repeat_are_refused() {
        let raw = record(0.05);
        let repeats = periods(&raw, 500, 0).unwrap();
        let error = average(&repeats, 0.01).unwrap_err().to_string();
        assert!(error.contains("input `u` does not repeat"), "{error}");
        assert!(average(&repeats, 0.1).is_ok());
        // The period is wrong.
        assert!(average(&periods(&record(0.0), 499, 0).unwrap(), 0.1).is_err());
    }

    #[test]
    fn too_few_or_unequal_repeats_are_refused() {
        let raw = record(0.0);
        for (period, skip) in [(0, 0), (3000, 0), (500, 9)] {
            let error = periods(&raw, period, skip).unwrap_err();
            assert!(matches!(error, PrepareError::TooFewRepeats { .. }));
        }
        let mut repeats = periods(&raw, 500, 0).unwrap();
        repeats[3] = periods(&raw, 400, 0).unwrap().remove(0);
        let error = average(&repeats, 0.1).unwrap_err();
        assert!(matches!(error, PrepareError::RepeatLength { repeat: 4, .. }));
        assert!(matches!(average(&[], 0.1), Err(PrepareError::TooFewRepeats { .. })));
    }
}
