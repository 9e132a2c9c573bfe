//! Levels of the records, and one record of each.

use crate::case::record::{Channels, Excitation, Record, rms};

/// A driven record with its simulations.
#[derive(Debug, Clone, PartialEq)]
pub struct LevelRun {
    /// Name of the record.
    pub record: String,
    /// RMS of its inputs.
    pub level: f64,
    /// Inputs (m channels).
    pub u: Channels,
    /// Measured outputs (p channels).
    pub y: Channels,
    /// The simulation as given (p channels).
    pub given: Channels,
    /// The simulation with the effects (p channels).
    pub with: Channels,
}

/// Returns the longest random record of each level, in order of increasing level; if no record is random, the longest
/// driven one of each level. Levels whose ratio is below `same_level` count as one level.
pub fn one_of_each_level(records: &[Record], same_level: f64) -> Vec<&Record> {
    let random = |r: &&Record| r.excitation == Excitation::Random && r.is_driven();
    let mut left: Vec<&Record> = records.iter().filter(random).collect();
    if left.is_empty() {
        left = records.iter().filter(|r| r.is_driven()).collect();
    }
    // The longest record represents its level.
    left.sort_by_key(|r| std::cmp::Reverse(r.samples()));
    let mut chosen: Vec<&Record> = Vec::new();
    for record in left {
        let alike = |other: &&Record| {
            let ratio = record.level() / other.level();
            ratio < same_level && ratio > 1.0 / same_level
        };
        if !chosen.iter().any(alike) {
            chosen.push(record);
        }
    }
    chosen.sort_by(|a, b| a.level().total_cmp(&b.level()));
    chosen
}

/// Returns the last of the loudest records, preferably a random one, because a drift is most visible there. Levels
/// whose ratio is below `same_level` count as one level.
pub(crate) fn loudest(records: &[Record], same_level: f64) -> &Record {
    let most = records.iter().map(Record::level).fold(0.0, f64::max);
    let loud = || records.iter().rev().filter(|r| r.level() * same_level > most);
    let random = loud().find(|r| r.excitation == Excitation::Random);
    random.or(loud().next()).unwrap_or(&records[0])
}

/// Returns whether twice the input gives twice the output, as every linear simulation from rest does. `respond` runs a
/// simulation. Outputs that do not depend on the input, such as an offset or hum, are subtracted first.
pub fn is_linear(u: &[Vec<f64>], respond: impl Fn(&[Vec<f64>]) -> Channels) -> bool {
    let scaled = |by: f64| -> Channels { u.iter().map(|u| u.iter().map(|u| by * u).collect()).collect() };
    let [none, once, twice] = [0.0, 1.0, 2.0].map(|by| respond(&scaled(by)));
    let flat = |y: &Channels| y.iter().flatten().copied().collect::<Vec<f64>>();
    let (none, once, twice) = (flat(&none), flat(&once), flat(&twice));
    let beyond: Vec<f64> = (0..once.len()).map(|k| (twice[k] - none[k]) - 2.0 * (once[k] - none[k])).collect();
    let whole: Vec<f64> = once.iter().zip(&none).map(|(y, y0)| y - y0).collect();
    // Rounding causes a relative error of 1e-12; the weakest effect that exceeds the noise causes about 1e-4.
    rms(&beyond) <= 1e-6 * rms(&whole)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(level: f64, samples: usize, excitation: Excitation) -> Record {
        Record { excitation, ..crate::testing::record(vec![vec![level; samples]], vec![vec![0.0; samples]]) }
    }

    #[test]
    fn each_level_is_there_once_by_its_longest_record() {
        let random = Excitation::Random;
        let records = [
            record(0.0, 90, Excitation::Zero),
            record(1.0, 50, random),
            record(0.3, 50, random),
            record(1.05, 80, random),
            record(2.0, 500, Excitation::Periodic(50)),
        ];
        let levels =
            |records: &[Record]| one_of_each_level(records, 1.15).iter().map(|r| r.u[0][0]).collect::<Vec<f64>>();
        assert_eq!(levels(&records), [0.3, 1.05]);
        assert_eq!(levels(&[records[0].clone(), records[4].clone()]), [2.0]);
        assert!(levels(&records[..1]).is_empty());
    }

    #[test]
    fn a_gain_and_an_offset_are_linear_and_a_limit_is_not() {
        let u = vec![vec![0.5, -1.0, 0.25]];
        let map = |f: fn(f64) -> f64| move |u: &[Vec<f64>]| vec![u[0].iter().map(|u| f(*u)).collect::<Vec<_>>()];
        assert!(is_linear(&u, map(|u| 3.0 * u)));
        assert!(is_linear(&u, map(|u| 3.0 * u + 7.0)));
        assert!(!is_linear(&u, map(|u| u.clamp(-1.2, 1.2))));
        assert!(!is_linear(&u, map(|u| u + 1e-3 * u * u)));
    }
}
