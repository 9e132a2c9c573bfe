//! The whole diagnosis, step after step.

use std::collections::BTreeMap;

use statrs::distribution::{ContinuousCDF, StudentsT};

use crate::audit::audit;
use crate::case::Case;
use crate::diagnosis::{
    Diagnosis, Explanation, Gap, Located, NamedEffect, SimulationWithEffects, Value, Where, WrittenEffect,
};
use crate::effects::{Action, Library, Side};
use crate::error::GapError;
use crate::gap::{self, Blocks};
use crate::levels::{LevelRun, is_linear, one_of_each_level};
use crate::locate::{self, Map};
use crate::nuisance::{Limits, Nuisance};
use crate::plant::Plant;
use crate::prepare::{Prepared, prepare};
use crate::problem::{Effort, Fit, Placed, Problem, sum_of_squares};
use crate::record::{Channels, Excitation, Record};
use crate::refit::{Refit, refit};
use crate::shape;
use crate::simulate::{Fineness, State, simulate};
use crate::stepwise::{Search, search};
use crate::thresholds::{HEAD, SHAPE_DIFFERS, WORTH};
use crate::unseen::{self, EVIDENCE, unseen};
use crate::verdict::{Adequacy, Verdict, Weighted, adequacy, weigh};

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
    say("audit".into());
    let audit = audit(case, library, say)?;
    let case = &audit.case;
    let model = case.model.as_ref().ok_or_else(|| GapError::Failed("a case has a model once it is audited".into()))?;
    let limits = &case.config.nuisance;
    say("preparing".into());
    let mut ready = prepare(model, &case.records, limits)?;
    let rows = ready.problem.rows() as f64;
    say("bounded refit".into());
    let mut refitted = refit(&ready.problem);
    let unseen = unseen(&ready, library);
    let names = ready.problem.setting.names.clone();
    let names = &names;
    let matches =
        |word: &String, placed: &Placed| word == placed.effect.name() || *word == placed.place.location(names);
    let excluded = |placed: &Placed| case.config.exclude.iter().any(|word| matches(word, placed));
    let allowed = |placed: &Placed| !unseen::is_unseen(placed.effect) && !excluded(placed);
    let bonus = |placed: &Placed| {
        if case.config.suspects.iter().any(|word| matches(word, placed)) { SUSPECTED } else { 0.0 }
    };
    let mut quick = ready.problem.head(HEAD, &ready.noise);
    let mut found = search(&mut ready.problem, &mut quick, &refitted, library, &allowed, &bonus, say);
    let simulated = outputs(&ready.problem, &found.best);
    if !found.best.effects.is_empty() && ready.renew_noise(&simulated) {
        refitted.weigh_anew(&ready.problem);
        found.weigh_anew(&ready.problem);
    }
    let problem = &ready.problem;
    let zero = vec![0.0; problem.nuisance.len()];
    let given_cost = sum_of_squares(&problem.residual(&problem.plant, &zero, &[], Fineness::FINE));
    let best = &found.best;
    let level = ready.noise_level(&simulated);
    // A stage that was looked at and not accepted says what is still there.
    let last = if found.stages.len() > best.effects.len() { found.stages.last() } else { None };
    let next = last.and_then(|entries| entries.first()).map_or(0.0, |entry| entry.gain);
    let mut judged = adequacy(problem.bent(&best.eta), next, best.cost, refitted.cost, given_cost, rows, level);
    // What fails with its own shape and suffices with a free one is this place, and another shape.
    let bent = shape::bent(problem, &quick, best).filter(|bent| best.cost - bent.fit.cost > 4.0 * WORTH);
    if let Some(bent) = &bent {
        let freed = adequacy(problem.bent(&bent.fit.eta), 0.0, bent.fit.cost, refitted.cost, given_cost, rows, level);
        judged.unknown = judged.unknown.min(freed.unknown).max(SHAPE_DIFFERS);
    }
    let free_shape = bent;
    let mut weighted = weigh(&found.candidates, judged.unknown, rows, level);
    // What quiet records show holds whatever the free runs say.
    let shown: Vec<&Placed> =
        unseen.iter().filter(|u| u.gain > EVIDENCE && !excluded(&u.placed)).map(|u| &u.placed).collect();
    for explanation in weighted.iter_mut().filter(|w| !w.unknown) {
        explanation.effects.extend(shown.iter().map(|placed| (*placed).clone()));
    }
    let top = weighted.first();
    let verdict = match top {
        Some(top) if top.unknown => Verdict::Unknown,
        Some(top) if top.effects.is_empty() => Verdict::None,
        Some(_) => Verdict::Effects,
        None => Verdict::Unknown,
    };

    say("gaps".into());
    let plant = problem.nuisance.apply(&problem.plant, &best.eta);
    let actions = problem.actions(&best.effects);
    let gaps = gaps(&ready, &quick, &refitted, &found, &plant, &actions, limits);
    let given_errors = locate::errors(problem);
    let before = locate::map(&problem.records, &given_errors, &ready.noise, plant.rate);
    let after_errors: Vec<Channels> =
        problem.records.iter().zip(outputs(problem, best)).map(|(record, y)| locate::error(record, &y)).collect();
    let after = locate::map(&problem.records, &after_errors, &ready.noise, plant.rate);

    let effects = if verdict == Verdict::Effects {
        named(&ready, best, &shown, &weighted, free_shape.map(|bent| bent.which))
    } else {
        Vec::new()
    };
    let place = place(&before, &names.outputs, &found, &shown);
    let candidates = weighted
        .iter()
        .map(|w| Explanation {
            effects: w
                .effects
                .iter()
                .map(|p| Located { effect: p.effect.name().into(), location: p.place.location(names) })
                .collect(),
            unknown: w.unknown,
            probability: w.probability,
            gap_after: w.cost.map(|cost| gaps.noise_floor * cost.max(0.0).sqrt()),
        })
        .collect::<Vec<_>>();
    let not_separable = classes(&found, names);
    let evidence = words(&ready, &refitted, &found, &before, &judged, given_cost);
    let diagnosis = Diagnosis {
        verdict,
        sentence: sentence(verdict, &effects, &gaps),
        next_experiment: next_experiment(verdict, &candidates),
        effects,
        candidates,
        not_separable,
        place,
        gap: gaps,
        evidence,
        warnings: case.warnings.clone(),
    };
    let simulation = written(&ready, model, best, &plant, &shown, verdict);
    let trace_record = ready.held_out.last().or(problem.records.last()).expect("a case has records").clone();
    let runs = |plant: &Plant, actions: &[Action]| run(plant, actions, &trace_record);
    let levels = one_of_each_level(&case.records).into_iter().map(|record| LevelRun {
        record: record.name.clone(),
        level: record.level(),
        u: record.u.clone(),
        y: record.y.clone(),
        given: run(&problem.plant, &[], record),
        with: run(&plant, &actions, record),
    });
    let noise_lines: Vec<(f64, nalgebra::DMatrix<crate::plant::C>)> = (1..NOISE_LINES)
        .map(|k| 0.5 * plant.rate * k as f64 / NOISE_LINES as f64)
        .map(|hz| (hz, ready.noise.density(hz)))
        .collect();
    let evidence = Evidence {
        outputs: names.outputs.clone(),
        rate: plant.rate,
        before,
        after,
        adequacy: judged,
        stages: found
            .stages
            .iter()
            .map(|entries| {
                let line = |e: &crate::screen::Entry| {
                    (e.placed.effect.name().to_string(), e.placed.place.location(names), e.gain, e.absorbed)
                };
                entries.iter().take(15).map(line).collect()
            })
            .collect(),
        trace: [trace_record.y.clone(), runs(&problem.plant, &[]), runs(&plant, &actions)],
        trace_record: trace_record.name,
        unseen: unseen
            .iter()
            .map(|u| (u.placed.effect.name().into(), u.placed.place.location(names), u.gain))
            .collect(),
        refit: refit_summary(problem, &best.eta),
        costs: [given_cost / rows, refitted.cost / rows, best.cost / rows],
        fitted: problem.records.iter().map(|r| (r.name.clone(), r.start_s, r.samples())).collect(),
        levels: levels.collect(),
        // One-sided, from a power spectral density that is the variance for white noise.
        noise: (0..plant.p)
            .map(|o| noise_lines.iter().map(|(hz, s)| (*hz, 2.0 * s[(o, o)].re / plant.rate)).collect())
            .collect(),
        linear: is_linear(&loudest(&problem.records).u, |u| simulate(&plant, &actions, u, 0.0, None, Fineness::FINE)),
    };
    let mut outcome = Outcome { diagnosis, simulation, evidence };
    audit.tell(&mut outcome);
    Ok(outcome)
}

