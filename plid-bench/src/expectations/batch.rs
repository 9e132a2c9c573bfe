//! Batch estimates of the scalar plant. They may use the whole record as often as necessary.

use super::grid::{ScalarPrior, ScalarRecord};

/// Returns the sum over k of the products of two series, for the normal equations of z_{k+1} = a z_k + b u_k.
fn sum(pairs: impl Iterator<Item = (f64, f64)>) -> f64 {
    pairs.map(|(x, y)| x * y).sum()
}

fn solve(normal: [[f64; 2]; 2], right: [f64; 2]) -> Option<[f64; 2]> {
    let determinant = normal[0][0] * normal[1][1] - normal[0][1] * normal[1][0];
    let solution = [
        (normal[1][1] * right[0] - normal[0][1] * right[1]) / determinant,
        (normal[0][0] * right[1] - normal[1][0] * right[0]) / determinant,
    ];
    solution.iter().all(|x| x.is_finite()).then_some(solution)
}

/// Solves the equations with the instruments (i_k, u_k) for the regressors (z_k, u_k), from sample `first` on.
fn instrumental(record: &ScalarRecord<'_>, first: usize, instrument: impl Fn(usize) -> f64) -> Option<[f64; 2]> {
    let (z, u) = (record.z, record.u);
    let all = first..z.len().saturating_sub(1);
    let row = |of: &dyn Fn(usize) -> f64| {
        let with = |x: &dyn Fn(usize) -> f64| sum(all.clone().map(|k| (of(k), x(k))));
        ([with(&|k| z[k]), with(&|k| u[k])], with(&|k| z[k + 1]))
    };
    let ((first, right_first), (second, right_second)) = (row(&instrument), row(&|k| u[k]));
    solve([first, second], [right_first, right_second])
}

/// Least squares of z_{k+1} on z_k and u_k. The noise in z_k biases a towards zero.
pub fn least_squares(record: &ScalarRecord<'_>) -> Option<[f64; 2]> {
    instrumental(record, 0, |k| record.z[k])
}

/// Instrumental variables: the equations of [`least_squares`] with u_{k-1} as the instrument for z_k, because it is
/// independent of the noise.
pub fn instrumental_variable(record: &ScalarRecord<'_>) -> Option<[f64; 2]> {
    instrumental(record, 1, |k| record.u[k - 1])
}

/// The prior knowledge about (a, b).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Knowledge {
    /// Only |a| < 1, for maximum likelihood.
    Stable,
    /// The prior, for maximum a posteriori.
    Prior,
}

/// Returns the negative logarithm of the likelihood (and prior) for this a, with the most probable b, and this b.
///
/// The innovations e = z - C x of the filter for known (a, b) are linear in b, and its gain does not depend on b, so
/// b follows from a regression.
fn profile(record: &ScalarRecord<'_>, prior: &ScalarPrior, knowledge: Knowledge, a: f64) -> (f64, f64) {
    let (mut cost, mut information, mut weighted) = match knowledge {
        Knowledge::Stable => (0.0, 0.0, 0.0),
        Knowledge::Prior => (
            (a - prior.a.0).powi(2) / (2.0 * prior.a.1) + prior.b.0.powi(2) / (2.0 * prior.b.1),
            1.0 / prior.b.1,
            prior.b.0 / prior.b.1,
        ),
    };
    // x = x_0 + b x_1.
    let (mut x0, mut x1, mut variance) = (0.0, 0.0, prior.state_variance);
    for (&z, &u) in record.z.iter().zip(record.u) {
        let (e, s) = (z - x0, variance + record.sensor);
        cost += 0.5 * (e * e / s + s.ln());
        information += x1 * x1 / s;
        weighted += x1 * e / s;
        let gain = variance / s;
        (x0, x1) = (a * (x0 + gain * e), a * (x1 - gain * x1) + u);
        variance = a * a * (variance - gain * variance) + record.state;
    }
    let b = weighted / information;
    (cost - 0.5 * weighted * b, b)
}

