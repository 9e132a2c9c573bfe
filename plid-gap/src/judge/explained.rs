//! The result of the search and its adequacy.

use crate::case::record::Record;
use crate::fit::candidate::{Candidate, all_same};
use crate::fit::free_run::{outputs, run};
use crate::fit::problem::{Fit, Placed, Problem};
use crate::fit::refit::{Refit, clipped};
use crate::judge::gap;
use crate::judge::predictability::Unpredicted;
use crate::judge::shrink::{blocks, floor, opened};
use crate::judge::verdict::{Adequacy, outside};
use crate::prepare::{NoiseLevel, Prepared};
use crate::search::shape::FreeShapeFit;
use crate::search::stage::polish;
use crate::search::stepwise::Search;
use crate::settings::JudgeSettings;

/// The result of the search and its adequacy.
pub struct Explained<'a> {
    /// The problem as the search left it, with fitted scales of inferred ports, updated noise and ports on modes.
    pub ready: Prepared,
    /// The problem on the first samples of the records.
    pub quick: Problem,
    /// The bounded refit.
    pub refitted: Refit,
    /// The explanations.
    pub found: Search<'a>,
    /// The best explanation with the shape of one effect set free, if its own shape does not suffice.
    pub free_shape: Option<FreeShapeFit<'a>>,
    /// Offsets of the outputs of an imperfect simulation: part of the prediction, but not of the explanation.
    pub offsets: Vec<Placed<'a>>,
    /// The adequacy of the best explanation.
    pub judged: Adequacy,
    /// The noise level.
    pub level: NoiseLevel,
    /// The residual of the best explanation, if no record shows the noise level and the inputs do not predict this
    /// residual.
    pub unpredicted: Option<Unpredicted>,
    /// Sum of squares of the simulation as given.
    pub given_cost: f64,
    /// Explanations that were refused although they fitted best, with the reason.
    pub refused: Vec<(Vec<Placed<'a>>, Refusal)>,
}

/// The reason for refusing an explanation that fitted best.
#[derive(Debug, Clone, PartialEq)]
pub enum Refusal {
    /// Its free run of this record diverges.
    Diverges(String),
    /// It fits the noise of the fitted records.
    FitsNoise,
    /// It leaves most of the gap that stochastic effects do not account for.
    BesideNoise,
    /// It predicts the held-out records worse than the simulation without effects.
    Overfits,
    /// It predicts the held-out records much worse than an explanation that fits as well.
    Outdone,
    /// It leaves most of the gap of the held-out records, and a change over time closes that gap.
    Untimely,
}

