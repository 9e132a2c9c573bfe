//! Preparation of records before identification, and conversion back to the data's units.
//!
//! [`prepare`] runs the steps that a [`Preparation`] requests, in this order:
//! 1. repeats of one input are averaged, which reduces the noise in all that follows;
//! 2. the rate is reduced by decimation after a linear-phase filter;
//! 3. means or straight lines are removed;
//! 4. the input is advanced by one sample if the plant has direct feedthrough;
//! 5. channels are scaled.
//!
//! All estimates in these steps (means, lines, feedthrough, scales, bands) use the training parts only.
pub mod advance;
pub mod band;
mod config;
pub mod converter;
pub mod decimate;
mod error;
pub mod excitation;
pub mod noise;
pub mod repeats;
pub mod scaling;
mod segment;
mod step;
pub mod stream;
pub mod trend;

pub use config::{Advance, Preparation};
pub use error::PrepareError;
pub use segment::{Segment, heads};
pub use step::Step;

use crate::{Record, Warning, require_alike};
use advance::AdvanceTest;
use band::Band;
use ndarray::Array2;
use noise::NoiseCovariance;
use trend::{Line, Trend};

#[cfg(test)]
mod real_files;
#[cfg(test)]
mod test_plants;

/// Records that are ready for identification, with everything that is required to convert results back to the data's
/// units.
#[derive(Debug, Clone)]
pub struct Prepared {
    /// The records.
    pub records: Vec<Record>,
    /// For each record, the number of its leading samples for training.
    pub training: Vec<usize>,
    /// Time in s from the first sample of a record as given to its first output sample here.
    pub start_s: f64,
    /// Samples by which the input was advanced: 0 or 1.
    pub advanced: usize,
    /// For each record, the outputs (p, prepared like the others) of the last sample, which an advanced input does not
    /// reach.
    pub last_outputs: Vec<Option<Vec<f64>>>,
    /// The test for direct feedthrough, if it was requested and possible.
    pub advance_test: Option<AdvanceTest>,
    /// For each record, the lines removed from the inputs and from the outputs.
    pub lines: Vec<[Vec<Line>; 2]>,
    /// The divisor of each input.
    pub input_scales: Vec<f64>,
    /// The divisor of each output.
    pub output_scales: Vec<f64>,
    /// Noise covariance of a single repeat, in the data's units squared, and the number of repeats averaged, for each
    /// record that comes from repeats. The covariance is estimated before any decimation.
    pub repeat_noise: Vec<(NoiseCovariance, usize)>,
    /// Bands of the inputs and of the outputs.
    pub bands: [Vec<Band>; 2],
    /// The steps.
    pub steps: Vec<Step>,
    /// The warnings for the reader of a report.
    pub warnings: Vec<Warning>,
}

/// Prepares records. `training_shares` holds the leading share of each record that is used for training.
///
/// A record that is averaged from several records has the training share of the first record.
///
/// # Errors
/// Returns an error if the records differ in channels or rate, or if a step is not possible.
pub fn prepare(
    records: Vec<Record>,
    training_shares: &[f64],
    preparation: &Preparation,
) -> Result<Prepared, PrepareError> {
    if records.is_empty() {
        return Err(PrepareError::NoRecords);
    }
    require_alike(&records)?;
    check_shares(training_shares, records.len())?;
    let mut steps = Vec::new();
    let mut warnings = Vec::new();
    let (records, repeat_noise) = average_repeats(records, preparation, &mut steps)?;
    let (records, start_s) = decimate_all(records, preparation, &mut steps, &mut warnings)?;
    let training: Vec<usize> = records
        .iter()
        .zip(training_shares)
        .map(|(record, share)| (share * record.samples() as f64).round() as usize)
        .collect();

    let before = Before { repeat_noise, start_s, steps, warnings };
    let remove = |records: &mut [Record], training: &[usize]| trend::remove(records, training, preparation.trend);
    let scale =
        |records: &mut [Record], training: &[usize], _| Ok(scaling::apply(records, training, preparation.scaling));
    last_steps((records, training), preparation, before, remove, scale)
}

/// The results of the first steps of the preparation.
struct Before {
    repeat_noise: RepeatNoise,
    start_s: f64,
    steps: Vec<Step>,
    warnings: Vec<Warning>,
}

/// The lines removed from the inputs and from the outputs of each record.
type Lines = Vec<[Vec<Line>; 2]>;

