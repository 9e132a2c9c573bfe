//! The response of periodic records at lines that the input does not contain.
//!
//! A linear structure responds to a periodic input at the lines of the input only. If the input has odd lines only (1,
//! 3, 5, ... cycles in a period), an odd nonlinearity adds odd lines and an even one adds even lines. The lines that a
//! multisine leaves out therefore show the kind of nonlinearity without any model (Pintelon and Schoukens, System
//! Identification, 2012, chapter 4).

use crate::case::record::{Channels, Excitation, Record};
use crate::settings::{EvidenceSettings, GapSettings};
use crate::signal::lines::{driven, periods, used};
use plid_report::percent;

/// Least number of periods that are averaged, because the noise is estimated from their differences.
const LEAST_PERIODS: usize = 2;

/// Number of neighbouring lines over which the noise is averaged, which gives a relative scatter of about a fifth.
const NEIGHBOURS: usize = 21;

/// The role of a line in a multisine of odd lines.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// A line of the input; it is odd.
    Driven,
    /// An odd line that the input leaves out.
    Odd,
    /// An even line.
    Even,
}

/// One line of an output.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Line {
    /// Frequency in Hz.
    pub hz: f64,
    /// Its role in the input.
    pub kind: Kind,
    /// RMS of the periodic part, in the output's unit. For a line that the input leaves out it is that of the residual
    /// of the linear simulation, which contains the same transient.
    pub measured: f64,
    /// `measured` for the simulation with the effects that were found.
    pub simulated: f64,
    /// RMS of the noise in `measured`, from the differences between periods, averaged over neighbouring lines.
    pub noise: f64,
}

/// The lines of a record.
#[derive(Debug, Clone, PartialEq)]
pub struct Lines {
    /// Name of the record.
    pub record: String,
    /// The lines of each output (p); an output has none if fewer than two of its periods have all of their samples.
    pub outputs: Vec<Vec<Line>>,
    /// Number of periods averaged, of the output that has the fewest. Periods with missing samples are left out.
    pub periods: usize,
}

/// The response at the lines of one kind.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Answer {
    /// RMS of a line beyond the noise over that of a line of the input, averaged over the outputs.
    pub share: f64,
    /// `share` for the simulation with the effects that were found.
    pub simulated: f64,
    /// Whether the response exceeds the noise by more than chance allows.
    pub clear: bool,
}

impl Lines {
    /// Returns the lines of the loudest record whose inputs have odd lines only, leave out some of them, and repeat
    /// often enough; `None` if there is no such record. `linear` and `with` simulate a record without and with the
    /// effects that were found (p channels each).
    pub fn of(
        records: &[Record],
        rate: f64,
        linear: impl Fn(&Record) -> Channels,
        with: impl Fn(&Record) -> Channels,
        settings: &GapSettings,
    ) -> Option<Self> {
        let odd = records.iter().filter_map(|record| Some((record, kinds(record, settings)?)));
        let (record, (period, kinds)) = odd.max_by(|a, b| a.0.level().total_cmp(&b.0.level()))?;
        let (linear, with) = (linear(record), with(record));
        let starts = used(record.samples(), period);
        let one = |o: usize| {
            let present = |k: usize| record.y[o][k].is_finite() && linear[o][k].is_finite() && with[o][k].is_finite();
            let whole = |from: &usize| (*from..from + period).all(present);
            let starts: Vec<usize> = starts.iter().copied().filter(whole).collect();
            if starts.len() < LEAST_PERIODS {
                return (Vec::new(), starts.len());
            }
            let y = periods(&record.y[o], period, &starts);
            let error = |from: &[f64]| -> Vec<f64> { from.iter().zip(&linear[o]).map(|(y, s)| y - s).collect() };
            let [left, added] = [error(&record.y[o]), error(&with[o])].map(|x| periods(&x, period, &starts));
            let simulated = periods(&with[o], period, &starts);
            let noise = smooth(&left.iter().map(|line| line.1).collect::<Vec<f64>>());
            let line = |(k, kind): (usize, &Option<Kind>)| {
                let kind = (*kind)?;
                let of = |driven: &[(f64, f64)], not: &[(f64, f64)]| {
                    if kind == Kind::Driven { driven[k].0 } else { not[k].0 }
                };
                Some(Line {
                    hz: rate * k as f64 / period as f64,
                    kind,
                    measured: of(&y, &left).sqrt(),
                    simulated: of(&simulated, &added).sqrt(),
                    noise: noise[k].sqrt(),
                })
            };
            (kinds.iter().enumerate().filter_map(line).collect(), starts.len())
        };
        let (outputs, periods): (Vec<Vec<Line>>, Vec<usize>) = (0..record.y.len()).map(one).unzip();
        let periods = periods.into_iter().filter(|count| *count >= LEAST_PERIODS).min().unwrap_or(LEAST_PERIODS);
        Some(Self { record: record.name.clone(), outputs, periods })
    }

