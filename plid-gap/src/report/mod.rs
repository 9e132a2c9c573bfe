//! The report of a diagnosis, report.html: the verdict in a sentence, four sections with figures (the gap before and
//! after, its location, what remains, the evidence), then the details.

mod details;
mod evidence;
mod evidence_figures;
mod hidden;
mod response;
mod shape;
mod shrink;
#[cfg(test)]
mod tests;
pub(crate) mod traces;
pub(crate) mod whereabouts;
mod words;
mod write;

use plid_data::config::to_toml;
use plid_report::Report;

use crate::case::Case;
use crate::diagnose::Outcome;

pub use write::write;
pub(crate) use write::write_answer;

/// Colour of measured outputs, which are drawn as broad lines behind the others.
const MEASURED: &str = "#8f8f8f";
/// Colour of the simulation as given.
const GIVEN: &str = "#e69f00";
/// Colour of the simulation with its effects.
const WITH: &str = "#0072b2";
/// Colour of noise and limits.
const REFERENCE: &str = "#d55e00";

/// Builds the page.
pub fn page(outcome: &Outcome, case: &Case) -> Report {
    let mut report = Report::new("The gap between the simulation and the records").verdict(&outcome.diagnosis.sentence);
    for change in outcome.diagnosis.effects.iter().filter_map(|effect| effect.change.as_ref()) {
        report = report.verdict(format!("In the simulation: {change}."));
    }
    for sentence in shrink::sentences(outcome).into_iter().chain(hidden::sentence(outcome)) {
        report = report.verdict(sentence);
    }
    report = report.warnings(&outcome.diagnosis.warnings).advice(&outcome.diagnosis.next_experiment);
    report = shrink::section(report, outcome);
    report = whereabouts::section(report, outcome);
    report = shape::figures(report, outcome);
    report = whereabouts::remains(report, outcome);
    report = evidence::section(report, outcome, case);
    report = details::section(report, outcome, case);
    report
        .listing(
            "The case, with all default values. As case.toml in the folder of the records, it gives this report:",
            to_toml(&case.config),
        )
        .listing("The commands:", COMMANDS)
        .provenance("plid", env!("CARGO_PKG_VERSION"))
}

const COMMANDS: &str = "plid gap diagnose case.toml --out DIR\n\
                        plid gap predict --diagnosis DIR/diagnosis.json --input u.csv --out y.csv";
