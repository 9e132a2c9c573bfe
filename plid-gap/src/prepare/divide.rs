//! The division of a record that shows a gap where the others do not. A stop that only one record reaches must be
//! both fitted and judged in that record.

use crate::case::record::{Channels, Excitation, Record};
use crate::case::split::divided;
use crate::settings::CaseSettings;

/// Divides a record that shows a gap where the others do not. This is the held-out record if the gap of the
/// simulation as given is several times larger there than in every fitted one; or it is the fitted record with the
/// largest gap, if that gap is several times larger than in the held-out record and the fitted record is as loud. The
/// first part of the record, up to half of the power of its error, is fitted, and the remainder is held out. `errors`
/// are the errors of the simulation as given in the fitted records, and `error_of` gives the error in a record. If
/// the held-out record is the end of another one, nothing is divided.
pub(super) fn divide(
    fitted: &mut Vec<Record>,
    held_out: &mut Vec<Record>,
    errors: &mut Vec<Channels>,
    error_of: impl Fn(&Record) -> Channels,
    settings: &CaseSettings,
) {
    let [last] = held_out.as_slice() else { return };
    if fitted.iter().any(|record| record.start_s == last.start_s) {
        return;
    }
    let error = error_of(last);
    let seen = gap(last, &error);
    let most = fitted.iter().map(Record::level).fold(last.level(), f64::max);
    let driven = (0..fitted.len()).filter(|&k| fitted[k].is_driven()).map(|k| (k, gap(&fitted[k], &errors[k])));
    let largest = driven.max_by(|a, b| a.1.total_cmp(&b.1));
    if largest.is_none_or(|(_, largest)| seen > settings.alone_gap * largest) {
        let Some(at) = middle(last, &error) else { return };
        let (head, tail) = divided(last, at);
        errors.push(beginning(error, at));
        fitted.push(Record { held_out: false, ..head });
        held_out[0] = tail;
    } else if let Some((k, largest)) = largest
        && largest > settings.alone_gap * seen
        && settings.same_level * fitted[k].level() > most
        && let Some(at) = middle(&fitted[k], &errors[k])
    {
        let (head, tail) = divided(&fitted[k], at);
        errors[k] = beginning(std::mem::take(&mut errors[k]), at);
        fitted[k] = head;
        held_out.push(Record { held_out: true, ..tail });
    }
}

/// Returns the number of samples with half of the power of an error, rounded up to whole periods; `None` if nothing
/// would remain on one side.
fn middle(record: &Record, error: &Channels) -> Option<usize> {
    let at = half(error);
    let at = match record.excitation {
        Excitation::Periodic(period) => at.div_ceil(period) * period,
        _ => at,
    };
    (0 < at && at < record.samples()).then_some(at)
}

/// Returns the first samples of all channels.
fn beginning(mut channels: Channels, samples: usize) -> Channels {
    channels.iter_mut().for_each(|channel| channel.truncate(samples));
    channels
}

/// Returns the power of the finite values.
fn power<'x>(x: impl IntoIterator<Item = &'x f64>) -> f64 {
    x.into_iter().filter(|x| x.is_finite()).map(|x| x * x).sum()
}

/// Returns the relative RMS error of a record, as the root mean square over all outputs.
fn gap(record: &Record, error: &Channels) -> f64 {
    let shares = record.y.iter().zip(error).map(|(y, e)| power(e) / power(y).max(f64::MIN_POSITIVE));
    (shares.sum::<f64>() / record.y.len().max(1) as f64).sqrt()
}

/// Returns the number of samples with half of the power of an error, in which all channels have the same weight.
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

    /// Returns the records of a case with all outputs set to one: all except the last, and the last.
    fn records() -> (Vec<Record>, Record) {
        let mut records = case(&truss(1), &truss(1)).records;
        records.iter_mut().flat_map(|record| &mut record.y).for_each(|y| y.fill(1.0));
        let last = records.pop().unwrap();
        assert!(records.iter().any(Record::is_driven));
        (records, last)
    }

    /// Returns errors of 2 %, except in one record, where they are zero before the 300th sample and `off` from there
    /// on.
    fn error_in(name: &str, off: f64) -> impl Fn(&Record) -> Channels {
        move |record: &Record| {
            let of = |k: usize| match (record.name == name, k < 300) {
                (false, _) => 0.02,
                (true, true) => 0.0,
                (true, false) => off,
            };
            vec![(0..record.samples()).map(of).collect(); record.y.len()]
        }
    }

    fn finite(record: &Record) -> usize {
        record.y[0].iter().filter(|y| y.is_finite()).count()
    }

    /// Only the last record is off by half, from its 300th sample on. It is fitted up to the middle of the remaining
    /// samples, and held out from there. A record that is off by as little as the others is not fitted, and the end
    /// of another record is not divided.
    #[test]
    fn the_beginning_of_a_record_that_alone_shows_the_gap_is_fitted() {
        let (others, last) = records();
        let (samples, before) = (last.samples(), others.last().unwrap().start_s);
        for (off, start_s, divides) in [(0.5, last.start_s, true), (0.01, last.start_s, false), (0.5, before, false)] {
            let mut fitted = others.clone();
            let mut held_out = vec![Record { start_s, held_out: true, ..last.clone() }];
            let error_of = error_in(&last.name, off);
            let mut errors: Vec<Channels> = fitted.iter().map(&error_of).collect();
            divide(&mut fitted, &mut held_out, &mut errors, error_of, &CaseSettings::default());
            assert_eq!(fitted.len() > others.len(), divides, "{off} {start_s}");
            assert!(errors.iter().map(|error| error[0].len()).eq(fitted.iter().map(Record::samples)));
            assert!(held_out.len() == 1 && held_out[0].held_out && fitted.iter().all(|record| !record.held_out));
            if divides {
                let head = fitted.last().unwrap();
                assert!(head.samples().abs_diff(300 + (samples - 300) / 2) <= 1);
                assert_eq!(head.samples() + finite(&held_out[0]), samples);
            } else {
                assert_eq!(finite(&held_out[0]), samples);
            }
        }
    }

    /// A fitted record is off by half. Its end is then held out in addition to the last record, but not if the record
    /// is so quiet that noise may be the reason.
    #[test]
    fn the_end_of_a_fitted_record_that_shows_the_gap_is_held_out() {
        let (mut others, last) = records();
        let at = others.iter().position(Record::is_driven).unwrap();
        others[at].name = "alone".into();
        for quieter in [1.0, 0.1] {
            let mut fitted = others.clone();
            fitted[at].u.iter_mut().flatten().for_each(|u| *u *= quieter);
            let mut held_out = vec![Record { held_out: true, ..last.clone() }];
            let error_of = error_in("alone", 0.5);
            let mut errors: Vec<Channels> = fitted.iter().map(&error_of).collect();
            divide(&mut fitted, &mut held_out, &mut errors, error_of, &CaseSettings::default());
            assert_eq!(held_out.len(), if quieter == 1.0 { 2 } else { 1 });
            assert!(errors.iter().map(|error| error[0].len()).eq(fitted.iter().map(Record::samples)));
            if let Some(end) = held_out.get(1) {
                assert!(end.held_out && finite(end) > 0);
                assert_eq!(fitted[at].samples() + finite(end), others[at].samples());
            }
        }
    }
}
