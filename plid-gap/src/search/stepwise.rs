//! The stepwise search: screen, fits of the best entries, acceptance; after each effect all effects are reconsidered.

use std::cell::OnceCell;
use std::f64::consts::TAU;

use rayon::prelude::*;

use crate::effects::{Effect, Names, Range};
use crate::fit::candidate::{Candidate, all_same, in_words, same};
use crate::fit::problem::{Effort, Fit, Jacobian, Placed, Problem, sum_of_squares};
use crate::fit::refit::{Refit, clipped};
use crate::noise::NoiseModel;
use crate::search::overlap::{Overlap, of_screen};
use crate::search::ports::fit_ports;
use crate::search::rules::Scope;
use crate::search::screen::{Base, Entry, screen};
use crate::search::windows::follows;
use crate::settings::step::Step;
use crate::simulate::Fineness;

/// The result of the search.
pub struct Search<'a> {
    /// The best explanation, fitted finely; without effects the refit itself.
    pub best: Fit<'a>,
    /// All explanations that were fitted, the best first, including that of no effect.
    pub candidates: Vec<Candidate<'a>>,
    /// The screen of each stage.
    pub stages: Vec<Vec<Entry<'a>>>,
    /// The similarity of the first entries of the first stage, before any fit.
    pub overlap: Option<Overlap>,
}

impl<'a> Search<'a> {
    /// Accepts a free shape of the best explanation, which costs `more` parameters.
    pub fn set_free(&mut self, cost: f64, more: usize, rows: f64) {
        let is_best = |c: &Candidate| all_same(&c.effects, &self.best.effects);
        let Some(at) = self.candidates.iter().position(is_best) else { return };
        let gain = self.candidates[at].cost - cost;
        let candidate = &mut self.candidates[at];
        candidate.cost = cost;
        candidate.priced -= (gain - more as f64 * rows.ln()).max(0.0);
        self.candidates.sort_by(|a, b| a.priced.total_cmp(&b.priced));
    }

    /// Replaces the best explanation by one with fewer effects that explains as much with a free shape. It takes the
    /// rank of the best explanation.
    pub fn settle(&mut self, fewer: Fit<'a>, cost: f64) {
        let first = self.candidates.first().map_or(cost, |candidate| candidate.priced);
        let old = std::mem::replace(&mut self.best, fewer);
        let replaced = |c: &Candidate| all_same(&c.effects, &old.effects) || all_same(&c.effects, &self.best.effects);
        self.candidates.retain(|c| !replaced(c));
        self.candidates.insert(0, Candidate { effects: self.best.effects.clone(), cost, priced: first });
    }

    /// Updates the best explanation for a changed noise model; the others keep their difference from it.
    pub fn weigh_anew(&mut self, problem: &Problem, off: &[Step]) {
        let before = self.best.cost;
        self.best = on_whole(problem, self.best.clone(), off);
        for candidate in &mut self.candidates {
            candidate.cost += self.best.cost - before;
            candidate.priced += self.best.cost - before;
        }
    }
}

/// Quick fits of the search.
const QUICK: Effort = Effort { steps: 8, gain: 0.5, fineness: Fineness::COARSE };

/// Fits of the windows' initial states.
const BEGIN: Effort = Effort { steps: 3, gain: 1.0, fineness: Fineness::COARSE };

/// Fits of the result.
const FINE: Effort = Effort { steps: 8, gain: 0.1, fineness: Fineness::FINE };