/// A gap as given within this factor of the noise has nothing to shrink.
const NOISE_ONLY: f64 = 1.1;

/// Free runs of all fitted records.
fn outputs(problem: &Problem, fit: &Fit) -> Vec<Channels> {
    let plant = problem.nuisance.apply(&problem.plant, &fit.eta);
    let actions = problem.actions(&fit.effects);
    let run = |k| problem.outputs(&plant, &fit.eta, &actions, k, Fineness::FINE);
    (0..problem.records.len()).map(run).collect()
}

/// What a suspect is worth: odds of 50 : 1 against an entry that nobody named.
const SUSPECTED: f64 = 8.0;

/// Gaps on held-out records, or on the last driven one where nothing is held out.
fn gaps(
    ready: &Prepared,
    quick: &Problem,
    refitted: &Refit,
    found: &Search,
    plant: &Plant,
    actions: &[Action],
    limits: &Limits,
) -> Gap {
    let problem = &ready.problem;
    let loudest = loudest(&problem.records);
    let noise = ready.noise.rms();
    // Stated first, from what was fitted.
    let fitted: Vec<Channels> = problem.records.iter().map(|record| run(plant, actions, record)).collect();
    let stated = gap::expected(&problem.records, &fitted, loudest.level());
    let opened: Vec<&Record> = if ready.held_out.is_empty() { vec![loudest] } else { ready.held_out.iter().collect() };
    let record = opened[opened.len() - 1];
    let of = |plant: &Plant, actions: &[Action]| Blocks::new(&record.y, &run(plant, actions, record), 0);
    let given = of(&problem.plant, &[]);
    let refit_blocks = of(&refitted.plant, &[]);
    let with = of(plant, actions);
    let floor = gap::floor(&noise, &record.y);
    let (as_given, refit, with_effect) = (given.gap(), refit_blocks.gap(), with.gap());
    let wide =
        Limits { frequency: 40.0 * limits.frequency, damping: 10.0 * limits.damping, shape: 40.0 * limits.shape };
    let free = Problem {
        plant: quick.plant.clone(),
        records: quick.records.clone(),
        whiteners: quick.whiteners.clone(),
        nuisance: Nuisance::new(&quick.plant, &quick.records, &wide),
        setting: quick.setting.clone(),
    };
    let free = crate::refit::refit(&free);
    let free_refit = of(&free.plant, &[]).gap();
    let placebo = placebo(quick, found);
    let placebo_gap = placebo.map_or(refit, |(plant, actions)| of(&plant, &actions).gap());
    let ceiling = ceiling(quick, found);
    let ceiling_gap = ceiling.map_or(with_effect, |(plant, actions)| of(&plant, &actions).gap()).min(with_effect);
    let shrink = gap::shrink(as_given, with_effect, floor);
    let most = gap::shrink(as_given, ceiling_gap, floor);
    Gap {
        as_given,
        refit,
        free_refit,
        with_effect,
        noise_floor: floor,
        shrink,
        shrink_ci95: gap::shrink_interval(&given, &with, floor),
        shrink_over_refit: gap::shrink(refit, with_effect, floor),
        placebo_shrink: gap::shrink(as_given, placebo_gap, floor) - gap::shrink(as_given, refit, floor),
        share_of_ceiling: if most > 0.0 { (shrink / most).clamp(0.0, 1.0) } else { 1.0 },
        predicted_held_out_gap: stated,
        measured_on: opened.iter().map(|r| r.name.clone()).collect(),
    }
}

