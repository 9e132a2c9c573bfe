//! The testbed's effects as a trial draws them: the vocabulary, and two halves of the effects outside it. Effects
//! that a program has added to the testbed are drawn only if a trial names them.

use plid_testbed::effects::{Family, Half, On, kinds};
use serde::{Deserialize, Serialize};

pub use plid_testbed::effects::{At, Kind};

/// Returns the built-in vocabulary, in the order in which trials draw it: first the effects that are drawn on
/// structures, then those that are drawn only on bodies on axes, such as a motor or an arm.
pub fn built_in() -> Vec<Kind> {
    let mut built_in = kinds();
    built_in.retain(|kind| kind.is_in_vocabulary() && kind.family.is_built_in());
    built_in
}

/// Returns the part of the built-in vocabulary that is drawn on structures.
pub fn on_structures() -> Vec<Kind> {
    let mut drawn = built_in();
    drawn.retain(|kind| kind.on.contains(&On::Structure));
    drawn
}

/// The effects outside the vocabulary from which a trial draws. The two halves have no effect in common, so a trial
/// of one half shows whether lessons from the other hold for other causes.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Outsiders {
    /// The half with which the diagnosis was developed.
    Development,
    /// The half that is drawn only by trials whose scores are reported.
    Reported,
    /// Both halves.
    #[default]
    All,
}

impl Outsiders {
    /// Returns these effects.
    pub fn kinds(self) -> Vec<Kind> {
        let half = match self {
            Self::Development => Some(Half::Development),
            Self::Reported => Some(Half::Reported),
            Self::All => None,
        };
        let is_of_it = |family| matches!(family, Family::Outside(of) if half.is_none_or(|half| half == of));
        kinds().into_iter().filter(|kind| is_of_it(kind.family)).collect()
    }
}

/// Returns the effects that this program has added to the testbed.
pub fn own() -> Vec<Kind> {
    kinds().into_iter().filter(|kind| !kind.family.is_built_in()).collect()
}

/// Returns the built-in vocabulary, and then the effects of [`own()`].
pub fn whole() -> Vec<Kind> {
    kinds().into_iter().filter(Kind::is_in_vocabulary).collect()
}

/// Returns an effect of [`whole`].
pub fn find(name: &str) -> Option<Kind> {
    plid_testbed::effects::kind(name).filter(Kind::is_in_vocabulary)
}

/// Returns the family of an effect of [`whole`].
pub fn family(name: &str) -> Option<&'static str> {
    find(name).map(|kind| kind.family.name())
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use plid_gap::effects::Library;
    use plid_testbed::Effect;

    use super::*;

    /// Each outsider of the testbed is in one half, and only in one.
    #[test]
    fn the_halves_of_the_outsiders_are_disjoint_and_together_all() {
        let names = |half: Outsiders| half.kinds().iter().map(|kind| kind.name).collect::<BTreeSet<_>>();
        let (development, reported) = (names(Outsiders::Development), names(Outsiders::Reported));
        assert!(development.is_disjoint(&reported));
        assert_eq!((development.len(), reported.len(), Outsiders::All.kinds().len()), (8, 8, 16));
        assert_eq!(&development | &reported, names(Outsiders::All));
        // The message about an unknown effect lists all effects that the testbed knows.
        let unknown = serde_json::from_value::<Effect>(serde_json::json!({ "kind": "x-" })).unwrap_err().to_string();
        let known: BTreeSet<&str> =
            unknown.split('`').filter(|name| name.starts_with("x-") && name.len() > 2).collect();
        assert_eq!(known, names(Outsiders::All));
    }

    #[test]
    fn the_vocabulary_is_the_diagnosis_s_and_outsiders_are_not() {
        let library = Library::standard();
        let mut known: Vec<&str> = library.effects().map(|effect| effect.name()).collect();
        let mut drawn: Vec<&str> = built_in().iter().map(|kind| kind.name).collect();
        known.sort_unstable();
        drawn.sort_unstable();
        assert_eq!(known, drawn);
        assert!(Outsiders::All.kinds().iter().all(|kind| library.get(kind.name).is_none()));
        // Trials draw them in this order.
        assert!(built_in().starts_with(&on_structures()));
        assert_eq!((on_structures().len(), built_in().len()), (33, 41));
    }

    /// The testbed reads kind, place and law before it reports the missing parameters, which are not given here.
    #[test]
    fn the_testbed_knows_every_kind_place_and_law() {
        for kind in built_in().iter().chain(&Outsiders::All.kinds()) {
            let laws = kind.near_misses.iter().map(|law| Some(*law)).chain([None]);
            for (place, law) in kind.at.places(3, 3).into_iter().flat_map(|p| laws.clone().map(move |l| (p.clone(), l)))
            {
                let mut effect = serde_json::json!({ "kind": kind.name });
                place.iter().for_each(|place| effect["at"] = place.as_str().into());
                law.iter().for_each(|law| effect["law"] = (*law).into());
                let said = serde_json::from_value::<Effect>(effect.clone()).map_err(|e| e.to_string());
                let missing = said.as_ref().is_err_and(|e| e.starts_with("missing field") && !e.contains("`at`"));
                assert!(missing, "{effect}: {said:?}");
            }
            let strange = serde_json::json!({ "kind": kind.name, "law": "strange" });
            let said = serde_json::from_value::<Effect>(strange).unwrap_err().to_string();
            assert_eq!(said.contains("unknown variant `strange`"), !kind.near_misses.is_empty(), "{said}");
        }
    }

    #[test]
    fn places_are_all_there_are() {
        let count = |name: &str| find(name).unwrap().at.places(3, 3).len();
        assert_eq!((count("actuator-delay"), count("sensor-crosstalk"), count("missing-mode")), (4, 6, 1));
        assert_eq!(find("actuator-crosstalk").unwrap().at.places(1, 1).len(), 0);
        assert_eq!(find("cubic-stiffness").unwrap().at.places(2, 1), [Some("u1".to_owned()), Some("u2".to_owned())]);
    }
}
