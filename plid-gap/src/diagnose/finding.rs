//! The answer of a diagnosis, from an explanation that was judged.

use plid_model::Model;

use crate::answer::calibrated::calibrated;
use crate::answer::schema::{Diagnosis, Explanation, Located, NamedEffect, Remainder, SimulationWithEffects};
use crate::answer::sentence::{Said, remains, sentence};
use crate::answer::shape::shapes;
use crate::answer::simulation::written;
use crate::answer::whole_delay::WholeDelay;
use crate::answer::words::{smaller, words};
use crate::answer::{classes, comparisons, named, others, place, remainder};
use crate::audit::Audit;
use crate::case::record::Record;
use crate::effects::{Names, Observation};
use crate::evidence::Evidence;
use crate::fit::candidate::{in_words, same};
use crate::fit::free_run::{errors, run};
use crate::fit::problem::Placed;
use crate::judge::calibration::Calibration;
use crate::judge::explained::Explained;
use crate::judge::judgement::Judgement;
use crate::judge::locate::{self, Map};
use crate::judge::next_experiment::next_experiment;
use crate::judge::separability::{Predicted, Rival, rivals};
use crate::judge::settle_all::with_all;
use crate::judge::side::places;
use crate::judge::statement::{About, Statement, basis};
use crate::judge::statistics::{self, Statistics};
use crate::judge::stochastic_gap::of_dropped;
use crate::judge::verdict::{Verdict, Weighted};
use crate::judge::written::Follows;
use crate::search::rules::Rules;
use crate::search::stochastic::{Stochastic, wandering};
use crate::settings::GapSettings;

/// An explanation, its judgement and its evidence.
pub(super) struct Finding<'f, 'a> {
    pub(super) audit: &'f Audit,
    pub(super) explained: &'f Explained<'a>,
    pub(super) stochastic: &'f [Stochastic<'a>],
    pub(super) judged: Judgement<'f, 'a>,
    delay: Option<WholeDelay>,
    /// The maps of the gap, as given and with the effects.
    pub(super) maps: [Map; 2],
    pub(super) evidence: Evidence,
}

