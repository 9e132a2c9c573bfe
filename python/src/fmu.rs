//! An FMU as a simulator, whose steps do not go through Python.

use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use numpy::{PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2, ToPyArray};
use plid::fmu::{Fmu as Model, FmuError, Options};
use plid_simulator::{Checked, Description, Motion, Simulator, SimulatorError};
use pyo3::exceptions::{PyOSError, PyRuntimeError};
use pyo3::prelude::*;

use crate::errors::value;
use crate::simulator::{Shelf, columns, rows, unless_ended};

/// An FMU that is open.
#[pyclass(frozen, module = "plid._plid")]
pub struct Fmu {
    model: Arc<Mutex<Model>>,
    description: Description,
}

fn locked(model: &Mutex<Model>) -> MutexGuard<'_, Model> {
    model.lock().unwrap_or_else(PoisonError::into_inner)
}

fn failed(error: SimulatorError) -> PyErr {
    PyRuntimeError::new_err(error.to_string())
}

/// Returns displacement and velocity of each port (ports x 2).
fn pairs<'py>(py: Python<'py>, motions: &[Motion]) -> Bound<'py, PyArray2<f64>> {
    let column = |of: fn(&Motion) -> f64| motions.iter().map(of).collect::<Vec<f64>>();
    rows(&[column(|motion| motion.displacement), column(|motion| motion.velocity)]).to_pyarray(py)
}

impl Fmu {
    /// Returns the FMU for a diagnosis, which keeps its exceptions on `shelf`.
    pub fn in_loop(&self, shelf: Shelf) -> InLoop {
        InLoop { model: Arc::clone(&self.model), description: self.description.clone(), shelf }
    }

    fn require_parameters(&self, given: &[f64]) -> PyResult<()> {
        let (found, expected) = (given.len(), self.description.parameters.len());
        if found == expected {
            Ok(())
        } else {
            Err(value(format!("{found} parameters are given, expected {expected}")))
        }
    }
}

#[pymethods]
impl Fmu {
    /// Opens an FMU. `options` is the JSON of `plid::fmu::Options`.
    #[new]
    fn new(py: Python<'_>, path: PathBuf, options: &str) -> PyResult<Self> {
        let options: Options = serde_json::from_str(options).map_err(value)?;
        let model = py.detach(|| Model::open(&path, &options)).map_err(|error| match error {
            FmuError::Io { .. } => PyOSError::new_err(error.to_string()),
            error => value(error),
        })?;
        let description = model.description().clone();
        Ok(Self { model: Arc::new(Mutex::new(model)), description })
    }

    /// The JSON of its description.
    fn description(&self) -> PyResult<String> {
        serde_json::to_string(&self.description).map_err(value)
    }

    /// Simulates from rest (samples x channels).
    fn run<'py>(
        &self,
        py: Python<'py>,
        parameters: PyReadonlyArray1<'py, f64>,
        u: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let (parameters, u) = (parameters.as_array().to_vec(), columns(u.as_array()));
        self.require_parameters(&parameters)?;
        if u.len() != self.description.inputs.len() {
            return Err(value(format!("u has {} columns, expected {}", u.len(), self.description.inputs.len())));
        }
        let y = py.detach(|| Checked::new(&mut *locked(&self.model))?.run(&parameters, &u)).map_err(failed)?;
        Ok(rows(&y).to_pyarray(py))
    }

    /// Goes to rest, and returns the motion at each port.
    fn start<'py>(
        &self,
        py: Python<'py>,
        parameters: PyReadonlyArray1<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let parameters = parameters.as_array().to_vec();
        self.require_parameters(&parameters)?;
        let motions = py.detach(|| locked(&self.model).start(&parameters)).map_err(failed)?;
        Ok(pairs(py, &motions))
    }

    /// Advances by one step, and returns the outputs at its start and the motions at its end.
    #[allow(clippy::type_complexity)]
    fn step<'py>(
        &self,
        py: Python<'py>,
        u: PyReadonlyArray1<'py, f64>,
        forces: PyReadonlyArray1<'py, f64>,
    ) -> PyResult<(Bound<'py, PyArray1<f64>>, Bound<'py, PyArray2<f64>>)> {
        let (u, forces) = (u.as_array().to_vec(), forces.as_array().to_vec());
        let Description { inputs, outputs, ports, .. } = &self.description;
        if (u.len(), forces.len()) != (inputs.len(), ports.len()) {
            let (m, q) = (inputs.len(), ports.len());
            return Err(value(format!("a step takes {m} inputs and {q} forces, not {} and {}", u.len(), forces.len())));
        }
        let (mut y, mut motions) = (vec![0.0; outputs.len()], vec![Motion::default(); ports.len()]);
        py.detach(|| locked(&self.model).step(&u, &forces, &mut y, &mut motions)).map_err(failed)?;
        Ok((y.to_pyarray(py), pairs(py, &motions)))
    }
}

/// An FMU in a diagnosis. Each run checks for Ctrl-C; steps do not call Python.
pub struct InLoop {
    model: Arc<Mutex<Model>>,
    description: Description,
    shelf: Shelf,
}

impl Simulator for InLoop {
    fn description(&self) -> &Description {
        &self.description
    }

    fn start(&mut self, parameters: &[f64]) -> Result<Vec<Motion>, SimulatorError> {
        unless_ended(&self.shelf, |_| Ok(()))?;
        locked(&self.model).start(parameters)
    }

    fn step(&mut self, u: &[f64], forces: &[f64], y: &mut [f64], motions: &mut [Motion]) -> Result<(), SimulatorError> {
        locked(&self.model).step(u, forces, y, motions)
    }

    fn save(&mut self, slot: usize) -> Result<(), SimulatorError> {
        locked(&self.model).save(slot)
    }

    fn restore(&mut self, slot: usize) -> Result<Vec<Motion>, SimulatorError> {
        locked(&self.model).restore(slot)
    }

    fn another(&self) -> Result<Option<Box<dyn Simulator>>, SimulatorError> {
        locked(&self.model).another()
    }
}
