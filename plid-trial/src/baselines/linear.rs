//! The best linear refit: frequency, damping and shapes of every mode, almost without bounds. It predicts, and it names
//! the parameter that is most significantly beyond the stated limits, if any.

use plid_gap::GapError;
use plid_gap::case::Channels;
use plid_gap::research::{Fineness, Plant, Problem, REFIT_STEPS, refit as bounded_refit, simulate};
use plid_model::Model;
use serde::{Deserialize, Serialize};

use super::WIDER;
use crate::judge::{Claim, Named};

/// The answer, and the model used for prediction.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Linear {
    /// The answer in the form of a diagnosis. It states no probability, so what it names counts as certain.
    pub claim: Claim,
    /// The refitted simulation in the format of model.json.
    pub model: serde_json::Value,
}

pub(super) fn refit(problem: &Problem, model: &Model) -> Linear {
    let found = bounded_refit(problem, REFIT_STEPS);
    let covariance = found.jacobian.normal.clone().try_inverse();
    // The first number says how far beyond the stated limits a parameter is, the second how surely it is not zero.
    let changes = found.eta.iter().zip(&problem.nuisance.std).enumerate().filter_map(|(index, (x, std))| {
        let (mode, part) = problem.nuisance.entry(index)?;
        let variance = covariance.as_ref()?[(index, index)].max(f64::MIN_POSITIVE);
        Some((mode, part, (x / std * WIDER[part.min(2)]).abs(), x.abs() / variance.sqrt()))
    });
    let beyond = changes.filter(|(_, _, limits, sure)| limits.min(*sure) > problem.settings.judge.max_prior_z);
    let furthest = beyond.max_by(|a, b| a.3.total_cmp(&b.3)).map(|(mode, part, ..)| (mode, part));
    let named = |effect: &str, mode: usize| Claim {
        verdict: "effects".to_owned(),
        effects: vec![Named {
            effect: effect.to_owned(),
            location: format!("mode:{:.1}", problem.plant.modes[mode].hz()),
            confidence: Some(1.0),
            ..Named::default()
        }],
        ..Claim::default()
    };
    let claim = match furthest {
        None => Claim { verdict: "none".to_owned(), ..Claim::default() },
        Some((mode, 0)) => named("modal-frequency", mode),
        Some((mode, 1)) => named("modal-damping", mode),
        // The vocabulary has no word for a shape.
        Some(_) => Claim { verdict: "unknown".to_owned(), ..Claim::default() },
    };
    Linear { claim, model: found.plant.to_model(model).to_json() }
}

impl Linear {
    pub(super) fn predict(&self, u: &[Vec<f64>]) -> Result<Channels, GapError> {
        let plant = Plant::new(&Model::from_json(&self.model, "baselines.json")?)?;
        Ok(simulate(&plant, &[], u, 0.0, None, Fineness::FINE))
    }
}
