//! The run of an experiment from data to report: data acquisition, preparation, identification, validation, output.

mod advice;
mod checkpoint;
mod error;
mod estimate;
mod noise;
mod obtain;
mod output;
mod peaks;
#[cfg(test)]
mod real_files;
pub(crate) mod report;
mod report_simulation;
mod simulation;
mod start;
mod stream;
mod validate;

pub use checkpoint::{CHECKPOINT, require_own};
pub(crate) use checkpoint::{Saved, identity, is_finished, read as read_checkpoint, write as write_checkpoint};
pub use error::RunError;
pub use estimate::Estimate;
pub(crate) use estimate::scaling;
pub(crate) use obtain::obtain;
pub use obtain::{Obtained, Source, Truth};
pub use output::write;
pub(crate) use output::{RESULT, errors as errors_json, file_error, modes_json, peaks_json, strict_json, typed, with};
pub use peaks::PeakRow;
pub(crate) use peaks::compare as compare_peaks;
pub use plid_work::{Progress, Silent};
pub use simulation::{Alternative, Path as RefinementPath, Simulation};
pub(crate) use start::{canonical, parameters};
pub use stream::StreamedRun;
pub use validate::{Errors, Shown, Validation};

use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

use plid_core::{Dense, Health, IdentifiedModel, ImplicitModel, ObservableForm};

use crate::experiment::{Experiment, IndicesChoice, NoiseSource, StructureKind};
use crate::identify::{
    Bank, Ending, IdentifyError, Memory, OrderScan, Paused, Plan, RecursionRun, Samples, ScanRow, Search, Split,
    ToModel, Trial, Watcher, scan_orders, search_indices, tune,
};
use error::setting;
use noise::Known;
use plid_catalogue::{Conditions, CovarianceName};
use plid_data::prepare::stream::Streamed;
use plid_data::prepare::{self, Prepared, excitation};
use plid_data::{Warning, require_samples};
use plid_model::{Model, Noise, undo_advance, undo_scaling};
use plid_refine::{Predictor, RefineError, fit_predictor};

/// The results of a run, in the units of the data.
#[derive(Debug)]
pub struct Outcome {
    /// The experiment as carried out, with all defaults.
    pub experiment: Experiment,
    /// The conditions that decided the covariance form, if the experiment did not name one.
    pub chosen: Option<Conditions>,
    /// SHA-256 of the experiment as requested and of the files that it names.
    pub identity: String,
    /// The data files.
    pub sources: Vec<Source>,
    /// The preparation steps, as sentences.
    pub steps: Vec<String>,
    /// Warnings for the reader.
    pub warnings: Vec<String>,
    /// Advice, as sentences.
    pub advice: Vec<String>,
    /// The prepared data.
    pub prepared: Prepared,
    /// The observable canonical form with its indices.
    pub form: ObservableForm,
    /// The scan over orders, if requested.
    pub scan: Option<OrderScan>,
    /// The search over observability indices, if requested.
    pub index_search: Vec<ScanRow>,
    /// The filters of the noise bank, if it was run; their variances are those of scaled channels.
    pub bank: Vec<Trial>,
    /// R_ii of each scaled output, and the mean Sigma_ii.
    pub noise_levels: (Vec<f64>, f64),
    /// The numerical condition of P at the end.
    pub health: Health,
    /// The identified model in the data's units.
    pub model: Model,
    /// The model in canonical form with its parameter covariance, before an input advance is undone.
    pub canonical: Model,
    /// The additional quantities that a merge needs.
    pub estimate: Estimate,
    /// The method that gave the predictor gain; `None` if there is no stable predictor.
    pub predictor: Option<String>,
    /// One-step errors, simulation errors and residual tests.
    pub validation: Validation,
    /// The subspace model and the refined model.
    pub simulation: Simulation,
    /// Peaks of the true plant and of the model, for simulated data.
    pub peaks: Vec<PeakRow>,
    /// The true plant, for simulated data at their original rate.
    pub truth: Option<Truth>,
    /// The parts of a streamed record and its held-out errors; all other results are those of its window. `None` for
    /// records in memory.
    pub streamed: Option<StreamedRun>,
}

