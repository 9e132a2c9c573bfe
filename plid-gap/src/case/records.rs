//! The records from their files: the rows that are used, decimated and detrended if the case requests it.

use std::path::Path;

use crate::case::record::{Excitation, Record, rms};
use crate::case::split::{self, Unnamed};
use crate::error::GapError;
use ndarray::{Array2, s};
use plid_data as data;
use plid_data::prepare::{decimate, trend};

use super::period::{NotPeriodic, Repeating};
use super::{CaseConfig, Channels, ExcitationKind, RecordConfig, StartKind, Use, columns};

/// Reads all records of a case in order, and returns them with warnings. `path` is the path of the case, for errors.
pub(super) fn read(path: &Path, config: &CaseConfig, folder: &Path) -> Result<(Vec<Record>, Vec<String>), GapError> {
    let mut warnings = Vec::new();
    let mut measured = Vec::new();
    for given in &config.record {
        measured.push(measured_and_simulated(path, config, folder, given, &mut warnings)?);
    }
    let wrong = |key: &str, message: String| GapError::Key { file: path.into(), key: key.into(), message };
    let ratio = config.ratio().map_err(|message| wrong("decimate_to_hz", message))?;
    let inputs: Vec<&Array2<f64>> = measured.iter().map(|(record, _)| &record.inputs).collect();
    let excitations =
        excitations(config, &inputs, ratio, &mut warnings).map_err(|(key, message)| wrong(key, message))?;
    if let Some(to_hz) = config.decimate_to_hz {
        let failed = |error: plid_data::prepare::PrepareError| wrong("decimate_to_hz", error.to_string());
        let plan = decimate::plan(config.sample_rate_hz, to_hz).map_err(failed)?;
        for (number, (record, simulated)) in measured.iter_mut().enumerate() {
            let decimated = decimate::decimate(record, &plan, number + 1).map_err(failed)?;
            warnings.extend(decimate::masked(record, &decimated, number + 1).iter().map(ToString::to_string));
            *record = decimated;
            if let Some(simulated) = simulated {
                *simulated = decimate::decimate(simulated, &plan, number + 1).map_err(failed)?;
            }
        }
    }
    let (mut records, simulated): (Vec<_>, Vec<_>) = measured.into_iter().unzip();
    let learnt = learnt(config, &records);
    trend::remove(&mut records, &learnt, config.trend);

    let mut clock = 0.0;
    let mut used = Vec::new();
    let channels = records.into_iter().zip(simulated);
    for (((given, excitation), (record, simulated)), learnt) in
        config.record.iter().zip(excitations).zip(channels).zip(learnt)
    {
        let start_s = given.start_s.unwrap_or(clock);
        clock = start_s + record.duration_s();
        used.push(Record {
            name: named(given),
            excitation,
            // Decimation removes samples at both ends, so the remaining record begins in motion.
            from_rest: given.start == StartKind::Rest && ratio == 1,
            start_s,
            held_out: learnt == 0,
            u: columns(&record.inputs),
            y: columns(&record.outputs),
            simulated: simulated.map(|simulated| columns(&simulated.outputs)),
        });
    }
    Ok((used, warnings))
}

/// Reads a record from its file, and the outputs of the engineer's own simulator if the case names them.
fn measured_and_simulated(
    path: &Path,
    config: &CaseConfig,
    folder: &Path,
    given: &RecordConfig,
    warnings: &mut Vec<String>,
) -> Result<(data::Record, Option<data::Record>), GapError> {
    let table = data::read(&folder.join(&given.file), None)?;
    let rate = Some(config.sample_rate_hz);
    let (mut record, more) = data::extract(&table, &config.inputs, &config.outputs, rate, data::MissingPolicy::Nan)?;
    warnings.extend(more.iter().map(|warning| format!("{}: {warning}", given.file)));
    let [from, to] = rows(path, given, record.samples())?;
    record.inputs = record.inputs.slice(s![from..to, ..]).to_owned();
    record.outputs = record.outputs.slice(s![from..to, ..]).to_owned();
    let simulated = match &given.simulated {
        Some(name) => {
            let table = data::read(&folder.join(name), None)?;
            let outputs = data::channels(&table, &config.outputs, data::MissingPolicy::Error)?;
            let [from, to] = rows(path, given, outputs.nrows())?;
            Some(data::Record { outputs: outputs.slice(s![from..to, ..]).to_owned(), ..record.clone() })
        }
        None => None,
    };
    Ok((record, simulated))
}

/// Returns the excitation of each record of a case whose inputs (m channels each) are given, and adds warnings. A
/// declared period is compared with the inputs; one that is absent is estimated.
///
/// # Errors
/// Returns the key and the reason if an input that is declared periodic does not repeat.
pub fn excitations_of(
    config: &CaseConfig,
    inputs: &[Channels],
    warnings: &mut Vec<String>,
) -> Result<Vec<Excitation>, (&'static str, String)> {
    let array = |u: &Channels| Array2::from_shape_fn((u.first().map_or(0, Vec::len), u.len()), |(k, i)| u[i][k]);
    let arrays: Vec<Array2<f64>> = inputs.iter().map(array).collect();
    excitations(config, &arrays.iter().collect::<Vec<_>>(), 1, warnings)
}

