//! PLID over a record, with checkpoints.

use ndarray::Array2;
use plid_core::{Checkpoint, Health, IdentifiedModel, ImplicitModel, NoiseModel, ObservableForm, Settings};

use super::{IdentifyError, Samples};
use crate::variant::Variant;

/// What the recursion is to be.
#[derive(Clone, Debug)]
pub struct Plan {
    /// The canonical form.
    pub form: ObservableForm,
    /// The noise covariances.
    pub noise: NoiseModel,
    /// Start, forgetting and parameter noise.
    pub settings: Settings,
    /// The types.
    pub variant: Variant,
    /// How often the record is gone through; each pass starts from the last one's estimate, with P as it stands.
    pub passes: usize,
}

/// What a run of the recursion gives.
#[derive(Clone, Debug)]
pub struct RecursionRun {
    /// The plant at the end, with the covariance of the estimate.
    pub identified: IdentifiedModel,
    /// The innovations of the last pass, K x p.
    pub innovations: Array2<f64>,
    /// How sound P is at the end.
    pub health: Health,
}

/// What a caller is told between samples, and what it may ask for.
pub trait Watcher {
    /// Called after each sample with the samples done of all; false asks for an end, after which [`Watcher::store`] is called.
    fn sample(&mut self, done: usize, total: usize) -> bool;
    /// Takes the state of an interrupted run.
    fn store(&mut self, checkpoint: Checkpoint, innovations: &Array2<f64>);
    /// The state to go on from, and the innovations of the pass so far.
    fn resume(&mut self) -> Option<(Checkpoint, Array2<f64>)>;
}

/// Nobody watches.
pub struct Unwatched;

impl Watcher for Unwatched {
    fn sample(&mut self, _done: usize, _total: usize) -> bool {
        true
    }
    fn store(&mut self, _checkpoint: Checkpoint, _innovations: &Array2<f64>) {}
    fn resume(&mut self) -> Option<(Checkpoint, Array2<f64>)> {
        None
    }
}

/// Runs the recursion of `plan` over `samples`.
///
/// # Errors
/// What the recursion says, or [`IdentifyError::Interrupted`] when the watcher asked for an end.
pub fn run(plan: &Plan, samples: Samples<'_>, watcher: &mut impl Watcher) -> Result<RecursionRun, IdentifyError> {
    let (count, p) = (samples.len(), plan.form.outputs());
    let total = count * plan.passes;
    let mut recursion = plan.variant.build(plan.form.clone(), &plan.noise, &plan.settings)?;
    let mut innovations = Array2::from_elem((count, p), f64::NAN);
    let mut start = 0;
    if let Some((checkpoint, so_far)) = watcher.resume() {
        recursion.restore(&checkpoint).map_err(crate::variant::VariantError::from)?;
        if so_far.dim() == innovations.dim() && checkpoint.step() as usize <= total {
            innovations = so_far;
            start = checkpoint.step() as usize;
        }
    }
    let (mut z, mut u) = (vec![0.0; p], vec![0.0; plan.form.inputs()]);
    for step in start..total {
        let k = step % count;
        for (to, &from) in z.iter_mut().zip(samples.outputs.row(k)) {
            *to = from;
        }
        for (to, &from) in u.iter_mut().zip(samples.inputs.row(k)) {
            *to = from;
        }
        recursion.step(&z, &u, samples.nan_is_missing).map_err(crate::variant::VariantError::from)?;
        for (to, &e) in innovations.row_mut(k).iter_mut().zip(recursion.innovation()) {
            *to = e;
        }
        if !watcher.sample(step + 1, total) {
            watcher.store(recursion.checkpoint(), &innovations);
            return Err(IdentifyError::Interrupted { steps: step + 1, total });
        }
    }
    Ok(RecursionRun { identified: recursion.identified(), innovations, health: recursion.health() })
}
