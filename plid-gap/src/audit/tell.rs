//! A mismatch in the answer: first in the sentence; and a delay of all channels, which the vocabulary has, among the effects.

use std::collections::BTreeMap;

use super::Audit;
use crate::answer::schema::{Located, NamedEffect, Value, WrittenEffect};
use crate::diagnose::Outcome;
use crate::effects::{ActuatorDelay, Effect};
use crate::judge::verdict::Verdict;

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
            None => diagnosis.effects.insert(
                0,
                NamedEffect {
                    effect,
                    location,
                    confidence: known,
                    parameters,
                    share: None,
                    share_ci95: None,
                    change: None,
                    shape_differs: false,
                },
            ),
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::answer::predict::Predictor;
    use crate::case::Case;
    use crate::diagnose::{Outcome, diagnose};
    use crate::effects::Library;
    use crate::judge::gap::Blocks;
    use crate::judge::verdict::Verdict;
    use crate::testing::{case, random_input, run, truss};

    /// A diagnosis that knows one effect only: what the audit says does not depend on the others.
    fn diagnosed(case: &Case) -> Outcome {
        let all = Library::standard();
        let names: Vec<String> = all.effects().map(|e| e.name().to_string()).filter(|n| n != "sensor-gain").collect();
        diagnose(case, &all.without(&names), &mut |_| {}).unwrap()
    }

    /// Gap of what sim-with-effect.json predicts for a new input, against these outputs.
    fn predicted_gap(outcome: &Outcome, u: &[Vec<f64>], y: &[Vec<f64>]) -> f64 {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("sim-with-effect.json");
        std::fs::write(&path, serde_json::to_string(&outcome.simulation).unwrap()).unwrap();
        let predictor = Predictor::read(&path, &Library::standard()).unwrap();
        Blocks::new(y, &predictor.run(u, predictor.t0), 0).gap()
    }

    #[test]
    fn swapped_outputs_come_first_and_are_put_right() {
        let mut case = case(&truss(1), &truss(1));
        case.records.iter_mut().for_each(|record| record.y.swap(0, 1));
        let outcome = diagnosed(&case);
        let diagnosis = &outcome.diagnosis;
        assert!(diagnosis.sentence.starts_with("Outputs y1 and y2 look swapped: "), "{}", diagnosis.sentence);
        assert_eq!((diagnosis.verdict, diagnosis.effects.len()), (Verdict::None, 0));
        let u = random_input(50, 1024, 2);
        let mut y = run(&truss(1), &u);
        y.swap(0, 1);
        assert!(predicted_gap(&outcome, &u, &y) < 0.01);
    }

    #[test]
    fn a_delay_of_all_channels_is_an_effect() {
        let late = |y: &mut Vec<f64>| {
            y.splice(0..0, [0.0; 40]);
            y.truncate(y.len() - 40);
        };
        let mut case = case(&truss(1), &truss(1));
        case.records.iter_mut().flat_map(|record| &mut record.y).for_each(late);
        let outcome = diagnosed(&case);
        let diagnosis = &outcome.diagnosis;
        assert!(diagnosis.sentence.starts_with("All channels look delayed by 40 samples"), "{}", diagnosis.sentence);
        assert_eq!(diagnosis.verdict, Verdict::Effects);
        let named = &diagnosis.effects[0];
        assert_eq!((named.effect.as_str(), named.location.as_str()), ("actuator-delay", "input:all"));
        assert_eq!(named.parameters["tau"].value, 40.0);
        assert_eq!(diagnosis.candidates[0].effects[0].effect, "actuator-delay");
        let u = random_input(50, 1024, 2);
        let mut y = run(&truss(1), &u);
        y.iter_mut().for_each(late);
        assert!(predicted_gap(&outcome, &u, &y) < 0.01);
    }
}
