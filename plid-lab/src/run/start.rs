//! The initial estimate and its covariance: uninformative, or from an earlier model.

use std::path::Path;

use nalgebra::DMatrix;
use plid_core::{Dense, ImplicitModel, InitialCovariance, ObservableForm, Settings};

use super::error::{RunError, setting};
use crate::experiment::Experiment;
use plid_data::prepare::Prepared;
use plid_model::{ChannelScaling, Model, undo_scaling};

/// Returns the settings of the recursion for scaled channels.
pub(super) fn settings(
    experiment: &Experiment,
    base: &Path,
    prepared: &Prepared,
    form: &ObservableForm,
) -> Result<Settings, RunError> {
    let start = &experiment.start;
    let mut settings = Settings::of_unique_form(form, start.state_variance, start.parameter_variance);
    settings.forgetting = experiment.identification.forgetting;
    settings.parameter_noise = experiment.identification.parameter_noise;
    if let Some(file) = &start.model {
        let model = Model::read(&base.join(file))?;
        from_model(&mut settings, &model, start.widen, prepared, form)?;
    }
    Ok(settings)
}

/// Takes over the parameters of an earlier model, with their covariance multiplied by `widen` if it is known. The state
/// has an uninformative prior.
fn from_model(
    settings: &mut Settings,
    model: &Model,
    widen: f64,
    prepared: &Prepared,
    form: &ObservableForm,
) -> Result<(), RunError> {
    let record = &prepared.records[0];
    let rate = record.sample_rate_hz;
    if (model.sample_rate_hz - rate).abs() > 1e-6 * rate {
        return Err(setting(
            "start.model",
            format!("its sample rate is {} Hz, that of the data {rate} Hz", model.sample_rate_hz),
        ));
    }
    if model.inputs != record.input_names || model.outputs != record.output_names {
        return Err(setting("start.model", "its channels are not those of the data"));
    }
    if model.observability_indices.as_deref() != Some(form.indices()) {
        let found = &model.observability_indices;
        return Err(setting(
            "start.model",
            format!("its indices are {found:?}, but the experiment requires {:?}", form.indices()),
        ));
    }
    let inverse = |scales: &[f64]| scales.iter().map(|s| 1.0 / s).collect::<Vec<_>>();
    let scaling = ChannelScaling {
        input_mean: vec![0.0; model.m()],
        input_scale: inverse(&prepared.input_scales),
        output_mean: vec![0.0; model.p()],
        output_scale: inverse(&prepared.output_scales),
    };
    let scaled = undo_scaling(&canonical(model).map_err(|e| setting("start.model", e))?, &scaling)?;
    let n = form.states();
    settings.initial_estimate[n..].copy_from_slice(&parameters(&scaled, form));
    if let (Some(covariance), InitialCovariance::Diagonal(d)) =
        (&scaled.parameter_covariance, &settings.initial_covariance)
    {
        let size = form.joint_states();
        settings.initial_covariance = InitialCovariance::Full(Dense::from_fn(size, size, |i, j| {
            if i >= n && j >= n {
                widen * covariance[(i - n, j - n)]
            } else if i == j {
                d[i]
            } else {
                0.0
            }
        }));
    }
    Ok(())
}

/// Returns [a_1; ..; a_p; b_1; ..; b_m] of a model in the canonical form `form`.
pub(crate) fn parameters(model: &Model, form: &ObservableForm) -> Vec<f64> {
    let mut parameters = Vec::with_capacity(form.parameter_columns() * form.states());
    for &column in form.output_states() {
        parameters.extend((0..form.states()).map(|row| {
            let structural = if form.shift_source(row) == Some(column) { 1.0 } else { 0.0 };
            model.a[(row, column)] - structural
        }));
    }
    parameters.extend_from_slice(model.b.as_slice());
    parameters
}

/// Returns the identified model before its input advance was undone. A model with D was identified with an advanced
/// input: its B is A b and its D is C b.
pub(crate) fn canonical(model: &Model) -> Result<Model, String> {
    let is_undone = model.d.iter().any(|&d| d != 0.0);
    let b = if is_undone { advanced_input(model)? } else { model.b.clone() };
    Ok(Model { b, d: DMatrix::zeros(model.p(), model.m()), ..model.clone() })
}

/// Returns the b with B = A b and D = C b.
fn advanced_input(model: &Model) -> Result<DMatrix<f64>, String> {
    let (n, p, m) = (model.n(), model.p(), model.m());
    let mut left = DMatrix::zeros(n + p, n);
    left.rows_mut(0, n).copy_from(&model.a);
    left.rows_mut(n, p).copy_from(&model.c);
    let mut right = DMatrix::zeros(n + p, m);
    right.rows_mut(0, n).copy_from(&model.b);
    right.rows_mut(n, p).copy_from(&model.d);
    let solution = left.clone().svd(true, true).solve(&right, 1e-13)?;
    if (&left * &solution - &right).norm() > 1e-6 * right.norm() {
        return Err("its D is not that of an advanced input".into());
    }
    Ok(solution)
}
