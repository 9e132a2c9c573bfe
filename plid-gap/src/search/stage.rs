//! A stage of the search: the screen for a further effect, and fits of its first entries.

use std::f64::consts::TAU;

use rayon::prelude::*;

use crate::effects::{Range, Setting};
use crate::fit::problem::{Effort, Fit, Jacobian, Placed, Problem, sum_of_squares};
use crate::fit::refit::clipped;
use crate::search::price::Price;
use crate::search::rules::{Rules, Scope};
use crate::search::screen::{Base, Entry, screen};
use crate::search::windows::carried;
use crate::settings::step::Step;
use crate::simulate::Fineness;

/// Effort of the quick fits of the search.
const QUICK: Effort = Effort { steps: 8, gain: 0.5, fineness: Fineness::COARSE };

/// Effort of the fits of the windows' initial states.
const BEGIN: Effort = Effort { steps: 3, gain: 1.0, fineness: Fineness::COARSE };

/// Effort of the fits of the result.
const FINE: Effort = Effort { steps: 8, gain: 0.1, fineness: Fineness::FINE };

/// One stage of the search: the screen for a further effect, quick fits of its first entries, and whole fits of the
/// best of these. No entry and no fit depends on the other entries, so a search that knows fewer effects can use the
/// same entries and fits.
pub struct SearchStage<'a> {
    pub(super) from: Start<'a>,
    entries: Vec<Entry<'a>>,
    /// Number of entries that are fitted, and number of these that are fitted to whole records.
    counts: [usize; 2],
    /// Gain of the quick fit with the effect that the effects of this stage are to replace, if there is one.
    incumbent: Option<f64>,
    /// Fits to the first samples, with the number of the entry; `None` if the fit is not sound.
    quick: Numbered<'a>,
    /// Fits to whole records.
    whole: Numbered<'a>,
}

type Numbered<'a> = Vec<(usize, Option<Fit<'a>>)>;

impl<'a> SearchStage<'a> {
    pub(super) fn new(
        problem: &Problem,
        quick: &Problem,
        so_far: &Fit<'a>,
        replaces: Option<&Placed<'a>>,
        there: &(dyn Fn(&Placed) -> bool + Sync),
        price: &Price<'_, 'a>,
        counts: [usize; 2],
    ) -> Self {
        let from = Start::new(quick, so_far, &price.scope.off);
        let left_out = |placed: &Placed| there(placed) || is_blind(&quick.setting, price.scope.rules, placed);
        let entries = screen(&from.base(quick, price.scope), price.scope.library, left_out);
        let incumbent = replaces.map(|placed| {
            let fit = from.fitted(quick, &[&from.effects[..], std::slice::from_ref(placed)].concat());
            from.cost - price.of(&fit)
        });
        let mut searched = Self { from, entries, counts, incumbent, quick: Vec::new(), whole: Vec::new() };
        let all: Vec<usize> = (0..searched.entries.len()).collect();
        (searched.quick, searched.whole) = searched.fits(problem, quick, &all, price);
        searched
    }

    /// Returns the entries and the fits to whole records of those effects that are neither present nor left out.
    pub(super) fn without(
        &self,
        problem: &Problem,
        quick: &Problem,
        there: &dyn Fn(&Placed) -> bool,
        price: &Price,
    ) -> (Vec<Entry<'a>>, Vec<Fit<'a>>) {
        let kept: Vec<usize> = (0..self.entries.len()).filter(|&k| !there(&self.entries[k].placed)).collect();
        let (_, whole) = self.fits(problem, quick, &kept, price);
        let entries = kept.into_iter().map(|k| self.entries[k].clone()).collect();
        (entries, whole.into_iter().filter_map(|(_, fit)| fit).collect())
    }

