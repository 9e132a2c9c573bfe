//! The details below the figures: all numbers of the diagnosis.

use plid_report::{Axis, Cell, Chart, Report, Series, Table, chart};

use super::words::{at, explanation, percent, records};
use super::{GIVEN, REFERENCE, WITH, shrink, whereabouts};
use crate::answer::schema::NamedEffect;
use crate::case::Case;
use crate::diagnose::Outcome;
use crate::plant::plain_hz;
use crate::words::{gain_cell, likelihood_cell};

/// Adds all details.
pub(super) fn section(report: Report, outcome: &Outcome, case: &Case) -> Report {
    let report = report.heading("Details");
    let report = parameters(report, outcome);
    let report = explanations(report, outcome, case);
    let report = separability(report, outcome);
    let report = gaps(report, outcome);
    let report = refit(report, outcome);
    let report = stages(report, outcome);
    let report = tracks(report, outcome);
    let report = quiet(report, outcome);
    let report = whereabouts::after(report, outcome);
    shrink::other_outputs(report, outcome)
}

fn parameters(report: Report, outcome: &Outcome) -> Report {
    let diagnosis = &outcome.diagnosis;
    if diagnosis.effects.is_empty() {
        return report;
    }
    let caption = "Effects of the answer, largest share of the gap first. The share is that of the squared gap beyond \
        noise and bounded refit that an effect closes while the others stay, with its 95 % interval.";
    let mut table = Table::new(caption)
        .column("effect", "")
        .column("place", "")
        .column("sure", "%")
        .column("share of the gap", "%")
        .column("family", "")
        .column("parameter", "")
        .column("value", "")
        .column("95 % interval", "")
        .column("unit", "");
    for effect in &diagnosis.effects {
        let shape = if effect.shape_differs { " (shape differs)" } else { "" };
        let mut head: Vec<Cell> = vec![
            format!("{}{shape}", effect.effect).into(),
            effect.location.as_str().into(),
            Cell::fixed(100.0 * effect.confidence, 1),
            share(effect),
            family(effect).into(),
        ];
        for (name, value) in &effect.parameters {
            let interval = value.ci95.filter(|ends| ends.iter().all(|x| x.is_finite()));
            let interval = interval.map_or("not given".into(), |[low, high]| {
                Cell::Number(format!("{} to {}", Cell::significant(low, 4), Cell::significant(high, 4)))
            });
            let unit: &str = if value.unit.is_empty() { "1" } else { &value.unit };
            head.extend([name.as_str().into(), Cell::significant(value.value, 4), interval, unit.into()]);
            table = table.row(std::mem::replace(&mut head, vec!["".into(); 5]));
        }
        if effect.parameters.is_empty() {
            table = table.row(head);
        }
    }
    let mut report = report.table(table);
    for written in &outcome.simulation.effects {
        report = report.paragraph(format!("{}: {}", at(&written.effect, &written.location), written.equation));
    }
    report
}

/// Returns the share of the gap that an effect closes, with its interval: "96.0 (94.1 to 97.3)". A stochastic effect
/// has none.
fn share(effect: &NamedEffect) -> Cell {
    let figure = |share: f64| Cell::fixed(100.0 * share, 1);
    let Some(share) = effect.share else { return "".into() };
    let interval = effect.share_ci95.map(|[low, high]| format!(" ({} to {})", figure(low), figure(high)));
    Cell::Number(format!("{}{}", figure(share), interval.unwrap_or_default()))
}

/// Returns the family of an effect with its probability: "dry friction, 97 % sure".
fn family(effect: &NamedEffect) -> String {
    let family = effect.family.as_ref();
    family.map_or_else(String::new, |family| format!("{}, {:.0} % sure", family.name, 100.0 * family.confidence))
}