impl<'a> Explained<'a> {
    /// Returns the fit of the best explanation, with a free shape if it needs one.
    pub fn fit(&self) -> &Fit<'a> {
        self.free_shape.as_ref().map_or(&self.found.best, |free| &free.fit)
    }

    /// Returns the model that predicts: the fit, with the offsets of the outputs.
    pub fn predicting(&self) -> Fit<'a> {
        let mut fit = self.fit().clone();
        fit.effects.extend(self.offsets.iter().cloned());
        fit
    }

    /// Returns the RMS of each output's noise, including lines whose phase wanders. If no record shows the noise level,
    /// the RMS is that of the residual if the residual counts as noise, and otherwise at most that of the residual.
    pub fn noise_rms(&self) -> Vec<f64> {
        if let Some(unpredicted) = &self.unpredicted {
            return unpredicted.rms.clone();
        }
        let noise = self.ready.noise.rms().into_iter().map(|rms| rms * self.level.factor.min(1.0).sqrt());
        let lines = |o: usize| self.ready.wandering.iter().map(|line| line.rms[o].powi(2)).sum::<f64>();
        noise.enumerate().map(|(o, noise)| (noise * noise + lines(o)).sqrt()).collect()
    }

    /// Returns the first record, held out or not, whose free run diverges. Without effects no free run does, because
    /// the audit refuses unstable simulations.
    fn unbounded(&self) -> Option<&Record> {
        if self.fit().effects.is_empty() {
            return None;
        }
        let problem = &self.ready.problem;
        let plant = problem.nuisance.apply(&problem.plant, &self.fit().eta);
        let actions = problem.actions(&self.fit().effects);
        let finite = |record: &&Record| run(&plant, &actions, record).iter().flatten().all(|y| y.is_finite());
        problem.records.iter().chain(&self.ready.held_out).find(|record| !finite(record))
    }

    /// Replaces an explanation whose free run of a record diverges by the next one whose free runs do not, or by the
    /// refit.
    pub(crate) fn refuse_divergence(mut self) -> Self {
        let JudgeSettings { most_refused: mut tries, most_unknown, .. } = self.ready.problem.settings.judge;
        while let Some(name) = self.unbounded().map(|record| record.name.clone()) {
            self.free_shape = None;
            self.unpredicted = None;
            self.offsets.clear();
            self.judged.unknown = most_unknown;
            let problem = &self.ready.problem;
            let found = &mut self.found;
            found.candidates.retain(|c| !all_same(&c.effects, &found.best.effects));
            tries -= 1;
            let cheaper = |c: &&Candidate| tries > 0 && !c.effects.is_empty() && c.priced < self.refitted.cost;
            // The fit starts from the refit, because the linear parameters of the diverging explanation compensate
            // for its effects.
            let anew = |c: &Candidate<'a>| {
                let fit = polish(problem, Fit { effects: c.effects.clone(), ..self.refitted.as_fit() });
                if fit.cost.is_finite() { problem.settled(&fit) } else { fit }
            };
            let next = found.candidates.iter().find(cheaper).map(anew);
            let refused = std::mem::replace(&mut found.best, next.unwrap_or_else(|| self.refitted.as_fit()));
            if self.refused.is_empty() {
                self.refused.push((refused.effects, Refusal::Diverges(name)));
            }
        }
        self
    }

    /// Replaces an explanation that leaves most of the gap on held-out records by the refit, if no record shows the
    /// noise level and the inputs do not predict the residual of the refit. A refit may be able to follow the records
    /// only beyond the stated limits. An explanation that follows them within the limits is kept.
    pub(crate) fn refuse_fits_to_noise(mut self) -> Self {
        let Prepared { problem, widened, quiet, .. } = &self.ready;
        let without = self.refitted.as_fit();
        let gap = |fit: &Fit| self.opened_gap(&fit.eta, &fit.effects);
        if widened.is_none() || !quiet.is_empty() || self.fit().effects.is_empty() {
            return self;
        }
        let within =
            |fit: &Fit| clipped(problem, &fit.eta).map_or_else(|| gap(fit), |eta| self.opened_gap(&eta, &fit.effects));
        let closes =
            |of: &dyn Fn(&Fit) -> f64| of(&self.predicting()) < problem.settings.judge.most_left * of(&without);
        if closes(&gap) || closes(&within) {
            return self;
        }
        let Some(unpredicted) = Unpredicted::of(problem, &without) else { return self };
        self.judged.unknown = unpredicted.unknown(&problem.settings.judge);
        self.unpredicted = Some(unpredicted);
        self.retreat(Refusal::FitsNoise);
        self
    }

    /// Returns the gap of the free runs of the opened records, with these linear parameters and effects.
    pub(super) fn opened_gap(&self, eta: &[f64], effects: &[Placed]) -> f64 {
        let problem = &self.ready.problem;
        blocks(&opened(self), &problem.nuisance.apply(&problem.plant, eta), &problem.actions(effects)).gap()
    }

    /// Replaces the explanation by one that the fitted records cannot distinguish from it, and that predicts the
    /// held-out records much better. An example is a pair of stops, of which only the held-out record reaches the
    /// second.
    pub(crate) fn refuse_outdone(mut self) -> Self {
        let (problem, best) = (&self.ready.problem, &self.found.best);
        if self.ready.held_out.is_empty() || self.free_shape.is_some() || best.effects.is_empty() {
            return self;
        }
        let most = self.price() + problem.settings.search.accept_gain;
        let tied = self.found.candidates.iter().filter(|candidate| {
            candidate.priced < most && !candidate.effects.is_empty() && !all_same(&candidate.effects, &best.effects)
        });
        let fitted = |c: &Candidate<'a>| polish(problem, Fit { effects: c.effects.clone(), ..best.clone() });
        let gap = |fit: &Fit| self.opened_gap(&fit.eta, &fit.effects);
        let JudgeSettings { most_refused, outdone, .. } = problem.settings.judge;
        let least = outdone * gap(&self.predicting());
        let gaps = tied.take(most_refused).map(fitted).map(|fit| (gap(&fit), fit)).filter(|(gap, _)| *gap < least);
        let Some((_, next)) = gaps.min_by(|a, b| a.0.total_cmp(&b.0)) else { return self };
        let next = problem.settled(&next);
        self.give_way(next, Refusal::Outdone);
        self
    }

    /// Returns whether the explanation of an imperfect simulation leaves most of the gap of the held-out records, and
    /// these are no louder than the fitted ones.
    pub(crate) fn fails_later(&self) -> bool {
        let held_out = &self.ready.held_out;
        let settings = &self.ready.problem.settings;
        let loudest = self.ready.problem.records.iter().map(Record::level).fold(0.0, f64::max);
        self.ready.widened.is_some()
            && !held_out.is_empty()
            && held_out.iter().all(|record| record.level() < settings.case.same_level * loudest)
            && self.opened_left(&self.predicting()) > settings.judge.most_left
    }

    /// Returns the remaining amplitude of the opened records beyond the noise with a fit, over that with the
    /// simulation within its limits.
    fn opened_left(&self, fit: &Fit) -> f64 {
        let floor = floor(self, &self.ready.noise.rms());
        let beyond = |gap: f64| (gap * gap - floor * floor).max(0.0).sqrt();
        let within = self.refitted.within_limits(&self.ready.problem);
        beyond(self.opened_gap(&fit.eta, &fit.effects)) / beyond(self.opened_gap(&within, &[])).max(f64::MIN_POSITIVE)
    }

    /// Replaces the explanation by the one of these fits that predicts the held-out records best, if that fit leaves
    /// less than half of their gap. Explanations with a lower price are refuted together with the present one.
    pub(crate) fn or_later(mut self, fits: Vec<(Fit<'a>, Candidate<'a>)>) -> Self {
        let left = fits.into_iter().map(|(fit, candidate)| (self.opened_left(&fit), fit, candidate));
        let Some((left, fit, candidate)) = left.min_by(|a, b| a.0.total_cmp(&b.0)) else { return self };
        let settings = &self.ready.problem.settings.judge;
        if left > settings.most_left {
            return self;
        }
        self.judged.left = left * left;
        self.judged.unknown = outside(left, settings);
        self.unpredicted = None;
        self.found.candidates.retain(|other| other.effects.is_empty() || other.priced > candidate.priced);
        self.found.candidates.insert(0, candidate);
        let fit = self.ready.problem.settled(&fit);
        self.give_way(fit, Refusal::Untimely);
        self
    }

    /// Replaces the explanation by the next one that predicts the held-out records better, if the explanation
    /// predicts them worse than no effect does. If there is no such explanation, the present one is kept, but it is
    /// not written into the simulation. If the explanation leaves only noise, it is replaced only if it predicts the
    /// held-out records much worse: its law may be wrong where they are louder.
    pub(crate) fn refuse_overfit(mut self) -> Self {
        if self.ready.held_out.is_empty() || self.unpredicted.is_some() || self.fit().effects.is_empty() {
            return self;
        }
        let Some(next) = self.predictive() else { return self };
        let left = left(&self.ready, &self.refitted, &next, &self.ready.noise.rms());
        self.judged.left = left * left;
        self.judged.unknown = outside(left, &self.ready.problem.settings.judge);
        self.give_way(next, Refusal::Overfits);
        self
    }

    /// Replaces the explanation by another one.
    fn give_way(&mut self, next: Fit<'a>, why: Refusal) {
        self.free_shape = None;
        self.offsets.clear();
        let refused = std::mem::replace(&mut self.found.best, next).effects;
        if refused.is_empty() {
            return;
        }
        let candidates = &mut self.found.candidates;
        candidates.retain(|candidate| !all_same(&candidate.effects, &refused));
        put_first(candidates, &self.found.best.effects, &why);
        self.refused.push((refused, why));
    }

    /// Returns the first of the further explanations that predicts the held-out records better than no effect does;
    /// `None` if the best one already does, or if no other does.
    fn predictive(&self) -> Option<Fit<'a>> {
        let problem = &self.ready.problem;
        let JudgeSettings { no_worse, most_refused, outdone, .. } = problem.settings.judge;
        let fails = if self.ready.widened.is_some() { no_worse } else { 1.0 / outdone };
        let given = blocks(&opened(self), self.ready.as_given(), &[]).gap();
        let without = given.min(self.opened_gap(&self.refitted.eta, &[]));
        let predicts = |fit: &Fit, limit: f64| self.opened_gap(&fit.eta, &fit.effects) <= limit * without;
        if predicts(&self.predicting(), fails) {
            return None;
        }
        let further = self.found.candidates.iter().filter(|candidate| {
            let other = !candidate.effects.is_empty() && !all_same(&candidate.effects, &self.found.best.effects);
            other && candidate.priced < self.refitted.cost
        });
        let fitted = |c: &Candidate<'a>| polish(problem, Fit { effects: c.effects.clone(), ..self.refitted.as_fit() });
        let next = further.take(most_refused).map(fitted).find(|fit| predicts(fit, no_worse));
        next.map(|fit| problem.settled(&fit))
    }

    /// Replaces the explanation by the refit, and removes all that rank before the explanation without effects.
    pub(super) fn retreat(&mut self, why: Refusal) {
        let without = self.refitted.as_fit();
        self.free_shape = None;
        self.offsets.clear();
        self.found.candidates.retain(|candidate| candidate.effects.is_empty() || candidate.priced >= without.cost);
        let refused = std::mem::replace(&mut self.found.best, without).effects;
        self.refused.push((refused, why));
    }

    pub(crate) fn price(&self) -> f64 {
        self.found.candidates.first().map_or(f64::INFINITY, |candidate| candidate.priced)
    }
}

