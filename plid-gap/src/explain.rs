//! Steps 3 to 8: which effects explain the gap, and whether they suffice.

use std::cell::OnceCell;

use crate::ablation::Step;
use crate::effects::{Effect, Library, Names};
use crate::locate::error;
use crate::modal::dominant;
use crate::prepare::{NoiseLevel, Prepared};
use crate::problem::{Fit, Placed, Problem, sum_of_squares};
use crate::record::Channels;
use crate::refit::{Refit, STEPS, refit};
use crate::shape::{Bent, bent, one_for_two};
use crate::simulate::Fineness;
use crate::stepwise::{Search, Turn, search};
use crate::thresholds::{ACCEPT, ELSEWHERE, HEAD, INADEQUATE, SHAPE_DIFFERS, WORTH};
use crate::unseen::is_unseen;
use crate::verdict::{Adequacy, adequacy};

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
}

impl<'a> Explained<'a> {
    /// The model that predicts: the best explanation, with a free shape where one is needed.
    pub fn fit(&self) -> &Fit<'a> {
        self.bent.as_ref().map_or(&self.found.best, |bent| &bent.fit)
    }

    /// RMS of each output's noise; where nothing shows it, no more than what is left.
    pub fn noise_rms(&self) -> Vec<f64> {
        self.ready.noise.rms().iter().map(|rms| rms * self.level.factor.min(1.0).sqrt()).collect()
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
    let rows = ready.problem.rows() as f64;
    let mut quick = ready.problem.head(HEAD, &ready.noise);
    let names = ready.problem.setting.names.clone();
    let allowed = |placed: &Placed| !is_unseen(placed.effect) && rules.allow(placed, &names);
    let bonus = |placed: &Placed| rules.bonus(placed, &names);
    let own = OnceCell::new();
    let kept = turn.unwrap_or(&own);
    let mut found = search(&mut ready.problem, &mut quick, &refitted, library, &allowed, &bonus, bold, &off, kept, say);
    let simulated = outputs(&ready.problem, &found.best.eta, &found.best.effects);
    if turn.is_some() && ready.renew_codes(&simulated) {
        say("samples drop out: once more without them".into());
        refitted = refit(&ready.problem, STEPS);
        return once(ready, refitted, library, rules, bold, None, say);
    }
    if !found.best.effects.is_empty() && ready.renew_noise(&simulated) {
        refitted.weigh_anew(&ready.problem);
        found.weigh_anew(&ready.problem, &off);
    }
    let problem = &ready.problem;
    let zero = vec![0.0; problem.nuisance.len()];
    let given_cost = sum_of_squares(&problem.residual(&problem.plant, &zero, &[], Fineness::FINE));
    let free = !off.contains(&Step::FreeShapes);
    let simpler = if free { one_for_two(problem, &quick, &found.best) } else { None };
    let bent = match simpler {
        Some((alone, bent)) => {
            found.settle(alone, bent.fit.cost);
            Some(bent)
        }
        // What fails with its own shape and suffices with a free one is this place, and another shape.
        None if free => bent(problem, &quick, &found.best).filter(|bent| found.best.cost - bent.fit.cost > 4.0 * WORTH),
        None => None,
    };
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
    Explained { ready, quick, refitted, found, bent, judged, level, given_cost }
}

/// Free runs of all fitted records.
fn outputs(problem: &Problem, eta: &[f64], effects: &[Placed]) -> Vec<Channels> {
    let plant = problem.nuisance.apply(&problem.plant, eta);
    let actions = problem.actions(effects);
    let run = |k| problem.outputs(&plant, eta, &actions, k, Fineness::FINE);
    (0..problem.records.len()).map(run).collect()
}

/// What they leave.
pub(crate) fn errors(problem: &Problem, eta: &[f64], effects: &[Placed]) -> Vec<Channels> {
    problem.records.iter().zip(outputs(problem, eta, effects)).map(|(record, y)| error(record, &y)).collect()
}
