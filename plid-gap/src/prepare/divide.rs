//! The held-out record where it alone shows the gap. A stop that only one record reaches must be fitted where it is
//! reached.

use crate::case::record::{Channels, Record};
use crate::case::split::divided;
use crate::settings::CaseSettings;

/// Fits the first part of the held-out record, up to half of the power of its error, if the gap of the simulation as
/// given is several times larger there than in every fitted one. The remainder stays held out. `errors` are those of
/// that simulation in the fitted records, to which that of the first part is added, and `error_of` gives the error in a
/// record. The held-out end of a record is not divided again.
pub(super) fn divide(
    fitted: &mut Vec<Record>,
    held_out: &mut [Record],
    errors: &mut Vec<Channels>,
    error_of: impl Fn(&Record) -> Channels,
    settings: &CaseSettings,
) {
    let [held_out] = held_out else { return };
    if fitted.iter().any(|record| record.start_s == held_out.start_s) {
        return;
    }
    let mut error = error_of(held_out);
    let driven = fitted.iter().zip(errors.iter()).filter(|(record, _)| record.is_driven());
    let largest = driven.map(|(record, error)| gap(record, error)).fold(0.0, f64::max);
    if gap(held_out, &error) <= settings.alone_gap * largest {
        return;
    }
    let at = half(&error);
    let (head, tail) = divided(held_out, at);
    fitted.push(Record { held_out: false, ..head });
    error.iter_mut().for_each(|error| error.truncate(at));
    errors.push(error);
    *held_out = tail;
}

/// Returns the power of the finite values.
fn power<'x>(x: impl IntoIterator<Item = &'x f64>) -> f64 {
    x.into_iter().filter(|x| x.is_finite()).map(|x| x * x).sum()
}

/// Returns the RMS of a record's error over that of its outputs, as the root mean square of all outputs.
fn gap(record: &Record, error: &Channels) -> f64 {
    let shares = record.y.iter().zip(error).map(|(y, e)| power(e) / power(y).max(f64::MIN_POSITIVE));
    (shares.sum::<f64>() / record.y.len().max(1) as f64).sqrt()
}

/// Returns the number of samples with half of the power of an error, each channel of which counts alike.
fn half(error: &Channels) -> usize {
    let whole: Vec<f64> = error.iter().map(|e| power(e).max(f64::MIN_POSITIVE)).collect();
    let at = |k: usize| -> f64 { error.iter().zip(&whole).map(|(e, whole)| power([&e[k]]) / whole).sum() };
    let samples = error.first().map_or(0, Vec::len);
    let mut sum = 0.0;
    let reaches = |k: &usize| {
        sum += at(*k);
        sum >= 0.5 * error.len() as f64
    };
    (0..samples).find(reaches).map_or(samples, |k| k + 1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{case, truss};

    /// The last record alone is off by half, from its 300th sample on. It is fitted up to the middle of that, and held
    /// out from there. A record that is off by as little as the others is not fitted, and an end of one is not divided.
    #[test]
    fn the_beginning_of_a_record_that_alone_shows_the_gap_is_fitted() {
        let mut records = case(&truss(1), &truss(1)).records;
        records.iter_mut().flat_map(|record| &mut record.y).for_each(|y| y.fill(1.0));
        let (last, others) = records.split_last().unwrap();
        assert!(others.iter().any(Record::is_driven));
        let (samples, before) = (last.samples(), others.last().unwrap().start_s);
        for (off, start_s, divides) in [(0.5, last.start_s, true), (0.01, last.start_s, false), (0.5, before, false)] {
            let mut fitted = others.to_vec();
            let mut held_out = [Record { start_s, held_out: true, ..last.clone() }];
            let error_of = |record: &Record| -> Channels {
                let of = |k| {
                    if record.name != last.name {
                        0.02
                    } else if k < 300 {
                        0.0
                    } else {
                        off
                    }
                };
                vec![(0..record.samples()).map(of).collect(); record.y.len()]
            };
            let mut errors: Vec<Channels> = fitted.iter().map(error_of).collect();
            divide(&mut fitted, &mut held_out, &mut errors, error_of, &CaseSettings::default());
            assert_eq!(fitted.len() > others.len(), divides, "{off} {start_s}");
            assert!(errors.iter().map(|error| error[0].len()).eq(fitted.iter().map(Record::samples)));
            let judged = held_out[0].y[0].iter().filter(|y| y.is_finite()).count();
            assert!(held_out[0].held_out && fitted.iter().all(|record| !record.held_out));
            if divides {
                let head = fitted.last().unwrap();
                assert!(head.samples().abs_diff(300 + (samples - 300) / 2) <= 1);
                assert_eq!(head.samples() + judged, samples);
            } else {
                assert_eq!(judged, samples);
            }
        }
    }
}
