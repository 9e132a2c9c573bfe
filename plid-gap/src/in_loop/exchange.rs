//! Exchange of one effect of an explanation for another.
//!
//! The first effect found is the one that explains most on its own. If two effects are present, it may be a third one
//! that imitates a part of each. If a pair leaves much of the gap, each of its effects is therefore removed in turn,
//! and all other effects are screened in its place.

use crate::fit::candidate::{in_words, same};
use crate::fit::problem::Placed;
use crate::in_loop::bounds::Bounds;
use crate::in_loop::problem::{Fit, Problem};
use crate::in_loop::runs::Runs;
use crate::in_loop::screen::Entry;
use crate::in_loop::search::Search;

impl<'a> Search<'_, 'a> {
    /// Adds explanations in which one effect of the best explanation is exchanged for another, as long as the best one
    /// leaves more than `least` of the output and the bounds allow further runs. All are fitted to the first
    /// samples of one record; the best comes first.
    pub(super) fn exchange(
        &self,
        quick: &Problem<'a>,
        runs: &mut Runs,
        mut fits: Vec<Fit<'a>>,
        (least, bounds): (f64, Bounds),
        say: &mut dyn FnMut(String),
    ) -> Vec<Fit<'a>> {
        let places = fits.first().map_or(0, |best| best.effects.len());
        for at in 0..places {
            let best = fits[0].clone();
            if self.left(quick, &best) < least {
                break;
            }
            if let (0, by) = bounds.left(runs.spent(), quick.samples()) {
                let words = in_words(&best.effects, &quick.setting.names);
                runs.leave_out(by, format!("other effects in place of effect {} of {words}", at + 1));
                break;
            }
            say(format!("trying other effects in place of effect {} of {}", at + 1, self.words(quick, &best)));
            fits.extend(self.others(quick, runs, &best, at, bounds, say));
            self.best_first(quick, &mut fits);
        }
        fits
    }

    /// Returns the best explanations in which one effect is exchanged for another.
    fn others(
        &self,
        quick: &Problem<'a>,
        runs: &mut Runs,
        best: &Fit<'a>,
        at: usize,
        bounds: Bounds,
        say: &mut dyn FnMut(String),
    ) -> Vec<Fit<'a>> {
        let rest: Vec<Placed> = [&best.effects[..at], &best.effects[at + 1..]].concat();
        let Ok(simulated) = quick.simulate(runs, &rest, &best.eta) else { return Vec::new() };
        let beside = quick.as_is(rest, best.eta.clone(), simulated);
        let entries = self.screen(quick, runs, &beside, bounds, say);
        let is_first = |at: usize| !entries[..at].iter().any(|other| same(&other.placed, &entries[at].placed));
        let is_new = |entry: &&Entry| !same(&entry.placed, &best.effects[at]);
        let distinct = (0..entries.len()).filter(|at| is_first(*at)).map(|at| &entries[at]).filter(is_new);
        let sized = distinct.take(self.settings.stepped);
        let mut fits: Vec<Fit> =
            sized.filter_map(|entry| self.sized(quick, runs, &beside.effects, &best.eta, entry)).collect();
        self.best_first(quick, &mut fits);
        fits.truncate(self.settings.refined);
        let fitted = fits.into_iter().map(|fit| quick.fit(runs, fit, self.settings.quick_steps, self.gain(quick)));
        let fitted: Vec<Fit> = fitted.collect();
        fitted.iter().for_each(|fit| say(format!("tried {}", self.words(quick, fit))));
        fitted
    }
}
