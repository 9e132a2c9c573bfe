//! The whole diagnosis, step by step.

pub(crate) mod explain;
mod finding;
mod law;
mod shown;
mod wiring;

use std::cell::OnceCell;

use crate::answer::motion;
use crate::answer::schema::{Diagnosis, Explanation, NamedEffect, SimulationWithEffects};
use crate::audit::{Audit, Law, audit};
use crate::case::Case;
use crate::diagnose::explain::explain;
use crate::diagnose::finding::Finding;
use crate::diagnose::law::law;
use crate::effects::{Library, Observation};
use crate::error::GapError;
use crate::fit::refit::{self, Refit, refit};
use crate::prepare::{Prepared, prepare};
use crate::search::rules::{Rules, require_names};
use crate::search::stage::SearchStage;
use crate::settings::step::Step;

pub use shown::Shown;

/// The result of a diagnosis: the answer, the simulation for predictions, and the data of the report.
pub struct Outcome {
    /// The contents of diagnosis.json.
    pub diagnosis: Diagnosis,
    /// The contents of sim-with-effect.json.
    pub simulation: SimulationWithEffects,
    /// The data of the report.
    pub shown: Shown,
}

/// Diagnoses a case. `say` is called with each step.
///
/// # Errors
/// Returns a [`GapError`] if a step fails.
pub fn diagnose(case: &Case, library: &Library, say: &mut dyn FnMut(String)) -> Result<Outcome, GapError> {
    diagnose_without(case, library, &[], say)
}

/// Diagnoses a case with some steps switched off, to measure their contribution.
///
/// # Errors
/// Returns a [`GapError`] if a step fails.
pub fn diagnose_without(
    case: &Case,
    library: &Library,
    off: &[Step],
    say: &mut dyn FnMut(String),
) -> Result<Outcome, GapError> {
    Ok(Groundwork::whole(case, library, off, say)?.0)
}

/// The part of a diagnosis that does not depend on the effects of the library: the audit, the preparation and the
/// bounded refit. In addition, it contains the first stage of the search, from which a diagnosis with fewer effects
/// removes the entries of the others.
pub struct Groundwork<'a> {
    case: &'a Case,
    library: &'a Library,
    audit: Audit,
    ready: Prepared,
    refitted: Refit,
    first: OnceCell<SearchStage<'a>>,
    /// The law with whose force the model was identified, if there is one.
    law: Option<Law>,
    /// Effects of the library that were not part of the answer that found this law.
    left_out: Vec<String>,
}

impl<'a> Groundwork<'a> {
    fn new(case: &'a Case, library: &'a Library, audit: Audit, say: &mut dyn FnMut(String)) -> Result<Self, GapError> {
        say("preparing".into());
        let mut ready = prepare(model(&audit)?, &audit.case.records, &audit.known)?;
        require_names(&audit.case.config, library.effects(), &ready.problem.setting)?;
        say("bounded refit".into());
        let mut refitted = refit(&ready.problem, refit::STEPS);
        if ready.unround(&refitted.eta) {
            refitted = refit(&ready.problem, refit::STEPS);
        }
        ready.renew_missing(&refitted.eta);
        Ok(Self { case, library, audit, ready, refitted, first: OnceCell::new(), law: None, left_out: Vec::new() })
    }

    /// Returns the answer with the whole library, and the groundwork, which can be used again if effects are left out.
    /// The steps `off` are skipped in both.
    ///
    /// # Errors
    /// Returns a [`GapError`] if a step fails.
    pub fn whole(
        case: &'a Case,
        library: &'a Library,
        off: &[Step],
        say: &mut dyn FnMut(String),
    ) -> Result<(Outcome, Self), GapError> {
        say("audit".into());
        let audit = audit(case, library, off, say)?;
        let as_recorded = audit.as_recorded(case, library)?;
        let ground = Self::new(case, library, audit, say)?;
        let outcome = answer(&ground, &ground.audit, &[], say)?;
        let (Some(audit), Some(mismatch)) = (as_recorded, ground.audit.put_right()) else {
            return Ok((outcome, ground));
        };
        say("without the correction of the channels".into());
        let settings = &case.config.settings.audit;
        let recorded = Self::new(case, library, audit, say)?;
        let other = answer(&recorded, &recorded.audit, &[], say)?;
        let (outcome, is_real) = wiring::decided(outcome, other, &mismatch.sentence, settings);
        Ok((outcome, if is_real { ground } else { recorded }))
    }