impl<'f, 'a> Finding<'f, 'a> {
    /// Judges an explanation. `stochastic` are the stochastic effects that were found.
    pub(super) fn new(
        audit: &'f Audit,
        explained: &'f Explained<'a>,
        stochastic: &'f [Stochastic<'a>],
        rules: &Rules,
        say: &mut dyn FnMut(String),
    ) -> Self {
        let Explained { ready, refitted, .. } = explained;
        let problem = &ready.problem;
        say("gaps".into());
        let judged = Judgement::new(explained, stochastic, rules, &audit.case.config);
        let (rate, settings) = (judged.plant.rate, &problem.settings);
        let map = |errors: &[_]| locate::map(&problem.records, errors, &ready.noise, rate, settings);
        let after = errors(problem, &explained.fit().eta, &explained.predicting().effects);
        let maps = [map(&locate::errors(ready, &refitted.eta)), map(&after)];
        say("collecting supporting evidence".into());
        let linear = |record: &Record| run(&judged.plant, &[], record);
        let with = |record: &Record| run(&judged.plant, &judged.actions, record);
        let evidence = Evidence::of(problem, &refitted.plant, &ready.noise, &audit.case.records, linear, with);
        Self { audit, explained, stochastic, judged, delay: WholeDelay::of(audit), maps, evidence }
    }

    /// Returns the contents of diagnosis.json. `motion` states the kinds of the outputs and the locations of forces.
    pub(super) fn diagnosis(&self, motion: Vec<String>, say: &mut dyn FnMut(String)) -> Diagnosis {
        let Explained { ready, found, .. } = self.explained;
        let Judgement { gaps, shown, weighted, verdict, .. } = &self.judged;
        let (names, best) = (&ready.problem.setting.names, &found.best.effects);
        let [before, _] = &self.maps;
        say("compared with its rivals".into());
        // If nothing is missing, there are no explanations to distinguish.
        let predicted = (*verdict != Verdict::None).then(|| Predicted::new(&ready.problem, self.explained.fit()));
        let rivals = predicted.as_ref().map_or_else(Vec::new, |predicted| rivals(predicted, best, &found.candidates));
        let mut effects = self.named();
        let mut statements = self.statements(&effects);
        let statistics = self.statistics(&effects, &rivals);
        let candidates = self.candidates(&effects);
        let mut candidates = joined(calibrated(candidates, &mut effects, &statements, Calibration::used()));
        let sentence = self.sentence(&effects, &rivals);
        if *verdict != Verdict::Effects {
            effects.clear();
        }
        let shapes = shapes(self.explained, &effects);
        // A delay that the audit removed is named, unless the verdict is something outside the vocabulary.
        let delay = self.delay.as_ref().filter(|_| *verdict != Verdict::Unknown);
        self.delay.iter().for_each(|delay| delay.explains(&mut candidates));
        delay.into_iter().for_each(|delay| delay.named(&mut effects, &candidates));
        say("next experiment".into());
        let next = predicted
            .as_ref()
            .and_then(|predicted| next_experiment(self.explained, weighted, best, predicted, &rivals));
        let class = others(self.explained, &rivals).map(|others| (in_words(best, names), others));
        let evidence = words(self.explained, before, &self.judged, &self.evidence, motion, (&effects, class));
        let (remainder, about_remainder) = self.remains();
        statements.push(about_remainder);
        Diagnosis {
            verdict: if delay.is_some() { Verdict::Effects } else { *verdict },
            sentence,
            simulator: None,
            next_experiment: next,
            effects,
            candidates,
            not_separable: classes(self.explained, &rivals),
            separability: comparisons(found, best, &rivals, names),
            statements,
            shapes,
            statistics,
            place: place(
                before,
                &names.outputs,
                &places(ready, &self.audit.known, self.explained.level.factor.min(1.0)),
                shown,
                (&ready.problem.settings.judge, &ready.problem.settings.answer),
            ),
            remainder,
            evidence,
            gap: gaps.clone(),
            settings: GapSettings::clone(&ready.problem.settings),
            warnings: self.audit.case.warnings.clone(),
        }
    }

    /// Returns the effects with their parameters, the one that causes the largest gap first. The largest effect is
    /// always named. Further effects are named only if they close a noticeable share of the gap and, in an imperfect
    /// simulation, if they are more likely to act than not and cause a material gap. The others remain in the
    /// prediction.
    fn named(&self) -> Vec<NamedEffect> {
        let Judgement { gaps, shares, shown, squared_gaps, weighted, .. } = &self.judged;
        let best = &self.explained.found.best.effects;
        let near_line = self.explained.ready.problem.settings.prepare.near_line;
        let mut named = named((self.explained, &self.audit.known.limits), shown, weighted, shares, gaps.left());
        for which in self.stochastic.iter().filter_map(|u| wandering(&u.placed, best, near_line)) {
            named[which].shape_differs = true;
        }
        // The size of a stochastic effect is the squared gap of its noise.
        let sizes: Vec<f64> = shares.iter().map(|share| share.made).chain(squared_gaps.iter().copied()).collect();
        let mut order: Vec<usize> = (0..named.len()).collect();
        order.sort_by(|&a, &b| sizes[b].total_cmp(&sizes[a]));
        let mut sorted: Vec<(NamedEffect, f64)> = order.into_iter().map(|k| (named[k].clone(), sizes[k])).collect();
        let judge = &self.explained.ready.problem.settings.judge;
        let imperfect = self.explained.ready.widened.is_some();
        let material = self.audit.case.config.material.powi(2);
        let stands = |(effect, size): &(NamedEffect, f64)| {
            effect.share.is_none_or(|share| share >= judge.least_share)
                && (!imperfect || effect.confidence >= judge.least_confidence && *size >= material)
        };
        let mut first = true;
        sorted.retain(|sized| std::mem::take(&mut first) || stands(sized));
        sorted.into_iter().map(|(effect, _)| effect).collect()
    }

    /// Returns the statements of the answer, that of the verdict first.
    fn statements(&self, named: &[NamedEffect]) -> Vec<Statement> {
        let Judgement { verdict, before, .. } = &self.judged;
        let whole = basis(self.explained);
        let about = match verdict {
            Verdict::Effects => None,
            Verdict::None => Some(About::Nothing),
            Verdict::Unknown => Some(About::Unknown),
        };
        if let Some(about) = about {
            return vec![Statement { about, before: *before, basis: whole }];
        }
        let of = |(at, effect): (usize, &NamedEffect)| {
            let about = if at == 0 { About::Effect } else { About::Further };
            Statement { about, before: effect.confidence, basis: whole.clone() }
        };
        named.iter().enumerate().map(of).collect()
    }

    /// Returns the remainder, with a calibrated probability of a further cause, and the statement about it.
    fn remains(&self) -> (Remainder, Statement) {
        let Judgement { gaps, simulated, .. } = &self.judged;
        let (after, material) = (&self.maps[1], self.audit.case.config.material);
        let mut remains = remainder(self.explained, gaps, (after, simulated), self.evidence.repeats, material);
        let before = remains.further_cause;
        let statement = Statement { about: About::Remainder, before, basis: basis(self.explained) };
        remains.further_cause = Calibration::used().probability(&statement);
        (remains, statement)
    }

    /// Returns the statistics of the explanation, whose first effect is the first of `named`. Stochastic effects leave
    /// no trace in free runs, to which the statistics refer.
    fn statistics(&self, named: &[NamedEffect], rivals: &[Rival]) -> Option<Statistics> {
        let (explained, names) = (self.explained, &self.explained.ready.problem.setting.names);
        let NamedEffect { effect, location, confidence, share, .. } = named.first()?;
        let is = |placed: &&Placed| placed.effect.name() == effect && placed.place.location(names) == *location;
        let first = explained.found.best.effects.iter().find(is).filter(|_| self.judged.verdict != Verdict::None)?;
        let mut values = statistics::values(explained, &self.judged, rivals, first);
        values.insert(statistics::CONFIDENCE.into(), *confidence);
        values.extend(share.map(|share| ("share".into(), share)));
        Some(Statistics { effect: effect.clone(), location: location.clone(), values })
    }

    /// Returns all explanations with their probabilities. In an imperfect simulation, small effects of the best
    /// explanation that are not named are left out, and explanations that differ only in them are joined.
    fn candidates(&self, named: &[NamedEffect]) -> Vec<Explanation> {
        let Explained { ready, found, level, .. } = self.explained;
        let Judgement { gaps, shown, weighted, .. } = &self.judged;
        let names = &ready.problem.setting.names;
        let factor = level.factor.min(1.0);
        let located = |p: &Placed| Located { effect: p.effect.name().into(), location: p.place.location(names) };
        let is_named =
            |at: &Located| named.iter().any(|named| named.effect == at.effect && named.location == at.location);
        let all = found.best.effects.iter().chain(shown.iter().map(|shown| &shown.placed));
        let small: Vec<&Placed> = all.filter(|p| ready.widened.is_some() && !is_named(&located(p))).collect();
        let counts = |placed: &&Placed| !small.iter().any(|small| same(small, placed));
        // An explanation by small effects alone keeps them, because an explanation without effects would state that
        // nothing is missing.
        let effects = |w: &Weighted| -> Vec<Located> {
            let large: Vec<Located> = w.effects.iter().filter(counts).map(located).collect();
            if large.is_empty() { w.effects.iter().map(located).collect() } else { large }
        };
        let explanation = |w: &Weighted| Explanation {
            effects: effects(w),
            unknown: w.unknown,
            probability: w.probability,
            gap_after: w.cost.map(|cost| gaps.noise_floor * (cost / factor).max(0.0).sqrt()),
            wiring: None,
        };
        joined(weighted.iter().map(explanation).collect())
    }

    /// Returns the answer in a few sentences.
    fn sentence(&self, effects: &[NamedEffect], rivals: &[Rival]) -> String {
        let Explained { ready, found, level, .. } = self.explained;
        let Judgement { gaps, shown, squared_gaps, verdict, lacking, .. } = &self.judged;
        let (names, best) = (&ready.problem.setting.names, &found.best.effects);
        let nearest: Vec<String> = best.iter().map(|placed| in_words(std::slice::from_ref(placed), names)).collect();
        let dropped = of_dropped(shown, squared_gaps);
        let beyond = (gaps.beyond_noise(gaps.with_effect).powi(2) - dropped).max(0.0).sqrt();
        let settings = &ready.problem.settings.answer;
        let remains = |_| remains(&self.maps[1], &names.outputs, beyond, gaps.as_given, settings);
        let remains = ready.widened.map(remains);
        let observed: Vec<Observation> = effects.iter().map(|effect| observed(effect, shown, names)).collect();
        let said = Said {
            effects,
            observed: &observed,
            nearest: &nearest,
            smaller: smaller(self.explained, effects).len(),
            gap: gaps,
            material: self.audit.case.config.material,
            noise_alone: (best.is_empty() && ready.widened.is_some()).then(|| squared_gaps.iter().sum::<f64>().sqrt()),
            lacking: *lacking,
            seen: level.seen || self.explained.unpredicted.is_some(),
            remains: remains.as_deref(),
            settings,
        };
        let mut text = sentence(*verdict, &said);
        if let (Verdict::Effects, Some(others)) = (verdict, others(self.explained, rivals)) {
            text += &format!(" These records cannot distinguish {} from {others}.", in_words(best, names));
        }
        match self.audit.put_right() {
            Some(mismatch) => format!("{} {text}", mismatch.sentence),
            None => text,
        }
    }

    /// Returns the contents of sim-with-effect.json. The models are that of the audited case and the simulation as
    /// given.
    pub(super) fn simulation(&self, models: (&Model, &Model)) -> SimulationWithEffects {
        let (eta, effects) = self.predicting();
        let intersample = self.audit.intersample();
        let mut simulation =
            written(self.explained, models, intersample, &eta, &effects, &self.judged.shown, &self.judged.gaps);
        self.delay.iter().for_each(|delay| delay.simulated(&mut simulation.effects));
        simulation
    }

    /// Returns the linear parameters and the effects of the simulation that is written. Both are fitted to all records
    /// after all statements have been made.
    fn predicting(&self) -> (Vec<f64>, Vec<Placed<'a>>) {
        let fit = self.explained.predicting();
        match self.judged.follows {
            Follows::AsGiven => (vec![0.0; fit.eta.len()], Vec::new()),
            Follows::Refit => (self.explained.refitted.eta.clone(), Vec::new()),
            Follows::Effects => with_all(&self.explained.ready, &fit).unwrap_or((fit.eta, fit.effects)),
        }
    }
}