/// Performs the steps after averaging and decimation. `remove` removes trends and returns them. `scale`, whose last
/// argument is whether the inputs were advanced, divides the channels and returns the divisors.
fn last_steps(
    (mut records, mut training): (Vec<Record>, Vec<usize>),
    preparation: &Preparation,
    Before { repeat_noise, start_s, mut steps, mut warnings }: Before,
    remove: impl FnOnce(&mut [Record], &[usize]) -> Lines,
    scale: impl FnOnce(&mut [Record], &[usize], bool) -> Result<[Vec<f64>; 2], PrepareError>,
) -> Result<Prepared, PrepareError> {
    let rate_hz = records[0].sample_rate_hz;
    let input_names = records[0].input_names.clone();
    let output_names = records[0].output_names.clone();
    let bands = band::bands(&heads(&records, &training), &input_names, &output_names, rate_hz);
    warnings.extend(band::warnings(&bands[0], &bands[1], rate_hz));

    let lines = remove(&mut records, &training);
    match preparation.trend {
        Trend::None => {}
        Trend::Mean => steps.push(Step::MeanRemoved),
        Trend::Linear => steps.push(Step::LineRemoved),
    }

    let (advance_test, advanced) =
        choose_advance(&heads(&records, &training), [&input_names, &output_names], preparation.advance, &mut warnings);
    let mut last_outputs = vec![None; records.len()];
    if advanced {
        for (record, last) in records.iter().zip(&mut last_outputs) {
            *last = record.outputs.rows().into_iter().next_back().map(|row| row.to_vec());
        }
        for (record, training) in records.iter_mut().zip(&mut training) {
            *record = advance::advance(record);
            // The last training sample would take its input from the held-out part.
            *training = training.saturating_sub(1);
        }
        steps.push(Step::Advanced { by_test: preparation.advance == Advance::Auto });
    }

    let [input_scales, output_scales] = scale(&mut records, &training, advanced)?;
    if preparation.scaling == scaling::Scaling::Rms {
        steps.push(Step::Scaled);
    }
    for last in last_outputs.iter_mut().flatten() {
        last.iter_mut().zip(&output_scales).for_each(|(value, scale)| *value /= scale);
    }
    Ok(Prepared {
        records,
        training,
        last_outputs,
        start_s,
        advanced: usize::from(advanced),
        advance_test,
        lines,
        input_scales,
        output_scales,
        repeat_noise,
        bands,
        steps,
        warnings,
    })
}

fn check_shares(training_shares: &[f64], records: usize) -> Result<(), PrepareError> {
    let in_range = |share: &f64| (0.0..=1.0).contains(share);
    if training_shares.len() != records
        || !training_shares.iter().all(in_range)
        || training_shares.iter().all(|share| *share == 0.0)
    {
        return Err(PrepareError::TrainingShares { shares: training_shares.to_vec(), records });
    }
    Ok(())
}

/// Returns the test for direct feedthrough, if it was made, and whether the inputs are advanced.
fn choose_advance(
    heads: &[Segment],
    [input_names, output_names]: [&[String]; 2],
    choice: Advance,
    warnings: &mut Vec<Warning>,
) -> (Option<AdvanceTest>, bool) {
    let mut advance_test = None;
    if choice == Advance::Auto {
        match advance::test(heads, input_names, output_names) {
            Ok(test) => advance_test = Some(test),
            Err(warning) => warnings.push(warning),
        }
    }
    let advanced = match choice {
        Advance::Auto => advance_test.as_ref().is_some_and(|t| t.answers_at_once),
        Advance::No => false,
        Advance::Yes => true,
    };
    (advance_test, advanced)
}

type RepeatNoise = Vec<(NoiseCovariance, usize)>;

fn average_repeats(
    records: Vec<Record>,
    preparation: &Preparation,
    steps: &mut Vec<Step>,
) -> Result<(Vec<Record>, RepeatNoise), PrepareError> {
    let Some(how) = &preparation.repeats else {
        return Ok((records, Vec::new()));
    };
    let groups = match how.period {
        Some(period) => {
            records.iter().map(|record| repeats::periods(record, period, how.skip)).collect::<Result<Vec<_>, _>>()?
        }
        None => vec![records.into_iter().skip(how.skip).collect()],
    };
    let mut averages = Vec::new();
    let mut noise = Vec::new();
    for group in &groups {
        let averaged = repeats::average(group, how.tolerance)?;
        steps.push(Step::Averaged { repeats: averaged.repeats, samples: averaged.record.samples(), skipped: how.skip });
        noise.push((averaged.noise, averaged.repeats));
        averages.push(averaged.record);
    }
    Ok((averages, noise))
}

