//! The stepwise search: screen, fits of the best entries, acceptance; after each effect the others are reconsidered.

use std::cell::OnceCell;

use crate::effects::{Names, Side};
use crate::fit::candidate::{Candidate, all_same, in_words, same};
use crate::fit::problem::{Fit, Placed, Problem};
use crate::fit::refit::Refit;
use crate::noise::NoiseModel;
use crate::search::course::not_of_time;
use crate::search::linear_cause;
use crate::search::overlap::{Overlap, of_screen};
use crate::search::ports::fit_ports;
use crate::search::price::{Price, imitates, least_straightened, material, straightens};
use crate::search::reconsider::{Latest, question, refined, related};
use crate::search::rules::Scope;
use crate::search::screen::Entry;
use crate::search::stage::{SearchStage, on_whole, polish};
use crate::search::windows::follows;
use crate::settings::step::Step;
use crate::words::gain;

/// The result of the search.
pub struct Search<'a> {
    /// The best explanation, fitted finely; if it has no effects, the refit itself.
    pub best: Fit<'a>,
    /// All explanations that were fitted, the best first, including the one without effects.
    pub candidates: Vec<Candidate<'a>>,
    /// The screen of each stage.
    pub stages: Vec<Vec<Entry<'a>>>,
    /// The similarity of the first entries of the first stage, before any fit.
    pub overlap: Option<Overlap>,
}

impl<'a> Search<'a> {
    /// Adds the explanations of another search of the same records; of equal explanations, the better fit is kept.
    pub fn add(&mut self, candidates: Vec<Candidate<'a>>) {
        self.candidates.extend(candidates);
        self.candidates.sort_by(|a, b| a.priced.total_cmp(&b.priced));
        let all = std::mem::take(&mut self.candidates);
        for candidate in all {
            if !self.candidates.iter().any(|kept| all_same(&kept.effects, &candidate.effects)) {
                self.candidates.push(candidate);
            }
        }
    }

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

    /// Replaces the best explanation by one with fewer effects that explains as much with a free shape. The new
    /// explanation takes the rank of the former one.
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

/// The starting point of a search.
pub(super) struct Begin<'s, 'a> {
    /// The linear model without effects.
    pub refit: &'s Refit,
    /// The noise, if the quick fits use windows of the records. As soon as an explanation follows the first samples,
    /// the quick fits use these again, weighted by this noise, because the windows' initial states hide the remaining
    /// residual.
    pub windows: Option<&'s NoiseModel>,
    /// An explanation that was found in weaker records.
    pub below: Option<Fit<'a>>,
}

/// Searches for up to `most_effects` effects: on `quick` (the first samples or windows of the records), then with the
/// best few on `problem`. `first` is the first stage; it is filled if it is empty. `say` is called with the progress.
pub(super) fn search<'a>(
    problem: &mut Problem,
    quick: &mut Problem,
    Begin { refit, mut windows, below }: Begin<'_, 'a>,
    scope: &Scope<'_, 'a>,
    first: &OnceCell<SearchStage<'a>>,
    say: &mut dyn FnMut(String),
) -> Search<'a> {
    let (price, settings) = (Price::new(problem, scope), &scope.settings);
    let mut candidates = vec![Candidate { effects: Vec::new(), cost: refit.cost, priced: refit.cost }];
    let mut stages = Vec::new();
    let mut overlap = None;
    // One effect may imitate two others better than either of these can alone.
    let mut runners_up: Vec<Fit> = Vec::new();
    let (mut best, mut gains) = begun([problem, quick], refit, below, &price, &mut candidates, say);
    for stage in best.effects.len()..settings.most_effects {
        let there = |placed: &Placed| best.effects.iter().any(|other| same(other, placed)) || !scope.admits(placed);
        let counts = [settings.fitted, settings.polished];
        let new = || SearchStage::new(problem, quick, &best, None, &there, &price, counts);
        let own = OnceCell::new();
        let searched = if stage == 0 { first } else { &own }.get_or_init(new);
        let (entries, mut fits) = standing(searched, [problem, quick], refit, &best, &there, &price, say);
        if stage == 0 {
            overlap = of_screen(&searched.from.base(quick, scope), &entries[..entries.len().min(settings.fitted)]);
        }
        stages.push(entries);
        for start in std::mem::take(&mut runners_up) {
            fits.extend(after(problem, quick, &start, &price, say));
        }
        fits.sort_by(|a, b| price.of(a).total_cmp(&price.of(b)));
        let tried: Vec<Candidate> = fits.iter().map(|fit| price.candidate(fit)).collect();
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
        // The best explanation with a further effect that was not accepted does not count as another explanation.
        if accepted || best.effects.is_empty() {
            candidates.extend(tried);
        }
        if !accepted {
            break;
        }
        gains.truncate(top.effects.len() - 1);
        gains.resize(top.effects.len(), gain);
        best = completed(problem, quick, top, &mut gains, &price, &mut candidates);
        if let Some(head) = windows.and_then(|noise| followed(problem, &best, noise)) {
            *quick = head;
            windows = None;
            best = further(problem, best, &price, &mut candidates);
        }
    }
    best = refined(problem, quick, best, &price, &mut candidates);
    // An effect that was not accepted must rank behind the explanation without effects, whatever its price.
    if best.effects.is_empty() {
        let least = best.cost + settings.not_accepted_price;
        candidates.iter_mut().filter(|c| !c.effects.is_empty()).for_each(|c| c.priced = c.priced.max(least));
    }
    candidates.sort_by(|a, b| a.priced.total_cmp(&b.priced));
    Search { best, candidates, stages, overlap }
}

