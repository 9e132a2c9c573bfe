//! The whole diagnosis, step after step.

pub(crate) mod explain;

use std::cell::OnceCell;

use crate::answer::schema::{Diagnosis, Explanation, Gap, Located, NamedEffect, SimulationWithEffects};
use crate::answer::simulation::{refit_summary, written};
use crate::answer::whole_delay::WholeDelay;
use crate::answer::{classes, comparisons, named, others, place, remainder, remains, sentence, words};
use crate::audit::{Audit, audit};
use crate::case::Case;
use crate::case::levels::{LevelRun, is_linear, loudest, one_of_each_level};
use crate::case::record::{Channels, Record};
use crate::diagnose::explain::explain;
use crate::effects::{Action, Library};
use crate::error::GapError;
use crate::evidence::Beside;
use crate::fit::candidate::in_words;
use crate::fit::free_run::errors;
use crate::fit::free_run::run;
use crate::fit::problem::Placed;
use crate::fit::refit::{self, Refit, clipped, refit};
use crate::judge::explained::Explained;
use crate::judge::held_out::held_out;
use crate::judge::locate::{self, Map};
use crate::judge::next_experiment::next_experiment;
use crate::judge::separability::{Foretold, rivals};
use crate::judge::settle_all::with_all;
use crate::judge::shares::{Share, of_band, shares};
use crate::judge::shrink::{blocks, gaps, opened};
use crate::judge::verdict::{Adequacy, Verdict, outside, weigh};
use crate::plant::Plant;
use crate::prepare::{Prepared, prepare};
use crate::search::rules::Rules;
use crate::search::stepwise::Turn;
use crate::search::stochastic::{Unseen, unseen, wandering};
use crate::settings::step::Step;
use crate::settings::thresholds::{EVIDENCE, LEAST_SHARE, MOST_UNKNOWN};
use crate::simulate::{Fineness, simulate};
use plid_data::nearest;

/// What a diagnosis gives: the answer, what a prediction needs, and what a report shows.
pub struct Outcome {
    /// diagnosis.json.
    pub diagnosis: Diagnosis,
    /// sim-with-effect.json.
    pub simulation: SimulationWithEffects,
    /// What the report draws.
    pub evidence: Evidence,
}

/// What the report draws.
pub struct Evidence {
    /// Names of the outputs.
    pub outputs: Vec<String>,
    /// Samples a second.
    pub rate: f64,
    /// The gap as given.
    pub before: Map,
    /// The gap with the effects.
    pub after: Map,
    /// What the best explanation leaves.
    pub adequacy: Adequacy,
    /// Best entries of each stage's screen: name, place, gain, share that a refit absorbs.
    pub stages: Vec<Vec<(String, String, f64, f64)>>,
    /// The record of `trace`.
    pub trace_record: String,
    /// Measured, as given, with the effects: p channels each.
    pub trace: [Channels; 3],
    /// Evidence for effects that no free run shows: name, place, twice the log likelihood.
    pub unseen: Vec<(String, String, f64)>,
    /// Changes of the bounded refit in standard deviations of its prior, by mode (Hz): frequency, damping, largest of the shapes.
    pub refit: Vec<(f64, f64, f64, f64)>,
    /// Sum of squares a row: as given, refit, with the effects.
    pub costs: [f64; 3],
    /// Of the records that were fitted, in order: name, start in s, samples.
    pub fitted: Vec<(String, f64, usize)>,
    /// A record of each level beside its simulations.
    pub levels: Vec<LevelRun>,
    /// Of each output: frequencies in Hz with the density that noise alone makes there, in the output's unit squared a Hz.
    pub noise: Vec<Vec<(f64, f64)>>,
    /// What the diagnosis does not rest on.
    pub beside: Beside,
    /// Whether the simulation with the effects still is linear in its inputs.
    pub linear: bool,
}

/// Frequencies at which the noise is shown.
const NOISE_LINES: usize = 200;

