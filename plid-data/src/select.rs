//! Channels of a table as inputs and outputs.
use super::error::nearest;
use super::{DataError, Record, Table, Warning, check_excited, require_alike, sample_rate};
use ndarray::Array2;
use serde::{Deserialize, Serialize};
use std::collections::HashSet;
use std::path::Path;

/// The largest magnitude of a sample. Sums of fourth powers of larger values would overflow.
const LARGEST: f64 = 1e70;

/// The meaning of NaN in an output.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum MissingPolicy {
    /// NaN is an error.
    #[default]
    Error,
    /// NaN in an output marks a missing sample and is kept.
    Nan,
}

/// Extracts inputs and outputs from a table and checks that they are suitable for identification.
///
/// NaN in an input is an error whatever the policy, and so is a magnitude above 1e70 anywhere.
///
/// # Errors
/// Returns the errors of [`extract`] and [`check_excited`].
pub fn select(
    table: &Table,
    inputs: &[String],
    outputs: &[String],
    rate_hz: Option<f64>,
    missing: MissingPolicy,
) -> Result<(Record, Vec<Warning>), DataError> {
    let (record, mut warnings) = extract(table, inputs, outputs, rate_hz, missing)?;
    warnings.extend(check_excited(&table.source, &record)?);
    Ok((record, warnings))
}

/// Applies [`select`] to several files, which must agree in channels and rate.
///
/// # Errors
/// Returns the errors of [`select`], and [`DataError::RecordsDiffer`].
pub fn select_all(
    tables: &[Table],
    inputs: &[String],
    outputs: &[String],
    rate_hz: Option<f64>,
    missing: MissingPolicy,
) -> Result<(Vec<Record>, Vec<Warning>), DataError> {
    let mut records = Vec::new();
    let mut warnings = Vec::new();
    for table in tables {
        let (record, more) = select(table, inputs, outputs, rate_hz, missing)?;
        records.push(record);
        warnings.extend(more.into_iter().filter(|w| !warnings.contains(w)).collect::<Vec<_>>());
    }
    require_alike(&records)?;
    Ok((records, warnings))
}

/// Extracts inputs and outputs from a table. They may be constant, as in a zero-input record.
///
/// # Errors
/// Returns an error if a channel is unknown or named twice, if there is only one sample, if a value is missing or too
/// large, or if the rate is invalid.
pub fn extract(
    table: &Table,
    inputs: &[String],
    outputs: &[String],
    rate_hz: Option<f64>,
    missing: MissingPolicy,
) -> Result<(Record, Vec<Warning>), DataError> {
    require_names(inputs, outputs)?;
    if table.samples() < 2 {
        return Err(DataError::OneSample { file: table.source.clone() });
    }
    let (sample_rate_hz, warning) = sample_rate(table, rate_hz)?;
    let record = Record {
        sample_rate_hz,
        input_names: inputs.to_vec(),
        output_names: outputs.to_vec(),
        inputs: channels(table, inputs, MissingPolicy::Error)?,
        outputs: channels(table, outputs, missing)?,
    };
    let mut warnings = table.notes.clone();
    warnings.extend(warning);
    let missing: Vec<usize> =
        record.outputs.columns().into_iter().map(|column| column.iter().filter(|v| v.is_nan()).count()).collect();
    warnings.extend(judge_missing(&table.source, outputs, &missing, record.samples())?);
    Ok((record, warnings))
}

/// Checks that there are inputs and outputs, and that none is named twice.
pub(super) fn require_names(inputs: &[String], outputs: &[String]) -> Result<(), DataError> {
    for (side, names) in [("input", inputs), ("output", outputs)] {
        if names.is_empty() {
            return Err(DataError::NoChannels { side });
        }
    }
    let mut seen = HashSet::new();
    match inputs.iter().chain(outputs).find(|name| !seen.insert(*name)) {
        Some(twice) => Err(DataError::RepeatedChannel { channel: twice.clone() }),
        None => Ok(()),
    }
}

/// Returns the columns `names` of a table in that order, K x (number of names). Each value is checked against the
/// policy.
///
/// # Errors
/// Returns [`DataError::UnknownChannel`] with the nearest name, or [`DataError::NotFinite`] with the place.
pub fn channels(table: &Table, names: &[String], missing: MissingPolicy) -> Result<Array2<f64>, DataError> {
    let mut out = Array2::zeros((table.samples(), names.len()));
    for (i, name) in names.iter().enumerate() {
        let column = table.column(name).ok_or_else(|| DataError::UnknownChannel {
            file: table.source.clone(),
            channel: name.clone(),
            there: table.names.clone(),
            suggestion: nearest(name, &table.names),
        })?;
        // A comparison with NaN is false.
        let bad = |v: &f64| v.abs() > LARGEST || (v.is_nan() && missing == MissingPolicy::Error);
        if let Some(k) = column.iter().position(bad) {
            return Err(DataError::NotFinite {
                file: table.source.clone(),
                channel: name.clone(),
                at: table.place(k),
                value: column[k],
            });
        }
        out.column_mut(i).assign(&column);
    }
    Ok(out)
}