/// Returns the explanation with which a search begins, and the gain of each of its effects when it was added. The
/// explanation has no effects, is a linear cause or a law in its place, or was found in weaker records.
fn begun<'a>(
    [problem, quick]: [&Problem; 2],
    refit: &Refit,
    below: Option<Fit<'a>>,
    price: &Price<'_, 'a>,
    candidates: &mut Vec<Candidate<'a>>,
    say: &mut dyn FnMut(String),
) -> (Fit<'a>, Vec<f64>) {
    let (mut best, mut gains) = (refit.as_fit(), Vec::new());
    if let Some(top) = start(problem, refit, price, candidates, say) {
        if let Some(law) = in_its_place([problem, quick], refit, &top, price, candidates, say) {
            return (law.clone(), vec![price.of(&best) - price.of(&law)]);
        }
        best = top;
        // The evidence for the cause is the change of the linear parameters, which the gains of other effects do not
        // contain.
        gains.push(f64::INFINITY);
    }
    if let Some(below) = below.filter(|below| price.of(below) < price.of(&best)) {
        candidates.push(price.candidate(&below));
        gains = vec![price.of(&best) - price.of(&below); below.effects.len()];
        best = below;
    }
    (best, gains)
}

/// Tries related effects in place of the one that was added to an explanation, fits the scales of the ports, and
/// reconsiders the effects. `gains` are the gains of the effects, the last of which was added.
fn completed<'a>(
    problem: &mut Problem,
    quick: &mut Problem,
    top: Fit<'a>,
    gains: &mut Vec<f64>,
    price: &Price<'_, 'a>,
    candidates: &mut Vec<Candidate<'a>>,
) -> Fit<'a> {
    let (scope, top) = (price.scope, related(problem, top, price, candidates));
    let entered = top.cost;
    let best = if scope.skips(Step::PortScales) { top } else { fit_ports(problem, quick, top) };
    // With other scales of the ports, the explanation may fit better than when it was entered.
    candidates.push(price.candidate(&best));
    if best.effects.len() < 2 || scope.skips(Step::Questioning) {
        return best;
    }
    let latest = Latest { gain: gains[gains.len() - 1], scaled: best.cost < entered };
    question(problem, quick, best, &latest, gains, price, candidates)
}

/// Returns the fit of a linear cause that the refit has spread over its parameters, if the simulation is imperfect
/// and the cause gains enough.
fn start<'a>(
    problem: &Problem,
    refit: &Refit,
    price: &Price<'_, 'a>,
    candidates: &mut Vec<Candidate<'a>>,
    say: &mut dyn FnMut(String),
) -> Option<Fit<'a>> {
    if !price.scope.imperfect {
        return None;
    }
    let mut fits = linear_cause::fits(problem, &refit.as_fit(), &refit.jacobian, price.scope);
    fits.extend(linear_cause::from_given(problem, &refit.as_fit(), &refit.jacobian, price.scope));
    let tried: Vec<Candidate> = fits.iter().map(|fit| price.candidate(fit)).collect();
    let top = fits.into_iter().min_by(|a, b| price.of(a).total_cmp(&price.of(b)))?;
    let gain = refit.cost - price.of(&top);
    if gain < price.scope.settings.accept_gain {
        return None;
    }
    candidates.extend(tried);
    let words = in_words(&top.effects, &problem.setting.names);
    say(format!("{words} explains changes that the refit has spread over many parameters ({gain:.0})"));
    Some(top)
}