fn loudest(records: &[Record]) -> &Record {
    // The last of those at the highest level: a drift shows there as it will in what follows.
    let most = records.iter().map(Record::level).fold(0.0, f64::max);
    let random = records.iter().rev().find(|r| r.excitation == Excitation::Random && r.level() > 0.9 * most);
    random.or(records.iter().rev().find(|r| r.level() > 0.9 * most)).unwrap_or(&records[0])
}

/// Free run of a record; an unknown start is fitted to it first.
fn run(plant: &Plant, actions: &[Action], record: &Record) -> Channels {
    let start = (!record.from_rest).then(|| fitted_start(plant, actions, record));
    simulate(plant, actions, &record.u, record.start_s, start.as_ref(), Fineness::FINE)
}

/// The initial state that explains a record best, by least squares on the linear response.
fn fitted_start(plant: &Plant, actions: &[Action], record: &Record) -> State {
    let nuisance = Nuisance::new(plant, std::slice::from_ref(record), &Limits::default());
    let from_rest = simulate(plant, actions, &record.u, record.start_s, None, Fineness::FINE);
    let error: Vec<f64> = locate::error(record, &from_rest).into_iter().flatten().collect();
    let first = nuisance.len() - plant.n();
    let mut columns = nalgebra::DMatrix::zeros(error.len(), plant.n());
    nuisance.tangents(plant, record, 0, |column, y| {
        if column >= first {
            let flat: Vec<f64> = y.iter().flatten().copied().collect();
            columns.column_mut(column - first).copy_from_slice(&flat);
        }
    });
    let mut normal = columns.tr_mul(&columns);
    let ridge = 1e-9 * normal.trace().max(f64::MIN_POSITIVE);
    (0..plant.n()).for_each(|i| normal[(i, i)] += ridge);
    let gradient = columns.tr_mul(&nalgebra::DVector::from_vec(error));
    let solved = normal.cholesky().map_or_else(|| nalgebra::DVector::zeros(plant.n()), |c| c.solve(&gradient));
    let mut eta = vec![0.0; nuisance.len()];
    eta[first..].copy_from_slice(solved.as_slice());
    nuisance.start(0, &eta).unwrap_or_else(|| State::rest(plant))
}

