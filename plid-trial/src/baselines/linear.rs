//! The best linear refit: every mode's frequency, damping and shapes, almost without bounds. It predicts; and what it names, if
//! anything, is the parameter that went furthest beyond the stated limits.

use plid_gap::GapError;
use plid_gap::plant::Plant;
use plid_gap::problem::Problem;
use plid_gap::record::Channels;
use plid_gap::refit;
use plid_gap::simulate::{Fineness, simulate};
use plid_gap::thresholds::BENT;
use plid_model::Model;
use serde::{Deserialize, Serialize};

use super::WIDER;
use crate::judge::{Claim, Named};

/// What it answers and predicts with.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Linear {
    /// In the words of a diagnosis. It states no probability: what it names counts as certain.
    pub claim: Claim,
    /// The refitted simulation, a model.json.
    pub model: serde_json::Value,
}

pub(super) fn refit(problem: &Problem, model: &Model) -> Linear {
    let found = refit::refit(problem);
    let changes = found.eta.iter().zip(&problem.nuisance.std).enumerate().filter_map(|(index, (x, std))| {
        let (mode, part) = problem.nuisance.entry(index)?;
        Some((mode, part, (x / std * WIDER[part.min(2)]).abs()))
    });
    let furthest = changes.max_by(|a, b| a.2.total_cmp(&b.2)).filter(|(_, _, z)| *z > BENT);
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
        Some((mode, 0, _)) => named("modal-frequency", mode),
        Some((mode, 1, _)) => named("modal-damping", mode),
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