/// Searches for up to `most_effects` effects: on `quick` (the first samples of the records), then with the best few on
/// `problem`. If `quick` holds `windows`, it gets the first samples again, weighed by this noise, as soon as an
/// explanation follows them: the windows' initial states hide what is left. `first` is the first stage; it is filled if
/// it is empty. `say` is called with the progress.
pub fn search<'a>(
    problem: &mut Problem,
    quick: &mut Problem,
    mut windows: Option<&NoiseModel>,
    refit: &Refit,
    scope: &Scope<'_, 'a>,
    first: &OnceCell<SearchStage<'a>>,
    say: &mut dyn FnMut(String),
) -> Search<'a> {
    let (price, settings) = (Price { rows: problem.rows() as f64, scope }, &scope.settings);
    let mut best = refit.as_fit();
    let mut candidates = vec![Candidate { effects: Vec::new(), cost: refit.cost, priced: refit.cost }];
    let mut stages = Vec::new();
    let mut overlap = None;
    // One effect may imitate two others better than each of these does alone.
    let mut runners_up: Vec<Fit> = Vec::new();
    for stage in 0..settings.most_effects {
        let there = |placed: &Placed| best.effects.iter().any(|other| same(other, placed)) || !scope.admits(placed);
        let new = || SearchStage::new(problem, quick, &best, &there, &price, [settings.fitted, settings.polished]);
        let own = OnceCell::new();
        let searched = if stage == 0 { first } else { &own }.get_or_init(new);
        let (entries, mut fits) = searched.without(problem, quick, &there, &price);
        if stage == 0 {
            overlap = of_screen(&searched.from.base(quick, scope.bold), &entries[..entries.len().min(settings.fitted)]);
        }
        say(progress(stage + 1, &entries, &fits, &price, &problem.setting.names));
        stages.push(entries);
        for start in std::mem::take(&mut runners_up) {
            fits.extend(after(problem, quick, &start, &price, say));
        }
        let tried: Vec<Candidate> = fits.iter().map(|fit| price.candidate(fit)).collect();
        fits.sort_by(|a, b| price.of(a).total_cmp(&price.of(b)));
        let mut ranked = fits.into_iter();
        let Some(top) = ranked.next() else { break };
        if stage == 0 && problem.few() && imitates(&top, &price) {
            runners_up = ranked.take(settings.runners_up).collect();
        }
        if problem.few() && price.of(&top) < price.of(&best) {
            best = without_last(problem, best, &top, &price, &mut candidates);
        }
        let gain = price.of(&best) - price.of(&top);
        let material = scope.skips(Step::Material) || material(problem, scope, &best, &top);
        let accepted = gain > settings.accept_gain && material;
        // The best explanation with a further effect that was not accepted is not another explanation.
        if accepted || best.effects.is_empty() {
            candidates.extend(tried);
        }
        if !accepted {
            break;
        }
        best = if scope.skips(Step::PortScales) { top } else { fit_ports(problem, quick, top) };
        // With other scales of the ports it explains more than when it was entered.
        candidates.push(price.candidate(&best));
        if best.effects.len() > 1 && !scope.skips(Step::Questioning) {
            best = question(problem, quick, best, &price, &mut candidates);
        }
        if let Some(head) = windows.and_then(|noise| followed(problem, &best, noise)) {
            *quick = head;
            windows = None;
            best = further(problem, best, &price, &mut candidates);
        }
    }
    best = refined(problem, quick, best, &price, &mut candidates);
    // An effect that was not accepted must rank behind no effect, whatever its price.
    if best.effects.is_empty() {
        let least = best.cost + settings.not_accepted_price;
        candidates.iter_mut().filter(|c| !c.effects.is_empty()).for_each(|c| c.priced = c.priced.max(least));
    }
    candidates.sort_by(|a, b| a.priced.total_cmp(&b.priced));
    Search { best, candidates, stages, overlap }
}

/// Returns whether an explanation leaves so much beyond the noise that it may only imitate the cause.
fn imitates(fit: &Fit, price: &Price) -> bool {
    sum_of_squares(&fit.residual) > price.scope.settings.imitation_left * price.rows
}

/// Returns the fits of a stage that starts from this explanation.
fn after<'a>(
    problem: &Problem,
    quick: &Problem,
    start: &Fit<'a>,
    price: &Price<'_, 'a>,
    say: &mut dyn FnMut(String),
) -> Vec<Fit<'a>> {
    let settings = &price.scope.settings;
    let there = |placed: &Placed| start.effects.iter().any(|other| same(other, placed)) || !price.scope.admits(placed);
    let searched = SearchStage::new(problem, quick, start, &there, price, [settings.fitted / 2, settings.polished / 2]);
    let (entries, fits) = searched.without(problem, quick, &there, price);
    let names = &problem.setting.names;
    say(format!("with {}, {}", in_words(&start.effects, names), progress(2, &entries, &fits, price, names)));
    fits
}