    /// Fits the first of these entries to the first samples, and the best of these fits to whole records. Known fits
    /// are not repeated.
    fn fits(&self, problem: &Problem, quick: &Problem, at: &[usize], price: &Price) -> (Numbered<'a>, Numbered<'a>) {
        let [fitted, polished] = self.counts;
        // The trace of a load says little if the load moves a resonance by more than its width, and so does the trace
        // of a contact that occurs at another time. A plant with few parameters has few loads and contacts, and all
        // of them are fitted.
        let always = |k: usize| {
            let effect = self.entries[k].placed.effect;
            quick.has_numbers() && (effect.is_number() || effect.is_contact())
        };
        let heads: Numbered<'a> = at
            .par_iter()
            .enumerate()
            .filter(|&(rank, &k)| rank < fitted && self.entries[k].gain > 0.0 || always(k))
            .map(|(_, &k)| {
                let new = || {
                    let mut all = self.from.effects.clone();
                    all.push(self.entries[k].placed.clone());
                    Some(self.from.fitted(quick, &all)).filter(|fit| fit.cost.is_finite())
                };
                (k, known(&self.quick, k).cloned().unwrap_or_else(new))
            })
            .collect();
        let heads = self.further(quick, heads, 2 * polished, price);
        // The parameters are checked only now, because a fit that has not reached its minimum may still lead back to
        // sound ones. Effects that were present before are judged by the fit to whole records alone: few samples may
        // not determine them.
        let added = self.from.effects.len();
        let is_sound = |fit: &Fit| fit.cost.is_finite() && are_sound(quick, &fit.effects[added..]);
        let sound = |(k, fit): (usize, Option<Fit<'a>>)| (k, fit.filter(is_sound));
        let heads: Numbered<'a> = heads.into_iter().map(sound).collect();
        let mut best = ranked(&heads, price);
        best.truncate(polished);
        let gain = |fit: &Fit| self.from.cost - price.of(fit);
        let first = best.first().map_or(0.0, |&(_, fit)| gain(fit));
        let settings = &price.scope.settings;
        let (most, least, share) = match self.incumbent {
            Some(incumbent) => (incumbent.max(first), settings.replacing_gain, settings.replacing_share),
            None => (first, settings.trailing_gain, settings.trailing_share),
        };
        best.retain(|(_, fit)| most - gain(fit) < least.max(share * most));
        let whole = best
            .into_par_iter()
            .map(|(k, fit)| {
                let new = || {
                    whether_sound(problem, carried(problem, quick, fit, |fit| on_whole(problem, fit, &price.scope.off)))
                };
                (k, known(&self.whole, k).cloned().unwrap_or_else(new))
            })
            .collect();
        (heads, whole)
    }

    /// Continues the best quick fits that have not yet reached their minimum, if the linear parameters are few: the
    /// best ones with sound parameters, and the best ones without.
    fn further(&self, quick: &Problem, heads: Numbered<'a>, most: usize, price: &Price) -> Numbered<'a> {
        if !quick.few() {
            return heads;
        }
        let (sound, unsound): (Vec<_>, Vec<_>) =
            ranked(&heads, price).into_iter().partition(|(_, fit)| are_sound(quick, &fit.effects));
        let first: Vec<usize> = [sound, unsound].iter().flat_map(|fits| fits.iter().take(most)).map(|f| f.0).collect();
        let continued = |(k, fit): (usize, Option<Fit<'a>>)| match fit {
            Some(fit) if !fit.converged && first.contains(&k) && known(&self.quick, k).is_none() => {
                let fit = quick.fit(&self.from.jacobian, &fit.eta, &fit.effects, quick.far(QUICK));
                (k, Some(fit))
            }
            fit => (k, fit),
        };
        heads.into_par_iter().map(continued).collect()
    }
}

/// Returns the known fit of an entry, if there is one.
fn known<'f, 'a>(fits: &'f Numbered<'a>, k: usize) -> Option<&'f Option<Fit<'a>>> {
    fits.iter().find(|(n, _)| *n == k).map(|(_, fit)| fit)
}

/// Returns the fits with their numbers, the best first.
fn ranked<'f, 'a>(fits: &'f Numbered<'a>, price: &Price) -> Vec<(usize, &'f Fit<'a>)> {
    let mut best: Vec<(usize, &Fit<'a>)> = fits.iter().filter_map(|(k, fit)| Some((*k, fit.as_ref()?))).collect();
    best.sort_by(|a, b| price.of(a.1).total_cmp(&price.of(b.1)));
    best
}

/// Returns the fit if its cost is finite and its parameters are consistent with the effects' names.
pub(super) fn whether_sound<'a>(problem: &Problem, fit: Fit<'a>) -> Option<Fit<'a>> {
    (fit.cost.is_finite() && are_sound(problem, &fit.effects)).then_some(fit)
}

/// The linear model from which a stage starts. Parameters far outside their prior are brought back, because they may
/// be the trace of an effect. If an effect is in place and the parameters are few, they are left where they are:
/// accurate derivatives lead them back.
pub(super) struct Start<'a> {
    effects: Vec<Placed<'a>>,
    eta: Vec<f64>,
    plant: crate::plant::Plant,
    jacobian: Jacobian,
    residual: Vec<f64>,
    cost: f64,
}