/// Returns the excitation of each record, with periods in samples after decimation. A declared period is compared with
/// the inputs (one array for each record, as in its file); one that is absent is estimated. The error is the key and
/// the reason.
fn excitations(
    config: &CaseConfig,
    inputs: &[&Array2<f64>],
    ratio: usize,
    warnings: &mut Vec<String>,
) -> Result<Vec<Excitation>, (&'static str, String)> {
    let size = |array: &Array2<f64>, i: usize| array.column(i).std(0.0);
    let levels: Vec<f64> =
        (0..config.inputs.len()).map(|i| inputs.iter().map(|array| size(array, i)).fold(0.0, f64::max)).collect();
    let mut excitations = Vec::new();
    for (given, inputs) in config.record.iter().zip(inputs) {
        excitations.push(match given.excitation {
            ExcitationKind::Zero => Excitation::Zero,
            ExcitationKind::Random => Excitation::Random,
            ExcitationKind::Periodic => {
                let repeating = Repeating::new(inputs, &levels, &config.settings.case);
                Excitation::Periodic(period(config, given, &repeating, ratio, warnings)? / ratio)
            }
        });
    }
    Ok(excitations)
}

/// Returns the period of a record in samples of its file.
fn period(
    config: &CaseConfig,
    given: &RecordConfig,
    repeating: &Repeating,
    ratio: usize,
    warnings: &mut Vec<String>,
) -> Result<usize, (&'static str, String)> {
    let file = &given.file;
    let Some(declared) = given.period else {
        let none = || {
            (
                "excitation",
                format!("{file} is declared periodic, but its inputs do not repeat; any other signal is \"random\""),
            )
        };
        let shortest = repeating.shortest().ok_or_else(none)?;
        // One sample in `ratio` is kept, so the period must be a multiple of `ratio`.
        let found =
            (1..=ratio).map(|times| times * shortest).find(|found| found.is_multiple_of(ratio)).unwrap_or(shortest);
        warnings.push(format!("{file}: its inputs repeat after {found} samples, which is used as the period"));
        return Ok(found);
    };
    match repeating.check(declared) {
        Ok(true) => {}
        Ok(false) => warnings.push(format!(
            "{file}: a period of {declared} samples cannot be checked, because the record does not contain two of them"
        )),
        Err(NotPeriodic { worst: (input, misfit), fits }) => {
            let instead = match fits {
                Some(fits) => format!("the nearest period that fits is {fits}"),
                None => "no period fits; \"random\" is the excitation of an input that does not repeat".to_string(),
            };
            let channel = &config.inputs[input];
            let share = 100.0 * misfit;
            let message = format!(
                "{file}: input `{channel}` does not repeat after {declared} samples ({share:.1} % of it differs): \
                {instead}"
            );
            return Err(("period", message));
        }
    }
    Ok(declared)
}

/// Returns a record's name: the file, and the rows if not all of them are used.
fn named(given: &RecordConfig) -> String {
    match given.samples {
        Some([from, to]) => format!("{}, rows {from} to {to}", given.file),
        None => given.file.clone(),
    }
}

fn rows(path: &Path, given: &RecordConfig, samples: usize) -> Result<[usize; 2], GapError> {
    match given.samples {
        None => Ok([0, samples]),
        Some([from, to]) if to <= samples => Ok([from, to]),
        Some([_, to]) => Err(GapError::Key {
            file: path.into(),
            key: "samples".into(),
            message: format!("{} has {samples} rows, but rows up to {to} are requested", given.file),
        }),
    }
}

/// Returns the number of samples of each record from which trends are estimated. Held-out samples are not among them.
fn learnt(config: &CaseConfig, records: &[data::Record]) -> Vec<usize> {
    let is_driven = |given: &RecordConfig| given.excitation != ExcitationKind::Zero && given.r#use != Some(Use::Sim);
    let level = |(given, record): (&RecordConfig, &data::Record)| {
        if is_driven(given) { rms(record.inputs.iter()) } else { 0.0 }
    };
    let levels: Vec<f64> = config.record.iter().zip(records).map(level).collect();
    let unnamed = if config.names_held_out() { None } else { split::unnamed(&levels, &config.settings.case) };
    let learnt = |(k, given): (usize, &RecordConfig)| {
        let samples = records[k].samples();
        match unnamed {
            _ if given.is_held_out() => 0,
            Some(Unnamed::Whole(whole)) if k == whole => 0,
            Some(Unnamed::EndOf(one)) if k == one => split::fitted(samples, config.settings.case.held_out_share),
            _ => samples,
        }
    };
    config.record.iter().enumerate().map(learnt).collect()
}