fn explanations(report: Report, outcome: &Outcome, case: &Case) -> Report {
    let diagnosis = &outcome.diagnosis;
    let caption = "All explanations that the data leave open. Their probabilities follow how often such answers were \
        right in blind trials.";
    let mut table = Table::new(caption)
        .column("explanation", "")
        .column("probability", "%")
        .column("gap with it", "%")
        .column("95 % set", "");
    let mut before = 0.0;
    for candidate in &diagnosis.candidates {
        table = table.row([
            explanation(candidate).into(),
            Cell::fixed(100.0 * candidate.probability, 2),
            Cell::fixed(100.0 * candidate.gap_after.unwrap_or(f64::NAN), 2),
            if before < 0.95 { "in it" } else { "" }.into(),
        ]);
        before += candidate.probability;
    }
    let mut report = report.table(table);
    for class in &diagnosis.not_separable {
        report = report.paragraph(format!("These records cannot distinguish: {}.", class.join("; ")));
    }
    for (words, what) in [
        (&case.config.suspects, "Suspected by the engineer, and therefore given a higher prior"),
        (&case.config.exclude, "Excluded by the engineer"),
    ] {
        if !words.is_empty() {
            report = report.paragraph(format!("{what}: {}.", words.join(", ")));
        }
    }
    report
}

/// Adds a table of the separability of the explanations on these records.
fn separability(report: Report, outcome: &Outcome) -> Report {
    let diagnosis = &outcome.diagnosis;
    let [first, others @ ..] = diagnosis.separability.as_slice() else { return report };
    if others.is_empty() {
        return report;
    }
    let mut table = Table::new(format!(
        "Could these records distinguish them? Differences in log likelihood if {} is the true cause. The left-hand \
        columns are first-order estimates from the first screen.",
        first.explanation
    ))
    .column("explanation", "")
    .column("absorbed by a refit", "%")
    .column("cosine", "")
    .column("difference expected before any fit", "")
    .column("expected after the fits", "")
    .column("found", "")
    .column("distinguished", "");
    let cell = |value: Option<f64>, digits: usize| match value {
        Some(value) if value.is_finite() => Cell::fixed(value, digits),
        _ => "".into(),
    };
    let evidence = |value: Option<f64>| value.filter(|x| x.is_finite()).map_or("".into(), likelihood_cell);
    for row in &diagnosis.separability {
        let told = match row.expected {
            None => "",
            Some(_) if row.explanation == first.explanation => "",
            Some(_) if diagnosis.not_separable.iter().any(|class| class.contains(&row.explanation)) => "no",
            Some(_) => "yes",
        };
        table = table.row([
            row.explanation.as_str().into(),
            cell(row.absorbed.map(|share| 100.0 * share), 1),
            cell(row.cosine, 4),
            evidence(row.expected_before),
            evidence(row.expected),
            evidence(row.realised),
            told.into(),
        ]);
    }
    report.table(table).paragraph(format!(
        "How to read it. A bounded refit absorbs a share of an effect's trace; only the remainder is visible. The \
        cosine says how similar two remainders are. It is not decisive alone: half the energy of the remainder times \
        one minus the squared cosine is the expected difference in log likelihood, so a cosine of 0.99 hides a cause \
        in a small gap but not in a large one. A rival is therefore fitted to what the first explanation predicts for \
        these records. Where less than {:.0} (odds of 150 : 1) is expected after the fits, the records cannot \
        distinguish the two, whatever difference was found. A field is empty if the entry was not fitted, or was too \
        poor to be fitted again.",
        outcome.diagnosis.settings.judge.separable
    ))
}

/// Adds the adaptive run: innovations, and each mode of the simulation from record to record.
fn tracks(report: Report, outcome: &Outcome) -> Report {
    let passed = &outcome.shown.evidence.tracks.passed;
    if passed.is_empty() {
        return report;
    }
    let mut table = Table::new(
        "An adaptive PLID run over the fitted records. A gap shows up as parameters that change with level or time.",
    )
    .column("record", "")
    .column("level, RMS", "")
    .column("innovations relative to the noise", "");
    let modes: Vec<usize> =
        (0..passed[0].modes.len()).filter(|&k| passed.iter().filter(|p| p.modes[k].is_some()).count() > 1).collect();
    for &k in modes.iter().take(MODES) {
        let hz = passed.iter().find_map(|p| p.modes[k]).map_or(0.0, |(hz, _)| hz);
        table = table.column(format!("mode near {}", plain_hz(hz)), "Hz");
    }
    for record in passed {
        let mut row: Vec<Cell> = vec![
            record.record.as_str().into(),
            Cell::significant(record.level, 3),
            Cell::significant(record.innovations, 3),
        ];
        row.extend(modes.iter().take(MODES).map(|&k| match record.modes[k] {
            Some((hz, _)) => Cell::significant(hz, 6),
            None => "".into(),
        }));
        table = table.row(row);
    }
    report.table(table)
}

