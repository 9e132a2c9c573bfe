//! The prediction of an experiment by the best explanation, and the expected separation from a rival.

use nalgebra::DMatrix;

use crate::case::Limits;
use crate::case::record::{Record, rms};
use crate::fit::free_run::diverges;
use crate::fit::nuisance::Nuisance;
use crate::fit::problem::{Fit, Problem, sum_of_squares};
use crate::judge::experiments::Experiment;
use crate::noise::NoiseModel;
use crate::noise::whiten::Whitener;
use crate::simulate::{Fineness, simulate};

/// The expected separation of the best explanation from a rival by an experiment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Separation {
    /// The expected log likelihood ratio.
    By(f64),
    /// The free run of the rival diverges, so the outcome cannot be predicted.
    Diverges,
}

/// An experiment as the best explanation predicts it.
pub(super) struct Imagined {
    pub problem: Problem,
    /// Largest magnitude of each output in the linear simulation and in the records.
    peaks: Vec<f64>,
}

/// Returns the expected measurement in an experiment if the best explanation is true; `None` if its free run diverges.
pub(super) fn imagined(problem: &Problem, noise: &NoiseModel, best: &Fit, experiment: &Experiment) -> Option<Imagined> {
    let given = match experiment.sensor {
        Some(port) => problem.plant.with_sensor(port),
        None => problem.plant.clone(),
    };
    let ends = problem.records.iter().map(|r| r.start_s + r.samples() as f64 / given.rate);
    let mut record = Record {
        name: String::new(),
        excitation: experiment.excitation,
        from_rest: true,
        start_s: ends.fold(0.0, f64::max),
        held_out: false,
        u: experiment.u.clone(),
        y: vec![vec![0.0; experiment.u[0].len()]; given.p],
        simulated: None,
    };
    let nuisance = Nuisance::new(&given, std::slice::from_ref(&record), &Limits::default());
    let plant = nuisance.apply(&given, &carried(&problem.nuisance, &nuisance, &best.eta));
    let run = |actions: &[_]| simulate(&plant, actions, &record.u, record.start_s, None, Fineness::COARSE);
    let measured = |o: usize| problem.records.iter().filter_map(|r| r.y.get(o)).map(|y| peak(y)).fold(0.0, f64::max);
    let linear = run(&[]);
    let peaks: Vec<f64> = (0..given.p).map(|o| measured(o).max(peak(&linear[o]))).collect();
    let y = run(&problem.actions(&best.effects));
    if !bounded(&y, &peaks) {
        return None;
    }
    let noise = match experiment.sensor {
        Some(_) => noise.with_output(&given, new_noise(noise, &y)),
        None => noise.clone(),
    };
    record.y = y;
    let whitener = Whitener::new(&record, &noise, given.rate, vec![Vec::new(); given.p]);
    let (setting, settings) = (problem.setting.clone(), problem.settings.clone());
    let records = vec![record];
    let whiteners = vec![whitener];
    let longer = Vec::new();
    let made = Problem { plant: given, records, whiteners, nuisance, setting, settings, strong: false, longer };
    Some(Imagined { problem: made, peaks })
}

/// Returns the noise variance of a new sensor. The new sensor is assumed to be as good as the others: its ratio of
/// noise to signal is the median of theirs.
fn new_noise(noise: &NoiseModel, y: &[Vec<f64>]) -> f64 {
    let mut ratios: Vec<f64> =
        noise.rms().iter().zip(y).map(|(noise, y)| noise / rms(y)).filter(|x| x.is_finite()).collect();
    ratios.sort_by(f64::total_cmp);
    let ratio = ratios.get(ratios.len() / 2).copied().unwrap_or(1.0);
    let own = ratio * y.last().map_or(0.0, rms);
    // A sensor without noise would separate all explanations.
    (own * own).max(f64::MIN_POSITIVE)
}

fn peak(y: &[f64]) -> f64 {
    y.iter().fold(0.0, |most: f64, y| if y.is_finite() { most.max(y.abs()) } else { most })
}

