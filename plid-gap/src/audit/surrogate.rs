//! A surrogate model for a case without a simulation: a linear model of the outputs that the engineer's own simulator
//! gives for the records' inputs or, without such outputs, the best linear model of the records themselves, or of those
//! that the case sets aside for it.
//!
//! Both are output-error refinements of a subspace estimate. The first replaces a simulator of any kind, with an error
//! of its own. The second has already absorbed the whole part of the gap that a linear model can absorb, so that only
//! nonlinear effects remain to be found.

use std::sync::Arc;

use plid_model::Model;
use plid_refine::{Options, RefineError, free_run_error};

use crate::audit::Law;
use crate::audit::lines;
use crate::audit::offsets::{in_words, shift, with_offsets};
use crate::case::record::{Channels, Excitation, Record};
use crate::case::split::driven;
use crate::case::{Case, Intersample, Limits};
use crate::effects::Setting;
use crate::error::GapError;
use crate::fit::free_run::run;
use crate::fit::linear_model::{Arrays, matrix, of_states, options};
use crate::fit::nuisance::Nuisance;
use crate::fit::problem::Problem;
use crate::noise::NoiseModel;
use crate::noise::model_error::ModelError;
use crate::noise::whiten::Whitener;
use crate::plant::Plant;
use crate::settings::{AuditSettings, GapSettings, PlantSettings};

/// Approximate largest number of states of a simulator that is identified exactly.
const MOST_STATES: usize = 40;

/// Least share of an output's power that rounding leaves as an error.
const ROUNDING: f64 = 1e-20;

/// A surrogate model for a case without a simulation.
#[derive(Debug, Clone)]
pub struct Surrogate {
    /// The model.
    pub model: Model,
    /// Its accuracy in words.
    pub words: String,
    /// Standard deviations of its parameters in the order of [`Nuisance`], by which its prior is widened.
    pub prior_std: Vec<f64>,
    /// The constant that each output contains in addition to its response (p); empty if the records show none.
    pub offsets: Vec<f64>,
    /// The best linear model of the records with its offsets, if the model was identified with the forces of a law.
    pub best_linear: Option<(Model, Vec<f64>)>,
    /// The error of the model on the records from which it was identified, if the error is not noise.
    pub model_error: Option<ModelError>,
    /// The assumed course of the inputs between the samples.
    pub intersample: Intersample,
    /// Whether the inputs hold too few frequencies to determine the model.
    pub undetermined: bool,
}

/// Identifies a model for a case without one.
///
/// # Errors
/// Returns [`GapError::TooLittle`] if the records are too short for the requested states, and [`GapError::Failed`] if
/// no model can be identified.
pub fn identify(case: &Case, say: &mut dyn FnMut(String)) -> Result<Surrogate, GapError> {
    let fitted: Vec<Record> = fitted_records(case)?.into_iter().cloned().collect();
    let of_simulator = fitted.iter().all(|record| record.simulated.is_some());
    say(format!("identifying a model from {}", if of_simulator { "the simulated outputs" } else { "the records" }));
    surrogate(case, fitted, of_simulator, None)
}

/// Identifies the model of the records again, with the forces of a law as further inputs (feedback as inputs: J. P.
/// Noel and G. Kerschen, Mechanical Systems and Signal Processing 40, 2013). Without these forces, a linear model
/// contains a part of the law, and its error is so large that the course of the inputs between the samples hardly
/// affects it. `None` if the forces in a record are unknown.
///
/// # Errors
/// Returns the errors of [`identify`].
pub fn identify_with(case: &Case, law: &Law) -> Result<Option<Surrogate>, GapError> {
    let driven = fitted_records(case)?.into_iter().map(|record| law.drives(record, case.config.rate()));
    let Some(fitted) = driven.collect::<Option<Vec<_>>>() else { return Ok(None) };
    surrogate(case, fitted, false, Some(law)).map(Some)
}

