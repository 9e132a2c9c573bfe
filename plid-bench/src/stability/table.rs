//! The table of a stability study for a terminal.

use std::fmt::Write;

use super::classify::Judged;
use super::outcome::Outcome;
use crate::speed::word;

impl Outcome {
    /// Returns the cells as a table: definiteness of P, and the relative errors of P and of the estimate, in standard
    /// deviations, against double-double after the stated number of steps.
    pub fn table(&self) -> String {
        let mut text = format!(
            "{:<12} {:<6} {:>3}  {:<26} {:>8} {:>12} {:>14}\n",
            "form", "scalar", "n", "positive definite", "step", "error of P", "error of s / std"
        );
        let mut cells: Vec<&Judged> = self.cells.iter().collect();
        cells.sort_by_key(|judged| (judged.cell.form, word(&judged.cell.scalar), judged.cell.group.states));
        for judged in cells {
            text += &row(judged);
        }
        text
    }
}

fn row(judged: &Judged) -> String {
    let cell = &judged.cell;
    let definite = match judged.lost_at {
        Some(step) => format!("lost by step {step}"),
        None => format!("for {} steps", cell.done),
    };
    let mut text =
        format!("{:<12} {:<6} {:>3}  {definite:<26}", cell.form.as_str(), word(&cell.scalar), cell.group.states);
    // Errors are compared at 1, 3, 10, 30 ... steps, as long as both the cell and the reference continue.
    let _ = match cell.errors.last() {
        Some(error) => {
            let covariance = error.covariance.map_or("not finite".to_string(), |error| format!("{error:.1e}"));
            writeln!(text, " {:>8} {covariance:>12} {:>14}", error.step, format!("{:.1e}", error.deviations))
        }
        None => writeln!(text, " {:>8} {:>12} {:>14}", "-", "-", "-"),
    };
    text
}
