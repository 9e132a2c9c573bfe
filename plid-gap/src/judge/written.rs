//! The model that is written: with the effects, unless it follows the held-out records better without them.

use crate::case::levels::loudest;
use crate::case::record::Record;
use crate::fit::free_run::run;
use crate::judge::crossed::{Crossed, Stated};
use crate::judge::explained::Explained;
use crate::plant::Plant;

/// The model that follows the held-out records and is written.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Follows {
    /// The simulation as given.
    AsGiven,
    /// Its bounded refit.
    Refit,
    /// The simulation with the effects.
    Effects,
}

impl Follows {
    /// Chooses the model by the gaps on held-out records: of the simulation as given and of its refit, and with the
    /// effects if there are any to write. The effects are left out if they predict worse than one of the others does;
    /// the gap of effects whose free run diverges is no number.
    pub fn of([as_given, refit]: [f64; 2], with_effect: Option<f64>, no_worse: f64) -> Self {
        match with_effect {
            Some(gap) if gap <= no_worse * as_given.min(refit) => Self::Effects,
            _ if refit <= as_given => Self::Refit,
            _ => Self::AsGiven,
        }
    }
}

/// Returns the gap to expect on a further record at full level if the effects of an explanation are not written: that
/// of the linear model that is, in all fitted and held-out records.
pub fn without_effects(explained: &Explained, follows: Follows) -> Option<Stated> {
    let ready = &explained.ready;
    let plant = match follows {
        _ if explained.found.best.effects.is_empty() => return None,
        Follows::Effects => return None,
        Follows::Refit => &explained.refitted.plant,
        Follows::AsGiven => ready.as_given(),
    };
    let fitted = &ready.problem.records;
    let settings = &ready.problem.settings;
    let records: Vec<Record> = fitted.iter().chain(&ready.held_out).cloned().collect();
    let simulated = records.iter().map(|record| run(plant, &[], record)).collect();
    let level = loudest(fitted, settings.case.same_level).level();
    Some(Crossed::new(&records, simulated, None, &settings.judge).at(level))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Effects that predict held-out records worse than the simulation as given, or than its refit, are not written.
    #[test]
    fn what_is_written_predicts_no_worse_than_without_effects() {
        let of = |gaps, with_effect| Follows::of(gaps, Some(with_effect), 1.001);
        assert_eq!(of([0.2, 0.1], 0.1), Follows::Effects);
        assert_eq!(of([0.2, 0.1], 0.10005), Follows::Effects);
        assert_eq!(of([0.2, 0.1], 0.11), Follows::Refit);
        assert_eq!(of([0.1, 0.2], 0.11), Follows::AsGiven);
        assert_eq!(of([0.1, 0.2], 0.09), Follows::Effects);
        for diverged in [f64::INFINITY, f64::NAN] {
            assert_eq!(of([0.2, 0.1], diverged), Follows::Refit);
        }
        assert_eq!(Follows::of([0.2, 0.1], None, 1.001), Follows::Refit);
    }
}