/// Diagnoses a case. `say` is told what is going on.
///
/// # Errors
/// [`GapError`].
pub fn diagnose(case: &Case, library: &Library, say: &mut dyn FnMut(String)) -> Result<Outcome, GapError> {
    diagnose_without(case, library, &[], say)
}

/// Diagnoses a case with some steps off, to see what they are worth.
///
/// # Errors
/// [`GapError`].
pub fn diagnose_without(
    case: &Case,
    library: &Library,
    off: &[Step],
    say: &mut dyn FnMut(String),
) -> Result<Outcome, GapError> {
    Ok(Groundwork::whole(case, library, off, say)?.0)
}

/// What a diagnosis does before it matters which effects it knows: audit, preparation, bounded refit; and the first turn of the search, from which one that
/// knows fewer effects takes all but theirs.
pub struct Groundwork<'a> {
    case: &'a Case,
    library: &'a Library,
    audit: Audit,
    ready: Prepared,
    refitted: Refit,
    first: OnceCell<Turn<'a>>,
}

impl<'a> Groundwork<'a> {
    fn new(case: &'a Case, library: &'a Library, off: &[Step], say: &mut dyn FnMut(String)) -> Result<Self, GapError> {
        say("audit".into());
        let audit = audit(case, library, off, say)?;
        say("preparing".into());
        let mut ready = prepare(model(&audit)?, &audit.case.records, &audit.known)?;
        known_names(&audit.case, library, &ready)?;
        say("bounded refit".into());
        let refitted = refit(&ready.problem, refit::STEPS);
        ready.renew_missing(&refitted.eta);
        Ok(Self { case, library, audit, ready, refitted, first: OnceCell::new() })
    }

    /// The answer with the whole library, and what can be used again where effects are left out. `off` are steps that neither makes.
    ///
    /// # Errors
    /// [`GapError`].
    pub fn whole(
        case: &'a Case,
        library: &'a Library,
        off: &[Step],
        say: &mut dyn FnMut(String),
    ) -> Result<(Outcome, Self), GapError> {
        let ground = Self::new(case, library, off, say)?;
        let outcome = finish(&ground, &ground.audit, &[], say)?;
        Ok((outcome, ground))
    }

    /// The answer of a diagnosis that does not know these effects: to the last bit that with [`Library::without`].
    ///
    /// # Errors
    /// [`GapError`].
    pub fn leave_out(&self, without: &[String], say: &mut dyn FnMut(String)) -> Result<Outcome, GapError> {
        finish(self, &self.audit.without(self.case, self.library, without)?, without, say)
    }
}

/// A slip of the pen in `suspects` or `exclude` would go unnoticed.
fn known_names(case: &Case, library: &Library, ready: &Prepared) -> Result<(), GapError> {
    let setting = &ready.problem.setting;
    let places = library.effects().flat_map(|effect| effect.places(setting));
    let mut names: Vec<String> = places.map(|place| place.location(&setting.names)).collect();
    names.extend(library.effects().map(|effect| effect.name().to_string()));
    // A mode that is missing and a line have any frequency.
    let is_frequency = |name: &str| {
        let hz = name.strip_prefix("mode:").or(name.strip_prefix("freq:"));
        hz.is_some_and(|hz| hz.parse::<f64>().is_ok())
    };
    for (key, said) in [("suspects", &case.config.suspects), ("exclude", &case.config.exclude)] {
        if let Some(name) = said.iter().find(|name| !names.contains(name) && !is_frequency(name)) {
            return Err(GapError::Name { key, name: name.clone(), suggestion: nearest(name, &names) });
        }
    }
    Ok(())
}

fn model(audit: &Audit) -> Result<&plid_model::Model, GapError> {
    audit.case.model.as_ref().ok_or_else(|| GapError::Failed("a case has a model once it is audited".into()))
}

