//! The search for the effects that explain the gap, and the judgement of whether they suffice. These are the steps
//! from "Noise" to "Is it enough?" in the book's chapter "How the diagnosis works".

use std::cell::OnceCell;

use crate::case::record::Channels;
use crate::effects::{Library, Observation};
use crate::fit::free_run::{errors, outputs};
use crate::fit::problem::{Fit, Placed, Problem, sum_of_squares};
use crate::fit::refit::{Refit, STEPS, refit};
use crate::judge::explained::{Explained, left};
use crate::judge::offsets::offsets;
use crate::judge::predictability::Unpredicted;
use crate::judge::verdict::{Adequacy, FitFigures, adequacy, outside};
use crate::prepare::{NoiseLevel, Prepared};
use crate::search::closest_law::closest_law;
use crate::search::course::not_of_time;
use crate::search::levels::{by_level, from_known, has_missed};
use crate::search::linear_cause;
use crate::search::modal::{dominant, gain_on_modes};
use crate::search::over_time::over_time;
use crate::search::rules::{Rules, Scope};
use crate::search::shape::{FreeShapeFit, fewer, free_shape, renamed};
use crate::search::stage::{SearchStage, polish};
use crate::search::stepwise::{Search, straighten};
use crate::settings::step::Step;
use crate::simulate::Fineness;
use plid_report::percent;

/// Searches with the ports as locations of internal forces. If that does not suffice, searches again with locations on
/// the modes near whose frequencies the gap lies. `stage` is the first stage of the first search; it is filled if it
/// is empty. `known` are effects from which the search may begin, too.
pub fn explain<'a>(
    ready: Prepared,
    refitted: Refit,
    library: &'a Library,
    rules: &Rules,
    known: &[Placed<'a>],
    stage: &OnceCell<SearchStage<'a>>,
    say: &mut dyn FnMut(String),
) -> Explained<'a> {
    let names = ready.problem.setting.names.clone();
    let settings = ready.problem.settings.search.clone();
    let scope = Scope { library, rules, settings, names, off: ready.off.clone(), bold: false, imperfect: false };
    let first = passes(ready, refitted, &scope, known, stage, say);
    let explained = elsewhere(first, &scope, say).refuse_divergence().refuse_outdone();
    later(explained, &scope, say).refuse_fits_to_noise().refuse_overfit()
}

/// Tries changes over time in place of an explanation that leaves most of the gap of the held-out records.
fn later<'a>(explained: Explained<'a>, scope: &Scope<'_, 'a>, say: &mut dyn FnMut(String)) -> Explained<'a> {
    if !explained.fails_later() {
        return explained;
    }
    say("changes over time".into());
    let ready = &explained.ready;
    let exclude: Vec<String> = scope.rules.exclude.iter().chain(&ready.not_of_time).cloned().collect();
    let rules = Rules { exclude: &exclude, ..*scope.rules };
    let scope = Scope { rules: &rules, names: ready.problem.setting.names.clone(), imperfect: true, ..scope.clone() };
    let fits = over_time(&ready.problem, &explained.quick, &explained.refitted, &scope);
    explained.or_later(fits)
}

/// Searches again with locations on single modes if the first search does not suffice, and returns the second result if
/// it explains more.
fn elsewhere<'a>(first: Explained<'a>, scope: &Scope<'_, 'a>, say: &mut dyn FnMut(String)) -> Explained<'a> {
    if scope.skips(Step::ModalPlaces)
        || first.judged.unknown < scope.settings.inadequate
        || first.judged.left < scope.settings.modal_left
    {
        return first;
    }
    let problem = &first.ready.problem;
    let modes = dominant(problem, &errors(problem, &first.refitted.eta, &[]));
    if modes.is_empty() {
        return first;
    }
    say("places on single modes".into());
    let mut ready = first.ready.clone();
    ready.problem = ready.problem.with_modal_places(&modes);
    let names = ready.problem.setting.names.clone();
    let scope = Scope { names, bold: true, ..scope.clone() };
    // A cause on a mode accounts for much of the gap by itself.
    let least = scope.settings.modal_gain * (first.refitted.cost - first.price());
    if gain_on_modes(&ready.problem, &ready.noise, &first.refitted, &scope) < least {
        return first;
    }
    let mut second = passes(ready, first.refitted.clone(), &scope, &[], &OnceCell::new(), say);
    // The second search may have found other noise, by which its costs are weighted.
    let change = change_of_cost(problem, first.fit(), &second.ready.problem);
    if second.price() + scope.settings.accept_gain > first.price() + change {
        return first;
    }
    let mut candidates = first.found.candidates;
    for candidate in &mut candidates {
        candidate.cost += change;
        candidate.priced += change;
    }
    second.found.add(candidates);
    second
}

