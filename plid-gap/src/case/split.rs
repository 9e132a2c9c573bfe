//! The records that are held out from all fits: those that the case names, or else the last driven record that is not
//! louder than all others. The loudest record is fitted, because the other records do not determine the behaviour of a
//! nonlinearity at that level. If only one record is driven, or two at different levels, the end of the last one is
//! held out. A record whose input is nearly zero, such as a controller's in a quiet record, is never held out: it
//! shows the noise.

use crate::case::record::{Channels, Record, rms};
use crate::settings::CaseSettings;

/// The part that is held out if the case names none.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Unnamed {
    /// The whole of this record.
    Whole(usize),
    /// The end of this record.
    EndOf(usize),
}

/// Chooses the part that is held out among records whose inputs have these RMS values; zero means that a record is not
/// driven.
pub(crate) fn unnamed(levels: &[f64], settings: &CaseSettings) -> Option<Unnamed> {
    let loudest = levels.iter().copied().fold(0.0, f64::max);
    let shows = |k: &usize| levels[*k] > settings.least_held_out_level * loudest;
    let driven: Vec<usize> = (0..levels.len()).filter(shows).collect();
    let as_loud = |k: usize, other: usize| other != k && settings.same_level * levels[other] > levels[k];
    let not_loudest = |k: &&usize| driven.iter().any(|&other| as_loud(**k, other));
    match driven[..] {
        [] => None,
        [only] => Some(Unnamed::EndOf(only)),
        // Each of the two records contains a level that the other does not.
        [first, last] if !(as_loud(first, last) && as_loud(last, first)) => Some(Unnamed::EndOf(last)),
        _ => driven.iter().rev().find(not_loudest).copied().map(Unnamed::Whole),
    }
}

/// Returns the number of samples of a record that are fitted, if this share of the record is held out.
pub(crate) fn fitted(samples: usize, held_out_share: f64) -> usize {
    (samples as f64 * (1.0 - held_out_share)) as usize
}

fn of(records: &[Record], settings: &CaseSettings) -> Option<Unnamed> {
    if records.iter().any(|record| record.held_out) {
        return None;
    }
    let level = |record: &Record| if record.is_driven() { record.level() } else { 0.0 };
    let chosen = unnamed(&records.iter().map(level).collect::<Vec<f64>>(), settings)?;
    let drives = |record: &Record, i: usize| record.is_driven() && rms(&record.u[i]) > 0.0;
    // An input that no other record drives would be driven in no fitted record.
    let alone = |k: usize, i: usize| drives(&records[k], i) && records.iter().filter(|r| drives(r, i)).count() == 1;
    Some(match chosen {
        Unnamed::Whole(k) if (0..records[k].u.len()).any(|i| alone(k, i)) => Unnamed::EndOf(k),
        chosen => chosen,
    })
}

/// Returns the records that are fitted and those that are held out.
pub(crate) fn split(records: &[Record], settings: &CaseSettings) -> (Vec<Record>, Vec<Record>) {
    let mut fit = records.to_vec();
    match of(records, settings) {
        None => fit.into_iter().partition(|record| !record.held_out),
        Some(Unnamed::Whole(whole)) => {
            let held_out = vec![fit.remove(whole)];
            (fit, held_out)
        }
        Some(Unnamed::EndOf(one)) => {
            let at = fitted(records[one].samples(), settings.held_out_share);
            let (head, tail) = divided(&records[one], at);
            fit[one] = head;
            (fit, vec![tail])
        }
    }
}

/// Returns the driven records that are not held out as a whole.
pub(crate) fn driven<'r>(records: &'r [Record], settings: &CaseSettings) -> Vec<&'r Record> {
    let unnamed = of(records, settings);
    let counts = |k: usize, r: &Record| unnamed != Some(Unnamed::Whole(k)) && !r.held_out && r.is_driven();
    records.iter().enumerate().filter(|(k, r)| counts(*k, r)).map(|(_, r)| r).collect()
}