/// Largest number of modes in a table.
const MODES: usize = 8;

fn gaps(report: Report, outcome: &Outcome) -> Report {
    let gap = &outcome.diagnosis.gap;
    // A zero is printed without a sign.
    let figure = |share: f64| Cell::fixed(if share.abs() < 5e-5 { 0.0 } else { 100.0 * share }, 2);
    let mut table = Table::new(format!("The gap in numbers, on {}.", gap.measured_on.join(", ")))
        .column("figure", "")
        .column("value", "%")
        .column("80 % interval", "%");
    let rows = [
        ("gap as given", gap.as_given),
        ("gap after the bounded refit", gap.refit),
        ("gap after a linear refit without bounds", gap.free_refit),
        ("gap with all effects", gap.with_effect),
        ("gap of noise alone", gap.noise_floor),
        ("gap predicted from the fitted records", gap.crossed_gap),
    ];
    let of_reference = ("shrink by a reference effect, minus that of the bounded refit", gap.placebo_shrink);
    for (name, value) in rows.into_iter().chain(gap.reference().map(|_| of_reference)) {
        table = table.row([name.into(), figure(value)]);
    }
    let [low, high] = gap.predicted_ci80.map(figure);
    let interval = Cell::Number(format!("{low} to {high}"));
    table = table.row(["gap to expect on a further record".into(), figure(gap.predicted_held_out_gap), interval]);
    let mut shrink = Table::new(
        "Shrink by all effects: 1 − (gap with effects)/(reference gap), both in excess of the noise, with 95 % \
        intervals from a block bootstrap.",
    )
    .column("relative to", "")
    .column("its gap", "%")
    .column("shrink", "%")
    .column("from", "%")
    .column("to", "%");
    let mut over = vec![("the simulation as given".to_string(), figure(gap.as_given), gap.shrink, gap.shrink_ci95)];
    let others = gap.shrink_over.iter();
    over.extend(others.map(|over| (format!("the {}", over.than), figure(over.gap), over.shrink, over.ci95)));
    let ceiling = "as a share of what the flexible ceiling model closes".to_string();
    over.push((ceiling, Cell::from(""), gap.share_of_ceiling, gap.share_of_ceiling_ci95));
    for (than, its_gap, value, [low, high]) in over {
        shrink = shrink.row([than.into(), its_gap, figure(value), figure(low), figure(high)]);
    }
    let costs = costs(outcome);
    report
        .table(table)
        .paragraph(records(outcome))
        .table(shrink)
        .details("Residual compared with the noise", |report| report.table(costs))
}

/// Returns the table of the residual of the fitted records.
fn costs(outcome: &Outcome) -> Table {
    let judged = &outcome.shown.adequacy;
    let [given, refit, found] = outcome.shown.costs;
    let mut costs =
        Table::new("The residual of the fitted records: mean squared whitened residual, where 1 is noise alone.")
            .column("figure", "")
            .column("value", "");
    let figure = |value: f64| Cell::significant(value, 4);
    for (name, cell) in [
        ("as given", figure(given)),
        ("after the bounded refit", figure(refit)),
        ("with all effects", figure(found)),
        ("excess over the noise, in standard deviations of the noise level", figure(judged.excess)),
        ("share of the gap that is left", figure(judged.left)),
        (
            "largest change of a linear parameter, in standard deviations of the stated limits",
            figure(judged.max_prior_z),
        ),
        ("gain of the best remaining entry of the screen", gain_cell(judged.next_gain)),
        ("probability of something else", figure(judged.unknown)),
    ] {
        costs = costs.row([name.into(), cell]);
    }
    costs
}

