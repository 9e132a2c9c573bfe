//! The best linear refit: frequency, damping and shapes of every mode, almost without bounds. It predicts the
//! outputs, and names the parameter that is most significantly beyond the stated limits, if there is one.

use nalgebra::{DMatrix, DVector};
use plid_gap::GapError;
use plid_gap::research::{Plant, Problem, REFIT_STEPS, Refit, refit as bounded_refit};
use plid_model::Model;
use serde::{Deserialize, Serialize};

use super::WIDER;
use super::weights::{at_work, schwarz};
use crate::judge::{Candidate, Claim, Named};

/// The answer, and the model used for prediction.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Linear {
    /// The answer in the form of a diagnosis.
    pub claim: Claim,
    /// The refitted simulation in the format of model.json.
    pub model: serde_json::Value,
}

pub(super) fn refit(problem: &Problem, model: &Model) -> Linear {
    let found = bounded_refit(problem, REFIT_STEPS);
    Linear { claim: claim(problem, &found), model: found.plant.to_model(model).to_json() }
}

/// A parameter of a mode that is beyond the stated limits.
struct Beyond {
    mode: usize,
    part: usize,
    /// Index among all parameters.
    index: usize,
    /// Signed distance from its limit.
    by: f64,
    /// Distance from zero in standard deviations.
    sure: f64,
}

fn claim(problem: &Problem, found: &Refit) -> Claim {
    let none = || Claim { verdict: "none".to_owned(), ..Claim::default() };
    let Some(covariance) = found.jacobian.normal.clone().try_inverse() else { return none() };
    let bound = problem.settings.judge.max_prior_z;
    let beyond = found.eta.iter().zip(&problem.nuisance.std).enumerate().filter_map(|(index, (x, std))| {
        let (mode, part) = problem.nuisance.entry(index)?;
        let limit = bound * std / WIDER[part.min(2)];
        let sure = x.abs() / covariance[(index, index)].max(f64::MIN_POSITIVE).sqrt();
        let by = x - x.clamp(-limit, limit);
        (by != 0.0).then_some(Beyond { mode, part, index, by, sure })
    });
    let mut beyond: Vec<Beyond> = beyond.collect();
    beyond.sort_by(|a, b| b.sure.total_cmp(&a.sure));
    let candidates = explanations(problem, &beyond, &covariance, found.cost);
    let significant = beyond.first().filter(|first| first.sure > bound);
    let Some(first) = significant else { return Claim { candidates, ..none() } };
    let Some(named) = named(problem, first) else {
        return Claim { verdict: "unknown".to_owned(), candidates, ..Claim::default() };
    };
    let effects = vec![Named { confidence: Some(at_work(&candidates, &named)), ..named }];
    Claim { verdict: "effects".to_owned(), effects, candidates, ..Claim::default() }
}

/// Returns the effect to which a parameter corresponds; the vocabulary has no name for a shape.
fn named(problem: &Problem, beyond: &Beyond) -> Option<Named> {
    let effect = ["modal-frequency", "modal-damping"].get(beyond.part)?;
    let location = format!("mode:{:.1}", problem.plant.modes[beyond.mode].hz());
    Some(Named { effect: (*effect).to_owned(), location, ..Named::default() })
}

/// Returns the explanations with their Schwarz weights: no parameter is beyond its limit, one of them is, or all are.
/// The cost of holding parameters at their limits follows from the covariance, and the noise from the residual of the
/// refit.
fn explanations(problem: &Problem, beyond: &[Beyond], covariance: &DMatrix<f64>, cost: f64) -> Vec<Candidate> {
    let rows = problem.values();
    let bic = |free: &dyn Fn(usize) -> bool| {
        let held: Vec<&Beyond> = (0..beyond.len()).filter(|k| !free(*k)).map(|k| &beyond[k]).collect();
        let by = DVector::from_iterator(held.len(), held.iter().map(|held| held.by));
        let part = DMatrix::from_fn(held.len(), held.len(), |i, j| covariance[(held[i].index, held[j].index)]);
        let solved = part.cholesky().map_or_else(|| by.clone(), |factor| factor.solve(&by));
        rows * (1.0 + by.dot(&solved) / cost).ln() + (beyond.len() - held.len()) as f64 * rows.ln()
    };
    let candidate = |free: &[&Beyond]| {
        let effects: Option<Vec<Named>> = free.iter().map(|beyond| named(problem, beyond)).collect();
        Candidate { unknown: effects.is_none(), effects: effects.unwrap_or_default(), probability: None }
    };
    let mut models = vec![(bic(&|_| false), candidate(&[]))];
    models.extend((0..beyond.len()).map(|k| (bic(&|free| free == k), candidate(&[&beyond[k]]))));
    if beyond.len() > 1 {
        models.push((bic(&|_| true), candidate(&beyond.iter().collect::<Vec<_>>())));
    }
    schwarz(models)
}