/// Fits for comparison only.
const ROUGH: Effort = Effort { steps: 4, gain: 1.0, fineness: Fineness::COARSE };

/// A wrong effect with as many parameters: from the lower half of the screen, on another side of the chain.
fn placebo(problem: &Problem, found: &Search) -> Option<(Plant, Vec<Action>)> {
    let first = found.best.effects.first()?;
    let wanted = first.parameters.len();
    let entries = found.stages.first()?;
    let entry = entries
        .iter()
        .skip(entries.len() / 2)
        .find(|entry| entry.placed.effect.side() != first.effect.side() && entry.placed.parameters.len() == wanted)?;
    let tangent = problem.tangent(&problem.plant);
    let fit = problem.fit(&tangent, &vec![0.0; problem.nuisance.len()], std::slice::from_ref(&entry.placed), ROUGH);
    Some((problem.nuisance.apply(&problem.plant, &fit.eta), problem.actions(&fit.effects)))
}

/// The flexible model: the best explanation and, beside it, the three entries that would explain most of the rest.
fn ceiling(problem: &Problem, found: &Search) -> Option<(Plant, Vec<Action>)> {
    let mut effects = found.best.effects.clone();
    let entries = found.stages.last()?;
    effects.extend(entries.iter().filter(|e| e.gain > 20.0).take(3).map(|entry| entry.placed.clone()));
    let tangent = problem.tangent(&problem.nuisance.apply(&problem.plant, &found.best.eta));
    let fit = problem.fit(&tangent, &found.best.eta, &effects, ROUGH);
    Some((problem.nuisance.apply(&problem.plant, &fit.eta), problem.actions(&fit.effects)))
}

