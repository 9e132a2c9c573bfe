//! A simulator that is a Python object.

use std::io::stdin;
use std::sync::{Arc, Mutex, PoisonError};

use numpy::ndarray::{Array2, ArrayView2};
use numpy::{PyArray2, PyArrayDyn, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, ToPyArray};
use plid_simulator::{Checked, Description, Motion, Simulator, SimulatorError, own_output};
use pyo3::exceptions::{PyException, PyRuntimeError};
use pyo3::prelude::*;
use pyo3::types::{PyFloat, PyList, PyTuple};

use crate::errors::value;
use crate::fmu::Fmu;
use crate::patience::Patience;

/// The exceptions of the simulator: the last one, and the one that ends the computation, such as Ctrl-C.
#[derive(Default)]
pub struct Raised {
    last: Option<PyErr>,
    end: Option<PyErr>,
}

/// The store of exceptions until Rust has returned.
pub type Shelf = Arc<Mutex<Raised>>;

/// An object with the method `run(parameters, u)`, as `plid._simulator` makes it. Samples are rows of its arrays.
struct Whole {
    description: Description,
    object: Py<PyAny>,
    patience: Patience,
    shelf: Shelf,
}

/// An object with the method `start(parameters)`, and the user's own `step(u, forces)`: a diagnosis takes millions of
/// steps, so no other Python code is called in between.
struct Stepping {
    description: Description,
    object: Py<PyAny>,
    step: Py<PyAny>,
    /// Displacements and velocities after a step.
    moved: Vec<f64>,
    patience: Patience,
    shelf: Shelf,
}

/// Calls Python, unless an exception has ended the computation.
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

/// Returns the simulator of an object of `plid._simulator`, and the store of its exceptions. The object holds an FMU as
/// `native`, and the `step` method of the user's own object as `own_step`; `patience` is the longest time of a call, in
/// s.
pub fn of_object(
    py: Python<'_>,
    description: Description,
    object: Py<PyAny>,
) -> PyResult<(Box<dyn Simulator + Send>, Shelf)> {
    let shelf = Shelf::default();
    let bound = object.bind(py);
    if let Ok(fmu) = bound.getattr("native").and_then(|native| Ok(native.cast_into::<Fmu>()?)) {
        return Ok((Box::new(fmu.get().in_loop(Arc::clone(&shelf))), shelf));
    }
    let patience = Patience::new(&description.name, bound.getattr("patience")?.extract()?);
    let own_step = bound.getattr("own_step").ok().filter(|step| !step.is_none()).map(Bound::unbind);
    let simulator: Box<dyn Simulator + Send> = match own_step {
        Some(step) => {
            let moved = vec![0.0; 2 * description.ports.len()];
            Box::new(Stepping { description, object, step, moved, patience, shelf: Arc::clone(&shelf) })
        }
        None => Box::new(Whole { description, object, patience, shelf: Arc::clone(&shelf) }),
    };
    Ok((simulator, shelf))
}

/// Runs an object of `plid._simulator` from rest (samples x channels).
#[pyfunction]
pub fn run<'py>(
    py: Python<'py>,
    simulator: Py<PyAny>,
    description: &str,
    parameters: PyReadonlyArray1<'py, f64>,
    u: PyReadonlyArray2<'py, f64>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let description: Description = serde_json::from_str(description).map_err(value)?;
    let (mut simulator, shelf) = of_object(py, description, simulator)?;
    let (parameters, u) = (parameters.as_array().to_vec(), columns(u.as_array()));
    match py.detach(|| Checked::new(simulator.as_mut())?.run(&parameters, &u)) {
        Ok(y) => Ok(rows(&y).to_pyarray(py)),
        Err(error) => Err(reason(py, &shelf, PyRuntimeError::new_err(error.to_string()))),
    }
}

/// Checks an object of `plid._simulator` with inputs of a size; returns the findings as JSON.
#[pyfunction]
pub fn check(py: Python<'_>, simulator: Py<PyAny>, description: &str, size: f64) -> PyResult<String> {
    let description: Description = serde_json::from_str(description).map_err(value)?;
    let (mut simulator, shelf) = of_object(py, description, simulator)?;
    let found = py.detach(|| plid_simulator::check(simulator.as_mut(), size));
    match (ended(&shelf), found) {
        (Some(error), _) => Err(error),
        (None, Ok(findings)) => serde_json::to_string(&findings).map_err(value),
        (None, Err(error)) => Err(reason(py, &shelf, PyRuntimeError::new_err(error.to_string()))),
    }
}

/// Serves an object of `plid._simulator` over standard input and output, until standard input ends.
#[pyfunction]
pub fn serve(py: Python<'_>, simulator: Py<PyAny>, description: &str) -> PyResult<()> {
    let description: Description = serde_json::from_str(description).map_err(value)?;
    let (mut simulator, shelf) = of_object(py, description, simulator)?;
    let output = own_output()?;
    // From now on, Python prints to standard error.
    py.import("os")?.call_method1("dup2", (2, 1))?;
    let done = py.detach(|| plid_simulator::serve(simulator.as_mut(), stdin().lock(), output));
    ended(&shelf).map_or(Ok(done?), Err)
}

