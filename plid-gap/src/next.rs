//! What next: the experiment that would part what is left, by expected information.
//!
//! For each experiment that could be made with this setup, and each pair of the best explanation and a rival: the rival is fitted to what
//! the best explanation says that would be measured, with all that the records already say of its parameters. What it cannot follow, whitened, is
//! twice the expected log likelihood ratio (Box and Hill 1967, with the noise known).

use nalgebra::DMatrix;

use crate::diagnosis::Explanation;
use crate::explain::Explained;
use crate::nuisance::{Limits, Nuisance};
use crate::problem::{Effort, Fit, Problem, sum_of_squares};
use crate::record::{Channels, Excitation, Record};
use crate::shrink::loudest;
use crate::simulate::Fineness;
use crate::verdict::{Verdict, Weighted};
use crate::whiten::Whitener;

/// Rivals that are looked at, and the probability from which an explanation is one.
const RIVALS: usize = 3;
const OPEN: f64 = 0.02;

/// Expected log likelihood ratio from which an experiment settles a question: odds of 150 : 1.
const SETTLES: f64 = 5.0;

/// Samples of an experiment.
const SAMPLES: usize = 2000;

const ROUGH: Effort = Effort { steps: 4, gain: 1.0, fineness: Fineness::COARSE };

/// The experiment to make next, in words with its predicted gain; none where nothing is open.
pub(crate) fn next_experiment(
    explained: &Explained,
    verdict: Verdict,
    weighted: &[Weighted],
    candidates: &[Explanation],
) -> Option<String> {
    if verdict == Verdict::None || weighted.len() < 2 {
        return None;
    }
    let open = |w: &&Weighted| !w.unknown && w.probability > OPEN && !alike(w, &explained.found.best);
    let rivals: Vec<&Weighted> = weighted.iter().filter(open).take(RIVALS).collect();
    let unknown = weighted.iter().find(|w| w.unknown).map_or(0.0, |w| w.probability);
    if rivals.is_empty() {
        return (unknown > 0.05).then(|| by_rule(explained));
    }
    let quick = &explained.quick;
    let tangent = quick.tangent(&quick.nuisance.apply(&quick.plant, &explained.found.best.eta));
    let fitted: Vec<Fit> =
        rivals.iter().map(|rival| quick.fit(&tangent, &explained.found.best.eta, &rival.effects, ROUGH)).collect();
    let known: Vec<Option<DMatrix<f64>>> = fitted.iter().map(|fit| known(quick, fit)).collect();
    let mut best: Option<(f64, String)> = None;
    for experiment in experiments(quick) {
        let problem = imagined(explained, &experiment);
        let least = fitted
            .iter()
            .zip(&known)
            .map(|(fit, known)| known.as_ref().map_or(0.0, |known| gain(&problem, fit, known)))
            .fold(f64::INFINITY, f64::min);
        if best.as_ref().is_none_or(|(most, _)| least > *most) {
            best = Some((least, experiment.words));
        }
    }
    let (gain, words) = best?;
    let name =
        |k: usize| -> String {
            let text = |e: &crate::diagnosis::Located| format!("{} at {}", e.effect, e.location);
            let effects = candidates.iter().filter(|c| !c.unknown).nth(k).map(|c| c.effects.iter().map(text).collect());
            effects.map_or_else(String::new, |effects: Vec<String>| {
                if effects.is_empty() { "nothing".to_string() } else { effects.join(" + ") }
            })
        };
    let from =
        format!("{} from {}", name(0), if rivals.len() > 1 { "each of its rivals".to_string() } else { name(1) });
    Some(if gain > SETTLES {
        format!("{words}: {SAMPLES} samples are expected to part {from} by {gain:.0} in log likelihood.")
    } else {
        format!(
            "No level of the inputs at hand parts {from} ({words}: {gain:.1} in log likelihood, where {SETTLES:.0} would do): it takes a sensor or an input at another place."
        )
    })
}

