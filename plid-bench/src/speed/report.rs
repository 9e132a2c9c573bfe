//! The content of report.html: a summary, figures, the targets, and the tables behind them.

use itertools::Itertools;
use plid_catalogue::CovarianceName;
use plid_report::{Cell as Shown, Report, Table};

use super::cell::{Cell, word};
use super::outcome::{Outcome, Timing};
use super::peers::{Peers, Size};
use super::pictures;
use super::targets::{STATES, targets};
use crate::study::to_toml;

/// The page.
pub fn page(outcome: &Outcome, peers: Option<&Peers>) -> Report {
    let mut report = verdict(outcome, peers, Report::new("Speed of a step"));
    for (svg, caption) in pictures::all(outcome) {
        report = report.figure(svg, caption);
    }
    report = report.heading("Targets").table(target_table(outcome, peers));
    if let Some(peers) = peers {
        report = peers.sizes.iter().fold(report.heading("Peers"), |report, size| report.table(peer_table(size)));
    }
    report =
        report.heading("Figures").table(limit_table(outcome)).table(slope_table(outcome)).table(term_table(outcome));
    report = report.details(format!("All {} cells", outcome.timings.len()), |part| part.table(cell_table(outcome)));
    report = report.warnings(warnings(outcome));
    report = report.paragraph(method(outcome)).details("The config that repeats this study", |part| {
        part.listing("plid bench speed config.toml --out DIR", to_toml(&outcome.config))
    });
    outcome.machine.lines().into_iter().fold(report, |report, (name, value)| report.provenance(name, value))
}

fn verdict(outcome: &Outcome, peers: Option<&Peers>, report: Report) -> Report {
    let mut sentences = Vec::new();
    sentences.extend(largest(outcome));
    sentences.extend(claim(outcome));
    let targets = targets(outcome, peers);
    let (met, missed) =
        targets.iter().filter_map(|t| t.met).fold((0, 0), |(a, b), met| if met { (a + 1, b) } else { (a, b + 1) });
    if met + missed > 0 {
        sentences.push(format!(
            "{met} of {} targets are met; for the others the table gives the limiting factor.",
            met + missed
        ));
    }
    sentences.into_iter().fold(report, Report::verdict)
}

/// Returns a sentence on the forms at the largest measured size with one expectation.
fn largest(outcome: &Outcome) -> Option<String> {
    let states = pictures::sizes(outcome).into_iter().max()?;
    let expectations = pictures::shown_expectation(outcome)?;
    let direct = outcome.plain(states, CovarianceName::Direct, expectations)?;
    let others: Vec<String> = CovarianceName::all()
        .into_iter()
        .filter(|&form| form != CovarianceName::Direct)
        .filter_map(|form| {
            let timing = outcome.plain(states, form, expectations)?;
            Some(format!("{} {:.2} times that", word(&form), timing.passes / direct.passes))
        })
        .collect();
    let others = if others.is_empty() { String::new() } else { format!("; {}", others.join(", ")) };
    Some(format!(
        "At n = {states} (N = {}) in f64 on one thread with {}, a direct step takes {:.1} us, {:.2} passes over \
         P{others}.",
        direct.joint_states,
        word(&expectations),
        direct.median_us,
        direct.passes
    ))
}

/// Returns a sentence on the paper's "as much as 10x more", over all sizes, expectations and shapes of noise in f64
/// on one thread.
pub(super) fn claim(outcome: &Outcome) -> Option<String> {
    let range = |form| {
        let ratios: Vec<f64> = outcome
            .timings
            .iter()
            .filter(|timing| timing.cell.variant.covariance == form && timing.cell.is_plain())
            .filter_map(|timing| {
                let mut direct = timing.cell;
                direct.variant.covariance = CovarianceName::Direct;
                Some(timing.passes / outcome.timing(&direct)?.passes)
            })
            .collect();
        let least = ratios.iter().copied().reduce(f64::min)?;
        Some((least, ratios.into_iter().reduce(f64::max)?))
    };
    let (ud, array) = (range(CovarianceName::BiermanUd)?, range(CovarianceName::ArraySqrt)?);
    let most = ud.1.max(array.1);
    let judged = if most >= 10.0 {
        "so the claim holds for the slowest of them"
    } else {
        "so the claim does not hold for these implementations"
    };
    Some(format!(
        "The paper says that square-root forms cost \"as much as 10x more\": over all sizes and expectations in f64 on \
         one thread, UD takes {:.2} \
         to {:.2} times as long as direct and the array square root {:.2} to {:.2} times, {judged}.",
        ud.0, ud.1, array.0, array.1
    ))
}

