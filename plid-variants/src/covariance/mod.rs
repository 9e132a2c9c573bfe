//! How P is represented: as a matrix (direct, Joseph) or as a triangular factor (Bierman UD, array square root).

mod array_sqrt;
mod bierman_ud;
mod corner;
mod direct;
mod factored;
mod joseph;
mod parameter_blocks;
mod symmetric;
mod triangular;

pub use array_sqrt::ArraySqrt;
pub use bierman_ud::BiermanUd;
pub use corner::{Corner, Laid};
pub use direct::Direct;
pub use factored::{FactorRule, Factored};
pub use joseph::Joseph;
pub use symmetric::{Innovations, Symmetric, UpdateRule};
pub use triangular::{Triangular, Updates};

use plid_core::{Dense, InitialCovariance, Matrix, Scalar, kernels, kernels::BadPivot};

/// Checks that the initial variances are finite and not negative.
fn check_variances(variances: &[f64]) -> Result<(), BadPivot> {
    match variances.iter().position(|&v| !(v >= 0.0 && v.is_finite())) {
        Some(index) => Err(BadPivot { index, value: variances[index] }),
        None => Ok(()),
    }
}

/// Factors P0 = U diag(d) U^T with U unit upper triangular, in f64, or in `S` if it has more digits.
fn factor_initial<S: Scalar>(initial: &InitialCovariance) -> Result<(Dense<S>, Vec<S>), BadPivot> {
    if S::EPSILON < <f64 as Scalar>::EPSILON {
        return factor(initial);
    }
    let (u, d) = factor::<f64>(initial)?;
    Ok((u.cast(), d.into_iter().map(S::from_f64).collect()))
}

fn factor<S: Scalar>(initial: &InitialCovariance) -> Result<(Dense<S>, Vec<S>), BadPivot> {
    match initial {
        InitialCovariance::Diagonal(d) => {
            check_variances(d)?;
            let d: Vec<S> = d.iter().map(|&x| S::from_f64(x)).collect();
            Ok((Dense::from_diagonal(&vec![S::one(); d.len()]), d))
        }
        InitialCovariance::Full(p0) => {
            // A factorisation from the last entry upwards is the usual one of the reversed matrix.
            let size = p0.rows();
            let mut reversed = Dense::from_fn(size, size, |i, j| S::from_f64(p0.at(size - 1 - i, size - 1 - j)));
            let mut d = vec![S::zero(); size];
            kernels::semidefinite_ldl(reversed.view_mut(), &mut d, 1e-13, 1e-13)
                .map_err(|e| BadPivot { index: size - 1 - e.index, value: e.value })?;
            d.reverse();
            let u = Dense::from_fn(size, size, |i, j| match i.cmp(&j) {
                std::cmp::Ordering::Less => reversed.at(size - 1 - i, size - 1 - j),
                std::cmp::Ordering::Equal => S::one(),
                std::cmp::Ordering::Greater => S::zero(),
            });
            Ok((u, d))
        }
    }
}