/// Returns the change of a fit's cost if the records are weighted as in another problem with the same records.
fn change_of_cost(problem: &Problem, fit: &Fit, other: &Problem) -> f64 {
    let weighted = Problem { whiteners: other.whiteners.clone(), ..problem.clone() };
    let plant = weighted.nuisance.apply(&weighted.plant, &fit.eta);
    let residual = weighted.residual(&plant, &fit.eta, &fit.effects, Fineness::FINE);
    sum_of_squares(&residual) + weighted.penalty(&fit.eta) - fit.cost
}

/// The pass to which a search belongs.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Pass {
    /// The first pass, with the records and their noise as they were prepared.
    First,
    /// A further pass, after an earlier one has revealed a property of the records or their noise that no effect
    /// explains.
    Again,
}

/// Searches and judges in passes. Dropouts, lines whose phase wanders, random forces in a band or errors of the
/// simulation that a pass finds are removed from the records or added to their noise before the next pass.
fn passes<'a>(
    mut ready: Prepared,
    mut refitted: Refit,
    scope: &Scope<'_, 'a>,
    known: &[Placed<'a>],
    stage: &OnceCell<SearchStage<'a>>,
    say: &mut dyn FnMut(String),
) -> Explained<'a> {
    let mut pass = Pass::First;
    // The preparation before the residual of an explanation was treated as an error of the simulation.
    let mut exact: Option<Prepared> = None;
    // The explanation that was found with that preparation.
    let mut earlier: Option<Fit> = None;
    loop {
        let exclude: Vec<String> = scope.rules.exclude.iter().chain(&ready.not_of_time).cloned().collect();
        let rules = Rules { exclude: &exclude, ..*scope.rules };
        let scope = &Scope { rules: &rules, imperfect: ready.widened.is_some(), ..scope.clone() };
        let first = OnceCell::new();
        let stage = if pass == Pass::First { stage } else { &first };
        let mut searched = Searched::new(&mut ready, &refitted, scope, stage, say);
        if pass == Pass::First && !known.is_empty() {
            let known = Fit { effects: known.to_vec(), ..refitted.as_fit() };
            searched.begun(&mut ready.problem, &refitted, &known, scope, say);
        }
        if ready.widened.is_some() {
            searched.completed(&mut ready.problem, &refitted, earlier.as_ref(), scope, say);
        }
        match searched.renew(&mut ready, &mut refitted, scope, pass) {
            Some(renewed) => say(renewed),
            None if searched.refutes_time(&mut ready, &refitted, say) => {
                // The error was derived from an explanation that is now refuted.
                let not_of_time = std::mem::take(&mut ready.not_of_time);
                ready = Prepared { not_of_time, ..exact.take().unwrap_or(ready) };
            }
            None => {
                let mut explained = searched.judged(ready, refitted, scope, say);
                let best = explained.found.best.clone();
                match admit_error(&mut explained, scope) {
                    Some((admitted, before)) => {
                        say(admitted);
                        exact = Some(before);
                        earlier = Some(best);
                    }
                    None => return explained,
                }
                ready = explained.ready;
            }
        }
        refitted = refit(&ready.problem, STEPS);
        pass = Pass::Again;
    }
}