/// Effects of the answer with intervals and confidence.
fn named(
    ready: &Prepared,
    best: &Fit,
    shown: &[&Placed],
    weighted: &[Weighted],
    free_shape: Option<usize>,
) -> Vec<NamedEffect> {
    let setting = &ready.problem.setting;
    let names = &setting.names;
    let rows = ready.problem.rows() as f64;
    let quantile = StudentsT::new(0.0, 1.0, rows.max(3.0)).map_or(1.96, |t| t.inverse_cdf(0.975));
    // Where the fit leaves more than the noise, its intervals grow with it.
    let inflation = (best.cost / rows).max(1.0).sqrt();
    let confidence = |placed: &Placed| -> f64 {
        weighted
            .iter()
            .filter(|w| w.effects.iter().any(|e| crate::stepwise::same(e, placed)))
            .map(|w| w.probability)
            .sum()
    };
    let mut at = 0;
    let mut named = Vec::new();
    for (which, placed) in best.effects.iter().enumerate() {
        let mut parameters = BTreeMap::new();
        for (parameter, &value) in placed.effect.parameters(setting).iter().zip(&placed.parameters) {
            let half = quantile * best.covariance[(at, at)].max(0.0).sqrt() * inflation;
            let ci95 = half.is_finite().then_some([value - half, value + half]);
            parameters.insert(parameter.name.clone(), Value { value, ci95, unit: parameter.unit.clone() });
            at += 1;
        }
        named.push(NamedEffect {
            effect: placed.effect.name().into(),
            location: placed.place.location(names),
            confidence: confidence(placed),
            parameters,
            shape_differs: free_shape == Some(which),
        });
    }
    for placed in shown {
        let parameters = placed
            .effect
            .parameters(setting)
            .iter()
            .zip(&placed.parameters)
            .map(|(p, &value)| (p.name.clone(), Value { value, ci95: None, unit: p.unit.clone() }))
            .collect();
        named.push(NamedEffect {
            effect: placed.effect.name().into(),
            location: placed.place.location(names),
            confidence: confidence(placed),
            parameters,
            shape_differs: false,
        });
    }
    named
}

fn place(before: &Map, outputs: &[String], found: &Search, shown: &[&Placed]) -> Where {
    let named = found.best.effects.first().map(|placed| placed.effect.side());
    let screened = found.stages.first().and_then(|entries| entries.first()).map(|e| e.placed.effect.side());
    let side = named.or(shown.first().map(|p| p.effect.side())).or(screened).unwrap_or(Side::Structure);
    let channels = (0..outputs.len()).map(|o| (outputs[o].clone(), before.share.row(o).sum())).collect();
    let bands = before.share.row_sum();
    let mut order: Vec<usize> = (0..bands.len()).collect();
    order.sort_by(|&a, &b| bands[b].total_cmp(&bands[a]));
    let bands_hz = order
        .into_iter()
        .take(4)
        .filter(|&b| bands[b] > 0.02)
        .map(|b| [before.edges[b], before.edges[b + 1], bands[b]])
        .collect();
    let time = before.time.column_sum().iter().copied().collect();
    Where { side, channels, bands_hz, time, level_slope: before.slope }
}

