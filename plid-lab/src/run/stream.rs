//! A run whose record is not held in memory: the recursion and the held-out errors read the file block by block.
//!
//! Everything else uses the window, the samples around the end of the training part.

use std::path::Path;

use nalgebra::{DMatrix, DVector};
use ndarray::{Array1, Array2, ArrayView2, Axis};
use plid_core::ImplicitModel;

use super::error::RunError;
use super::obtain::{Obtained, Source};
use super::validate::Errors;
use crate::experiment::Experiment;
use crate::identify::{Course, Ending, IdentifyError, Paused, Plan, Watcher};
use plid_data::prepare::Prepared;
use plid_data::prepare::stream::{self, Streamed};
use plid_file::Hashing;
use plid_model::signal::ErrorSums;
use plid_model::{Model, one_step_prediction, simulate};
use plid_work::Progress;

/// Samples before and after the end of the training part that are held in memory, unless the experiment says otherwise.
const WINDOW: usize = 100_000;

/// The parts of a streamed record, and the errors over all of its held-out samples.
#[derive(Debug)]
pub struct StreamedRun {
    /// Number of samples of the prepared record.
    pub samples: usize,
    /// Number of its samples over which the recursion ran.
    pub training: usize,
    /// The first sample of the window.
    pub first: usize,
    /// Number of training samples in the window.
    pub window_training: usize,
    /// Number of held-out samples in the window.
    pub window_held_out: usize,
    /// Simulation errors over all held-out samples; infinite if the model diverges.
    pub free_run: Errors,
    /// One-step errors of the steady-state predictor over all held-out samples; `None` if there is none.
    pub one_step: Option<Errors>,
}

impl StreamedRun {
    /// Returns a sentence about the part that was not held in memory.
    pub(super) fn sentence(&self) -> String {
        let held_out = self.samples - self.training;
        format!(
            "the file was read block by block: the recursion ran over all {} training samples, and the errors over the \
             whole tail are those of all {held_out} held-out samples; all else used the window of {} training samples \
             and {} held-out samples around the end of the training part",
            self.training, self.window_training, self.window_held_out
        )
    }
}

/// Prepares the one file of an experiment.
pub(super) fn data(
    experiment: &Experiment,
    base: &Path,
    progress: &dyn Progress,
) -> Result<(Obtained, Prepared, Streamed), RunError> {
    let config = &experiment.data;
    let file = &config.files[0];
    let path = base.join(file);
    let opened = std::fs::File::open(&path).and_then(|file| Hashing::new(file).sha256());
    let sha256 = opened.map_err(super::file_error(&path))?;
    let source = stream::Source {
        file: path,
        inputs: config.inputs.clone(),
        outputs: config.outputs.clone(),
        rate_hz: config.sample_rate_hz,
        missing: config.missing,
    };
    let (share, window) = (experiment.validation.training_share, config.window.unwrap_or(WINDOW));
    let mut now = "";
    let mut tell = |pass: &'static str, done, total| {
        if pass != now {
            now = pass;
            progress.stage(pass);
        }
        progress.advance(done, total);
    };
    let (prepared, mut streamed) = stream::prepare(source, share, &experiment.preparation, window, &mut tell)?;
    let obtained = Obtained {
        records: Vec::new(),
        sources: vec![Source { file: file.display().to_string(), sha256 }],
        truth: None,
        warnings: streamed.warnings.iter().map(ToString::to_string).collect(),
        channel_rms: std::mem::take(&mut streamed.channel_rms),
    };
    Ok((obtained, prepared, streamed))
}

/// Runs the recursion of `plan` over the training part, as [`crate::identify::run`] does over records in memory. The
/// innovations are those of the training samples in the window.
pub(super) fn run(
    plan: &Plan,
    streamed: &Streamed,
    paused: Option<&Paused>,
    watcher: Watcher<'_>,
) -> Result<Ending, RunError> {
    let training = streamed.training;
    let total = plan.passes * training;
    let mut kept = Array2::from_elem((training - streamed.window.start, plan.form.outputs()), f64::NAN);
    let mut course = Course::start(plan).map_err(RunError::Identify)?;
    let (mut pass, mut k) = (0, 0);
    if let Some(paused) = paused {
        course.resume(paused).map_err(RunError::Identify)?;
        (pass, k) = paused.place();
        for (array, saved) in std::iter::once(&mut kept).zip(paused.innovations()) {
            array.iter_mut().zip(saved).for_each(|(to, from)| *to = from);
        }
    }
    while pass < plan.passes {
        let mut parts = streamed.parts(k)?;
        while k < training {
            let Some(part) = parts.next_part()? else { return Err(shorter(k, training)) };
            let rows = part.outputs.rows().into_iter().zip(part.inputs.rows());
            for (outputs, inputs) in rows.take(training - k) {
                let innovation = course.step(outputs, inputs, streamed.has_missing).map_err(RunError::Identify)?;
                if let Some(row) = k.checked_sub(streamed.window.start) {
                    kept.row_mut(row).iter_mut().zip(innovation).for_each(|(to, &e)| *to = e);
                }
                k += 1;
                let done = pass * training + k;
                if !watcher(done, total) && done < total {
                    return Ok(Ending::Paused(Box::new(course.pause(pass, &[kept]))));
                }
            }
        }
        pass += 1;
        k = 0;
        if pass < plan.passes {
            course.next_record().map_err(RunError::Identify)?;
        }
    }
    Ok(Ending::Done(Box::new(course.finish(vec![kept]))))
}