/// Fits a further time without the last effect, from where the fit with it ended, and returns the better one of this
/// and the best explanation. What the linear parameters alone gain on that way is no gain of the effect.
fn without_last<'a>(
    problem: &Problem,
    best: Fit<'a>,
    with: &Fit<'a>,
    price: &Price<'_, 'a>,
    candidates: &mut Vec<Candidate<'a>>,
) -> Fit<'a> {
    let mut bare = with.clone();
    bare.effects.pop();
    let bare = polish(problem, bare);
    if bare.cost >= best.cost {
        return best;
    }
    candidates.retain(|candidate| !all_same(&candidate.effects, &bare.effects));
    candidates.push(price.candidate(&bare));
    bare
}

/// Returns the first samples of the records if the free runs of an explanation follow them.
fn followed(problem: &Problem, fit: &Fit, noise: &NoiseModel) -> Option<Problem> {
    let head = problem.head(problem.settings.search.first_samples, noise);
    follows(&head, &fit.eta, &fit.effects).then_some(head)
}

/// Fits the best explanation a further time, and returns the better fit.
fn further<'a>(
    problem: &Problem,
    best: Fit<'a>,
    price: &Price<'_, 'a>,
    candidates: &mut Vec<Candidate<'a>>,
) -> Fit<'a> {
    let further = on_whole(problem, best.clone(), &price.scope.off);
    if price.of(&further) >= price.of(&best) {
        return best;
    }
    candidates.push(price.candidate(&further));
    further
}

/// Adds parameters of the simulation, such as a gain or a frequency, that the refit changed beyond its other changes.
/// Each is added to the best explanation if that brings the linear parameters sufficiently close to their prior,
/// whatever else was found.
pub fn straighten<'a>(
    problem: &Problem,
    quick: &Problem,
    found: &mut Search<'a>,
    scope: &Scope<'_, 'a>,
    say: &mut dyn FnMut(String),
) {
    let (price, settings) = (Price { rows: problem.rows() as f64, scope }, &scope.settings);
    for _ in 0..settings.most_straightened {
        let best = &found.best;
        let there = |placed: &Placed| {
            !placed.effect.is_number() || best.effects.iter().any(|other| same(other, placed)) || !scope.allows(placed)
        };
        let searched = SearchStage::new(problem, quick, best, &there, &price, [settings.fitted, settings.polished]);
        let (entries, fits) = searched.without(problem, quick, &there, &price);
        say(progress(best.effects.len() + 1, &entries, &fits, &price, &problem.setting.names));
        let Some(top) = fits.into_iter().min_by(|a, b| price.of(a).total_cmp(&price.of(b))) else { return };
        let straightened = problem.penalty(&best.eta) - problem.penalty(&top.eta);
        if price.of(best) - price.of(&top) < settings.accept_gain || straightened < settings.straightened_penalty {
            return;
        }
        found.candidates.push(price.candidate(&top));
        found.candidates.sort_by(|a, b| a.priced.total_cmp(&b.priced));
        found.best = top;
    }
}

/// States the number of entries of a stage and the gains of its first fits.
fn progress(stage: usize, entries: &[Entry], fits: &[Fit], price: &Price, names: &Names) -> String {
    let one = |fit: &Fit| {
        let last = fit.effects.last().expect("a stage adds an effect");
        format!("{} at {} ({:.0})", last.effect.name(), last.place.location(names), price.of(fit))
    };
    let fits = fits.iter().map(one).collect::<Vec<_>>().join(", ");
    let entry = |entry: &Entry| {
        format!("{} at {} ({:.0})", entry.placed.effect.name(), entry.placed.place.location(names), entry.gain)
    };
    let first = entries.iter().take(6).map(entry).collect::<Vec<_>>().join(", ");
    format!("stage {stage}: {} entries of the screen, the first: {first}; priced fits: {fits}", entries.len())
}