/// Returns the kind of observation in which a named effect appears. `shown` are the stochastic effects of the answer.
fn observed(named: &NamedEffect, shown: &[&Stochastic], names: &Names) -> Observation {
    let is = |placed: &Placed| placed.effect.name() == named.effect && placed.place.location(names) == named.location;
    let found = shown.iter().find(|stochastic| is(&stochastic.placed));
    found.map_or(Observation::FreeRun, |stochastic| stochastic.placed.effect.observed_in())
}

/// Joins explanations with the same effects, whose probabilities add up.
fn joined(explanations: Vec<Explanation>) -> Vec<Explanation> {
    let is_part = |a: &Explanation, b: &Explanation| a.effects.iter().all(|effect| b.effects.contains(effect));
    let mut joined: Vec<Explanation> = Vec::new();
    for next in explanations {
        let equal = |one: &&mut Explanation| one.unknown == next.unknown && is_part(one, &next) && is_part(&next, one);
        match joined.iter_mut().find(equal) {
            Some(one) => one.probability += next.probability,
            None => joined.push(next),
        }
    }
    joined.sort_by(|a, b| b.probability.total_cmp(&a.probability));
    joined
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::{Library, Place};
    use crate::testing;

    /// The offset is slightly larger in the held-out record. What is stated is the fit without this record, and what
    /// is written is the fit with it.
    #[test]
    fn what_is_written_is_fitted_to_all_records() {
        let sim = testing::truss(1);
        let mut case = testing::case(&sim, &sim);
        let size = crate::case::record::rms(&case.records[1].y[0]);
        for record in &mut case.records {
            let share = if record.name == "random-3" { 0.104 } else { 0.1 };
            record.y[0].iter_mut().for_each(|y| *y += share * size);
        }
        testing::only(&mut case, &["sensor-offset"]);
        let outcome = crate::diagnose(&case, &Library::standard(), &mut |_| {}).unwrap();
        let stated = outcome.diagnosis.effects[0].parameters["o"].value / size;
        let written = outcome.simulation.effects[0].parameters["o"].value / size;
        assert!((stated - 0.1).abs() < 3e-4, "{stated}");
        assert!((0.1008..0.1032).contains(&written), "{written} instead of {stated}");
    }

    #[test]
    fn an_effect_appears_where_it_was_found_at_its_own_place() {
        let library = Library::standard();
        let effect = library.get("sensor-noise").unwrap();
        let placed = Placed { effect, place: Place::Output(0), parameters: vec![1.0] };
        let stochastic = Stochastic { placed, std: vec![0.1], gain: 100.0 };
        let names = Names { outputs: vec!["y1".into(), "y2".into()], ..Names::default() };
        let at = |location: &str| NamedEffect {
            effect: "sensor-noise".into(),
            location: location.into(),
            confidence: 0.9,
            family: None,
            share: None,
            share_ci95: None,
            parameters: Default::default(),
            change: None,
            shape_differs: false,
        };
        let of = |location: &str| observed(&at(location), &[&stochastic], &names);
        assert_eq!([of("output:y1"), of("output:y2")], [Observation::SensorNoise, Observation::FreeRun]);
    }

    #[test]
    fn explanations_with_the_same_effects_are_one() {
        let explanation = |effects: &[&str], unknown: bool, probability: f64| Explanation {
            effects: effects.iter().map(|e| Located { effect: (*e).into(), location: "input:u1".into() }).collect(),
            unknown,
            probability,
            gap_after: None,
            wiring: None,
        };
        let all = [
            explanation(&["actuator-lag"], false, 0.4),
            explanation(&["actuator-gain", "actuator-lag"], false, 0.25),
            explanation(&[], true, 0.15),
            explanation(&["actuator-lag", "actuator-gain"], false, 0.2),
        ];
        let joined = joined(all.to_vec());
        let sizes: Vec<usize> = joined.iter().map(|explanation| explanation.effects.len()).collect();
        assert_eq!(sizes, [2, 1, 0]);
        assert!((joined[0].probability - 0.45).abs() < 1e-12);
        assert!(joined[2].unknown);
    }
}
