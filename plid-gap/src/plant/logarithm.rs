use nalgebra::DMatrix;

/// Distance from the identity matrix below which no further square root is taken and the quadrature is applied.
const NEAR_ONE: f64 = 0.2;

/// Largest number of square roots. If more are needed, an eigenvalue is zero or lies on the negative real axis.
const MOST_ROOTS: i32 = 40;

/// Nodes and weights of Gauss-Legendre quadrature on [0, 1], eight points:
/// log(1 + X) = sum of w X (1 + x X)^{-1}, the [8/8] Pade approximant (Higham, Functions of Matrices, 2008, eq. 11.18).
const QUADRATURE: [(f64, f64); 8] = [
    (0.019_855_071_751_231_884, 0.050_614_268_145_188_13),
    (0.101_666_761_293_186_63, 0.111_190_517_226_687_24),
    (0.237_233_795_041_835_5, 0.156_853_322_938_943_64),
    (0.408_282_678_752_175_1, 0.181_341_891_689_181),
    (0.591_717_321_247_825, 0.181_341_891_689_181),
    (0.762_766_204_958_164_5, 0.156_853_322_938_943_64),
    (0.898_333_238_706_813_4, 0.111_190_517_226_687_24),
    (0.980_144_928_248_768_1, 0.050_614_268_145_188_13),
];

/// Returns the principal logarithm by inverse scaling and squaring; `None` if there is none (a pole at zero, a negative
/// real pole) or if its exponential does not reproduce the matrix.
pub(crate) fn logarithm(a: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let n = a.nrows();
    if n == 0 {
        return Some(a.clone());
    }
    let one = DMatrix::identity(n, n);
    let mut root = a.clone();
    let mut roots = 0;
    while (&root - &one).norm() > NEAR_ONE {
        root = square_root(&root)?;
        roots += 1;
        if roots > MOST_ROOTS {
            return None;
        }
    }
    let x = root - &one;
    let mut sum = DMatrix::zeros(n, n);
    for (node, weight) in QUADRATURE {
        let inverse = (&one + &x * node).try_inverse()?;
        sum += (&x * inverse) * weight;
    }
    let log = sum * 2_f64.powi(roots);
    let back = (log.exp() - a).norm();
    (back <= 1e-8 * a.norm()).then_some(log)
}

/// Returns the principal square root by the product form of the Denman-Beavers iteration (Higham, eq. 6.29).
fn square_root(a: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let n = a.nrows();
    let one = DMatrix::identity(n, n);
    let (mut product, mut root) = (a.clone(), a.clone());
    for _ in 0..60 {
        let inverse = product.clone().try_inverse()?;
        root = (&root + &root * &inverse) * 0.5;
        product = (&one + (&product + inverse) * 0.5) * 0.5;
        let far = (&product - &one).norm();
        if !far.is_finite() {
            return None;
        }
        if far < 1e-14 * n as f64 {
            return Some(root);
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::dmatrix;

    /// A Jordan block has a logarithm, although it has no basis of eigenvectors.
    #[test]
    fn a_jordan_block_has_its_logarithm() {
        let log = dmatrix![-0.3, 1.0, 0.0; 0.0, -0.3, 1.0; 0.0, 0.0, -0.3];
        assert!((logarithm(&log.exp()).unwrap() - log).norm() < 1e-13);
    }

    #[test]
    fn a_fast_rotation_keeps_its_branch() {
        let log = dmatrix![-0.01, 2.9; -2.9, -0.01];
        assert!((logarithm(&log.exp()).unwrap() - log).norm() < 1e-11);
    }

    #[test]
    fn zero_and_negative_poles_have_none() {
        assert!(logarithm(&dmatrix![0.0, 1.0; 0.0, 0.0]).is_none());
        assert!(logarithm(&dmatrix![-0.5, 0.1; 0.0, 0.7]).is_none());
    }
}
