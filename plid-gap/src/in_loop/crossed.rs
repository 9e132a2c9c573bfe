//! Predictions of each fitted record by a fit to the others, as `judge/crossed.rs` makes them with a model.
//!
//! A fit takes too many runs to be repeated for each record. A fit to the other records is therefore one Gauss-Newton
//! step from the fit to all of them, with the derivatives of that fit, if the step lowers the cost. It takes one run of
//! every record.

use std::ops::Range;

use crate::case::record::{Channels, Record};
use crate::in_loop::fit::TRIES;
use crate::in_loop::problem::{Fit, Problem};
use crate::in_loop::runs::Runs;
use crate::judge::crossed::others_are_as_loud;
use crate::settings::GapSettings;

impl<'a> Problem<'a> {
    /// Returns the outputs of all records, those of each driven record as a fit to the others predicts them. A record
    /// that is louder than all others is predicted part by part, from its other parts as well. Returns `None` if the
    /// bounds or the settings do not allow the runs.
    pub fn crossed(&self, runs: &mut Runs, fit: &Fit<'a>, settings: &GapSettings) -> Option<Vec<Channels>> {
        if fit.effects.is_empty() && self.nuisances.is_empty() {
            // Nothing was fitted to these records.
            return Some(fit.simulated.clone());
        }
        let folds = folds(&self.records, settings);
        let left = runs.bounds().left(runs.spent(), self.samples()).0;
        let needed = self.runs_of_slopes(runs, fit) + (folds.len() + TRIES) * self.records.len();
        if needed > left.min(settings.in_loop.crossed_calls) {
            return None;
        }
        let slopes = self.slopes(runs, fit);
        let mut predicted = fit.simulated.clone();
        for (record, samples) in folds {
            let others = self.without(record, samples.clone());
            let start = others.as_is(fit.effects.clone(), fit.eta.clone(), fit.simulated.clone());
            let simulated = others.stepped(runs, Fit { slopes: Some(slopes.clone()), ..start }).simulated;
            for (to, from) in predicted[record].iter_mut().zip(&simulated[record]) {
                to[samples.clone()].copy_from_slice(&from[samples.clone()]);
            }
        }
        Some(predicted)
    }
}

/// Returns the samples that are predicted together, each with its record.
fn folds(records: &[Record], settings: &GapSettings) -> Vec<(usize, Range<usize>)> {
    let parts_of = |k: usize| {
        let shown = others_are_as_loud(records, k, settings.case.same_level);
        let (samples, parts) = (records[k].samples(), if shown { 1 } else { settings.judge.prediction_parts });
        (0..parts).map(move |part| (k, samples * part / parts..samples * (part + 1) / parts))
    };
    (0..records.len()).filter(|&k| records[k].is_driven()).flat_map(parts_of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::record;

    /// A record that is as loud as another one is predicted as a whole, the loudest one in parts, and one without
    /// input not at all.
    #[test]
    fn the_loudest_record_is_predicted_in_parts() {
        let of = |level: f64| record(vec![vec![level; 400]], vec![vec![0.0; 400]]);
        let settings = GapSettings::default();
        let folds = folds(&[of(0.5), of(0.0), of(1.0)], &settings);
        let parts = [0..100, 100..200, 200..300, 300..400].map(|samples| (2, samples));
        assert_eq!(folds[0], (0, 0..400));
        assert_eq!(folds[1..], parts);
    }
}
