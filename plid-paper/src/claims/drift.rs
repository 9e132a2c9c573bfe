//! Claim: PLID follows a plant that changes slowly.

use ndarray::{Array2, ArrayView2, s};
use plid_core::{Dense, ImplicitModel, InitialCovariance, ObservableForm, Settings};
use plid_lab::experiment::Experiment;
use plid_lab::identify::ToModel;
use plid_model::signal::error_measures;
use plid_model::signal::median;
use plid_model::{Model, estimate_initial_state, simulate};
use plid_testbed::EffectsConfig;
use rayon::prelude::*;
use serde::Deserialize;

use crate::claim::{Claim, Context, Finding, Result, claim};
use crate::course::{Course, Pair, course, form_and_start, noise_of};
use crate::truss::{truss_of, with_seed};

pub const CLAIM: Claim = claim!("drift",
    statement: "Slow variation in time needs re-identification.",
    limit: "The drift is one of stiffness, linear in time, of all modes alike; its rate is stated.",
    timed: false,
);

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Vary {
    duration_s: f64,
    drift_per_s: f64,
    /// The end of the record, on which models are judged, and the preceding part, from which the plant is identified
    /// again.
    check_s: f64,
    recent_s: f64,
    tune_samples: usize,
    forgetting: Vec<f64>,
    widen: Vec<f64>,
    seeds: u64,
}

/// Returns a start from the parameters of an earlier run with an increased covariance. Nothing is known about the
/// state.
fn from_last(form: &ObservableForm, former: &Course, widen: f64) -> Settings {
    let (n, size) = (form.states(), form.joint_states());
    let known = &former.identified.covariance;
    let covariance = Dense::from_fn(size, size, |i, j| match (i < n, j < n) {
        (false, false) => widen * known.at(i, j),
        (true, true) if i == j => 1.0,
        _ => 0.0,
    });
    let mut estimate = vec![0.0; n];
    estimate.extend(former.identified.parameters(form));
    Settings {
        initial_covariance: InitialCovariance::Full(covariance),
        initial_estimate: estimate,
        ..Settings::new(form, 1.0, 1.0)
    }
}

/// Returns the free-run error over a record in per cent, with a fitted initial state.
fn free_run(model: &Model, (inputs, outputs): Pair<'_>) -> Result<f64> {
    let start = estimate_initial_state(model, inputs, outputs, None)?;
    let simulated = simulate(model, inputs, &start.state)?;
    Ok(100.0 * error_measures(outputs, simulated.outputs.view())?.overall_relative)
}

/// Returns the errors of all methods on one record, in the order of their names.
fn ways(experiment: &Experiment, vary: &Vary, noise: &plid_core::NoiseModel) -> Result<Vec<f64>> {
    let mut experiment = experiment.clone();
    let states = experiment.structure.states.unwrap_or(30);
    truss_of(&mut experiment).duration_s = vary.duration_s;
    let simulation = plid_testbed::simulate(truss_of(&mut experiment))?;
    let rate = simulation.sample_rate_hz;
    let part = |array: &Array2<f64>, from: usize, to: usize| array.slice(s![from..to, ..]).to_owned();
    let record =
        |from: usize, to: usize| (part(&simulation.commands, from, to), part(&simulation.outputs[0], from, to));
    let all = simulation.commands.nrows();
    let check = all - (vary.check_s * rate) as usize;
    let recent = check - (vary.recent_s * rate) as usize;
    let (before, late, whole, last) = (record(0, recent), record(recent, check), record(0, check), record(check, all));
    fn views((inputs, outputs): &(Array2<f64>, Array2<f64>)) -> (ArrayView2<'_, f64>, ArrayView2<'_, f64>) {
        (inputs.view(), outputs.view())
    }
    let start = form_and_start(states, views(&whole))?;
    let with = |settings: Settings| (start.0.clone(), settings);
    let go = |record: &(Array2<f64>, Array2<f64>), start: &(ObservableForm, Settings)| {
        course(views(record), rate, start, noise, usize::MAX)
    };
    let judge = |done: &Course| free_run(&done.identified.to_model(rate)?, views(&last));
    let former = go(&before, &start)?;
    let mut errors = vec![judge(&former)?, judge(&go(&whole, &start)?)?, judge(&go(&late, &start)?)?];
    for &forgetting in &vary.forgetting {
        errors.push(judge(&go(&whole, &with(Settings { forgetting, ..start.1.clone() }))?)?);
    }
    for &widen in &vary.widen {
        errors.push(judge(&go(&late, &with(from_last(&start.0, &former, widen)))?)?);
    }
    Ok(errors)
}

