//! Constant errors that all driven records share.
//!
//! The likelihood of an imperfect simulation gives little weight to the frequencies at which the simulation is off.
//! Zero is often one of them, because sensors have offsets. Such an offset is not a cause of the gap, but a prediction
//! is better with it.

use plid_model::signal::mean;

use crate::case::record::{Channels, Record};
use crate::effects::{Effect, Place, SensorOffset};
use crate::fit::free_run::outputs;
use crate::fit::problem::{Fit, Placed, Problem};

/// Number of blocks of each record. The scatter of their means gives the uncertainty of the overall mean.
const BLOCKS: usize = 8;

/// Returns the offset of each output that an explanation leaves in all driven records together, if it is significant.
pub fn offsets<'a>(problem: &Problem, fit: &Fit) -> Vec<Placed<'a>> {
    let simulated = outputs(problem, &fit.eta, &fit.effects);
    let driven = || problem.records.iter().zip(&simulated).filter(|(record, _)| record.is_driven());
    let offset = |o: usize| {
        let place = Place::Output(o);
        let there = |placed: &Placed| placed.effect.name() == SensorOffset.name() && placed.place == place;
        if fit.effects.iter().any(there) {
            return None;
        }
        let blocks = |(record, simulated): (&Record, &Channels)| -> Vec<f64> {
            let error: Vec<f64> = record.measured_error(o, &simulated[o]).collect();
            error.chunks(error.len().div_ceil(BLOCKS).max(1)).map(mean).collect()
        };
        let certain = certain_mean(&driven().flat_map(blocks).collect::<Vec<f64>>());
        let (offset, _) = certain.filter(|(_, t)| *t > problem.settings.judge.offset_deviations)?;
        Some(placed(o, offset))
    };
    (0..problem.plant.p).filter_map(offset).collect()
}

/// Returns an offset at an output.
pub(crate) fn placed<'a>(output: usize, offset: f64) -> Placed<'a> {
    Placed { effect: &SensorOffset, place: Place::Output(output), parameters: vec![offset] }
}

/// Returns the mean of at least three values, and its magnitude in standard deviations of the mean.
fn certain_mean(values: &[f64]) -> Option<(f64, f64)> {
    let count = values.len() as f64;
    if count < 3.0 {
        return None;
    }
    let all = mean(values);
    let variance = values.iter().map(|x| (x - all).powi(2)).sum::<f64>() / (count - 1.0);
    Some((all, all.abs() / (variance / count).sqrt().max(f64::MIN_POSITIVE)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::refit::{STEPS, refit};
    use crate::prepare::{Known, prepare};
    use crate::testing;

    /// Student's t of 1, 2, 3: mean 2, standard error 1/sqrt(3).
    #[test]
    fn the_size_of_a_mean_is_students_t() {
        let (mean, t) = certain_mean(&[1.0, 2.0, 3.0]).unwrap();
        assert!((mean - 2.0).abs() < 1e-12 && (t - 2.0 * 3_f64.sqrt()).abs() < 1e-12);
        assert_eq!(certain_mean(&[1.0, 2.0]), None);
    }

    #[test]
    fn an_offset_is_found_where_it_is_and_only_there() {
        const OFFSET: f64 = 0.02;
        let sim = testing::truss(1);
        let mut case = testing::case(&sim, &sim);
        for record in &mut case.records {
            record.y[1].iter_mut().for_each(|y| *y += OFFSET);
            // Missing samples are ignored.
            record.y[1][100..400].fill(f64::NAN);
        }
        let ready = prepare(case.model.as_ref().unwrap(), &case.records, &Known::default()).unwrap();
        let fit = refit(&ready.problem, STEPS).as_fit();
        let found = offsets(&ready.problem, &fit);
        assert_eq!(found.iter().map(|placed| placed.place.clone()).collect::<Vec<_>>(), [Place::Output(1)]);
        assert!((found[0].parameters[0] / OFFSET - 1.0).abs() < 0.05, "{:?}", found[0].parameters);
        // With this offset in place, nothing is left.
        assert!(offsets(&ready.problem, &Fit { effects: found, ..fit }).is_empty());
    }
}