/// Returns the records at the lower rate, and the time of their first samples in s.
fn decimate_all(
    records: Vec<Record>,
    preparation: &Preparation,
    steps: &mut Vec<Step>,
    warnings: &mut Vec<Warning>,
) -> Result<(Vec<Record>, f64), PrepareError> {
    let Some(to_hz) = preparation.decimate_to_hz else {
        return Ok((records, 0.0));
    };
    let from_hz = records[0].sample_rate_hz;
    let plan = decimate::plan(from_hz, to_hz)?;
    if plan.ratio == 1 {
        return Ok((records, 0.0));
    }
    let mut decimated = Vec::new();
    for (i, record) in records.iter().enumerate() {
        decimated.push(decimate::decimate(record, &plan, i + 1)?);
        warnings.extend(decimate::masked(record, &decimated[i], i + 1));
    }
    steps.push(Step::Decimated(plan));
    Ok((decimated, plan.edge as f64 / from_hz))
}

impl Prepared {
    /// Returns the factor by which the rate could be reduced without loss; one if the rate is not high compared with
    /// the band of the data.
    pub fn oversampled_by(&self) -> usize {
        let [inputs, outputs] = &self.bands;
        band::oversampled(inputs, outputs, self.records[0].sample_rate_hz).map_or(1, |(_, factor)| factor as usize)
    }

    /// Converts outputs of record `record` (from 0), from its sample `first` on, to the data's units. The outputs
    /// (samples x p) are measured or simulated.
    pub fn outputs_in_units(&self, record: usize, first: usize, outputs: &Array2<f64>) -> Array2<f64> {
        self.in_units(record, 1, first, &self.output_scales, outputs)
    }

    /// Converts inputs (samples x m) of record `record` (from 0), from its sample `first` on, to the data's units. An
    /// advanced input stays advanced.
    pub fn inputs_in_units(&self, record: usize, first: usize, inputs: &Array2<f64>) -> Array2<f64> {
        self.in_units(record, 0, first + self.advanced, &self.input_scales, inputs)
    }

