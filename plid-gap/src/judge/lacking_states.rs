//! Whether the simulation has too few states.
//!
//! In a plant without lightly damped modes, the vocabulary has no name for a state that the simulation lacks: gains,
//! lags and delays imitate it. Linear models with as many states as the simulation and with one or two more are
//! identified from the fitted records, by a subspace method and an output-error refinement. A state is lacking if a
//! model with more states leaves much less of the gap on the held-out records than the model with as many states, and
//! than the best explanation by linear effects.

use plid_model::Model;

use crate::fit::linear_model::{Arrays, of_states, options};
use crate::fit::problem::Problem;
use crate::judge::explained::Explained;
use crate::judge::shrink::{Gap, blocks, opened};
use crate::plant::Plant;

/// Largest number of states that are added.
const MOST_MORE: usize = 2;

/// A simulation that lacks states.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct LackingStates {
    /// Number of its states.
    pub states: usize,
    /// Number of states of the linear model that needs no effect.
    pub needed: usize,
    /// Gap of that model on the records that are opened at the end.
    pub gap: f64,
}

/// Looks for a linear model with more states that needs no effect, if the simulation within its limits leaves a
/// material gap.
pub(crate) fn lacking_states(explained: &Explained, gaps: &Gap, material: f64) -> Option<LackingStates> {
    let problem = &explained.ready.problem;
    let plant = &problem.plant;
    let settings = &problem.settings.judge;
    let linear = explained.predicting().effects.iter().all(|placed| placed.effect.is_linear());
    let suffices = gaps.with_effect < settings.states_above_noise * gaps.noise_floor
        || gaps.beyond_noise(gaps.within_limits) < material;
    if !linear || suffices || !plant.modes.is_empty() || plant.controller.is_some() {
        return None;
    }
    let opened = opened(explained);
    let gap = |states: usize| {
        let model = identified(problem, states)?;
        Some(blocks(&opened, &Plant::with_settings(&model, &problem.settings.plant).ok()?, &[]).gap())
    };
    let states = plant.seen_states();
    let left = gaps.beyond_noise(gaps.with_effect).min(gaps.beyond_noise(gap(states)?));
    (states + 1..=states + MOST_MORE).find_map(|needed| {
        let gap = gap(needed)?;
        (gaps.beyond_noise(gap) < settings.states_left * left).then_some(LackingStates { states, needed, gap })
    })
}

/// Identifies a linear model from the fitted records; `None` if they do not determine one.
fn identified(problem: &Problem, states: usize) -> Option<Model> {
    let driven = problem.records.iter().filter(|record| record.is_driven()).collect();
    let arrays = Arrays::new(driven, |record| &record.y);
    let records = arrays.records();
    let head = plid_refine::head(&records).ok()?;
    let found = of_states(&head, &records, states, problem.plant.rate, &options(&records)).ok()?;
    Some(found.refined.model)
}