/// Returns the (a, b) with the largest likelihood or posterior density. It uses the prediction errors of the
/// innovations form with the stated R and Sigma, on successively finer grids of `points` values of a around the best
/// one.
pub fn most_probable(record: &ScalarRecord<'_>, prior: &ScalarPrior, knowledge: Knowledge, points: usize) -> [f64; 2] {
    let bound = if knowledge == Knowledge::Prior { prior.largest_a } else { 1.0 };
    let mut range = (-bound, bound);
    loop {
        let part = (range.1 - range.0) / points as f64;
        let (a, (_, b)) = (0..points)
            .map(|i| range.0 + (i as f64 + 0.5) * part)
            .map(|a| (a, profile(record, prior, knowledge, a)))
            .min_by(|x, y| x.1.0.total_cmp(&y.1.0))
            .expect("a grid has points");
        if part < 1e-9 {
            return [a, b];
        }
        range = ((a - 2.0 * part).max(-bound), (a + 2.0 * part).min(bound));
    }
}

#[cfg(test)]
mod tests {
    use super::super::grid::exact_bayes;
    use super::super::plants::{Loudness, scalar};
    use super::*;

    fn with_record<T>(
        signal_to_noise: f64,
        seed: u64,
        steps: usize,
        f: impl Fn(&ScalarRecord<'_>, [f64; 2]) -> T,
    ) -> T {
        let loudness = Loudness { signal_to_noise, state_share: 0.2, told_factor: 1.0 };
        let trial = scalar(&ScalarPrior::default(), loudness, steps, seed);
        let (z, u) = (trial.outputs.as_slice().unwrap(), trial.inputs.as_slice().unwrap());
        let (sensor, state) = (trial.told.sensor.at(0, 0), trial.told.state.at(0, 0));
        let truth = trial.truth.as_ref().unwrap();
        f(&ScalarRecord { z, u, sensor, state }, [truth[0], truth[1]])
    }

    #[test]
    fn all_find_the_plant_where_there_is_hardly_any_noise() {
        with_record(1e4, 3, 300, |record, truth| {
            let prior = ScalarPrior::default();
            let found = [
                least_squares(record).unwrap(),
                instrumental_variable(record).unwrap(),
                most_probable(record, &prior, Knowledge::Stable, 40),
                most_probable(record, &prior, Knowledge::Prior, 40),
            ];
            for [a, b] in found {
                assert!((a - truth[0]).abs() < 1e-4 && (b - truth[1]).abs() < 1e-4, "{found:?} for {truth:?}");
            }
        });
    }

    /// With a long record the prior has no influence, and a Gaussian posterior has its mean at its peak.
    #[test]
    fn with_much_data_the_peak_is_the_mean_of_exact_bayes() {
        with_record(3.0, 4, 4000, |record, _| {
            let prior = ScalarPrior::default();
            let bayes = exact_bayes(record, &prior, 60);
            let std = bayes.covariance[0].sqrt();
            for knowledge in [Knowledge::Stable, Knowledge::Prior] {
                let [a, b] = most_probable(record, &prior, knowledge, 40);
                assert!((a - bayes.mean[0]).abs() < 0.1 * std, "{a}, {:?}", bayes.mean);
                assert!((b - bayes.mean[1]).abs() < 0.1 * bayes.covariance[2].sqrt(), "{b}, {:?}", bayes.mean);
            }
        });
    }

    #[test]
    fn noise_draws_least_squares_to_zero_and_leaves_instruments_alone() {
        let errors: Vec<[f64; 2]> = (0..40)
            .map(|seed| {
                with_record(1.0, seed, 4000, |record, truth| {
                    let relative = |found: Option<[f64; 2]>| (found.unwrap()[0] - truth[0]) * truth[0].signum();
                    [relative(least_squares(record)), relative(instrumental_variable(record))]
                })
            })
            .collect();
        let mean = |i: usize| errors.iter().map(|e| e[i]).sum::<f64>() / 40.0;
        assert!(mean(0) < -0.08, "{}", mean(0));
        assert!(mean(1).abs() < 0.04, "{}", mean(1));
    }
}
