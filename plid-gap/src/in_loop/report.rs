//! The report of a diagnosis with a simulator in the loop, and the files of its answer.

use std::path::Path;

use plid_data::config::to_toml;
use plid_report::{Bar, Bars, Cell, Report, Table, bars, percent};

use crate::answer::schema::Remainder;
use crate::answer::statements::what_remains;
use crate::case::Case;
use crate::error::GapError;
use crate::in_loop::answer::LoopDiagnosis;
use crate::in_loop::{LoopOutcome, Shown};
use crate::judge::verdict::Verdict;
use crate::report::traces::{Traces, spectra, window};
use crate::report::{whereabouts, write_answer};
use crate::words::band;

/// Writes diagnosis.json, sim-with-effect.json and report.html into a folder, either all three or none.
///
/// # Errors
/// [`GapError::NotFinite`] with the file and the key, before anything is written; [`GapError::Io`] with the file.
pub fn write(outcome: &LoopOutcome, case: &Case, directory: &Path) -> Result<(), GapError> {
    write_answer(&outcome.diagnosis, &outcome.simulation, || page(outcome, case), directory)
}

/// Builds the page.
pub(super) fn page(outcome: &LoopOutcome, case: &Case) -> Report {
    let LoopOutcome { diagnosis, simulation, shown } = outcome;
    let gap = &diagnosis.gap;
    let mut report =
        Report::new("The gap between the simulator and the records").verdict(&diagnosis.sentence).verdict(format!(
            "Predicted gap: {} (80 % interval {} to {}). Measured on {}: {}.",
            percent(gap.predicted_held_out_gap),
            percent(gap.predicted_ci80[0]),
            percent(gap.predicted_ci80[1]),
            gap.measured_on.join(", "),
            percent(gap.with_effect)
        ));
    report = report.warnings(&diagnosis.warnings);
    report = report.heading("The gap before and after").figure(
        bars(&gap_bars(outcome)),
        format!("The gap on {}, relative to the output. All outputs have equal weight.", gap.measured_on.join(", ")),
    );
    report = report.heading("Where the gap arises").paragraph(whereabouts::sentence(&diagnosis.place));
    for sentence in &diagnosis.evidence {
        report = report.paragraph(sentence);
    }
    report = traces_section(report, shown);
    report = remainder_section(report, diagnosis);
    report = report.heading("The explanations that were tried");
    let mut fits = Table::new("Explanations that were fitted with the simulator, best first")
        .column("explanation", "")
        .column("left beyond the noise", "% of the output");
    for (words, left) in &shown.fits {
        fits = fits.row([words.as_str().into(), Cell::significant(100.0 * left, 3)]);
    }
    report = report.table(fits);
    report = parameters(report, outcome);
    for (stage, entries) in shown.screens.iter().enumerate() {
        let mut table = Table::new(format!("Best entries of screen {}", stage + 1))
            .column("effect", "")
            .column("location", "")
            .column("share of the squared gap that it explains", "%");
        for (effect, location, share) in entries {
            table = table.row([effect.as_str().into(), location.as_str().into(), Cell::significant(100.0 * share, 3)]);
        }
        report = report.details(format!("Screen {}", stage + 1), |report| report.table(table));
    }
    let used = &diagnosis.simulator;
    report
        .paragraph(format!(
            "The simulator, {}, was run {} times (one record per run), {:.1} s in total.{}",
            used.name,
            used.runs,
            used.seconds,
            match &used.left_out[..] {
                [] => String::new(),
                left_out => format!(" A bound on the runs left this out: {}.", left_out.join("; ")),
            }
        ))
        .listing("The case, with all default values:", to_toml(&case.config))
        .provenance("plid", env!("CARGO_PKG_VERSION"))
        .provenance("simulator", &simulation.simulator.name)
}

fn gap_bars(outcome: &LoopOutcome) -> Bars {
    let gap = &outcome.diagnosis.gap;
    let bar = |name: &str, value: f64| Bar {
        name: name.into(),
        value: 100.0 * value,
        text: percent(value),
        ..Bar::default()
    };
    let mut rows = vec![bar("as given", gap.as_given), bar("parameters within their limits", gap.refit)];
    if outcome.diagnosis.verdict != Verdict::None {
        rows.push(Bar { strong: true, ..bar("with the best explanation", gap.with_effect) });
    }
    Bars {
        bars: rows,
        label: "gap: RMS of the error over RMS of the output, %".into(),
        reference: Some((format!("noise alone, {}", percent(gap.noise_floor)), 100.0 * gap.noise_floor)),
    }
}

fn traces_section(mut report: Report, shown: &Shown) -> Report {
    report = report.heading("Measured and simulated");
    let traces = Traces {
        record: &shown.record,
        rate: shown.rate,
        outputs: &shown.outputs,
        units: &shown.units,
        y: &shown.trace,
        with: "with the effects".into(),
        noise: &shown.noise,
    };
    for (o, output) in shown.outputs.iter().enumerate() {
        report = report.figure(
            window(&traces, o),
            format!("{output} where the outputs are loudest, and the errors in the same unit."),
        );
        if let Some(spectra) = spectra(&traces, o) {
            report = report.figure(spectra, format!("Spectral densities of {output} and of its errors."));
        }
    }
    report
}

/// Adds the section on what remains.
fn remainder_section(report: Report, diagnosis: &LoopDiagnosis) -> Report {
    let Remainder { place, .. } = &diagnosis.remainder;
    let report =
        report.heading("What remains").paragraph(what_remains(&diagnosis.remainder, &diagnosis.settings.answer));
    let outputs = place.channels.iter().map(|(name, share)| (name.clone(), *share));
    let bands = place.bands_hz.iter().map(|[from, to, share]| (band(*from, *to), *share));
    let bar = |(name, share)| Bar { name, value: 100.0 * share, text: percent(share), ..Bar::default() };
    let shares: Vec<Bar> = outputs.chain(bands).filter(|(_, share)| *share > 0.0).map(bar).collect();
    if shares.is_empty() {
        return report;
    }
    let label = "share of the remaining squared gap beyond the noise, %".into();
    report.figure(
        bars(&Bars { bars: shares, label, reference: None }),
        "Share of what remains by output and by frequency band (largest only).",
    )
}

/// Adds the table of named effects and parameters.
fn parameters(report: Report, outcome: &LoopOutcome) -> Report {
    let mut table = Table::new("Named effects and parameters, with 95 % intervals")
        .column("effect", "")
        .column("location", "")
        .column("sure", "%")
        .column("share of the gap", "%")
        .column("parameter", "")
        .column("value", "")
        .column("from", "")
        .column("to", "")
        .column("unit", "");
    if outcome.diagnosis.effects.is_empty() {
        return report;
    }
    for effect in &outcome.diagnosis.effects {
        for (name, value) in &effect.parameters {
            let end = |k: usize| value.ci95.map_or_else(|| Cell::from("-"), |ci95| Cell::significant(ci95[k], 4));
            table = table.row([
                effect.effect.as_str().into(),
                effect.location.as_str().into(),
                Cell::fixed(100.0 * effect.confidence, 0),
                effect.share.map_or_else(|| Cell::from("-"), |share| Cell::fixed(100.0 * share, 0)),
                name.as_str().into(),
                Cell::significant(value.value, 4),
                end(0),
                end(1),
                value.unit.as_str().into(),
            ]);
        }
    }
    report.table(table)
}
