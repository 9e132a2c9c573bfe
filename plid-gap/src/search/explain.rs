//! Steps 3 to 8: which effects explain the gap, and whether they suffice.

use std::cell::OnceCell;

use crate::case::record::{Channels, Record};
use crate::effects::{Effect, Library, Names};
use crate::fit::problem::{Fit, Placed, Problem, sum_of_squares};
use crate::fit::refit::{Refit, STEPS, clipped, refit};
use crate::judge::gap::{self, Blocks};
use crate::judge::locate::error;
use crate::judge::shrink::run;
use crate::judge::verdict::{Adequacy, adequacy, least_unknown, outside};
use crate::prepare::{NoiseLevel, Prepared};
use crate::search::closest_law::closest_law;
use crate::search::modal::dominant;
use crate::search::shape::{Bent, bent, fewer, renamed};
use crate::search::stepwise::{Candidate, Search, Turn, all_same, polish, search, straighten};
use crate::search::stochastic::is_unseen;
use crate::settings::step::Step;
use crate::settings::thresholds::{
    ACCEPT, DOUBTFUL, ELSEWHERE, HEAD, INADEQUATE, MOST_UNKNOWN, SHAPE_DIFFERS, SHAPED, WORTH,
};
use crate::simulate::Fineness;

/// Explanations without bounds that are refused before the refit takes their place.
const MOST_REFUSED: usize = 5;

/// What the engineer knows, as effects or locations.
pub struct Rules<'r> {
    /// What is expected.
    pub suspects: &'r [String],
    /// What cannot be.
    pub exclude: &'r [String],
    /// Effects of the library that the diagnosis does not know.
    pub without: &'r [String],
}

/// What a suspect is worth: odds of 50 : 1 against an entry that nobody named.
const SUSPECTED: f64 = 8.0;

impl Rules<'_> {
    /// Whether it knows an effect.
    pub fn knows(&self, effect: &dyn Effect) -> bool {
        !self.without.iter().any(|name| name == effect.name())
    }

    /// Whether an effect may be named at all.
    pub fn may_be(&self, library: &Library, name: &str) -> bool {
        library.get(name).is_some_and(|effect| self.knows(effect)) && !self.exclude.iter().any(|word| word == name)
    }

    /// Whether an effect may be named at a place.
    pub fn allow(&self, placed: &Placed, names: &Names) -> bool {
        self.knows(placed.effect) && !self.exclude.iter().any(|word| means(word, placed, names))
    }

    /// What a suspicion is worth, in twice the log likelihood.
    fn bonus(&self, placed: &Placed, names: &Names) -> f64 {
        if self.suspects.iter().any(|word| means(word, placed, names)) { SUSPECTED } else { 0.0 }
    }
}

fn means(word: &str, placed: &Placed, names: &Names) -> bool {
    word == placed.effect.name() || word == placed.place.location(names)
}

/// What was found, and how far it suffices.
pub struct Explained<'a> {
    /// What was fitted, as the search left it: scales of inferred ports, noise renewed, places on modes.
    pub ready: Prepared,
    /// The heads of the records.
    pub quick: Problem,
    /// The bounded refit.
    pub refitted: Refit,
    /// Explanations.
    pub found: Search<'a>,
    /// The best explanation with one effect's shape set free, where its own does not suffice.
    pub bent: Option<Bent<'a>>,
    /// What the best leaves.
    pub judged: Adequacy,
    /// Of the noise.
    pub level: NoiseLevel,
    /// Sum of squares of the simulation as given.
    pub given_cost: f64,
    /// An explanation whose free run of a record has no bounds, with that record: it was refused.
    pub diverged: Option<(Vec<Placed<'a>>, String)>,
}

