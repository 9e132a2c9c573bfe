//! Simpler ways to answer the same cases, to stand beside the diagnosis.

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

/// baselines.json: what they answer, and what their predictions need.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Baselines {
    /// The diagnosis' own candidates ranked by BIC, without any test of whether the best is good enough.
    pub ranking: Claim,
    /// The same of the second answer.
    pub ranking_left_out: Option<Claim>,
    /// Those that need a simulation.
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

/// How much wider than the stated limits a linear refit may go: frequency, damping, shapes.
const WIDER: [f64; 3] = [40.0, 10.0, 40.0];

/// Lets the baselines answer a case that was diagnosed with `library`, and a second time with less.
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
    /// Free runs on a new input from rest at `t0`: sparse, linear.
    pub(crate) fn predict(&self, model: &Model, u: &[Vec<f64>], t0: f64) -> Result<[Channels; 2], GapError> {
        Ok([self.sparse.predict(&Plant::new(model)?, u, t0), self.linear.predict(u)?])
    }
}