/// Returns the best fit with a nonlinear law at the place of a linear cause inside the structure, if the law explains
/// more: a damper accounts for most of the changes by which a refit imitates friction.
fn in_its_place<'a>(
    [problem, quick]: [&Problem; 2],
    refit: &Refit,
    cause: &Fit<'a>,
    price: &Price<'_, 'a>,
    candidates: &mut Vec<Candidate<'a>>,
    say: &mut dyn FnMut(String),
) -> Option<Fit<'a>> {
    let [cause_of] = cause.effects.as_slice() else { return None };
    if cause_of.effect.side() != Side::Structure {
        return None;
    }
    let is_law = |placed: &Placed| {
        placed.place == cause_of.place && placed.effect.side() == Side::Structure && !placed.effect.is_linear()
    };
    let left_out = |placed: &Placed| !is_law(placed) || !price.scope.admits(placed);
    let counts = [price.scope.settings.fitted, price.scope.settings.polished];
    let bare = refit.as_fit();
    let (_, fits) = SearchStage::new(problem, quick, &bare, None, &left_out, price, counts)
        .without(problem, quick, &left_out, price);
    candidates.extend(fits.iter().map(|fit| price.candidate(fit)));
    let law = fits.into_iter().min_by(|a, b| price.of(a).total_cmp(&price.of(b)))?;
    if price.of(&law) >= price.of(cause) {
        return None;
    }
    say(format!("{} explains more in its place", in_words(&law.effects, &problem.setting.names)));
    Some(law)
}

/// Returns the entries and fits of a stage. If the best fit adds a change over time that is constant within the
/// records, this change is set aside, and other entries are fitted in its place. With further effects in the
/// explanation, the change may turn out to vary within the records, so a later stage tries it again.
fn standing<'a>(
    searched: &SearchStage<'a>,
    [problem, quick]: [&Problem; 2],
    refit: &Refit,
    best: &Fit<'a>,
    there: &dyn Fn(&Placed) -> bool,
    price: &Price<'_, 'a>,
    say: &mut dyn FnMut(String),
) -> (Vec<Entry<'a>>, Vec<Fit<'a>>) {
    let mut aside: Vec<Placed> = Vec::new();
    loop {
        let left_out = |placed: &Placed| there(placed) || aside.iter().any(|other| same(other, placed));
        let (entries, fits) = searched.without(problem, quick, &left_out, price);
        say(progress(best.effects.len() + 1, &entries, &fits, price, &problem.setting.names));
        let top = fits.iter().min_by(|a, b| price.of(a).total_cmp(&price.of(b)));
        let gains = |fit: &&Fit| price.of(best) - price.of(fit) > price.scope.settings.accept_gain;
        let last = top.filter(gains).and_then(|fit| Some((fit, fit.effects.last()?)));
        let of_time = last.filter(|(_, last)| last.effect.side() == Side::Time);
        let Some((found, last)) = of_time.and_then(|(fit, last)| Some((not_of_time(problem, refit, fit)?, last)))
        else {
            return (entries, fits);
        };
        say(format!("{} does not change within the records: set aside", found.words));
        aside.push(last.clone());
    }
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
    let counts = [settings.fitted / 2, settings.polished / 2];
    let searched = SearchStage::new(problem, quick, start, None, &there, price, counts);
    let (entries, fits) = searched.without(problem, quick, &there, price);
    let names = &problem.setting.names;
    say(format!("with {}, {}", in_words(&start.effects, names), progress(2, &entries, &fits, price, names)));
    fits
}

/// Fits once more without the last effect, from the end of the fit with it, and returns the better of this fit and
/// the best explanation. A gain by the linear parameters alone is not a gain of the effect.
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
    if !bare.is_better_than(&best) {
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

/// Fits the best explanation once more, and returns the better fit.
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

/// Adds numbers of the simulation, such as a gain or a frequency, that account for large changes of the linear
/// parameters. Each is added to the best explanation if it brings the linear parameters sufficiently close to their
/// prior, whatever else was found.
pub fn straighten<'a>(
    problem: &Problem,
    quick: &Problem,
    found: &mut Search<'a>,
    scope: &Scope<'_, 'a>,
    say: &mut dyn FnMut(String),
) {
    let (price, settings) = (Price::new(problem, scope), &scope.settings);
    for _ in 0..settings.most_straightened {
        let best = &found.best;
        if problem.penalty(&best.eta) < least_straightened(problem, scope) {
            return;
        }
        let there = |placed: &Placed| {
            !placed.effect.is_number() || best.effects.iter().any(|other| same(other, placed)) || !scope.allows(placed)
        };
        // The model is linear in these numbers, so the quick fits rank them well.
        let counts = [settings.fitted / 2, settings.polished / 2];
        let searched = SearchStage::new(problem, quick, best, None, &there, &price, counts);
        let (entries, mut fits) = searched.without(problem, quick, &there, &price);
        let jacobian = problem.jacobian(&problem.nuisance.apply(&problem.plant, &best.eta));
        fits.extend(linear_cause::fits(problem, best, &jacobian, scope));
        say(progress(best.effects.len() + 1, &entries, &fits, &price, &problem.setting.names));
        // A damper may remove more of the residual than the gain that explains the changes of the linear parameters.
        let explains = |fit: &Fit| {
            price.of(best) - price.of(fit) >= settings.accept_gain && straightens(problem, scope, best, fit)
        };
        let sound = fits.into_iter().filter(explains);
        let Some(top) = sound.min_by(|a, b| price.of(a).total_cmp(&price.of(b))) else { return };
        found.candidates.push(price.candidate(&top));
        found.candidates.sort_by(|a, b| a.priced.total_cmp(&b.priced));
        found.best = top;
    }
}