fn bounded(y: &[Vec<f64>], peaks: &[f64]) -> bool {
    y.iter().zip(peaks).all(|(y, &peak)| !y.iter().any(|&y| diverges(y, peak)))
}

/// Returns the linear parameters for a plant that may have one more output, at which the shapes are as given.
fn carried(from: &Nuisance, to: &Nuisance, eta: &[f64]) -> Vec<f64> {
    let mut carried = vec![0.0; to.len()];
    for k in 0..from.of_simulation() {
        carried[place(from, to, k)] = eta[k];
    }
    carried
}

/// Returns the entry of `to` that corresponds to an entry of `from`.
fn place(from: &Nuisance, to: &Nuisance, index: usize) -> usize {
    match from.entry(index) {
        Some((mode, part)) => to.first_of(mode) + part,
        None => index + to.of_simulation() - from.of_simulation(),
    }
}

/// Returns the information of the records on a rival's parameters, without the initial states.
pub(super) fn known(problem: &Problem, fit: &Fit) -> Option<DMatrix<f64>> {
    let (normal, _) = problem.information(fit, &fit.residual);
    let kept: Vec<usize> =
        (0..problem.nuisance.of_simulation()).chain(problem.nuisance.len()..normal.nrows()).collect();
    let covariance = normal.cholesky()?.inverse();
    let part = DMatrix::from_fn(kept.len(), kept.len(), |i, j| covariance[(kept[i], kept[j])]);
    part.cholesky().map(|factor| factor.inverse())
}

impl Imagined {
    /// Returns the separation of a rival from the best explanation by this experiment. `of` describes the linear
    /// parameters of the fit to the records, and `known` is the information of the records on the rival's parameters.
    pub fn separation(&self, of: &Nuisance, rival: &Fit, known: &DMatrix<f64>) -> Separation {
        let problem = &self.problem;
        let eta = carried(of, &problem.nuisance, &rival.eta);
        let rival = Fit { eta, ..rival.clone() };
        let plant = problem.nuisance.apply(&problem.plant, &rival.eta);
        let y = problem.outputs(&plant, &rival.eta, &problem.actions(&rival.effects), 0, Fineness::COARSE);
        if !bounded(&y, &self.peaks) {
            return Separation::Diverges;
        }
        let mut residual = vec![0.0; problem.rows()];
        problem.whiteners[0].apply(&problem.records[0].error(&y), &mut residual);
        let (mut normal, gradient) = problem.information(&rival, &residual);
        for (j, std) in problem.nuisance.std.iter().enumerate() {
            normal[(j, j)] -= 1.0 / (std * std);
        }
        let energy = sum_of_squares(&residual);
        let whole = normal + self.prior(of, known);
        let absorbed = whole.cholesky().map_or(energy, |factor| gradient.dot(&factor.solve(&gradient)));
        let gain = 0.5 * (energy - absorbed);
        if gain.is_finite() { Separation::By(gain.max(0.0)) } else { Separation::Diverges }
    }

    /// Returns the prior information on a rival's parameters, with the usual limits for the shapes at a new output.
    fn prior(&self, of: &Nuisance, known: &DMatrix<f64>) -> DMatrix<f64> {
        let own = &self.problem.nuisance;
        let (before, after) = (of.of_simulation(), own.of_simulation());
        if before == after {
            return known.clone();
        }
        let place = |k: usize| if k < before { place(of, own, k) } else { k - before + after };
        let size = known.nrows() - before + after;
        let mut prior = DMatrix::zeros(size, size);
        let mut seen = vec![false; size];
        for i in 0..known.nrows() {
            seen[place(i)] = true;
            (0..known.ncols()).for_each(|j| prior[(place(i), place(j))] = known[(i, j)]);
        }
        (0..after).filter(|&k| !seen[k]).for_each(|k| prior[(k, k)] = own.std[k].powi(-2));
        prior
    }
}
