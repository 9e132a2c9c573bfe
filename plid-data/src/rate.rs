//! The sample rate: given, or found in the file.
use super::{DataError, Table, Warning};
use ndarray::ArrayView1;
use std::path::Path;

/// Names of a scalar that holds the rate in Hz, in lower case.
const RATE_NAMES: [&str; 6] =
    ["fs", "sample_rate", "sample_rate_hz", "samplerate", "sampling_rate", "sampling_frequency"];

/// Returns the sample rate in Hz: the given one; else a scalar such as `Fs`; else the rate of a column of time (`t`,
/// `time`, `Time_s`, `time [ms]`, ...); else 1 Hz with a warning.
///
/// # Errors
/// Returns an error if the rate is zero, negative or not finite, or if the times are not evenly spaced.
pub fn sample_rate(table: &Table, given: Option<f64>) -> Result<(f64, Option<Warning>), DataError> {
    if let Some(rate) = stated_rate(table, given)? {
        return Ok((rate, None));
    }
    if let Some((name, unit_s)) = time_column(table)
        && let Some(values) = table.column(name)
    {
        let rate = rate_of_time(table, name, values, unit_s)?;
        return Ok((checked(&table.source, rate, format!("column `{name}`"))?, None));
    }
    let file = table.source.display().to_string();
    Ok((1.0, Some(Warning::RateAssumed { file })))
}

/// Returns the given rate in Hz, or else that of a scalar in the file.
pub(super) fn stated_rate(table: &Table, given: Option<f64>) -> Result<Option<f64>, DataError> {
    if let Some(rate) = given {
        return checked(&table.source, rate, "as given".into()).map(Some);
    }
    let scalar = table.scalars.iter().find(|(name, _)| RATE_NAMES.contains(&name.to_lowercase().as_str()));
    scalar.map(|(name, rate)| checked(&table.source, *rate, format!("`{name}` in the file"))).transpose()
}

/// Returns the name and the unit in s of the column of time, if there is one.
pub(super) fn time_column(table: &Table) -> Option<(&str, f64)> {
    table.names.iter().find_map(|name| Some((name.as_str(), unit_of_time(name)?)))
}

fn checked(file: &Path, rate_hz: f64, origin: String) -> Result<f64, DataError> {
    if rate_hz > 0.0 && rate_hz.is_finite() {
        return Ok(rate_hz);
    }
    Err(DataError::BadRate { file: file.into(), rate_hz, origin })
}

/// Returns the unit in s of a column of time; `None` if the name is not that of time.
fn unit_of_time(name: &str) -> Option<f64> {
    let name = name.to_lowercase();
    let mut words = name.split(|c: char| !c.is_alphanumeric()).filter(|word| !word.is_empty());
    if !matches!(words.next()?, "t" | "time") {
        return None;
    }
    let unit = match words.next() {
        None | Some("s" | "sec" | "second" | "seconds") => 1.0,
        Some("ms") => 1e-3,
        Some("us" | "\u{b5}s" | "\u{3bc}s") => 1e-6,
        Some(_) => return None,
    };
    words.next().is_none().then_some(unit)
}

/// Returns the rate in Hz of times that are at most `off_the_line` away from a straight line between the first and the
/// `last` one, with the mean `step`; `None` if they are not evenly spaced.
pub(super) fn rate_of_line(step: f64, off_the_line: f64, last: usize, unit_s: f64) -> Option<f64> {
    if !(step > 0.0 && off_the_line <= 0.25 * step) {
        return None;
    }
    let rate = 1.0 / (step * unit_s);
    // Rounded times determine the rate only to within this tolerance. If it contains a whole number, that is the rate.
    let open = rate * (2.0 * off_the_line / (step * last as f64) + 1e-12);
    Some(if (rate - rate.round()).abs() <= open { rate.round() } else { rate })
}