/// Identifies a model of these records, whose inputs may include the forces of a `law` after those of the case.
fn surrogate(case: &Case, fitted: Vec<Record>, of_simulator: bool, law: Option<&Law>) -> Result<Surrogate, GapError> {
    let (linear, error, mut fitted, intersample) = either_hold(case, fitted, of_simulator)?;
    let ((Linear { mut model, std, validation_error }, error), offsets) =
        if of_simulator { ((linear, error), Vec::new()) } else { with_offsets(case, &fitted, (linear, error))? };
    let mut best_linear = law.map(|_| best_linear(case, fitted.clone())).transpose()?;
    fitted.iter_mut().for_each(|record| shift(record, &offsets));
    let set_aside = !case.for_simulation.is_empty();
    let model_error =
        if of_simulator { None } else { model_error(&model, &fitted, set_aside, &case.config.settings.plant)? };
    // Without the inputs of the forces, the model is that of the plant alone.
    let m = case.config.inputs.len();
    model.b = model.b.columns(0, m).into_owned();
    model.d = model.d.columns(0, m).into_owned();
    model.noise.actuator_std.iter_mut().for_each(|std| std.truncate(m));
    fitted.iter_mut().for_each(|record| record.u.truncate(m));
    for model in best_linear.iter_mut().map(|(model, _)| model).chain([&mut model]) {
        model.inputs.clone_from(&case.config.inputs);
        model.outputs.clone_from(&case.config.outputs);
        model.initial_state = None;
        case.config.declare_kinds(model);
    }
    let errors = [error, validation_error];
    let mut words = words(&model, &case.for_simulation, of_simulator, errors, &case.config.settings.audit);
    if let Some(law) = law {
        words += &format!(" It was identified with the force of {} as a further input.", law.name);
    }
    if !intersample.is_zoh() {
        words += " The inputs are assumed to vary linearly between samples, which fits better than steps.";
    }
    words += &in_words(&offsets, &case.config.outputs);
    let driven_line = case.config.settings.signal.driven_line;
    let few = if of_simulator { None } else { lines::too_few(&fitted, model.n(), driven_line) };
    words.extend(few.map(|count| {
        format!(
            " The inputs hold only {count} frequenc{}, which do{} not determine a model of {} states. Record a band of \
            frequencies.",
            if count == 1 { "y" } else { "ies" },
            if count == 1 { "es" } else { "" },
            model.n()
        )
    }));
    let free = |plant: &Plant| !of_simulator && (!set_aside || plant.modes.is_empty());
    let prior_std = prior_std(&model, &fitted, &std, free, &case.config.settings)?;
    let undetermined = few.is_some();
    Ok(Surrogate { model, words, prior_std, offsets, best_linear, model_error, intersample, undetermined })
}

/// Returns the best linear model of records that may have the forces of a law as further inputs, with its offsets.
fn best_linear(case: &Case, mut records: Vec<Record>) -> Result<(Model, Vec<f64>), GapError> {
    records.iter_mut().for_each(|record| record.u.truncate(case.config.inputs.len()));
    let plain = linear(case, &records, false)?;
    let ((linear, _), offsets) = with_offsets(case, &records, plain)?;
    Ok((linear.model, offsets))
}

/// Identifies a model of the records with both holds of the inputs, and a model of a simulator with the zero-order
/// hold alone. Returns the better model with its relative free-run error, the records with their inputs held
/// accordingly, and the hold. A simulator receives only the samples of its inputs, whatever the inputs do between
/// them.
fn either_hold(
    case: &Case,
    fitted: Vec<Record>,
    of_simulator: bool,
) -> Result<(Linear, f64, Vec<Record>, Intersample), GapError> {
    let (zoh, error) = linear(case, &fitted, of_simulator)?;
    if !of_simulator {
        let mut straight = fitted.clone();
        straight.iter_mut().for_each(|record| record.u = Intersample::Foh.held(&record.u));
        let values = straight.iter().map(|record| (record.samples() * record.y.len()) as f64).sum::<f64>();
        if let Ok((foh, less)) = linear(case, &straight, false)
            && 2.0 * values * (error / less).ln() > case.config.settings.search.accept_gain
        {
            return Ok((foh, less, straight, Intersample::Foh));
        }
    }
    Ok((zoh, error, fitted, Intersample::Zoh))
}

