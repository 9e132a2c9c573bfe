//! Simpler methods that answer the same cases, for comparison with the diagnosis.

mod bic;
pub mod black_box;
pub mod chance;
mod linear;
mod sparse;
mod weights;

use plid_gap::case::Limits;
use plid_gap::case::{Case, Channels};
use plid_gap::effects::Library;
use plid_gap::research::{Fineness, Known, Plant, prepare, simulate};
use plid_gap::{GapError, Outcome};
use plid_model::Model;
use serde::{Deserialize, Serialize};

use crate::judge::Claim;
use black_box::BlackBox;
use linear::Linear;
use sparse::Sparse;

/// The content of baselines.json: the answers of the baselines, and the data for their predictions.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Baselines {
    /// The selection of effects by BIC, without a test of whether the best model is adequate.
    pub ranking: Claim,
    /// This selection for the second answer, from the reduced vocabulary.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ranking_left_out: Option<Claim>,
    /// The baselines that require a simulation.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fitted: Option<Fitted>,
}

/// Baselines that fit the simulation as given.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Fitted {
    /// Sparse regression on monomials.
    pub sparse: Sparse,
    /// A linear refit almost without bounds.
    pub linear: Linear,
    /// The black box, which names nothing; `None` in answers from before there was one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub black_box: Option<BlackBox>,
}

/// The outputs that the fitted baselines predict.
pub(crate) struct Predicted {
    pub sparse: Channels,
    pub linear: Channels,
    pub black_box: Option<Channels>,
}

/// Factors by which the limits of a linear refit are wider than the stated ones: frequency, damping, shapes.
const WIDER: [f64; 3] = [40.0, 10.0, 40.0];

/// Returns the limits of a linear refit almost without bounds.
fn wider(stated: &Limits) -> Limits {
    let [frequency, damping, shape] = WIDER;
    Limits { frequency: frequency * stated.frequency, damping: damping * stated.damping, shape: shape * stated.shape }
}

/// Answers a case with the baselines. If effects to leave out are named, BIC alone also answers it without them. A
/// case without a simulation is answered with the one that the diagnosis used. `say` is called with the progress.
pub(crate) fn answers(
    case: &Case,
    outcome: &Outcome,
    without: &[String],
    library: &Library,
    say: &mut dyn FnMut(String),
) -> Result<Baselines, GapError> {
    let model = match &case.model {
        Some(model) => model.clone(),
        None => Model::from_json(&outcome.simulation.linear, "sim-with-effect.json")?,
    };
    let with_model = Case { model: Some(model.clone()), ..case.clone() };
    let asked = bic::Asked::new(&with_model, library, say)?;
    let ranking = asked.claim(library, &[], say);
    let ranking_left_out = (!without.is_empty()).then(|| asked.claim(library, without, say));
    let fitted = case.model.is_some().then(|| fitted(case, &model)).transpose()?;
    Ok(Baselines { ranking, ranking_left_out, fitted })
}

fn fitted(case: &Case, model: &Model) -> Result<Fitted, GapError> {
    let ready = prepare(model, &case.records, &Known { limits: wider(&case.config.nuisance), ..Known::default() })?;
    let heads = ready.problem.head(ready.problem.settings.search.first_samples, &ready.noise);
    let linear = linear::refit(&heads, model);
    let black_box = Some(black_box::learn(&ready, &linear.plant()?));
    Ok(Fitted { sparse: sparse::regress(&heads), linear, black_box })
}

impl Fitted {
    /// Simulates a new input from rest at `t0`.
    pub(crate) fn predict(&self, model: &Model, u: &[Vec<f64>], t0: f64) -> Result<Predicted, GapError> {
        let (given, refitted) = (Plant::new(model)?, self.linear.plant()?);
        Ok(Predicted {
            sparse: self.sparse.predict(&given, u, t0),
            linear: simulate(&refitted, &[], u, 0.0, None, Fineness::FINE),
            black_box: self.black_box.as_ref().map(|model| model.predict(&given, &refitted, u, t0)),
        })
    }
}