/// Where something outside the vocabulary is at work, no model says what it would do elsewhere.
fn by_rule(explained: &Explained) -> String {
    let records = &explained.ready.problem.records;
    let levels = records.iter().filter(|r| r.level() > 0.0).map(Record::level);
    let (least, most) = levels.fold((f64::INFINITY, 0.0_f64), |(a, b), x| (a.min(x), b.max(x)));
    let mut wanted = Vec::new();
    if most < 2.0 * least {
        wanted.push("the same random input at a third and at twice the level, interleaved");
    }
    if records.iter().all(|r| !matches!(r.excitation, Excitation::Periodic(_))) {
        wanted.push("a random-phase multisine of odd lines over six periods or more, whose even and left-out lines show the kind");
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
    format!("Nothing of the vocabulary explains the rest; to see what it is, record {}.", wanted.join(", then "))
}

fn alike(a: &Weighted, best: &Fit) -> bool {
    let within = |a: &[crate::problem::Placed], b: &[crate::problem::Placed]| {
        a.iter().all(|a| crate::unseen::is_unseen(a.effect) || b.iter().any(|b| crate::stepwise::same(a, b)))
    };
    within(&a.effects, &best.effects) && within(&best.effects, &a.effects)
}

/// An input that could be applied.
struct Experiment {
    u: Channels,
    words: String,
}

/// The loudest input again, at other levels, and one input alone.
fn experiments(quick: &Problem) -> Vec<Experiment> {
    let loudest = loudest(&quick.records);
    let scaled = |by: &dyn Fn(usize) -> f64| -> Channels {
        let scale = |(i, u): (usize, &Vec<f64>)| u.iter().take(SAMPLES).map(|x| by(i) * x).collect();
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
    let names = &quick.setting.names.inputs;
    if names.len() > 1 {
        for (alone, name) in names.iter().enumerate() {
            let words = format!("Record with {name} alone at twice its highest level");
            experiments.push(Experiment { u: scaled(&|i| if i == alone { 2.0 } else { 0.0 }), words });
        }
    }
    experiments
}

/// What would be measured if the best explanation were true.
fn imagined(explained: &Explained, experiment: &Experiment) -> Problem {
    let quick = &explained.quick;
    let best = explained.fit();
    let t0 = quick.records.iter().map(|r| r.start_s + r.samples() as f64 / quick.plant.rate).fold(0.0, f64::max);
    let record = Record {
        name: String::new(),
        excitation: Excitation::Random,
        from_rest: true,
        start_s: t0,
        held_out: false,
        u: experiment.u.clone(),
        y: vec![Vec::new(); quick.plant.p],
        simulated: None,
    };
    let plant = quick.nuisance.apply(&quick.plant, &best.eta);
    let y = crate::simulate::simulate(&plant, &quick.actions(&best.effects), &record.u, t0, None, Fineness::COARSE);
    let record = Record { y, ..record };
    let masked = vec![Vec::new(); quick.plant.p];
    let whitener = Whitener::new(&record, &explained.ready.noise, quick.plant.rate, masked);
    let records = vec![record];
    let nuisance = Nuisance::new(&quick.plant, &records, &Limits::default());
    Problem { plant: quick.plant.clone(), records, whiteners: vec![whitener], nuisance, setting: quick.setting.clone() }
}

/// What the records say of a rival's parameters: the information on modes and effects, with initial states let go.
fn known(quick: &Problem, fit: &Fit) -> Option<DMatrix<f64>> {
    let (normal, _) = quick.information(fit, &fit.residual);
    let kept: Vec<usize> = (0..quick.nuisance.of_modes()).chain(quick.nuisance.len()..normal.nrows()).collect();
    let covariance = normal.cholesky()?.inverse();
    let part = DMatrix::from_fn(kept.len(), kept.len(), |i, j| covariance[(kept[i], kept[j])]);
    part.cholesky().map(|factor| factor.inverse())
}

/// Expected log likelihood ratio against a rival.
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