/// The result of a search before it is judged.
struct Searched<'a> {
    /// The problem on the first samples of the records.
    quick: Problem,
    found: Search<'a>,
    /// Free runs of the best explanation.
    simulated: Vec<Channels>,
}

impl<'a> Searched<'a> {
    fn new(
        ready: &mut Prepared,
        refitted: &Refit,
        scope: &Scope<'_, 'a>,
        stage: &OnceCell<SearchStage<'a>>,
        say: &mut dyn FnMut(String),
    ) -> Self {
        let (quick, found) = by_level(&mut ready.problem, &ready.noise, refitted, scope, stage, say);
        let simulated = outputs(&ready.problem, &found.best.eta, &found.best.effects);
        Self { quick, found, simulated }
    }

    /// Searches from known effects, and replaces the result if this explains more.
    fn begun(
        &mut self,
        problem: &mut Problem,
        refitted: &Refit,
        known: &Fit<'a>,
        scope: &Scope<'_, 'a>,
        say: &mut dyn FnMut(String),
    ) {
        if let Some(again) = from_known(problem, &mut self.quick, [known, &self.found.best], refitted, scope, say) {
            let candidates = std::mem::replace(&mut self.found, again).candidates;
            self.found.add(candidates);
            self.simulated = outputs(problem, &self.found.best.eta, &self.found.best.effects);
        }
    }

    /// Completes a search with an error of the simulation: it begins again from the explanation of an earlier pass
    /// without that error, if it has missed that, and tries linear causes.
    fn completed(
        &mut self,
        problem: &mut Problem,
        refitted: &Refit,
        earlier: Option<&Fit<'a>>,
        scope: &Scope<'_, 'a>,
        say: &mut dyn FnMut(String),
    ) {
        if let Some(earlier) = earlier.filter(|earlier| has_missed(&self.found.best, earlier)) {
            self.begun(problem, refitted, earlier, scope, say);
        }
        let plain = Scope { bold: false, ..scope.clone() };
        straighten(problem, &self.quick, &mut self.found, &plain, say);
        self.simulated = outputs(problem, &self.found.best.eta, &self.found.best.effects);
    }

    /// Removes the stochastic effects that the best explanation reveals from the records, or adds them to the noise.
    /// Returns a description if another pass is needed.
    fn renew(&mut self, ready: &mut Prepared, refitted: &mut Refit, scope: &Scope, pass: Pass) -> Option<String> {
        if pass == Pass::First && ready.renew_quantisation(&self.simulated) {
            return Some("samples drop out: repeated without them".into());
        }
        let best = &self.found.best;
        let may_be = !scope.skips(Step::Stochastic) && scope.rules.may_show(scope.library, Observation::Band);
        let lines = if pass == Pass::First { ready.renew_lines(&best.eta, &best.effects, may_be) } else { None };
        if lines.is_none() && !best.effects.is_empty() && ready.renew_noise(&self.simulated) {
            refitted.weigh_anew(&ready.problem);
            self.found.weigh_anew(&ready.problem, &scope.off);
        }
        let what = lines.or_else(|| may_be.then(|| ready.renew_band(&self.simulated)).flatten())?;
        Some(format!("{what}: repeated without it"))
    }

    /// Returns whether an effect that changes over time is refuted as such. Further passes leave this effect out.
    fn refutes_time(&self, ready: &mut Prepared, refitted: &Refit, say: &mut dyn FnMut(String)) -> bool {
        let Some(found) = not_of_time(&ready.problem, refitted, &self.found.best) else { return false };
        say(format!("{} does not change within the records: repeated without it", found.words));
        ready.not_of_time.push(found.effect);
        true
    }

