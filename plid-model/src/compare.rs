use nalgebra::DVector;
use ndarray::{Array2, ArrayView2, Axis};
use serde::Serialize;

use super::error::ModelError;
use super::initial_state::{estimate_initial_state, estimate_predictor_state};
use super::predict::one_step_prediction;
use super::simulate::simulate;
use super::state_space::Model;

/// Sample rates count as equal if their relative difference is at most this.
const SAME_RATE: f64 = 1e-6;

/// A model and its name in the table.
#[derive(Debug, Clone)]
pub struct NamedModel<'a> {
    /// The name of the model.
    pub name: &'a str,
    /// The model.
    pub model: &'a Model,
}

/// A record with named channels, from which the channels of a model are selected by name.
#[derive(Debug, Clone)]
pub struct Record<'a> {
    /// The name of the record.
    pub name: &'a str,
    /// Sample rate in Hz.
    pub sample_rate_hz: f64,
    /// Names of the columns.
    pub channels: &'a [String],
    /// Values (samples x channels); NaN marks a missing output.
    pub values: ArrayView2<'a, f64>,
}

/// The initial state of a run, at the first sample of a record.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Start {
    /// The zero state.
    Rest,
    /// A state fitted to the first samples (all if `None`), separately for the simulation and the one-step prediction.
    Fitted {
        /// Number of samples used by the fit.
        #[serde(skip_serializing_if = "Option::is_none")]
        window: Option<usize>,
    },
}

/// The settings of a comparison.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CompareOptions {
    /// The initial state.
    pub start: Start,
    /// The first sample that is scored; the run itself starts at the first sample of the record.
    pub score_from: usize,
}

impl Default for CompareOptions {
    fn default() -> Self {
        Self { start: Start::Rest, score_from: 0 }
    }
}

/// The errors of one output.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct OutputScore {
    /// The name of the output.
    pub output: String,
    /// Number of samples scored, without the missing ones.
    pub samples: usize,
    /// RMS of the error, in the output's unit. `None` without samples.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rms_error: Option<f64>,
    /// RMS of the error over RMS of the output. `None` if the output is zero throughout.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub relative_rms: Option<f64>,
    /// 100 (1 - |y - y_model| / |y - mean y|), the fit of MATLAB's `compare`. `None` for a constant output.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fit_percent: Option<f64>,
}

/// The outcome of one run of a model over a record.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Run {
    /// The run was completed.
    Scored {
        /// The scores of the outputs.
        outputs: Vec<OutputScore>,
        /// RMS(y - y_model) / RMS(y) over all outputs, each scaled to unit RMS.
        #[serde(skip_serializing_if = "Option::is_none")]
        relative_rms: Option<f64>,
    },
    /// The run diverged.
    Diverged {
        /// The first output that diverged.
        output: String,
        /// The sample at which it diverged, from 0.
        sample: usize,
    },
}

/// The results of one model on one record.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Trial {
    /// The model's name.
    pub model: String,
    /// The record's name.
    pub record: String,
    /// The simulation.
    pub free_run: Run,
    /// The one-step prediction, if the model has a predictor gain.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub one_step: Option<Run>,
}

/// The table of a comparison: every model on every record, ordered by record.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Comparison {
    /// The initial state that was used.
    pub start: Start,
    /// The first sample that was scored.
    pub score_from: usize,
    /// The rows.
    pub trials: Vec<Trial>,
}

/// Compares models on records, as MATLAB's `compare` does. A run that diverges is a row of the table, not an error.
///
/// # Errors
/// Returns [`ModelError::Rate`], [`ModelError::UnknownChannel`], [`ModelError::TooShort`], or [`ModelError::NotFinite`]
/// for an input.
pub fn compare(models: &[NamedModel], records: &[Record], options: CompareOptions) -> Result<Comparison, ModelError> {
    let mut trials = Vec::with_capacity(models.len() * records.len());
    for record in records {
        for model in models {
            trials.push(trial(model, record, options)?);
        }
    }
    Ok(Comparison { start: options.start, score_from: options.score_from, trials })
}