    /// Returns the answer of a diagnosis without these effects. The answer equals that with [`Library::without`] to
    /// the last bit.
    ///
    /// # Errors
    /// Returns a [`GapError`] if a step fails.
    pub fn leave_out(&self, without: &[String], say: &mut dyn FnMut(String)) -> Result<Outcome, GapError> {
        answer(self, &self.audit.without(self.case, self.library, without)?, without, say)
    }
}

fn model(audit: &Audit) -> Result<&plid_model::Model, GapError> {
    audit.case.model.as_ref().ok_or_else(|| GapError::Failed("a case has a model once it is audited".into()))
}

/// Largest number of further models of the records that are tried.
const MOST_MODELS: usize = 3;

/// Ratio of the gap to that of the noise alone up to which no better model of the records is needed.
const NEAR_NOISE: f64 = 1.1;

/// Probability of explanations without a law beside those with it, up to which the law has no rival.
const NO_RIVAL: f64 = 0.05;

/// Completes a diagnosis with the steps that depend on the effects of the library. If the simulation is a model of the
/// records themselves, it is identified again with the forces of the laws that were found, and the diagnosis is
/// repeated with it. The repeated answer replaces the first one if it confirms the law and leaves a smaller gap. If the
/// law has no rival, the repeated diagnosis considers only the effects of the first one: the better model shows how
/// much of the gap they leave, and what it lacks itself may resemble other effects.
fn answer(
    ground: &Groundwork,
    audit: &Audit,
    without: &[String],
    say: &mut dyn FnMut(String),
) -> Result<Outcome, GapError> {
    let (mut outcome, mut law) = finish(ground, audit, without, say)?;
    for _ in 0..MOST_MODELS {
        let left = &outcome.diagnosis.gap;
        let Some(found) = law.take().filter(|_| left.with_effect > NEAR_NOISE * left.noise_floor) else { break };
        // If the records do not determine a model with the forces as further inputs, the answer is kept.
        let Ok(Some(audit)) = audit.with_law(ground.case, ground.library, without, &found) else { break };
        say(format!("repeated with a model that was identified with the force of {} as a further input", found.name));
        let Ok(again) = Groundwork::new(ground.case, ground.library, audit, say) else { break };
        let Diagnosis { candidates, effects, .. } = &outcome.diagnosis;
        let left_out = left_out(candidates, effects, &found, ground.library);
        let again = Groundwork { law: Some(found), left_out, ..again };
        let Ok((other, next)) = finish(&again, &again.audit, without, say) else { break };
        if !confirms(&other.diagnosis, &outcome.diagnosis, again.law.as_ref()) {
            break;
        }
        (outcome, law) = (other, next);
    }
    Ok(outcome)
}

/// Returns the names of the effects that are neither in a law nor `named` in the answer that found it; none if the law
/// has a rival among the explanations. Stochastic effects, which are not searched for, are never left out.
fn left_out(explanations: &[Explanation], named: &[NamedEffect], law: &Law, library: &Library) -> Vec<String> {
    let in_law = |effect: &str| law.effects.iter().any(|(law, ..)| law == effect);
    let is_rival = |explanation: &&Explanation| {
        !explanation.effects.is_empty() && !explanation.effects.iter().any(|located| in_law(&located.effect))
    };
    let rivals: f64 = explanations.iter().filter(is_rival).map(|explanation| explanation.probability).sum();
    if rivals > NO_RIVAL {
        return Vec::new();
    }
    let known = |effect: &str| in_law(effect) || named.iter().any(|named| named.effect == effect);
    let others = library.effects().filter(|effect| !effect.is_stochastic() && !known(effect.name()));
    others.map(|effect| effect.name().into()).collect()
}