    /// Completes the best explanation with a free shape, if it needs one, and with the last steps of its fit, and
    /// judges its residual.
    fn judged(
        mut self,
        mut ready: Prepared,
        refitted: Refit,
        scope: &Scope<'_, 'a>,
        say: &mut dyn FnMut(String),
    ) -> Explained<'a> {
        let widened = ready.widened.is_some();
        // With an error of the simulation itself, the last digits of a law do not matter.
        let shaped =
            !widened || left(&ready, &refitted, &self.found.best, &ready.noise.rms()) > scope.settings.shape_left;
        let problem = &mut ready.problem;
        let given = problem.nuisance.as_given(&refitted.eta);
        let given_cost = sum_of_squares(&problem.residual(&problem.plant, &given, &[], Fineness::FINE));
        let free = shaped && !scope.skips(Step::FreeShapes);
        let free = if free { self.freed(problem, scope, !widened) } else { None };
        // A free shape was fitted with the simulation's own ports, and has no physical size that these ports could
        // distort.
        problem.nuisance.ports_follow = free.is_none() || problem.few();
        self.found.best = problem.settled(&self.found.best);
        let best_cost = self.found.best.cost;
        let level = ready.noise_level(&self.simulated, best_cost / ready.problem.values());
        let fit = free.as_ref().map_or(&self.found.best, |free| &free.fit);
        let unpredicted = (widened && ready.quiet.is_empty()).then(|| Unpredicted::of(&ready.problem, fit)).flatten();
        let before = refitted.cost.max(given_cost);
        let judging = Judging { ready: &ready, refitted: &refitted, before, level, unpredicted: unpredicted.as_ref() };
        let judged = judging.judge(&mut self.found, free.as_ref(), say);
        let Self { quick, found, .. } = self;
        let mut explained = Explained {
            ready,
            quick,
            refitted,
            found,
            free_shape: free,
            offsets: Vec::new(),
            judged,
            level,
            unpredicted,
            given_cost,
            refused: Vec::new(),
        };
        // A controller responds to a constant at an output, whose mean error therefore differs from this constant.
        let open = explained.ready.problem.plant.controller.is_none();
        if scope.imperfect && open && !explained.fit().effects.is_empty() {
            explained.offsets = offsets(&explained.ready.problem, explained.fit());
            explained.offsets.retain(|offset| scope.allows(offset));
        }
        explained
    }

    /// Returns the best explanation with one free shape, if the free shape gains enough. The explanation is reduced to
    /// `fewer` effects if these explain as much, and the effect with the free shape is named after the nearest law.
    fn freed(&mut self, problem: &Problem, scope: &Scope<'_, 'a>, may_be_fewer: bool) -> Option<FreeShapeFit<'a>> {
        let (quick, found) = (&self.quick, &mut self.found);
        let simpler = if may_be_fewer { fewer(problem, quick, &found.best) } else { None };
        let free = match simpler {
            Some((alone, free)) => {
                found.settle(alone, free.fit.cost);
                free
            }
            // If the effect fails with its own shape and suffices with a free one, the location is right and the shape
            // differs.
            None => free_shape(problem, quick, &found.best)
                .filter(|free| found.best.cost - free.fit.cost > scope.settings.shape_gain_whole)?,
        };
        let present = &found.best.effects[free.which];
        let law = closest_law(problem, &free.fit.effects, present, scope.library, &|placed| scope.allows(placed));
        match law.and_then(|law| renamed(problem, quick, &found.best, &free, law)) {
            Some((alone, nearer)) => {
                found.settle(alone, nearer.fit.cost);
                Some(nearer)
            }
            None => Some(free),
        }
    }
}

/// The reference by which the best explanation is judged.
struct Judging<'j> {
    ready: &'j Prepared,
    refitted: &'j Refit,
    /// Sum of squares without effects.
    before: f64,
    level: NoiseLevel,
    /// The residual of the explanation, if it counts as noise.
    unpredicted: Option<&'j Unpredicted>,
}

