//! Simulated cases with one known effect each: how often the diagnosis finds it at its location, and how often its
//! true parameters lie in the stated intervals.
//!
//! ```sh
//! cargo run --release --example backward_study -- [EFFECT...] \
//!     [--seeds 40] [--first 1] [--length 1.0] [--jobs 1] [--out FOLDER]
//! ```
//!
//! There is one case for each effect and seed, with a gap of 5 to 15 %, ports and all six records. The plant is the
//! truss. If the effect makes no sense on the truss, the plant is one of the others that can have it, in turn. `all`
//! stands for every effect of the vocabulary. EFFECT+PARAMETER stands for the cases of an effect that have a parameter
//! which others leave out: `iwan-joint+s` is a joint of which the simulation contains a share s as a spring. Effects
//! that the limits of the simulation allow (of frequencies, damping ratios, gains) are drawn beyond these limits, with
//! a larger gap. With `--out`, each finished case is written to a file in FOLDER, and the same command continues after
//! an interruption. Without arguments, it is a trial of a few seconds with one effect, one seed and short records.

use std::collections::BTreeMap;
use std::error::Error;
use std::f64::consts::PI;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::time::Instant;

use clap::Parser;
use plid::gap::answer::predict::Predictor;
use plid::gap::answer::schema::{Explanation, Value};
use plid::gap::case::{Case, columns};
use plid::gap::effects::Library;
use plid::model::to_json;
use plid::testbed::gap::{EffectSpec, GapCase, GapError, GapSpec, LabelledEffect, PlantKind, draw};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

#[derive(Parser)]
struct Arguments {
    /// Effects of the vocabulary, each with a parameter that its cases have (`iwan-joint+s`), or `all`.
    effects: Vec<String>,
    /// Number of cases of each effect.
    #[arg(long, default_value_t = 40)]
    seeds: u64,
    /// The first seed.
    #[arg(long, default_value_t = 1)]
    first: u64,
    /// Length of the records relative to full ones.
    #[arg(long, default_value_t = 1.0)]
    length: f64,
    /// Number of cases at a time.
    #[arg(long, default_value_t = 1)]
    jobs: usize,
    /// Folder for finished cases.
    #[arg(long)]
    out: Option<PathBuf>,
}

/// Smallest and largest gap. Gaps are drawn evenly in their logarithm.
const GAPS: [f64; 2] = [0.05, 0.15];

/// Factor by which the gap is increased, repeatedly, while an effect lies within the limits of the simulation's own
/// errors.
const STRONGER: f64 = 1.3;

/// Distance between the seeds that are drawn in turn until a case has a parameter that its kind may leave out, and the
/// number of these seeds.
const NEXT_SEED: u64 = 100_000;
const MOST_SEEDS: u64 = 20;

/// Smallest ratio of the gap to the noise floor for which a shrink is stated. Random effects belong to the floor.
const STANDS_OUT: f64 = 1.5;

/// The result of a case.
#[derive(Serialize, Deserialize)]
struct Found {
    effect: String,
    seed: u64,
    /// The specification of the case, by which the files of another study are recognised.
    spec: GapSpec,
    /// The reason why there is no case, which is that no strength of this draw gives the gap. `None` if there is a
    /// case.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    undrawn: Option<String>,
    /// The effects that were named, with their locations.
    named: Vec<(String, String)>,
    /// Whether the first named effect is the true one at its location.
    located: bool,
    /// Whether the true effect at its location is the first effect of an explanation in the 95 % set.
    in_set: bool,
    /// The true and the stated value of each parameter, if the effect was found.
    parameters: BTreeMap<String, (f64, Option<Value>)>,
    /// Whether all true values lie in their intervals; `None` if one has no interval.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    covered: Option<bool>,
    /// Share of the gap beyond the noise that is closed on the held-out record; `None` if the gap there is not larger
    /// than the noise.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    shrink: Option<f64>,
    seconds: f64,
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = Arguments::parse();
    if arguments.effects.is_empty() {
        println!("a trial of seconds; for the study: --example backward_study -- all [--seeds 40]");
        arguments = Arguments { effects: vec!["sensor-offset".into()], seeds: 1, length: 0.2, ..arguments };
    }
    if arguments.effects == ["all"] {
        arguments.effects = Library::standard().effects().map(|effect| effect.name().to_owned()).collect();
    }
    if let Some(out) = &arguments.out {
        fs::create_dir_all(out)?;
    }
    let seeds = arguments.first..arguments.first + arguments.seeds;
    let todo: Vec<(&str, u64)> =
        arguments.effects.iter().flat_map(|effect| seeds.clone().map(move |seed| (effect.as_str(), seed))).collect();
    let (next, results) = (Mutex::new(todo.iter()), Mutex::new(Vec::new()));
    std::thread::scope(|scope| {
        for _ in 0..arguments.jobs.max(1) {
            scope.spawn(|| {
                loop {
                    let Some((effect, seed)) = next.lock().expect("no thread panics with it").next() else { break };
                    let result = one(effect, *seed, &arguments).map_err(|e| format!("{effect}, seed {seed}: {e}"));
                    let mut results = results.lock().expect("no thread panics with it");
                    results.push(result);
                    let word = match results.last() {
                        Some(Ok(found)) if found.undrawn.is_some() => "not drawn".to_owned(),
                        Some(Ok(found)) if found.located => "found".to_owned(),
                        Some(Ok(found)) => format!("{:?}", found.named),
                        Some(Err(error)) => error.clone(),
                        None => String::new(),
                    };
                    eprintln!("{}/{} {effect}, seed {seed}: {word}", results.len(), todo.len());
                }
            });
        }
    });
    let found = results.into_inner()?.into_iter().collect::<Result<Vec<Found>, String>>()?;
    print_table(&arguments.effects, &found);
    Ok(())
}