/// Returns whether an answer with a model that was identified with a law confirms this law and leaves a smaller gap.
/// The law must come first, and no effect may be new, because an effect that only the new model needs is an error of
/// that model.
fn confirms(other: &Diagnosis, before: &Diagnosis, law: Option<&Law>) -> bool {
    let is_of = |named: &NamedEffect| {
        let is = |(effect, location, _): &(String, String, _)| (effect, location) == (&named.effect, &named.location);
        law.is_some_and(|law| law.effects.iter().any(is))
    };
    let known = |named: &NamedEffect| {
        is_of(named) || before.effects.iter().any(|e| (&e.effect, &e.location) == (&named.effect, &named.location))
    };
    other.effects.first().is_some_and(is_of)
        && other.effects.iter().all(known)
        && other.gap.with_effect < before.gap.with_effect.min(other.gap.as_given)
}

/// Returns the answer, and the laws in it if the simulation is a model of the records.
fn finish(
    ground: &Groundwork,
    audit: &Audit,
    without: &[String],
    say: &mut dyn FnMut(String),
) -> Result<(Outcome, Option<Law>), GapError> {
    let config = &audit.case.config;
    let all = Rules { suspects: &config.suspects, exclude: &config.exclude, without };
    let unused = [without, &ground.left_out].concat();
    let rules = Rules { without: &unused, ..all };
    let (ready, refitted) = (ground.ready.clone(), ground.refitted.clone());
    let placed = |known| law::placed(known, ground.library, &ready.problem.setting);
    let known = ground.law.as_ref().map_or_else(Vec::new, placed);
    let explained = explain(ready, refitted, ground.library, &rules, &known, &ground.first, say);
    // The noise is that of the explanation's residual, because the explanation may account for a part of the quiet
    // records.
    let skipped = audit.known.off.contains(&Step::Stochastic);
    let may_be_band = rules.may_show(ground.library, Observation::Band);
    let (explained, mut stochastic) = if skipped {
        (explained, Vec::new())
    } else {
        explained.with_noise_of_residual(ground.library, may_be_band, config.material)
    };
    stochastic.retain(|stochastic| rules.knows(stochastic.placed.effect));
    let explained = explained.leave_to_noise(&stochastic, &rules, config.material);
    let finding = Finding::new(audit, &explained, &stochastic, &rules, say);
    let motion = motion::in_words(&explained.ready.problem.setting, ground.library, &all);
    let diagnosis = finding.diagnosis(motion, say);
    let given = ground.case.model.as_ref().or(audit.surrogate_model());
    let simulation = finding.simulation((model(audit)?, given.map_or_else(|| model(audit), Ok)?));
    let law = if audit.is_of_records(ground.case) { law(&explained) } else { None };
    Ok((Outcome { diagnosis, simulation, shown: finding.shown() }, law))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::answer::schema::Located;

    /// If a law has no rival, the repeated diagnosis knows only its effects and those of noise.
    #[test]
    fn a_rival_keeps_all_effects() {
        let library = Library::standard();
        let law =
            Law { name: String::new(), effects: vec![("cubic-stiffness".into(), "a".into(), vec![])], forces: vec![] };
        let with = |effect: &str, probability: f64| {
            let effects = vec![Located { effect: effect.into(), location: "a".into() }];
            Explanation { effects, unknown: false, probability, gap_after: None, wiring: None }
        };
        let left = |rival: f64| {
            let explanations = [with("cubic-stiffness", 0.9), with("clearance", rival)];
            left_out(&explanations, &[], &law, &library)
        };
        assert!(left(0.06).is_empty());
        let known: Vec<&str> = (library.effects().map(|effect| effect.name()))
            .filter(|name| !left(0.04).iter().any(|left| left == name))
            .collect();
        assert!(known.contains(&"cubic-stiffness") && known.contains(&"sensor-noise"), "{known:?}");
        assert!(library.effects().filter(|effect| known.contains(&effect.name())).count() < 10);
    }
}
