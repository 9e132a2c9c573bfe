//! The first section: the gap before and after.

use plid_report::{Bar, Bars, Report, bars};

use super::traces::{self, Traces};
use super::words::{held_out, kind, percent, records, unbroken, with, worst};
use crate::answer::statements::expected;
use crate::diagnose::Outcome;
use crate::judge::verdict::Verdict;

/// Returns the sentences below the verdict: the shrink of the gap, the gap that was predicted, and the gap to expect.
pub(super) fn sentences(outcome: &Outcome) -> Vec<String> {
    let gap = &outcome.diagnosis.gap;
    let on = gap.measured_on.join(", ");
    let kind = kind(outcome);
    let mut sentences = Vec::new();
    if outcome.diagnosis.verdict != Verdict::None {
        sentences.push(format!(
            "On {on} ({kind}) the gap is reduced by {} (95 % interval {} to {}) relative to the simulation as given, \
            and by {} relative to the bounded refit.",
            percent(gap.shrink),
            percent(gap.shrink_ci95[0]),
            percent(gap.shrink_ci95[1]),
            percent(gap.shrink_over_refit)
        ));
    }
    if held_out(outcome) {
        sentences.push(format!(
            "Gap on {on}: {} predicted from the fitted records, {} measured.",
            percent(gap.crossed_gap),
            percent(gap.with_effect)
        ));
    }
    sentences.push(unbroken(&expected(gap.predicted_held_out_gap, gap.predicted_ci80)));
    sentences
}

/// Returns the gap that remains after a shrink.
fn left(as_given: f64, floor: f64, shrink: f64) -> f64 {
    if as_given <= floor {
        return as_given;
    }
    let beyond = (as_given * as_given - floor * floor).sqrt() * (1.0 - shrink);
    (beyond * beyond + floor * floor).sqrt()
}

fn gap_bars(outcome: &Outcome) -> Bars {
    let gap = &outcome.diagnosis.gap;
    let of = |shrink: f64| left(gap.as_given, gap.noise_floor, shrink);
    let bar = |name: &str, value: f64| Bar {
        name: name.into(),
        value: 100.0 * value,
        text: percent(value),
        ..Bar::default()
    };
    let mut rows =
        vec![bar("as given", gap.as_given), bar("bounded refit", gap.refit), bar("free linear refit", gap.free_refit)];
    if outcome.diagnosis.verdict != Verdict::None {
        let reference = gap.reference();
        rows.extend(reference.map(|reference| bar("reference effect with the bounded refit", reference.gap)));
        let [low, high] = gap.shrink_ci95;
        let interval = Some((100.0 * of(high), 100.0 * of(low)));
        rows.push(Bar { interval, strong: true, ..bar(with(outcome), gap.with_effect) });
        if gap.share_of_ceiling > 0.0 {
            rows.push(bar("flexible ceiling model", of(gap.shrink / gap.share_of_ceiling)));
        }
    }
    Bars {
        bars: rows,
        label: "gap: RMS of the error over RMS of the output, %".into(),
        reference: Some((format!("noise alone, {}", percent(gap.noise_floor)), 100.0 * gap.noise_floor)),
    }
}

/// Adds the section.
pub(super) fn section(report: Report, outcome: &Outcome) -> Report {
    let gap = &outcome.diagnosis.gap;
    let worst = worst(outcome);
    let mut words = String::new();
    if outcome.diagnosis.verdict != Verdict::None {
        if gap.reference().is_some() {
            words += " The reference effect is a wrong effect with as many parameters.";
        }
        words += &format!(
            " The ceiling model has up to three more effects; the answer closes {} of the gap that the ceiling model \
            closes. The whisker is the 95 % interval of the shrink.",
            percent(gap.share_of_ceiling)
        );
    }
    let report = report
        .heading("1. The gap before and after")
        .figure(
            bars(&gap_bars(outcome)),
            format!("Free-run gap, every output scaled to unit RMS. {}{words}", records(outcome)),
        )
        .figure(
            traces::window(&Traces::of(outcome), worst),
            format!(
                "The loudest moment of {}, at the output with the largest share of the gap; errors below.",
                outcome.shown.trace_record
            ),
        );
    match traces::spectra(&Traces::of(outcome), worst) {
        Some(svg) => report.figure(
            svg,
            format!(
                "Spectra of {} in {}: the output, the error before and after, and noise alone (Welch).",
                outcome.shown.outputs[worst], outcome.shown.trace_record
            ),
        ),
        None => report.paragraph(format!(
            "{} gives no spectra, because it is too short or too many samples are missing.",
            outcome.shown.trace_record
        )),
    }
}

/// Adds the other outputs, for the details.
pub(super) fn other_outputs(report: Report, outcome: &Outcome) -> Report {
    let others: Vec<usize> = (0..outcome.shown.outputs.len()).filter(|&o| o != worst(outcome)).collect();
    if others.is_empty() {
        return report;
    }
    report.details("The other outputs: traces and spectra", |mut report| {
        for o in others {
            let name = &outcome.shown.outputs[o];
            report = report
                .figure(traces::window(&Traces::of(outcome), o), format!("{name} at the same moment; errors below."));
            if let Some(svg) = traces::spectra(&Traces::of(outcome), o) {
                report = report.figure(svg, format!("Spectra of {name} and of its error."));
            }
        }
        report
    })
}