/// Returns whether a further effect explains enough: of the residual, or of the changes of the linear parameters.
fn material(problem: &Problem, scope: &Scope, before: &Fit, after: &Fit) -> bool {
    let (search, rows) = (&problem.settings.search, problem.rows() as f64);
    let left = |fit: &Fit| sum_of_squares(&fit.residual);
    let explained = left(before) - left(after);
    // If less is left than the noise that is assumed, the records do not show how much of it is noise. Nor do they if
    // an earlier residual is assumed: a further effect at the same place may then only correct the first one's law.
    let corrects =
        after.effects.split_last().is_some_and(|(last, others)| others.iter().any(|e| e.place == last.place));
    let unknown = scope.imperfect && corrects || left(before) < search.overstated * rows;
    let excess = if unknown { left(before) } else { left(before) - rows };
    let share = explained / excess.max(search.material_power * rows);
    let straightened = problem.penalty(&before.eta) - problem.penalty(&after.eta);
    let visible =
        explained > search.material_power * rows && (before.effects.is_empty() || share > search.further_share);
    visible || (straightened > search.straightened_penalty && explained > -search.straightened_penalty)
}

/// One stage of the search: the screen for a further effect, quick fits of its first entries, and whole fits of the
/// best of these. No entry and no fit depends on which other entries there are, so a search that knows fewer effects
/// can use the same ones.
pub struct SearchStage<'a> {
    from: Start<'a>,
    entries: Vec<Entry<'a>>,
    /// Number of entries that are fitted, and number of these that are fitted to whole records.
    counts: [usize; 2],
    /// Fits to the first samples by number of the entry; `None` if the fit is not sound.
    quick: Numbered<'a>,
    /// Fits to whole records.
    whole: Numbered<'a>,
}

type Numbered<'a> = Vec<(usize, Option<Fit<'a>>)>;

impl<'a> SearchStage<'a> {
    fn new(
        problem: &Problem,
        quick: &Problem,
        so_far: &Fit<'a>,
        there: &(dyn Fn(&Placed) -> bool + Sync),
        price: &Price<'_, 'a>,
        counts: [usize; 2],
    ) -> Self {
        let from = Start::new(quick, so_far, &price.scope.off);
        let entries = screen(&from.base(quick, price.scope.bold), price.scope.library, there);
        let mut searched = Self { from, entries, counts, quick: Vec::new(), whole: Vec::new() };
        let all: Vec<usize> = (0..searched.entries.len()).collect();
        (searched.quick, searched.whole) = searched.fits(problem, quick, &all, price);
        searched
    }

