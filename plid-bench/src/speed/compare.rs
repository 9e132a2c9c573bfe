//! The changes in speed since an earlier run, in times relative to passes over P in the same run.

use std::path::Path;

use serde::Serialize;

use super::outcome::{Outcome, Timing};
use crate::study::StudyError;

/// Changes smaller than this are not reported, even if they are significant.
pub const TOLERANCE: f64 = 0.10;
/// The smallest change that counts, in standard errors.
const ERRORS: f64 = 3.0;
/// Ratio of the standard error of a median to that of a mean, for normal scatter.
const MEDIAN: f64 = 1.2533;

/// The comparison of an earlier run with a new one.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Comparison {
    /// Cells that take longer, the worst first.
    pub slower: Vec<Change>,
    /// Cells that take less time, the best first.
    pub faster: Vec<Change>,
    /// The number of cells that both runs have.
    pub compared: usize,
    /// The number of cells that only one of them has.
    pub unmatched: usize,
    /// Whether CPU and compiler are the same.
    pub same_machine: bool,
}

/// A cell whose time has changed.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Change {
    /// The cell's name.
    pub key: String,
    /// Earlier time in passes over P.
    pub old_passes: f64,
    /// New time in passes over P.
    pub new_passes: f64,
    /// The factor from old to new.
    pub factor: f64,
    /// The factor beyond which a change counts for this cell, by the tolerance and the scatter of both runs' rounds.
    pub threshold: f64,
}

/// Reads the speed.json of an earlier run.
///
/// # Errors
/// Returns an error for a file that cannot be read or is not a speed.json.
pub fn read(path: &Path) -> Result<Outcome, StudyError> {
    let text = std::fs::read_to_string(path).map_err(StudyError::file(path))?;
    serde_json::from_str(&text).map_err(|error| StudyError::Content {
        path: path.into(),
        line: error.line(),
        reason: format!("not the speed.json of this version's study: {error}"),
    })
}

/// Compares `new` with `old`. A change counts if it exceeds `tolerance` (0.1 for 10 %) and three standard errors of the
/// two medians, estimated from the scatter of the rounds.
pub fn compare(old: &Outcome, new: &Outcome, tolerance: f64) -> Comparison {
    let pairs: Vec<(&Timing, &Timing)> = new
        .timings
        .iter()
        .filter_map(|timing| Some((old.timings.iter().find(|old| old.key == timing.key)?, timing)))
        .collect();
    let changes: Vec<Change> = pairs.iter().map(|(old, new)| change(old, new, tolerance)).collect();
    let beyond = |far: fn(&Change) -> bool| {
        let mut found: Vec<Change> = changes.iter().filter(|change| far(change)).cloned().collect();
        found.sort_by(|a, b| b.factor.ln().abs().total_cmp(&a.factor.ln().abs()));
        found
    };
    Comparison {
        slower: beyond(|change| change.factor > change.threshold),
        faster: beyond(|change| change.factor < 1.0 / change.threshold),
        compared: pairs.len(),
        unmatched: old.timings.len() + new.timings.len() - 2 * pairs.len(),
        same_machine: old.machine.cpu == new.machine.cpu && old.machine.rustc == new.machine.rustc,
    }
}

fn change(old: &Timing, new: &Timing, tolerance: f64) -> Change {
    let error = ERRORS * (variance(&old.pass_ratios) + variance(&new.pass_ratios)).sqrt();
    Change {
        key: new.key.clone(),
        old_passes: old.passes,
        new_passes: new.passes,
        factor: new.passes / old.passes,
        threshold: (1.0 + tolerance).max(error.exp()),
    }
}

/// Returns the variance of the median of the logarithms, or 0 for a single round, whose scatter is unknown.
fn variance(ratios: &[f64]) -> f64 {
    let count = ratios.len() as f64;
    if ratios.len() < 2 {
        return 0.0;
    }
    let mean = ratios.iter().map(|ratio| ratio.ln()).sum::<f64>() / count;
    let squares: f64 = ratios.iter().map(|ratio| (ratio.ln() - mean).powi(2)).sum();
    MEDIAN * MEDIAN * squares / ((count - 1.0) * count)
}

impl Comparison {
    /// Returns the comparison in words for a terminal.
    pub fn text(&self) -> String {
        let mut text = String::new();
        for (name, changes) in [("slower", &self.slower), ("faster", &self.faster)] {
            if !changes.is_empty() {
                text += &format!("{name} (passes over P: then, now, factor; factor that counts):\n");
            }
            for Change { key, old_passes, new_passes, factor, threshold } in changes {
                text += &format!("  {old_passes:8.2} {new_passes:8.2} {factor:6.2} ({threshold:.2})  {key}\n");
            }
        }
        text +=
            &format!("{} cells compared: {} slower, {} faster\n", self.compared, self.slower.len(), self.faster.len());
        if self.unmatched > 0 {
            text += &format!("{} cells occur in only one of the two runs\n", self.unmatched);
        }
        if !self.same_machine {
            text += "the runs are from different machines or compilers; \
                     ratios to the pass compensate for only part of the difference\n";
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use plid_catalogue::{CovarianceName, ExpectationName};

    use super::*;
    use crate::speed::outcome::testing::{outcome, timing};

    fn run(ratios: &[(usize, &[f64])]) -> Outcome {
        let one = |&(states, ratios): &(usize, &[f64])| {
            timing(states, CovarianceName::Direct, ExpectationName::Prior, 10.0, ratios)
        };
        outcome(ratios.iter().map(one).collect())
    }

    #[test]
    fn what_is_slower_beyond_tolerance_and_scatter_is_listed_the_worst_first() {
        let old = run(&[(12, &[2.0, 2.01, 1.99]), (18, &[2.0]), (24, &[2.0, 2.6, 1.6]), (30, &[2.0]), (36, &[1.0])]);
        let new = run(&[
            (12, &[2.3, 2.29, 2.31]), // 15 % slower, and sure
            (18, &[3.0]),             // half slower
            (24, &[2.3, 1.7, 2.9]),   // within the scatter
            (30, &[1.5]),             // faster
            (48, &[1.0]),             // not in the other
        ]);
        let found = compare(&old, &new, TOLERANCE);
        let keys = |changes: &[Change]| changes.iter().map(|c| c.key[..4].to_string()).collect::<Vec<_>>();
        assert_eq!(keys(&found.slower), ["n=18", "n=12"]);
        assert_eq!(keys(&found.faster), ["n=30"]);
        assert_eq!((found.compared, found.unmatched, found.same_machine), (4, 2, true));
        let text = found.text();
        assert!(text.contains("2.00     3.00   1.50 (1.10)  n=18") && text.contains("2 slower, 1 faster"), "{text}");
        assert!(compare(&old, &new, 0.6).slower.is_empty());
        assert!(compare(&new, &new, 0.0).slower.is_empty());
    }

    #[test]
    fn another_machine_is_said() {
        let (old, mut new) = (run(&[]), run(&[]));
        new.machine.cpu = "another".into();
        assert!(compare(&old, &new, TOLERANCE).text().contains("different machines"));
    }

    #[test]
    fn a_file_that_is_none_is_named_with_its_line() {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), "{\n\"machine\": 3\n}").unwrap();
        let message = read(file.path()).unwrap_err().to_string();
        assert!(message.contains("line 2") && message.contains("speed.json"), "{message}");
    }
}