fn trial(named: &NamedModel, record: &Record, options: CompareOptions) -> Result<Trial, ModelError> {
    let model = named.model;
    expect_same_rate(named, record)?;
    let inputs = pick(named, record, &model.inputs)?;
    let outputs = pick(named, record, &model.outputs)?;
    let from = options.score_from;
    if record.values.nrows() <= from {
        let (record, samples) = (record.name.to_string(), record.values.nrows());
        return Err(ModelError::TooShort { record, samples, from });
    }
    let (u, y) = (inputs.view(), outputs.view());
    let scored = |run| score(model, run, &outputs, from);
    let free_run =
        free_start(model, u, y, options.start).and_then(|start| simulate(model, u, &start)).map(|run| run.outputs);
    let one_step = model.predictor_gain.as_ref().map(|_| {
        prediction_start(model, u, y, options.start)
            .and_then(|start| one_step_prediction(model, u, y, &start))
            .map(|run| run.predicted)
    });
    Ok(Trial {
        model: named.name.to_string(),
        record: record.name.to_string(),
        free_run: scored(free_run)?,
        one_step: one_step.map(scored).transpose()?,
    })
}

fn expect_same_rate(named: &NamedModel, record: &Record) -> Result<(), ModelError> {
    let (model_hz, record_hz) = (named.model.sample_rate_hz, record.sample_rate_hz);
    if (model_hz - record_hz).abs() <= SAME_RATE * model_hz {
        return Ok(());
    }
    Err(ModelError::Rate { record: record.name.to_string(), record_hz, model: named.name.to_string(), model_hz })
}

/// Returns the named columns of a record in the order of the names.
fn pick(named: &NamedModel, record: &Record, channels: &[String]) -> Result<Array2<f64>, ModelError> {
    let columns: Vec<usize> = channels
        .iter()
        .map(|channel| {
            let position = record.channels.iter().position(|x| x == channel);
            position.ok_or_else(|| ModelError::UnknownChannel {
                record: record.name.to_string(),
                model: named.name.to_string(),
                channel: channel.clone(),
                present: record.channels.join(", "),
            })
        })
        .collect::<Result<_, _>>()?;
    if record.channels.len() != record.values.ncols() {
        return Err(ModelError::Shape {
            what: "the record's values",
            expected: (record.values.nrows(), record.channels.len()),
            found: record.values.dim(),
        });
    }
    Ok(record.values.select(Axis(1), &columns))
}

fn free_start(model: &Model, u: ArrayView2<f64>, y: ArrayView2<f64>, start: Start) -> Result<DVector<f64>, ModelError> {
    match start {
        Start::Rest => Ok(model.rest()),
        Start::Fitted { window } => Ok(estimate_initial_state(model, u, y, window)?.state),
    }
}

fn prediction_start(
    model: &Model,
    u: ArrayView2<f64>,
    y: ArrayView2<f64>,
    start: Start,
) -> Result<DVector<f64>, ModelError> {
    match start {
        Start::Rest => Ok(model.rest()),
        Start::Fitted { window } => Ok(estimate_predictor_state(model, u, y, window)?.state),
    }
}

/// Scores a run. Divergence is a regular outcome; every other error is returned.
fn score(
    model: &Model,
    run: Result<Array2<f64>, ModelError>,
    measured: &Array2<f64>,
    from: usize,
) -> Result<Run, ModelError> {
    let run = match run {
        Ok(run) => run,
        Err(ModelError::Diverged { output, sample, .. }) => {
            return Ok(Run::Diverged { output, sample });
        }
        Err(other) => return Err(other),
    };
    let outputs: Vec<OutputScore> =
        (0..model.p()).map(|i| output_score(&model.outputs[i], run.column(i), measured.column(i), from)).collect();
    // With each output scaled to unit RMS, the mean square over all outputs is the mean of the parts.
    let parts: Vec<f64> = outputs.iter().filter_map(|s| s.relative_rms).collect();
    let mean = parts.iter().map(|x| x * x).sum::<f64>() / parts.len() as f64;
    let relative_rms = (!parts.is_empty()).then(|| mean.sqrt());
    Ok(Run::Scored { outputs, relative_rms })
}