    /// Adds entries and whole fits of effects that are neither present nor left out.
    fn without(
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

    /// Fits the first of these entries to the first samples and to whole records. Known fits are not repeated.
    fn fits(&self, problem: &Problem, quick: &Problem, at: &[usize], price: &Price) -> (Numbered<'a>, Numbered<'a>) {
        let [fitted, polished] = self.counts;
        let heads: Numbered<'a> = at[..at.len().min(fitted)]
            .par_iter()
            .filter(|&&k| self.entries[k].gain > 0.0)
            .map(|&k| {
                let new = || {
                    let mut all = self.from.effects.clone();
                    all.push(self.entries[k].placed.clone());
                    whether_sound(quick, self.from.fitted(quick, &all))
                };
                (k, known(&self.quick, k).cloned().unwrap_or_else(new))
            })
            .collect();
        let heads = self.further(quick, heads, 2 * polished, price);
        let mut best = ranked(&heads, price);
        best.truncate(polished);
        let gain = |fit: &Fit| self.from.cost - price.of(fit);
        let most = best.first().map_or(0.0, |&(_, fit)| gain(fit));
        let trailing = price.scope.settings.trailing_gain.max(price.scope.settings.trailing_share * most);
        best.retain(|(_, fit)| most - gain(fit) < trailing);
        let whole = best
            .into_par_iter()
            .map(|(k, fit)| {
                let new = || whether_sound(problem, on_whole(problem, fit.clone(), &price.scope.off));
                (k, known(&self.whole, k).cloned().unwrap_or_else(new))
            })
            .collect();
        (heads, whole)
    }

    /// Continues the best quick fits that have not yet reached their minimum, if the linear parameters are few.
    fn further(&self, quick: &Problem, heads: Numbered<'a>, most: usize, price: &Price) -> Numbered<'a> {
        if !quick.few() {
            return heads;
        }
        let first: Vec<usize> = ranked(&heads, price).into_iter().take(most).map(|(k, _)| k).collect();
        let continued = |(k, fit): (usize, Option<Fit<'a>>)| match fit {
            Some(fit) if !fit.converged && first.contains(&k) && known(&self.quick, k).is_none() => {
                let fit = quick.fit(&self.from.jacobian, &fit.eta, &fit.effects, quick.far(QUICK));
                (k, whether_sound(quick, fit))
            }
            fit => (k, fit),
        };
        heads.into_par_iter().map(continued).collect()
    }
}

/// Returns the fit of an entry, if there is one.
fn known<'f, 'a>(fits: &'f Numbered<'a>, k: usize) -> Option<&'f Option<Fit<'a>>> {
    fits.iter().find(|(n, _)| *n == k).map(|(_, fit)| fit)
}

/// Returns the fits with their numbers, the best first.
fn ranked<'f, 'a>(fits: &'f Numbered<'a>, price: &Price) -> Vec<(usize, &'f Fit<'a>)> {
    let mut best: Vec<(usize, &Fit<'a>)> = fits.iter().filter_map(|(k, fit)| Some((*k, fit.as_ref()?))).collect();
    best.sort_by(|a, b| price.of(a.1).total_cmp(&price.of(b.1)));
    best
}

/// Returns the fit if its cost is finite and its parameters still mean what the effects' names say.
fn whether_sound<'a>(problem: &Problem, fit: Fit<'a>) -> Option<Fit<'a>> {
    (fit.cost.is_finite() && fit.effects.iter().all(|placed| sound(problem, placed))).then_some(fit)
}

/// The price of parameters and choices, and the options of a stage.
struct Price<'p, 'a> {
    rows: f64,
    scope: &'p Scope<'p, 'a>,
}

impl<'a> Price<'_, 'a> {
    fn of(&self, fit: &Fit) -> f64 {
        let settings = &self.scope.settings;
        let one = |placed: &Placed| {
            let own = if placed.effect.is_in_refit() {
                settings.release_price
            } else {
                settings.choice_price + placed.parameters.len() as f64 * self.rows.ln()
            };
            own - self.scope.bonus(placed)
        };
        fit.cost + fit.effects.iter().map(one).sum::<f64>()
    }

    fn candidate(&self, fit: &Fit<'a>) -> Candidate<'a> {
        Candidate { effects: fit.effects.clone(), cost: fit.cost, priced: self.of(fit) }
    }
}

/// A linear model from which a stage starts. Parameters far outside their prior are brought back, because they may be
/// the trace of an effect. With an effect in place, few parameters are left where they are: accurate derivatives lead
/// them back.
struct Start<'a> {
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