/// Carries out an experiment whose paths are relative to `base`. If `directory` is given, an interrupted run writes its
/// checkpoint there, and `resume` continues from it.
///
/// # Errors
/// Returns a [`RunError`]; an interrupted run returns [`RunError::Interrupted`].
pub fn carry_out(
    experiment: &Experiment,
    base: &Path,
    directory: Option<&Path>,
    resume: bool,
    progress: &dyn Progress,
) -> Result<Outcome, RunError> {
    let mut experiment = experiment.clone();
    require_single(&experiment)?;
    progress.stage("data");
    let identity = identity(&experiment, base)?;
    let Saved { memory, paused, .. } = match (directory, resume) {
        (Some(directory), true) => checkpoint::read(directory, &identity)?,
        _ => Saved::default(),
    };
    // An interrupted run saves its progress in a checkpoint.
    let stopped = |error: RunError, memory: Memory| match error {
        RunError::Identify(IdentifyError::Interrupted) | RunError::Refine(RefineError::Interrupted) => {
            checkpoint::write(directory, &identity, memory, None)
        }
        other => other,
    };
    let (mut obtained, mut prepared, streamed) = if experiment.data.stream {
        let (obtained, window, streamed) = stream::data(&experiment, base, progress)?;
        (obtained, window, Some(streamed))
    } else {
        let (obtained, prepared) = data(&mut experiment, base)?;
        (obtained, prepared, None)
    };
    let mut of_data = std::mem::take(&mut prepared.warnings);
    let training = training(&prepared);
    require_parts(&prepared, &training)?;
    let mut search = Search {
        split: Split::new(&training, experiment.validation.learning_share),
        progress: &|done, total| progress.advance(done, total),
        may_go_on: &|| !progress.interrupted(),
        memory,
    };
    let samples = streamed.as_ref().map_or_else(|| training.iter().map(Samples::len).sum(), |s| s.training);
    let actor = Actor { experiment: &experiment, base, raw: &obtained.records, prepared: &prepared, samples, progress };
    let mut settled = match actor.settle(&mut search, &mut of_data) {
        Err(error) => return Err(stopped(error, search.memory)),
        Ok(settled) => settled,
    };
    let mut warnings = std::mem::take(&mut obtained.warnings);
    warnings.extend(of_data.iter().map(ToString::to_string));

    progress.stage("identification");
    let Settled { plan, .. } = &mut settled;
    let form_is_open = experiment.variant.covariance.is_none();
    if form_is_open && let Some(paused) = &paused {
        plan.variant.covariance = paused.covariance;
    }
    let record = Training { parts: &training, streamed: streamed.as_ref() };
    let run = match recursion(plan, form_is_open, record, paused.as_ref(), progress, &mut warnings)? {
        Ending::Done(run) => *run,
        Ending::Paused(paused) => return Err(checkpoint::write(directory, &identity, search.memory, Some(*paused))),
    };
    experiment.variant.covariance = Some(plan.variant.covariance);
    let memory = search.memory;
    let identity = identity.clone();
    let done =
        Done { experiment, identity, obtained, prepared, streamed, of_data, warnings, settled, form_is_open, run };
    done.conclude(progress).map_err(|error| stopped(error, memory))
}

/// A finished recursion with its inputs.
struct Done {
    experiment: Experiment,
    identity: String,
    obtained: Obtained,
    prepared: Prepared,
    streamed: Option<Streamed>,
    of_data: Vec<Warning>,
    warnings: Vec<String>,
    settled: Settled,
    form_is_open: bool,
    run: RecursionRun,
}

impl Done {
    /// Validates the model, and refines it for simulation.
    fn conclude(self, progress: &dyn Progress) -> Result<Outcome, RunError> {
        progress.stage("validation");
        let Self { experiment, identity, obtained, prepared, streamed, of_data, mut warnings, settled, .. } = self;
        let (form_is_open, run) = (self.form_is_open, self.run);
        let Settled { plan, conditions, scan, index_search, bank } = settled;
        let RecursionRun { innovations, health, identified } = run;
        let scaled = scaled_model(&identified, &prepared)?;
        let alone = experiment.validation.model_only;
        let last = training(&prepared).pop().filter(|_| !alone);
        let predictor = last.and_then(|last| fit_predictor(&scaled, last.inputs, last.outputs));
        let (canonical, model) = in_data_units(&scaled, predictor.as_ref(), &plan, &prepared)?;
        let truth = obtained.truth.filter(|truth| is_comparable(truth, &prepared));
        let estimate = Estimate::new(&plan, &scaled, &identified, &innovations, &prepared, obtained.channel_rms)?;
        let gain = predictor.as_ref().map(|p| &p.gain);
        let state = &identified.state;
        let streamed = streamed.map(|s| stream::held_out(&s, &scaled, gain, state, progress)).transpose()?;
        let validation = validate::validate(&experiment, &scaled, gain, state, innovations, &prepared, truth.as_ref())?;
        let (simulation, said) = if alone {
            (Simulation { best: "plid", ..Simulation::default() }, Vec::new())
        } else {
            simulation::carry_out(&experiment, &scaled, &prepared, &validation.free_run_errors, progress)?
        };
        warnings.extend(said);
        let steps = prepared.steps.iter().map(ToString::to_string);
        let mut outcome = Outcome {
            steps: steps.chain(streamed.as_ref().map(StreamedRun::sentence)).collect(),
            streamed,
            identity,
            sources: obtained.sources,
            advice: Vec::new(),
            predictor: predictor.map(|p| p.origin),
            experiment,
            chosen: form_is_open.then_some(conditions),
            warnings,
            noise_levels: noise_levels(&plan),
            form: plan.form,
            scan,
            index_search,
            bank,
            health,
            canonical,
            estimate,
            validation,
            simulation,
            peaks: truth.as_ref().map_or(Ok(Vec::new()), |truth| peaks::compare(truth, &model))?,
            model,
            truth,
            prepared,
        };
        let (more_warnings, advice) = advice::advise(&outcome, &of_data)?;
        outcome.warnings.extend(more_warnings);
        outcome.advice = advice;
        Ok(outcome)
    }
}