impl<'a> Explained<'a> {
    /// The model that predicts: the best explanation, with a free shape where one is needed.
    pub fn fit(&self) -> &Fit<'a> {
        self.bent.as_ref().map_or(&self.found.best, |bent| &bent.fit)
    }

    /// RMS of each output's noise, lines that wander among it; where nothing shows it, no more than what is left.
    pub fn noise_rms(&self) -> Vec<f64> {
        let noise = self.ready.noise.rms().into_iter().map(|rms| rms * self.level.factor.min(1.0).sqrt());
        let lines = |o: usize| self.ready.wandering.iter().map(|line| line.rms[o].powi(2)).sum::<f64>();
        noise.enumerate().map(|(o, noise)| (noise * noise + lines(o)).sqrt()).collect()
    }

    /// The record, held out or not, whose free run has no bounds. Without effects every one has them: the audit refuses what is unstable.
    fn unbounded(&self) -> Option<&Record> {
        if self.fit().effects.is_empty() {
            return None;
        }
        let problem = &self.ready.problem;
        let plant = problem.nuisance.apply(&problem.plant, &self.fit().eta);
        let actions = problem.actions(&self.fit().effects);
        let finite = |record: &&Record| run(&plant, &actions, record).iter().flatten().all(|y| y.is_finite());
        problem.records.iter().chain(&self.ready.held_out).find(|record| !finite(record))
    }

    /// In place of an explanation whose free run of a record has no bounds the next one that has them, or the refit.
    fn refuse_divergence(mut self) -> Self {
        let mut tries = MOST_REFUSED;
        while let Some(name) = self.unbounded().map(|record| record.name.clone()) {
            self.bent = None;
            self.judged.unknown = MOST_UNKNOWN;
            let problem = &self.ready.problem;
            let found = &mut self.found;
            found.candidates.retain(|c| !all_same(&c.effects, &found.best.effects));
            tries -= 1;
            let cheaper = |c: &&Candidate| tries > 0 && !c.effects.is_empty() && c.priced < self.refitted.cost;
            // From the refit: what had no bounds leaves linear parameters that lean on it.
            let anew =
                |c: &Candidate<'a>| polish(problem, Fit { effects: c.effects.clone(), ..self.refitted.as_fit() });
            let next = found.candidates.iter().find(cheaper).map(anew);
            let refused = std::mem::replace(&mut found.best, next.unwrap_or_else(|| self.refitted.as_fit()));
            self.diverged.get_or_insert((refused.effects, name));
        }
        self
    }

    fn price(&self) -> f64 {
        self.found.candidates.first().map_or(f64::INFINITY, |candidate| candidate.priced)
    }
}

/// Searches, with the struts as places of internal forces; where that does not suffice, with the modes about which the gap lies too. `turn` keeps the
/// first turn of the first search, or has it.
pub fn explain<'a>(
    ready: Prepared,
    refitted: Refit,
    library: &'a Library,
    rules: &Rules,
    turn: &OnceCell<Turn<'a>>,
    say: &mut dyn FnMut(String),
) -> Explained<'a> {
    let first = once(ready, refitted, library, rules, false, Some(turn), say);
    elsewhere(first, library, rules, say).refuse_divergence()
}

/// Where the first search does not suffice, a second with places on single modes, if that one explains more.
fn elsewhere<'a>(
    first: Explained<'a>,
    library: &'a Library,
    rules: &Rules,
    say: &mut dyn FnMut(String),
) -> Explained<'a> {
    let off = first.ready.off.contains(&Step::ModalPlaces);
    if off || first.judged.unknown < INADEQUATE || first.judged.left < ELSEWHERE {
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
    let refitted = first.refitted.clone();
    let mut second = once(ready, refitted, library, rules, true, Some(&OnceCell::new()), say);
    if second.price() + ACCEPT > first.price() {
        return first;
    }
    second.found.candidates.extend(first.found.candidates);
    second.found.candidates.sort_by(|a, b| a.priced.total_cmp(&b.priced));
    second
}