/// Judges the number of missing samples of each output.
pub(super) fn judge_missing(
    file: &Path,
    outputs: &[String],
    missing: &[usize],
    samples: usize,
) -> Result<Vec<Warning>, DataError> {
    let mut warnings = Vec::new();
    for (name, &missing) in outputs.iter().zip(missing) {
        if missing == samples {
            return Err(DataError::AllMissing { file: file.into(), channel: name.clone() });
        }
        if missing > 0 {
            warnings.push(Warning::MissingSamples { channel: name.clone(), missing, samples });
        }
    }
    Ok(warnings)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::read;

    fn table(text: &str) -> Table {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x.csv");
        std::fs::write(&path, text).unwrap();
        read(&path, None).unwrap()
    }

    fn names(text: &str) -> Vec<String> {
        text.split_whitespace().map(str::to_owned).collect()
    }

    fn take(text: &str, missing: MissingPolicy) -> Result<(Record, Vec<Warning>), DataError> {
        select(&table(text), &names("u"), &names("y z"), Some(10.0), missing)
    }

    #[test]
    fn channels_come_in_the_order_asked_for() {
        let t = table("z,u,y,Fs\n1,2,3,400\n4,5,6,\n7,8,10,\n");
        let (record, warnings) = select(&t, &names("u"), &names("y z"), None, MissingPolicy::Error).unwrap();
        assert_eq!(record.sample_rate_hz, 400.0);
        assert_eq!(record.outputs.row(2).to_vec(), [10.0, 7.0]);
        assert_eq!(record.inputs.column(0).to_vec(), [2.0, 5.0, 8.0]);
        assert_eq!(warnings, []);
        assert!((record.duration_s() - 3.0 / 400.0).abs() < 1e-15);
    }

    #[test]
    fn unknown_and_repeated_channels_are_named() {
        let t = table("Force,Acceleration1\n1,2\n2,3\n");
        let go =
            |i: &str, o: &str| select(&t, &names(i), &names(o), None, MissingPolicy::Error).unwrap_err().to_string();
        let error = go("Force", "Aceleration1");
        assert!(error.contains("no channel `Aceleration1`, only Force, Acceleration1"), "{error}");
        assert!(error.contains("did you mean `Acceleration1`?"), "{error}");
        assert!(!go("Force", "xyz").contains("did you mean"));
        assert!(go("force", "Acceleration1").contains("did you mean `Force`?"));
        assert!(go("Force", "Force").contains("twice"));
        assert!(go("", "Force").contains("no input channel"));
        assert!(go("Force", "").contains("no output channel"));
    }

    #[test]
    fn missing_and_infinite_values_follow_the_policy() {
        let gap = "# c\nu,y,z\n1,2,3\n2,,4\n3,nan,6\n";
        let error = take(gap, MissingPolicy::Error).unwrap_err().to_string();
        assert!(error.contains("channel `y` is NaN at line 4"), "{error}");
        let (record, warnings) = take(gap, MissingPolicy::Nan).unwrap();
        assert!(record.outputs[[1, 0]].is_nan());
        let y = || "y".to_owned();
        let expected = [
            Warning::MissingSamples { channel: y(), missing: 2, samples: 3 },
            Warning::ConstantOutput { channel: y() },
        ];
        assert_eq!(warnings, expected);
        for (text, channel) in [
            ("u,y,z\n1,2,3\nnan,3,4\n2,4,5\n", "u"),
            ("u,y,z\n1,2,3\ninf,3,4\n2,4,5\n", "u"),
            ("u,y,z\n1,2,3\n3,-inf,4\n2,4,5\n", "y"),
            ("u,y,z\n1,2,3\n3,1e300,4\n2,4,5\n", "y"),
        ] {
            let error = take(text, MissingPolicy::Nan).unwrap_err().to_string();
            assert!(error.contains(&format!("channel `{channel}`")), "{error}");
            assert!(error.contains("line 3"), "{error}");
        }
        let error = take("u,y,z\n1,,3\n2,nan,4\n3,,5\n", MissingPolicy::Nan).unwrap_err();
        assert!(matches!(error, DataError::AllMissing { channel, .. } if channel == "y"));
    }

    #[test]
    fn one_sample_and_no_excitation_are_errors() {
        let error = take("u,y,z\n1,2,3\n", MissingPolicy::Error).unwrap_err();
        assert!(matches!(error, DataError::OneSample { .. }));
        let still = "u,y,z\n0,2,3\n0,3,4\n0,4,5\n";
        let error = take(still, MissingPolicy::Error).unwrap_err();
        assert!(matches!(error, DataError::NoExcitation { .. }));
        // A zero-input record may still be extracted to estimate its noise.
        let t = table(still);
        assert!(extract(&t, &names("u"), &names("y"), None, MissingPolicy::Error).is_ok());
    }

    #[test]
    fn several_files_must_agree() {
        let a = table("u,y,Fs\n1,2,100\n2,3,\n4,3,\n");
        let b = table("y,u,Fs\n1,2,100\n2,3,\n4,5,\n");
        let c = table("u,y,Fs\n1,2,200\n2,3,\n4,5,\n");
        let go = |tables: &[Table]| select_all(tables, &names("u"), &names("y"), None, MissingPolicy::Error);
        assert_eq!(go(&[a.clone(), b]).unwrap().0.len(), 2);
        let error = go(&[a, c]).unwrap_err().to_string();
        assert!(error.contains("record 2") && error.contains("200 Hz"), "{error}");
    }
}
