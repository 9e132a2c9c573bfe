//! Conversions of matrices to and from NumPy.

use numpy::ndarray::{Array2, Array3};
use numpy::{PyArray2, PyArray3, PyReadonlyArray2, ToPyArray};
use plid::nalgebra::{Complex, DMatrix};
use pyo3::prelude::*;

/// Returns a matrix as an array.
pub fn to_array<'py>(py: Python<'py>, matrix: &DMatrix<f64>) -> Bound<'py, PyArray2<f64>> {
    Array2::from_shape_fn(matrix.shape(), |at| matrix[at]).to_pyarray(py)
}

/// Returns an array as a matrix.
pub fn to_matrix(array: &PyReadonlyArray2<'_, f64>) -> DMatrix<f64> {
    let array = array.as_array();
    DMatrix::from_fn(array.nrows(), array.ncols(), |i, j| array[(i, j)])
}

/// Returns matrices of one shape as an array whose first axis is their index.
pub fn stacked<'py, T: numpy::Element + Copy + plid::nalgebra::Scalar>(
    py: Python<'py>,
    matrices: &[DMatrix<T>],
    (rows, columns): (usize, usize),
) -> Bound<'py, PyArray3<T>> {
    Array3::from_shape_fn((matrices.len(), rows, columns), |(k, i, j)| matrices[k][(i, j)]).to_pyarray(py)
}

/// An array of frequency responses: frequencies x outputs x inputs.
pub type Responses<'py> = Bound<'py, PyArray3<Complex<f64>>>;