    fn in_units(&self, record: usize, side: usize, first: usize, scales: &[f64], values: &Array2<f64>) -> Array2<f64> {
        let rate_hz = self.records[record].sample_rate_hz;
        let lines = &self.lines[record][side];
        Array2::from_shape_fn(values.dim(), |(k, i)| {
            let t = (first + k) as f64 / rate_hz;
            values[[k, i]] * scales[i] + lines[i].offset + lines[i].slope_per_s * t
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use test_plants::Gaussian;

    /// Returns a record in other units and with a trend, whose outputs respond to the input at once.
    fn record(seed: u64, samples: usize) -> Record {
        let mut g = Gaussian::new(seed);
        let inputs = Array2::from_shape_fn((samples, 1), |(k, _)| 7.0 + 0.01 * k as f64 + g.draw());
        let outputs = Array2::from_shape_fn((samples, 2), |(k, i)| {
            100.0 * (i as f64 + 1.0) * (inputs[[k, 0]] + if k > 0 { 0.5 * inputs[[k - 1, 0]] } else { 0.0 }) + g.draw()
        });
        Record {
            sample_rate_hz: 400.0,
            input_names: vec!["u".into()],
            output_names: vec!["y".into(), "z".into()],
            inputs,
            outputs,
        }
    }

    fn all_steps() -> Preparation {
        Preparation {
            decimate_to_hz: Some(200.0),
            trend: Trend::Linear,
            scaling: scaling::Scaling::Rms,
            ..Preparation::default()
        }
    }

    #[test]
    fn what_was_prepared_leads_back_to_the_data() {
        let raw = vec![record(1, 4000), record(2, 3000)];
        let prepared = prepare(raw.clone(), &[0.75, 0.0], &all_steps()).unwrap();
        assert_eq!(prepared.steps.len(), 4);
        assert_eq!(prepared.advanced, 1);
        assert_eq!(prepared.training[1], 0);
        let plan = decimate::plan(400.0, 200.0).unwrap();
        assert_eq!(prepared.start_s, plan.edge as f64 / 400.0);
        for (r, record) in raw.iter().enumerate() {
            let plain = decimate::decimate(record, &plan, 1).unwrap();
            let outputs = prepared.outputs_in_units(r, 0, &prepared.records[r].outputs);
            let inputs = prepared.inputs_in_units(r, 0, &prepared.records[r].inputs);
            for k in 0..outputs.nrows() {
                for i in 0..2 {
                    assert!((outputs[[k, i]] - plain.outputs[[k, i]]).abs() < 1e-8);
                }
                assert!((inputs[[k, 0]] - plain.inputs[[k + 1, 0]]).abs() < 1e-9);
            }
            let tail = prepared.records[r].outputs.slice(ndarray::s![50.., ..]).to_owned();
            let back = prepared.outputs_in_units(r, 50, &tail);
            assert!((back[[0, 1]] - plain.outputs[[50, 1]]).abs() < 1e-8);
        }
        let head = heads(&prepared.records, &prepared.training);
        assert!((plid_model::signal::rms(head[0].outputs.column(0)) - 1.0).abs() < 1e-9);
    }

    #[test]
    fn the_reader_is_told_what_a_missing_sample_costs() {
        let mut raw = record(1, 4000);
        raw.outputs[[2000, 1]] = f64::NAN;
        let prepared = prepare(vec![raw.clone()], &[0.75], &all_steps()).unwrap();
        let masked = |w: &&Warning| matches!(w, Warning::MaskedByFilter { channel, missing: 1, .. } if channel == "z");
        assert_eq!(prepared.warnings.iter().filter(masked).count(), 1, "{:?}", prepared.warnings);
        let how = Preparation { decimate_to_hz: None, ..all_steps() };
        assert_eq!(prepare(vec![raw], &[0.75], &how).unwrap().warnings.iter().filter(masked).count(), 0);
    }

    #[test]
    fn nothing_of_the_held_out_part_is_used() {
        let raw = record(1, 4000);
        let mut other = raw.clone();
        other.outputs.slice_mut(ndarray::s![3000.., ..]).fill(1e3);
        other.inputs.slice_mut(ndarray::s![3000.., ..]).fill(-9.0);
        let how = Preparation { decimate_to_hz: None, ..all_steps() };
        let a = prepare(vec![raw], &[0.75], &how).unwrap();
        let b = prepare(vec![other], &[0.75], &how).unwrap();
        assert_eq!(a.lines, b.lines);
        assert_eq!((a.input_scales, a.output_scales), (b.input_scales, b.output_scales));
        assert_eq!(a.advance_test, b.advance_test);
        assert_eq!(a.bands, b.bands);
    }

    #[test]
    fn the_config_overrules_the_test() {
        for (advance, advanced) in [(Advance::No, 0), (Advance::Yes, 1), (Advance::Auto, 1)] {
            let how = Preparation { advance, ..Preparation::default() };
            let prepared = prepare(vec![record(1, 1000)], &[1.0], &how).unwrap();
            assert_eq!(prepared.advanced, advanced);
            assert_eq!(prepared.records[0].samples(), 1000 - advanced);
            assert_eq!(prepared.training[0], 1000 - advanced);
            assert_eq!(prepared.advance_test.is_some(), advance == Advance::Auto);
        }
    }

    #[test]
    fn repeats_are_averaged_first() {
        let one = record(1, 1000);
        let stack = |a: &Array2<f64>| ndarray::concatenate![ndarray::Axis(0), *a, *a, *a];
        let raw = Record { inputs: stack(&one.inputs), outputs: stack(&one.outputs), ..one.clone() };
        let mut how: Preparation =
            toml::from_str("trend = \"none\"\nscaling = \"none\"\nadvance = 0\nrepeats = { period = 1000, skip = 1 }")
                .unwrap();
        let prepared = prepare(vec![raw], &[1.0], &how).unwrap();
        assert!((&prepared.records[0].outputs - &one.outputs).iter().all(|v| v.abs() < 1e-9));
        assert_eq!(prepared.repeat_noise[0].1, 2);
        assert!(prepared.steps[0].to_string().starts_with("2 repeats of 1000 samples"));
        how.repeats = toml::from_str("skip = 0").ok();
        let prepared = prepare(vec![one.clone(), one.clone()], &[1.0, 0.0], &how).unwrap();
        assert_eq!((prepared.records.len(), prepared.training.clone()), (1, vec![1000]));
    }

    #[test]
    fn records_and_shares_must_fit() {
        let how = Preparation::default();
        assert!(matches!(prepare(Vec::new(), &[], &how), Err(PrepareError::NoRecords)));
        for shares in [&[][..], &[0.0], &[1.5], &[f64::NAN], &[0.5, 0.5]] {
            let error = prepare(vec![record(1, 100)], shares, &how).unwrap_err();
            assert!(matches!(error, PrepareError::TrainingShares { .. }));
        }
        let other = Record { sample_rate_hz: 100.0, ..record(1, 100) };
        let error = prepare(vec![record(1, 100), other], &[1.0, 1.0], &how).unwrap_err();
        assert!(error.to_string().contains("record 2"), "{error}");
    }
}
