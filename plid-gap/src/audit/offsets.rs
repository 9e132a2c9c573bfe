//! The constants that the outputs contain in addition to the response of the best linear model of the records.
//!
//! The recorded outputs of a plant at rest are rarely zero: a level is measured from the floor, and a diode or a
//! square law adds a mean. In a model without an offset, a pole near one takes its place, and a run from rest begins
//! too low.

use plid_model::Model;
use plid_model::signal::mean;

use crate::audit::rewire::short;
use crate::audit::surrogate::{Linear, linear, relative};
use crate::case::Case;
use crate::case::record::{Channels, Record};
use crate::error::GapError;
use crate::fit::free_run::run;
use crate::fit::linear_model::Arrays;
use crate::plant::Plant;
use crate::settings::PlantSettings;

/// Number of rounds in which the model and the offsets of its outputs are identified alternately.
const OFFSET_ROUNDS: usize = 2;

/// Number of rounds in which the mean error of a model is determined.
const MEAN_ROUNDS: usize = 6;

/// Identifies the model again, together with a constant at each output. Returns the model with its relative free-run
/// error, and the offsets. If the records show no clear offsets, the model without offsets is returned.
pub(super) fn with_offsets(
    case: &Case,
    records: &[Record],
    plain: (Linear, f64),
) -> Result<((Linear, f64), Vec<f64>), GapError> {
    // If records are set aside for the model, an offset in the other records is a cause to be named.
    if case.controller.is_some() || !case.for_simulation.is_empty() {
        return Ok((plain, Vec::new()));
    }
    // Without the means of each record, the first model has no constant that slow poles would have to imitate.
    let mut centred = records.to_vec();
    centred.iter_mut().for_each(centre);
    let Ok((mut from, _)) = linear(case, &centred, false) else { return Ok((plain, Vec::new())) };
    let all = Arrays::new(records.iter().collect(), |record| &record.y);
    let values = records.iter().map(|record| (record.samples() * record.y.len()) as f64).sum::<f64>();
    let clear = |error: f64| 2.0 * values * (plain.1 / error).ln() > case.config.settings.search.accept_gain;
    let mut best = None;
    for _ in 0..OFFSET_ROUNDS {
        let offsets = mean_errors(&from.model, records, &case.config.settings.plant)?;
        let mut shifted = records.to_vec();
        shifted.iter_mut().for_each(|record| shift(record, &offsets));
        let Ok((linear, of_shifted)) = linear(case, &shifted, false) else { break };
        let error = relative(&linear.std, &all);
        let validation_error = linear.validation_error * error / of_shifted;
        from = Linear { validation_error, ..linear };
        if best.as_ref().is_none_or(|((_, least), _)| error < *least) && clear(error) {
            best = Some(((from.clone(), error), offsets));
        }
    }
    Ok(best.unwrap_or((plain, Vec::new())))
}

/// Returns the mean error of the free runs of a model, for each output. The fitted initial state of a run absorbs a
/// part of a constant error as a transient, so the remaining error is determined again after the mean so far has been
/// subtracted.
fn mean_errors(model: &Model, records: &[Record], settings: &PlantSettings) -> Result<Vec<f64>, GapError> {
    let plant = Plant::with_settings(model, settings)?;
    let mut shifted = records.to_vec();
    let mut means = vec![0.0; plant.p];
    for _ in 0..MEAN_ROUNDS {
        let runs: Vec<Channels> = shifted.iter().map(|record| run(&plant, &[], record)).collect();
        let error = |o: usize| shifted.iter().zip(&runs).flat_map(move |(record, y)| record.measured_error(o, &y[o]));
        let left: Vec<f64> = (0..plant.p).map(|o| mean(error(o))).collect();
        shifted.iter_mut().for_each(|record| shift(record, &left));
        means.iter_mut().zip(left).for_each(|(mean, left)| *mean += left);
    }
    Ok(means)
}

/// Subtracts the mean from each channel of a record, which then no longer begins at rest.
fn centre(record: &mut Record) {
    record.from_rest = false;
    for x in record.u.iter_mut().chain(&mut record.y) {
        let mean = mean(x.iter());
        x.iter_mut().for_each(|x| *x -= mean);
    }
}

/// Subtracts the offsets from a record's outputs.
pub(super) fn shift(record: &mut Record, offsets: &[f64]) {
    for (y, offset) in record.y.iter_mut().zip(offsets) {
        y.iter_mut().for_each(|y| *y -= offset);
    }
}

/// Returns a sentence about the offsets, if there are any.
pub(super) fn in_words(offsets: &[f64], outputs: &[String]) -> String {
    let each: Vec<String> =
        outputs.iter().zip(offsets).map(|(name, offset)| format!("{name} {}", short(*offset))).collect();
    if each.is_empty() {
        return String::new();
    }
    format!(
        " In addition to the response, the outputs contain constants ({}), which are fitted together with the model.",
        each.join(", ")
    )
}

#[cfg(test)]
mod tests {
    use crate::audit::surrogate::{Surrogate, identify};
    use crate::case::record::rms;
    use crate::testing::{apart, case, truss};

    /// A level above the floor is an offset of the sensor, and runs from rest begin there. Without such a level there
    /// is no offset.
    #[test]
    fn a_constant_beside_the_response_is_an_offset() {
        const LEVELS: [f64; 2] = [3.0, -0.5];
        let mut case = case(&truss(3), &truss(3));
        case.config.states = Some(truss(3).n());
        assert!(identify(&case, &mut |_| {}).unwrap().offsets.is_empty());
        let sizes: Vec<f64> = case.records[1].y.iter().map(rms).collect();
        let levels: Vec<f64> = LEVELS.iter().zip(&sizes).map(|(level, size)| level * size).collect();
        for record in &mut case.records {
            record.y.iter_mut().zip(&levels).for_each(|(y, level)| y.iter_mut().for_each(|y| *y += level));
        }
        let Surrogate { model, words, offsets, .. } = identify(&case, &mut |_| {}).unwrap();
        assert_eq!(offsets.len(), levels.len());
        for ((found, level), size) in offsets.iter().zip(&levels).zip(&sizes) {
            assert!((found - level).abs() < 0.005 * size, "{offsets:?} {levels:?}");
        }
        assert!(apart(&model, &truss(3)) < 0.002, "{}", apart(&model, &truss(3)));
        assert!(words.ends_with("which are fitted together with the model."), "{words}");
    }
}
