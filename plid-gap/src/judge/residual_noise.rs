//! Stochastic effects if no record shows the noise alone and the residual of driven records counts as noise.
//!
//! The residual also contains errors that no effect of the vocabulary describes. An effect is stated only if it
//! accounts for most of the residual, and a noisy sensor only if its noise does not depend on the motion.

use crate::case::record::Record;
use crate::effects::{Library, Observation, Place};
use crate::fit::free_run::outputs;
use crate::judge::explained::Explained;
use crate::judge::predictability::Unpredicted;
use crate::judge::shrink::floor;
use crate::judge::stochastic_gap::squared_gap;
use crate::search::stochastic::{Stochastic, stochastic_effects};

/// Returns whether a stochastic effect is kept. It always is if it is not observed in a residual, or if the residual
/// does not count as noise.
pub fn stands(explained: &Explained, stochastic: &Stochastic) -> bool {
    match (stochastic.placed.effect.observed_in(), &stochastic.placed.place) {
        _ if explained.unpredicted.is_none() => true,
        (Observation::SensorNoise, Place::Output(o)) => {
            is_noisy(explained, stochastic) && !grows_with_motion(explained, *o)
        }
        (Observation::Band, _) => is_most(explained, stochastic),
        _ => true,
    }
}

/// Returns whether an effect accounts for most of a residual that counts as noise.
fn is_most(explained: &Explained, stochastic: &Stochastic) -> bool {
    let Some(unpredicted) = &explained.unpredicted else { return false };
    squared_gap(explained, stochastic) > 0.5 * floor(explained, &unpredicted.rms).powi(2)
}

/// Returns whether a sensor accounts for most of the residual, with a much larger noise than the declared one.
fn is_noisy(explained: &Explained, stochastic: &Stochastic) -> bool {
    let Place::Output(o) = stochastic.placed.place else { return false };
    let problem = &explained.ready.problem;
    let least = problem.settings.judge.residual_noisier * explained.ready.declared_sensor[o];
    // Only a comparison with other sensors reveals whether the noise of all sensors is misjudged by a common factor.
    problem.plant.p > 1 && stochastic.placed.parameters[0] > least && is_most(explained, stochastic)
}

impl<'a> Explained<'a> {
    /// Returns the explanation, with its residual as the noise of the records if the residual counts as noise, and
    /// the stochastic effects that are found in the residual. If the residual looks like that of a noisy sensor but
    /// grows with the motion, something outside the vocabulary is at work.
    pub(crate) fn with_noise_of_residual(
        mut self,
        library: &'a Library,
        may_be_band: bool,
        material: f64,
    ) -> (Self, Vec<Stochastic<'a>>) {
        let settings = &self.ready.problem.settings;
        let fit = self.predicting();
        let matters = self.ready.widened.is_some()
            && self.ready.quiet.is_empty()
            && self.opened_gap(&fit.eta, &fit.effects) > material;
        if matters && self.unpredicted.is_some() {
            self.take_for_noise(may_be_band);
        } else if matters
            && self.judged.unknown >= settings.search.inadequate
            && let Some(unpredicted) = Unpredicted::for_the_most_part(&self.ready.problem, self.fit())
        {
            let before = self.ready.clone();
            self.unpredicted = Some(unpredicted);
            self.take_for_noise(may_be_band);
            let stochastic = stochastic_effects(&self.ready, library);
            if stochastic.iter().any(|u| is_most(&self, u) && stands(&self, u)) {
                return (self, stochastic);
            }
            (self.ready, self.unpredicted) = (before, None);
        }
        let stochastic = stochastic_effects(&self.ready, library);
        let grows = |u: &Stochastic| {
            u.placed.effect.observed_in() == Observation::SensorNoise && is_noisy(&self, u) && !stands(&self, u)
        };
        if stochastic.iter().any(grows) {
            self.judged.unknown = self.ready.problem.settings.judge.most_unknown;
        }
        (self, stochastic)
    }