/// All that depends on which effects are known.
fn finish(
    ground: &Groundwork,
    audit: &Audit,
    without: &[String],
    say: &mut dyn FnMut(String),
) -> Result<Outcome, GapError> {
    let (case, model) = (&audit.case, model(audit)?);
    let off = &audit.known.off;
    let rules = Rules { suspects: &case.config.suspects, exclude: &case.config.exclude, without };
    let (ready, refitted) = (ground.ready.clone(), ground.refitted.clone());
    let explained = explain(ready, refitted, ground.library, &rules, &ground.first, say);
    // What an explanation makes of the quiet records is no noise in them.
    let mut unseen = if off.contains(&Step::Unseen) { Vec::new() } else { unseen(&explained.ready, ground.library) };
    unseen.retain(|unseen| rules.knows(unseen.placed.effect));
    let Explained { ready, refitted, found, judged, level, .. } = &explained;
    let problem = &ready.problem;
    let names = &problem.setting.names;
    say("gaps".into());
    let plant = problem.nuisance.apply(&problem.plant, &explained.fit().eta);
    let actions = problem.actions(&explained.fit().effects);
    // What was held out judges too: an effect that does not simulate it better than a refit alone is not what happens there. A refit beyond
    // the stated limits may stand for the effect itself.
    let bounded = clipped(problem, &refitted.eta).map(|eta| problem.nuisance.apply(&problem.plant, &eta));
    let bounded = bounded.as_ref().unwrap_or(&refitted.plant);
    let gaps = gaps(&explained, &plant, &actions, bounded, &case.config.nuisance);
    let best = &found.best.effects;
    let held_out =
        if best.is_empty() { None } else { held_out(&ready.held_out, &ready.noise, bounded, &plant, &actions) };
    let fails = !off.contains(&Step::HeldOutVeto) && held_out.is_some_and(|held_out| held_out.refutes());
    let imperfect = ready.widened.is_some() && !best.is_empty();
    // What makes the gap on held-out records grow by a material part explains nothing, however well it fits the others.
    let grown = gaps.with_effect.powi(2) - gaps.within_limits.powi(2) > case.config.material.powi(2);
    let unknown = match (fails || grown, imperfect) {
        (true, _) => MOST_UNKNOWN.max(judged.unknown),
        (false, true) => judged.unknown.max(outside(gaps.left())),
        (false, false) => judged.unknown,
    };
    let opened = opened(&explained);
    let simulated = blocks(&opened, &plant, &actions);
    let shares = shares(&explained, &simulated, bounded);
    let beyond = |gap: f64| (gap * gap - gaps.noise_floor * gaps.noise_floor).max(0.0).sqrt();
    // Nothing matters that a simulation within its limits leaves less of than is material.
    let immaterial = ready.widened.is_some() && beyond(gaps.within_limits) < case.config.material;
    let mut weighted = weigh(&found.candidates, unknown, problem.rows() as f64, *level, off);
    // What quiet records show holds whatever the free runs say.
    let shown: Vec<&Unseen> = unseen
        .iter()
        .filter(|u| u.gain > EVIDENCE && rules.allow(&u.placed, names) && wandering(&u.placed, best).is_none())
        .collect();
    for explanation in weighted.iter_mut().filter(|w| !w.unknown) {
        explanation.effects.extend(shown.iter().map(|u| u.placed.clone()));
    }
    let verdict = match weighted.first() {
        Some(top) if immaterial && (top.unknown || best.is_empty()) => Verdict::None,
        Some(top) if top.unknown => Verdict::Unknown,
        Some(top) if top.effects.is_empty() => Verdict::None,
        Some(_) => Verdict::Effects,
        None => Verdict::Unknown,
    };

    let before = locate::map(&problem.records, &locate::errors(problem), &ready.noise, plant.rate);
    let mut said = named(&explained, &shown, &weighted, &shares, gaps.left());
    for which in unseen.iter().filter_map(|u| wandering(&u.placed, best)) {
        said[which].shape_differs = true;
    }
    by_size(&mut said, &shares, &shown, &explained);
    keep_main(&mut said);
    let nearest: Vec<String> = best.iter().map(|placed| in_words(std::slice::from_ref(placed), names)).collect();
    let mut candidates = weighted
        .iter()
        .map(|w| Explanation {
            effects: w
                .effects
                .iter()
                .map(|p| Located { effect: p.effect.name().into(), location: p.place.location(names) })
                .collect(),
            unknown: w.unknown,
            probability: w.probability,
            gap_after: w.cost.map(|cost| gaps.noise_floor * (cost / level.factor.min(1.0)).max(0.0).sqrt()),
        })
        .collect::<Vec<_>>();
    say("evidence beside it".into());
    let linear = |record: &Record| run(&plant, &[], record);
    let with = |record: &Record| run(&plant, &actions, record);
    let beside = Beside::of(problem, &refitted.plant, &ready.noise, &case.records, linear, with);
    say("held against its rivals".into());
    // Where nothing is missing nothing is left to part.
    let foretold = (verdict != Verdict::None).then(|| Foretold::new(problem, explained.fit()));
    let rivals = foretold.as_ref().map_or_else(Vec::new, |foretold| rivals(foretold, best, &found.candidates));
    let first = in_words(best, names);
    let others = others(best, &rivals, names);
    let after = errors(problem, &explained.fit().eta, &explained.fit().effects);
    let after = locate::map(&problem.records, &after, &ready.noise, plant.rate);
    let remains = ready.widened.map(|_| remains(&after, &names.outputs, beyond(gaps.with_effect), gaps.as_given));
    let mut sentence = sentence(verdict, &said, &nearest, &gaps, level.seen, remains.as_deref());
    let remainder = remainder(&explained, &gaps, &after, &simulated, case.config.material);
    if let (Verdict::Effects, Some(others)) = (verdict, &others) {
        sentence += &format!(" These records cannot tell {first} from {others}.");
    }
    say("next experiment".into());
    let mut effects = if verdict == Verdict::Effects { said } else { Vec::new() };
    let delay = WholeDelay::of(audit);
    if let Some(delay) = &delay {
        delay.explains(&mut candidates);
        if verdict != Verdict::Unknown {
            delay.named(&mut effects, &candidates);
        }
    }
    if let Some(mismatch) = audit.put_right() {
        sentence = format!("{} {sentence}", mismatch.sentence);
    }
    let delayed = delay.is_some() && verdict != Verdict::Unknown;
    let diagnosis = Diagnosis {
        verdict: if delayed { Verdict::Effects } else { verdict },
        sentence,
        next_experiment: foretold
            .as_ref()
            .and_then(|foretold| next_experiment(&explained, &weighted, best, foretold, &rivals)),
        effects,
        candidates,
        not_separable: classes(found, best, &rivals, names),
        separability: comparisons(found, best, &rivals, names),
        place: place(&before, &names.outputs, found, &shown),
        remainder,
        gap: gaps,
        evidence: words(
            &explained,
            &before,
            held_out,
            &beside,
            others.as_deref().map(|others| (first.as_str(), others)),
        ),
        warnings: case.warnings.clone(),
    };
    let (eta, effects) = predicting(&explained, &diagnosis.gap, verdict);
    let mut simulation = written(&explained, model, &eta, &effects, &shown, &diagnosis.gap);
    let evidence = evidence(case, &explained, &unseen, [before, after], beside, &plant, &actions);
    if let Some(delay) = &delay {
        delay.simulated(&mut simulation.effects);
    }
    Ok(Outcome { diagnosis, simulation, evidence })
}

