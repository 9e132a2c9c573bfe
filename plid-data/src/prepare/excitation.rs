//! How well the inputs excite the plant.
//!
//! An input is persistently exciting of order d if its vectors of d consecutive samples span R^{md} (Ljung, System
//! Identification, 13.2). A model of n states requires an order of about 2n.
use super::Segment;
use crate::Warning;
use nalgebra::DMatrix;
use serde::{Deserialize, Serialize};

/// Ratio of an eigenvalue to the largest one below which the eigenvalue counts as zero. Rounding errors leave about
/// 1e-15.
const ZERO: f64 = 1e-11;
/// Condition number above which estimates depend on directions that are dominated by noise.
const ILL_CONDITIONED: f64 = 1e8;

/// Persistence of excitation.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Excitation {
    /// The largest order up to `depth` to which the inputs excite persistently.
    pub order: usize,
    /// Number of consecutive samples examined.
    pub depth: usize,
    /// Ratio of the largest to the smallest eigenvalue of their covariance; infinite below full order.
    pub condition: f64,
}

impl Excitation {
    /// Returns the warnings for the reader of a report.
    pub fn warnings(&self) -> Vec<Warning> {
        if self.order < self.depth {
            vec![Warning::PoorExcitation { order: self.order, wanted: self.depth }]
        } else if self.condition > ILL_CONDITIONED {
            vec![Warning::IllConditionedInput { depth: self.depth, condition: self.condition }]
        } else {
            Vec::new()
        }
    }
}

/// Computes the order of persistent excitation up to `depth`. Each input is scaled to unit RMS.
///
/// Windows do not cross records. The depth is reduced if there are fewer windows than m * depth directions.
pub fn excitation(segments: &[Segment], depth: usize) -> Excitation {
    let m = segments.first().map_or(0, |s| s.inputs.ncols());
    let enough = |d: usize| {
        let windows: usize = segments.iter().map(|s| (s.inputs.nrows() + 1).saturating_sub(d)).sum();
        windows >= m * d
    };
    let possible = (0..=depth).rev().find(|&d| enough(d)).unwrap_or(0);
    // The smallest eigenvalue falls with the depth (interlacing), so that bisection finds the order.
    let (mut order, mut too_deep) = (0, possible + 1);
    while too_deep - order > 1 {
        let middle = (order + too_deep) / 2;
        if spread(segments, middle).is_finite() {
            order = middle;
        } else {
            too_deep = middle;
        }
    }
    Excitation { order, depth, condition: if order == depth { spread(segments, depth) } else { f64::INFINITY } }
}

/// Returns the ratio of the largest to the smallest eigenvalue of the block Hankel covariance; infinite if the smallest
/// one is zero.
fn spread(segments: &[Segment], depth: usize) -> f64 {
    let m = segments.first().map_or(0, |s| s.inputs.ncols());
    if depth == 0 || m == 0 {
        return 1.0;
    }
    let scales: Vec<f64> =
        (0..m).map(|j| plid_model::signal::rms(segments.iter().flat_map(|s| s.inputs.column(j)))).collect();
    if scales.contains(&0.0) {
        return f64::INFINITY;
    }
    let mut gram = DMatrix::<f64>::zeros(m * depth, m * depth);
    for segment in segments {
        let Some(windows) = (segment.inputs.nrows() + 1).checked_sub(depth) else {
            continue;
        };
        let u = |k: usize, j: usize| segment.inputs[[k, j]] / scales[j];
        // From one block to the next along a diagonal of blocks, the windows of both factors move on by one sample.
        for lag in 0..depth {
            for a in 0..m {
                for b in 0..m {
                    let mut sum: f64 = (0..windows).map(|k| u(k, a) * u(k + lag, b)).sum();
                    for row in 0..depth - lag {
                        let (i, j) = (row * m + a, (row + lag) * m + b);
                        gram[(i, j)] += sum;
                        if lag > 0 {
                            gram[(j, i)] += sum;
                        }
                        if row + lag + 1 < depth {
                            sum += u(row + windows, a) * u(row + windows + lag, b) - u(row, a) * u(row + lag, b);
                        }
                    }
                }
            }
        }
    }
    let eigenvalues = gram.symmetric_eigenvalues();
    let (low, high) = (eigenvalues.min(), eigenvalues.max());
    if low > ZERO * high { high / low } else { f64::INFINITY }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prepare::test_plants::Gaussian;
    use ndarray::Array2;
    use std::f64::consts::PI;

    fn of(inputs: &Array2<f64>, depth: usize) -> Excitation {
        let outputs = Array2::zeros((inputs.nrows(), 1));
        let segment = Segment { inputs: inputs.view(), outputs: outputs.view() };
        excitation(&[segment], depth)
    }

    #[test]
    fn s_sines_excite_to_order_2s_and_a_mean_adds_one() {
        for (sines, mean, order) in [(1, 0.0, 2), (3, 0.0, 6), (3, 1.0, 7), (0, 1.0, 1)] {
            let u = Array2::from_shape_fn((1000, 1), |(k, _)| {
                let tones = (0..sines).map(|s| (2.0 * PI * (0.07 + 0.11 * s as f64) * k as f64).sin());
                mean + tones.sum::<f64>()
            });
            let found = of(&u, 20);
            assert_eq!(found.order, order);
            assert_eq!(found.warnings(), [Warning::PoorExcitation { order, wanted: 20 }]);
            assert_eq!(of(&u, order).warnings(), []);
        }
    }

    #[test]
    fn white_inputs_excite_fully_and_evenly() {
        let mut g = Gaussian::new(1);
        let u = Array2::from_shape_simple_fn((20_000, 2), || 5.0 * g.draw());
        let found = of(&u, 20);
        assert_eq!(found.order, 20);
        assert!(found.condition < 1.5, "{found:?}");
        assert_eq!(found.warnings(), []);
    }

    #[test]
    fn a_smooth_input_has_the_condition_of_its_spectrum() {
        // An AR(1) input with pole a: at great depth the condition tends to ((1 + a) / (1 - a))^2.
        let mut g = Gaussian::new(2);
        let mut last = 0.0;
        let u = Array2::from_shape_simple_fn((100_000, 1), || {
            last = 0.8 * last + g.draw();
            last
        });
        let found = of(&u, 60);
        assert!((60.0..90.0).contains(&found.condition), "{found:?}");
    }

    #[test]
    fn dependent_and_dead_inputs_do_not_excite() {
        let mut g = Gaussian::new(5);
        let u: Vec<f64> = (0..500).map(|_| g.draw()).collect();
        let same = Array2::from_shape_fn((500, 2), |(k, j)| u[k] * (j as f64 + 1.0));
        assert_eq!(of(&same, 4).order, 0);
        let dead = Array2::from_shape_fn((500, 2), |(k, j)| u[k] * (1.0 - j as f64));
        assert_eq!(of(&dead, 4).order, 0);
        // Ten samples cannot show the order 9.
        assert!(of(&same.slice(ndarray::s![..10, ..1]).to_owned(), 9).order <= 5);
    }
}
