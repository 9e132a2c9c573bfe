//! A mismatch in the answer: first in the sentence; and a delay of all channels, which the vocabulary has, among the effects.

use std::collections::BTreeMap;

use super::Audit;
use crate::diagnose::Outcome;
use crate::diagnosis::{Located, NamedEffect, Value, WrittenEffect};
use crate::effects::{ActuatorDelay, Effect};
use crate::verdict::Verdict;

impl Audit {
    /// Puts what the audit explained into an answer that was made with it put right.
    pub fn tell(&self, outcome: &mut Outcome) {
        let Some(mismatch) = self.mismatch.as_ref().filter(|mismatch| mismatch.explains) else { return };
        let diagnosis = &mut outcome.diagnosis;
        diagnosis.sentence = format!("{} {}", mismatch.sentence, diagnosis.sentence);
        let delay = mismatch.wiring.delay;
        if delay < 0 {
            let words = format!("A prediction cannot answer before its input: it comes {} samples late.", -delay);
            diagnosis.warnings.push(words);
        }
        if delay <= 0 {
            return;
        }
        let inputs = &self.case.config.inputs;
        let location = if let [only] = inputs.as_slice() { format!("input:{only}") } else { "input:all".to_string() };
        let effect = ActuatorDelay.name().to_string();
        let value = Value { value: delay as f64, ci95: None, unit: "samples".into() };
        let parameters = BTreeMap::from([("tau".to_string(), value)]);
        let here = |name: &str, at: &str| name == effect && at == location;
        // What was fitted of it is what the whole samples leave.
        let add = |parameters: &mut BTreeMap<String, Value>| {
            if let Some(tau) = parameters.get_mut("tau") {
                tau.value += delay as f64;
                tau.ci95 = tau.ci95.map(|ci| ci.map(|x| x + delay as f64));
            }
        };
        if let Some(found) = outcome.simulation.effects.iter_mut().find(|e| here(&e.effect, &e.location)) {
            add(&mut found.parameters);
        } else {
            outcome.simulation.effects.insert(
                0,
                WrittenEffect {
                    effect: effect.clone(),
                    location: location.clone(),
                    parameters: parameters.clone(),
                    given: BTreeMap::new(),
                    equation: ActuatorDelay.equation().into(),
                },
            );
        }
        for candidate in diagnosis.candidates.iter_mut().filter(|candidate| !candidate.unknown) {
            if !candidate.effects.iter().any(|e| here(&e.effect, &e.location)) {
                candidate.effects.insert(0, Located { effect: effect.clone(), location: location.clone() });
            }
        }
        if diagnosis.verdict == Verdict::Unknown {
            return;
        }
        diagnosis.verdict = Verdict::Effects;
        let known: f64 = diagnosis.candidates.iter().filter(|c| !c.unknown).map(|c| c.probability).sum();
        match diagnosis.effects.iter_mut().find(|e| here(&e.effect, &e.location)) {
            Some(found) => add(&mut found.parameters),
            None => diagnosis
                .effects
                .insert(0, NamedEffect { effect, location, confidence: known, parameters, shape_differs: false }),
        }
    }
}