/// Returns a line on a stage: the number of entries, the gains of the first of them, and the distance of each fit
/// from the best.
fn progress(stage: usize, entries: &[Entry], fits: &[Fit], price: &Price, names: &Names) -> String {
    let one = |placed: &Placed, figure: f64| {
        format!("{} at {} ({})", placed.effect.name(), placed.place.location(names), gain(figure))
    };
    let least = fits.iter().map(|fit| price.of(fit)).fold(f64::INFINITY, f64::min);
    let fit = |fit: &Fit| one(fit.effects.last().expect("a stage adds an effect"), price.of(fit) - least);
    let fits = fits.iter().map(fit).collect::<Vec<_>>().join(", ");
    let entry = |entry: &Entry| one(&entry.placed, entry.gain);
    let first = entries.iter().take(6).map(entry).collect::<Vec<_>>().join(", ");
    let entries = entries.len();
    format!("stage {stage}: {entries} entries of the screen, the first by gain: {first}; fits, behind the best: {fits}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::{Library, Place, Setting};
    use crate::fit::refit::{STEPS, refit};
    use crate::search::rules::Rules;
    use crate::testing::laws::{at, prepared, without};

    /// If friction acts, it takes the place of a linear damper that accounts for most of it. A damper that acts is
    /// kept.
    #[test]
    fn friction_takes_the_place_of_a_damper() {
        let library = Library::standard();
        let friction: fn(&Setting) -> Vec<f64> = |setting| vec![0.02 * setting.force[0], 0.05 * setting.v_rms[0]];
        let damper: fn(&Setting) -> Vec<f64> = |setting| vec![0.02 * setting.force[0] / setting.v_rms[0]];
        for (acts, parameters, law) in
            [("coulomb-friction", friction, Some("coulomb-friction")), ("added-damping", damper, None)]
        {
            let ready = prepared(&[(acts, parameters)]);
            let problem = &ready.problem;
            let quick = problem.head(problem.settings.search.first_samples, &ready.noise);
            let exclude = without(&library, &["coulomb-friction", "quadratic-damping", "added-damping"]);
            let rules = Rules { suspects: &[], exclude: &exclude, without: &[] };
            let (settings, names) = (problem.settings.search.clone(), problem.setting.names.clone());
            let (off, bold) = (Vec::new(), false);
            let scope = Scope { library: &library, rules: &rules, settings, names, off, bold, imperfect: true };
            let price = Price::new(problem, &scope);
            let refitted = refit(problem, STEPS);
            let added = at(&library, "added-damping", Place::Input(0), damper(&problem.setting));
            let cause = polish(problem, Fit { effects: vec![added], ..refitted.as_fit() });
            let found = in_its_place([problem, &quick], &refitted, &cause, &price, &mut Vec::new(), &mut |_| {});
            assert_eq!(found.map(|fit| fit.effects[0].effect.name()), law);
        }
    }

    /// A gain of 1.04 is added although a damper, which changes no linear parameter, removes more of the residual.
    #[test]
    fn a_gain_that_straightens_is_added_beside_a_damper() {
        let library = Library::standard();
        let damper: fn(&Setting) -> Vec<f64> = |setting| vec![2e-3 * setting.force[0] / setting.v_rms[0]];
        let ready = prepared(&[("actuator-gain", |_| vec![1.04]), ("added-damping", damper)]);
        let problem = &ready.problem;
        let quick = problem.head(problem.settings.search.first_samples, &ready.noise);
        let exclude = without(&library, &["actuator-gain", "added-damping"]);
        let rules = Rules { suspects: &[], exclude: &exclude, without: &[] };
        let (settings, names) = (problem.settings.search.clone(), problem.setting.names.clone());
        let scope =
            Scope { library: &library, rules: &rules, settings, names, off: Vec::new(), bold: false, imperfect: true };
        let best = refit(problem, STEPS).as_fit();
        let mut found = Search { best, candidates: Vec::new(), stages: Vec::new(), overlap: None };
        straighten(problem, &quick, &mut found, &scope, &mut |said| println!("{said}"));
        let named: Vec<_> = found.best.effects.iter().map(|e| (e.effect.name(), e.place.clone())).collect();
        assert_eq!(named, [("actuator-gain", Place::Input(0))]);
    }
}
