//! The search: effects are screened, the best entries are fitted with the simulator and weighted again by the
//! residual of the best fit, and a further effect is then searched for in its presence.

use crate::case::record::Channels;
use crate::effects::Effect;
use crate::fit::candidate::{all_same, in_words, same};
use crate::fit::problem::Placed;
use crate::in_loop::judge::{Evidence, evidence, is_parameter};
use crate::in_loop::pairs::Paired;
use crate::in_loop::problem::{Fit, Problem};
use crate::in_loop::runs::Runs;
use crate::in_loop::screen::Entry;
use crate::judge::gap;
use crate::search::rules::Scope;
use crate::settings::LoopSettings;

/// Smallest number of samples of a record on which effects are screened.
const SHORTEST: usize = 64;

/// Gaps relative to the output below which a record may be screened, in order of preference. The trace of an effect
/// is a first-order approximation, which becomes less accurate as the gap grows.
const NEAR: [f64; 2] = [0.5, 1.0];

/// The result of a search.
pub(super) struct Found<'a> {
    /// The simulator with its parameters fitted within their limits, without effects.
    pub refit: Fit<'a>,
    /// All fitted explanations, the best first, weighted by the residual of the best one.
    pub fits: Vec<Fit<'a>>,
    /// The screens, in order.
    pub screens: Vec<Vec<Entry<'a>>>,
    /// The record of the first screen, and the number of its first samples that were screened.
    pub first_head: Option<(usize, usize)>,
}

impl<'a> Found<'a> {
    /// Weights all explanations with the current weights of the problem.
    fn weigh_anew(&mut self, problem: &Problem<'a>) {
        self.fits.iter_mut().chain([&mut self.refit]).for_each(|fit| *fit = fit.weighted_anew(problem));
    }
}

/// The search and its bounds.
pub(super) struct Search<'s, 'a> {
    /// The vocabulary.
    pub effects: Vec<&'a dyn Effect>,
    /// The effects and locations that may be named.
    pub scope: Scope<'s, 'a>,
    /// The settings.
    pub settings: LoopSettings,
    /// Standard deviation of the noise of each output (p).
    pub noise: Vec<f64>,
    /// The smallest gap beyond the noise that matters, relative to the output.
    pub material: f64,
}

