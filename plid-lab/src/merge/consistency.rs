//! The test of whether the runs share the parameters that they should share.

use nalgebra::{DMatrix, DVector};
use serde::Serialize;
use statrs::distribution::{ChiSquared, ContinuousCDF, FisherSnedecor};

use super::MergeError;
use super::combine::{common_prior, solve};
use super::knowledge::{Knowledge, Rows};

/// The comparison of one run with all others together.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Departure {
    /// The run.
    pub run: String,
    /// The squared difference between its estimate and that of the others, weighted by the inverse covariance of the
    /// difference. Under the null hypothesis it has a chi-square distribution with `directions` degrees of freedom.
    pub chi_square: f64,
    /// Number of directions about which at least one side has information.
    pub directions: usize,
    /// Effective degrees of freedom according to the spread of the chi-square over the directions; smaller than
    /// `directions` if a few of them dominate.
    pub effective: f64,
    /// Chi-square of the other runs among themselves over its degrees of freedom, at least 1; `None` with two runs.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub overdispersion: Option<f64>,
    /// Chi-square divided by `directions` and by `overdispersion`: about 1 for a consistent run.
    pub quotient: f64,
    /// Probability of a larger quotient if the run shares its parameters with the others.
    pub p_value: f64,
}

impl Departure {
    /// Returns chi-square over its degrees of freedom.
    pub fn ratio(&self) -> f64 {
        self.chi_square / self.directions.max(1) as f64
    }
}

/// The verdict of the consistency test.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Agreement {
    /// The runs share their parameters.
    Agree,
    /// One run is inconsistent with the others.
    Departs {
        /// The inconsistent run.
        run: String,
    },
    /// Two runs disagree by more than their covariances allow. Without a third run the test cannot distinguish an
    /// insufficient order from different plants.
    Open,
    /// There is only one run.
    Alone,
}

/// The result of the consistency test.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Consistency {
    /// The verdict.
    pub agreement: Agreement,
    /// The comparison of every run with the others, in the order of the runs.
    pub departures: Vec<Departure>,
    /// Chi-square over degrees of freedom, over all runs.
    pub overdispersion: f64,
}

/// Significance level of the test over all runs together.
pub const LEVEL: f64 = 0.01;
/// Degrees of freedom that describe how much the overdispersion varies between valid runs: each input reveals a
/// different part of the dynamics that a reduced order omits. The logarithms of the quotients of 18 valid runs of the
/// simulated truss (six seeds, docs/merge.md) have a variance of 0.16, which corresponds to 24 degrees of freedom on
/// both sides; 10 leaves a margin for other plants.
const ALIKE: f64 = 10.0;

/// Tests whether the runs agree on the parameters that at least two of them estimate.
///
/// Each run is compared with the combination of all others. If theta is drawn from the prior and both posterior
/// covariances are correct, P of the run and Q of the others, then in units of the prior's standard deviations the
/// difference of the two estimates has the covariance P + Q - P Q - Q P, which does not count the common prior twice.
/// If the model order is smaller than that of the plant, this chi-square grows with the length of the records for valid
/// runs as well, and for all of them alike. It is therefore divided by the same figure of the other runs among
/// themselves, and the quotient is compared with Fisher's F distribution, with fewer degrees of freedom the larger the
/// overdispersion.
///
/// # Errors
/// Returns the errors of [`super::combine()`].
pub fn consistency(runs: &[Knowledge], size: usize) -> Result<Consistency, MergeError> {
    let prior = common_prior(runs, size)?;
    let data = runs.iter().map(Knowledge::data).collect::<Result<Vec<_>, _>>()?;
    let all: Vec<usize> = (0..runs.len()).collect();
    if runs.len() < 2 {
        return Ok(Consistency { agreement: Agreement::Alone, departures: Vec::new(), overdispersion: 1.0 });
    }
    let test = Test { runs, data: &data, prior: &prior };
    let among_all = test.departures(&all);
    let mut departures = Vec::new();
    for (k, own) in among_all.iter().enumerate() {
        let others: Vec<usize> = all.iter().copied().filter(|&j| j != k).collect();
        let (overdispersion, p_value) = if others.len() < 2 {
            (None, tail_chi_square(own))
        } else {
            let among = test.departures(&others);
            let reference = pooled(&among).max(1.0);
            let freedom = among.iter().map(|d| d.effective).sum::<f64>() / among.len() as f64;
            let excess = (1.0 - 1.0 / reference).powi(2) / ALIKE;
            let fewer = |freedom: f64| 1.0 / (1.0 / freedom + excess);
            (Some(reference), tail_fisher(own.ratio() / reference, fewer(own.effective), fewer(freedom)))
        };
        let quotient = own.ratio() / overdispersion.unwrap_or(1.0);
        departures.push(Departure { overdispersion, quotient, p_value, ..own.clone() });
    }
    let worst = departures.iter().min_by(|a, b| a.p_value.total_cmp(&b.p_value).then(b.ratio().total_cmp(&a.ratio())));
    let agreement = match worst {
        Some(worst) if worst.p_value < LEVEL / runs.len() as f64 => match worst.overdispersion {
            Some(_) => Agreement::Departs { run: worst.run.clone() },
            None => Agreement::Open,
        },
        _ => Agreement::Agree,
    };
    let overdispersion = pooled(&departures);
    Ok(Consistency { agreement, departures, overdispersion })
}