/// Returns the error for a file that has lost samples since its first pass.
fn shorter(found: usize, expected: usize) -> RunError {
    super::error::setting("stream", format!("the file changes: it had {expected} training samples, and now {found}"))
}

/// Simulates and predicts all held-out samples with the model of scaled channels, from the `state` at the end of the
/// training part.
pub(super) fn held_out(
    streamed: &Streamed,
    scaled: &Model,
    gain: Option<&DMatrix<f64>>,
    state: &[f64],
    progress: &dyn Progress,
) -> Result<StreamedRun, RunError> {
    progress.stage("held-out samples");
    let scales = Array1::from(streamed.output_scales().to_vec());
    let x0 = DVector::from_column_slice(state);
    let mut free_run = Follower::new(scaled.clone(), &x0, &scales);
    let predictor = gain.map(|gain| Model { predictor_gain: Some(gain.clone()), ..scaled.clone() });
    let mut one_step = predictor.map(|model| Follower::new(model, &x0, &scales));
    let mut parts = streamed.parts(streamed.training)?;
    let (mut done, total) = (0, streamed.samples - streamed.training);
    while let Some(part) = parts.next_part()? {
        if progress.interrupted() {
            return Err(RunError::Identify(IdentifyError::Interrupted));
        }
        free_run.follow(part.outputs.view(), |model, x| {
            let simulation = simulate(model, part.inputs.view(), x).ok()?;
            Some((simulation.outputs, simulation.final_state))
        })?;
        if let Some(one_step) = &mut one_step {
            one_step.follow(part.outputs.view(), |model, x| {
                let prediction = one_step_prediction(model, part.inputs.view(), part.outputs.view(), x).ok()?;
                Some((prediction.predicted, prediction.final_state))
            })?;
        }
        done += part.inputs.nrows();
        progress.advance(done, total);
    }
    if let Some(last) = parts.last_output() {
        // This is the sample that the input advance drops.
        let measured = Array1::from(last.to_vec()).insert_axis(Axis(0));
        for follower in [Some(&mut free_run), one_step.as_mut()].into_iter().flatten() {
            follower.follow(measured.view(), |model, x| {
                let seen = Array1::from((&model.c * x).as_slice().to_vec()).insert_axis(Axis(0));
                Some((seen, x.clone()))
            })?;
        }
    }
    Ok(StreamedRun {
        samples: streamed.samples,
        training: streamed.training,
        first: streamed.window.start,
        window_training: streamed.training - streamed.window.start,
        window_held_out: streamed.window.end - streamed.training,
        free_run: free_run.sums.measures()?,
        one_step: one_step.filter(|o| o.state.is_some()).map(|o| o.sums.measures()).transpose()?,
    })
}

/// A model that follows a record block by block.
struct Follower<'a> {
    model: Model,
    /// The state before the next block; `None` once the model has diverged.
    state: Option<DVector<f64>>,
    scales: &'a Array1<f64>,
    /// Errors in the data's units.
    sums: ErrorSums,
}

impl<'a> Follower<'a> {
    fn new(model: Model, state: &DVector<f64>, scales: &'a Array1<f64>) -> Self {
        let sums = ErrorSums::new(model.p());
        Self { model, state: Some(state.clone()), scales, sums }
    }

    /// Compares the outputs of a block with the response of the model. `of` returns this response and the state after
    /// the block, or `None` if the model diverges.
    fn follow(
        &mut self,
        measured: ArrayView2<'_, f64>,
        of: impl FnOnce(&Model, &DVector<f64>) -> Option<(Array2<f64>, DVector<f64>)>,
    ) -> Result<(), RunError> {
        let found = self.state.as_ref().and_then(|state| of(&self.model, state));
        let (response, state) = match found {
            Some((response, state)) => (response * self.scales, Some(state)),
            None => (Array2::from_elem(measured.dim(), f64::INFINITY), None),
        };
        self.state = state;
        self.sums.add((&measured * self.scales).view(), response.view())?;
        Ok(())
    }
}