/// Identifies the best linear model of records, or of the simulator's outputs for them. Returns it with its relative
/// free-run error on all of them.
pub(super) fn linear(case: &Case, fitted: &[Record], of_simulator: bool) -> Result<(Linear, f64), GapError> {
    let target = |record| simulated_or_measured(record, of_simulator);
    let arrays = Arrays::new(fitted.iter().collect(), target);
    let records = arrays.records();
    let options = options(&records);
    let (rate, settings) = (case.config.rate(), &case.config.settings.audit);
    // An initial model that is judged by the tails of the records must not have been fitted to these tails.
    let head = plid_refine::head(&records).map_err(failed)?;
    let tried = of_simulator && case.config.states.is_none();
    let exact = tried.then(|| itself(&head, &records, rate, settings.exact)).flatten();
    let linear = match exact {
        Some(itself) => itself,
        None => fitted_best(&head, &records, case.config.states.unwrap_or(settings.surrogate_states), rate, &options)?,
    };
    let error = relative(&linear.std, &arrays);
    Ok((linear, error))
}

/// Returns the outputs that a model is to reproduce: those of the engineer's simulator, or the measured ones.
fn simulated_or_measured(record: &Record, of_simulator: bool) -> &Channels {
    record.simulated.as_ref().filter(|_| of_simulator).unwrap_or(&record.y)
}

/// Returns the records from which a model is identified: those that are set aside for it, or else those that are
/// fitted.
fn fitted_records(case: &Case) -> Result<Vec<&Record>, GapError> {
    let fitted = if case.for_simulation.is_empty() {
        driven(&case.records, &case.config.settings.case)
    } else {
        case.for_simulation.iter().collect()
    };
    if fitted.is_empty() {
        return Err(GapError::TooLittle(
            "without `sim` a model is identified, but no record that is fitted has an input".into(),
        ));
    }
    Ok(fitted)
}

/// A linear model of records.
#[derive(Clone)]
pub(super) struct Linear {
    pub model: Model,
    /// Standard deviation of its free-run error on all records, of each output.
    pub std: Vec<f64>,
    /// Relative free-run error after the heads of the records.
    pub validation_error: f64,
}

/// Identifies a linear simulator exactly, with its own number of states. Returns `None` if the simulator's outputs do
/// not determine the model, or if the model does not predict them after the heads of the records.
fn itself(head: &[plid_refine::Record], records: &[plid_refine::Record], rate: f64, exact: f64) -> Option<Linear> {
    let found = plid_refine::exact(head, MOST_STATES, true, rate).ok()??;
    let start = |k: usize| &found.initial_states[k];
    let last = records.len().checked_sub(1)?;
    let validation_error = free_run_error(&found.model, &records[last], start(last), head[last].samples()).ok()?;
    let mut sums = vec![(0.0, 0.0); found.model.p()];
    for (k, record) in records.iter().enumerate() {
        let run = plid_model::simulate(&found.model, record.inputs, start(k)).ok()?;
        for ((o, (error, output)), y) in sums.iter_mut().enumerate().zip(record.outputs.columns()) {
            for (y, simulated) in y.iter().zip(run.outputs.column(o)).filter(|(y, _)| y.is_finite()) {
                *error += (y - simulated).powi(2);
                *output += y * y;
            }
        }
    }
    let samples = records.iter().map(plid_refine::Record::samples).sum::<usize>() as f64;
    let std = sums.iter().map(|(error, output)| (error.max(ROUNDING * output) / samples).sqrt()).collect();
    (validation_error < exact).then_some(Linear { model: found.model, std, validation_error })
}

/// Identifies the best model with this number of states.
fn fitted_best(
    head: &[plid_refine::Record],
    records: &[plid_refine::Record],
    states: usize,
    rate: f64,
    options: &Options,
) -> Result<Linear, GapError> {
    let choice = of_states(head, records, states, rate, options).map_err(failed)?;
    let std = choice.refined.residual_variances.iter().map(|variance| variance.sqrt()).collect();
    let validation_error = choice.scores[choice.chosen].error;
    Ok(Linear { model: choice.refined.model, std, validation_error })
}

/// Subtracts from the measured outputs the part of the simulator's own outputs that the model does not reproduce, if
/// the simulator's outputs are given. The remaining gap is that to the simulator, not to its surrogate.
pub fn take_misfit(record: &mut Record, model: &Model) {
    let Some(simulated) = &record.simulated else { return };
    let Ok(run) = plid_model::simulate(model, matrix(&record.u).view(), &model.rest()) else { return };
    for (o, y) in record.y.iter_mut().enumerate() {
        y.iter_mut().enumerate().for_each(|(k, y)| *y += run.outputs[(k, o)] - simulated[o][k]);
    }
}