/// Returns chi-square over degrees of freedom of several comparisons together.
fn pooled(departures: &[Departure]) -> f64 {
    let sum: f64 = departures.iter().map(|d| d.chi_square).sum();
    sum / departures.iter().map(|d| d.directions).sum::<usize>().max(1) as f64
}

fn tail_chi_square(departure: &Departure) -> f64 {
    // Satterthwaite's approximation: the ratio has the distribution of a chi-square with fewer degrees of freedom.
    let freedom = departure.effective;
    ChiSquared::new(freedom).map_or(1.0, |law| law.sf(departure.ratio() * freedom))
}

fn tail_fisher(ratio: f64, above: f64, below: f64) -> f64 {
    FisherSnedecor::new(above, below).map_or(1.0, |law| law.sf(ratio))
}

struct Test<'a> {
    runs: &'a [Knowledge],
    data: &'a [Rows],
    prior: &'a [f64],
}

impl Test<'_> {
    /// Compares each run of `set` with the others in it.
    fn departures(&self, set: &[usize]) -> Vec<Departure> {
        set.iter()
            .map(|&k| {
                let others: Vec<usize> = set.iter().copied().filter(|&j| j != k).collect();
                self.departure(k, &others)
            })
            .collect()
    }

    fn departure(&self, run: usize, others: &[usize]) -> Departure {
        let is_shared =
            |place: &usize| self.prior[*place] > 0.0 && others.iter().any(|&j| self.runs[j].places.contains(place));
        let shared: Vec<usize> = self.runs[run].places.iter().copied().filter(is_shared).collect();
        let (own, p) = self.marginal(&[run], &shared);
        let (theirs, q) = self.marginal(others, &shared);
        let product = &p * &q;
        let spread = (p + q - &product - product.transpose()).symmetric_eigen();
        let difference = own - theirs;
        // Directions without variance are excluded: those unknown to both sides and those known to all digits.
        let floor = 4.0 * shared.len() as f64 * f64::EPSILON;
        let squares: Vec<f64> = spread
            .eigenvalues
            .iter()
            .zip(spread.eigenvectors.column_iter())
            .filter(|(variance, _)| **variance > floor)
            .map(|(variance, direction)| direction.dot(&difference).powi(2) / variance)
            .collect();
        let chi_square: f64 = squares.iter().sum();
        let fourth: f64 = squares.iter().map(|x| x * x).sum();
        let directions = squares.len();
        // For Gaussian variables of equal variance the normalised fourth moment is three; a larger value means that few
        // directions dominate.
        let effective = if fourth > 0.0 { 3.0 * chi_square * chi_square / fourth } else { directions as f64 };
        Departure {
            run: self.runs[run].run.clone(),
            chi_square,
            directions,
            effective: effective.min(directions as f64),
            overdispersion: None,
            quotient: 1.0,
            p_value: 1.0,
        }
    }

    /// Returns estimate and covariance of the parameters `shared` by the runs `set`, in units of the prior's standard
    /// deviations.
    fn marginal(&self, set: &[usize], shared: &[usize]) -> (DVector<f64>, DMatrix<f64>) {
        let pieces: Vec<(&Knowledge, &Rows)> = set.iter().map(|&j| (&self.runs[j], &self.data[j])).collect();
        // Parameters that no run of the set estimates need no column, because the prior does not correlate them with
        // the others.
        let mut prior = vec![0.0; self.prior.len()];
        for (run, _) in &pieces {
            run.places.iter().for_each(|&place| prior[place] = self.prior[place]);
        }
        let (estimate, root) = solve(&pieces, &prior);
        let estimate = DVector::from_fn(shared.len(), |k, _| estimate[shared[k]]);
        let root = root.select_rows(shared);
        let covariance = &root * root.transpose();
        (estimate, covariance)
    }
}
