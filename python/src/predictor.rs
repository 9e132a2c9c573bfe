//! The gain of the one-step predictor.

use numpy::ndarray::{ArrayView1, ArrayView2};
use plid::model::{ChannelScaling, Model, undo_scaling};
use plid::refine::fit_predictor;
use pyo3::prelude::*;
use serde_json::json;

use crate::errors::{of_model, value};

/// Least number of samples for each state: a gain that is fitted to fewer says nothing.
const SAMPLES_PER_STATE: usize = 4;

/// Fits the predictor gain of a model to deviations from its operating point (samples x channels); NaN is a missing
/// output. The outputs are scaled to an RMS of one, because the fit weights them equally. Returns `None` if no gain
/// keeps the predictor bounded.
pub fn with_predictor(model: &Model, u: ArrayView2<'_, f64>, y: ArrayView2<'_, f64>) -> PyResult<Option<Model>> {
    let (n, m, p) = (model.n(), model.m(), model.p());
    let samples = u.nrows();
    if u.ncols() != m || y.dim() != (samples, p) {
        return Err(value(format!(
            "u has the shape {:?} and y {:?}, expected (samples, {m}) and (samples, {p})",
            u.dim(),
            y.dim()
        )));
    }
    if samples < SAMPLES_PER_STATE * n {
        return Err(value(format!("{samples} samples are too few for the predictor gain of {n} states")));
    }
    let size = |column: ArrayView1<'_, f64>| {
        let finite = || column.iter().filter(|y| y.is_finite());
        (finite().map(|y| y * y).sum::<f64>() / finite().count() as f64).sqrt()
    };
    let scales: Vec<f64> = y.columns().into_iter().map(size).collect();
    if let Some(at) = scales.iter().position(|scale| !(scale.is_finite() && *scale > 0.0)) {
        return Err(value(format!("y: channel {:?} has no sample that differs from zero", model.outputs[at])));
    }
    let of = |output_scale: Vec<f64>| ChannelScaling {
        input_mean: vec![0.0; m],
        input_scale: vec![1.0; m],
        output_mean: vec![0.0; p],
        output_scale,
    };
    let mut scaled = undo_scaling(model, &of(scales.iter().map(|scale| 1.0 / scale).collect())).map_err(of_model)?;
    let mut normal = y.to_owned();
    normal.columns_mut().into_iter().zip(&scales).for_each(|(mut column, scale)| column /= *scale);
    let Some(found) = fit_predictor(&scaled, u, normal.view()) else { return Ok(None) };
    scaled.predictor_gain = Some(found.gain);
    let gain = undo_scaling(&scaled, &of(scales)).map_err(of_model)?.predictor_gain;
    let mut provenance = model.provenance.clone().unwrap_or_default();
    provenance.insert("predictor".into(), json!(found.origin));
    Ok(Some(Model { predictor_gain: gain, provenance: Some(provenance), ..model.clone() }))
}
