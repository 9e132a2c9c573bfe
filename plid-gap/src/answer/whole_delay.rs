//! A delay of all channels by whole samples. The audit finds it before anything is fitted and removes it from the
//! records. It is an effect of the vocabulary, so the answer names it.

use std::collections::BTreeMap;

use crate::answer::schema::{Explanation, Located, NamedEffect, Value, WrittenEffect};
use crate::audit::Audit;
use crate::effects::{ActuatorDelay, Effect};

/// A delay by whole samples. If the same effect was also fitted, its delay is the remaining part, and the two delays
/// are added.
pub(crate) struct WholeDelay {
    samples: f64,
    location: String,
}

impl WholeDelay {
    /// Returns the delay that an audit removed, if there is one.
    pub(crate) fn of(audit: &Audit) -> Option<Self> {
        let delay = audit.put_right()?.wiring.delay;
        let location = match audit.case.config.inputs.as_slice() {
            [only] => format!("input:{only}"),
            _ => "input:all".into(),
        };
        (delay > 0).then_some(Self { samples: delay as f64, location })
    }

    fn is(&self, effect: &str, location: &str) -> bool {
        effect == ActuatorDelay.name() && location == self.location
    }

    fn parameters(&self) -> BTreeMap<String, Value> {
        let value = Value { value: self.samples, ci95: None, unit: "samples".into() };
        BTreeMap::from([("tau".to_string(), value)])
    }

    fn add_to(&self, parameters: &mut BTreeMap<String, Value>) {
        if let Some(tau) = parameters.get_mut("tau") {
            tau.value += self.samples;
            tau.ci95 = tau.ci95.map(|ci| ci.map(|x| x + self.samples));
        }
    }

    /// Adds the delay to the effects of a simulation.
    pub(crate) fn simulated(&self, effects: &mut Vec<WrittenEffect>) {
        if let Some(found) = effects.iter_mut().find(|e| self.is(&e.effect, &e.location)) {
            return self.add_to(&mut found.parameters);
        }
        let delay = WrittenEffect {
            effect: ActuatorDelay.name().into(),
            location: self.location.clone(),
            parameters: self.parameters(),
            given: BTreeMap::new(),
            equation: ActuatorDelay.equation().into(),
        };
        effects.insert(0, delay);
    }

    /// Adds the delay to every explanation within the vocabulary.
    pub(crate) fn explains(&self, candidates: &mut [Explanation]) {
        for candidate in candidates.iter_mut().filter(|candidate| !candidate.unknown) {
            if !candidate.effects.iter().any(|e| self.is(&e.effect, &e.location)) {
                let delay = Located { effect: ActuatorDelay.name().into(), location: self.location.clone() };
                candidate.effects.insert(0, delay);
            }
        }
    }

    /// Names the delay first, with the probability of all explanations within the vocabulary together.
    pub(crate) fn named(&self, effects: &mut Vec<NamedEffect>, candidates: &[Explanation]) {
        if let Some(found) = effects.iter_mut().find(|e| self.is(&e.effect, &e.location)) {
            return self.add_to(&mut found.parameters);
        }
        let delay = NamedEffect {
            effect: ActuatorDelay.name().into(),
            location: self.location.clone(),
            confidence: candidates.iter().filter(|c| !c.unknown).map(|c| c.probability).sum(),
            parameters: self.parameters(),
            family: None,
            share: None,
            share_ci95: None,
            change: None,
            shape_differs: false,
        };
        effects.insert(0, delay);
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

    /// Diagnoses with a library of only one effect, because the audit does not depend on the others.
    fn diagnosed(case: &Case) -> Outcome {
        let all = Library::standard();
        let names: Vec<String> = all.effects().map(|e| e.name().to_string()).filter(|n| n != "sensor-gain").collect();
        diagnose(case, &all.without(&names), &mut |_| {}).unwrap()
    }

    /// Returns the gap between the prediction of sim-with-effect.json for a new input and these outputs.
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