/// `turn` keeps the first turn of the search, or has it; none for a search that was made before with other records.
fn once<'a>(
    mut ready: Prepared,
    mut refitted: Refit,
    library: &'a Library,
    rules: &Rules,
    bold: bool,
    turn: Option<&OnceCell<Turn<'a>>>,
    say: &mut dyn FnMut(String),
) -> Explained<'a> {
    let off = ready.off.clone();
    ready.problem.nuisance.struts_follow = false;
    let rows = ready.problem.rows() as f64;
    let mut quick = ready.problem.head(HEAD, &ready.noise);
    let names = ready.problem.setting.names.clone();
    let allowed = |placed: &Placed| !is_unseen(placed.effect) && rules.allow(placed, &names);
    let bonus = |placed: &Placed| rules.bonus(placed, &names);
    let own = OnceCell::new();
    let kept = turn.unwrap_or(&own);
    let mut found = search(&mut ready.problem, &mut quick, &refitted, library, &allowed, &bonus, bold, &off, kept, say);
    if ready.widened.is_some() {
        straighten(&ready.problem, &quick, &mut found, library, &allowed, &bonus, &off, say);
    }
    let simulated = outputs(&ready.problem, &found.best.eta, &found.best.effects);
    if turn.is_some() && ready.renew_codes(&simulated) {
        say("samples drop out: once more without them".into());
        refitted = refit(&ready.problem, STEPS);
        return once(ready, refitted, library, rules, bold, None, say);
    }
    let may_be = !off.contains(&Step::Unseen) && rules.may_be(library, "coloured-disturbance");
    let lines = turn.is_some().then(|| ready.renew_lines(&found.best.eta, &found.best.effects, may_be)).flatten();
    if lines.is_none() && !found.best.effects.is_empty() && ready.renew_noise(&simulated) {
        refitted.weigh_anew(&ready.problem);
        found.weigh_anew(&ready.problem, &off);
    }
    if let Some(what) = lines.or_else(|| may_be.then(|| ready.renew_band(&simulated)).flatten()) {
        say(format!("{what}: once more without it"));
        refitted = refit(&ready.problem, STEPS);
        return once(ready, refitted, library, rules, bold, None, say);
    }
    let widened = ready.widened.is_some();
    // Beside an error of the simulation itself the last digits of a law are no matter.
    let shaped = !widened || left(&ready, &refitted, &found.best) > SHAPED;
    let free = shaped && !off.contains(&Step::FreeShapes);
    let problem = &mut ready.problem;
    let zero = vec![0.0; problem.nuisance.len()];
    let given_cost = sum_of_squares(&problem.residual(&problem.plant, &zero, &[], Fineness::FINE));
    let simpler = if free && !widened { fewer(problem, &quick, &found.best) } else { None };
    let mut bent = match simpler {
        Some((alone, bent)) => {
            found.settle(alone, bent.fit.cost);
            Some(bent)
        }
        // What fails with its own shape and suffices with a free one is this place, and another shape.
        None if free => bent(problem, &quick, &found.best).filter(|bent| found.best.cost - bent.fit.cost > 4.0 * WORTH),
        None => None,
    };
    if let Some(free) = &bent {
        let present = &found.best.effects[free.which];
        let nearer = closest_law(problem, &free.fit.effects, present, library, &allowed);
        if let Some((alone, free)) = nearer.and_then(|law| renamed(problem, &quick, &found.best, free, law)) {
            found.settle(alone, free.fit.cost);
            bent = Some(free);
        }
    }
    // A free shape was fitted with the struts where the simulation has them, and has no size of its own to be right about.
    problem.nuisance.struts_follow = bent.is_none();
    found.best = problem.settled(&found.best);
    let problem = &ready.problem;
    let best = found.best.clone();
    let level = ready.noise_level(&simulated, best.cost / rows);
    // A stage that was looked at and not accepted says what is still there.
    let last = if found.stages.len() > best.effects.len() { found.stages.last() } else { None };
    // How far linear parameters are bent is asked for itself.
    let further = last.and_then(|entries| entries.iter().find(|entry| !entry.placed.effect.is_in_refit()));
    let next = further.map_or(0.0, |entry| entry.gain);
    // Where nothing shows the noise, what is left is its measure.
    let next = if level.seen { next } else { next / (best.cost / rows).max(1.0) };
    let before = refitted.cost.max(given_cost);
    let judge = |bent: f64, next: f64, cost: f64| adequacy(bent, next, cost, before, rows, level, &off);
    let straight = problem.bent(&best.eta);
    let mut judged = judge(straight, next, best.cost);
    if let Some(bent) = &bent {
        let more = bent.fit.parameters() - found.best.parameters();
        found.set_free(bent.fit.cost, more, rows);
        // A shape that is free to tilt may lean on the linear parameters; what they hide, they hide in both fits.
        let freed = judge(straight.min(problem.bent(&bent.fit.eta)), 0.0, bent.fit.cost);
        say(format!("with a free shape: {freed:.2?}"));
        judged.unknown = judged.unknown.min(freed.unknown).max(SHAPE_DIFFERS);
    }
    if best.effects.iter().any(|placed| placed.effect.doubt(&placed.parameters).is_some()) {
        judged.unknown = judged.unknown.max(DOUBTFUL);
    }
    if !best.effects.is_empty() {
        let left = bent.as_ref().map_or(best.cost, |bent| bent.fit.cost);
        judged.unknown = judged.unknown.max(least_unknown((before - left) / left, level.seen));
    }
    if ready.widened.is_some() {
        let fit = bent.as_ref().map_or(&found.best, |bent| &bent.fit);
        let left = left(&ready, &refitted, fit);
        say(format!("leaves {left:.3} of the gap beyond noise and limits"));
        judged.left = left * left;
        judged.unknown = if found.best.effects.is_empty() { MOST_UNKNOWN } else { outside(left) };
    } else if judged.unknown >= INADEQUATE {
        let fit = bent.as_ref().map_or(&found.best, |bent| &bent.fit);
        let simulated = outputs(&ready.problem, &fit.eta, &fit.effects);
        ready.admit_error(&simulated);
        // In the noise's own weights linear parameters lean on every small thing that is left: how far they are off shows beside it.
        let scale = ready.widen(&refit(&ready.problem, STEPS));
        say(format!(
            "no explanation leaves only noise: once more with that as an error of the simulation, its limits {scale:.2} times as wide"
        ));
        refitted = refit(&ready.problem, STEPS);
        return once(ready, refitted, library, rules, bold, None, say);
    }
    Explained { ready, quick, refitted, found, bent, judged, level, given_cost, diverged: None }
}

