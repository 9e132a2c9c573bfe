//! The leading part of the records, on which the search ranks effects with quick fits.

use crate::fit::free_run::errors;
use crate::fit::problem::Problem;
use crate::fit::refit::Refit;

/// Returns the number of samples of each record that the quick fits use: `first_samples`, or more if the refit fits
/// the first samples of a driven record much better than its remainder. A stop that is reached late, or a chirp that
/// reaches a resonance late, leaves no trace before. If the refit fits the records no better than the simulation as
/// given, the errors of this simulation count, too: a refit to a record with a stop may fit no part of it.
pub fn leading(problem: &Problem, refitted: &Refit) -> usize {
    let settings = &problem.settings.search;
    if problem.records.iter().all(|record| record.samples() <= settings.first_samples) {
        return settings.first_samples;
    }
    let errors_of = |eta: &[f64]| -> Vec<Vec<f64>> {
        let errors = problem.records.iter().zip(errors(problem, eta, &[]));
        errors.filter(|(record, _)| record.is_driven()).flat_map(|(_, errors)| errors).collect()
    };
    let of_refit = errors_of(&refitted.eta);
    let as_given = errors_of(&problem.nuisance.as_given(&refitted.eta));
    let is_no_better = of_refit.iter().zip(&as_given).map(|(refit, given)| power(refit) / power(given)).sum::<f64>()
        >= of_refit.len() as f64;
    let all = of_refit.iter().chain(as_given.iter().filter(|_| is_no_better));
    let until = all.map(|error| until_typical(error, settings.first_samples, settings.first_share));
    until.fold(settings.first_samples, usize::max)
}

/// Returns the sum of squares. A missing sample counts as zero.
fn power(error: &[f64]) -> f64 {
    error.iter().filter(|e| e.is_finite()).map(|e| e * e).sum()
}

/// Returns the smallest number of samples, but at least `first`, whose mean square is at least this share of that of
/// the whole error. A missing sample counts as zero.
fn until_typical(error: &[f64], first: usize, share: f64) -> usize {
    let least = share * power(error) / error.len().max(1) as f64;
    let mut sum = 0.0;
    let typical = |(k, e): (usize, &f64)| {
        sum += power(std::slice::from_ref(e));
        (k + 1 >= first && sum >= least * (k + 1) as f64).then_some(k + 1)
    };
    error.iter().enumerate().find_map(typical).unwrap_or(error.len())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_leading_part_reaches_what_happens_late() {
        let late: Vec<f64> = (0..1000).map(|k| if k < 700 { 0.01 } else { 1.0 }).collect();
        let at = until_typical(&late, 100, 0.1);
        assert!((710..800).contains(&at), "{at}");
        assert_eq!(until_typical(&[0.5; 1000], 100, 0.1), 100);
        // The error grows as a drift does: its first third has a ninth of the mean square of the whole.
        let drift: Vec<f64> = (0..1000).map(|k| k as f64).collect();
        assert_eq!(until_typical(&drift, 334, 0.1), 334);
        let missing: Vec<f64> = (0..1000).map(|k| if k < 900 { f64::NAN } else { 1.0 }).collect();
        assert!((900..920).contains(&until_typical(&missing, 100, 0.1)));
        assert_eq!(until_typical(&[1.0; 50], 100, 0.1), 50);
    }
}