    /// Fits the first samples with these effects. Where a load and the poles that it moves look alike, a refit has left
    /// the linear parameters in a long, curved valley, and a fit that starts from zero enters it near its minimum.
    fn fitted(&self, quick: &Problem, effects: &[Placed<'a>]) -> Fit<'a> {
        let fit = |eta: &[f64]| quick.fit(&self.jacobian, eta, effects, QUICK);
        let near = fit(&self.eta);
        if !quick.is_loaded(effects) {
            return near;
        }
        let mut eta = self.eta.clone();
        eta[..quick.nuisance.of_simulation()].fill(0.0);
        let anew = fit(&eta);
        if anew.cost < near.cost { anew } else { near }
    }

    fn base<'p>(&'p self, problem: &'p Problem, bold: bool) -> Base<'p, 'a> {
        Base {
            problem,
            jacobian: &self.jacobian,
            plant: &self.plant,
            eta: &self.eta,
            effects: &self.effects,
            residual: &self.residual,
            bold,
        }
    }
}

/// Returns whether the parameters still mean what the effect's name says.
fn sound(problem: &Problem, placed: &Placed) -> bool {
    placed.effect.sound(&problem.setting, &placed.place, &placed.parameters)
}

/// Fits to whole records what was fitted to the first samples, or only evaluates it there if that step is off.
fn on_whole<'a>(problem: &Problem, fit: Fit<'a>, off: &[Step]) -> Fit<'a> {
    if !off.contains(&Step::Polishing) {
        return polish(problem, fit);
    }
    let plant = problem.nuisance.apply(&problem.plant, &fit.eta);
    let residual = problem.residual(&plant, &fit.eta, &fit.effects, Fineness::FINE);
    let cost = sum_of_squares(&residual) + problem.penalty(&fit.eta);
    Fit { residual, cost, ..fit }
}

/// Returns the same fit with fine steps and derivatives at its own linear model.
pub(crate) fn polish<'a>(problem: &Problem, fit: Fit<'a>) -> Fit<'a> {
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

/// Reconsiders each effect with all others in place: the first was chosen while the others were missing.
fn question<'a>(
    problem: &Problem,
    quick: &Problem,
    mut best: Fit<'a>,
    price: &Price<'_, 'a>,
    candidates: &mut Vec<Candidate<'a>>,
) -> Fit<'a> {
    for place in 0..best.effects.len() {
        let asked = best.effects[place].clone();
        let may = |placed: &Placed| !same(&asked, placed) && price.scope.admits(placed);
        let top = replaced(problem, quick, &best, place, &may, price, candidates);
        if let Some(top) = top.filter(|top| price.of(top) < price.of(&best)) {
            best = top;
        }
    }
    best
}

/// Replaces each effect by a finer law of the same kind if more than noise is left, and if the finer law explains as
/// much of that as a further effect would have to.
fn refined<'a>(
    problem: &Problem,
    quick: &Problem,
    mut best: Fit<'a>,
    price: &Price<'_, 'a>,
    candidates: &mut Vec<Candidate<'a>>,
) -> Fit<'a> {
    let scope = price.scope;
    if !imitates(&best, price) {
        return best;
    }
    for place in 0..best.effects.len() {
        let coarse = best.effects[place].clone();
        let refines = |effect: &dyn Effect| effect.refines() == Some(coarse.effect.name());
        if !scope.library.effects().any(refines) {
            continue;
        }
        let may = |placed: &Placed| refines(placed.effect) && placed.place == coarse.place && scope.allows(placed);
        let top = replaced(problem, quick, &best, place, &may, price, candidates);
        let pays = |top: &Fit| price.of(&best) - price.of(top) > scope.settings.accept_gain;
        if let Some(top) = top.filter(|top| pays(top) && material(problem, scope, &best, top)) {
            best = top;
        }
    }
    best
}

/// Returns the best fit in which the effect at this place of an explanation is replaced by one that `may` take it.
fn replaced<'a>(
    problem: &Problem,
    quick: &Problem,
    best: &Fit<'a>,
    place: usize,
    may: &(dyn Fn(&Placed) -> bool + Sync),
    price: &Price<'_, 'a>,
    candidates: &mut Vec<Candidate<'a>>,
) -> Option<Fit<'a>> {
    let settings = &price.scope.settings;
    let mut others = best.effects.clone();
    others.remove(place);
    let there = |placed: &Placed| others.iter().any(|other| same(other, placed)) || !may(placed);
    let without = Fit { effects: others.clone(), ..best.clone() };
    let counts = [settings.fitted / 2, settings.polished / 2];
    let searched = SearchStage::new(problem, quick, &without, &there, price, counts);
    let (_, fits) = searched.without(problem, quick, &there, price);
    candidates.extend(fits.iter().map(|fit| price.candidate(fit)));
    fits.into_iter().min_by(|a, b| price.of(a).total_cmp(&price.of(b)))
}