/// Returns the remaining amplitude of the fitted records beyond the noise with a fit, over that with the simulation
/// within its limits. `noise` is the RMS of each output's noise.
pub(crate) fn left(ready: &Prepared, refitted: &Refit, fit: &Fit, noise: &[f64]) -> f64 {
    let problem = &ready.problem;
    let within = refitted.within_limits(problem);
    let beyond = |eta: &[f64], effects: &[Placed]| {
        let driven = problem.records.iter().filter(|record| record.is_driven());
        let measured: Vec<&[Vec<f64>]> = driven.map(|record| record.y.as_slice()).collect();
        let floor = gap::floor_over(noise, &measured);
        let gap = gap::of_driven(&problem.records, &outputs(problem, eta, effects));
        (gap * gap - floor * floor).max(0.0).sqrt()
    };
    beyond(&fit.eta, &fit.effects) / beyond(&within, &[]).max(f64::MIN_POSITIVE)
}

/// Gives an explanation that took the place of a refused one the first rank.
fn put_first(candidates: &mut Vec<Candidate>, effects: &[Placed], why: &Refusal) {
    match candidates.iter().position(|candidate| all_same(&candidate.effects, effects)) {
        // It fits as well as those before it, and predicts better.
        Some(rank) if *why == Refusal::Outdone => candidates[..=rank].rotate_right(1),
        // Those before it predict no better than the refused one.
        Some(rank) => {
            let confirmed = candidates.split_off(rank);
            candidates.retain(|candidate| candidate.effects.is_empty());
            candidates.extend(confirmed);
        }
        None => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::{Library, Place};
    use crate::testing::laws::at;

    /// What held-out records have refuted does not rank before the explanation that they confirm.
    #[test]
    fn the_explanation_that_takes_over_ranks_first() {
        let library = Library::standard();
        let one = |output: usize| at(&library, "sensor-gain", Place::Output(output), vec![1.1]);
        let explanations = [vec![one(0)], Vec::new(), vec![one(1)], vec![one(2)]];
        let priced = [1.0, 2.0, 3.0, 4.0];
        let all = explanations.into_iter().zip(priced);
        let all: Vec<Candidate> = all.map(|(effects, priced)| Candidate { effects, cost: priced, priced }).collect();
        for (why, prices) in [(Refusal::Overfits, vec![2.0, 3.0, 4.0]), (Refusal::Outdone, vec![3.0, 1.0, 2.0, 4.0])] {
            let mut candidates = all.clone();
            put_first(&mut candidates, &[one(1)], &why);
            assert_eq!(candidates.iter().map(|candidate| candidate.priced).collect::<Vec<_>>(), prices, "{why:?}");
        }
    }
}