impl<'a> Search<'_, 'a> {
    /// Searches for explanations of a problem. Work that the bounds on the runs do not allow is recorded in `runs` as
    /// left out.
    pub fn run(
        &self,
        problem: &mut Problem<'a>,
        runs: &mut Runs,
        given: &[Channels],
        say: &mut dyn FnMut(String),
    ) -> Found<'a> {
        let none = vec![0.0; problem.nuisances.len()];
        let as_given = problem.as_is(Vec::new(), none, given.to_vec());
        let mut refit = as_given.clone();
        if !problem.nuisances.is_empty() {
            say("fitting the parameters within their limits".into());
            refit = problem.fit(runs, as_given, self.settings.steps, self.gain(problem));
        }
        let mut found = Found { fits: vec![refit.clone()], refit, screens: Vec::new(), first_head: None };
        // An effect that does not suffice on its own is kept, because two effects may mask each other.
        let mut insufficient: Option<Fit> = None;
        for stage in 0..self.settings.effects {
            let standing = found.fits[0].clone();
            let beside = insufficient.take().unwrap_or_else(|| standing.clone());
            let least = self.least(problem, &found);
            let what = || if stage == 0 { "the search for effects" } else { "the search for a further effect" };
            if self.left(problem, &standing) < least || !runs.may(1, problem.samples(), || what().into()) {
                break;
            }
            say(format!("stage {}: screening effects", stage + 1));
            if stage > 0 {
                problem.weigh_for_search(&self.noise, &standing.simulated);
                found.weigh_anew(problem);
            }
            let doubtful = self.doubtful(problem, &found);
            let mut tried = Vec::new();
            if stage == 1 && self.left(problem, &standing) >= doubtful {
                tried = self.stage_of_pair(problem, runs, &mut found, say);
            }
            // A pair that fits the first samples of one record may fail on all other data.
            if tried.iter().all(|fit| self.left(problem, fit) >= doubtful) {
                tried.extend(self.stage(problem, runs, &beside, None, &mut found, say));
            }
            let best = tried.iter().min_by(|a, b| a.cost.total_cmp(&b.cost)).cloned();
            found.fits.extend(tried);
            let Some(best) = best else { break };
            let accepted = self.accepts(problem, &best, &standing.weighted_anew(problem), least);
            if accepted {
                self.weigh(problem, runs, &mut found, &best);
            } else if stage > 0 {
                problem.weigh_by(&self.noise, &standing);
                found.weigh_anew(problem);
            }
            self.best_first(problem, &mut found.fits);
            if !accepted {
                self.keep_first(&mut found.fits, &standing);
                if self.left(problem, &standing) < self.material {
                    break;
                }
                insufficient = Some(best);
                continue;
            }
            say(format!("{}, {} runs so far", self.words(problem, &found.fits[0]), runs.calls().runs));
        }
        found
    }

    /// Returns the decrease of the cost below which a fit ends.
    pub(super) fn gain(&self, problem: &Problem) -> f64 {
        self.settings.fit_gain * problem.rows() as f64
    }

    /// Fits a pair of effects that explains most of the gap, and its rivals, if the first screen shows such a pair.
    fn stage_of_pair(
        &self,
        problem: &Problem<'a>,
        runs: &mut Runs,
        found: &mut Found<'a>,
        say: &mut dyn FnMut(String),
    ) -> Vec<Fit<'a>> {
        let Some(pair) = self.paired(problem, runs, found, say) else { return Vec::new() };
        let stronger = vec![pair.stronger.clone()];
        let Some(stronger) = self.begun(problem, runs, stronger, &found.refit.eta) else { return Vec::new() };
        self.stage(problem, runs, &stronger, Some(pair), found, say)
    }

    /// Returns the remaining gap, relative to the output, above which an explanation with a further effect is
    /// doubtful.
    pub(super) fn doubtful(&self, problem: &Problem, found: &Found) -> f64 {
        self.settings.doubtful * self.left(problem, &found.refit).min(1.0)
    }

    /// Screens effects in the presence of an explanation, and fits the best entries. In the presence of the stronger
    /// effect of the best pair, the traces of the first screen determine the best entries.
    fn stage(
        &self,
        problem: &Problem<'a>,
        runs: &mut Runs,
        beside: &Fit<'a>,
        paired: Option<Paired<'a>>,
        found: &mut Found<'a>,
        say: &mut dyn FnMut(String),
    ) -> Vec<Fit<'a>> {
        let (record, heads) = self.heads(problem, beside);
        let quick = problem.head(record, heads[0]);
        let start = quick.on_head(beside, record);
        // Half of the remaining runs are reserved for the fits.
        let half = runs.bounds().half(runs.spent());
        let doubtful = self.doubtful(problem, found);
        let (entries, stepped) = match &paired {
            Some(paired) => (paired.entries.clone(), self.settings.fitted),
            None => (self.screen(&quick, runs, &start, half, say), self.settings.stepped),
        };
        found.first_head.get_or_insert((record, heads[0]));
        let mut tried = self.tried(&quick, runs, &start, (&entries, stepped), say);
        for effects in paired.into_iter().flat_map(|paired| paired.pairs) {
            if let Some(fit) = self.begun(&quick, runs, effects, &beside.eta) {
                keep_better(&mut tried, fit);
            }
        }
        self.best_first(&quick, &mut tried);
        if !start.effects.is_empty() {
            tried = self.exchange(&quick, runs, tried, (doubtful, half), say);
        }
        let mut leading = self.leading(&quick, tried);
        for samples in &heads[1..] {
            leading = self.grown(&problem.head(record, *samples), runs, &leading, &start.eta, say);
        }
        let mut fits: Vec<Fit> = Vec::new();
        for effects in leading {
            let Some(start) = self.begun(problem, runs, effects, &beside.eta) else { continue };
            let fit = problem.fit(runs, start, self.settings.steps, self.gain(problem));
            say(format!("fitted {}, {} runs so far", self.words(problem, &fit), runs.calls().runs));
            if self.is_sound(problem, &fit) {
                fits.push(fit);
            }
        }
        found.screens.push(entries);
        fits
    }

    /// Returns the record on which effects are screened, and the numbers of its first samples that are fitted in turn.
    ///
    /// It is the loudest record with a gap below half of the output, or else the loudest one with a gap below the
    /// output. If the gap exceeds the output in all records, the loudest one is shortened until its gap is smaller
    /// than the output. Explanations that fit its first samples are then fitted to increasing numbers of samples.
    pub(super) fn heads(&self, problem: &Problem<'a>, beside: &Fit<'a>) -> (usize, Vec<usize>) {
        let levels: Vec<f64> = problem.records.iter().map(crate::case::record::Record::level).collect();
        let mut order: Vec<usize> = (0..levels.len()).filter(|k| levels[*k] > 0.0).collect();
        order.sort_by(|&a, &b| levels[b].total_cmp(&levels[a]));
        let gap = |k: usize| gap::of_driven(&problem.records[k..=k], &beside.simulated[k..=k]);
        let floor = |k: usize| gap::floor_over(&self.noise, &[problem.records[k].y.as_slice()]);
        let shows = |k: usize| gap(k).powi(2) - floor(k).powi(2) > self.material.powi(2);
        let whole = |k: usize| problem.records[k].samples().min(self.settings.screened_samples);
        for near in NEAR {
            if let Some(record) = order.iter().copied().find(|&k| gap(k) < near && shows(k)) {
                return (record, vec![whole(record)]);
            }
        }
        let record = order.first().copied().unwrap_or(0);
        let near = |samples: usize| {
            let head = problem.head(record, samples);
            gap::of_driven(&head.records, &head.on_head(beside, record).simulated) < 1.0
        };
        let [mut short, mut long] = [SHORTEST.min(whole(record)), whole(record)];
        if !near(short) {
            return (record, vec![long]);
        }
        // The length is found to within a few samples, because a single contact with a stop may move a simulation far
        // from the measurement.
        while long - short > SHORTEST / 8 {
            let middle = (short + long) / 2;
            if near(middle) {
                short = middle;
            } else {
                long = middle;
            }
        }
        let mut heads = vec![short];
        while heads[heads.len() - 1] < whole(record) {
            heads.push((2 * heads[heads.len() - 1]).min(whole(record)));
        }
        (record, heads)
    }

    /// Fits explanations in a few steps to more samples than those on which they were found, and drops those that are
    /// far behind the best.
    fn grown(
        &self,
        head: &Problem<'a>,
        runs: &mut Runs,
        leading: &[Vec<Placed<'a>>],
        eta: &[f64],
        say: &mut dyn FnMut(String),
    ) -> Vec<Vec<Placed<'a>>> {
        let mut fits = Vec::new();
        for effects in leading {
            let Some(start) = self.begun(head, runs, effects.clone(), eta) else { continue };
            let fit = head.fit(runs, start, self.settings.quick_steps, self.gain(head));
            let samples = head.records[0].samples();
            say(format!("{samples} samples: {}, {} runs so far", self.words(head, &fit), runs.calls().runs));
            fits.push(fit);
        }
        self.leading(head, fits)
    }

    /// Returns the start of a fit, unless the bounds do not allow its runs or the simulator fails.
    pub(super) fn begun(
        &self,
        problem: &Problem<'a>,
        runs: &mut Runs,
        effects: Vec<Placed<'a>>,
        eta: &[f64],
    ) -> Option<Fit<'a>> {
        let at = [(effects, eta.to_vec())];
        let names = &problem.setting.names;
        let what = || format!("the fit of {} to {} samples", in_words(&at[0].0, names), problem.samples());
        if !problem.may_simulate(runs, &at, what) {
            return None;
        }
        let [(effects, eta)] = at;
        let simulated = problem.simulate(runs, &effects, &eta).ok()?;
        Some(problem.as_is(effects, eta, simulated))
    }

    /// Returns the effects of the fits with the smallest residuals, without those that are far behind the best.
    fn leading(&self, problem: &Problem<'a>, mut fits: Vec<Fit<'a>>) -> Vec<Vec<Placed<'a>>> {
        self.best_first(problem, &mut fits);
        let nearest = fits.iter().map(|fit| self.left(problem, fit)).fold(f64::INFINITY, f64::min);
        fits.retain(|fit| self.left(problem, fit) <= self.settings.far * nearest.max(self.material));
        fits.into_iter().take(self.settings.fitted).map(|fit| fit.effects).collect()
    }

    /// Runs the best starts of each effect at each place at three sizes on the first samples of one record, and fits
    /// the leading ones in a few steps; at most `most` of these fits may take runs. Returns the best of these fits,
    /// one for each effect at each place, the best first.
    fn tried(
        &self,
        quick: &Problem<'a>,
        runs: &mut Runs,
        start: &Fit<'a>,
        (entries, most): (&[Entry<'a>], usize),
        say: &mut dyn FnMut(String),
    ) -> Vec<Fit<'a>> {
        // The best start of each effect at each place comes first, then the second best of each.
        let rank = |at: usize| entries[..at].iter().filter(|other| same(&other.placed, &entries[at].placed)).count();
        let mut order: Vec<(usize, usize)> = (0..entries.len()).map(|at| (rank(at), at)).collect();
        order.retain(|(rank, _)| *rank < self.settings.starts);
        order.sort_unstable();
        let chosen = order.iter().take(self.settings.tried).map(|(_, at)| &entries[*at]);
        let mut sized: Vec<Fit> = Vec::new();
        for entry in chosen {
            sized.extend(self.sized(quick, runs, &start.effects, &start.eta, entry));
        }
        self.best_first(quick, &mut sized);
        let mut fits: Vec<Fit> = Vec::new();
        let mut stepped = 0;
        for from in sized {
            let mut fit = from;
            let before = runs.calls().runs;
            if stepped < most {
                fit = quick.fit(runs, fit, self.settings.quick_steps, self.gain(quick));
                stepped += usize::from(runs.calls().runs > before);
            }
            say(format!("tried {}, {} runs so far", self.words(quick, &fit), runs.calls().runs));
            keep_better(&mut fits, fit);
        }
        self.best_first(quick, &mut fits);
        fits
    }

    /// Sorts explanations by their cost including the price.
    pub(super) fn best_first(&self, problem: &Problem, fits: &mut [Fit]) {
        fits.sort_by(|a, b| self.priced(problem, a).total_cmp(&self.priced(problem, b)));
    }

    /// Runs an entry at three sizes together with other effects, and returns the best explanation.
    pub(super) fn sized(
        &self,
        quick: &Problem<'a>,
        runs: &mut Runs,
        beside: &[Placed<'a>],
        eta: &[f64],
        entry: &Entry<'a>,
    ) -> Option<Fit<'a>> {
        let with = |placed: Placed<'a>| (beside.iter().cloned().chain([placed]).collect(), eta.to_vec());
        let sizes: Vec<(Vec<Placed>, Vec<f64>)> = entry.sizes(quick).into_iter().map(with).collect();
        self.best_of(quick, runs, sizes)
    }

    /// Runs several explanations with the same effects and returns the best one.
    pub(super) fn best_of(
        &self,
        quick: &Problem<'a>,
        runs: &mut Runs,
        sizes: Vec<(Vec<Placed<'a>>, Vec<f64>)>,
    ) -> Option<Fit<'a>> {
        let names = &quick.setting.names;
        if !quick.may_simulate(runs, &sizes, || format!("a trial of {}", in_words(&sizes[0].0, names))) {
            return None;
        }
        let simulated = quick.simulate_all(runs, &sizes);
        let fits = sizes
            .into_iter()
            .zip(simulated)
            .filter_map(|((effects, eta), simulated)| Some(quick.as_is(effects, eta, simulated.ok()?)));
        fits.min_by(|a, b| a.cost.total_cmp(&b.cost))
    }

    /// Weights all explanations by the residual of the best one, and fits the leading ones again.
    pub(super) fn weigh(&self, problem: &mut Problem<'a>, runs: &mut Runs, found: &mut Found<'a>, best: &Fit<'a>) {
        problem.weigh_by(&self.noise, best);
        found.weigh_anew(problem);
        self.best_first(problem, &mut found.fits);
        let rivals = self.settings.refined.min(found.fits.len());
        for k in 0..rivals {
            if found.fits[k].effects.is_empty() {
                continue;
            }
            found.fits[k] = problem.fit(runs, found.fits[k].clone(), self.settings.steps, self.gain(problem));
        }
    }

    /// Returns whether a further effect is needed: the records clearly prefer it, and it closes a sufficient share of
    /// the remaining gap.
    fn accepts(&self, problem: &Problem, fit: &Fit, before: &Fit, least: f64) -> bool {
        let Evidence { difference, z } = evidence(problem, fit, before);
        let price = self.price(problem, fit) - self.price(problem, before);
        let [after, before] = [fit, before].map(|fit| self.left(problem, fit));
        let closes = (before * before - after * after).max(0.0).sqrt();
        let enough = closes > least && 1.0 - after / before > self.settings.least_closed;
        difference > price && z > self.settings.clear && enough
    }

    /// Returns the smallest gap, in amplitude, that a further effect must close.
    fn least(&self, problem: &Problem, found: &Found) -> f64 {
        let least = self.settings.least_material * self.material;
        let is_first = found.fits[0].effects.is_empty();
        if is_first { least } else { least.max(self.settings.least_of_gap * self.left(problem, &found.refit).min(1.0)) }
    }

    /// Returns the gap of the fitted records beyond the noise, relative to the outputs.
    pub fn left(&self, problem: &Problem, fit: &Fit) -> f64 {
        let driven = problem.records.iter().filter(|record| record.is_driven());
        let measured: Vec<&[Vec<f64>]> = driven.map(|record| record.y.as_slice()).collect();
        let floor = gap::floor_over(&self.noise, &measured);
        let gap = gap::of_driven(&problem.records, &fit.simulated);
        (gap * gap - floor * floor).max(0.0).sqrt()
    }

    /// Returns whether the records can show all effects of an explanation.
    pub(super) fn is_sound(&self, problem: &Problem, fit: &Fit) -> bool {
        fit.effects.iter().all(|placed| placed.effect.sound(&problem.setting, &placed.place, &placed.parameters))
    }

    /// Returns the price of an explanation, in units of twice the log likelihood: that of its parameters (Schwarz,
    /// Ann. Stat. 6, 1978) and that of the choice among all effects. A parameter that the simulator declares counts
    /// as suspected, because its engineer thereby states that it may be wrong.
    pub fn price(&self, problem: &Problem, fit: &Fit) -> f64 {
        let choices = self.effects.len().max(2) as f64;
        let of = |placed: &Placed| {
            if is_parameter(&placed.place) { self.scope.settings.suspect_bonus } else { self.scope.bonus(placed) }
        };
        let bonus: f64 = fit.effects.iter().map(of).sum();
        fit.parameters() as f64 * (problem.rows() as f64).ln() + 2.0 * fit.effects.len() as f64 * choices.ln() - bonus
    }

    /// Returns the cost of an explanation including its price.
    pub fn priced(&self, problem: &Problem, fit: &Fit) -> f64 {
        fit.cost + self.price(problem, fit)
    }

    /// Puts an explanation first, regardless of its cost.
    fn keep_first(&self, fits: &mut [Fit<'a>], first: &Fit<'a>) {
        if let Some(at) = fits.iter().position(|fit| all_same(&fit.effects, &first.effects)) {
            fits[..=at].rotate_right(1);
        }
    }

    pub(super) fn words(&self, problem: &Problem, fit: &Fit) -> String {
        let effects = in_words(&fit.effects, &problem.setting.names);
        format!("{effects}: leaves {} of the output", plid_report::percent(self.left(problem, fit)))
    }
}

/// Adds a fit. If there is one with the same effects, the better of the two is kept.
fn keep_better<'a>(fits: &mut Vec<Fit<'a>>, fit: Fit<'a>) {
    match fits.iter_mut().find(|other| all_same(&other.effects, &fit.effects)) {
        Some(other) if other.cost <= fit.cost => {}
        Some(other) => *other = fit,
        None => fits.push(fit),
    }
}
