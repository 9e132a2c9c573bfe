//! Families of effects: laws of one kind at one place, which records often cannot tell apart.

use serde::{Deserialize, Serialize};

use crate::fit::problem::Placed;
use crate::judge::verdict::Weighted;

/// The family of a named effect.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Family {
    /// Its name, such as "dry friction".
    pub name: String,
    /// Probability that some member of the family acts at this place.
    pub confidence: f64,
}

impl Family {
    /// Returns the family of an effect. Its confidence is the sum of the probabilities of all explanations that have
    /// a member of the family at the same place.
    pub(crate) fn of(placed: &Placed, weighted: &[Weighted]) -> Option<Self> {
        let name = placed.effect.family()?.to_string();
        let has = |w: &&Weighted| w.effects.iter().any(|other| is_kin(placed, other));
        Some(Self { name, confidence: weighted.iter().filter(has).map(|w| w.probability).sum() })
    }

    /// Returns the family with its confidence multiplied by the probability that the effect is not an imitation.
    pub(crate) fn imitated(self, factor: f64) -> Self {
        Self { confidence: self.confidence * factor, ..self }
    }
}

/// Returns whether two effects act at the same place and are the same or of one family.
fn is_kin(a: &Placed, b: &Placed) -> bool {
    let related = a.effect.family().is_some() && a.effect.family() == b.effect.family();
    a.place == b.place && (related || a.effect.name() == b.effect.name())
}

/// Returns the sum of the probabilities of all explanations that differ from this one at most in other members of the
/// same families.
pub(crate) fn with_kin(effects: &[Placed], weighted: &[Weighted]) -> f64 {
    let kin = |w: &&Weighted| {
        w.effects.len() == effects.len() && effects.iter().all(|a| w.effects.iter().any(|b| is_kin(a, b)))
    };
    weighted.iter().filter(kin).map(|w| w.probability).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::{Library, Place};

    fn weighted(effects: Vec<Placed>, probability: f64) -> Weighted {
        Weighted { unknown: effects.is_empty(), effects, probability, cost: None }
    }

    #[test]
    fn kin_is_of_one_family_at_one_place() {
        let library = Library::standard();
        let at = |name: &str, place: Place| Placed { effect: library.get(name).unwrap(), place, parameters: vec![1.0] };
        let [smooth, stick] = ["coulomb-friction", "stick-friction"];
        let all = [
            weighted(Vec::new(), 0.4),
            weighted(vec![at(smooth, Place::Port(0))], 0.3),
            weighted(vec![at(stick, Place::Port(0))], 0.2),
            weighted(vec![at(stick, Place::Port(1))], 0.06),
            weighted(vec![at("cubic-stiffness", Place::Port(0))], 0.04),
        ];
        let named = at(smooth, Place::Port(0));
        let family = Family::of(&named, &all).unwrap();
        assert_eq!(family.name, "dry friction");
        assert!((family.confidence - 0.5).abs() < 1e-12);
        assert!((with_kin(&[named], &all) - 0.5).abs() < 1e-12);
        // An effect without a family is compared by name only.
        let gain = at("actuator-gain", Place::Input(0));
        assert_eq!(Family::of(&gain, &all), None);
        assert!(with_kin(&[gain], &all).abs() < 1e-12);
    }
}