fn target_table(outcome: &Outcome, peers: Option<&Peers>) -> Table {
    let table = Table::new(format!(
        "Targets at n = {STATES}, three inputs and outputs, f64, one thread, diagonal noise, unless said otherwise; \
         ratios within this run."
    ));
    let table =
        ["quantity", "target", "measured", "", "limiting factor"].iter().fold(table, |t, name| t.column(*name, ""));
    targets(outcome, peers).into_iter().fold(table, |table, target| {
        let met = match target.met {
            Some(true) => "reached",
            Some(false) => "not reached",
            None => "stated",
        };
        table.row([target.what.into(), target.target.into(), target.found.into(), met.into(), target.reason.into()])
    })
}

fn peer_table(size: &Size) -> Table {
    let caption = format!(
        "Other software on the same recursion (joint-ekf) and data, n = {}, {} inputs, {} outputs, each timed \
         alternately with plid's direct form.",
        size.n, size.inputs, size.outputs
    );
    let table = Table::new(caption)
        .column("peer", "")
        .column("version", "")
        .column("form", "")
        .column("uses the structure", "")
        .column("a step", "us")
        .column("plid", "us")
        .column("speed-up of plid", "×")
        .column("s, P differ by", "");
    let table = size.peers.iter().fold(table, |table, peer| {
        table.row([
            peer.name.as_str().into(),
            peer.version.as_str().into(),
            peer.form.as_str().into(),
            if peer.structured { "yes" } else { "no" }.into(),
            Shown::significant(peer.us_per_step, 3),
            Shown::significant(peer.plid_us_per_step, 3),
            Shown::significant(peer.ratio, 3),
            Shown::significant(peer.agreement, 2),
        ])
    });
    size.refused.iter().fold(table, |table, peer| {
        table.row([peer.name.as_str().into(), "".into(), format!("no time: {}", peer.refused).into()])
    })
}

fn limit_table(outcome: &Outcome) -> Table {
    let table = Table::new(
        "The reference for memory traffic: one pass over an N x N matrix, x ← a x + b for every \
        entry, in the same run.",
    )
    .column("N", "")
    .column("scalar", "")
    .column("the whole", "us")
    .column("lower triangle", "us")
    .column("rate", "GB/s")
    .column("peak", "Gflop/s");
    let mut limits: Vec<_> = outcome.limits.iter().collect();
    limits.sort_by_key(|limit| (word(&limit.scalar), limit.joint_states));
    limits.into_iter().fold(table, |table, limit| {
        table.row([
            limit.joint_states.into(),
            word(&limit.scalar).into(),
            Shown::significant(limit.full_us, 3),
            Shown::significant(limit.triangle_us, 3),
            Shown::significant(limit.gbytes_s, 3),
            Shown::significant(outcome.peak(limit.scalar).unwrap_or(f64::NAN), 3),
        ])
    })
}

fn slope_table(outcome: &Outcome) -> Table {
    let table =
        Table::new("Slopes of log time against log N, N from 168 to 448, three inputs and outputs, one thread.")
            .column("form", "")
            .column("expectation", "")
            .column("library", "")
            .column("scalar", "")
            .column("time", "")
            .column("operations", "");
    outcome.slopes.iter().fold(table, |table, slope| {
        table.row([
            word(&slope.variant.covariance).into(),
            word(&slope.variant.expectations).into(),
            word(&slope.variant.backend).into(),
            word(&slope.variant.scalar).into(),
            Shown::fixed(slope.time, 2),
            Shown::fixed(slope.operations, 2),
        ])
    })
}

