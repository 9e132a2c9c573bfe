//! The part of the gap that stochastic effects make. No free run follows them, so no fit of a free run closes this
//! part.

use crate::effects::{Observation, Place};
use crate::fit::free_run::run;
use crate::fit::problem::Placed;
use crate::judge::explained::{Explained, Refusal};
use crate::judge::residual_noise;
use crate::judge::shrink::{blocks, floor, opened};
use crate::judge::verdict::outside;
use crate::noise::Source;
use crate::search::rules::Rules;
use crate::search::stochastic::{Stochastic, wandering};
use crate::signal::quantisation::repeats;

/// Returns the stochastic effects that enter the answer.
pub fn shown<'s, 'a>(
    explained: &Explained,
    stochastic: &'s [Stochastic<'a>],
    rules: &Rules,
) -> Vec<&'s Stochastic<'a>> {
    let problem = &explained.ready.problem;
    let settings = &problem.settings;
    let enters = |u: &&Stochastic| {
        u.gain > settings.search.stochastic_gain
            && rules.allow(&u.placed, &problem.setting.names)
            && wandering(&u.placed, &explained.found.best.effects, settings.prepare.near_line).is_none()
            && !explained.unpredicted.as_ref().is_some_and(|noise| noise.hides(&u.placed))
            && residual_noise::stands(explained, u)
    };
    stochastic.iter().filter(enters).collect()
}

/// Returns the squared gap that a stochastic effect makes on the opened records.
pub fn squared_gap(explained: &Explained, stochastic: &Stochastic) -> f64 {
    let placed = &stochastic.placed;
    match (placed.effect.observed_in(), &placed.place) {
        (Observation::SensorNoise, Place::Output(o)) => of_outputs(explained, &[(*o, placed.parameters[0])]),
        // The error of a converter is uniform over a step; the half step that truncation subtracts has been restored.
        (Observation::Quantisation, Place::Output(o)) => {
            of_outputs(explained, &[(*o, placed.parameters[0] / 12.0_f64.sqrt())])
        }
        (Observation::Dropouts, Place::Output(o)) => of_dropouts(explained, *o),
        (Observation::Band, _) => of_band(explained),
        (_, Place::Frequency(hz, port)) => {
            let mut lines = explained.ready.wandering.iter().filter(|line| line.hz == *hz && line.port == *port);
            let rms = lines.next().map_or(&[][..], |line| &line.rms);
            of_outputs(explained, &rms.iter().copied().enumerate().collect::<Vec<_>>())
        }
        _ => 0.0,
    }
}

/// Returns the squared gap of errors on some outputs, each with its RMS.
fn of_outputs(explained: &Explained, errors: &[(usize, f64)]) -> f64 {
    let mut rms = vec![0.0; explained.ready.problem.plant.p];
    errors.iter().for_each(|&(o, error)| rms[o] = error);
    floor(explained, &rms).powi(2)
}

/// Returns the squared gap of a random force in a band, which is part of the noise.
fn of_band(explained: &Explained) -> f64 {
    let mut without = explained.ready.noise.clone();
    without.sources.retain(|(source, _)| !matches!(source, Source::Band(_)));
    (floor(explained, &explained.ready.noise.rms()).powi(2) - floor(explained, &without.rms()).powi(2)).max(0.0)
}

/// Returns the squared gap of the samples that an output drops in the opened records.
fn of_dropouts(explained: &Explained, o: usize) -> f64 {
    let ready = &explained.ready;
    let problem = &ready.problem;
    let fit = explained.predicting();
    let (plant, actions) = (problem.nuisance.apply(&problem.plant, &fit.eta), problem.actions(&fit.effects));
    let (mut dropped, mut all) = (0.0, 0.0);
    for record in opened(explained).into_iter().filter(|record| record.is_driven()) {
        let error = record.error(&run(&plant, &actions, record)).swap_remove(o);
        let repeated = repeats(&record.y[o], &error, ready.declared_sensor[o], &problem.settings.signal);
        dropped += repeated.into_iter().map(|k| error[k]).filter(|e| e.is_finite()).map(|e| e * e).sum::<f64>();
        all += record.y[o].iter().filter(|y| y.is_finite()).map(|y| y * y).sum::<f64>();
    }
    dropped / all.max(f64::MIN_POSITIVE) / problem.plant.p as f64
}

/// Returns the part of the squared gaps of stochastic effects that is due to dropped samples. Dropped samples are
/// masked, so the noise model does not contain them.
pub fn of_dropped(shown: &[&Stochastic], squared_gaps: &[f64]) -> f64 {
    let all = shown.iter().zip(squared_gaps);
    all.filter(|(u, _)| u.placed.effect.observed_in() == Observation::Dropouts).map(|(_, squared)| squared).sum()
}