/// Single explanations that fit equally well (their expected log likelihoods differ by less than five).
fn classes(found: &Search, names: &crate::effects::Names) -> Vec<Vec<String>> {
    let Some(best) = found.candidates.first().filter(|c| !c.effects.is_empty()) else { return Vec::new() };
    let text = |c: &crate::stepwise::Candidate| {
        let one = |p: &Placed| format!("{}@{}", p.effect.name(), p.place.location(names));
        c.effects.iter().map(one).collect::<Vec<_>>().join(" + ")
    };
    let mut class: Vec<String> = Vec::new();
    for candidate in &found.candidates {
        if candidate.effects.len() == best.effects.len() && candidate.cost - best.cost < 10.0 {
            let text = text(candidate);
            if !class.contains(&text) {
                class.push(text);
            }
        }
    }
    if class.len() > 1 { vec![class] } else { Vec::new() }
}

fn refit_summary(problem: &Problem, eta: &[f64]) -> Vec<(f64, f64, f64, f64)> {
    let mut modes: Vec<(f64, f64, f64, f64)> = problem.plant.modes.iter().map(|m| (m.hz(), 0.0, 0.0, 0.0)).collect();
    for (index, (x, std)) in eta.iter().zip(&problem.nuisance.std).enumerate() {
        let Some((mode, part)) = problem.nuisance.entry(index) else { continue };
        let z = x / std;
        match part {
            0 => modes[mode].1 = z,
            1 => modes[mode].2 = z,
            _ if z.abs() > modes[mode].3.abs() => modes[mode].3 = z,
            _ => {}
        }
    }
    modes
}

fn written(
    ready: &Prepared,
    model: &plid_model::Model,
    best: &Fit,
    plant: &Plant,
    shown: &[&Placed],
    verdict: Verdict,
) -> SimulationWithEffects {
    let setting = &ready.problem.setting;
    let records = &ready.problem.records;
    let t0 =
        records.iter().chain(&ready.held_out).map(|r| r.start_s + r.samples() as f64 / plant.rate).fold(0.0, f64::max);
    let fitted: &[Placed] = if verdict == Verdict::None { &[] } else { &best.effects };
    let effects = fitted
        .iter()
        .chain(shown.iter().copied())
        .map(|placed| WrittenEffect {
            effect: placed.effect.name().into(),
            location: written_place(placed, setting),
            parameters: placed
                .effect
                .parameters(setting)
                .iter()
                .zip(&placed.parameters)
                .map(|(p, &value)| (p.name.clone(), Value { value, ci95: None, unit: p.unit.clone() }))
                .collect(),
            given: given(placed, plant),
            equation: placed.effect.equation().into(),
        })
        .collect();
    let mut modal = plant.clone();
    let mut changed = false;
    for action in ready.problem.actions(fitted) {
        if let Action::Plant(change) = action {
            change(&mut modal);
            changed = true;
        }
    }
    let refit = refit_summary(&ready.problem, &best.eta)
        .iter()
        .zip(ready.problem.plant.modes.iter().zip(&plant.modes))
        .map(|(z, (from, to))| {
            format!(
                "mode {:.2} Hz: frequency {:.3} -> {:.3} Hz, damping ratio {:.4} -> {:.4}, shapes by up to {:.2} standard deviations of the stated limits",
                from.hz(), from.hz(), to.hz(), from.damping(), to.damping(), z.3.abs()
            )
        })
        .collect();
    SimulationWithEffects {
        format: "simulation-with-effects".into(),
        linear: plant.to_model(model).to_json(),
        modes: plant.modes.len(),
        linear_with_modal_effects: changed.then(|| modal.to_model(model).to_json()),
        refit,
        effects,
        t0,
        noise_rms: ready.noise.rms(),
    }
}

/// The actuator's present pole, for the effect that moves it.
fn given(placed: &Placed, plant: &Plant) -> BTreeMap<String, Value> {
    let pole = match placed.place {
        crate::effects::Place::Input(i) if placed.effect.name() == "actuator-lag" => plant.chain.actuator_hz(i),
        _ => None,
    };
    pole.map(|value| ("pole".into(), Value { value, ci95: None, unit: "Hz".into() })).into_iter().collect()
}

