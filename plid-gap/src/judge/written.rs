//! The model that is written: with the effects, unless nothing is missing or it follows the held-out records better
//! without them.

use crate::case::levels::loudest;
use crate::case::record::Record;
use crate::fit::free_run::run;
use crate::judge::crossed::{Crossed, Stated};
use crate::judge::explained::Explained;
use crate::judge::shrink::Gap;

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
    /// Chooses the model that is written, and states the gap to expect of it. `explains` is whether the effects of the
    /// explanation are written if they predict well enough.
    pub fn chosen(explained: &Explained, gaps: &mut Gap, explains: bool) -> Self {
        let with_effect = explains.then_some(gaps.with_effect);
        let no_worse = explained.ready.problem.settings.judge.no_worse;
        let follows = Self::of([gaps.as_given, gaps.refit], with_effect, no_worse);
        if let Some(Stated { gap, ci80 }) = without_effects(explained, follows) {
            (gaps.predicted_held_out_gap, gaps.predicted_ci80) = (gap, ci80);
        }
        follows
    }

    /// Chooses the model by the gaps on held-out records: of the simulation as given and of its refit, and with the
    /// effects if there are any to write. The effects are left out if they predict worse than one of the others does;
    /// the gap of effects whose free run diverges is no number.
    fn of([as_given, refit]: [f64; 2], with_effect: Option<f64>, no_worse: f64) -> Self {
        match with_effect {
            Some(gap) if gap <= no_worse * as_given.min(refit) => Self::Effects,
            _ if refit <= as_given => Self::Refit,
            _ => Self::AsGiven,
        }
    }
}

/// Returns the gap to expect on a further record at full level if not the explanation but a linear model is written:
/// that of this model in all fitted and held-out records. Without effects, the explanation is the refit.
fn without_effects(explained: &Explained, follows: Follows) -> Option<Stated> {
    let ready = &explained.ready;
    let plant = match follows {
        Follows::Effects => return None,
        Follows::Refit if explained.found.best.effects.is_empty() => return None,
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