/// Checks that an experiment has no invalid value and is a single run.
fn require_single(experiment: &Experiment) -> Result<(), RunError> {
    if let Some((key, reason)) = experiment.problems().into_iter().next() {
        return Err(setting(key, reason));
    }
    if experiment.structure.kind == StructureKind::SimoMerge {
        return Err(setting("structure", "a merge consists of several runs: `merge::carry_out` makes them"));
    }
    Ok(())
}

/// Checks that there are samples to learn from, and samples that are held out.
fn require_parts(prepared: &Prepared, training: &[Samples<'_>]) -> Result<(), RunError> {
    let last_training = *prepared.training.last().unwrap_or(&0);
    let held_out = prepared.records[prepared.records.len() - 1].samples() > last_training;
    if training.is_empty() || last_training < 8 || !held_out {
        let reason = format!("it leaves {last_training} samples for training, or none to hold out");
        return Err(setting("training_share", reason));
    }
    Ok(())
}

/// The decisions of a run before its recursion.
struct Settled {
    plan: Plan,
    /// The conditions that determine the covariance form.
    conditions: Conditions,
    scan: Option<OrderScan>,
    index_search: Vec<ScanRow>,
    bank: Vec<Trial>,
}

/// The training data of a recursion: records in memory, or the one record that is streamed.
#[derive(Clone, Copy)]
struct Training<'a> {
    parts: &'a [Samples<'a>],
    streamed: Option<&'a Streamed>,
}

impl Training<'_> {
    fn run(self, plan: &Plan, paused: Option<&Paused>, watcher: Watcher<'_>) -> Result<Ending, RunError> {
        match self.streamed {
            None => crate::identify::run(plan, self.parts, paused, watcher).map_err(RunError::Identify),
            Some(streamed) => stream::run(plan, streamed, paused, watcher),
        }
    }
}

/// Runs the recursion of `plan`, or continues it. If P is lost in a form that the experiment does not name, Bierman
/// UD takes its place in `plan`, and a warning states this.
fn recursion(
    plan: &mut Plan,
    form_is_open: bool,
    training: Training<'_>,
    paused: Option<&Paused>,
    progress: &dyn Progress,
    warnings: &mut Vec<String>,
) -> Result<Ending, RunError> {
    let told = AtomicUsize::new(0);
    let mut watcher = |done: usize, total: usize| {
        if done == total || done >= told.load(Ordering::Relaxed) + 64 {
            told.store(done, Ordering::Relaxed);
            progress.advance(done, total);
        }
        !progress.interrupted()
    };
    let ending = training.run(plan, paused, &mut watcher);
    let Err(RunError::Identify(error)) = &ending else { return ending };
    match error.lost() {
        Some(lost) if form_is_open && plan.variant.covariance != CovarianceName::BiermanUd => {
            warnings
                .push(format!("the recommended covariance form failed ({lost}); the run was repeated with Bierman UD"));
            plan.variant.covariance = CovarianceName::BiermanUd;
            told.store(0, Ordering::Relaxed);
            training.run(plan, None, &mut watcher)
        }
        _ => ending,
    }
}

/// Returns R_ii of each scaled output, and the mean Sigma_ii.
fn noise_levels(plan: &Plan) -> (Vec<f64>, f64) {
    let (form, noise) = (&plan.form, &plan.noise);
    let sensor = (0..form.outputs()).map(|i| noise.sensor.at(i, i)).collect();
    (sensor, (0..form.states()).map(|i| noise.state.at(i, i)).sum::<f64>() / form.states() as f64)
}

