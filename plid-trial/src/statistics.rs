//! Shares with their confidence intervals, medians and calibration.

use serde::{Deserialize, Serialize};
use statrs::distribution::{Beta, Binomial, ContinuousCDF, DiscreteCDF};

use plid_model::signal;

/// A share of cases with its 95 % interval.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Rate {
    /// Number of hits.
    pub hits: usize,
    /// Number of cases.
    pub of: usize,
    /// The share of hits; `None` without cases.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub share: Option<f64>,
    /// The Clopper-Pearson interval.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ci95: Option<[f64; 2]>,
}

impl Rate {
    /// Creates a rate from its counts.
    pub fn new(hits: usize, of: usize) -> Self {
        let share = (of > 0).then(|| hits as f64 / of as f64);
        Self { hits, of, share, ci95: (of > 0).then(|| clopper_pearson(hits, of)) }
    }

    /// Counts how often a value is true.
    pub fn of(values: impl IntoIterator<Item = bool>) -> Self {
        let (mut hits, mut of) = (0, 0);
        for value in values {
            hits += usize::from(value);
            of += 1;
        }
        Self::new(hits, of)
    }
}

/// Returns the Clopper-Pearson 95 % interval of a share: each end leaves 2.5 % of the binomial distribution.
pub fn clopper_pearson(hits: usize, of: usize) -> [f64; 2] {
    with_tails(hits, of, 0.025)
}

/// Returns the interval that leaves `tail` at each end.
fn with_tails(hits: usize, of: usize, tail: f64) -> [f64; 2] {
    let (k, n) = (hits as f64, of as f64);
    let quantile = |a: f64, b: f64, p: f64| Beta::new(a, b).map_or(f64::NAN, |beta| beta.inverse_cdf(p));
    let low = if hits == 0 { 0.0 } else { quantile(k, n - k + 1.0, tail) };
    let high = if hits == of { 1.0 } else { quantile(k + 1.0, n - k, 1.0 - tail) };
    [low, high]
}

/// Returns the 95 % interval of the difference between two shares of the same cases, of which `up` were gained and
/// `down` lost. The shares of gains and of losses are each within their own 97.5 % interval.
pub fn paired(up: usize, down: usize, of: usize) -> [f64; 2] {
    let [[low_up, high_up], [low_down, high_down]] = [up, down].map(|hits| with_tails(hits, of, 0.0125));
    [low_up - high_down, high_up - low_down]
}

/// Returns the p-value of the two-sided sign test: the probability that a fair coin falls at least as one-sidedly.
pub fn sign_test(up: usize, down: usize) -> f64 {
    let coin = Binomial::new(0.5, (up + down) as u64).expect("one half is a probability");
    (2.0 * coin.cdf(up.min(down) as u64)).min(1.0)
}

/// Returns the median, or `None` for an empty set.
pub fn median(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| signal::median(values))
}

/// Returns the lowest decile, or `None` for an empty set.
pub fn lowest_tenth(values: &[f64]) -> Option<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.get(values.len() / 10).copied()
}

/// The calibration of stated probabilities.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Calibration {
    /// Number of statements.
    pub of: usize,
    /// The Brier score: the mean of (stated - outcome)^2.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub brier: Option<f64>,
    /// The expected calibration error: the mean over the statements of |mean stated - observed share| of their bin.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub expected_error: Option<f64>,
    /// The bins, ten of equal width.
    pub bins: Vec<Bin>,
}

/// Statements of about the same probability.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Bin {
    /// Mean stated probability.
    pub stated: f64,
    /// The rate at which the statements were true.
    pub came_true: Rate,
}

/// Number of bins of the reliability diagram.
const BINS: usize = 10;

/// Returns the Brier score of statements: the mean of (stated - outcome)^2. `None` without statements.
pub fn brier(statements: &[(f64, bool)]) -> Option<f64> {
    let sum: f64 = statements.iter().map(|(p, hit)| (p - f64::from(*hit)).powi(2)).sum();
    (!statements.is_empty()).then(|| sum / statements.len() as f64)
}

/// Returns the logarithmic loss of statements: the mean of -ln of the probability of what came true. `None` without
/// statements.
pub fn log_loss(statements: &[(f64, bool)]) -> Option<f64> {
    let sum: f64 = statements.iter().map(|(p, hit)| -if *hit { p.ln() } else { (-p).ln_1p() }).sum();
    (!statements.is_empty()).then(|| sum / statements.len() as f64)
}

