//! The similarity of effects before any fit, to first order: the share of each entry of a screen that a bounded refit
//! would absorb, and the cosines between the remaining traces.

use nalgebra::DMatrix;

use crate::fit::problem::{Jacobian, Problem, dot};
use crate::search::screen::{Base, Entry, traces};

/// The similarity of the traces of some effects, after a bounded refit has absorbed as much of them as it can.
#[derive(Debug, Clone, PartialEq)]
pub struct Overlap {
    /// Share of each trace's energy that the refit absorbs.
    pub absorbed: Vec<f64>,
    /// Cosines between the remaining traces.
    pub cosine: DMatrix<f64>,
    /// Expected difference in log likelihood if the row's effect acts with the size of its trace and the column's
    /// effect is fitted in its place: energy (1 - cosine^2) / 2.
    pub expected: DMatrix<f64>,
}

/// Computes the similarity of whitened traces, each with the size at which its effect is screened. `None` if the
/// refit's normal matrix is not positive definite.
pub fn overlap(problem: &Problem, jacobian: &Jacobian, traces: &[Vec<f64>]) -> Option<Overlap> {
    left(&jacobian.normal, &problem.cross_all(jacobian, traces), traces)
}

/// Computes the overlap from the refit's normal matrix and the products of its derivatives with the traces.
fn left(normal: &DMatrix<f64>, cross: &DMatrix<f64>, traces: &[Vec<f64>]) -> Option<Overlap> {
    let count = traces.len();
    let solved = normal.clone().cholesky()?.solve(cross);
    let whole = DMatrix::from_fn(count, count, |i, j| dot(&traces[i], &traces[j]));
    let clear = &whole - cross.tr_mul(&solved);
    let energy = |i: usize| clear[(i, i)].max(0.0);
    let cosine = DMatrix::from_fn(count, count, |i, j| {
        let sizes = (energy(i) * energy(j)).sqrt();
        if sizes > 0.0 { (clear[(i, j)] / sizes).clamp(-1.0, 1.0) } else { 0.0 }
    });
    Some(Overlap {
        absorbed: (0..count).map(|i| 1.0 - energy(i) / whole[(i, i)].max(f64::MIN_POSITIVE)).collect(),
        expected: DMatrix::from_fn(count, count, |i, j| 0.5 * energy(i) * (1.0 - cosine[(i, j)].powi(2))),
        cosine,
    })
}

/// Computes the similarity of entries of a screen, with the sizes that the screen found.
pub fn of_screen(base: &Base, entries: &[Entry]) -> Option<Overlap> {
    overlap(base.problem, base.jacobian, &traces(base, entries))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The refit absorbs half of the part along its one derivative, whose size equals that of its prior.
    #[test]
    fn overlap_is_that_of_what_the_refit_leaves() {
        let (normal, cross) = (DMatrix::from_element(1, 1, 2.0), DMatrix::from_row_slice(1, 2, &[2.0, 2.0]));
        let found = left(&normal, &cross, &[vec![2.0, 2.0, 0.0], vec![2.0, 0.0, 1.0]]).unwrap();
        // The remaining energies are 4/2 + 4 of 8 and 4/2 + 1 of 5, and their inner product is 4/2.
        let cosine = 2.0 / 18_f64.sqrt();
        let close = |a: f64, b: f64| assert!((a - b).abs() < 1e-12, "{a} {b}");
        close(found.absorbed[0], 0.25);
        close(found.absorbed[1], 0.4);
        close(found.cosine[(0, 1)], cosine);
        close(found.cosine[(1, 1)], 1.0);
        close(found.expected[(0, 1)], 3.0 * (1.0 - 4.0 / 18.0));
        close(found.expected[(1, 0)], 1.5 * (1.0 - 4.0 / 18.0));
        close(found.expected[(0, 0)], 0.0);
    }
}