/// Returns a finished case from its file, or computes it.
fn one(effect: &str, seed: u64, arguments: &Arguments) -> Result<Found, Box<dyn Error>> {
    let spec = spec(effect, seed, arguments.length);
    let file = arguments.out.as_ref().map(|out| out.join(format!("{effect}-{seed}.json")));
    if let Some(file) = file.as_ref().filter(|file| file.exists()) {
        let kept: Found = serde_json::from_str(&fs::read_to_string(file)?)?;
        if kept.spec != spec {
            return Err(format!("{} is of another study", file.display()).into());
        }
        return Ok(kept);
    }
    let found = plant_and_find(effect, seed, spec)?;
    if let Some(file) = file {
        let beside = file.with_extension("part");
        fs::write(&beside, to_json(&found)?)?;
        fs::rename(beside, file)?;
    }
    Ok(found)
}

/// Returns the specification of a case. Every other simulation is slightly wrong.
fn spec(effect: &str, seed: u64, length: f64) -> GapSpec {
    let (effect, _) = kind(effect);
    let share: f64 = ChaCha8Rng::seed_from_u64(seed).random();
    let gap = GAPS[0] * (GAPS[1] / GAPS[0]).powf(share);
    let effects = vec![EffectSpec { kind: effect.to_owned(), at: None, law: None, gap }];
    let plant = plant(effect, seed);
    let (channels, perturbed) = (plant.channels(), seed % 2 == 1);
    GapSpec { effects, perturbed, ports: true, length, plant, channels, ..GapSpec::default() }
}

/// Returns the effect of `EFFECT+PARAMETER`, and the parameter if there is one.
fn kind(effect: &str) -> (&str, Option<&str>) {
    effect.split_once('+').map_or((effect, None), |(effect, parameter)| (effect, Some(parameter)))
}

/// Returns the plant of a case: the truss if the effect makes sense on it, otherwise one of those that can have it.
fn plant(effect: &str, seed: u64) -> PlantKind {
    if PlantKind::Truss.takes(effect) {
        return PlantKind::Truss;
    }
    let takers: Vec<PlantKind> = PlantKind::ALL.into_iter().filter(|plant| plant.takes(effect)).collect();
    takers.get(seed as usize % takers.len().max(1)).copied().unwrap_or_default()
}

fn plant_and_find(effect: &str, seed: u64, spec: GapSpec) -> Result<Found, Box<dyn Error>> {
    let clock = Instant::now();
    let mut found = Found {
        effect: effect.to_owned(),
        seed,
        spec,
        undrawn: None,
        named: Vec::new(),
        located: false,
        in_set: false,
        parameters: BTreeMap::new(),
        covered: None,
        shrink: None,
        seconds: 0.0,
    };
    let drawn = match with_parameter(seed, &found.spec, kind(effect).1) {
        Ok(drawn) => drawn,
        Err(error @ (GapError::Unreachable { .. } | GapError::Unseen { .. })) => {
            return Ok(Found { undrawn: Some(error.to_string()), ..found });
        }
        Err(error) => return Err(error.into()),
    };
    let folder = tempfile::tempdir()?;
    let (at, answer) = (folder.path().join("case"), folder.path().join("answer"));
    drawn.write(&at, &folder.path().join("label"))?;
    fs::create_dir(&answer)?;
    let case = Case::read(&at.join("case.toml"))?;
    let outcome = plid::gap::diagnose(&case, &Library::standard(), &mut |_| {})?;
    plid::gap::write(&outcome, &case, &answer)?;

    let truth = &drawn.label.effects[0];
    let named = &outcome.diagnosis.effects;
    found.named = named.iter().map(|e| (e.effect.clone(), e.location.clone())).collect();
    if let Some(first) = named.first().filter(|e| e.effect == truth.effect && truth.is_at(&e.location)) {
        found.located = true;
        found.parameters = parameters(truth, &first.parameters);
        let each: Option<Vec<bool>> = found.parameters.iter().map(|(name, pair)| covers(name, pair)).collect();
        found.covered = each.map(|each| each.into_iter().all(|is_in| is_in));
    }
    found.in_set = in_set(truth, &outcome.diagnosis.candidates);
    found.shrink = shrink(&drawn, &answer)?;
    found.seconds = clock.elapsed().as_secs_f64();
    Ok(found)
}

