//! Simpler methods that answer the same cases, for comparison with the diagnosis.

pub mod chance;
mod linear;
mod ranking;
mod sparse;

use plid_gap::case::Limits;
use plid_gap::case::{Case, Channels};
use plid_gap::effects::{Library, Setting};
use plid_gap::research::{Known, Plant, prepare};
use plid_gap::{GapError, Outcome};
use plid_model::Model;
use serde::{Deserialize, Serialize};

use crate::judge::Claim;
use linear::Linear;
use sparse::Sparse;

/// The content of baselines.json: the answers of the baselines, and the data that their predictions require.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Baselines {
    /// The candidates of the diagnosis ranked by BIC, without a test of whether the best is adequate.
    pub ranking: Claim,
    /// This ranking for the second answer.
    pub ranking_left_out: Option<Claim>,
    /// The baselines that require a simulation.
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
}

/// Factors by which the limits of a linear refit are wider than the stated ones: frequency, damping, shapes.
const WIDER: [f64; 3] = [40.0, 10.0, 40.0];

/// Answers a case with the baselines: with the vocabulary `library`, and a second time with a reduced one.
pub(crate) fn answers(
    case: &Case,
    outcome: &Outcome,
    left_out: Option<&Outcome>,
    library: &Library,
) -> Result<Baselines, GapError> {
    let model = match &case.model {
        Some(model) => model.clone(),
        // What the diagnosis itself took for the simulation is only good for names and counts here.
        None => Model::from_json(&outcome.simulation.linear, "sim-with-effect.json")?,
    };
    let setting = Setting::bare(&Plant::new(&model)?, &model);
    let rows: usize = outcome.shown.fitted.iter().map(|(_, _, samples)| samples * setting.plant.p).sum();
    let ranked = |outcome: &Outcome| ranking::claim(&outcome.diagnosis, rows as f64, library, &setting);
    let (ranking, ranking_left_out) = (ranked(outcome), left_out.map(ranked));
    let fitted = case.model.is_some().then(|| fitted(case, &model)).transpose()?;
    Ok(Baselines { ranking, ranking_left_out, fitted })
}

fn fitted(case: &Case, model: &Model) -> Result<Fitted, GapError> {
    let stated = &case.config.nuisance;
    let [frequency, damping, shape] = WIDER;
    let wide = Limits {
        frequency: frequency * stated.frequency,
        damping: damping * stated.damping,
        shape: shape * stated.shape,
    };
    let ready = prepare(model, &case.records, &Known { limits: wide, ..Known::default() })?;
    let heads = ready.problem.head(ready.problem.settings.search.first_samples, &ready.noise);
    Ok(Fitted { sparse: sparse::regress(&heads), linear: linear::refit(&heads, model) })
}

impl Fitted {
    /// Simulates a new input from rest at `t0` with the sparse and the linear baseline.
    pub(crate) fn predict(&self, model: &Model, u: &[Vec<f64>], t0: f64) -> Result<[Channels; 2], GapError> {
        Ok([self.sparse.predict(&Plant::new(model)?, u, t0), self.linear.predict(u)?])
    }
}
