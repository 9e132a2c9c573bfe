use nalgebra::linalg::Schur;
use nalgebra::{Complex, DMatrix, DVector, Matrix2, Vector2};

use super::error::ModelError;
use super::state_space::LARGEST;

type C = Complex<f64>;

/// The most QR steps per eigenvalue. Two or three are usual.
const MOST_STEPS: usize = 60;

/// Eigenvalues with right and left eigenvectors, normalised so that l_k . r_k = 1.
pub(super) struct Eigen {
    pub values: Vec<C>,
    /// The right eigenvectors as columns.
    pub right: DMatrix<C>,
    /// The left eigenvectors as rows: the inverse of `right`. `None` if the eigenvectors are linearly dependent.
    pub left: Option<DMatrix<C>>,
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
pub(super) fn eigenvalues(a: &DMatrix<f64>) -> Result<Vec<C>, ModelError> {
    let (_, t) = schur(balance(a).0)?;
    Ok(blocks(&t).iter().flat_map(|&block| values(&t, block)).collect())
}

/// Returns the eigenvalues and eigenvectors of A.
pub(super) fn eigen(a: &DMatrix<f64>) -> Result<Eigen, ModelError> {
    let (balanced, scale) = balance(a);
    let (q, t) = schur(balanced)?;
    let blocks = blocks(&t);
    let mut found: Vec<(C, DVector<C>)> = Vec::with_capacity(a.nrows());
    for (index, &block) in blocks.iter().enumerate() {
        for (place, value) in values(&t, block).into_iter().enumerate() {
            // The second of a pair has the conjugate vector of the first.
            let vector = match found.last() {
                Some((_, first)) if place == 1 => first.conjugate(),
                _ => triangular_vector(&t, &blocks[..=index], value),
            };
            found.push((value, vector));
        }
    }
    let columns: Vec<DVector<C>> = found.iter().map(|(_, vector)| q.map(C::from) * vector).collect();
    let vectors = DMatrix::from_columns(&columns);
    let left = vectors.clone().try_inverse().filter(|left| left.iter().all(|x| x.is_finite()));
    let left = left.map(|l| DMatrix::from_fn(l.nrows(), l.ncols(), |i, j| l[(i, j)] / scale[j]));
    let right = DMatrix::from_fn(vectors.nrows(), vectors.ncols(), |i, j| vectors[(i, j)] * scale[i]);
    Ok(Eigen { values: found.into_iter().map(|(value, _)| value).collect(), right, left })
}

/// Returns Q and T of the real Schur decomposition A = Q T Q^T.
///
/// The library's QR steps take their shifts from the last two rows, and stall where these never change: for a cyclic
/// permutation, which a delay line in a loop is, they are always zero. A reflection at a plane without special
/// directions keeps the eigenvalues, and leaves no such rows.
fn schur(a: DMatrix<f64>) -> Result<(DMatrix<f64>, DMatrix<f64>), ModelError> {
    let n = a.nrows();
    if a.iter().any(|x| !x.is_finite()) {
        return Err(ModelError::Eigenvalues);
    }
    if let Some(found) = library(&a) {
        return Ok(found);
    }
    let normal = DVector::from_fn(n, |i, _| 1.0 + (i as f64).sin()).normalize();
    let reflection = DMatrix::identity(n, n) - &normal * normal.transpose() * 2.0;
    let (q, t) = library(&(&reflection * a * &reflection)).ok_or(ModelError::Eigenvalues)?;
    Ok((reflection * q, t))
}

/// The library's decomposition, if it converges.
///
/// It divides A by its largest entry and multiplies T by it, so that a pole at one, an integrator, would come back
/// beside one. A power of two that follows A on the diagonal is the largest entry in its place, and both are exact.
fn library(a: &DMatrix<f64>) -> Option<(DMatrix<f64>, DMatrix<f64>)> {
    let n = a.nrows();
    let mut padded = DMatrix::zeros(n + 1, n + 1);
    padded.view_mut((0, 0), (n, n)).copy_from(a);
    padded[(n, n)] = a.amax().max(f64::MIN_POSITIVE).log2().ceil().min(1023.0).exp2();
    let (q, t) = Schur::try_new(padded, f64::EPSILON, MOST_STEPS * (n + 1))?.unpack();
    Some((q.view((0, 0), (n, n)).into_owned(), t.view((0, 0), (n, n)).into_owned()))
}

/// A diagonal block of T: its first row, and whether it has a second one.
#[derive(Clone, Copy)]
struct Block {
    first: usize,
    double: bool,
}

fn blocks(t: &DMatrix<f64>) -> Vec<Block> {
    let mut blocks = Vec::with_capacity(t.nrows());
    let mut first = 0;
    while first < t.nrows() {
        let double = first + 1 < t.nrows() && t[(first + 1, first)] != 0.0;
        blocks.push(Block { first, double });
        first += if double { 2 } else { 1 };
    }
    blocks
}

/// Returns the eigenvalues of a block of T: of a pair, first the one with the positive imaginary part.
fn values(t: &DMatrix<f64>, Block { first, double }: Block) -> Vec<C> {
    if !double {
        return vec![C::from(t[(first, first)])];
    }
    let [[a, b], [c, d]] = [[0, 1].map(|j| t[(first, first + j)]), [0, 1].map(|j| t[(first + 1, first + j)])];
    let (mean, half) = (0.5 * (a + d), 0.5 * (a - d));
    let root = C::from(half * half + b * c).sqrt();
    vec![C::from(mean) + root, C::from(mean) - root]
}

/// Returns the eigenvector, of length one, of the upper quasi-triangular T for a value of the last of the given blocks:
/// back substitution, as in LAPACK's dtrevc. A pivot near zero, which a repeated value has, is replaced by one that is
/// as large as rounding.
fn triangular_vector(t: &DMatrix<f64>, blocks: &[Block], value: C) -> DVector<C> {
    let smallest = (f64::EPSILON * t.amax()).max(f64::MIN_POSITIVE);
    let mut x = DVector::from_element(t.nrows(), C::ZERO);
    let Some((&last, above)) = blocks.split_last() else { return x };
    let k = last.first;
    x[k] = C::ONE;
    if last.double {
        // Each row of the block determines the same direction; the larger one determines it better.
        let rows =
            [[C::from(t[(k, k)]) - value, t[(k, k + 1)].into()], [t[(k + 1, k)].into(), value - t[(k + 1, k + 1)]]];
        let size = |row: &[C; 2]| row[0].norm() + row[1].norm();
        let [p, q] = if size(&rows[0]) > size(&rows[1]) { [rows[0][0], rows[0][1]] } else { [rows[1][0], -rows[1][1]] };
        (x[k], x[k + 1]) = (q, -p);
    }
    let end = if last.double { k + 2 } else { k + 1 };
    for &Block { first, double } in above.iter().rev() {
        let from = if double { first + 2 } else { first + 1 };
        let sum = |row: usize| -(from..end).map(|j| x[j] * t[(row, j)]).sum::<C>();
        if double {
            let right = Vector2::new(sum(first), sum(first + 1));
            let block = Matrix2::from_fn(|i, j| C::from(t[(first + i, first + j)]));
            let solved = solve(block - Matrix2::from_diagonal_element(value), right, smallest);
            (x[first], x[first + 1]) = (solved[0], solved[1]);
        } else {
            x[first] = sum(first) / away_from_zero(C::from(t[(first, first)]) - value, smallest);
        }
        // A chain of equal values multiplies the entries by 1e16 for each of them.
        let largest = x.iter().map(|x| x.norm()).fold(0.0, f64::max);
        if largest > 1e100 {
            x.unscale_mut(largest);
        }
    }
    let norm = x.norm();
    x.unscale(norm)
}

fn away_from_zero(pivot: C, smallest: f64) -> C {
    if pivot.norm() < smallest { C::from(smallest) } else { pivot }
}

/// Solves two equations by elimination with the larger pivot of the first column.
fn solve(mut m: Matrix2<C>, mut right: Vector2<C>, smallest: f64) -> Vector2<C> {
    if m[(1, 0)].norm() > m[(0, 0)].norm() {
        m.swap_rows(0, 1);
        right.swap_rows(0, 1);
    }
    let pivot = away_from_zero(m[(0, 0)], smallest);
    let factor = m[(1, 0)] / pivot;
    let second = (right[1] - factor * right[0]) / away_from_zero(m[(1, 1)] - factor * m[(0, 1)], smallest);
    Vector2::new((right[0] - m[(0, 1)] * second) / pivot, second)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Returns the larger of |A r - lambda r| and |l A - lambda l|, relative to A and the vectors.
    fn misfit(a: &DMatrix<f64>) -> f64 {
        let found = eigen(a).unwrap();
        let complex = a.map(C::from);
        let size = a.norm().max(1e-300);
        let of = |k: usize| {
            let (value, r) = (found.values[k], found.right.column(k));
            let right = (&complex * r - r * value).norm() / (size * r.norm());
            let left = found.left.as_ref().map_or(0.0, |left| {
                let l = left.row(k);
                (l * &complex - l * value).norm() / (size * l.norm())
            });
            right.max(left)
        };
        (0..a.nrows()).map(of).fold(0.0, f64::max)
    }

    #[test]
    fn a_cyclic_permutation_has_the_roots_of_one() {
        for n in [2, 3, 4, 7, 16, 45] {
            let a = DMatrix::from_fn(n, n, |i, j| f64::from(i == (j + 1) % n));
            assert!(misfit(&a) < 1e-13, "{n}: {}", misfit(&a));
            for value in eigenvalues(&a).unwrap() {
                assert!((value.powu(n as u32) - C::ONE).norm() < 1e-12 * n as f64, "{n}: {value}");
            }
        }
    }

    /// A delay line, a repeated pole, and nothing at all: no eigenvector is missing or infinite, and dependent ones
    /// have no inverse.
    #[test]
    fn defective_matrices_have_finite_vectors() {
        for (value, n) in [(0.0, 1), (0.0, 3), (0.0, 40), (0.9, 6), (1.0, 2)] {
            let a = DMatrix::from_fn(n, n, |i, j| if i == j { value } else { f64::from(j == i + 1) });
            let found = eigen(&a).unwrap();
            assert!(found.right.iter().all(|x| x.is_finite()) && found.right.column(0).norm() > 0.5);
            assert!(found.values.iter().all(|v| (v - value).norm() < 1e-2), "{:?}", found.values);
            assert!(n == 1 || found.left.is_none_or(|left| left.norm() > 1e8));
        }
        assert!(eigen(&DMatrix::zeros(5, 5)).unwrap().values.iter().all(|v| *v == C::ZERO));
        assert!(eigenvalues(&DMatrix::zeros(0, 0)).unwrap().is_empty());
        assert!(eigenvalues(&DMatrix::from_element(3, 3, f64::NAN)).is_err());
    }

    proptest! {
        /// Another library, faer, finds the same eigenvalues; the vectors satisfy their definition.
        #[test]
        fn another_library_agrees(n in 1_usize..24, entries in prop::collection::vec(-1.0..1.0, 576)) {
            let a = DMatrix::from_fn(n, n, |i, j| entries[i * 24 + j]);
            prop_assert!(misfit(&a) < 1e-11, "{}", misfit(&a));
            let theirs = faer::Mat::from_fn(n, n, |i, j| a[(i, j)]).eigenvalues().unwrap();
            let ours = eigenvalues(&a).unwrap();
            // Conjugates come in pairs to the bit, so that a filter of those above the real axis finds one of each.
            prop_assert_eq!(ours.iter().filter(|v| v.im > 0.0).count(), ours.iter().filter(|v| v.im < 0.0).count());
            for value in &theirs {
                let nearest = ours.iter().map(|v| (v - value).norm()).fold(f64::INFINITY, f64::min);
                prop_assert!(nearest < 1e-7, "{value}: {nearest}");
            }
        }
    }
}