    fn take_for_noise(&mut self, may_be_band: bool) {
        let fit = self.fit();
        let simulated = outputs(&self.ready.problem, &fit.eta, &fit.effects);
        self.ready.take_for_noise(&simulated, may_be_band);
    }
}

/// Returns whether the squared residual of an output is correlated with the square of the simulated output. The noise
/// of a sensor is independent of the measured motion; errors in the gain or in the timing of single samples are not.
fn grows_with_motion(explained: &Explained, output: usize) -> bool {
    let problem = &explained.ready.problem;
    let fit = explained.predicting();
    let simulated = outputs(problem, &fit.eta, &fit.effects);
    let driven = problem.records.iter().zip(&simulated).filter(|(record, _)| record.is_driven());
    let squares = |(record, simulated): (&Record, &Vec<Vec<f64>>)| -> Vec<[f64; 2]> {
        let both = record.y[output].iter().zip(&simulated[output]).filter(|(y, _)| y.is_finite());
        both.map(|(y, s)| [(y - s).powi(2), s * s]).collect()
    };
    let squares: Vec<[f64; 2]> = driven.flat_map(squares).collect();
    correlation(&squares) > problem.settings.judge.noise_grows
}

/// Returns the correlation coefficient of pairs.
fn correlation(pairs: &[[f64; 2]]) -> f64 {
    let count = pairs.len().max(1) as f64;
    let mean = [0, 1].map(|i| pairs.iter().map(|pair| pair[i]).sum::<f64>() / count);
    let moment = |i: usize, j: usize| pairs.iter().map(|pair| (pair[i] - mean[i]) * (pair[j] - mean[j])).sum::<f64>();
    moment(0, 1) / (moment(0, 0) * moment(1, 1)).sqrt().max(f64::MIN_POSITIVE)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::case::record::rms;
    use crate::diagnose::diagnose;
    use crate::judge::verdict::Verdict;
    use crate::testing;

    /// Without a quiet record, a noisy sensor is named beside small imperfections that no effect explains. Noise in
    /// proportion to the output is not sensor noise.
    #[test]
    fn a_sensor_is_noisy_if_its_noise_does_not_follow_the_motion() {
        for (follows, verdict) in [(false, Verdict::Effects), (true, Verdict::Unknown)] {
            let sim = testing::truss(1);
            let mut case = testing::case(&sim, &sim);
            case.records.remove(0);
            let size: Vec<f64> = case.records[0].y.iter().map(rms).collect();
            for (k, record) in case.records.iter_mut().enumerate() {
                testing::add_products(&mut record.y, 0.02, &size);
                let noise = testing::random_input(900 + k as u64, record.samples(), 1).remove(0);
                for (y, e) in record.y[0].iter_mut().zip(noise) {
                    *y += 0.2 * e * if follows { *y } else { size[0] };
                }
            }
            testing::only(&mut case, &["sensor-saturation", "actuator-saturation", "actuator-lag"]);
            let diagnosis = diagnose(&case, &Library::standard(), &mut |_| {}).unwrap().diagnosis;
            assert_eq!(diagnosis.verdict, verdict, "{follows}: {}", diagnosis.sentence);
            if verdict == Verdict::Effects {
                let first = testing::first_is(&diagnosis, "sensor-noise", "output:y1");
                let std = first.parameters.values().next().unwrap().value;
                assert!((std / (0.2 * size[0]) - 1.0).abs() < 0.1, "{std} {}", size[0]);
            }
        }
    }

    #[test]
    fn correlation_is_that_of_the_textbook() {
        let pairs = [[1.0, 2.0], [2.0, 4.0], [3.0, 6.0]];
        assert!((correlation(&pairs) - 1.0).abs() < 1e-12);
        // Deviations -1, 0, 1 and 1, -2, 1 are orthogonal.
        assert!(correlation(&[[1.0, 3.0], [2.0, 0.0], [3.0, 3.0]]).abs() < 1e-12);
    }
}