/// Draws a case whose effect has this parameter, if one is given.
fn with_parameter(seed: u64, spec: &GapSpec, parameter: Option<&str>) -> Result<GapCase, GapError> {
    let has = |case: &GapCase| {
        let truth = &case.label.effects[0];
        parameter.is_none_or(|name| truth.parameter_names().iter().zip(&truth.par).any(|(known, _)| *known == name))
    };
    let mut drawn = clear(seed, spec)?;
    for further in 1..MOST_SEEDS {
        if has(&drawn) {
            break;
        }
        drawn = clear(seed + further * NEXT_SEED, spec)?;
    }
    Ok(drawn)
}

/// Draws a case. An effect within the stated limits of the simulation cannot be found, so its gap is increased until
/// the effect is beyond them.
fn clear(seed: u64, spec: &GapSpec) -> Result<GapCase, GapError> {
    let mut spec = spec.clone();
    loop {
        let drawn = draw(seed, &spec)?;
        if drawn.label.effects[0].clear_of_nuisance {
            return Ok(drawn);
        }
        spec.effects[0].gap *= STRONGER;
    }
}

/// Returns whether an effect is the first one of an explanation in the 95 % set.
fn in_set(truth: &LabelledEffect, candidates: &[Explanation]) -> bool {
    let mut before = 0.0;
    candidates.iter().any(|candidate| {
        let is_in = before < 0.95;
        before += candidate.probability;
        is_in && candidate.effects.first().is_some_and(|e| e.effect == truth.effect && truth.is_at(&e.location))
    })
}

fn parameters(truth: &LabelledEffect, stated: &BTreeMap<String, Value>) -> BTreeMap<String, (f64, Option<Value>)> {
    let values = truth.parameter_names().iter().zip(&truth.par);
    values.map(|(name, value)| ((*name).to_owned(), (*value, stated.get(*name).cloned()))).collect()
}

/// Returns whether the true value is in the stated interval. An amplitude of the other sign is the same signal with a
/// phase that differs by half a turn, so amplitudes are compared up to their sign, and phases up to half a turn.
fn covers(name: &str, (truth, stated): &(f64, Option<Value>)) -> Option<bool> {
    let stated = stated.as_ref()?;
    let [low, high] = stated.ci95?;
    let truth = match name {
        "a" => truth.abs() * stated.value.signum(),
        "phi" => truth + PI * ((stated.value - truth) / PI).round(),
        _ => *truth,
    };
    Some((low..=high).contains(&truth))
}

/// Returns the shrink on the held-out record. Both gaps are taken beyond the noise floor.
fn shrink(drawn: &GapCase, answer: &Path) -> Result<Option<f64>, Box<dyn Error>> {
    if drawn.label.gap_sim < STANDS_OUT * drawn.label.gap_floor {
        return Ok(None);
    }
    let predictor = Predictor::read(&answer.join("sim-with-effect.json"), &Library::standard())?;
    let simulated = predictor.run(&columns(&drawn.held_out.commands), predictor.t0);
    let measured = columns(&drawn.held_out.outputs);
    let squares = measured.iter().zip(&simulated).map(|(y, s)| {
        let error: f64 = y.iter().zip(s).map(|(y, s)| (y - s).powi(2)).sum();
        error / y.iter().map(|y| y * y).sum::<f64>()
    });
    let gap = (squares.sum::<f64>() / measured.len() as f64).sqrt();
    let beyond = |gap: f64| (gap.powi(2) - drawn.label.gap_floor.powi(2)).max(0.0).sqrt();
    Ok(Some(1.0 - beyond(gap) / beyond(drawn.label.gap_sim)))
}

fn print_table(effects: &[String], found: &[Found]) {
    println!(
        "| effect | located | in the 95 % set | parameters in their intervals | median shrink | mean s | no case |"
    );
    println!("|---|---|---|---|---|---|---|");
    for effect in effects {
        let (cases, undrawn): (Vec<&Found>, Vec<&Found>) =
            found.iter().filter(|f| f.effect == *effect).partition(|f| f.undrawn.is_none());
        let located: Vec<&&Found> = cases.iter().filter(|f| f.located).collect();
        let kept = cases.iter().filter(|f| f.in_set).count();
        let intervals: Vec<bool> = located.iter().filter_map(|f| f.covered).collect();
        let covered = intervals.iter().filter(|covered| **covered).count();
        let mut shrinks: Vec<f64> = located.iter().filter_map(|f| f.shrink).collect();
        shrinks.sort_by(f64::total_cmp);
        let median = shrinks.get(shrinks.len() / 2).map_or("-".to_owned(), |shrink| format!("{shrink:.3}"));
        let seconds = cases.iter().map(|f| f.seconds).sum::<f64>() / cases.len().max(1) as f64;
        println!(
            "| {effect} | {} of {} | {kept} | {covered} of {} | {median} | {seconds:.1} | {} |",
            located.len(),
            cases.len(),
            intervals.len(),
            undrawn.len()
        );
    }
}