/// Whether the response of the true plant and the prepared data have the same samples.
fn is_comparable(truth: &Truth, prepared: &Prepared) -> bool {
    let same = truth.noise_free.nrows() == prepared.records[0].samples() + prepared.advanced;
    same && prepared.records.len() == 1 && prepared.start_s == 0.0
}

/// Returns the data before and after preparation.
fn data(experiment: &mut Experiment, base: &Path) -> Result<(Obtained, Prepared), RunError> {
    let mut obtained = obtain(experiment, base)?;
    let mut shares = vec![1.0; obtained.records.len()];
    if let Some(last) = shares.last_mut() {
        *last = experiment.validation.training_share;
    }
    if experiment.preparation.repeats.as_ref().is_some_and(|r| r.period.is_none()) {
        shares.fill(experiment.validation.training_share);
    }
    // A record may occupy most of the memory. It is copied only if the noise is measured on the unprepared data.
    let is_measured = matches!(experiment.noise.from, NoiseSource::Converter | NoiseSource::ZeroInput);
    let records = if is_measured { obtained.records.clone() } else { std::mem::take(&mut obtained.records) };
    let prepared = prepare::prepare(records, &shares, &experiment.preparation)?;
    Ok((obtained, prepared))
}

/// Returns the training parts of prepared records.
pub(crate) fn training(prepared: &Prepared) -> Vec<Samples<'_>> {
    let records = prepared.records.iter().zip(&prepared.training).filter(|(_, count)| **count > 0);
    let samples = records.map(|(record, &count)| {
        let (inputs, outputs) = (record.inputs.view(), record.outputs.view());
        Samples { inputs, outputs, nan_is_missing: noise::has_missing(&record.outputs) }.range(0, count)
    });
    samples.collect()
}

/// Returns the prepared data of an experiment and its bank of filters, or `None` in place of the bank if the
/// experiment specifies all noise covariances.
pub(crate) fn bank(experiment: &Experiment, base: &Path) -> Result<(Prepared, Option<Bank>), RunError> {
    let mut experiment = experiment.clone();
    let (obtained, prepared) = data(&mut experiment, base)?;
    let record = &prepared.records[0];
    let samples = prepared.training.iter().sum();
    let raw = obtained.records.as_slice();
    let actor = Actor { experiment: &experiment, base, raw, prepared: &prepared, samples, progress: &Silent };
    let form = actor.form(experiment.structure.states, record.outputs.ncols(), record.inputs.ncols())?;
    let bank = match actor.known(&form)? {
        Known::All(_) => None,
        Known::Some { .. } => Some(actor.bank(&form)?),
    };
    Ok((prepared, bank))
}

/// The data that the stages of a run share.
struct Actor<'a> {
    experiment: &'a Experiment,
    base: &'a Path,
    /// The records before preparation, if the noise is measured on them.
    raw: &'a [plid_data::Record],
    prepared: &'a Prepared,
    /// Number of training samples of the recursion.
    samples: usize,
    progress: &'a dyn Progress,
}