impl Linear {
    /// Returns the refitted simulation.
    pub(super) fn plant(&self) -> Result<Plant, GapError> {
        Plant::new(&Model::from_json(&self.model, "baselines.json")?)
    }
}

#[cfg(test)]
mod tests {
    use plid_gap::case::{Excitation, Limits, Record};
    use plid_gap::research::{Known, prepare};
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha12Rng;
    use serde_json::json;

    use super::*;
    use crate::baselines::wider;

    /// Returns a model of a mode at 35 Hz whose discrete-time poles have this radius.
    fn model(radius: f64) -> Model {
        let (sin, cos) = 0.55_f64.sin_cos();
        let text = json!({
            "format": "state-space", "sample_rate_hz": 400.0, "inputs": ["u1"], "outputs": ["y1"],
            "A": [[radius * cos, radius * sin], [-radius * sin, radius * cos]], "B": [[0.0], [1.0]],
            "C": [[1.0, 0.0]], "D": [[0.0]],
            "noise": { "sensor_std": [0.05] },
        });
        Model::from_json(&text, "here").unwrap()
    }

    /// Returns records of a system, simulated with the difference equation of its model, with noise.
    fn records(radius: f64) -> Vec<Record> {
        let mut rng = ChaCha12Rng::seed_from_u64(8);
        let (sin, cos) = 0.55_f64.sin_cos();
        let mut one = |k: usize| {
            let u: Vec<f64> = (0..2000).map(|_| if k == 0 { 0.0 } else { rng.random_range(-1.0..1.0) }).collect();
            let mut x = [0.0, 0.0];
            let step = |u: &f64| {
                let y = x[0] + 0.05 * 3f64.sqrt() * rng.random_range(-1.0..1.0);
                x = [radius * (cos * x[0] + sin * x[1]), radius * (cos * x[1] - sin * x[0]) + u];
                y
            };
            let y = u.iter().map(step).collect();
            let excitation = if k == 0 { Excitation::Zero } else { Excitation::Random };
            let (name, start_s) = (format!("r{k}"), 5.0 * k as f64);
            Record {
                name,
                excitation,
                from_rest: true,
                start_s,
                held_out: k == 4,
                u: vec![u],
                y: vec![y],
                simulated: None,
            }
        };
        (0..5).map(&mut one).collect()
    }

    fn claim_of(radius: f64) -> Claim {
        let model = model(0.985);
        let known = Known { limits: wider(&Limits::default()), ..Known::default() };
        let ready = prepare(&model, &records(radius), &known).unwrap();
        refit(&ready.problem, &model).claim
    }

    #[test]
    fn a_damping_beyond_its_limits_is_named_with_its_weight() {
        let claim = claim_of(0.97);
        assert_eq!((claim.verdict.as_str(), claim.effects.len()), ("effects", 1));
        assert_eq!(claim.effects[0].effect, "modal-damping");
        assert!(claim.effects[0].confidence.is_some_and(|p| p > 0.9), "{claim:?}");
        let all: f64 = claim.candidates.iter().filter_map(|c| c.probability).sum();
        assert!((all - 1.0).abs() < 1e-12);
    }

    #[test]
    fn within_the_limits_nothing_is_named() {
        let claim = claim_of(0.985);
        assert_eq!((claim.verdict.as_str(), claim.candidates.len()), ("none", 1), "{claim:?}");
    }
}
