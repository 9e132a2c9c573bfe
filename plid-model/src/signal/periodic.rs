use nalgebra::DMatrix;
use ndarray::{Array2, Array3, ArrayView2, Axis, s};
use plid_fourier::Complex64;

use super::error::{SignalError, check_positive, check_record, check_rows};

/// A record with a periodic input.
#[derive(Debug, Clone, Copy)]
pub struct PeriodicRecord<'a> {
    /// `samples x m`; a missing sample is a NaN.
    pub inputs: ArrayView2<'a, f64>,
    /// `samples x p`; a missing sample is a NaN.
    pub outputs: ArrayView2<'a, f64>,
}

/// A frequency response averaged over periods, at the lines that the input excites.
#[derive(Debug, Clone, PartialEq)]
pub struct PeriodicFrf {
    /// Frequencies of the lines in Hz.
    pub frequency_hz: Vec<f64>,
    /// Response (`lines x outputs x inputs`), in output units per input unit; NaN where an input has no power at a
    /// line.
    pub response: Array3<Complex64>,
    /// Standard deviation of |H| and of its real and imaginary parts (`lines x outputs x inputs`), from the variance
    /// between periods.
    pub response_std: Array3<f64>,
    /// Variance of the complex amplitude of a single period about the mean of the periods (`lines x outputs`), averaged
    /// over the records.
    pub output_noise: Array2<f64>,
    /// Excited lines left out because more inputs are active there than there are records to separate them.
    pub lines_unresolved: usize,
    /// Number of periods averaged, over all records.
    pub periods_used: usize,
    /// Periods skipped because a sample was missing.
    pub periods_skipped: usize,
}

/// A line is excited if the amplitude of an input exceeds this fraction of the largest amplitude.
const EXCITED: f64 = 1e-3;

/// Estimates the frequency response from periodic records. Each record is cut into periods of `period` samples, the
/// first `transient` periods are discarded, and the discrete Fourier transforms of the others are averaged at the
/// excited lines.
///
/// If q inputs are active at a line, at least q records with different inputs are needed. If the inputs excite disjoint
/// sets of lines (a zippered multisine), one record is sufficient. Periods with a missing sample are skipped and
/// counted. The amplitudes are those of x_k = sum A exp(i 2 pi f k), half the peak of a sine.
///
/// # Errors
/// Returns [`SignalError::TooShort`] with fewer than two whole periods in a record, [`SignalError::NoResolvableLine`],
/// [`SignalError::LengthMismatch`], [`SignalError::ChannelMismatch`], [`SignalError::Infinite`] or
/// [`SignalError::Setting`].
pub fn periodic_frf(
    records: &[PeriodicRecord],
    period: usize,
    transient: usize,
    sample_rate_hz: f64,
) -> Result<PeriodicFrf, SignalError> {
    check_positive("sample rate", sample_rate_hz)?;
    let Some(first) = records.first() else {
        return Err(SignalError::TooShort {
            what: "a periodic frequency response",
            unit: "records",
            needed: 1,
            available: 0,
        });
    };
    let (m, p) = (first.inputs.ncols(), first.outputs.ncols());
    let mut averages = Vec::with_capacity(records.len());
    for record in records {
        check_record("the input", record.inputs)?;
        check_record("the output", record.outputs)?;
        check_rows("the output", record.outputs, record.inputs.nrows())?;
        check_channels("the input", record.inputs, m)?;
        check_channels("the output", record.outputs, p)?;
        averages.push(average_periods(record, period, transient)?);
    }

    let (kept, lines_unresolved) = resolve(&averages, period);
    if kept.is_empty() {
        return Err(SignalError::NoResolvableLine { records: records.len() });
    }

    let mut frf = PeriodicFrf {
        frequency_hz: kept.iter().map(|at| at.line as f64 * sample_rate_hz / period as f64).collect(),
        response: Array3::from_elem((kept.len(), p, m), Complex64::new(f64::NAN, f64::NAN)),
        response_std: Array3::from_elem((kept.len(), p, m), f64::NAN),
        output_noise: Array2::zeros((kept.len(), p)),
        lines_unresolved,
        periods_used: averages.iter().map(|a| a.used).sum(),
        periods_skipped: averages.iter().map(|a| a.skipped).sum(),
    };
    for (row, Resolved { line, active, weights }) in kept.iter().enumerate() {
        for i in 0..p {
            for (column, &j) in active.iter().enumerate() {
                let (mut response, mut variance) = (Complex64::ZERO, 0.0);
                for (e, average) in averages.iter().enumerate() {
                    let weight = weights[(e, column)];
                    response += average.outputs[[*line, i]] * weight;
                    variance += average.noise[[*line, i]] / average.used as f64 * weight.norm_sqr();
                }
                frf.response[[row, i, j]] = response;
                frf.response_std[[row, i, j]] = (variance / 2.0).sqrt();
            }
            frf.output_noise[[row, i]] =
                averages.iter().map(|a| a.noise[[*line, i]]).sum::<f64>() / averages.len() as f64;
        }
    }
    Ok(frf)
}