/// Returns the area under the receiver operating characteristic: the probability that a true statement has a higher
/// probability than a false one, where a tie counts half. `None` unless there are both.
pub fn auc(statements: &[(f64, bool)]) -> Option<f64> {
    let of = |kind: bool| statements.iter().filter(move |(_, hit)| *hit == kind).map(|(p, _)| *p);
    let pairs = of(true).count() * of(false).count();
    let won = |p: f64, q: f64| if p > q { 1.0 } else { f64::from(p == q) / 2.0 };
    let sum: f64 = of(true).map(|p| of(false).map(|q| won(p, q)).sum::<f64>()).sum();
    (pairs > 0).then(|| sum / pairs as f64)
}

/// Computes the calibration of statements, each given as its probability and whether it was true.
pub fn calibration(statements: &[(f64, bool)]) -> Calibration {
    let of = statements.len();
    let mean = |sum: f64| (of > 0).then(|| sum / of as f64);
    let brier = brier(statements);
    let bins: Vec<Bin> = (0..BINS)
        .filter_map(|bin| {
            let inside = |p: f64| ((p * BINS as f64) as usize).min(BINS - 1) == bin;
            let here: Vec<&(f64, bool)> = statements.iter().filter(|(p, _)| inside(*p)).collect();
            let stated = here.iter().map(|(p, _)| p).sum::<f64>() / here.len() as f64;
            (!here.is_empty()).then(|| Bin { stated, came_true: Rate::of(here.iter().map(|(_, hit)| *hit)) })
        })
        .collect();
    let off = |bin: &Bin| bin.came_true.of as f64 * (bin.stated - bin.came_true.share.unwrap_or(0.0)).abs();
    let expected_error = mean(bins.iter().map(off).sum());
    Calibration { of, brier, expected_error, bins }
}

/// Returns the expected calibration error that chance alone gives for as many statements with exactly right
/// probabilities. The number of true statements in each bin is taken as normal. `None` without statements.
pub fn error_by_chance(stated: &[f64]) -> Option<f64> {
    let variances = stated.iter().fold([0.0; BINS], |mut variances, p| {
        variances[((p * BINS as f64) as usize).min(BINS - 1)] += p * (1.0 - p);
        variances
    });
    // The mean distance of a normal variable from its mean is the square root of 2 / pi standard deviations.
    let distances: f64 = variances.iter().map(|variance| (variance * std::f64::consts::FRAC_2_PI).sqrt()).sum();
    (!stated.is_empty()).then(|| distances / stated.len() as f64)
}

#[cfg(test)]
mod tests {
    use approx::assert_relative_eq;

    use super::*;

    /// Some ends have closed forms: 1 - (alpha/2)^(1/n) for no hits, and (alpha/2)^(1/n) for all hits. Others are in
    /// the tables of Clopper and Pearson (5 of 10: 0.187 to 0.813; 1 of 10: 0.0025 to 0.445; 7 of 20: 0.154 to 0.592).
    #[test]
    fn intervals_are_those_of_the_tables() {
        for n in [1, 7, 200] {
            assert_relative_eq!(clopper_pearson(0, n)[1], 1.0 - 0.025f64.powf(1.0 / n as f64), epsilon = 1e-9);
            assert_relative_eq!(clopper_pearson(n, n)[0], 0.025f64.powf(1.0 / n as f64), epsilon = 1e-9);
        }
        for (k, n, low, high) in [(5, 10, 0.1871, 0.8129), (1, 10, 0.0025, 0.4450), (7, 20, 0.1539, 0.5922)] {
            let [a, b] = clopper_pearson(k, n);
            assert!((a - low).abs() < 6e-5 && (b - high).abs() < 6e-5, "{k} of {n}: {a} to {b}");
        }
        assert_eq!(Rate::new(0, 0).ci95, None);
    }

    /// The defining property: at the upper end, as few hits or fewer are a 2.5 % event; at the lower end, as many or
    /// more are.
    #[test]
    fn ends_leave_a_fortieth_each() {
        let tail = |k: usize, n: usize, p: f64| {
            let choose = |k: usize| (0..k).map(|i| (n - i) as f64 / (i + 1) as f64).product::<f64>();
            (0..=k).map(|j| choose(j) * p.powi(j as i32) * (1.0 - p).powi((n - j) as i32)).sum::<f64>()
        };
        for (k, n) in [(3, 12), (11, 40), (1, 5)] {
            let [low, high] = clopper_pearson(k, n);
            assert_relative_eq!(tail(k, n, high), 0.025, epsilon = 1e-9);
            assert_relative_eq!(1.0 - tail(k - 1, n, low), 0.025, epsilon = 1e-9);
        }
    }