/// Linear parameters and effects of the simulation that is written: fitted to all records once all is stated, and no effect that follows what was held out
/// worse than the simulation as given or its refit.
fn predicting<'a>(explained: &Explained<'a>, gap: &Gap, verdict: Verdict) -> (Vec<f64>, Vec<Placed<'a>>) {
    let fit = explained.fit();
    let follows = gap.with_effect <= NO_WORSE * gap.as_given.min(gap.refit);
    if verdict == Verdict::None || !follows {
        let given = vec![0.0; fit.eta.len()];
        let refit = explained.refitted.eta.clone();
        return (if gap.refit <= gap.as_given { refit } else { given }, Vec::new());
    }
    with_all(explained).unwrap_or_else(|| (fit.eta.clone(), fit.effects.clone()))
}

/// A gap counts as no worse within the scatter of its last digits.
const NO_WORSE: f64 = 1.001;

/// Names only effects that close a noticeable share of the gap, and the largest in any case. The others remain among the
/// candidates.
fn keep_main(said: &mut Vec<NamedEffect>) {
    let mut first = true;
    said.retain(|effect| std::mem::take(&mut first) || effect.share.is_none_or(|share| share >= LEAST_SHARE));
}

/// Largest part of the gap first; what no free run shows has a part in the noise.
fn by_size(said: &mut Vec<NamedEffect>, shares: &[Share], shown: &[&Unseen], explained: &Explained) {
    let closed = shares.iter().map(|share| share.closed);
    let band = |u: &&Unseen| if u.placed.effect.name() == "coloured-disturbance" { of_band(explained) } else { 0.0 };
    let sizes: Vec<f64> = closed.chain(shown.iter().map(band)).collect();
    let mut order: Vec<usize> = (0..said.len()).collect();
    order.sort_by(|&a, &b| sizes[b].total_cmp(&sizes[a]));
    *said = order.into_iter().map(|k| said[k].clone()).collect();
}