/// A disturbance's port matters for a prediction, and its location names the frequency alone.
fn written_place(placed: &Placed, setting: &crate::effects::Setting) -> String {
    let location = placed.place.location(&setting.names);
    match placed.place {
        crate::effects::Place::Frequency(_, port) => format!("{location} port:{}", setting.names.ports[port]),
        _ => location,
    }
}

fn sentence(verdict: Verdict, effects: &[NamedEffect], gap: &Gap) -> String {
    let percent = |x: f64| format!("{:.1} %", 100.0 * x);
    match verdict {
        Verdict::None => format!(
            "Nothing is missing: within its stated limits the simulation explains the records down to {} (noise {}).",
            percent(gap.refit),
            percent(gap.noise_floor)
        ),
        Verdict::Unknown => format!(
            "Something outside the vocabulary: the best explanation leaves {} of {}, where noise makes {}.",
            percent(gap.with_effect),
            percent(gap.as_given),
            percent(gap.noise_floor)
        ),
        Verdict::Effects => {
            let one = |e: &NamedEffect| format!("{} at {}", e.effect, e.location);
            let all = effects.iter().map(one).collect::<Vec<_>>().join(" and ");
            let sure = 100.0 * effects.iter().map(|e| e.confidence).fold(1.0, f64::min);
            if gap.as_given < NOISE_ONLY * gap.noise_floor {
                return format!(
                    "{all} ({sure:.0} % sure): it is noise that no simulation predicts, {} of the output.",
                    percent(gap.noise_floor)
                );
            }
            format!(
                "{all} ({sure:.0} % sure): with {} the gap falls from {} to {} (noise {}).",
                if effects.len() == 1 { "it" } else { "them" },
                percent(gap.as_given),
                percent(gap.with_effect),
                percent(gap.noise_floor)
            )
        }
    }
}

fn words(
    ready: &Prepared,
    refitted: &Refit,
    found: &Search,
    before: &Map,
    judged: &Adequacy,
    given_cost: f64,
) -> Vec<String> {
    let rows = ready.problem.rows() as f64;
    let names = &ready.problem.setting.names;
    let mut words = vec![format!(
        "Squared residual over noise: {:.3} as given, {:.3} after the bounded refit, {:.3} with the best explanation (1 is noise alone).",
        given_cost / rows,
        refitted.cost / rows,
        found.best.cost / rows
    )];
    if let Some(slope) = before.slope {
        words.push(format!("The relative gap goes with the level to the power {slope:+.1}."));
    }
    for placed in &found.best.effects {
        if let Some(entry) = found.stages.iter().flatten().find(|e| crate::stepwise::same(&e.placed, placed)) {
            words.push(format!(
                "{} at {}: a refit would absorb {:.0} % of its trace.",
                placed.effect.name(),
                placed.place.location(names),
                100.0 * entry.absorbed
            ));
        }
    }
    let other = found.candidates.iter().find(|c| {
        !c.effects.is_empty()
            && !c.effects.iter().all(|a| found.best.effects.iter().any(|b| crate::stepwise::same(a, b)))
    });
    if let (Some(other), false) = (other, found.best.effects.is_empty()) {
        let one = |p: &Placed| format!("{} at {}", p.effect.name(), p.place.location(names));
        words.push(format!(
            "The nearest other explanation, {}, is worse by {:.0} in log likelihood.",
            other.effects.iter().map(one).collect::<Vec<_>>().join(" + "),
            (other.cost - found.best.cost) / 2.0
        ));
    }
    words.push(format!("What is left exceeds the noise by {:.1} times the uncertainty of its level.", judged.excess));
    words
}

fn next_experiment(verdict: Verdict, candidates: &[Explanation]) -> Option<String> {
    if verdict == Verdict::None {
        return None;
    }
    let open: Vec<&Explanation> = candidates.iter().filter(|c| c.probability > 0.05).collect();
    if open.len() < 2 {
        return None;
    }
    Some("Record the same random input at a third and at twice the level, interleaved, with a record without input before and after.".into())
}
