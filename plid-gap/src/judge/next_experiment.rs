//! The next experiment: the one that would best separate the remaining explanations, by expected information.
//!
//! Each possible experiment with this setup is judged by each pair of the best explanation and a rival. The rival was
//! fitted to the prediction of the records by the best explanation (`separability.rs`). It is now fitted to the
//! prediction of the experiment, with the information of those records on its parameters as prior. The whitened part
//! that it cannot follow is twice the expected log likelihood ratio (Box and Hill 1967, with the noise known).

use nalgebra::DMatrix;

use crate::case::Limits;
use crate::case::levels::loudest;
use crate::case::record::{Channels, Excitation, Record};
use crate::fit::candidate::all_same;
use crate::fit::candidate::in_words;
use crate::fit::nuisance::Nuisance;
use crate::fit::problem::{Fit, Placed, Problem, sum_of_squares};
use crate::judge::explained::Explained;
use crate::judge::separability::{Predicted, Rival, open, predicted};
use crate::judge::verdict::Weighted;
use crate::noise::whiten::Whitener;
use crate::simulate::Fineness;
use crate::words::likelihood;

/// Returns the next experiment in words with its predicted gain; `None` if nothing is open.
pub fn next_experiment<'a>(
    explained: &Explained<'a>,
    weighted: &[Weighted<'a>],
    best: &[Placed],
    records: &Predicted<'a>,
    rivals: &[Rival<'a>],
) -> Option<String> {
    if weighted.len() < 2 {
        return None;
    }
    let settings = &records.problem.settings.judge;
    let mut fitted: Vec<Fit> = open(rivals, best, settings).map(|rival| rival.fit.clone()).collect();
    let most = fitted.len().max(settings.experiment_rivals);
    for likely in weighted.iter().filter(|w| !w.unknown && w.probability > settings.open_probability) {
        let effects: Vec<Placed> = likely.effects.iter().filter(|p| !p.effect.is_stochastic()).cloned().collect();
        let there = all_same(&effects, best) || fitted.iter().any(|fit| all_same(&fit.effects, &effects));
        if fitted.len() < most && !there {
            let compared = rivals.iter().find(|rival| all_same(&rival.effects, &effects));
            fitted.push(compared.map_or_else(|| records.fit(&effects), |rival| rival.fit.clone()));
        }
    }
    if fitted.is_empty() {
        let unknown = weighted.iter().find(|w| w.unknown).map_or(0.0, |w| w.probability);
        return (unknown > settings.open_unknown).then(|| by_rule(explained));
    }
    let known: Vec<Option<DMatrix<f64>>> = fitted.iter().map(|fit| known(&records.problem, fit)).collect();
    let mut proposed: Option<(f64, String)> = None;
    for experiment in experiments(&records.problem) {
        let problem = imagined(explained, &records.truth, &experiment);
        let least = fitted
            .iter()
            .zip(&known)
            .map(|(fit, known)| known.as_ref().map_or(0.0, |known| gain(&problem, fit, known)))
            .fold(f64::INFINITY, f64::min);
        if proposed.as_ref().is_none_or(|(most, _)| least > *most) {
            proposed = Some((least, experiment.words));
        }
    }
    let (gain, words) = proposed?;
    let name = |effects: &[Placed]| in_words(effects, &records.problem.setting.names);
    let others: Vec<String> = fitted.iter().map(|fit| name(&fit.effects)).collect();
    let from = format!("{} from {}", name(best), others.join(" and from "));
    Some(if gain > settings.separable {
        format!(
            "{words}: {} samples are expected to distinguish {from} by {}.",
            settings.experiment_samples,
            likelihood(gain)
        )
    } else {
        format!(
            "No tested input level distinguishes {from} ({words}: {gain:.1} in log likelihood, where {:.0} is needed): \
            a sensor or an input at another location is necessary.",
            settings.separable
        )
    })
}

/// Proposes an experiment by rule: if something outside the vocabulary acts, no model predicts its behaviour elsewhere.
fn by_rule(explained: &Explained) -> String {
    let records = &explained.ready.problem.records;
    let levels = records.iter().filter(|r| r.is_driven()).map(Record::level);
    let (least, most) = levels.fold((f64::INFINITY, 0.0_f64), |(a, b), x| (a.min(x), b.max(x)));
    let mut wanted = Vec::new();
    if most < 2.0 * least {
        wanted.push("the same random input at a third and at twice the level, interleaved");
    }
    if records.iter().all(|r| !matches!(r.excitation, Excitation::Periodic(_))) {
        wanted.push(
            "a random-phase multisine of odd lines over six periods or more, whose even and left-out lines \
        show the kind",
        );
    }
    if records.iter().all(|r| r.excitation != Excitation::Zero) {
        wanted.push("a record without input");
    }
    if explained.ready.problem.plant.m > 1 {
        wanted.push("each input alone at the highest level");
    }
    if wanted.is_empty() {
        wanted
            .push("a sine at the frequency where most of the gap lies, at several levels: its harmonics show the kind");
    }
    format!("Nothing in the vocabulary explains the remainder; to identify it, record {}.", wanted.join(", then "))
}

/// A possible input.
struct Experiment {
    u: Channels,
    words: String,
}

/// Returns the loudest input at other levels, and each input alone.
fn experiments(problem: &Problem) -> Vec<Experiment> {
    let samples = problem.settings.judge.experiment_samples;
    let loudest = loudest(&problem.records, problem.settings.case.same_level);
    let scaled = |by: &dyn Fn(usize) -> f64| -> Channels {
        let scale = |(i, u): (usize, &Vec<f64>)| u.iter().take(samples).map(|x| by(i) * x).collect();
        loudest.u.iter().enumerate().map(scale).collect()
    };
    let mut experiments = Vec::new();
    for (level, words) in [
        (1.0, "Record the input of the loudest record once more, from rest"),
        (1.0 / 3.0, "Record the input of the loudest record at a third of its level"),
        (2.0, "Record the input of the loudest record at twice its level"),
        (4.0, "Record the input of the loudest record at four times its level"),
    ] {
        experiments.push(Experiment { u: scaled(&|_| level), words: words.into() });
    }
    let names = &problem.setting.names.inputs;
    if names.len() > 1 {
        for (alone, name) in names.iter().enumerate() {
            let words = format!("Record with {name} alone at twice its highest level");
            experiments.push(Experiment { u: scaled(&|i| if i == alone { 2.0 } else { 0.0 }), words });
        }
    }
    experiments
}

/// Returns what would be measured if the best explanation were true.
fn imagined(explained: &Explained, best: &Fit, experiment: &Experiment) -> Problem {
    let problem = &explained.ready.problem;
    let ends = problem.records.iter().map(|r| r.start_s + r.samples() as f64 / problem.plant.rate);
    let record = Record {
        name: String::new(),
        excitation: Excitation::Random,
        from_rest: true,
        start_s: ends.fold(0.0, f64::max),
        held_out: false,
        u: experiment.u.clone(),
        y: vec![vec![0.0; experiment.u[0].len()]; problem.plant.p],
        simulated: None,
    };
    let masked = vec![Vec::new(); problem.plant.p];
    let whitener = Whitener::new(&record, &explained.ready.noise, problem.plant.rate, masked);
    let records = vec![record];
    let nuisance = Nuisance::new(&problem.plant, &records, &Limits::default());
    let (plant, setting) = (problem.plant.clone(), problem.setting.clone());
    let settings = problem.settings.clone();
    let made = Problem { plant, records, whiteners: vec![whitener], nuisance, setting, settings, strong: false };
    predicted(&made, &best.eta[..made.nuisance.len()], &best.effects)
}

/// Returns the information of the records on a rival's parameters, without the initial states.
fn known(problem: &Problem, fit: &Fit) -> Option<DMatrix<f64>> {
    let (normal, _) = problem.information(fit, &fit.residual);
    let kept: Vec<usize> =
        (0..problem.nuisance.of_simulation()).chain(problem.nuisance.len()..normal.nrows()).collect();
    let covariance = normal.cholesky()?.inverse();
    let part = DMatrix::from_fn(kept.len(), kept.len(), |i, j| covariance[(kept[i], kept[j])]);
    part.cholesky().map(|factor| factor.inverse())
}

/// Returns the expected log likelihood ratio against a rival.
fn gain(problem: &Problem, rival: &Fit, known: &DMatrix<f64>) -> f64 {
    let eta = rival.eta[..problem.nuisance.len()].to_vec();
    let rival = Fit { eta, ..rival.clone() };
    let plant = problem.nuisance.apply(&problem.plant, &rival.eta);
    let residual = problem.residual(&plant, &rival.eta, &rival.effects, Fineness::COARSE);
    let (mut normal, gradient) = problem.information(&rival, &residual);
    for (j, std) in problem.nuisance.std.iter().enumerate() {
        normal[(j, j)] -= 1.0 / (std * std);
    }
    let energy = sum_of_squares(&residual);
    let absorbed = (normal + known).cholesky().map_or(energy, |factor| gradient.dot(&factor.solve(&gradient)));
    0.5 * (energy - absorbed).max(0.0)
}