/// Amplitude that a fit leaves of the fitted records beyond the noise, over what the simulation within its limits leaves.
fn left(ready: &Prepared, refitted: &Refit, fit: &Fit) -> f64 {
    let problem = &ready.problem;
    let within = clipped(problem, &refitted.eta).unwrap_or_else(|| refitted.eta.clone());
    let noise = ready.noise.rms();
    let beyond = |eta: &[f64], effects: &[Placed]| {
        let simulated = outputs(problem, eta, effects);
        let driven = || problem.records.iter().zip(&simulated).filter(|(record, _)| record.level() > 0.0);
        let blocks = Blocks::joined(driven().map(|(record, y)| Blocks::new(&record.y, y, 0)).collect());
        let measured: Vec<&[Vec<f64>]> = driven().map(|(record, _)| record.y.as_slice()).collect();
        let floor = gap::floor_over(&noise, &measured);
        blocks.map_or(0.0, |blocks| (blocks.gap().powi(2) - floor * floor).max(0.0).sqrt())
    };
    beyond(&fit.eta, &fit.effects) / beyond(&within, &[]).max(f64::MIN_POSITIVE)
}

/// Free runs of all fitted records.
pub(crate) fn outputs(problem: &Problem, eta: &[f64], effects: &[Placed]) -> Vec<Channels> {
    let plant = problem.nuisance.apply(&problem.plant, eta);
    let actions = problem.actions(effects);
    let run = |k| problem.outputs(&plant, eta, &actions, k, Fineness::FINE);
    (0..problem.records.len()).map(run).collect()
}

/// What they leave.
pub(crate) fn errors(problem: &Problem, eta: &[f64], effects: &[Placed]) -> Vec<Channels> {
    problem.records.iter().zip(outputs(problem, eta, effects)).map(|(record, y)| error(record, &y)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::Place;
    use crate::prepare::{Known, prepare};
    use crate::testing;

    /// A spring that gives way without end stands first: the next explanation takes its place, or the refit where there is none.
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
            let mut explained = once(ready, refitted, &library, &rules, false, Some(&OnceCell::new()), &mut |_| {});
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
        let next = explained().refuse_divergence();
        assert_eq!(next.found.best.effects[0].effect.name(), "sensor-offset");
        let (refused, record) = next.diverged.unwrap();
        assert_eq!((refused[0].effect.name(), record.starts_with("random")), ("cubic-stiffness", true));
        assert!(next.judged.unknown >= MOST_UNKNOWN);
        let mut alone = explained();
        alone.found.candidates.truncate(1);
        let alone = alone.refuse_divergence();
        assert!(alone.found.best.effects.is_empty() && alone.diverged.is_some());
    }
}
