//! The recursion, one sample at a time.

use std::sync::{Mutex, MutexGuard, PoisonError};

use numpy::{PyArray1, PyReadonlyArray1, ToPyArray};
use plid::catalogue::{self, Variant};
use plid::{ImplicitModel, NoiseModel, ObservableForm, Settings, ToModel};
use pyo3::prelude::*;

use crate::errors::{of_model, value};
use crate::model::Model;
use crate::variant::Named;

/// A recursion whose types were chosen by name.
#[pyclass(frozen, module = "plid._plid")]
pub struct Recursion {
    recursion: Mutex<Box<dyn catalogue::Recursion>>,
    rate: f64,
    states: usize,
    nan_is_missing: bool,
}

impl Recursion {
    fn lock(&self) -> MutexGuard<'_, Box<dyn catalogue::Recursion>> {
        self.recursion.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[pymethods]
impl Recursion {
    /// Variances: `noise` of outputs (p), inputs (m) and states (n), `start` of a state and of a parameter.
    #[new]
    #[allow(clippy::too_many_arguments)]
    fn new(
        indices: Vec<usize>,
        noise: (Vec<f64>, Vec<f64>, Vec<f64>),
        start: (f64, f64),
        parameter_noise: f64,
        forgetting: f64,
        rate: f64,
        variant: Named,
        nan_is_missing: bool,
    ) -> PyResult<Self> {
        let (sensor, actuator, state) = noise;
        let form = ObservableForm::new(&indices, actuator.len()).map_err(value)?;
        let noise = NoiseModel::diagonal(&sensor, &actuator, &state);
        let settings = Settings { parameter_noise, forgetting, ..Settings::of_unique_form(&form, start.0, start.1) };
        let chosen = variant.chosen()?;
        let variant = Variant {
            covariance: chosen.covariance.unwrap_or_default(),
            expectations: chosen.expectations,
            backend: chosen.backend,
            scalar: chosen.scalar,
        };
        let states = form.states();
        let recursion = Mutex::new(variant.build(form, &noise, &settings).map_err(value)?);
        Ok(Self { recursion, rate, states, nan_is_missing })
    }

    /// Processes a sample, and returns the innovation (p).
    fn step<'py>(
        &self,
        py: Python<'py>,
        u: PyReadonlyArray1<'_, f64>,
        y: PyReadonlyArray1<'_, f64>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let (u, y) = (u.as_array().to_vec(), y.as_array().to_vec());
        let mut recursion = self.lock();
        recursion.step(&y, &u, self.nan_is_missing).map_err(value)?;
        Ok(recursion.innovation().to_pyarray(py))
    }

    /// The estimate of states and parameters (N).
    #[getter]
    fn estimate<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        let estimate: Vec<f64> = self.lock().estimate().iter().map(|[high, low]| high + low).collect();
        estimate.to_pyarray(py)
    }

    /// The variances of the estimate (N).
    #[getter]
    fn variances<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        let covariance = self.lock().identified().covariance;
        let diagonal: Vec<f64> = (0..covariance.rows()).map(|i| covariance.at(i, i)).collect();
        diagonal.to_pyarray(py)
    }

    /// Number of states.
    #[getter]
    fn states(&self) -> usize {
        self.states
    }

    /// The present model.
    fn model(&self) -> PyResult<Model> {
        Ok(Model { model: self.lock().identified().to_model(self.rate).map_err(of_model)? })
    }
}