impl<'a> Start<'a> {
    fn new(problem: &Problem, fit: &Fit<'a>, off: &[Step]) -> Self {
        let stays = off.contains(&Step::Clipping) || problem.few() && !fit.effects.is_empty();
        let mut eta = if stays { None } else { clipped(problem, &fit.eta) }.unwrap_or_else(|| fit.eta.clone());
        let plant = problem.nuisance.apply(&problem.plant, &eta);
        let jacobian = problem.jacobian(&plant);
        if problem.nuisance.len() > eta.len() {
            let begun = problem.fit(&jacobian, &eta, &fit.effects, BEGIN);
            eta.extend_from_slice(&begun.eta[eta.len()..]);
        }
        let residual = problem.residual(&plant, &eta, &fit.effects, Fineness::COARSE);
        let cost = sum_of_squares(&residual) + problem.penalty(&eta);
        Self { effects: fit.effects.clone(), eta, plant, jacobian, residual, cost }
    }

    /// Fits the first samples with these effects. If a load and the poles that it moves have similar traces, a refit
    /// has left the linear parameters in a long, curved valley, and a fit that starts from zero enters this valley
    /// near its minimum.
    fn fitted(&self, quick: &Problem, effects: &[Placed<'a>]) -> Fit<'a> {
        let fit = |eta: &[f64]| quick.fit(&self.jacobian, eta, effects, QUICK);
        let near = fit(&self.eta);
        if !quick.is_loaded(effects) {
            return near;
        }
        let anew = fit(&quick.nuisance.as_given(&self.eta));
        if anew.is_better_than(&near) { anew } else { near }
    }

    pub(super) fn base<'p>(&'p self, problem: &'p Problem, scope: &Scope) -> Base<'p, 'a> {
        Base {
            problem,
            jacobian: &self.jacobian,
            plant: &self.plant,
            eta: &self.eta,
            effects: &self.effects,
            residual: &self.residual,
            bold: scope.bold,
            sized: scope.imperfect,
        }
    }
}

/// Returns whether an effect is a contact whose displacement no output measures. Such a contact could be at any
/// displacement, and a stop near rest resembles a stiffening spring, so it is not tried unless the case suspects it.
pub(crate) fn is_blind(setting: &Setting, rules: &Rules, placed: &Placed) -> bool {
    let unmeasured = || {
        let port = setting.port(&placed.place);
        setting.d_range[port].is_none() || setting.plant.integrates(&setting.plant.ports[port])
    };
    placed.effect.is_contact() && unmeasured() && !rules.suspects(placed, &setting.names)
}

/// Returns whether the parameters are consistent with the effects' names.
fn are_sound(problem: &Problem, effects: &[Placed]) -> bool {
    effects.iter().all(|placed| placed.effect.sound(&problem.setting, &placed.place, &placed.parameters))
}

/// Repeats a fit to the first samples on whole records, or only evaluates it there if that step is off.
pub(super) fn on_whole<'a>(problem: &Problem, fit: Fit<'a>, off: &[Step]) -> Fit<'a> {
    if !off.contains(&Step::Polishing) {
        return polish(problem, fit);
    }
    let plant = problem.nuisance.apply(&problem.plant, &fit.eta);
    let residual = problem.residual(&plant, &fit.eta, &fit.effects, Fineness::FINE);
    let cost = sum_of_squares(&residual) + problem.penalty(&fit.eta);
    Fit { residual, cost, ..fit }
}

/// Continues a fit with fine steps and with derivatives at its own linear model.
pub fn polish<'a>(problem: &Problem, fit: Fit<'a>) -> Fit<'a> {
    let plant = problem.nuisance.apply(&problem.plant, &fit.eta);
    let jacobian = problem.jacobian(&plant);
    let mut fit = problem.fit(&jacobian, &fit.eta, &fit.effects, problem.far(FINE));
    for placed in &mut fit.effects {
        let kinds = placed.effect.parameters(&problem.setting);
        for (value, parameter) in placed.parameters.iter_mut().zip(kinds) {
            if parameter.range == Range::Angle {
                *value -= TAU * (*value / TAU).round();
            }
        }
        placed.place = placed.effect.fitted_place(&placed.place, &placed.parameters);
    }
    fit
}
