use nalgebra::{Complex, DMatrix, DVector};

use super::error::ModelError;
use super::state_space::LARGEST;

/// Eigenvalues with right and left eigenvectors, normalised so that l_k . r_k = 1.
pub(super) struct Eigen {
    pub values: Vec<Complex<f64>>,
    /// The right eigenvectors as columns.
    pub right: DMatrix<Complex<f64>>,
    /// The left eigenvectors as rows: the inverse of `right`. `None` if the eigenvectors are linearly dependent.
    pub left: Option<DMatrix<Complex<f64>>>,
}

/// Balances A, unless its entries are too large: returns D^{-1} A D, whose rows and columns have similar norms, and the
/// diagonal of D. Canonical forms are badly balanced.
pub(super) fn balance(a: &DMatrix<f64>) -> (DMatrix<f64>, DVector<f64>) {
    let mut balanced = a.clone();
    if a.amax() > LARGEST {
        return (balanced, DVector::from_element(a.nrows(), 1.0));
    }
    let scale = nalgebra::linalg::balancing::balance_parlett_reinsch(&mut balanced);
    (balanced, scale)
}

/// Returns the eigenvalues of A in the order in which the library computes them.
pub(super) fn eigenvalues(a: &DMatrix<f64>) -> Result<Vec<Complex<f64>>, ModelError> {
    let (balanced, _) = balance(a);
    library(&balanced).eigenvalues().map_err(|_| ModelError::Eigenvalues)
}

/// Returns the eigenvalues and eigenvectors of A.
pub(super) fn eigen(a: &DMatrix<f64>) -> Result<Eigen, ModelError> {
    let n = a.nrows();
    let (balanced, scale) = balance(a);
    let found = library(&balanced).eigen().map_err(|_| ModelError::Eigenvalues)?;
    let values = found.S().column_vector().iter().copied().collect();
    let vectors = DMatrix::from_fn(n, n, |i, j| found.U()[(i, j)]);
    let left = vectors.clone().try_inverse();
    let left = left.map(|l| DMatrix::from_fn(n, n, |i, j| l[(i, j)] / scale[j]));
    let right = DMatrix::from_fn(n, n, |i, j| vectors[(i, j)] * scale[i]);
    Ok(Eigen { values, right, left })
}

/// The library is faer: nalgebra's Schur decomposition does not converge for a cyclic permutation, which a delay line
/// in a loop is.
fn library(a: &DMatrix<f64>) -> faer::Mat<f64> {
    faer::Mat::from_fn(a.nrows(), a.ncols(), |i, j| a[(i, j)])
}
