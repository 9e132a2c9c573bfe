//! Records from files.

use std::path::PathBuf;

use numpy::{PyArray2, ToPyArray};
use plid::data::{self, DataError, MissingPolicy};
use pyo3::exceptions::PyOSError;
use pyo3::prelude::*;

use crate::errors::value;

/// Inputs and outputs: samples x channels.
type Sides<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>);

/// Reads channels of a text, .mat, .npz or .npy file by their names. A missing output is NaN.
#[pyfunction]
pub fn read<'py>(py: Python<'py>, path: PathBuf, inputs: Vec<String>, outputs: Vec<String>) -> PyResult<Sides<'py>> {
    let failed = |error: DataError| match error {
        DataError::Io { .. } => PyOSError::new_err(error.to_string()),
        other => value(other),
    };
    let table = py.detach(|| data::read(&path, None)).map_err(failed)?;
    let u = data::channels(&table, &inputs, MissingPolicy::Error).map_err(failed)?;
    let y = data::channels(&table, &outputs, MissingPolicy::Nan).map_err(failed)?;
    Ok((u.to_pyarray(py), y.to_pyarray(py)))
}