/// Returns the rate of evenly spaced times.
///
/// Printed times are rounded, so single steps are not accurate. Each time must therefore lie within a quarter of a step
/// of the line from the first to the last time. If a sample is lost, at least one time is half a step or more off that
/// line.
fn rate_of_time(table: &Table, name: &str, time: ArrayView1<f64>, unit_s: f64) -> Result<f64, DataError> {
    if let Some(k) = time.iter().position(|t| !t.is_finite()) {
        return Err(DataError::NotFinite {
            file: table.source.clone(),
            channel: name.into(),
            at: table.place(k),
            value: time[k],
        });
    }
    let last = time.len() - 1;
    if last == 0 {
        return Err(DataError::OneSample { file: table.source.clone() });
    }
    let step = (time[last] - time[0]) / last as f64;
    let off_the_line = (0..=last).map(|k| (time[k] - time[0] - k as f64 * step).abs()).fold(0.0, f64::max);
    if let Some(rate) = rate_of_line(step, off_the_line, last, unit_s) {
        return Ok(rate);
    }
    let steps: Vec<f64> = (1..=last).map(|k| time[k] - time[k - 1]).collect();
    let mut sorted = steps.clone();
    sorted.sort_by(f64::total_cmp);
    let median = sorted[sorted.len() / 2];
    let worst =
        (0..steps.len()).max_by(|&a, &b| (steps[a] - median).abs().total_cmp(&(steps[b] - median).abs())).unwrap_or(0);
    Err(DataError::UnevenTime {
        file: table.source.clone(),
        column: name.into(),
        at: table.place(worst + 1),
        step_s: steps[worst] * unit_s,
        expected_s: median * unit_s,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array2;
    use std::collections::BTreeMap;

    fn table(name: &str, values: Vec<f64>) -> Table {
        Table {
            source: "x.csv".into(),
            names: vec![name.into()],
            columns: Array2::from_shape_vec((values.len(), 1), values).unwrap(),
            scalars: BTreeMap::new(),
            sha256: String::new(),
            lines: Vec::new(),
            first: 0,
            notes: Vec::new(),
        }
    }

    fn times(step: f64) -> Vec<f64> {
        (0..1000).map(|k| 3.0 + k as f64 * step).collect()
    }

    #[test]
    fn a_given_rate_comes_first_then_a_scalar_then_time() {
        let mut t = table("time", times(0.01));
        assert_eq!(sample_rate(&t, None).unwrap(), (100.0, None));
        t.scalars.insert("Fs".into(), 400.0);
        assert_eq!(sample_rate(&t, None).unwrap(), (400.0, None));
        assert_eq!(sample_rate(&t, Some(50.0)).unwrap(), (50.0, None));
    }

    #[test]
    fn without_any_there_is_a_warning() {
        let (rate, warning) = sample_rate(&table("temperature", times(0.01)), None).unwrap();
        assert_eq!(rate, 1.0);
        assert!(matches!(warning, Some(Warning::RateAssumed { .. })));
    }

    #[test]
    fn impossible_rates_are_errors() {
        let mut t = table("u", times(0.01));
        for rate in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            let error = sample_rate(&t, Some(rate)).unwrap_err();
            assert!(error.to_string().contains("as given"), "{error}");
        }
        t.scalars.insert("fs".into(), 0.0);
        let error = sample_rate(&t, None).unwrap_err();
        assert!(error.to_string().contains("`fs` in the file"), "{error}");
    }

    #[test]
    fn units_of_time_are_understood() {
        for (name, rate) in [("Time_s", 100.0), ("t [ms]", 1e5), ("TIME (us)", 1e8)] {
            let (found, _) = sample_rate(&table(name, times(0.01)), None).unwrap();
            assert!((found - rate).abs() < 1e-6 * rate, "{name}: {found}");
        }
        for name in ["time_constant", "t1", "u", "time s old"] {
            assert_eq!(unit_of_time(name), None, "{name}");
        }
    }

    #[test]
    fn rounded_times_give_the_rate_that_was_meant() {
        // 1600 Hz with four decimals: single steps are 0.0006 or 0.0007 s.
        let rounded = times(1.0 / 1600.0).iter().map(|t| (t * 1e4).round() / 1e4).collect();
        assert_eq!(sample_rate(&table("t", rounded), None).unwrap().0, 1600.0);
        // A rate that is not a whole number is not rounded.
        let (rate, _) = sample_rate(&table("t", times(1.0 / 610.35)), None).unwrap();
        assert!((rate - 610.35).abs() < 1e-6);
    }

    #[test]
    fn a_lost_sample_is_found_where_it_is() {
        for lost in [1, 500, 998] {
            let mut t = times(0.01);
            t.remove(lost);
            let error = sample_rate(&table("t", t), None).unwrap_err().to_string();
            // Row lost + 1 now holds the sample after the lost one.
            assert!(error.contains(&format!("row {}:", lost + 1)), "{error}");
        }
        let error = sample_rate(&table("t", vec![0.0, f64::NAN, 2.0]), None).unwrap_err();
        assert!(matches!(error, DataError::NotFinite { .. }));
        let error = sample_rate(&table("t", vec![2.0, 1.0, 0.0]), None).unwrap_err();
        assert!(matches!(error, DataError::UnevenTime { .. }));
    }
}