/// What the report draws.
fn evidence(
    case: &Case,
    explained: &Explained,
    unseen: &[Unseen],
    [before, after]: [Map; 2],
    beside: Beside,
    plant: &Plant,
    actions: &[Action],
) -> Evidence {
    let Explained { ready, refitted, found, judged, given_cost, .. } = explained;
    let problem = &ready.problem;
    let names = &problem.setting.names;
    let rows = problem.rows() as f64;
    let trace_record = ready.held_out.last().or(problem.records.last()).expect("a case has records").clone();
    let runs = |plant: &Plant, actions: &[Action]| run(plant, actions, &trace_record);
    let levels = one_of_each_level(&case.records).into_iter().map(|record| LevelRun {
        record: record.name.clone(),
        level: record.level(),
        u: record.u.clone(),
        y: record.y.clone(),
        given: run(&problem.plant, &[], record),
        with: run(plant, actions, record),
    });
    let noise_lines: Vec<(f64, nalgebra::DMatrix<crate::fourier::C>)> = (1..NOISE_LINES)
        .map(|k| 0.5 * plant.rate * k as f64 / NOISE_LINES as f64)
        .map(|hz| (hz, ready.noise.density(hz)))
        .collect();
    Evidence {
        outputs: names.outputs.clone(),
        rate: plant.rate,
        before,
        after,
        adequacy: *judged,
        stages: found
            .stages
            .iter()
            .map(|entries| {
                let line = |e: &crate::search::screen::Entry| {
                    (e.placed.effect.name().to_string(), e.placed.place.location(names), e.gain, e.absorbed)
                };
                entries.iter().take(15).map(line).collect()
            })
            .collect(),
        trace: [trace_record.y.clone(), runs(&problem.plant, &[]), runs(plant, actions)],
        trace_record: trace_record.name,
        beside,
        unseen: unseen
            .iter()
            .map(|u| (u.placed.effect.name().into(), u.placed.place.location(names), u.gain))
            .collect(),
        refit: refit_summary(problem, &explained.fit().eta),
        costs: [given_cost / rows, refitted.cost / rows, explained.fit().cost / rows],
        fitted: problem.records.iter().map(|r| (r.name.clone(), r.start_s, r.samples())).collect(),
        levels: levels.collect(),
        // One-sided, from a power spectral density that is the variance for white noise.
        noise: (0..plant.p)
            .map(|o| noise_lines.iter().map(|(hz, s)| (*hz, 2.0 * s[(o, o)].re / plant.rate)).collect())
            .collect(),
        linear: is_linear(&loudest(&problem.records).u, |u| simulate(plant, actions, u, 0.0, None, Fineness::FINE)),
    }
}