/// Returns the exception of a failed diagnosis: the one that ended it, or `failure` with the last one as its cause.
pub fn reason(py: Python<'_>, shelf: &Shelf, failure: PyErr) -> PyErr {
    let mut raised = shelf.lock().unwrap_or_else(PoisonError::into_inner);
    raised.end.take().unwrap_or_else(|| {
        failure.set_cause(py, raised.last.take());
        failure
    })
}

/// Takes the exception that ended the computation.
pub fn ended(shelf: &Shelf) -> Option<PyErr> {
    shelf.lock().unwrap_or_else(PoisonError::into_inner).end.take()
}

/// Stores an exception that ends the computation.
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

/// Collects the numbers that Python returned: a number, an array, or a sequence of these. Numbers beyond the end are
/// only counted.
struct Filled<'a> {
    numbers: &'a mut [f64],
    found: usize,
}

impl Filled<'_> {
    fn put(&mut self, x: f64) {
        if let Some(number) = self.numbers.get_mut(self.found) {
            *number = x;
        }
        self.found += 1;
    }

    fn add(&mut self, from: &Bound<'_, PyAny>) -> PyResult<()> {
        if let Ok(number) = from.cast::<PyFloat>() {
            self.put(number.value());
        } else if let Ok(array) = from.cast::<PyArrayDyn<f64>>() {
            array.readonly().as_array().iter().for_each(|x| self.put(*x));
        } else if from.is_instance_of::<PyTuple>() || from.is_instance_of::<PyList>() {
            from.try_iter()?.try_for_each(|entry| self.add(&entry?))?;
        } else {
            // NumPy converts all other numbers: integers, arrays of other types, data frames.
            let array = from.py().import("numpy")?.call_method1("asarray", (from, "float64"))?;
            self.add(&array)?;
        }
        Ok(())
    }
}

/// Reads an array of displacements and velocities, whose size the Python half has checked.
fn motions(found: &Bound<'_, PyAny>) -> PyResult<Vec<Motion>> {
    let found: PyReadonlyArray2<'_, f64> = found.extract()?;
    Ok(found.as_array().rows().into_iter().map(|m| Motion { displacement: m[0], velocity: m[1] }).collect())
}

/// Copies the numbers that Python returned; `what` names them, and `to` has their expected count.
fn copy(from: &Bound<'_, PyAny>, to: &mut [f64], name: &str, what: &str) -> PyResult<()> {
    let expected = to.len();
    let mut filled = Filled { numbers: to, found: 0 };
    filled.add(from)?;
    match filled.found {
        found if found == expected => Ok(()),
        found => Err(value(format!("{name}.step returned {found} {what}, expected {expected}"))),
    }
}

impl Simulator for Whole {
    fn description(&self) -> &Description {
        &self.description
    }

    fn run(&mut self, parameters: &[f64], u: &[Vec<f64>]) -> Result<Vec<Vec<f64>>, SimulatorError> {
        unless_ended(&self.shelf, |py| {
            let given = (parameters.to_pyarray(py), rows(u).to_pyarray(py));
            let y = self.patience.over(py, || self.object.bind(py).call_method1("run", given))?;
            let y: PyReadonlyArray2<'_, f64> = y.extract()?;
            Ok(columns(y.as_array()))
        })
    }
}

impl Simulator for Stepping {
    fn description(&self) -> &Description {
        &self.description
    }

    fn start(&mut self, parameters: &[f64]) -> Result<Vec<Motion>, SimulatorError> {
        unless_ended(&self.shelf, |py| {
            let given = (parameters.to_pyarray(py),);
            motions(&self.patience.over(py, || self.object.bind(py).call_method1("start", given))?)
        })
    }

    fn step(&mut self, u: &[f64], forces: &[f64], y: &mut [f64], at: &mut [Motion]) -> Result<(), SimulatorError> {
        let Self { description, step, moved, patience, .. } = self;
        unless_ended(&self.shelf, |py| {
            let given = (u.to_pyarray(py), forces.to_pyarray(py));
            let found = patience.over(py, || step.bind(py).call1(given))?;
            let name = &description.name;
            if at.is_empty() {
                return copy(&found, y, name, "outputs");
            }
            let (seen, motions): (Bound<'_, PyAny>, Bound<'_, PyAny>) = found.extract()?;
            copy(&seen, y, name, "outputs")?;
            copy(&motions, moved, name, "displacements and velocities")?;
            for (at, moved) in at.iter_mut().zip(moved.chunks_exact(2)) {
                *at = Motion { displacement: moved[0], velocity: moved[1] };
            }
            Ok(())
        })
    }

    fn save(&mut self, slot: usize) -> Result<(), SimulatorError> {
        unless_ended(&self.shelf, |py| self.object.bind(py).call_method1("save", (slot,)).map(drop))
    }

    fn restore(&mut self, slot: usize) -> Result<Vec<Motion>, SimulatorError> {
        unless_ended(&self.shelf, |py| motions(&self.object.bind(py).call_method1("restore", (slot,))?))
    }
}
