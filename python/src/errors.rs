//! Conversions of Rust errors to Python exceptions.

use plid::model::ModelError;
use pyo3::PyErr;
use pyo3::exceptions::{PyOSError, PyRuntimeError, PyValueError};
use std::any::Any;
use std::fmt::Display;

/// Returns a `ValueError` for unsuitable data or options.
pub fn value(error: impl Display) -> PyErr {
    PyValueError::new_err(error.to_string())
}

/// Returns the exception for an error of a model or of its file.
pub fn of_model(error: ModelError) -> PyErr {
    match error {
        ModelError::Io { .. } => PyOSError::new_err(error.to_string()),
        other => value(other),
    }
}

/// A panic, which is a fault of plid. It must not end the interpreter, and Python code may catch it.
pub fn of_panic(panic: &(dyn Any + Send)) -> PyErr {
    let text = panic.downcast_ref::<String>().map(String::as_str).or(panic.downcast_ref::<&str>().copied());
    PyRuntimeError::new_err(format!("a fault in plid, please report it: {}", text.unwrap_or("no message")))
}