impl<'a> Explained<'a> {
    /// Replaces an explanation by the refit if it leaves too much of the gap beyond noise and limits to be credible,
    /// while stochastic effects make most of the gap that the refit leaves. Free runs do not reveal the main fault of
    /// such a simulation. The probability of something else becomes that of a fit which leaves the same share.
    pub(crate) fn leave_to_noise(mut self, stochastic: &[Stochastic<'a>], rules: &Rules, material: f64) -> Self {
        let problem = &self.ready.problem;
        let settings = &problem.settings.judge;
        if self.ready.widened.is_none() {
            return self;
        }
        let shown = shown(&self, stochastic, rules);
        let made: Vec<f64> = shown.iter().map(|u| squared_gap(&self, u)).collect();
        let noise: f64 = made.iter().sum();
        if noise < material * material {
            return self;
        }
        let floor = floor(&self, &self.noise_rms()).powi(2) + of_dropped(&shown, &made);
        let beyond = |eta: &[f64], effects: &[Placed]| {
            let plant = problem.nuisance.apply(&problem.plant, eta);
            let gap = blocks(&opened(&self), &plant, &problem.actions(effects)).gap();
            (gap * gap - floor).max(0.0)
        };
        let within = self.refitted.within_limits(problem);
        let without = beyond(&within, &[]);
        let with = self.predicting();
        let kept = self.judged.left.max(beyond(&with.eta, &with.effects) / without.max(f64::MIN_POSITIVE)).sqrt();
        let credible = !with.effects.is_empty() && kept <= settings.most_left;
        let left = (without / (without + noise)).sqrt();
        if credible || left > settings.most_left {
            return self;
        }
        self.judged.unknown = outside(left, settings);
        if !self.found.best.effects.is_empty() {
            self.retreat(Refusal::BesideNoise);
        }
        self
    }
}

#[cfg(test)]
mod tests {
    use crate::case::record::rms;
    use crate::diagnose::diagnose;
    use crate::effects::Library;
    use crate::judge::verdict::Verdict;
    use crate::testing;

    /// The noise of a sensor is the main cause, although the simulation also lacks products of one channel with the
    /// past of the other, which no effect explains. If the products are larger, the answer remains "something else".
    #[test]
    fn noise_is_the_main_cause_with_small_imperfections_and_not_with_large_ones() {
        let library = Library::standard();
        for (noise, product, verdict) in [(0.25, 0.05, Verdict::Effects), (0.05, 0.3, Verdict::Unknown)] {
            let sim = testing::truss(1);
            let mut case = testing::case(&sim, &sim);
            let size: Vec<f64> = case.records[1].y.iter().map(rms).collect();
            for (k, record) in case.records.iter_mut().enumerate() {
                record.u.iter_mut().chain(&mut record.y).for_each(|channel| channel.truncate(1500));
                testing::add_products(&mut record.y, product, &size);
                testing::add_noise(&mut record.y, 900 + k as u64, &[noise * size[0], 0.0]);
            }
            testing::only(&mut case, &["sensor-saturation", "actuator-saturation", "actuator-lag"]);
            let diagnosis = diagnose(&case, &library, &mut |_| {}).unwrap().diagnosis;
            assert_eq!(diagnosis.verdict, verdict, "{noise} {product}: {}", diagnosis.sentence);
            if verdict == Verdict::Effects {
                let first = &diagnosis.effects[0];
                assert_eq!((first.effect.as_str(), first.location.as_str()), ("sensor-noise", "output:y1"));
                let std = first.parameters.values().next().unwrap().value;
                assert!((std / (noise * size[0]) - 1.0).abs() < 0.1, "{std}");
                assert!(diagnosis.sentence.contains("unpredictable noise makes a gap of"), "{}", diagnosis.sentence);
            }
        }
    }

    /// Dropped samples are the main cause, although they are twice as frequent in the held-out record as in the fitted
    /// ones.
    #[test]
    fn dropouts_are_counted_where_the_gap_is_measured() {
        let sim = testing::truss(1);
        let mut case = testing::case(&sim, &sim);
        let size: Vec<f64> = case.records[1].y.iter().map(rms).collect();
        for (k, record) in case.records.iter_mut().enumerate() {
            testing::add_products(&mut record.y, 0.05, &size);
            let every = if k == 3 { 40 } else { 80 };
            for from in (50..record.samples() - 10).step_by(every) {
                let held = record.y[0][from];
                record.y[0][from + 1..from + 4].fill(held);
            }
            record.held_out = k == 3;
        }
        testing::only(&mut case, &["sensor-saturation", "actuator-saturation", "actuator-lag"]);
        let diagnosis = diagnose(&case, &Library::standard(), &mut |_| {}).unwrap().diagnosis;
        assert_eq!(diagnosis.verdict, Verdict::Effects, "{}", diagnosis.sentence);
        let first = testing::first_is(&diagnosis, "sensor-dropout", "output:y1");
        assert!(first.confidence > 0.5, "{}", diagnosis.sentence);
    }
}