/// A line at which the responses of the active inputs can be separated.
struct Resolved {
    line: usize,
    /// The inputs that are active at the line.
    active: Vec<usize>,
    /// The right inverse of their amplitudes (records x active inputs).
    weights: DMatrix<Complex64>,
}

/// Returns the lines that can be resolved, and the number of excited lines that cannot.
fn resolve(averages: &[PeriodAverage], period: usize) -> (Vec<Resolved>, usize) {
    let m = averages[0].inputs.ncols();
    let lines = period.div_ceil(2);
    let largest = averages.iter().flat_map(|a| a.inputs.iter()).fold(0.0, |peak: f64, z| peak.max(z.norm()));
    let mut kept: Vec<Resolved> = Vec::new();
    let mut lines_unresolved = 0;
    for line in 1..lines {
        let acts = |j: usize| averages.iter().any(|a| a.inputs[[line, j]].norm() > EXCITED * largest);
        let active: Vec<usize> = (0..m).filter(|&j| acts(j)).collect();
        if active.is_empty() {
            continue;
        }
        let u = DMatrix::from_fn(active.len(), averages.len(), |row, e| averages[e].inputs[[line, active[row]]]);
        match right_inverse(&u) {
            Some(weights) => kept.push(Resolved { line, active, weights }),
            None => lines_unresolved += 1,
        }
    }
    (kept, lines_unresolved)
}

/// Returns the RMS deviation of the periods from their mean for each output, which is the noise level of a periodic
/// record. `outputs` is `samples x p`; the first `transient` periods are discarded. A missing sample excludes only
/// that sample of that period.
///
/// # Errors
/// Returns [`SignalError::TooShort`] with fewer than two whole periods, [`SignalError::Infinite`] or
/// [`SignalError::Setting`].
pub fn period_noise_rms(outputs: ArrayView2<f64>, period: usize, transient: usize) -> Result<Vec<f64>, SignalError> {
    check_record("the output", outputs)?;
    let periods = whole_periods(outputs.nrows(), period, transient)?;
    let noise = outputs.columns().into_iter().map(|column| {
        let (mut sum, mut freedom) = (0.0, 0usize);
        for k in 0..period {
            let values: Vec<f64> = periods.clone().map(|r| column[r * period + k]).filter(|x| !x.is_nan()).collect();
            if values.len() > 1 {
                let mean = values.iter().sum::<f64>() / values.len() as f64;
                sum += values.iter().map(|x| (x - mean).powi(2)).sum::<f64>();
                freedom += values.len() - 1;
            }
        }
        (sum / freedom as f64).sqrt()
    });
    Ok(noise.collect())
}

/// The Fourier amplitudes of the mean period of a record, and the variance between its periods.
struct PeriodAverage {
    inputs: Array2<Complex64>,
    outputs: Array2<Complex64>,
    noise: Array2<f64>,
    used: usize,
    skipped: usize,
}

