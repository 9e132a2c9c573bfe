//! How P is carried: as a matrix (direct, Joseph) or as a triangular factor (Bierman UD, array square root).

mod array_sqrt;
mod bierman_ud;
mod direct;
mod joseph;
mod symmetric;
mod triangular;

pub use array_sqrt::ArraySqrt;
pub use bierman_ud::BiermanUd;
pub use direct::Direct;
pub use joseph::Joseph;
pub use symmetric::{Innovations, Symmetric, UpdateRule};

use plid_core::{Dense, ImplicitModel, InitialCovariance, Scalar, kernels, kernels::BadPivot};

/// x <- Abar x = J x + sum_i abar_i x_{c_i}, in place.
fn advance<S: Scalar>(model: &impl ImplicitModel, abar: &Dense<S>, x: &mut [S], outputs: &mut [S]) {
    for (y, &row) in outputs.iter_mut().zip(model.output_states()) {
        *y = x[row];
    }
    model.shift(x);
    for (i, &y) in outputs.iter().enumerate() {
        kernels::axpy(y, abar.column(i), x);
    }
}

/// The first variances must be finite and not negative.
fn check_variances(variances: &[f64]) -> Result<(), BadPivot> {
    match variances.iter().position(|&v| !(v >= 0.0 && v.is_finite())) {
        Some(index) => Err(BadPivot { index, value: variances[index] }),
        None => Ok(()),
    }
}

/// P0 as U diag(d) U^T with U unit upper triangular.
fn factor_initial(initial: &InitialCovariance) -> Result<(Dense<f64>, Vec<f64>), BadPivot> {
    use plid_core::Matrix;
    match initial {
        InitialCovariance::Diagonal(d) => {
            check_variances(d)?;
            Ok((Dense::from_diagonal(&vec![1.0; d.len()]), d.clone()))
        }
        InitialCovariance::Full(p0) => {
            // The same factorisation from the last entry up is that of the reversed matrix from the first one down.
            let size = p0.rows();
            let mut reversed = Dense::from_fn(size, size, |i, j| p0.at(size - 1 - i, size - 1 - j));
            let mut d = vec![0.0; size];
            kernels::semidefinite_ldl(reversed.view_mut(), &mut d, 1e-13)
                .map_err(|e| BadPivot { index: size - 1 - e.index, value: e.value })?;
            d.reverse();
            let u = Dense::from_fn(size, size, |i, j| match i.cmp(&j) {
                std::cmp::Ordering::Less => reversed.at(size - 1 - i, size - 1 - j),
                std::cmp::Ordering::Equal => 1.0,
                std::cmp::Ordering::Greater => 0.0,
            });
            Ok((u, d))
        }
    }
}