    #[test]
    fn pairs_by_hand() {
        // Two of 2^5 sequences are all heads or all tails; another ten have exactly one that differs.
        assert_relative_eq!(sign_test(5, 0), 2.0 / 32.0, epsilon = 1e-12);
        assert_relative_eq!(sign_test(1, 4), 12.0 / 32.0, epsilon = 1e-12);
        assert_eq!((sign_test(0, 0), sign_test(3, 3)), (1.0, 1.0));
        // 2^2000 overflows. With the continuity correction, 50 more than half of 2000 are 99 / sqrt(2000) standard
        // deviations.
        assert_eq!(sign_test(1000, 1000), 1.0);
        let deviations = 99.0 / 2000f64.sqrt();
        let normal = statrs::function::erf::erfc(deviations / 2f64.sqrt());
        assert_relative_eq!(sign_test(950, 1050), normal, max_relative = 2e-3);
        assert!(sign_test(2000, 0) < 1e-300);
        // If nothing changed in n cases, each share is below 1 - 0.0125^(1/n).
        let bound = 1.0 - 0.0125f64.powf(1.0 / 16.0);
        let [low, high] = paired(0, 0, 16);
        assert_relative_eq!(high, bound, epsilon = 1e-9);
        assert_relative_eq!(low, -bound, epsilon = 1e-9);
        let [low, high] = paired(9, 1, 20);
        // By bisection of the binomial distribution: at 0.20692, nine or more of 20 are a 1.25 % event; at 0.27932,
        // one or fewer are.
        assert_relative_eq!(low, 0.20692 - 0.27932, epsilon = 1e-4);
        assert!(0.4 < high && high < 0.8, "{high}");
    }

    /// The share of true statements among n with probability 1/2 has the standard deviation 1 / (2 root n), and that
    /// among certain statements has none.
    #[test]
    fn chance_alone_makes_an_error() {
        let half = error_by_chance(&[0.5; 100]).unwrap();
        assert_relative_eq!(half, (2.0 / std::f64::consts::PI).sqrt() / 20.0, epsilon = 1e-12);
        assert_eq!(error_by_chance(&[1.0; 10]), Some(0.0));
        assert_eq!(error_by_chance(&[]), None);
    }

    #[test]
    fn calibration_by_hand() {
        let found = calibration(&[(0.9, true), (0.94, false), (0.2, false), (1.0, true)]);
        // (0.01 + 0.8836 + 0.04 + 0) / 4
        assert_relative_eq!(found.brier.unwrap(), 0.2334, epsilon = 1e-12);
        // The last bin holds three statements: stated 0.94667, true 2/3. The third bin holds one: stated 0.2, true 0.
        assert_relative_eq!(
            found.expected_error.unwrap(),
            (3.0 * (2.84 / 3.0 - 2.0 / 3.0) + 0.2) / 4.0,
            epsilon = 1e-12
        );
        assert_eq!(found.bins.iter().map(|b| b.came_true.of).collect::<Vec<_>>(), [1, 3]);
        assert_eq!(calibration(&[]).brier, None);
    }

    /// Of the four pairs of a true and a false statement, two are in order, one is a tie and one is reversed.
    #[test]
    fn scores_of_probabilities_by_hand() {
        let stated = [(0.9, true), (0.4, true), (0.4, false), (0.7, false)];
        assert_relative_eq!(auc(&stated).unwrap(), 2.5 / 4.0, epsilon = 1e-12);
        assert_relative_eq!(brier(&stated).unwrap(), (0.01 + 0.36 + 0.16 + 0.49) / 4.0, epsilon = 1e-12);
        let loss = -(0.9_f64.ln() + 0.4_f64.ln() + 0.6_f64.ln() + 0.3_f64.ln()) / 4.0;
        assert_relative_eq!(log_loss(&stated).unwrap(), loss, epsilon = 1e-12);
        assert_eq!((auc(&[(0.9, true), (0.2, false)]), auc(&[(0.2, true), (0.9, false)])), (Some(1.0), Some(0.0)));
        assert_eq!((auc(&stated[..2]), brier(&[]), log_loss(&[])), (None, None, None));
    }

    #[test]
    fn the_middle_and_the_lowest_tenth() {
        let values: Vec<f64> = (0..20).rev().map(f64::from).collect();
        assert_eq!((median(&values), lowest_tenth(&values)), (Some(9.5), Some(2.0)));
        assert_eq!((median(&[]), median(&[3.0])), (None, Some(3.0)));
    }
}
