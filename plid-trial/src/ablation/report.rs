//! The page: the change of the figures without each step, the table, and the cases by name.

use plid_data::config::to_toml;
use plid_gap::Step;
use plid_report::{Cell, Dot, Dots, Report, Table, dots};

use super::{Ablation, EXACT, FALSE_ALARM, Figures, IN_SET, RIGHT, WRONG, Without};
use crate::config::TrialConfig;
use crate::statistics::Rate;

pub(super) fn page(ablation: &Ablation, config: &TrialConfig) -> Report {
    let mut report = Report::new(format!("The contribution of each step: {}", ablation.name));
    for sentence in sentences(ablation) {
        report = report.verdict(sentence);
    }
    let report = picture(report, ablation);
    let report = figures(report, ablation);
    let report = by_name(report, ablation);
    report
        .listing("The trial:", to_toml(config))
        .listing(
            "The commands:",
            format!(
                "plid gap trial draw TRIAL.toml --out T --sealed S --seed {}\nplid gap trial diagnose T\nplid gap \
                 trial score T --sealed S\nplid gap trial ablate T --sealed S --out DIR",
                ablation.seed
            ),
        )
        .provenance("plid", env!("CARGO_PKG_VERSION"))
        .provenance("SHA-256 of the trial's own answers", &ablation.answers_sha256)
}

/// Returns the summary in words.
pub(super) fn sentences(ablation: &Ablation) -> Vec<String> {
    let mut sentences = vec![format!(
        "{} cases, diagnosed again with one of {} steps off at a time.",
        ablation.cases,
        ablation.steps.len()
    )];
    let names = |keep: &dyn Fn(&Without) -> bool| -> Vec<&str> {
        ablation.steps.iter().filter(|without| keep(without)).map(|without| without.step.name()).collect()
    };
    let moves = |without: &Without| without.changes.iter().any(|c| !c.better.is_empty() || !c.worse.is_empty());
    let same = names(&|without| without.changed.is_empty());
    if !same.is_empty() {
        sentences.push(format!("No answer changed without {}: these steps have no effect here.", list(&same)));
    }
    let unread = names(&|without| !without.changed.is_empty() && !moves(without));
    if !unread.is_empty() {
        sentences
            .push(format!("Answers changed without {}, but no figure that is counted by case did.", list(&unread)));
    }
    for without in &ablation.steps {
        let Some(change) = without.change(RIGHT).filter(|c| !c.better.is_empty() || !c.worse.is_empty()) else {
            continue;
        };
        sentences.push(format!(
            "Without {}, {} fewer and {} more of {} cases are answered correctly (sign test p = {:.2}).",
            without.step,
            change.worse.len(),
            change.better.len(),
            change.of,
            change.p
        ));
    }
    sentences
}

fn list(names: &[&str]) -> String {
    match names {
        [] => String::new(),
        [only] => (*only).to_owned(),
        [first @ .., last] => format!("{} or {last}", first.join(", ")),
    }
}

fn picture(report: Report, ablation: &Ablation) -> Report {
    let kinds = [EXACT, IN_SET, WRONG, FALSE_ALARM];
    let dot = |without: &Without, figure: &str| {
        let change = without.change(figure)?;
        let [low, high] = change.ci95?;
        Some(Dot { value: 100.0 * change.difference?, interval: (100.0 * low, 100.0 * high) })
    };
    let rows = ablation.steps.iter().map(|without| {
        (format!("without {}", without.step), kinds.iter().map(|figure| dot(without, figure)).collect())
    });
    let svg = dots(&Dots {
        kinds: kinds.map(str::to_owned).to_vec(),
        rows: rows.collect(),
        label: "change when the step is off, in per cent of the cases".to_owned(),
    });
    report.heading("The effect of switching a step off").figure(
        svg,
        "A step contributes if, without it, exact names or the 95 % set move left, or wrong names and false alarms \
         move right. The lines are 95 % intervals of the paired difference. They are conservative, because they \
         combine 97.5 % intervals (Clopper-Pearson) of the gains and of the losses.",
    )
}

fn figures(report: Report, ablation: &Ablation) -> Report {
    let mut table = Table::new(
        "All cases. Better: cases answered correctly only without the step; worse: only with it; p is that of the sign \
         test. Time: median seconds for a case, without baselines.",
    )
    .column("off", "")
    .column("answers changed", "")
    .column("better", "")
    .column("worse", "")
    .column("p", "");
    for name in ["exact", "family", "place", "in the set", "all named", "false alarms", "confident, wrong", "kept open"]
    {
        table = table.column(name, "");
    }
    table = table.column("shrink", "median").column("Brier", "").column("time", "s");
    let cells = |figures: &Figures| {
        let t = &figures.totals;
        let rates =
            [t.exact, t.family, t.located, t.in_set, t.all_named, t.false_alarms, t.confident_wrong, t.kept_open];
        let number = |value: Option<f64>, decimals| Cell::fixed(value.unwrap_or(f64::NAN), decimals);
        let mut cells: Vec<Cell> = rates.iter().map(count).collect();
        cells.push(number(t.shrink_median, 3));
        cells.push(number(t.calibration.brier, 3));
        cells.push(number(figures.median_s, 1));
        cells
    };
    let dash = || Cell::Number("–".to_owned());
    table = table.row(["nothing".into(), dash(), dash(), dash(), dash()].into_iter().chain(cells(&ablation.full)));
    for without in &ablation.steps {
        let right = without.change(RIGHT);
        let number = |count: Option<usize>| Cell::Number(count.map_or("–".to_owned(), |count| count.to_string()));
        let first = [
            without.step.name().into(),
            Cell::Number(without.changed.len().to_string()),
            number(right.map(|change| change.better.len())),
            number(right.map(|change| change.worse.len())),
            Cell::fixed(right.map_or(f64::NAN, |change| change.p), 2),
        ];
        table = table.row(first.into_iter().chain(cells(&without.figures)));
    }
    let mut what = Table::new("The diagnosis without a step.").column("off", "").column("then", "");
    for without in &ablation.steps {
        what = what.row([without.step.name().into(), without.when_off.into()]);
    }
    let left: Vec<&str> = Step::ALL
        .iter()
        .filter(|step| ablation.steps.iter().all(|w| w.step != **step))
        .map(|step| step.name())
        .collect();
    let report = report.heading("Step by step").table(table).table(what);
    if left.is_empty() { report } else { report.paragraph(format!("Not asked: {}.", left.join(", "))) }
}

/// Formats a rate as "8 of 10".
fn count(rate: &Rate) -> Cell {
    Cell::Number(if rate.of == 0 { "–".to_owned() } else { format!("{} of {}", rate.hits, rate.of) })
}

fn by_name(report: Report, ablation: &Ablation) -> Report {
    let mut table = Table::new("Cases that a step changes, by figure.")
        .column("off", "")
        .column("figure", "")
        .column("of", "")
        .column("better without it", "")
        .column("worse without it", "")
        .column("p", "");
    let mut rows = 0;
    for without in &ablation.steps {
        for change in without.changes.iter().filter(|c| !c.better.is_empty() || !c.worse.is_empty()) {
            table = table.row([
                without.step.name().into(),
                change.figure.into(),
                change.of.into(),
                change.better.join(", ").into(),
                change.worse.join(", ").into(),
                Cell::fixed(change.p, 2),
            ]);
            rows += 1;
        }
    }
    let report = report.heading("Case by case");
    if rows == 0 { report.paragraph("No case changed in any figure that is counted.") } else { report.table(table) }
}