fn refit(report: Report, outcome: &Outcome) -> Report {
    let modes = &outcome.shown.refit;
    if modes.is_empty() {
        return report;
    }
    let points = |of: fn(&(f64, f64, f64, f64)) -> f64| modes.iter().map(|mode| (mode.0, of(mode))).collect();
    let plot = chart(&Chart {
        title: String::new(),
        x: Axis::linear("mode, Hz"),
        y: Axis::linear("change, standard deviations"),
        series: vec![
            Series::level("stated limits (two)", 2.0).colour(REFERENCE),
            Series::level("", -2.0).colour(REFERENCE),
            Series::points("frequency", points(|m| m.1)).colour(WITH).width(4.5),
            Series::points("damping", points(|m| m.2)).colour(GIVEN).width(4.5),
            Series::points("largest of the shapes", points(|m| m.3)).colour("#009e73").width(4.5),
        ],
        height: 160.0,
    });
    let largest =
        modes.iter().flat_map(|m| [m.1, m.2, m.3]).filter(|z| z.is_finite()).map(f64::abs).fold(0.0, f64::max);
    let within = if largest <= 2.0 { "all within the stated limits" } else { "beyond the stated limits" };
    report
        .figure(
            plot,
            format!(
                "Changes by the refit in addition to the effects, mode by mode, in standard deviations of its prior \
                (half the stated limits). The largest change is {largest:.1}: {within}."
            ),
        )
        .details("Changes by the refit in numbers", |mut report| {
            for line in &outcome.simulation.refit {
                report = report.paragraph(line);
            }
            report
        })
}

fn stages(report: Report, outcome: &Outcome) -> Report {
    report.details("The screen, stage by stage", |mut report| {
        for (stage, entries) in outcome.shown.stages.iter().enumerate() {
            let mut table = Table::new(format!(
                "Stage {}: best entries before any fit{}.",
                stage + 1,
                if stage == 0 { "" } else { ", with the effects of earlier stages in place" }
            ))
            .column("effect", "")
            .column("place", "")
            .column("reduction of the sum of squares", "")
            .column("absorbed by a refit", "%");
            for (effect, location, gain, absorbed) in entries {
                table = table.row([
                    effect.as_str().into(),
                    location.as_str().into(),
                    gain_cell(*gain),
                    Cell::fixed(100.0 * absorbed, 1),
                ]);
            }
            report = report.table(table);
        }
        report
    })
}

fn quiet(report: Report, outcome: &Outcome) -> Report {
    let shown = &outcome.shown;
    let mut noise = Table::new("Noise that no command explains, and share of the initial squared gap, by output.")
        .column("output", "")
        .column("RMS of the noise", "as recorded")
        .column("share of the squared gap", "%");
    let channels = &outcome.diagnosis.place.channels;
    for (name, rms) in shown.outputs.iter().zip(&outcome.simulation.noise_rms) {
        let share = channels.get(name).copied().unwrap_or(f64::NAN);
        noise = noise.row([name.as_str().into(), Cell::significant(*rms, 3), Cell::fixed(100.0 * share, 1)]);
    }
    let report = report.table(noise);
    if shown.stochastic.is_empty() {
        return report.paragraph(
            "Quiet records, differences between periods and raw values show no stochastic effect (coarse quantisation, \
            dropouts, a noisy sensor or a random force in a band).",
        );
    }
    let mut table = Table::new("Stochastic effects, found in quiet records and in raw values.")
        .column("effect", "")
        .column("place", "")
        .column("evidence: twice the log likelihood", "");
    for (effect, location, gain) in &shown.stochastic {
        table = table.row([effect.as_str().into(), location.as_str().into(), gain_cell(*gain)]);
    }
    report.table(table).paragraph(format!(
        "Effects with a gain of at least {:.0} are in the answer. 'Something else' has a probability of {}.",
        outcome.diagnosis.settings.search.stochastic_gain,
        percent(shown.adequacy.unknown)
    ))
}