fn output_score(
    output: &str,
    run: ndarray::ArrayView1<f64>,
    measured: ndarray::ArrayView1<f64>,
    from: usize,
) -> OutputScore {
    let pairs = || run.into_iter().zip(measured).skip(from).filter(|(_, y)| !y.is_nan());
    let samples = pairs().count();
    let count = samples as f64;
    let mean = pairs().map(|(_, y)| y).sum::<f64>() / count;
    let rms = |squares: f64| (squares / count).sqrt();
    let error = rms(pairs().map(|(x, y)| (y - x).powi(2)).sum());
    let size = rms(pairs().map(|(_, y)| y * y).sum());
    let spread = rms(pairs().map(|(_, y)| (y - mean).powi(2)).sum());
    OutputScore {
        output: output.to_string(),
        samples,
        rms_error: (samples > 0).then_some(error),
        relative_rms: (size > 0.0).then(|| error / size),
        // The mean of a constant signal is subject to rounding, so its computed spread need not be exactly zero.
        fit_percent: (spread > 1e-12 * size).then(|| 100.0 * (1.0 - error / spread)),
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::{random, record, two_modes};
    use super::*;
    use approx::assert_relative_eq;
    use ndarray::{concatenate, s};

    fn names(names: &[&str]) -> Vec<String> {
        names.iter().map(|x| x.to_string()).collect()
    }

    /// Simulates a model from a state and returns a record whose columns are in a different order, with one extra
    /// column.
    fn measured(model: &Model, start: &DVector<f64>) -> (Vec<String>, Array2<f64>) {
        let u = record(1, 400, 2);
        let y = simulate(model, u.view(), start).unwrap().outputs;
        let all = concatenate![Axis(1), y, record(3, 400, 1), u];
        (names(&["y1", "y2", "spare", "u1", "u2"]), all)
    }

    fn on<'a>(channels: &'a [String], values: &'a Array2<f64>) -> Record<'a> {
        Record { name: "held-out", sample_rate_hz: 100.0, channels, values: values.view() }
    }

    fn scored(run: &Run) -> (&[OutputScore], f64) {
        match run {
            Run::Scored { outputs, relative_rms } => (outputs, relative_rms.unwrap()),
            Run::Diverged { .. } => panic!("{run:?}"),
        }
    }

    #[test]
    fn figures_are_those_of_an_error_that_is_known() {
        let model = two_modes();
        let (channels, mut values) = measured(&model, &model.rest());
        let clean = values.column(0).to_owned();
        // The second output of the model is 5 % too small, and the first has an offset of 2.
        values.column_mut(0).mapv_inplace(|y| y + 2.0);
        values.column_mut(1).mapv_inplace(|y| y / 0.95);
        values[(7, 1)] = f64::NAN;
        let named = NamedModel { name: "m", model: &model };
        let options = CompareOptions { score_from: 3, ..CompareOptions::default() };
        let table = compare(&[named], &[on(&channels, &values)], options).unwrap();
        let (outputs, all) = scored(&table.trials[0].free_run);
        assert_relative_eq!(outputs[1].relative_rms.unwrap(), 0.05, max_relative = 1e-9);
        assert_eq!((outputs[0].samples, outputs[1].samples), (397, 396));
        assert_relative_eq!(outputs[0].rms_error.unwrap(), 2.0, max_relative = 1e-9);
        let spread = clean.slice(s![3..]).std(0.0);
        let fit = 100.0 * (1.0 - 2.0 / spread);
        assert_relative_eq!(outputs[0].fit_percent.unwrap(), fit, max_relative = 1e-9);
        let first = outputs[0].relative_rms.unwrap();
        assert_relative_eq!(all, ((first * first + 0.0025) / 2.0).sqrt(), max_relative = 1e-9);
        assert!(table.trials[0].one_step.is_none());
    }

    #[test]
    fn a_fitted_start_meets_a_record_that_began_in_motion() {
        let mut model = two_modes();
        model.predictor_gain = Some(random(9, 4, 2) * 0.1);
        let (channels, values) = measured(&model, &DVector::from_element(4, 3.0));
        let run = |start| {
            let named = NamedModel { name: "m", model: &model };
            let options = CompareOptions { start, score_from: 0 };
            let table = compare(&[named], &[on(&channels, &values)], options).unwrap();
            let trial = &table.trials[0];
            (scored(&trial.free_run).1, scored(trial.one_step.as_ref().unwrap()).1)
        };
        let rest = run(Start::Rest);
        assert!(rest.0 > 0.1 && rest.1 > 1e-3);
        let fitted = run(Start::Fitted { window: Some(50) });
        assert!(fitted.0 < 1e-9 && fitted.1 < 1e-9, "{fitted:?}");
    }

    #[test]
    fn divergence_is_a_row_of_the_table() {
        let model = two_modes();
        let mut wild = model.clone();
        wild.a *= 2.0;
        let (channels, values) = measured(&model, &model.rest());
        let models = [("good", &model), ("wild", &wild)];
        let models = models.map(|(name, model)| NamedModel { name, model });
        let records = [on(&channels, &values)];
        let table = compare(&models, &records, CompareOptions::default()).unwrap();
        assert_eq!(table.trials.len(), 2);
        assert!(scored(&table.trials[0].free_run).1 < 1e-12);
        assert!(matches!(table.trials[1].free_run, Run::Diverged { .. }));
        let json = serde_json::to_value(&table).unwrap();
        assert_eq!(json["trials"][1]["model"], "wild");
        assert!(json["trials"][1]["free_run"]["diverged"]["sample"].is_u64());
    }

    #[test]
    fn a_constant_and_an_empty_output_have_no_fit() {
        let mut model = two_modes();
        model.c.fill(0.0);
        let (channels, mut values) = measured(&model, &model.rest());
        values.column_mut(0).fill(0.1);
        values.column_mut(1).fill(f64::NAN);
        let named = NamedModel { name: "m", model: &model };
        let table = compare(&[named], &[on(&channels, &values)], CompareOptions::default());
        let table = table.unwrap();
        let (outputs, all) = scored(&table.trials[0].free_run);
        assert_relative_eq!(all, 1.0, max_relative = 1e-12);
        assert_eq!(outputs[0].fit_percent, None);
        let empty = &outputs[1];
        assert_eq!((empty.samples, empty.rms_error, empty.relative_rms), (0, None, None));
    }

    #[test]
    fn what_does_not_match_is_named() {
        let model = two_modes();
        let (mut channels, values) = measured(&model, &model.rest());
        let named = [NamedModel { name: "m", model: &model }];
        let run = |record: Record, score_from| {
            let options = CompareOptions { score_from, ..CompareOptions::default() };
            compare(&named, &[record], options).unwrap_err()
        };
        let late = run(on(&channels, &values), 400);
        assert!(matches!(late, ModelError::TooShort { samples: 400, .. }));
        let mut slow = on(&channels, &values);
        slow.sample_rate_hz = 50.0;
        assert!(matches!(run(slow, 0), ModelError::Rate { record_hz: 50.0, .. }));
        channels[1] = "other".into();
        let error = run(on(&channels, &values), 0);
        assert!(matches!(&error, ModelError::UnknownChannel { channel, .. } if channel == "y2"));
        assert!(error.to_string().contains("y1, other, spare, u1, u2"));
    }
}