/// Estimates the model's error from the longest random record or, if the records were set aside for the model, from
/// the longest record. Otherwise, the periodic part of the error in a periodic record may be an effect.
fn model_error(
    model: &Model,
    records: &[Record],
    aside: bool,
    settings: &PlantSettings,
) -> Result<Option<ModelError>, GapError> {
    let tells = |record: &&Record| record.excitation == Excitation::Random || aside;
    let Some(record) = records.iter().filter(tells).max_by_key(|record| record.samples()) else { return Ok(None) };
    let plant = Plant::with_settings(model, settings)?;
    let error = record.error(&run(&plant, &[], record));
    Ok(ModelError::of(record, &error, plant.rate))
}

/// Returns the standard deviations of the model's parameters, as far as the records from which it was identified
/// determine them, if the residual is white noise of these standard deviations. The standard deviation of an
/// undetermined frequency or shape is a tenth of itself, and that of an undetermined damping ratio is as large as the
/// ratio. A model of the records themselves has absorbed a part of the effect: a stiffening spring as a higher
/// frequency, friction as a larger damping ratio. Its parameters are therefore `free` within wide limits.
fn prior_std(
    model: &Model,
    records: &[Record],
    std: &[f64],
    free: impl Fn(&Plant) -> bool,
    settings: &GapSettings,
) -> Result<Vec<f64>, GapError> {
    let plant = Plant::with_settings(model, &settings.plant)?;
    let records = records.to_vec();
    let mut noise = NoiseModel::declared(&plant, std, &vec![0.0; plant.m]);
    noise.settings.clone_from(&settings.noise);
    let masked = vec![Vec::new(); plant.p];
    let whiteners = records.iter().map(|record| Whitener::new(record, &noise, plant.rate, masked.clone())).collect();
    let nuisance = Nuisance::new(&plant, &records, &Limits { frequency: 0.2, damping: 2.0, shape: 0.2 });
    let setting = Setting::bare(&plant, model);
    let settings = Arc::new(settings.clone());
    let problem = Problem { plant, records, whiteners, nuisance, setting, settings, strong: false, longer: Vec::new() };
    let normal = problem.jacobian(&problem.plant).normal;
    let Some(factor) = normal.cholesky() else { return Ok(Vec::new()) };
    let covariance = factor.inverse();
    let free = free(&problem.plant);
    let told = |k: usize| if free { problem.nuisance.std[k] } else { covariance[(k, k)].max(0.0).sqrt() };
    Ok((0..problem.nuisance.of_simulation()).map(told).collect())
}

fn words(model: &Model, chosen: &[Record], of_simulator: bool, errors: [f64; 2], settings: &AuditSettings) -> String {
    let [error, validation_error] = errors.map(|error| 100.0 * error);
    let states = model.n();
    if of_simulator && validation_error < 100.0 * settings.exact {
        format!(
            "The simulator was identified exactly from its outputs: it is linear with {states} states, and the \
            relative error outside the fit is {validation_error:.0e} %. `predict` does not need its outputs."
        )
    } else if of_simulator {
        let poor = if validation_error > 100.0 * settings.poor {
            ": a linear model does not represent it well; the model's error is subtracted from the measured outputs, \
            but effects act on the model"
        } else {
            ". This error is subtracted from the measured outputs, and `predict` needs the simulator's outputs \
            (`--simulated`)"
        };
        format!(
            "The surrogate of the simulator is a linear model of {states} states, identified from its outputs: its \
            error is {error:.2} % within the fit and {validation_error:.2} % outside{poor}."
        )
    } else if let [first, rest @ ..] = chosen {
        let names = rest.iter().fold(first.name.clone(), |names, record| format!("{names} and {}", record.name));
        format!(
            "No simulation is given: the surrogate is the best linear model with {states} states, identified from \
            {names}. Its error is {error:.2} % within the fit and {validation_error:.2} % outside."
        )
    } else {
        format!(
            "No simulation is given: the surrogate is the best linear model with {states} states, identified from the \
            records. Its error is {error:.2} % within the fit and {validation_error:.2} % outside. It already contains \
            all linear effects, so they cannot be found."
        )
    }
}

