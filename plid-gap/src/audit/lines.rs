//! The frequencies of periodic inputs, which limit what a model of the records can be.

use std::collections::BTreeSet;

use crate::case::record::{Excitation, Record};
use crate::signal::lines::driven;

/// Returns the number of frequencies that periodic inputs hold, if they are too few to determine a model of this number
/// of states. A frequency determines two numbers for each input and output, and a model has at least as many parameters
/// as states for each of them (persistent excitation: L. Ljung, System Identification, 1999, section 13.2). Returns
/// `None` if the frequencies suffice, or if an input does not repeat. `driven_line` is the setting.
pub fn too_few(records: &[Record], states: usize, driven_line: f64) -> Option<usize> {
    let mut lines = BTreeSet::new();
    let (mut m, mut p) = (0, 0);
    for record in records.iter().filter(|record| record.is_driven()) {
        let Excitation::Periodic(period) = record.excitation else { return None };
        (m, p) = (record.u.len(), record.y.len());
        let driven = driven(&record.u, period, driven_line);
        // In turns per sample, so that records of other periods can be compared.
        let turns = |k: usize| (k as f64 / period as f64 * 1e9).round() as u64;
        lines.extend((0..driven.len()).filter(|&k| driven[k]).map(turns));
    }
    (!lines.is_empty() && 2 * lines.len() * m * p < states * (m + p)).then_some(lines.len())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing;
    use std::f64::consts::TAU;

    /// One sine determines a model of one state, two a model of two states, and random inputs any model.
    #[test]
    fn a_model_needs_as_many_frequencies_as_states() {
        let few = |records: &[Record], states: usize| too_few(records, states, 1e-3);
        let record = |cycles: &[f64]| {
            let sine = |k: usize| cycles.iter().map(|c| (TAU * c * k as f64 / 100.0).sin()).sum::<f64>();
            let u: Vec<f64> = (0..400).map(sine).collect();
            Record { excitation: Excitation::Periodic(100), ..testing::record(vec![u.clone()], vec![u]) }
        };
        assert_eq!(few(&[record(&[3.0])], 1), None);
        assert_eq!(few(&[record(&[3.0])], 2), Some(1));
        assert_eq!(few(&[record(&[3.0]), record(&[3.0])], 2), Some(1));
        assert_eq!(few(&[record(&[3.0]), record(&[5.0])], 2), None);
        assert_eq!(few(&[record(&[3.0, 7.0])], 3), Some(2));
        let random = testing::random_input(1, 400, 1);
        assert_eq!(few(&[record(&[3.0]), testing::record(random.clone(), random)], 30), None);
    }
}
