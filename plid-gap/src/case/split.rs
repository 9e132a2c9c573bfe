//! The records that are held out from all fits: those that the case names, or else the last driven record, or the end
//! of the only driven one.

use crate::case::record::{Channels, Excitation, Record};

/// What is held out if the case names nothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Unnamed {
    /// This record.
    Last(usize),
    /// The end of this record, which is the only driven one.
    EndOf(usize),
}

/// Chooses among records, each of which is driven or not.
pub(crate) fn unnamed(driven: impl DoubleEndedIterator<Item = bool> + ExactSizeIterator) -> Option<Unnamed> {
    let mut driven = driven.enumerate().rev().filter(|(_, driven)| *driven).map(|(k, _)| k);
    let last = driven.next()?;
    Some(if driven.next().is_some() { Unnamed::Last(last) } else { Unnamed::EndOf(last) })
}

/// Returns how many samples of the only driven record are fitted, if this share of it is held out.
pub(crate) fn fitted(samples: usize, held_out_share: f64) -> usize {
    (samples as f64 * (1.0 - held_out_share)) as usize
}

fn of(records: &[Record]) -> Option<Unnamed> {
    if records.iter().any(|record| record.held_out) {
        return None;
    }
    unnamed(records.iter().map(|record| record.excitation != Excitation::Zero))
}

/// Returns the records that are fitted and those that are held out. If only one record is driven, this share of it is
/// held out.
pub(crate) fn split(records: &[Record], held_out_share: f64) -> (Vec<Record>, Vec<Record>) {
    let mut fit = records.to_vec();
    match of(records) {
        None => fit.into_iter().partition(|record| !record.held_out),
        Some(Unnamed::Last(last)) => {
            let held_out = vec![fit.remove(last)];
            (fit, held_out)
        }
        Some(Unnamed::EndOf(only)) => {
            let at = fitted(records[only].samples(), held_out_share);
            fit[only] = head(&records[only], at);
            (fit, vec![tail(&records[only], at, held_out_share)])
        }
    }
}

/// Returns the driven records that are not held out as a whole.
pub(crate) fn driven(records: &[Record]) -> Vec<&Record> {
    let unnamed = of(records);
    let counts = |k: usize, r: &Record| {
        unnamed != Some(Unnamed::Last(k)) && !r.held_out && r.excitation != Excitation::Zero && r.level() > 0.0
    };
    records.iter().enumerate().filter(|(k, r)| counts(*k, r)).map(|(_, r)| r).collect()
}

/// Returns the first samples of a record.
fn head(record: &Record, samples: usize) -> Record {
    let part = |channels: &Channels| channels.iter().map(|x| x[..samples].to_vec()).collect();
    Record { u: part(&record.u), y: part(&record.y), simulated: record.simulated.as_ref().map(part), ..record.clone() }
}

/// Returns a record without measurements of its first samples. It is simulated from its own start and judged on the
/// remainder.
fn tail(record: &Record, from: usize, held_out_share: f64) -> Record {
    let mut tail = record.clone();
    tail.y.iter_mut().for_each(|y| y[..from].fill(f64::NAN));
    tail.name = format!("the last {:.0} % of {}", 100.0 * held_out_share, record.name);
    tail
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
        let (fit, held_out) = split(&records, 0.25);
        assert_eq!((names(&fit), names(&held_out)), (vec!["quiet", "random-1", "random-2"], vec!["random-3"]));
        let at_work = |records: &[Record]| driven(records).iter().map(|record| record.name.clone()).collect::<Vec<_>>();
        assert_eq!(at_work(&records), ["random-1", "random-2"]);
        records[1].held_out = true;
        let (fit, held_out) = split(&records, 0.25);
        assert_eq!((names(&fit), names(&held_out)), (vec!["quiet", "random-2", "random-3"], vec!["random-1"]));
        assert_eq!(at_work(&records), ["random-2", "random-3"]);
        records.drain(1..3);
        assert_eq!(at_work(&records), ["random-3"]);
    }

    #[test]
    fn of_the_only_driven_record_the_end_is_held_out() {
        let mut records = case(&truss(1), &truss(1)).records;
        records.drain(2..);
        let (fit, held_out) = split(&records, 0.25);
        let (samples, at) = (records[1].samples(), fitted(records[1].samples(), 0.25));
        assert_eq!(fit[1].y[0], records[1].y[0][..at]);
        assert_eq!(held_out[0].samples(), samples);
        assert_eq!(held_out[0].y[0].iter().filter(|y| y.is_finite()).count(), samples - at);
        assert_eq!(held_out[0].y[0][at..], records[1].y[0][at..]);
        assert_eq!(driven(&records).len(), 1);
    }

    #[test]
    fn without_a_driven_record_nothing_is_held_out() {
        let mut records = case(&truss(1), &truss(1)).records;
        records.truncate(1);
        assert_eq!(split(&records, 0.25).1, []);
    }
}
