//! Whether the runs share what they should share.

use nalgebra::{DMatrix, DVector};
use serde::Serialize;
use statrs::distribution::{ChiSquared, ContinuousCDF, FisherSnedecor};

use super::MergeError;
use super::combine::{common_prior, solve};
use super::knowledge::{Knowledge, Rows};

/// A run beside all the others together.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Departure {
    /// The run.
    pub run: String,
    /// (its estimate - that of the others) over the covariance of this difference: chi-square with `directions` degrees of freedom if all is as assumed.
    pub chi_square: f64,
    /// Directions of which both sides, or one of them, know something.
    pub directions: usize,
    /// Degrees of freedom as the spread of the chi-square over the directions shows them; fewer where a few directions make most of it.
    pub effective: f64,
    /// The other runs' own disagreement, chi-square over degrees of freedom, at least 1; `None` with two runs.
    pub overdispersion: Option<f64>,
    /// Chi-square over `directions` and over `overdispersion`: about 1 for a run that fits.
    pub quotient: f64,
    /// The chance of a departure as large as this or larger if the run shares its parameters with the others.
    pub p_value: f64,
}

impl Departure {
    /// Chi-square over its degrees of freedom.
    pub fn ratio(&self) -> f64 {
        self.chi_square / self.directions.max(1) as f64
    }
}

/// What the test says.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Agreement {
    /// The runs share their parameters.
    Agree,
    /// This run does not fit the others.
    Departs {
        /// The run.
        run: String,
    },
    /// Two runs disagree by more than their covariances allow, and there is no third to tell a lack of order from another plant.
    Open,
    /// There is one run only.
    Alone,
}

/// The test and what led to its verdict.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Consistency {
    /// The verdict.
    pub agreement: Agreement,
    /// Every run beside the others, in the order of the runs.
    pub departures: Vec<Departure>,
    /// Chi-square over degrees of freedom, over all runs.
    pub overdispersion: f64,
}

/// The chance of calling a run wrong that is right, over all runs together.
pub const LEVEL: f64 = 0.01;
/// How alike the overdispersion of valid runs is, as degrees of freedom: of what a reduced order leaves out each input shows another part. The logarithms of the
/// quotients of 18 valid runs of the simulated truss (six seeds, docs/merge.md) have the variance 0.16, as with 24 on both sides; 10 leaves room for other plants.
const ALIKE: f64 = 10.0;

/// Tests whether the runs agree on the parameters that they share (those of which at least two have a place).
///
/// Each run is put beside the combination of all others. If theta is drawn from the prior and both posterior covariances, P of the run and
/// Q of the others, are right, then in units of the prior's deviations the difference of the two estimates has the covariance
/// P + Q - P Q - Q P: the prior that both contain is in neither part of it twice. Where a model is smaller than the plant this
/// chi-square grows with the length of the records also for valid runs, and does so for all of them. It is therefore divided by the same figure of the
/// other runs among themselves, and the quotient is held against Fisher's distribution; the more of it is overdispersion, the fewer its degrees of freedom.
///
/// # Errors
/// As [`super::combine()`].
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

/// Chi-square over degrees of freedom of several departures together.
fn pooled(departures: &[Departure]) -> f64 {
    let sum: f64 = departures.iter().map(|d| d.chi_square).sum();
    sum / departures.iter().map(|d| d.directions).sum::<usize>().max(1) as f64
}

fn tail_chi_square(departure: &Departure) -> f64 {
    // Satterthwaite: the ratio is that of a chi-square with fewer degrees of freedom.
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
    /// Each run of `set` beside the rest of it.
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
        // What neither side knows has no variance left; nor has what is known to all digits.
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
        // Of Gaussians of one variance the expected fourth moment is three; more says that few directions matter.
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

    /// Estimate and covariance of the places `shared` by the runs `set`, in units of the prior's deviations.
    fn marginal(&self, set: &[usize], shared: &[usize]) -> (DVector<f64>, DMatrix<f64>) {
        let pieces: Vec<(&Knowledge, &Rows)> = set.iter().map(|&j| (&self.runs[j], &self.data[j])).collect();
        // What no run of the set has needs no column: the prior says nothing of it to the others.
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
