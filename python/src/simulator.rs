//! A simulator that is a Python object.

use std::sync::{Arc, Mutex, PoisonError};

use numpy::ndarray::{Array2, ArrayView2};
use numpy::{PyReadonlyArray1, PyReadonlyArray2, ToPyArray};
use plid_simulator::{Description, Motion, Simulator, SimulatorError};
use pyo3::exceptions::PyException;
use pyo3::prelude::*;

use crate::fmu::Fmu;

/// What the simulator raised: the last exception, and the one that ends everything, such as Ctrl-C.
#[derive(Default)]
pub struct Raised {
    last: Option<PyErr>,
    end: Option<PyErr>,
}

/// The place where exceptions wait until Rust has returned.
pub type Shelf = Arc<Mutex<Raised>>;

/// An object with the methods `run(parameters, u)`, `start(parameters)` and `step(u, forces)`, as `plid._simulator`
/// makes them. Samples are rows of its arrays.
struct Foreign {
    description: Description,
    object: Py<PyAny>,
    shelf: Shelf,
}

impl Foreign {
    fn call<T>(&self, work: impl FnOnce(Python<'_>, &Bound<'_, PyAny>) -> PyResult<T>) -> Result<T, SimulatorError> {
        unless_ended(&self.shelf, |py| work(py, self.object.bind(py)))
    }
}

/// Calls Python, unless it has ended everything.
pub fn unless_ended<T>(shelf: &Shelf, work: impl FnOnce(Python<'_>) -> PyResult<T>) -> Result<T, SimulatorError> {
    let mut raised = shelf.lock().unwrap_or_else(PoisonError::into_inner);
    if raised.end.is_some() {
        return Err(SimulatorError::failed("it was stopped"));
    }
    Python::attach(|py| {
        let result = py.check_signals().and_then(|()| work(py));
        result.map_err(|error| {
            let words = SimulatorError::failed(error.to_string());
            let place = if error.is_instance_of::<PyException>(py) { &mut raised.last } else { &mut raised.end };
            *place = Some(error);
            words
        })
    })
}

/// Returns the simulator of an object of `plid._simulator`, and the place of its exceptions. That of an FMU has it as
/// `native`.
pub fn of_object(py: Python<'_>, description: Description, object: Py<PyAny>) -> (Box<dyn Simulator + Send>, Shelf) {
    let shelf = Shelf::default();
    let native = object.bind(py).getattr("native").and_then(|native| Ok(native.cast_into::<Fmu>()?));
    match native {
        Ok(fmu) => (Box::new(fmu.get().in_loop(Arc::clone(&shelf))), shelf),
        Err(_) => (Box::new(Foreign { description, object, shelf: Arc::clone(&shelf) }), shelf),
    }
}

/// Returns the exception that a failed diagnosis should raise: what ended it, or `failure` caused by the last one.
pub fn reason(py: Python<'_>, shelf: &Shelf, failure: PyErr) -> PyErr {
    let mut raised = shelf.lock().unwrap_or_else(PoisonError::into_inner);
    raised.end.take().unwrap_or_else(|| {
        failure.set_cause(py, raised.last.take());
        failure
    })
}

/// Takes the exception that ends everything.
pub fn ended(shelf: &Shelf) -> Option<PyErr> {
    shelf.lock().unwrap_or_else(PoisonError::into_inner).end.take()
}

/// Keeps an exception that ends everything.
pub fn end(shelf: &Shelf, error: PyErr) {
    shelf.lock().unwrap_or_else(PoisonError::into_inner).end = Some(error);
}

/// Returns the columns of an array as channels.
pub fn columns(array: ArrayView2<'_, f64>) -> Vec<Vec<f64>> {
    array.columns().into_iter().map(|column| column.to_vec()).collect()
}

/// Returns channels as an array of samples x channels.
pub fn rows(channels: &[Vec<f64>]) -> Array2<f64> {
    let samples = channels.first().map_or(0, Vec::len);
    Array2::from_shape_fn((samples, channels.len()), |(k, i)| channels[i][k])
}

fn motions(array: ArrayView2<'_, f64>) -> Vec<Motion> {
    array.rows().into_iter().map(|row| Motion { displacement: row[0], velocity: row[1] }).collect()
}

impl Simulator for Foreign {
    fn description(&self) -> &Description {
        &self.description
    }

    fn run(&mut self, parameters: &[f64], u: &[Vec<f64>]) -> Result<Vec<Vec<f64>>, SimulatorError> {
        self.call(|py, object| {
            let y = object.call_method1("run", (parameters.to_pyarray(py), rows(u).to_pyarray(py)))?;
            let y: PyReadonlyArray2<'_, f64> = y.extract()?;
            Ok(columns(y.as_array()))
        })
    }

    fn start(&mut self, parameters: &[f64]) -> Result<Vec<Motion>, SimulatorError> {
        if !self.description.has_steps() {
            return Err(SimulatorError::NoSteps { name: self.description.name.clone() });
        }
        self.call(|py, object| {
            let found = object.call_method1("start", (parameters.to_pyarray(py),))?;
            let found: PyReadonlyArray2<'_, f64> = found.extract()?;
            Ok(motions(found.as_array()))
        })
    }

    fn step(&mut self, u: &[f64], forces: &[f64], y: &mut [f64], at: &mut [Motion]) -> Result<(), SimulatorError> {
        self.call(|py, object| {
            let found = object.call_method1("step", (u.to_pyarray(py), forces.to_pyarray(py)))?;
            // The Python half has checked both sizes.
            let (seen, moved): (PyReadonlyArray1<'_, f64>, PyReadonlyArray2<'_, f64>) = found.extract()?;
            y.iter_mut().zip(seen.as_array()).for_each(|(y, seen)| *y = *seen);
            at.iter_mut().zip(motions(moved.as_array())).for_each(|(at, moved)| *at = moved);
            Ok(())
        })
    }
}
