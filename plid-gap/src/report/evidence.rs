//! The fourth section: the evidence.

use plid_report::{Bar, Bars, Report, bars};

use super::evidence_figures;
use super::response::Responses;
use super::words::{at, percent, with};
use crate::case::Case;
use crate::diagnose::Outcome;
use crate::words::gain_cell;

/// Number of entries of the screen that are drawn.
const SHOWN: usize = 8;

/// Adds the section.
pub(super) fn section(report: Report, outcome: &Outcome, case: &Case) -> Report {
    let mut report = report.heading("4. The evidence");
    for sentence in &outcome.diagnosis.evidence {
        report = report.paragraph(sentence);
    }
    report = match Responses::new(outcome, case) {
        Some(responses) => {
            let report = report
                .figure(
                    responses.by_level(),
                    format!(
                        "Frequency response at each level, for the pair ({}) and the band in which measured and \
                        simulated differ most. Left: measured. Right: simulated with the same inputs, {}. 0 dB is one \
                        unit of the output for one of the input. {}.",
                        responses.pair(),
                        with(outcome),
                        responses.how()
                    ),
                )
                .figure(
                    responses.change(outcome),
                    "These responses relative to those of the simulation as given, at the same level. Where the broad \
                    lines diverge, the structure's response depends on the level; where the dashed lines follow them, \
                    the simulation with its effects has the same dependence.",
                );
            match responses.all_pairs(outcome, case) {
                Some(svg) => report.details("All pairs at the highest level", |report| {
                    report.figure(
                        svg,
                        "Columns are inputs, rows are outputs; the strip above each plot shows the coherence.",
                    )
                }),
                None => report,
            }
        }
        None => report
            .paragraph("No record in which all inputs are excited is long enough to estimate a frequency response."),
    };
    report = evidence_figures::section(report, outcome);
    match screen(outcome) {
        Some(svg) => report.figure(
            svg,
            "First screen: reduction of the sum of squares of the whitened residual (twice the gain in log likelihood) \
            by each effect alone, before any fit, and the share of its response that a linear refit would absorb. \
            Effects in the answer are dark.",
        ),
        None => report.paragraph("No effect in the screen explains any of the residual after the bounded refit."),
    }
}

fn screen(outcome: &Outcome) -> Option<String> {
    let entries = outcome.shown.stages.first()?;
    let rows: Vec<Bar> = entries
        .iter()
        .filter(|(_, _, gain, _)| *gain > 0.0)
        .take(SHOWN)
        .map(|(effect, location, gain, absorbed)| Bar {
            name: at(effect, location),
            value: *gain,
            text: format!("{} (refit {})", gain_cell(*gain), percent(*absorbed)),
            interval: None,
            strong: outcome.diagnosis.effects.iter().any(|e| e.effect == *effect && e.location == *location),
        })
        .collect();
    let plot = Bars { bars: rows, label: "reduction of the sum of squares".into(), reference: None };
    (!plot.bars.is_empty()).then(|| bars(&plot))
}
