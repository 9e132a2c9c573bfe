//! Numbers in sentences and tables.

use plid_report::Cell;

/// Beyond this difference in log likelihood the odds exceed 10^400 : 1, and further digits mean nothing.
const OVERWHELMING: f64 = 1e3;

/// Formats a difference in log likelihood for a sentence.
pub(crate) fn likelihood(difference: f64) -> String {
    if difference.abs() > OVERWHELMING {
        "an overwhelming margin (odds beyond 10^300 : 1)".into()
    } else {
        format!("{difference:.0} in log likelihood")
    }
}

/// Formats a difference in log likelihood for a table, with one decimal.
pub(crate) fn likelihood_cell(difference: f64) -> Cell {
    if difference.abs() > OVERWHELMING { "overwhelming (> 10^300 : 1)".into() } else { Cell::fixed(difference, 1) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_large_likelihood_is_said_as_odds() {
        assert_eq!(likelihood(12.3), "12 in log likelihood");
        assert_eq!(likelihood_cell(-12.34).to_string(), "-12.3");
        for large in [8e25, -8e25] {
            assert!(likelihood(large).contains("10^300 : 1"));
            assert_eq!(likelihood_cell(large).to_string(), "overwhelming (> 10^300 : 1)");
        }
    }
}
