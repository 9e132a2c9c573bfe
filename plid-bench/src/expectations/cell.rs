//! A cell, in which all methods process the same runs of a plant at one signal-to-noise ratio and one assumed Sigma.

use std::sync::atomic::{AtomicUsize, Ordering};

use plid_catalogue::ExpectationName;
use plid_core::ObservableForm;
use plid_testbed::TestbedError;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::config::{Config, Plant};
use super::grid::ScalarPrior;
use super::method::{self, Method, Outcome};
use super::plants::{self, Loudness};
use super::statistics::{Figure, geometric_mean, mean, paired_root_ratio, root_mean};
use super::trial::Trial;
use crate::study::Progress;

/// The method with which the others are compared: the default of `plid run`.
pub const DEFAULT: Method = Method::Filter(ExpectationName::MomentMatched);

/// The position of a cell in the study.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cell<'a> {
    /// The plant.
    pub plant: Plant<'a>,
    /// RMS of the response to the input over RMS of all noise in the outputs.
    pub signal_to_noise: f64,
    /// The assumed Sigma relative to the true one, or relative to R for the truss.
    pub sigma: f64,
}

/// The results of a method in a cell.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Score {
    /// Its name.
    pub method: String,
    /// Number of runs in which the recursion failed, P was not a covariance, or the equations had no solution. The
    /// figures exclude them.
    pub lost: usize,
    /// Number of runs whose model has a larger free-run error than no model at all.
    pub useless: usize,
    /// Normalised estimation error squared of all parameters, divided by their number. It is one for a consistent P.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub nees: Option<Figure>,
    /// Normalised estimation error squared of a_1 .. a_p only, divided by their number.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub nees_a: Option<Figure>,
    /// Root mean square error of the entries of a_1 .. a_p.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rmse_a: Option<Figure>,
    /// Root mean square error of the entries of b_1 .. b_m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rmse_b: Option<Figure>,
    /// `rmse_a` over that of the reference, over the runs that both have. Errors are in standard deviations of the
    /// reference. Otherwise, the few plants that hardly respond to the input would dominate the figure.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rmse_a_over_reference: Option<Figure>,
    /// `rmse_a` over that of the default expectation, computed in the same way.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rmse_a_over_default: Option<Figure>,
    /// Relative free-run error on new inputs. It is the geometric mean over the runs, in which a useless model has an
    /// error of one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub free_run: Option<Figure>,
    /// Free-run error relative to that of the default expectation. It is the geometric mean over the runs that both
    /// have, computed in the same way.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub free_run_over_default: Option<Figure>,
}

/// A finished cell.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Finished {
    /// The plant's name.
    pub plant: String,
    /// RMS of the response to the input over RMS of all noise in the outputs.
    pub signal_to_noise: f64,
    /// The assumed Sigma relative to the true one, or relative to R for the truss.
    pub sigma: f64,
    /// Number of runs.
    pub runs: usize,
    /// The best possible method for the cell, with which rmse_a is compared.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reference: Option<String>,
    /// The results of each method.
    pub scores: Vec<Score>,
}

/// Returns all cells of a study.
pub fn cells(config: &Config) -> Vec<Cell<'_>> {
    config
        .plants()
        .flat_map(|plant| plant.sigmas().into_iter().map(move |sigma| (plant, sigma)))
        .flat_map(|(plant, sigma)| {
            config.signal_to_noise.iter().map(move |&signal_to_noise| Cell { plant, signal_to_noise, sigma })
        })
        .collect()
}

