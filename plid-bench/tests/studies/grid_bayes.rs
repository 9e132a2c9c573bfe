//! The scalar plant x+ = a x + b u + xi, z = x + w against exact Bayes.

use plid_core::ConditionalExpectations;
use plid_testkit::scalar_case::ScalarCase;
use plid_variants::expectations::{JointEkf, MomentMatched, Prior};

/// Error of a, and its square over its variance in P.
fn filter<E: ConditionalExpectations<Scalar = f64>>(case: &ScalarCase) -> (f64, f64) {
    let (found, variance) = case.filtered::<E>();
    let error = found - case.a;
    (error, error * error / variance)
}

type Filter = fn(&ScalarCase) -> (f64, f64);

/// Mean and standard deviation.
fn moments(values: &[f64]) -> (f64, f64) {
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (values.len() - 1) as f64;
    (mean, variance.sqrt())
}

/// What the table was made with.
const TABLE_RUNS: f64 = 300.0;

/// The difference in standard errors of both Monte Carlo runs, the table's and this one.
fn deviation(name: &str, found: f64, published: f64, spread: f64, runs: usize) -> f64 {
    let error = spread * (1.0 / TABLE_RUNS + 1.0 / runs as f64).sqrt();
    let sigmas = (found - published) / error;
    println!("  {name:24} {found:.4} (table {published}, standard error {error:.4}, {sigmas:+.1} of them)");
    sigmas.abs()
}

fn rmse(name: &str, errors: &[f64], published: f64) -> f64 {
    let squares: Vec<f64> = errors.iter().map(|e| e * e).collect();
    let (mean, spread) = moments(&squares);
    let root = mean.sqrt();
    // Of a root: half the relative spread of what stands under it.
    deviation(name, root, published, spread / (2.0 * root), errors.len())
}

fn nees(name: &str, values: &[f64], published: f64) -> f64 {
    let (mean, spread) = moments(values);
    deviation(name, mean, published, spread, values.len())
}

/// (Sigma, R, rmse exact, prior, moment-matched, EKF, NEES prior, moment-matched)
const TABLE: [[f64; 8]; 3] = [
    [0.1, 0.5, 0.0721, 0.0783, 0.0764, 0.0780, 2.33, 1.03],
    [0.1, 3.0, 0.1204, 0.1651, 0.1263, 0.1301, 7.7, 1.06],
    [1.0, 1.0, 0.0708, 0.0779, 0.0733, 0.0738, 1.88, 0.92],
];

/// `runs` for the filters; the first `exact_runs` of them for the grid too.
fn reproduce(runs: usize, exact_runs: usize, points: usize) {
    for [sigma, r, rmse_exact, rmse_prior, rmse_moments, rmse_ekf, nees_prior, nees_moments] in TABLE {
        println!("Sigma = {sigma}, R = {r}, {runs} runs ({exact_runs} on the grid)");
        let cases: Vec<ScalarCase> = (0..runs).map(|k| ScalarCase::draw(sigma, r, 1000 + k as u64)).collect();
        let errors: Vec<f64> = cases[..exact_runs].iter().map(|case| case.exact_mean(points) - case.a).collect();
        let all = |one: Filter| -> (Vec<f64>, Vec<f64>) { cases.iter().map(one).unzip() };
        let (prior, moments, ekf) =
            (all(filter::<Prior<f64>>), all(filter::<MomentMatched<f64>>), all(filter::<JointEkf<f64>>));
        let deviations = [
            rmse("rmse exact", &errors, rmse_exact),
            rmse("rmse prior", &prior.0, rmse_prior),
            rmse("rmse moment-matched", &moments.0, rmse_moments),
            rmse("rmse EKF", &ekf.0, rmse_ekf),
            nees("NEES prior", &prior.1, nees_prior),
            nees("NEES moment-matched", &moments.1, nees_moments),
        ];
        // Eighteen figures: one beyond 3.5 by chance in a hundred times.
        assert!(deviations.iter().all(|&d| d < 3.5), "Sigma = {sigma}, R = {r}: {deviations:.1?}");
        // On the same records, the order that the table shows and that its own spread would hide.
        let square = |errors: &[f64]| errors[..exact_runs].iter().map(|e| e * e).sum::<f64>();
        assert!(square(&errors) < square(&moments.0), "nothing is better than Bayes");
        assert!(square(&moments.0) < square(&prior.0));
    }
}

#[test]
fn table_of_the_conditional_expectations() {
    reproduce(1500, 300, 120);
}

/// cargo test --release -p plid-bench --test grid_bayes -- --ignored --nocapture
#[test]
#[ignore = "a minute: ten times the runs, and a finer grid"]
fn table_of_the_conditional_expectations_at_length() {
    reproduce(20_000, 3000, 300);
}