fn average_periods(record: &PeriodicRecord, period: usize, transient: usize) -> Result<PeriodAverage, SignalError> {
    let rows = |r: usize| s![r * period..(r + 1) * period, ..];
    let periods = whole_periods(record.outputs.nrows(), period, transient)?;
    let all = periods.len();
    let complete: Vec<usize> = periods
        .filter(|&r| {
            let holds_gap = |data: ArrayView2<f64>| data.slice(rows(r)).iter().any(|x| x.is_nan());
            !holds_gap(record.inputs) && !holds_gap(record.outputs)
        })
        .collect();
    let used = complete.len();
    if used < 2 {
        return Err(too_few_periods(used));
    }
    let mean = |spectra: &[Array2<Complex64>]| {
        let mut sum = Array2::<Complex64>::zeros(spectra[0].raw_dim());
        spectra.iter().for_each(|one| sum += one);
        sum.mapv(|z| z / spectra.len() as f64)
    };
    let transform = |data: ArrayView2<f64>| -> Vec<Array2<Complex64>> {
        complete.iter().map(|&r| amplitudes(data.slice(rows(r)))).collect()
    };
    let inputs = mean(&transform(record.inputs));
    let each = transform(record.outputs);
    let outputs = mean(&each);
    let mut noise = Array2::<f64>::zeros(outputs.raw_dim());
    for one in &each {
        noise.zip_mut_with(&(one - &outputs), |sum, z| *sum += z.norm_sqr() / (used - 1) as f64);
    }
    Ok(PeriodAverage { inputs, outputs, noise, used, skipped: all - used })
}

/// Returns the Fourier amplitudes of one period (`lines x channels`).
fn amplitudes(data: ArrayView2<f64>) -> Array2<Complex64> {
    let length = data.nrows();
    let mut result = Array2::zeros((length.div_ceil(2), data.ncols()));
    for (channel, column) in data.axis_iter(Axis(1)).enumerate() {
        let lines = plid_fourier::forward(&column.to_vec());
        for (to, line) in result.column_mut(channel).iter_mut().zip(lines) {
            *to = line / length as f64;
        }
    }
    result
}

/// Returns the W of least norm with U W = I, U^H (U U^H)^{-1}, or `None` if the records do not separate the inputs.
fn right_inverse(u: &DMatrix<Complex64>) -> Option<DMatrix<Complex64>> {
    if u.nrows() > u.ncols() {
        return None;
    }
    let singular = u.singular_values();
    if singular.min() <= 1e-6 * singular.max() {
        return None;
    }
    Some(u.adjoint() * (u * u.adjoint()).try_inverse()?)
}

fn whole_periods(samples: usize, period: usize, transient: usize) -> Result<std::ops::Range<usize>, SignalError> {
    if period < 3 {
        return Err(SignalError::Setting { name: "period", value: period as f64, allowed: "at least 3 samples" });
    }
    let periods = samples / period;
    if periods < transient + 2 {
        return Err(too_few_periods(periods.saturating_sub(transient)));
    }
    Ok(transient..periods)
}

fn too_few_periods(available: usize) -> SignalError {
    SignalError::TooShort {
        what: "averaging of periods",
        unit: "whole periods after the transient",
        needed: 2,
        available,
    }
}