/// Returns the names of the methods, in the order of their errors.
fn names(vary: &Vary) -> Vec<String> {
    ["one run, ended before the last stretch", "one run over all", "anew from the last stretch alone"]
        .into_iter()
        .map(String::from)
        .chain(vary.forgetting.iter().map(|f| format!("forgetting {f}")))
        .chain(vary.widen.iter().map(|w| format!("from the last P, widened {w:e} times")))
        .collect()
}

/// Returns the medians over the seeds of the errors of all methods, in the order of their names.
fn medians(experiment: &Experiment, vary: &Vary, noise: &plid_core::NoiseModel) -> Result<Vec<f64>> {
    let states = experiment.structure.states.unwrap_or(30);
    let runs = (1..=vary.seeds).into_par_iter().map(|seed| ways(&with_seed(experiment, states, seed), vary, noise));
    let runs = runs.collect::<Result<Vec<_>>>()?;
    Ok((0..runs[0].len()).map(|k| median(&runs.iter().map(|run| run[k]).collect::<Vec<_>>())).collect())
}

fn run(context: &Context<'_>) -> Result<Finding> {
    let (base, vary): (_, Vary) = (context.experiment()?, context.vary()?);
    let mut still = base.clone();
    truss_of(&mut still).effects = EffectsConfig::default();
    let mut drifting = base.clone();
    truss_of(&mut drifting).effects.stiffness_drift_per_s = vary.drift_per_s;
    // These are the noise covariances of the plant without drift.
    let noise = noise_of(&context.identify(&crate::truss::with_samples(&still, vary.tune_samples))?);
    let names = names(&vary);
    let (quiet, moved) = (medians(&still, &vary, &noise)?, medians(&drifting, &vary, &noise)?);
    let mut finding = Finding::default();
    for (k, name) in names.iter().enumerate() {
        finding =
            finding.figure(format!("no drift, {name}"), quiet[k], "%").figure(format!("drift, {name}"), moved[k], "%");
    }
    let rows = names
        .iter()
        .zip(quiet.iter().zip(&moved))
        .map(|(name, (q, m))| vec![name.clone(), format!("{q:.2}"), format!("{m:.2}")]);
    let least = |values: &[f64]| values.iter().copied().fold(f64::INFINITY, f64::min);
    let forgets = 3 + vary.forgetting.len();
    let (one, floor) = (moved[1].min(moved[0]), quiet[1]);
    let (forgetting, again, anew) = (least(&moved[3..forgets]), least(&moved[forgets..]), moved[2]);
    let best = again.min(anew);
    let total = 50.0 * vary.drift_per_s * vary.duration_s;
    Ok(finding
        .figure("change of frequencies over the record", total, "%")
        .part(
            "Without re-identification the drift makes the free-run error at least half as large again as without \
            drift.",
            one > 1.5 * floor,
        )
        .part(
            "Identified again over the last stretch, the model comes at least half-way \
            back.",
            best - floor < 0.5 * (one - floor),
        )
        .part(
            "Forgetting leaves an error more than a tenth larger than identifying again does: it is \
            re-identification that is needed.",
            forgetting > 1.1 * best,
        )
        .table(
            &format!(
                "Free-run error over the last {} s, initial state fitted, median over {} seeds; the last stretch \
                 before it is {} s long.",
                vary.check_s, vary.seeds, vary.recent_s
            ),
            &[("way", ""), ("no drift", "%"), ("drift", "%")],
            rows.collect(),
        )
        .say(format!(
            "Frequencies drift by {total:.2} % in {} s. One run then simulates with {one:.1} % ({floor:.1} % without \
             drift); identified again over the last {} s, {again:.1} % from the last P and {anew:.1} % from scratch; \
             with forgetting {forgetting:.1} %.",
            vary.duration_s, vary.recent_s
        )))
}