/// Returns the first samples of a record, and the whole record without the measurements of these samples. The latter
/// is simulated from its own start and judged on the remainder.
pub(crate) fn divided(record: &Record, at: usize) -> (Record, Record) {
    let part = |channels: &Channels| channels.iter().map(|x| x[..at].to_vec()).collect();
    let simulated = record.simulated.as_ref().map(part);
    let head = Record { u: part(&record.u), y: part(&record.y), simulated, ..record.clone() };
    let mut tail = record.clone();
    tail.y.iter_mut().for_each(|y| y[..at].fill(f64::NAN));
    let share = 1.0 - at as f64 / record.samples() as f64;
    tail.name = format!("the last {:.0} % of {}", 100.0 * share, record.name);
    (head, tail)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{case, truss};

    fn names(records: &[Record]) -> Vec<&str> {
        records.iter().map(|record| record.name.as_str()).collect()
    }

    #[test]
    fn the_last_driven_record_is_held_out_where_the_case_names_none() {
        let mut records = case(&truss(1), &truss(1)).records;
        let (fit, held_out) = split(&records, &CaseSettings::default());
        assert_eq!((names(&fit), names(&held_out)), (vec!["quiet", "random-1", "random-2"], vec!["random-3"]));
        let at_work = |records: &[Record]| {
            driven(records, &CaseSettings::default()).iter().map(|record| record.name.clone()).collect::<Vec<_>>()
        };
        assert_eq!(at_work(&records), ["random-1", "random-2"]);
        records[1].held_out = true;
        let (fit, held_out) = split(&records, &CaseSettings::default());
        assert_eq!((names(&fit), names(&held_out)), (vec!["quiet", "random-2", "random-3"], vec!["random-1"]));
        assert_eq!(at_work(&records), ["random-2", "random-3"]);
        records.drain(1..3);
        assert_eq!(at_work(&records), ["random-3"]);
    }

    /// If the last record alone drives an input, its end alone is held out.
    #[test]
    fn every_input_is_driven_in_a_fitted_record() {
        let mut records = case(&truss(1), &truss(1)).records;
        records.truncate(3);
        for (record, (quiet, level)) in records[1..].iter_mut().zip([(1, 1.0), (0, 2.0)]) {
            record.u.iter_mut().flatten().for_each(|u| *u *= level);
            record.u[quiet].fill(0.0);
        }
        let (fit, held_out) = split(&records, &CaseSettings::default());
        assert_eq!(names(&fit), ["quiet", "random-1", "random-2"]);
        assert!(held_out[0].name.starts_with("the last") && held_out.len() == 1, "{:?}", names(&held_out));
    }

    /// The loudest record is fitted. Of two records at different levels, neither is held out as a whole.
    #[test]
    fn the_loudest_record_is_fitted() {
        let settings = CaseSettings::default();
        let unnamed = |levels: &[f64]| unnamed(levels, &settings);
        assert_eq!(unnamed(&[0.0, 1.0, 2.0, 4.0]), Some(Unnamed::Whole(2)));
        assert_eq!(unnamed(&[4.0, 1.0, 0.0, 3.9]), Some(Unnamed::Whole(3)));
        assert_eq!(unnamed(&[1.0, 4.0]), Some(Unnamed::EndOf(1)));
        assert_eq!(unnamed(&[4.0, 1.0]), Some(Unnamed::EndOf(1)));
        assert_eq!(unnamed(&[1.0, 1.05]), Some(Unnamed::Whole(1)));
        assert_eq!(unnamed(&[0.0, 0.0]), None);
        // The input of a quiet record may be measured with noise.
        assert_eq!(unnamed(&[1.0, 1.0, 0.01]), Some(Unnamed::Whole(1)));
        assert_eq!(unnamed(&[1.0, 0.01]), Some(Unnamed::EndOf(0)));
    }

    #[test]
    fn of_the_only_driven_record_the_end_is_held_out() {
        let mut records = case(&truss(1), &truss(1)).records;
        records.drain(2..);
        let (fit, held_out) = split(&records, &CaseSettings::default());
        let (samples, at) = (records[1].samples(), fitted(records[1].samples(), 0.25));
        assert_eq!(fit[1].y[0], records[1].y[0][..at]);
        assert_eq!(held_out[0].samples(), samples);
        assert_eq!(held_out[0].y[0].iter().filter(|y| y.is_finite()).count(), samples - at);
        assert_eq!(held_out[0].y[0][at..], records[1].y[0][at..]);
        assert_eq!(driven(&records, &CaseSettings::default()).len(), 1);
    }

    #[test]
    fn without_a_driven_record_nothing_is_held_out() {
        let mut records = case(&truss(1), &truss(1)).records;
        records.truncate(1);
        assert_eq!(split(&records, &CaseSettings::default()).1, []);
    }
}