/// Returns a table of the operations of a step by purpose, with one column per form.
fn term_table(outcome: &Outcome) -> Table {
    let expectations = pictures::shown_expectation(outcome).unwrap_or_default();
    let caption = format!(
        "Distribution of the operations of a step at n = {STATES}, {}, by the leading terms of the formulas.",
        word(&expectations)
    );
    let mut table = Table::new(caption).column("part", "");
    let of = |form| {
        let cell = Cell::plain(STATES, form, expectations);
        cell.variant.flops(&cell.size())
    };
    let forms = CovarianceName::all();
    for form in &forms {
        table = table.column(word(form), "Mflop");
    }
    let parts = forms.iter().flat_map(|&form| of(form)).map(|term| term.what).unique();
    let cells = |part: &str| {
        let megaflops =
            |form| of(form).iter().filter(|term| term.what == part).map(|term| term.flops / 1e6).sum::<f64>();
        let shown = forms.iter().map(|&form| match megaflops(form) {
            0.0 => Shown::Number(String::new()),
            value => Shown::fixed(value, 3),
        });
        [Shown::from(part)].into_iter().chain(shown).collect::<Vec<_>>()
    };
    parts.fold(table, |table, part| table.row(cells(part)))
}

fn cell_table(outcome: &Outcome) -> Table {
    let table = Table::new(
        "All cells. A pass reads and writes a whole N x N matrix and is measured together with the \
        steps.",
    )
    .column("cell", "")
    .column("steps", "")
    .column("median", "us")
    .column("p99", "us")
    .column("p99.9", "us")
    .column("time", "passes")
    .column("operations", "Mflop")
    .column("bytes", "kB")
    .column("", "Gflop/s")
    .column("", "GB/s")
    .column("allocated", "bytes")
    .column("restarts", "");
    let row = |timing: &Timing| {
        [
            timing.key.as_str().into(),
            Shown::Number(timing.steps.to_string()),
            Shown::significant(timing.median_us, 3),
            Shown::significant(timing.p99_us, 3),
            Shown::significant(timing.p99_9_us, 3),
            Shown::significant(timing.passes, 3),
            Shown::significant(timing.operations.total() as f64 / 1e6, 3),
            Shown::significant(timing.bytes / 1e3, 3),
            Shown::significant(timing.gflops, 3),
            Shown::significant(timing.gbytes_s, 3),
            timing.allocated_bytes.map_or("–".into(), Shown::from),
            timing.restarts.into(),
        ]
    };
    outcome.timings.iter().fold(table, |table, timing| table.row(row(timing)))
}

fn warnings(outcome: &Outcome) -> Vec<String> {
    let mut warnings = Vec::new();
    if !outcome.pinned {
        warnings.push("Threads could not be pinned to cores, so times vary more.".into());
    }
    if !outcome.skipped.is_empty() {
        warnings.push(format!(
            "{} cells require more cores than this machine has and were not measured.",
            outcome.skipped.len()
        ));
    }
    let restarted: Vec<&Timing> = outcome.timings.iter().filter(|timing| timing.restarts > 0).collect();
    if let Some(first) = restarted.first() {
        warnings.push(format!("{} recursions failed and were restarted, for example {}.", restarted.len(), first.key));
    }
    if let Some(load) = outcome.machine.load_average
        && load[0] > 0.5
    {
        warnings.push(format!(
            "Other processes were running when the study began (load average {:.2}), which affects the percentiles.",
            load[0]
        ));
    }
    warnings
}

fn method(outcome: &Outcome) -> String {
    let cores: Vec<String> = outcome.cores.iter().map(ToString::to_string).collect();
    let config = &outcome.config;
    format!(
        "Steps are timed one by one, in {} visits of each cell, all cells in turn, after {} steps of warm-up; a cell's \
         time is the median over the visits of \
         the median step, and its ratio to the pass is taken within each visit. Threads are kept on logical cores {} \
         (the first one measures{}). \
         Operations are counted while the recursion runs on numbers that count, a fused multiply-add as two; bytes are \
         those of P, s and the gain, read and written once.",
        config.rounds,
        config.warm_up,
        cores.join(", "),
        if outcome.pinned { "" } else { ", which the system refused" },
    )
}
