//! The truth of a case as given in label.json, and the comparison of stated locations with it.

use std::collections::BTreeMap;

use plid_testbed::effects::kind;
use serde::{Deserialize, Serialize};
use serde_json::Value;

/// The content of label.json.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub struct Truth {
    /// The effects, or the single effect `none` if nothing is missing.
    pub effects: Vec<TrueEffect>,
    /// Gap of the simulation as given on the held-out record.
    pub gap_sim: f64,
    /// Gap that remains if everything except the noise is known.
    pub gap_floor: f64,
    /// Gap of the held-out record without the main effects, noise included, relative to a simulation whose own
    /// parameters are exact. `None` if the truth has no imperfections.
    #[serde(default)]
    pub gap_background: Option<f64>,
    /// The imperfections.
    #[serde(default)]
    pub background_effects: Vec<TrueEffect>,
    /// All other properties of the case: its nuisances.
    #[serde(flatten)]
    pub more: BTreeMap<String, Value>,
}

/// An effect that is at work.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TrueEffect {
    /// Its name.
    pub effect: String,
    /// Its place, counted from 0.
    pub loc: usize,
    /// The parameters in the order of the vocabulary.
    pub par: Vec<f64>,
    /// The gap that it causes alone.
    pub gap: f64,
    /// Frequency of the mode at `loc`, or of the missing mode.
    pub hz: f64,
    /// Whether its law is the vocabulary's own equation.
    pub own_equation: bool,
}

impl Truth {
    /// Returns the effects; the list is empty if nothing is missing.
    pub fn at_work(&self) -> impl Iterator<Item = &TrueEffect> {
        self.effects.iter().filter(|effect| effect.effect != "none")
    }

    /// Returns the main cause: the effect with the largest gap.
    pub fn main(&self) -> Option<&TrueEffect> {
        self.at_work().max_by(|a, b| a.gap.total_cmp(&b.gap))
    }

    /// Returns whether an effect of this name at this place is the main cause.
    pub fn is_main(&self, effect: &str, location: &str) -> bool {
        self.main().is_some_and(|main| main.effect == effect && main.is_at(location))
    }

    /// Returns whether an effect of this name is at work at this place, as a cause or as an imperfection.
    pub fn acts(&self, effect: &str, location: &str) -> bool {
        self.at_work().any(|cause| cause.effect == effect && cause.is_at(location))
            || self.has_background(effect, location)
    }

    /// Returns whether a cause that is not named makes more than a material gap alone. Imperfections count, but not the
    /// errors of the simulation's own parameters, whose gaps no label states. `None` if the truth has imperfections
    /// that the label does not list.
    pub fn has_further_cause(&self, material: f64, is_named: impl Fn(&TrueEffect) -> bool) -> Option<bool> {
        let listed = self.gap_background.is_none() || !self.background_effects.is_empty();
        let mut all = self.at_work().chain(&self.background_effects);
        listed.then(|| all.any(|cause| cause.gap > material && !is_named(cause)))
    }

    /// Returns whether an imperfection of this name is at this place.
    pub fn has_background(&self, effect: &str, location: &str) -> bool {
        self.background_effects.iter().any(|small| small.effect == effect && small.is_at(location))
    }

    /// Returns the properties of the case apart from its effects, in words. The scores have a table for each of them.
    pub fn nuisances(&self) -> BTreeMap<String, String> {
        let word = |value: &Value| match value {
            Value::Bool(true) => Some("yes".to_owned()),
            Value::Bool(false) => Some("no".to_owned()),
            Value::String(text) => Some(text.clone()),
            Value::Number(number) if number.is_u64() => Some(number.to_string()),
            _ => None,
        };
        self.more.iter().filter_map(|(key, value)| Some((key.clone(), word(value)?))).collect()
    }
}