/// Returns the RMS of the free-run error, each output scaled to unit RMS.
pub(super) fn relative(std: &[f64], arrays: &Arrays) -> f64 {
    let share = |o: usize| {
        let all = arrays.outputs().flat_map(|y| y.column(o).to_vec()).filter(|y| y.is_finite());
        let (sum, count) = all.fold((0.0, 0.0), |(s, n), y| (s + y * y, n + 1.0));
        std[o] * std[o] * count / f64::max(sum, f64::MIN_POSITIVE)
    };
    ((0..std.len()).map(share).sum::<f64>() / std.len() as f64).sqrt()
}

fn failed(error: RefineError) -> GapError {
    let message = format!("no model could be identified: {error}");
    match error {
        RefineError::TooLittleData { .. } => GapError::TooLittle(message),
        _ => GapError::Failed(message),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{apart, case, run, truss};

    #[test]
    fn the_best_linear_model_of_the_records_is_the_surrogate() {
        let mut case = case(&truss(3), &truss(3));
        case.config.states = Some(truss(3).n());
        let Surrogate { model, words, intersample, .. } = identify(&case, &mut |_| {}).unwrap();
        assert_eq!((model.n(), &model.outputs), (truss(3).n(), &case.config.outputs));
        assert!(intersample.is_zoh());
        // Noise of 0.2 % in 4096 samples.
        assert!(apart(&model, &truss(3)) < 0.002, "{}", apart(&model, &truss(3)));
        assert!(
            words.starts_with("No simulation is given: the surrogate is the best linear model with 14 states"),
            "{words}"
        );
    }

    /// The real inputs vary linearly between samples, and the records contain their sampled values.
    #[test]
    fn inputs_that_do_not_step_are_recognised() {
        let mut case = case(&truss(3), &truss(3));
        case.config.states = Some(truss(3).n());
        for record in &mut case.records {
            let measured = run(&truss(3), &Intersample::Foh.held(&record.u));
            let stepped = run(&truss(3), &record.u);
            for (y, (measured, stepped)) in record.y.iter_mut().zip(measured.iter().zip(&stepped)) {
                y.iter_mut().zip(measured.iter().zip(stepped)).for_each(|(y, (m, s))| *y += m - s);
            }
        }
        let Surrogate { model, words, intersample, .. } = identify(&case, &mut |_| {}).unwrap();
        assert_eq!(intersample, Intersample::Foh);
        assert!(words.ends_with("which fits better than steps."), "{words}");
        assert!(apart(&model, &truss(3)) < 0.002, "{}", apart(&model, &truss(3)));
    }

    #[test]
    fn the_engineers_simulator_is_identified_not_the_records() {
        // The simulator is a different truss from the measured one.
        let mut case = case(&truss(4), &truss(3));
        for record in &mut case.records {
            record.simulated = Some(run(&truss(4), &record.u));
        }
        let Surrogate { model, words, .. } = identify(&case, &mut |_| {}).unwrap();
        // The model has the simulator's number of states and no rounding errors.
        assert_eq!(model.n(), truss(4).n());
        assert!(apart(&model, &truss(4)) < 1e-5, "{}", apart(&model, &truss(4)));
        assert!(apart(&model, &truss(3)) > 0.5);
        assert!(
            words.starts_with("The simulator was identified exactly from its outputs: it is linear with"),
            "{words}"
        );
        // Outputs that are rounded to four decimal places do not reveal the order.
        for value in case.records.iter_mut().flat_map(|record| record.simulated.iter_mut().flatten().flatten()) {
            *value = (1e4 * *value).round() / 1e4;
        }
        let Surrogate { model, words, .. } = identify(&case, &mut |_| {}).unwrap();
        assert_eq!(model.n(), AuditSettings::default().surrogate_states);
        assert!(words.contains("its error is 0."), "{words}");
        // Too few states are reported.
        case.config.states = Some(6);
        let words = identify(&case, &mut |_| {}).unwrap().words;
        assert!(words.contains("does not represent it"), "{words}");
    }

    #[test]
    fn short_records_are_refused() {
        let mut case = case(&truss(3), &truss(3));
        for record in &mut case.records {
            record.u.iter_mut().chain(&mut record.y).for_each(|x| x.truncate(60));
        }
        assert!(matches!(identify(&case, &mut |_| {}), Err(GapError::TooLittle(_))));
    }
}
