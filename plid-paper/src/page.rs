//! The page: a table of the paper's statements with our figures and verdicts, followed by each claim with its plots.

use plid_bench::study::Machine;
use plid_report::{Cell, Report, Table};

use crate::claim::{Claim, Finding, Panel, Verdict};
use crate::reproduce::Summary;

/// The conclusions that a simulated truss permits.
pub const CAVEAT: &str = "The paper's own records are not available. Its experiment is repeated on a simulated truss \
    that was built from the paper's figures: \
    frequencies, levels, noise, converters. So a simulation can say whether PLID does what the paper says of it, given \
    such a plant, such noise and such converters, and it \
    knows the true plant, as the paper could not. It cannot say that the real structure was like that: what went into \
    the testbed cannot be confirmed by it.";

/// A claim and its finding.
#[derive(Clone)]
pub struct Line {
    /// The claim.
    pub claim: Claim,
    /// Its config.
    pub config: String,
    /// The varied settings.
    pub vary: String,
    /// The finding; `None` if it has not been run.
    pub finding: Option<Finding>,
    /// Duration in s.
    pub seconds: Option<f64>,
}

impl Line {
    /// Returns the entry of claims.json if the claim has been run.
    pub fn summary(&self) -> Option<Summary> {
        self.finding.as_ref().map(|finding| Summary::of(&self.claim, finding))
    }
}

/// Returns the report.
pub fn page(lines: &[Line], quick: bool, machine: &Machine) -> Report {
    let found = || lines.iter().filter_map(|line| Some((line, line.finding.as_ref()?)));
    let count = |verdict: Verdict| found().filter(|(_, finding)| finding.verdict() == verdict).count();
    let verdicts = [Verdict::Confirmed, Verdict::ConfirmedInPart, Verdict::Refuted, Verdict::CannotBeJudged];
    let counted: Vec<String> =
        verdicts.iter().map(|&verdict| format!("{} {}", count(verdict), verdict.words())).collect();
    let mut report = Report::new("Reproduction of the paper's claims").verdict(format!(
        "Of {} figures and claims of Vallone and Hopkins (1995): {}.",
        found().count(),
        counted.join(", ")
    ));
    if quick {
        report =
            report.verdict("This is a quick run with few seeds and short records. Only the full run should be quoted.");
    }
    let missing: Vec<&str> = lines.iter().filter(|l| l.finding.is_none()).map(|l| l.claim.id).collect();
    if !missing.is_empty() {
        report = report.verdict(format!("Not run yet: {}.", missing.join(", ")));
    }
    report = report.paragraph(CAVEAT).table(
        found().fold(
            Table::new("The paper's claims and the results of this run.")
                .column("id", "")
                .column("claim of the paper", "")
                .column("we find", "")
                .column("verdict", ""),
            |table, (line, finding)| {
                let cells = [line.claim.id, line.claim.statement, &finding.sentence, finding.verdict().words()];
                table.row(cells.map(Cell::from))
            },
        ),
    );
    report = found().fold(report, |report, (line, finding)| claim(report, line, finding));
    let seconds = lines.iter().filter_map(|line| line.seconds).sum::<f64>();
    let rows = machine.lines().into_iter().chain([("time of all claims", format!("{seconds:.0} s"))]);
    rows.fold(report, |report, (name, value)| report.provenance(name, value))
}

fn claim(report: Report, line: &Line, finding: &Finding) -> Report {
    let Claim { id, statement, limit, timed, .. } = line.claim;
    let mut report = report
        .heading(format!("{id}: {}", finding.verdict().words()))
        .paragraph(format!("The paper: {statement}"))
        .paragraph(format!("Here: {}", finding.sentence));
    for panel in &finding.panels {
        report = match panel {
            Panel::Picture { svg, caption } => report.figure(svg, caption),
            Panel::Table { caption, columns, rows } => {
                let empty = columns.iter().fold(Table::new(caption), |table, (name, unit)| table.column(name, unit));
                report.table(rows.iter().fold(empty, |table, row| table.row(row.iter().map(|cell| number(cell)))))
            }
        };
    }
    let rules = finding.parts.iter().fold(
        Table::new("A claim is confirmed if all of its parts hold, and refuted if none of the testable parts holds.")
            .column("part", "")
            .column("holds", ""),
        |table, part| {
            let holds = match part.holds {
                Some(true) => "yes",
                Some(false) => "no",
                None => "cannot be tested here",
            };
            table.row([part.rule.as_str().into(), holds.into()])
        },
    );
    report = report.table(rules).paragraph(limit);
    report.details("Figures and configs", |report| {
        let caption = if timed { "Figures. Times differ between runs." } else { "Figures." };
        let figures = finding.figures.iter().fold(
            Table::new(caption).column("figure", "").column("value", "").column("unit", ""),
            |table, figure| {
                let value = Cell::significant(figure.value.unwrap_or(f64::NAN), 4);
                table.row([figure.name.as_str().into(), value, figure.unit.as_str().into()])
            },
        );
        let mut report = report.table(figures).listing(format!("{id}.toml:"), &line.config);
        if !line.vary.is_empty() {
            report = report.listing(format!("{id}.vary.toml, the settings varied:"), &line.vary);
        }
        match line.seconds {
            Some(seconds) => report.paragraph(format!("It took {seconds:.1} s.")),
            None => report,
        }
    })
}

/// Aligns digits to the right.
fn number(cell: &str) -> Cell {
    if cell.parse::<f64>().is_ok() { Cell::Number(cell.into()) } else { Cell::Text(cell.into()) }
}