impl Judging<'_> {
    fn adequacy(&self, max_prior_z: f64, next_gain: f64, cost: f64) -> Adequacy {
        let Self { ready, before, level, .. } = *self;
        let figures = FitFigures { max_prior_z, next_gain, cost, before, rows: ready.problem.values(), level };
        adequacy(&figures, &ready.problem.settings.judge, &ready.off)
    }

    fn judge<'a>(
        &self,
        found: &mut Search<'a>,
        free: Option<&FreeShapeFit<'a>>,
        say: &mut dyn FnMut(String),
    ) -> Adequacy {
        let problem = &self.ready.problem;
        let settings = &problem.settings.judge;
        let rows = problem.values();
        let best = found.best.clone();
        let straight = problem.max_prior_z(&best.eta);
        let mut judged = self.adequacy(straight, self.next(found), best.cost);
        if let Some(free) = free {
            let more = free.fit.parameters() - best.parameters();
            found.set_free(free.fit.cost, more, rows);
            // A free shape may be correlated with linear parameters and shift them. What these parameters hide is the
            // same in both fits, so the smaller shift counts.
            let freed = self.adequacy(straight.min(problem.max_prior_z(&free.fit.eta)), 0.0, free.fit.cost);
            say(format!("with a free shape: {freed:.2?}"));
            judged.unknown = judged.unknown.min(freed.unknown);
        }
        let fit = free.map_or(&best, |free| &free.fit);
        if self.ready.widened.is_some() {
            let noise = self.unpredicted.map_or_else(|| self.ready.noise.rms(), |noise| noise.rms.clone());
            let left = left(self.ready, self.refitted, fit, &noise);
            say(format!("leaves {left:.3} of the gap beyond noise and limits"));
            judged.left = left * left;
            judged.unknown = match self.unpredicted {
                Some(noise) if best.effects.is_empty() => noise.unknown(settings),
                Some(noise) => outside(left, settings).max(noise.unknown(settings)),
                None if best.effects.is_empty() => settings.most_unknown,
                None => outside(left, settings),
            };
            if let Some(noise) = self.unpredicted {
                say(format!("the inputs predict at most {} of it: it counts as noise", percent(noise.at_most)));
            }
        }
        judged
    }

    /// Returns the gain of the best further entry of the screen. A stage that was screened but not accepted contains
    /// the remaining entries.
    fn next(&self, found: &Search) -> f64 {
        let last = if found.stages.len() > found.best.effects.len() { found.stages.last() } else { None };
        // A parameter that the refit also contains is judged by `max_prior_z`.
        let further = last.and_then(|entries| entries.iter().find(|entry| !entry.placed.effect.is_in_refit()));
        let next = further.map_or(0.0, |entry| entry.gain);
        // If no record shows the noise level, the residual is the estimate of that level.
        let left = found.best.cost / self.ready.problem.values();
        if self.level.seen { next } else { next / left.max(1.0) }
    }
}

/// Largest factor on the stated limits with which the limits count as sufficient. Up to this factor, no cause is
/// needed to account for the changes of the linear parameters.
const SUFFICIENT: f64 = 1.1;

/// Treats the residual as an error of the simulation itself if no explanation leaves only noise. If no earlier pass
/// has done so, returns a description and the preparation before this change.
fn admit_error<'a>(explained: &mut Explained<'a>, scope: &Scope<'_, 'a>) -> Option<(String, Prepared)> {
    if explained.ready.widened.is_some()
        || explained.judged.unknown < explained.ready.problem.settings.search.inadequate
    {
        return None;
    }
    let before = explained.ready.clone();
    let fit = explained.fit().clone();
    let simulated = outputs(&explained.ready.problem, &fit.eta, &fit.effects);
    explained.ready.admit_error(&simulated);
    // With weights by the noise alone, the linear parameters follow every small remainder. Their true error becomes
    // visible only if the weights include the error of the simulation.
    let refitted = refit(&explained.ready.problem, STEPS);
    let mut scale = explained.ready.needed(&refitted.eta, &refitted);
    if scale > SUFFICIENT {
        let needed = with_causes(explained, &refitted, fit, scale, scope).into_iter();
        scale = needed.map(|with| explained.ready.needed(&with.eta, &refitted)).fold(scale, f64::min);
    }
    explained.ready.widen(scale);
    let said = format!(
        "no explanation leaves only noise: repeated with the residual as an error of the simulation and limits \
        {scale:.2} times as wide"
    );
    Some((said, before))
}