impl TrueEffect {
    /// Returns whether a stated location agrees with that of this effect.
    pub fn is_at(&self, location: &str) -> bool {
        kind(&self.effect).is_some_and(|kind| kind.at.is_meant(location, self.loc, &self.par, self.hz))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn effect(name: &str, loc: usize, par: &[f64]) -> TrueEffect {
        let (gap, hz) = (0.1, 168.0);
        TrueEffect { effect: name.to_owned(), loc, par: par.to_vec(), gap, hz, own_equation: true }
    }

    #[test]
    fn places_mean_what_the_rules_take_them_for() {
        let yes = [
            (effect("clearance", 1, &[0.1, 1.0]), "input:u2"),
            (effect("clearance", 1, &[0.1, 1.0]), "port:strut2"),
            (effect("added-mass", 0, &[0.1]), "input:u1"),
            (effect("end-stop", 1, &[1.0, 0.1, 0.5]), "input:u2"),
            (effect("actuator-delay", 3, &[0.5]), "input:all"),
            (effect("actuator-delay", 0, &[0.5]), "input:u1"),
            (effect("actuator-crosstalk", 0, &[0.1, 2.0]), "input:u1->u3"),
            (effect("sensor-crosstalk", 2, &[0.1, 0.0]), "output:y3->y1"),
            (effect("mains-hum", 0, &[0.1, 50.0, 0.0]), "output:y1"),
            (effect("stiffness-drift", 0, &[0.1]), "anything"),
            (effect("missing-mode", 4, &[168.0]), "mode:170.1"),
            (effect("modal-damping", 4, &[1.2]), "mode:161 Hz"),
            (effect("narrowband-disturbance", 1, &[0.1, 120.0, 0.3]), "freq:130.0"),
        ];
        for (truth, said) in yes {
            assert!(truth.is_at(said), "{truth:?} at {said}");
        }
        let no = [
            (effect("clearance", 1, &[0.1, 1.0]), "input:u1"),
            (effect("clearance", 1, &[0.1, 1.0]), "output:y2"),
            (effect("actuator-delay", 3, &[0.5]), "input:u3"),
            (effect("actuator-crosstalk", 0, &[0.1, 2.0]), "input:u3->u1"),
            (effect("added-damping", 0, &[0.1]), "mode:168.0"),
            (effect("sensor-gain", 0, &[1.1]), "input:y1"),
            (effect("modal-frequency", 4, &[0.01]), "mode:180"),
            (effect("modal-frequency", 4, &[0.01]), "mode:"),
            (effect("coloured-disturbance", 1, &[0.1, 120.0]), "freq:140"),
        ];
        for (truth, said) in no {
            assert!(!truth.is_at(said), "{truth:?} at {said}");
        }
    }

    #[test]
    fn an_imperfection_acts_and_is_no_main_cause() {
        let truth = Truth {
            effects: vec![effect("sensor-gain", 0, &[1.1])],
            gap_sim: 0.1,
            gap_floor: 0.01,
            gap_background: Some(0.03),
            background_effects: vec![effect("clearance", 1, &[0.1, 1.0])],
            more: BTreeMap::new(),
        };
        let both = |effect, location| [truth.acts(effect, location), truth.is_main(effect, location)];
        assert_eq!(both("sensor-gain", "output:y1"), [true, true]);
        assert_eq!(both("clearance", "input:u2"), [true, false]);
        assert_eq!(both("clearance", "input:u1"), [false, false]);
        let nothing = Truth { effects: vec![effect("none", 0, &[])], background_effects: Vec::new(), ..truth };
        assert!(!nothing.acts("none", "anything"));
    }

    #[test]
    fn what_a_label_says_beside_the_effects_is_a_nuisance() {
        let text = r#"{"effects": [], "perturbed": true, "gap_sim": 0.1, "gap_floor": 0.01, "ports": false,
            "plant": "beam", "inputs": 2, "list": [1]}"#;
        let truth: Truth = serde_json::from_str(text).unwrap();
        let said: Vec<(String, String)> = truth.nuisances().into_iter().collect();
        let pair = |a: &str, b: &str| (a.to_owned(), b.to_owned());
        assert_eq!(said, [pair("inputs", "2"), pair("perturbed", "yes"), pair("plant", "beam"), pair("ports", "no")]);
    }
}
