//! A linear model with its analysis.

use std::path::PathBuf;

use numpy::{PyArray2, PyArray3, PyReadonlyArray1, PyReadonlyArray2, ToPyArray};
use plid::model::{self, ModeKind, frequency_response, mode_deviations, modes, response_variance, simulate};
use plid::nalgebra::{Complex, DMatrix, DVector};
use pyo3::prelude::*;

use crate::arrays::{Responses, stacked, to_array, to_matrix};
use crate::errors::{of_model, value};
use crate::predictor::with_predictor;

/// A mode: frequency in Hz, damping ratio, their standard deviations, the pole, and whether it oscillates.
type Mode = (f64, f64, Option<f64>, Option<f64>, Complex<f64>, bool);

/// A model of the library.
#[pyclass(frozen, module = "plid._plid")]
pub struct Model {
    pub model: model::Model,
}

impl Model {
    /// Whether the model has the covariance from which standard deviations follow.
    fn has_deviations(&self) -> bool {
        self.model.parameter_covariance.is_some() && self.model.observability_indices.is_some()
    }

    fn state(&self, given: Option<PyReadonlyArray1<'_, f64>>) -> DVector<f64> {
        given.map_or(self.model.rest(), |x| DVector::from_iterator(x.as_array().len(), x.as_array().iter().copied()))
    }
}

#[pymethods]
impl Model {
    /// Makes a model from its matrices.
    #[staticmethod]
    fn of_matrices(
        rate: f64,
        a: PyReadonlyArray2<'_, f64>,
        b: PyReadonlyArray2<'_, f64>,
        c: PyReadonlyArray2<'_, f64>,
        d: PyReadonlyArray2<'_, f64>,
    ) -> PyResult<Self> {
        let [a, b, c, d] = [a, b, c, d].map(|matrix| to_matrix(&matrix));
        Ok(Self { model: model::Model::new(rate, a, b, c, d).map_err(of_model)? })
    }

    /// Reads a model.json.
    #[staticmethod]
    fn read(path: PathBuf) -> PyResult<Self> {
        Ok(Self { model: model::Model::read(&path).map_err(of_model)? })
    }

    /// Reads the text of a model.json.
    #[staticmethod]
    fn of_json(text: &str, place: &str) -> PyResult<Self> {
        let json = serde_json::from_str(text).map_err(value)?;
        Ok(Self { model: model::Model::from_json(&json, place).map_err(of_model)? })
    }

    /// Writes a model.json.
    fn write(&self, path: PathBuf) -> PyResult<()> {
        self.model.write(&path).map_err(of_model)
    }

    /// The text of a model.json.
    fn to_json(&self) -> String {
        self.model.to_json().to_string()
    }

    #[getter]
    fn rate(&self) -> f64 {
        self.model.sample_rate_hz
    }

    #[getter]
    fn inputs(&self) -> Vec<String> {
        self.model.inputs.clone()
    }

    #[getter]
    fn outputs(&self) -> Vec<String> {
        self.model.outputs.clone()
    }

    #[getter]
    fn a<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        to_array(py, &self.model.a)
    }

    #[getter]
    fn b<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        to_array(py, &self.model.b)
    }

    #[getter]
    fn c<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        to_array(py, &self.model.c)
    }

    #[getter]
    fn d<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        to_array(py, &self.model.d)
    }

    #[getter]
    fn predictor_gain<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray2<f64>>> {
        self.model.predictor_gain.as_ref().map(|gain| to_array(py, gain))
    }

    #[getter]
    fn parameter_covariance<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray2<f64>>> {
        self.model.parameter_covariance.as_ref().map(|covariance| to_array(py, covariance))
    }

    /// The modes in order of frequency.
    fn modes(&self, py: Python<'_>) -> PyResult<Vec<Mode>> {
        let one = |mode: model::Mode, hz_std, damping_std| {
            (mode.hz, mode.damping, hz_std, damping_std, mode.pole, mode.kind == ModeKind::Oscillatory)
        };
        py.detach(|| {
            if self.has_deviations() {
                let found = mode_deviations(&self.model)?;
                return Ok(found.into_iter().map(|f| one(f.mode, f.hz_std, f.damping_std)).collect());
            }
            Ok(modes(&self.model)?.into_iter().map(|mode| one(mode, None, None)).collect())
        })
        .map_err(of_model)
    }

    /// The response at each frequency in Hz, and the standard deviation of its magnitude if the model has any.
    fn frequency_response<'py>(
        &self,
        py: Python<'py>,
        hz: Vec<f64>,
    ) -> PyResult<(Responses<'py>, Option<Bound<'py, PyArray3<f64>>>)> {
        let (response, std) = py
            .detach(|| {
                let response = frequency_response(&self.model, &hz)?;
                let std = match self.has_deviations() {
                    true => Some(response_variance(&self.model, &hz, 0)?.iter().map(|v| v.magnitude_std()).collect()),
                    false => None,
                };
                Ok((response, std))
            })
            .map_err(of_model)?;
        let shape = (self.model.p(), self.model.m());
        Ok((stacked(py, &response, shape), std.map(|std: Vec<DMatrix<f64>>| stacked(py, &std, shape))))
    }

    /// Simulates the model from a state, or from rest.
    #[pyo3(signature = (u, state=None))]
    fn simulate<'py>(
        &self,
        py: Python<'py>,
        u: PyReadonlyArray2<'_, f64>,
        state: Option<PyReadonlyArray1<'_, f64>>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let (state, u) = (self.state(state), u.as_array().to_owned());
        let done = py.detach(|| simulate(&self.model, u.view(), &state)).map_err(of_model)?;
        Ok(done.outputs.to_pyarray(py))
    }

    /// Predicts each output one step ahead.
    #[pyo3(signature = (u, y, state=None))]
    fn predict<'py>(
        &self,
        py: Python<'py>,
        u: PyReadonlyArray2<'_, f64>,
        y: PyReadonlyArray2<'_, f64>,
        state: Option<PyReadonlyArray1<'_, f64>>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let (state, u, y) = (self.state(state), u.as_array().to_owned(), y.as_array().to_owned());
        let done = py.detach(|| model::one_step_prediction(&self.model, u.view(), y.view(), &state));
        Ok(done.map_err(of_model)?.predicted.to_pyarray(py))
    }

    /// Returns the model with a predictor gain that is fitted to deviations from its operating point; None if no gain
    /// keeps the predictor bounded.
    fn with_predictor(
        &self,
        py: Python<'_>,
        u: PyReadonlyArray2<'_, f64>,
        y: PyReadonlyArray2<'_, f64>,
    ) -> PyResult<Option<Self>> {
        let (u, y) = (u.as_array().to_owned(), y.as_array().to_owned());
        Ok(py.detach(|| with_predictor(&self.model, u.view(), y.view()))?.map(|model| Self { model }))
    }
}