fn check_channels(what: &'static str, data: ArrayView2<f64>, expected: usize) -> Result<(), SignalError> {
    if data.ncols() == expected {
        return Ok(());
    }
    Err(SignalError::ChannelMismatch { what, expected, found: data.ncols() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::signal::test_noise::white;
    use std::f64::consts::TAU;

    const PERIOD: usize = 101;

    /// Returns one period of noise, repeated.
    fn repeated(seed: u64, periods: usize, m: usize) -> Array2<f64> {
        let one = white(seed, PERIOD, m);
        Array2::from_shape_fn((PERIOD * periods, m), |(k, j)| one[[k % PERIOD, j]])
    }

    /// Simulates y_k = sum over inputs of g_j (u_{j,k} + 0.5 u_{j,k-1}) from rest.
    fn plant(u: &Array2<f64>, noise: f64, seed: u64) -> Array2<f64> {
        let e = white(seed, u.nrows(), 1) * noise;
        Array2::from_shape_fn((u.nrows(), 1), |(k, _)| {
            let past = |j: usize| if k > 0 { u[[k - 1, j]] } else { 0.0 };
            e[[k, 0]] + (0..u.ncols()).map(|j| (j + 1) as f64 * (u[[k, j]] + 0.5 * past(j))).sum::<f64>()
        })
    }

    fn response(f: f64, j: usize) -> Complex64 {
        (j + 1) as f64 * (1.0 + 0.5 * Complex64::from_polar(1.0, -TAU * f / 50.0))
    }

    #[test]
    fn two_records_part_two_inputs_within_the_stated_error() {
        let inputs = [repeated(1, 9, 2), repeated(2, 9, 2)];
        let outputs = [plant(&inputs[0], 0.2, 3), plant(&inputs[1], 0.2, 4)];
        let records: Vec<_> =
            (0..2).map(|e| PeriodicRecord { inputs: inputs[e].view(), outputs: outputs[e].view() }).collect();
        let frf = periodic_frf(&records, PERIOD, 1, 50.0).unwrap();
        assert_eq!((frf.frequency_hz.len(), frf.periods_used, frf.lines_unresolved), (50, 16, 0));
        let chi: f64 = frf
            .response
            .indexed_iter()
            .map(|((line, i, j), h)| {
                (h - response(frf.frequency_hz[line], j)).norm_sqr() / (2.0 * frf.response_std[[line, i, j]].powi(2))
            })
            .sum::<f64>()
            / 100.0;
        // The ratio of two estimates with 14 degrees of freedom has a mean of about 14/12.
        assert!((0.75..1.7).contains(&chi), "{chi}");
        // White noise of variance s^2 has lines of variance s^2 / period.
        let noise = frf.output_noise.mean().unwrap() * PERIOD as f64;
        assert!((noise / 0.04 - 1.0).abs() < 0.15, "{noise}");
        let rms = period_noise_rms(outputs[0].view(), PERIOD, 1).unwrap()[0];
        assert!((rms / 0.2 - 1.0).abs() < 0.07, "{rms}");
    }

    #[test]
    fn inputs_that_take_turns_need_one_record() {
        let u = Array2::from_shape_fn((PERIOD * 4, 2), |(k, j)| {
            (1..20)
                .filter(|line| line % 2 == j)
                .map(|line| (TAU * (line * k) as f64 / PERIOD as f64 + (line * line) as f64).cos())
                .sum()
        });
        let y = plant(&u, 0.0, 0);
        let frf = periodic_frf(&[PeriodicRecord { inputs: u.view(), outputs: y.view() }], PERIOD, 1, 50.0).unwrap();
        assert_eq!(frf.frequency_hz.len(), 19);
        for (line, f) in frf.frequency_hz.iter().enumerate() {
            let acting = (line + 1) % 2;
            assert!((frf.response[[line, 0, acting]] - response(*f, acting)).norm() < 1e-12);
            assert!(frf.response[[line, 0, 1 - acting]].re.is_nan());
        }
    }

    #[test]
    fn gaps_cost_their_period_and_bad_records_are_refused() {
        let u = repeated(5, 6, 1);
        let mut y = plant(&u, 0.1, 6);
        y[[250, 0]] = f64::NAN;
        let record = PeriodicRecord { inputs: u.view(), outputs: y.view() };
        let frf = periodic_frf(&[record], PERIOD, 1, 50.0).unwrap();
        assert_eq!((frf.periods_used, frf.periods_skipped), (4, 1));
        assert!((period_noise_rms(y.view(), PERIOD, 1).unwrap()[0] / 0.1 - 1.0).abs() < 0.15);
        assert_eq!(periodic_frf(&[record], PERIOD, 5, 50.0).unwrap_err(), too_few_periods(1));
        assert!(matches!(periodic_frf(&[record], 2, 0, 50.0), Err(SignalError::Setting { .. })));
        let both = repeated(7, 6, 2);
        let y = plant(&both, 0.1, 6);
        let record = PeriodicRecord { inputs: both.view(), outputs: y.view() };
        assert_eq!(periodic_frf(&[record], PERIOD, 1, 50.0).unwrap_err(), SignalError::NoResolvableLine { records: 1 });
        let still = Array2::zeros((606, 1));
        let record = PeriodicRecord { inputs: still.view(), outputs: still.view() };
        assert_eq!(periodic_frf(&[record], PERIOD, 1, 50.0).unwrap_err(), SignalError::NoResolvableLine { records: 1 });
    }
}