impl Cell<'_> {
    /// Returns the key of the cell in the journal.
    pub fn key(&self) -> String {
        format!("{}, signal-to-noise {}, sigma {}", self.plant.name(), self.signal_to_noise, self.sigma)
    }

    fn trial(&self, config: &Config, seed: u64) -> Result<Trial, TestbedError> {
        let loudness = Loudness {
            signal_to_noise: self.signal_to_noise,
            state_share: config.state_noise_share,
            told_factor: self.sigma,
        };
        match self.plant {
            Plant::Scalar(plant) => Ok(plants::scalar(&ScalarPrior::default(), loudness, plant.steps, seed)),
            Plant::InClass(plant) => {
                let form = ObservableForm::balanced(plant.states, plant.outputs, plant.inputs);
                let form = form.expect("a config has been checked");
                Ok(plants::in_class(&form, loudness, plant.initial_std, plant.steps, seed))
            }
            Plant::Truss(plant) => {
                let duration_s = [plant.duration_s, plant.held_out_s];
                plants::truss(plant.states, self.signal_to_noise, self.sigma, duration_s, seed)
            }
        }
    }

    /// Returns the methods that are compared here, including the reference, and the reference. Batch estimates use
    /// the true Sigma, so only one setting of Sigma has them.
    fn methods(&self) -> (Vec<Method>, Option<Method>) {
        let mut methods: Vec<Method> = ExpectationName::all().into_iter().map(Method::Filter).collect();
        let reference = match self.plant {
            Plant::Scalar(plant) => {
                let (prior, points) = (ScalarPrior::default(), plant.grid_points);
                if self.sigma == 1.0 {
                    methods.extend([
                        Method::MaximumPosterior(Some((prior, points))),
                        Method::MaximumLikelihood(prior, points),
                        Method::InstrumentalVariable,
                        Method::LeastSquares,
                    ]);
                } else {
                    methods.push(Method::ExactAsTold(prior, points));
                }
                Some(Method::Exact(prior, points))
            }
            Plant::InClass(_) => (self.sigma == 1.0).then_some(Method::MaximumPosterior(None)),
            Plant::Truss(plant) => (plant.batch_at == Some(self.sigma)).then_some(Method::MaximumPosterior(None)),
        };
        methods.extend(reference);
        if !matches!(self.plant, Plant::Scalar(_)) && reference.is_some() {
            methods.push(Method::LeastSquares);
        }
        (methods, reference)
    }

    /// Carries out the runs in parallel. The results do not depend on the number of threads. Returns `None` if the
    /// user interrupts the study.
    ///
    /// # Errors
    /// Returns the error of the testbed.
    pub fn measure(&self, config: &Config, progress: &dyn Progress) -> Result<Option<Finished>, TestbedError> {
        let (methods, reference) = self.methods();
        let runs = self.plant.runs();
        let seeds = (0..runs as u64).into_par_iter().map(|run| config.seed + run);
        let trials = seeds.map(|seed| self.trial(config, seed)).collect::<Result<Vec<Trial>, _>>()?;
        let (done, total) = (AtomicUsize::new(0), runs * methods.len());
        let outcomes: Option<Vec<Option<Outcome>>> = (0..total)
            .into_par_iter()
            .map(|task| {
                if progress.interrupted() {
                    return None;
                }
                let outcome = method::run(methods[task / runs], &trials[task % runs], config.covariance);
                progress.advance(done.fetch_add(1, Ordering::Relaxed) + 1, total);
                Some(outcome)
            })
            .collect();
        let Some(outcomes) = outcomes else { return Ok(None) };
        let of =
            |wanted: Method| methods.iter().position(|&m| m == wanted).map(|k| &outcomes[k * runs..(k + 1) * runs]);
        let (best, default) = (reference.and_then(of), of(DEFAULT));
        let scores = methods
            .iter()
            .zip(outcomes.chunks(runs))
            .map(|(method, own)| summarise(method.name(), own, best, default))
            .collect();
        Ok(Some(Finished {
            plant: self.plant.name(),
            signal_to_noise: self.signal_to_noise,
            sigma: self.sigma,
            runs,
            reference: reference.map(|method| method.name().into()),
            scores,
        }))
    }
}

type Outcomes<'a> = &'a [Option<Outcome>];

fn summarise(name: &str, own: Outcomes<'_>, best: Option<Outcomes<'_>>, default: Option<Outcomes<'_>>) -> Score {
    let all = |of: fn(&Outcome) -> f64| own.iter().flatten().map(of).filter(|x| x.is_finite()).collect::<Vec<f64>>();
    // A model that is worse than no model has an error of one, which is the error without a model.
    let free_run = |outcome: &Outcome| outcome.free_run.min(1.0);
    let ratio = |other: Option<Outcomes<'_>>| {
        let rows = own.iter().zip(other.unwrap_or_default()).enumerate();
        let (over, under): (Vec<f64>, Vec<f64>) = rows
            .filter_map(|(run, (own, other))| {
                let unit = best.map_or(Some(1.0), |best| Some(best[run].as_ref()?.variance_a))?;
                Some((own.as_ref()?.squared_a / unit, other.as_ref()?.squared_a / unit))
            })
            .filter(|(x, y)| x.is_finite() && y.is_finite())
            .unzip();
        paired_root_ratio(&over, &under)
    };
    let free_run_ratios: Vec<f64> = own
        .iter()
        .zip(default.unwrap_or_default())
        .filter_map(|(own, default)| Some(free_run(own.as_ref()?) / free_run(default.as_ref()?)))
        .collect();
    Score {
        method: name.into(),
        lost: own.iter().filter(|o| o.is_none()).count(),
        useless: own.iter().flatten().filter(|o| o.free_run >= 1.0).count(),
        nees: mean(&all(|o| o.nees)),
        nees_a: mean(&all(|o| o.nees_a)),
        rmse_a: root_mean(&all(|o| o.squared_a)),
        rmse_b: root_mean(&all(|o| o.squared_b)),
        rmse_a_over_reference: ratio(best),
        rmse_a_over_default: ratio(default),
        free_run: geometric_mean(&own.iter().flatten().map(free_run).collect::<Vec<f64>>()),
        free_run_over_default: geometric_mean(&free_run_ratios),
    }
}