impl Actor<'_> {
    /// Determines structure, noise and covariance form. Warnings on the training data are added to `of_data`.
    fn settle(&self, search: &mut Search<'_>, of_data: &mut Vec<Warning>) -> Result<Settled, RunError> {
        let Self { experiment, prepared, samples, .. } = *self;
        let (p, m) = (prepared.records[0].outputs.ncols(), prepared.records[0].inputs.ncols());
        let (form, scan, index_search) = self.structure(p, m, search)?;
        of_data.extend(require_samples(samples, (p + m) * form.states())?);
        let segments = prepare::heads(&prepared.records, &prepared.training);
        let deepest = form.indices().iter().copied().max().unwrap_or(1);
        of_data.extend(excitation::excitation(&segments, 2 * deepest).warnings());

        let settings = start::settings(experiment, self.base, prepared, &form)?;
        let (noise, bank) = match self.known(&form)? {
            Known::All(noise) => (*noise, Vec::new()),
            Known::Some { .. } => {
                self.progress.stage("noise covariances");
                let tuned = tune(&self.bank(&form)?, search).map_err(RunError::Identify)?;
                (tuned.noise, tuned.trials)
            }
        };
        let passes = experiment.identification.passes;
        let conditions = Conditions::of(experiment.variant.scalar, &settings, &noise, samples * passes);
        let variant = experiment.variant.settle(&conditions);
        let plan = Plan { form, noise, settings, variant, passes };
        Ok(Settled { plan, conditions, scan, index_search, bank })
    }

    fn known(&self, form: &ObservableForm) -> Result<Known, RunError> {
        noise::known(self.experiment, self.base, self.raw, self.prepared, form)
    }

    fn bank(&self, form: &ObservableForm) -> Result<Bank, RunError> {
        let (sensor, actuator) = match self.known(form)? {
            Known::Some { sensor, actuator } => (sensor, actuator),
            // Comparing orders needs a bank even where the final run's noise is given for one order only.
            Known::All(_) => (None, vec![0.0; form.inputs()]),
        };
        Ok(Bank {
            form: form.clone(),
            settings: start::settings(self.experiment, self.base, self.prepared, form)?,
            expectations: self.experiment.variant.expectations,
            sensor,
            actuator,
        })
    }

    /// Returns the canonical form with the given number of states or with the given indices.
    fn form(&self, states: Option<usize>, p: usize, m: usize) -> Result<ObservableForm, RunError> {
        let bad = |e: plid_core::StructureError| setting("structure", e);
        match (&self.experiment.structure.indices, states) {
            (IndicesChoice::Given(indices), _) if indices.len() != p => {
                Err(setting("indices", format!("{} are given for {p} outputs", indices.len())))
            }
            (IndicesChoice::Given(indices), _) => ObservableForm::new(indices, m).map_err(bad),
            (_, Some(states)) => ObservableForm::balanced(states, p, m).map_err(bad),
            (_, None) => Err(setting("structure", "give `states`, `indices` or orders to `scan`")),
        }
    }

    /// Returns the canonical form, which is given, divided evenly among the outputs, or found by a search or a scan.
    fn structure(
        &self,
        p: usize,
        m: usize,
        search: &mut Search<'_>,
    ) -> Result<(ObservableForm, Option<OrderScan>, Vec<ScanRow>), RunError> {
        let config = &self.experiment.structure;
        let bad = |e: plid_core::StructureError| setting("structure", e);
        let mut scan = None;
        if !config.scan.is_empty() {
            self.progress.stage("order");
            let mut banks = Vec::new();
            for &states in &config.scan {
                banks.push((states, self.bank(&ObservableForm::balanced(states, p, m).map_err(bad)?)?));
            }
            let find = |states: usize| {
                let bank = banks.iter().find(|(n, _)| *n == states).map(|(_, bank)| bank.clone());
                bank.ok_or(IdentifyError::NoSetting { trials: 0 })
            };
            scan = Some(scan_orders(&config.scan, find, search).map_err(RunError::Identify)?);
        }
        let states = config.states.or(scan.as_ref().map(|s: &OrderScan| s.recommended));
        let form = self.form(states, p, m)?;
        if config.indices != IndicesChoice::Search {
            return Ok((form, scan, Vec::new()));
        }
        self.progress.stage("observability indices");
        let template = |indices: &[usize]| {
            let form = ObservableForm::new(indices, m).map_err(|_| IdentifyError::NoSetting { trials: 0 })?;
            self.bank(&form).map_err(|_| IdentifyError::NoSetting { trials: 0 })
        };
        let (indices, rows) = search_indices(&form, template, search).map_err(RunError::Identify)?;
        Ok((ObservableForm::new(&indices, m).map_err(bad)?, scan, rows))
    }
}

/// Returns the identified plant as a model of scaled channels, and of advanced inputs if preparation advanced them.
pub(crate) fn scaled_model(identified: &IdentifiedModel, prepared: &Prepared) -> Result<Model, RunError> {
    let record = &prepared.records[0];
    let mut model = identified.to_model(record.sample_rate_hz)?;
    model.inputs.clone_from(&record.input_names);
    model.outputs.clone_from(&record.output_names);
    Ok(model)
}

/// Converts a model to the units of the data, and returns it in canonical form and in the form for the user.
fn in_data_units(
    scaled: &Model,
    predictor: Option<&Predictor>,
    plan: &Plan,
    prepared: &Prepared,
) -> Result<(Model, Model), RunError> {
    let std = |covariance: &Dense<f64>| (0..covariance.rows()).map(|i| covariance.at(i, i).max(0.0).sqrt()).collect();
    let with_noise = Model {
        noise: Noise { sensor_std: Some(std(&plan.noise.sensor)), actuator_std: Some(std(&plan.noise.actuator)) },
        predictor_gain: predictor.map(|p| p.gain.clone()),
        ..scaled.clone()
    };
    let canonical = undo_scaling(&with_noise, &scaling(prepared))?;
    let model = if prepared.advanced == 1 { undo_advance(&canonical, None)? } else { canonical.clone() };
    Ok((canonical, model))
}
