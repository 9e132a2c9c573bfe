//! Numbers in sentences and tables.

use plid_report::Cell;

/// Beyond this difference in log likelihood the odds exceed 10^400 : 1, and further digits mean nothing.
const OVERWHELMING: f64 = 1e3;

/// Formats a band, "64 to 76 Hz", with as many digits as its width needs.
pub(crate) fn band(from: f64, to: f64) -> String {
    let digits = usize::from(to - from < 5.0) + usize::from(to - from < 0.5);
    format!("{from:.digits$} to {to:.digits$} Hz")
}

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

/// Formats a reduction of the sum of squares, which is twice a difference in log likelihood, for a line of progress.
pub(crate) fn gain(reduction: f64) -> String {
    if is_overwhelming(reduction) { "> 10^300 : 1".into() } else { format!("{reduction:.0}") }
}

/// Formats a reduction of the sum of squares for a table, with one decimal.
pub(crate) fn gain_cell(reduction: f64) -> Cell {
    if is_overwhelming(reduction) { likelihood_cell(reduction / 2.0) } else { Cell::fixed(reduction, 1) }
}

fn is_overwhelming(reduction: f64) -> bool {
    reduction.abs() / 2.0 > OVERWHELMING
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

    #[test]
    fn a_gain_is_twice_a_likelihood() {
        assert_eq!((gain(1999.4), gain_cell(1999.4).to_string()), ("1999".into(), "1999.4".into()));
        assert_eq!(gain(2001.0), "> 10^300 : 1");
        assert_eq!(gain_cell(2001.0).to_string(), "overwhelming (> 10^300 : 1)");
    }
}