    /// Returns the response at the lines of one kind; `None` if every output lacks samples in too many periods.
    pub fn answer(&self, kind: Kind, settings: &EvidenceSettings) -> Option<Answer> {
        let of = |lines: &[Line], kind: Kind, value: &dyn Fn(&Line) -> f64| -> (f64, f64) {
            let chosen = lines.iter().filter(|line| line.kind == kind);
            chosen.fold((0.0, 0.0), |(sum, count), line| (sum + value(line), count + 1.0))
        };
        let (mut measured, mut simulated, mut over, mut count, mut outputs) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for lines in self.outputs.iter().filter(|lines| !lines.is_empty()) {
            let mean = |kind: Kind, value: &dyn Fn(&Line) -> f64| {
                let (sum, count) = of(lines, kind, value);
                sum / count
            };
            let driven = mean(Kind::Driven, &|line| line.measured.powi(2)).max(f64::MIN_POSITIVE);
            measured += mean(kind, &|line| line.measured.powi(2) - line.noise.powi(2)) / driven;
            simulated += mean(kind, &|line| line.simulated.powi(2)) / driven;
            let (sum, lines) = of(lines, kind, &|line| (line.measured / line.noise.max(f64::MIN_POSITIVE)).powi(2));
            over += sum;
            count += lines;
            outputs += 1.0;
        }
        // The power of noise in a line is exponentially distributed. Its mean is itself an estimate, from the lines
        // and the periods over which the noise is averaged.
        let scatter = (1.0 / count + 1.0 / (NEIGHBOURS * (self.periods - 1)) as f64).sqrt();
        (outputs > 0.0).then(|| Answer {
            share: (measured / outputs).max(0.0).sqrt(),
            simulated: (simulated / outputs).sqrt(),
            clear: over / count - 1.0 > settings.line_excess * scatter,
        })
    }

    /// States the responses in a sentence, and those of the simulation if effects were found.
    pub fn words(&self, found: bool, settings: &EvidenceSettings) -> Option<String> {
        let (odd, even) = (self.answer(Kind::Odd, settings)?, self.answer(Kind::Even, settings)?);
        let share = |answer: Answer| {
            let simulated = if found { format!(" (simulated: {})", percent(answer.simulated)) } else { String::new() };
            if answer.clear {
                format!("{} of the response at driven lines{simulated}", percent(answer.share))
            } else {
                "no more than noise".into()
            }
        };
        let kind = match (odd.clear, even.clear) {
            (false, false) => "the periodic response is linear",
            (true, false) => "a nonlinearity that is odd",
            (false, true) => "a nonlinearity that is even",
            (true, true) if odd.share > settings.mostly * even.share => "a nonlinearity that is mostly odd",
            (true, true) if even.share > settings.mostly * odd.share => "a nonlinearity that is mostly even",
            (true, true) => "a nonlinearity with an odd and an even part",
        };
        Some(format!(
            "The input of {} contains only odd lines. At the odd lines that it omits, the outputs have {}, and at even \
            lines {}: {kind}.",
            self.record,
            share(odd),
            share(even)
        ))
    }
}

/// Returns the period and the role of each of its lines, if the record's input has odd lines only and leaves out enough
/// of them.
fn kinds(record: &Record, settings: &GapSettings) -> Option<(usize, Vec<Option<Kind>>)> {
    let Excitation::Periodic(period) = record.excitation else { return None };
    if used(record.samples(), period).len() < LEAST_PERIODS {
        return None;
    }
    let driven = driven(&record.u, period, settings.signal.driven_line);
    let driven = |k: usize| driven[k];
    let (first, last) = ((1..=period / 2).find(|&k| driven(k))?, (1..=period / 2).rev().find(|&k| driven(k))?);
    let kind = |k: usize| match k {
        _ if k < first || k > last => None,
        _ if driven(k) => Some(Kind::Driven),
        _ if k % 2 == 1 => Some(Kind::Odd),
        _ => Some(Kind::Even),
    };
    let kinds: Vec<Option<Kind>> = (0..=period / 2).map(kind).collect();
    let enough = |kind: Kind| kinds.iter().filter(|k| **k == Some(kind)).count() >= settings.evidence.least_lines;
    let odd = (first..=last).all(|k| k % 2 == 1 || !driven(k));
    (odd && enough(Kind::Odd) && enough(Kind::Even)).then_some((period, kinds))
}

