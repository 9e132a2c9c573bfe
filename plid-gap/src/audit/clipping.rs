//! Clipping: many samples at one and the same extreme value.

use crate::case::Case;
use crate::settings::AuditSettings;

/// Returns the findings, by channel and record.
pub fn check(case: &Case) -> Vec<String> {
    let mut found = Vec::new();
    let config = &case.config;
    for record in &case.records {
        let channels = config.inputs.iter().zip(&record.u).chain(config.outputs.iter().zip(&record.y));
        for (name, x) in channels {
            for (rail, count) in rails(x, &config.settings.audit) {
                found.push(format!(
                    "`{name}` clips at {rail} in {}: {count} samples lie on exactly that value ({:.2} %).",
                    record.name,
                    100.0 * count as f64 / x.len() as f64
                ));
            }
        }
    }
    found
}

/// Returns the lowest and the highest value with their numbers of samples, if the samples accumulate there.
fn rails(x: &[f64], settings: &AuditSettings) -> Vec<(f64, usize)> {
    let mut sorted: Vec<f64> = x.iter().copied().filter(|x| x.is_finite()).collect();
    sorted.sort_by(f64::total_cmp);
    let mut counts: Vec<(f64, usize)> = Vec::new();
    for x in sorted {
        match counts.last_mut() {
            Some((value, count)) if *value == x => *count += 1,
            _ => counts.push((x, 1)),
        }
    }
    if counts.len() < settings.clipped_values {
        return Vec::new();
    }
    let last = counts.len() - 1;
    let piles =
        |at: usize, next: usize| counts[at].1 >= settings.clipped_samples.max(settings.clipped_ratio * counts[next].1);
    let often = |at: usize| visits(x, counts[at].0) >= settings.clipped_visits;
    let clips = |&(at, next): &(usize, usize)| piles(at, next) && often(at);
    [(0, 1), (last, last - 1)].into_iter().filter(clips).map(|(at, _)| counts[at]).collect()
}

/// Returns the number of times that a channel reaches a value.
fn visits(x: &[f64], value: f64) -> usize {
    (0..x.len()).filter(|&k| x[k] == value && (k == 0 || x[k - 1] != value)).count()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{case, random_input, truss};

    const CODE: f64 = 1.0 / 512.0;

    fn codes(x: impl Iterator<Item = f64>) -> Vec<f64> {
        x.map(|x| (x / CODE).round() * CODE).collect()
    }

    #[test]
    fn a_rail_is_found_and_named() {
        let mut case = case(&truss(1), &truss(1));
        assert!(check(&case).is_empty());
        let y = &mut case.records[1].y[0];
        let size = crate::case::record::rms(y.iter());
        let rail = (2.0 * size / CODE).round() * CODE;
        *y = codes(y.iter().map(|y| y.min(rail)));
        let count = y.iter().filter(|y| **y == rail).count();
        let found = check(&case);
        assert_eq!(found.len(), 1, "{found:?}");
        assert!(found[0].contains(&format!("`y1` clips at {rail} in random-1: {count} samples")), "{}", found[0]);
    }

    #[test]
    fn sines_switches_quiet_and_noisy_limits_are_no_rails() {
        let sine = codes((0..8000).map(|k| (0.0371 * k as f64).sin()));
        assert!(rails(&sine, &AuditSettings::default()).is_empty());
        let switched: Vec<f64> = random_input(1, 4000, 1)[0].iter().map(|x| x.signum()).collect();
        assert!(rails(&switched, &AuditSettings::default()).is_empty());
        // A command that holds its largest value for a while visits it once.
        let held: Vec<f64> = (0..4000).map(|k| if k / 40 == 17 { 1.5 } else { (0.0371 * k as f64).sin() }).collect();
        assert!(rails(&held, &AuditSettings::default()).is_empty());
        let quiet = codes(random_input(2, 4000, 1)[0].iter().map(|x| 0.6 * CODE * x));
        assert!(rails(&quiet, &AuditSettings::default()).is_empty());
        // The samples of a sensor that saturates before its noise accumulate near a value, not on it.
        let (signal, noise) = (random_input(3, 4000, 1), random_input(4, 4000, 1));
        let saturated = codes(signal[0].iter().zip(&noise[0]).map(|(x, n)| x.min(1.5) + 0.01 * n));
        assert!(rails(&saturated, &AuditSettings::default()).is_empty());
    }
}