/// Returns fits with an error of the simulation and with causes that may account for the changes of the linear
/// parameters. If the parameters are few, one cause shifts most of them, and the error of the simulation becomes
/// visible only with this cause in the model. `fit` is the best explanation without the error of the simulation, and
/// `scale` is the factor by which the limits would have to be widened without a cause.
fn with_causes<'a>(
    explained: &Explained<'a>,
    refitted: &Refit,
    fit: Fit<'a>,
    scale: f64,
    scope: &Scope<'_, 'a>,
) -> Vec<Fit<'a>> {
    let problem = &explained.ready.problem;
    let mut with: Vec<Fit> = Vec::new();
    if problem.few() && !fit.effects.is_empty() {
        with.extend(Some(polish(problem, fit)).filter(|with| with.cost < refitted.cost));
    }
    let mut wide = explained.ready.clone();
    wide.widen(scale);
    let spread = refit(&wide.problem, STEPS);
    let absorbed = linear_cause::fits(&wide.problem, &spread.as_fit(), &spread.jacobian, scope);
    with.extend(absorbed.into_iter().filter(|with| with.cost < spread.cost - scope.settings.absorbed_gain));
    for model in [&refitted.as_fit(), &explained.found.best] {
        with.extend(linear_cause::from_given(problem, model, &refitted.jacobian, scope));
    }
    with
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::case::record::Record;
    use crate::effects::{Place, Setting};
    use crate::fit::candidate::{Candidate, all_same};
    use crate::judge::explained::Refusal;
    use crate::noise::NoiseModel;
    use crate::noise::whiten::Whitener;
    use crate::prepare::{Known, prepare};
    use crate::testing;

    /// If the first explanation is a spring that diverges, the next explanation takes its place, or the refit if there
    /// is none.
    #[test]
    fn what_has_no_bounds_is_refused() {
        let sim = testing::truss(1);
        let case = testing::case(&sim, &sim);
        let ready = prepare(case.model.as_ref().unwrap(), &case.records, &Known::default()).unwrap();
        let refitted = refit(&ready.problem, STEPS);
        let library = Library::standard();
        let rules = Rules { suspects: &[], exclude: &[], without: &[] };
        let explained = || {
            let (ready, refitted) = (ready.clone(), refitted.clone());
            let names = ready.problem.setting.names.clone();
            let settings = ready.problem.settings.search.clone();
            let scope = Scope {
                library: &library,
                rules: &rules,
                settings,
                names,
                off: Vec::new(),
                bold: false,
                imperfect: false,
            };
            let mut explained = passes(ready, refitted, &scope, &[], &OnceCell::new(), &mut |_| {});
            let at = |place, name: &str, parameters| {
                let effect = library.effects().find(|effect| effect.name() == name).unwrap();
                Placed { effect, place, parameters }
            };
            let size = explained.ready.problem.setting.stiffness[0] / explained.ready.problem.setting.d_rms[0].powi(2);
            let unbounded = vec![at(Place::Port(0), "cubic-stiffness", vec![-1e3 * size])];
            let offset = vec![at(Place::Output(0), "sensor-offset", vec![1e-3])];
            explained.found.best = Fit { effects: unbounded.clone(), ..explained.refitted.as_fit() };
            explained.found.candidates.clear();
            for (effects, gain) in [(unbounded, 20.0), (offset, 10.0)] {
                let cost = explained.refitted.cost - gain;
                explained.found.candidates.push(Candidate { effects, cost, priced: cost });
            }
            explained
        };
        let mut next = explained().refuse_divergence();
        assert_eq!(next.found.best.effects[0].effect.name(), "sensor-offset");
        let (refused, why) = next.refused.remove(0);
        assert_eq!(refused[0].effect.name(), "cubic-stiffness");
        assert!(matches!(&why, Refusal::Diverges(record) if record.starts_with("random")), "{why:?}");
        assert!(next.judged.unknown >= crate::settings::JudgeSettings::default().most_unknown);
        let mut alone = explained();
        alone.found.candidates.truncate(1);
        let alone = alone.refuse_divergence();
        assert!(alone.found.best.effects.is_empty() && !alone.refused.is_empty());
    }

    /// A gain that drifts replaces an explanation that leaves most of the gap on the held-out record.
    #[test]
    fn a_later_record_shows_a_change_over_time() {
        let sim = testing::truss(1);
        let mut case = testing::case(&sim, &sim);
        for (k, record) in case.records.iter_mut().enumerate().skip(1) {
            let gain = |at: usize| 1.0 - 0.03 * (record.start_s + at as f64 / testing::RATE);
            let mut drifting = record.u.clone();
            drifting[0].iter_mut().enumerate().for_each(|(at, u)| *u *= gain(at));
            record.y = testing::run(&sim, &drifting);
            let std = record.y.iter().map(|y| 0.002 * crate::case::record::rms(y)).collect::<Vec<f64>>();
            testing::add_noise(&mut record.y, 40 + k as u64, &std);
        }
        let mut ready = prepare(case.model.as_ref().unwrap(), &case.records, &Known::default()).unwrap();
        ready.widen(1.0);
        let refitted = refit(&ready.problem, STEPS);
        let library = Library::standard();
        let exclude = testing::laws::without(&library, &["sensor-offset"]);
        let (names, settings) = (ready.problem.setting.names.clone(), ready.problem.settings.search.clone());
        let few = Rules { suspects: &[], exclude: &exclude, without: &[] };
        let all = Rules { exclude: &[], ..few };
        let scope =
            Scope { library: &library, rules: &few, settings, names, off: vec![], bold: false, imperfect: true };
        let found = passes(ready, refitted, &scope, &[], &OnceCell::new(), &mut |_| {});
        assert!(found.fails_later());
        let found = later(found, &Scope { rules: &all, ..scope }, &mut |_| {});
        let best = &found.fit().effects[0];
        assert_eq!((best.effect.name(), &best.place), ("actuator-gain-drift", &Place::Input(0)));
        assert!((best.parameters[0] / -0.03 - 1.0).abs() < 0.05, "{:?}", best.parameters);
        assert!(!found.fails_later());
    }

    /// If the first explanation predicts held-out records worse than no effect, the next one that predicts them better
    /// takes its place. If there is none, the first one is kept.
    #[test]
    fn what_held_out_records_refute_is_replaced() {
        let sim = testing::truss(1);
        let mut case = testing::case(&sim, &sim);
        let size = crate::case::record::rms(case.records[1].y[0].iter());
        case.records.iter_mut().flat_map(|record| &mut record.y[0]).for_each(|y| *y += 0.2 * size);
        let mut ready = prepare(case.model.as_ref().unwrap(), &case.records, &Known::default()).unwrap();
        ready.widen(1.0);
        assert!(!ready.held_out.is_empty());
        let refitted = refit(&ready.problem, STEPS);
        let library = Library::standard();
        let rules = Rules { suspects: &[], exclude: &[], without: &[] };
        let (names, settings) = (ready.problem.setting.names.clone(), ready.problem.settings.search.clone());
        let scope =
            Scope { library: &library, rules: &rules, settings, names, off: Vec::new(), bold: false, imperfect: true };
        let found = passes(ready, refitted, &scope, &[], &OnceCell::new(), &mut |_| {});
        assert_eq!(found.fit().effects[0].effect.name(), "sensor-offset");
        let right = found.found.best.effects.clone();
        let mut found = found.refuse_overfit();
        assert!(found.refused.is_empty() && all_same(&found.found.best.effects, &right));
        let effect = library.effects().find(|effect| effect.name() == "sensor-gain").unwrap();
        let without = found.refitted.as_fit();
        let wrong = |gain: f64| {
            let effects = vec![Placed { effect, place: Place::Output(0), parameters: vec![gain] }];
            Fit { effects, ..without.clone() }
        };
        found.offsets.clear();
        found.found.candidates.retain(|candidate| all_same(&candidate.effects, &right));
        assert!(!found.found.candidates.is_empty());
        let candidates = found.found.candidates.clone();
        // If an explanation has left only noise, a slightly worse prediction may be due to chance.
        for (gain, imperfect, replaced) in
            [(1.5, true, true), (1.05, true, true), (1.5, false, true), (1.05, false, false)]
        {
            found.found.best = wrong(gain);
            found.ready.widened = imperfect.then_some(1.0);
            found.found.candidates.clone_from(&candidates);
            found.refused.clear();
            found = found.refuse_overfit();
            assert_eq!(all_same(&found.found.best.effects, &right), replaced, "{gain} {imperfect}");
            let expected = |(effects, why): &(Vec<Placed>, Refusal)| {
                all_same(effects, &wrong(gain).effects) && *why == Refusal::Overfits
            };
            assert_eq!(found.refused.first().map(expected), replaced.then_some(true), "{gain} {imperfect}");
        }
        found.found.best = wrong(1.5);
        found.ready.widened = Some(1.0);
        found.refused.clear();
        found.found.candidates.clear();
        let alone = found.refuse_overfit();
        assert!(all_same(&alone.found.best.effects, &wrong(1.5).effects) && alone.refused.is_empty());
    }

    /// An explanation that takes the place of a refused one is settled, so its interval is as wide as any other.
    #[test]
    fn what_takes_over_is_settled() {
        let library = Library::standard();
        let size: fn(&Setting) -> Vec<f64> = |setting| vec![0.02 * setting.force[0] / setting.d_rms[0].powi(3)];
        let ready = testing::laws::prepared(&[("cubic-stiffness", size)]);
        let refitted = refit(&ready.problem, STEPS);
        let exclude = testing::laws::without(&library, &["cubic-stiffness"]);
        let rules = Rules { suspects: &[], exclude: &exclude, without: &[] };
        let (names, settings) = (ready.problem.setting.names.clone(), ready.problem.settings.search.clone());
        let scope =
            Scope { library: &library, rules: &rules, settings, names, off: vec![], bold: false, imperfect: false };
        let mut explained = passes(ready, refitted, &scope, &[], &OnceCell::new(), &mut |_| {});
        let right = explained.found.best.clone();
        assert_eq!((right.effects[0].effect.name(), &right.effects[0].place), ("cubic-stiffness", &Place::Input(0)));
        let setting = &explained.ready.problem.setting;
        let wild = -1e3 * setting.stiffness[0] / setting.d_rms[0].powi(2);
        let wild = testing::laws::at(&library, "cubic-stiffness", Place::Port(0), vec![wild]);
        explained.found.best = Fit { effects: vec![wild], ..explained.refitted.as_fit() };
        let next = explained.refuse_divergence();
        assert!(!next.refused.is_empty() && all_same(&next.found.best.effects, &right.effects));
        let wider = next.found.best.covariance[(0, 0)] / right.covariance[(0, 0)];
        assert!((wider - 1.0).abs() < 0.05, "{wider}");
    }

    /// With noise of twice the size, a sum of squares is a quarter of the former one.
    #[test]
    fn a_cost_is_compared_under_the_same_noise() {
        let problem = testing::laws::prepared(&[]).problem;
        let weighted = |factor: f64| {
            let noise = NoiseModel::declared(&problem.plant, &[factor * 1e-3; 2], &[0.0; 2]);
            let whitener = |record: &Record| Whitener::new(record, &noise, problem.plant.rate, vec![Vec::new(); 2]);
            Problem { whiteners: problem.records.iter().map(whitener).collect(), ..problem.clone() }
        };
        let (first, second) = (weighted(1.0), weighted(2.0));
        let fit = refit(&first, STEPS).as_fit();
        let expected = -0.75 * sum_of_squares(&fit.residual);
        assert!((change_of_cost(&first, &fit, &second) / expected - 1.0).abs() < 1e-6);
        assert!(change_of_cost(&first, &fit, &first).abs() < 1e-9 * fit.cost);
    }
}