/// Returns moving averages over neighbouring lines.
fn smooth(x: &[f64]) -> Vec<f64> {
    let half = NEIGHBOURS / 2;
    let mean = |k: usize| {
        let near = &x[k.saturating_sub(half)..(k + half + 1).min(x.len())];
        near.iter().sum::<f64>() / near.len() as f64
    };
    (0..x.len()).map(mean).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD: usize = 400;

    /// Returns a record of one input with these lines, whose output is a static curve of the input with a little
    /// noise.
    fn record(lines: &[usize], curve: impl Fn(f64) -> f64) -> Record {
        let noise = crate::testing::random_input(5, 4 * PERIOD, 1);
        let phase = crate::testing::random_input(6, lines.len(), 1);
        let at = |n: usize| -> f64 {
            let turn = std::f64::consts::TAU * n as f64 / PERIOD as f64;
            lines.iter().zip(&phase[0]).map(|(&k, phase)| 0.1 * (k as f64 * turn + 9.0 * phase).cos()).sum()
        };
        let u: Vec<f64> = (0..4 * PERIOD).map(at).collect();
        let y = u.iter().zip(&noise[0]).map(|(u, e)| curve(*u) + 1e-3 * e).collect();
        Record {
            name: "odd.csv".into(),
            excitation: Excitation::Periodic(PERIOD),
            ..crate::testing::record(vec![u], vec![y])
        }
    }

    fn odd_lines(lines: &Lines) -> Option<Answer> {
        lines.answer(Kind::Odd, &EvidenceSettings::default())
    }

    fn odd() -> Vec<usize> {
        (1..120).step_by(2).filter(|k| k % 5 != 0).collect()
    }

    fn lines(curve: impl Fn(f64) -> f64) -> Lines {
        let record = record(&odd(), &curve);
        let with = |r: &Record| vec![r.u[0].iter().map(|u| curve(*u)).collect()];
        Lines::of(&[record], 100.0, |r: &Record| r.u.clone(), with, &GapSettings::default()).unwrap()
    }

    #[test]
    fn odd_and_even_curves_answer_at_their_own_lines() {
        for (curve, odd, even, word) in [
            (Box::new(|u: f64| u) as Box<dyn Fn(f64) -> f64>, false, false, "is linear"),
            (Box::new(|u: f64| u - 0.1 * u.powi(3)), true, false, "that is odd"),
            (Box::new(|u: f64| u + 0.1 * u * u), false, true, "that is even"),
        ] {
            let lines = lines(curve);
            let answers = [Kind::Odd, Kind::Even].map(|kind| lines.answer(kind, &EvidenceSettings::default()).unwrap());
            assert_eq!(answers.map(|a| a.clear), [odd, even], "{answers:?}");
            // The curve that made the record is simulated, so both responses agree.
            for answer in answers.iter().filter(|a| a.clear) {
                assert!((answer.share / answer.simulated - 1.0).abs() < 0.05, "{answer:?}");
            }
            assert!(lines.words(true, &EvidenceSettings::default()).unwrap().contains(word));
        }
    }

    #[test]
    fn a_missing_sample_costs_its_period_and_not_the_output() {
        let curve = |u: f64| u - 0.1 * u.powi(3);
        let mut record = record(&odd(), curve);
        let of = |record: &Record| {
            let with = |r: &Record| vec![r.u[0].iter().map(|u| curve(*u)).collect()];
            let settings = GapSettings::default();
            Lines::of(std::slice::from_ref(record), 100.0, |r: &Record| r.u.clone(), with, &settings).unwrap()
        };
        let (whole, share) = (of(&record), |lines: &Lines| odd_lines(lines).unwrap().share);
        record.y[0][PERIOD + 7] = f64::NAN;
        let one = of(&record);
        assert_eq!((whole.periods, one.periods), (3, 2));
        assert!((share(&one) / share(&whole) - 1.0).abs() < 0.05 && odd_lines(&one).unwrap().clear);
        record.y[0][2 * PERIOD + 7] = f64::NAN;
        assert_eq!(odd_lines(&of(&record)), None);
    }

    /// If u consists of cosines of amplitude a at the lines k and l, u + c u^2 has the amplitude c a^2 at the line
    /// k + l.
    #[test]
    fn the_size_of_a_line_is_that_of_the_closed_form() {
        let record = record(&[41, 61, 81], |u| u + u * u);
        let found = periods(&record.y[0], PERIOD, &used(4 * PERIOD, PERIOD))[41 + 61].0;
        let expected = 0.1f64.powi(4) / 2.0;
        assert!((found / expected - 1.0).abs() < 0.03, "{found} {expected}");
    }

    #[test]
    fn records_of_other_lines_say_nothing() {
        let none = |lines: &[usize], curve: fn(f64) -> f64| {
            let run = |r: &Record| r.u.clone();
            Lines::of(&[record(lines, curve)], 100.0, run, run, &GapSettings::default())
        };
        assert_eq!(none(&(1..120).collect::<Vec<_>>(), |u| u), None);
        assert_eq!(none(&(1..120).step_by(2).collect::<Vec<_>>(), |u| u), None);
        // All samples are missing.
        let lines = none(&odd(), |_| f64::NAN).unwrap();
        assert_eq!(lines.words(false, &EvidenceSettings::default()), None);
    }
}
