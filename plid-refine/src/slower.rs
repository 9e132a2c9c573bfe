//! A starting model from records at a lower rate.
//!
//! If records are sampled many times faster than they change, neighbouring samples differ by little more than noise.
//! The windows of the subspace estimate then contain only a fraction of an oscillation, and the descent from this
//! estimate ends in a poor minimum. A model is therefore estimated and refined at a lower rate. If one sample at that
//! rate corresponds to k samples of the records, the poles z of the model become z^(1/k).

use nalgebra::{Complex, DMatrix};
use plid_model::Model;

use crate::error::RefineError;
use crate::record::Record;
use crate::refine::{Noise, Options, Watcher, refine};
use crate::subspace::subspace;

/// Poles whose difference is below this share of their size count as one.
const ONE_POLE: f64 = 1e-8;

/// Returns a starting model with `states` states for [`refine`] at `sample_rate_hz`, from records at a lower rate:
/// each of their samples corresponds to `every` samples at `sample_rate_hz`. Inputs and outputs must have passed the
/// same low-pass filter, which does not change the response from input to output. Only the poles and C of the model
/// are meaningful, because [`refine`] fits B and D to them.
///
/// # Errors
/// Those of [`subspace`] and of [`refine`].
pub fn slower_start(
    slow: &[Record<'_>],
    states: usize,
    every: usize,
    sample_rate_hz: f64,
    options: &Options,
    watcher: Watcher<'_>,
) -> Result<Model, RefineError> {
    // At the lower rate, every plant responds within a sample.
    let options = Options {
        radius: options.radius.powi(every as i32),
        feedthrough: true,
        noise: Noise::White,
        ..options.clone()
    };
    let estimate = subspace(slow, states, None, sample_rate_hz / every as f64, &options)?;
    let mut model = refine(&estimate.model, slow, &options, watcher)?.model;
    model.a = root(&model.a, every);
    model.sample_rate_hz = sample_rate_hz;
    Ok(model)
}

/// Returns the root of a block-diagonal matrix with blocks of two states and, if their number is odd, one of one state.
/// A negative real pole has no real root, so its magnitude is taken.
fn root(a: &DMatrix<f64>, times: usize) -> DMatrix<f64> {
    let n = a.nrows();
    let of_real = |x: f64| x.abs().powf(1.0 / times as f64);
    let mut root = DMatrix::zeros(n, n);
    for at in (0..n).step_by(2) {
        if at + 1 == n {
            root[(at, at)] = of_real(a[(at, at)]);
            continue;
        }
        let block = a.fixed_view::<2, 2>(at, at).into_owned();
        let centre = block.trace() / 2.0;
        let square = centre * centre - block.determinant();
        // f(M) = mean I + slope (M - centre I), where the eigenvalues of M are centre +- sqrt(square).
        let (mean, slope) = if square < 0.0 {
            let pole = Complex::new(centre, (-square).sqrt());
            let power = Complex::from_polar(of_real(pole.norm()), pole.arg() / times as f64);
            (power.re, power.im / pole.im)
        } else {
            let half = square.sqrt();
            let (high, low) = (of_real(centre + half), of_real(centre - half));
            let near = half <= ONE_POLE * centre.abs();
            let slope = if near { of_real(centre) / (times as f64 * centre) } else { (high - low) / (2.0 * half) };
            ((high + low) / 2.0, if slope.is_finite() { slope } else { 0.0 })
        };
        let mut to = block * slope;
        (0..2).for_each(|i| to[(i, i)] += mean - slope * centre);
        root.fixed_view_mut::<2, 2>(at, at).copy_from(&to);
    }
    root
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The power of a root is the matrix: for complex poles, two real ones, a double one and a single one.
    #[test]
    fn the_power_of_a_root_is_the_matrix() {
        let blocks = [[0.3, 0.6, -0.6, 0.3], [0.5, 0.2, 0.3, 0.4], [0.7, 0.1, 0.0, 0.7], [-0.2, 0.8, -0.5, -0.1]];
        let mut a = DMatrix::zeros(9, 9);
        for (k, block) in blocks.iter().enumerate() {
            for (i, x) in block.iter().enumerate() {
                a[(2 * k + i / 2, 2 * k + i % 2)] = *x;
            }
        }
        a[(8, 8)] = 0.35;
        for times in [2, 5, 8] {
            let root = root(&a, times);
            let power = (1..times).fold(root.clone(), |power, _| power * &root);
            assert!((&power - &a).amax() < 1e-7, "{times}: {}", (&power - &a).amax());
        }
        // A negative real pole keeps its magnitude.
        assert!((root(&DMatrix::from_element(1, 1, -0.25), 2)[(0, 0)] - 0.5).abs() < 1e-15);
    }
}
