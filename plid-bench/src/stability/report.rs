//! The content of report.html: the map, the growth of errors, difficult starts, variations, the table, and the
//! numbers of the verdicts.

use itertools::Itertools;
use plid_catalogue::{CovarianceName, ScalarName};
use plid_report::{Axis, Cell as Field, Chart, Report, Series, Table, chart};

use super::classify::{Judged, rule};
use super::grid::{self, Grid, draw};
use super::group::{FACTORED_PEER, MATRIX_PEER, Part, SCALARS, word};
use super::outcome::Outcome;
use super::verdicts::name;

/// The page.
pub fn page(outcome: &Outcome) -> Report {
    let mut report = Report::new("Stability of the covariance forms");
    for claim in &outcome.claims {
        report = report.verdict(format!("{} {}", claim.claim, claim.verdict));
    }
    let steps = outcome.config.steps;
    report = report
        .figure(
            map(outcome),
            format!(
                "The map: the state of each form in each scalar after {steps} steps at the central settings (truss, \
                 3 x 3, sensor noise 0.005 V, moment-matched, P0 = 1, no parameter noise). For a lost cell, the step \
                 is given by which P was found not to be positive definite."
            ),
        )
        .paragraph(rule());
    report = errors(report, outcome);
    report = hard(report, outcome);
    report = variations(report, outcome);
    report = report.heading("Recommended forms").table(recommendations(outcome)).paragraph(
        "plid run and plid identify take the recommended form where an experiment names none. In f64 the direct form \
         is recommended up to the sizes and \
         lengths of this table, P0 / R of 1e8 and without forgetting; beyond that, and in f32 always, Bierman UD (with \
         12 states no form in f32 is sound over 10^5 steps).",
    );
    report = report.heading("Verdicts");
    for claim in &outcome.claims {
        report = report.paragraph(format!("{} {}", claim.claim, claim.verdict));
        report = claim.numbers.iter().fold(report, |report, number| report.paragraph(format!("– {number}")));
    }
    report = report
        .details("Rounding errors of one step, and P at the end", |r| r.table(rounding(outcome)))
        .details("Reference runs in double-double", |r| r.table(references(outcome)))
        .details("All unsound cells and the reasons", |r| r.table(reasons(outcome)))
        .listing(
            "The config. `plid bench stability CONFIG --out DIR` repeats the study.",
            crate::study::to_toml(&outcome.config),
        );
    for (name, value) in outcome.machine.lines() {
        report = report.provenance(name, value);
    }
    report
}

/// Returns form and scalar in the order of all pictures, in which the scalars are separate.
fn pairs() -> Vec<(CovarianceName, ScalarName)> {
    SCALARS.iter().flat_map(|&scalar| CovarianceName::all().into_iter().map(move |form| (form, scalar))).collect()
}

fn field(judged: &Judged) -> grid::Field {
    let note = judged.lost_at.map(|step| format!("step {step}")).unwrap_or_default();
    grid::Field { class: judged.class, note }
}

fn find<'a>(
    cells: &'a [Judged],
    part: Part,
    label: &str,
    states: usize,
    (form, scalar): (CovarianceName, ScalarName),
) -> Option<&'a Judged> {
    cells.iter().find(|j| {
        let cell = &j.cell;
        let group = &cell.group;
        group.part == part
            && group.label == label
            && group.states == states
            && (cell.form, cell.scalar) == (form, scalar)
    })
}

fn map(outcome: &Outcome) -> String {
    let states = &outcome.config.states;
    let row = |pair| states.iter().map(|&n| find(&outcome.cells, Part::Map, "centre", n, pair).map(field)).collect();
    draw(&Grid {
        rows: pairs().iter().map(|&(form, scalar)| name(form, scalar)).collect(),
        columns: states.iter().map(usize::to_string).collect(),
        column_label: "states n".into(),
        fields: pairs().into_iter().map(row).collect(),
    })
}

/// Returns the labels of a part at a size in the order of the config.
fn labels(outcome: &Outcome, part: Part, states: usize) -> Vec<String> {
    let groups = outcome.config.groups_in_order().into_iter().filter(|g| g.part == part && g.states == states);
    groups.map(|group| group.label).unique().collect()
}

/// Draws the classes, with one row per label and one column per form and scalar.
fn by_label(outcome: &Outcome, part: Part, states: usize) -> String {
    let labels = labels(outcome, part, states);
    let row = |label: &String| {
        pairs().into_iter().map(|pair| find(&outcome.cells, part, label, states, pair).map(field)).collect()
    };
    draw(&Grid {
        columns: pairs().iter().map(|&(form, scalar)| format!("{} {}", word(&form), word(&scalar))).collect(),
        column_label: format!("form and scalar, n = {states}"),
        fields: labels.iter().map(row).collect(),
        rows: labels,
    })
}

/// Returns the colour of a form. Single precision is dashed.
fn colour(form: CovarianceName) -> &'static str {
    const COLOURS: [&str; 6] = ["#d55e00", "#e69f00", "#0072b2", "#009e73", "#cc79a7", "#56b4e9"];
    let place = CovarianceName::all().iter().position(|&other| other == form).unwrap_or(0);
    COLOURS[place % COLOURS.len()]
}

fn errors(report: Report, outcome: &Outcome) -> Report {
    let states = &outcome.config.states;
    let shown = states.iter().copied().find(|&n| n >= 24).or(states.last().copied());
    let Some(shown) = shown else { return report };
    let mut both = vec![shown];
    both.extend(states.last().copied().filter(|&n| n != shown));
    let mut report = report.heading("Error relative to exact arithmetic");
    for n in both {
        let curves = |value: &dyn Fn(&super::ErrorAt) -> Option<f64>| -> Vec<Series> {
            pairs()
                .into_iter()
                .filter_map(|pair| {
                    let judged = find(&outcome.cells, Part::Map, "centre", n, pair)?;
                    let points =
                        judged.cell.errors.iter().filter_map(|e| Some((e.step as f64, value(e).filter(|v| *v > 0.0)?)));
                    let line = Series::line(name(pair.0, pair.1), points.collect()).colour(colour(pair.0));
                    Some(if pair.1 == ScalarName::F32 { line.dashed() } else { line })
                })
                .collect()
        };
        let draw = |y: &str, series| {
            chart(&Chart { title: format!("n = {n}"), x: Axis::log("step"), y: Axis::log(y), series, height: 260.0 })
        };
        report = report
            .figure(
                draw("largest |ΔP_ij| / √(P_ii P_jj)", curves(&|e| e.covariance)),
                "The error of P against the same recursion in double-double. A curve ends where the form or the \
                 reference stops.",
            )
            .figure(
                draw("|Δs| / |s|", curves(&|e| Some(e.estimate))),
                "The error of the estimate s of states and \
                parameters against the same reference.",
            );
    }
    report
}

fn hard(report: Report, outcome: &Outcome) -> Report {
    let states = outcome.config.adversarial.states;
    if outcome.config.adversarial.steps == 0 {
        return report;
    }
    report.heading("Adverse initial conditions and records").figure(
        by_label(outcome, Part::Adversarial, states),
        format!(
            "Each over {} steps; wind-up and the jump with forgetting {:.6}.",
            outcome.config.adversarial.steps, outcome.config.adversarial.forgetting
        ),
    )
}

fn variations(report: Report, outcome: &Outcome) -> Report {
    let mut report = report.heading("Variations of one setting");
    for &states in &outcome.config.variations.states {
        report = report
            .figure(by_label(outcome, Part::Variation, states), format!("Each over {} steps.", outcome.config.steps));
    }
    report.table(free_runs(outcome))
}

/// Returns the free-run errors and NEES of the variations.
fn free_runs(outcome: &Outcome) -> Table {
    let mut table = Table::new(
        "Free-run error on an undisturbed record, and NEES of Bierman UD in f64 where the plant is of the model's \
         class (1 for a consistent covariance). A dash marks a form whose P was lost or a simulation that diverged.",
    )
    .column("n", "")
    .column("setting", "");
    // In f64, only the forms with which others are compared are shown.
    let is_shown = |&(form, scalar): &_| scalar == ScalarName::F32 || [FACTORED_PEER, MATRIX_PEER].contains(&form);
    let shown: Vec<_> = pairs().into_iter().filter(is_shown).collect();
    for &(form, scalar) in &shown {
        table = table.column(format!("{} {}", word(&form), word(&scalar)), "%");
    }
    table = table.column("NEES", "");
    let mut row = |part: Part, label: &str, states: usize| {
        let cells: Vec<Option<&Judged>> =
            shown.iter().map(|&pair| find(&outcome.cells, part, label, states, pair)).collect();
        let percent = |j: &Option<&Judged>| {
            let error = j.filter(|j| j.lost_at.is_none()).and_then(|j| j.cell.free_run);
            Field::significant(100.0 * error.unwrap_or(f64::NAN), 3)
        };
        let nees =
            find(&outcome.cells, part, label, states, (FACTORED_PEER, ScalarName::F64)).and_then(|j| j.cell.nees);
        let first: [Field; 2] = [states.into(), label.into()];
        let last = Field::significant(nees.unwrap_or(f64::NAN), 3);
        let cells: Vec<Field> = first.into_iter().chain(cells.iter().map(percent)).chain([last]).collect();
        table = std::mem::take(&mut table).row(cells);
    };
    for &n in &outcome.config.states {
        row(Part::Map, "centre", n);
    }
    for &n in &outcome.config.variations.states {
        for label in labels(outcome, Part::Variation, n) {
            row(Part::Variation, &label, n);
        }
    }
    table
}

fn recommendations(outcome: &Outcome) -> Table {
    let mut table = Table::new("The fastest sound form in this study, and the form that plid recommends.")
        .column("scalar", "")
        .column("n", "")
        .column("steps", "")
        .column("fastest sound form", "")
        .column("recommended", "")
        .column("is it sound", "");
    for line in &outcome.recommended {
        let fastest = line.fastest_sound.map_or("none".into(), |form| word(&form));
        table = table.row([
            word(&line.scalar).into(),
            line.states.into(),
            line.steps.into(),
            Field::from(fastest),
            word(&line.recommended).into(),
            if line.holds { "yes" } else { "no" }.into(),
        ]);
    }
    table
}

fn rounding(outcome: &Outcome) -> Table {
    let mut table = Table::new(
        "At the central settings: the largest scaled change of P due to rounding in one step (including the loss of \
         orthogonality of factored forms), and P at the end.",
    )
    .column("form", "")
    .column("n", "")
    .column("one step", "")
    .column("symmetry defect", "")
    .column("smallest pivot", "")
    .column("lower bound of condition", "")
    .column("response error", "% of peak");
    for (form, scalar) in pairs() {
        for &n in &outcome.config.states {
            let Some(judged) = find(&outcome.cells, Part::Map, "centre", n, (form, scalar)) else { continue };
            let cell = &judged.cell;
            let one_step = cell.local.iter().filter_map(|l| l.covariance).reduce(f64::max);
            let number = |x: Option<f64>| Field::significant(x.unwrap_or(f64::NAN), 2);
            table = table.row([
                name(form, scalar).into(),
                n.into(),
                number(one_step),
                number(Some(cell.symmetry_defect)),
                number(cell.smallest_pivot),
                number(cell.condition),
                number(judged.response.map(|r| 100.0 * r)),
            ]);
        }
    }
    table
}

fn references(outcome: &Outcome) -> Table {
    let mut table = Table::new(
        "The reference in double-double with plain loops: its computing time, and its own error \
        from a comparison of the direct form with Bierman UD.",
    )
    .column("group", "")
    .column("form", "")
    .column("steps", "")
    .column("a step", "µs")
    .column("condition of P's correlations", "")
    .column("error of P", "")
    .column("at step", "");
    for reference in &outcome.references {
        let number = |x: Option<f64>| Field::significant(x.unwrap_or(f64::NAN), 2);
        let own = reference.own_error;
        table = table.row([
            reference.group.as_str().into(),
            word(&reference.form).into(),
            reference.steps.into(),
            Field::fixed(reference.microseconds_per_step, 0),
            number(reference.condition),
            number(own.map(|(_, error)| error)),
            own.map_or("–".into(), |(step, _)| step.into()),
        ]);
    }
    table
}

fn reasons(outcome: &Outcome) -> Table {
    let mut table = Table::new("Why.").column("cell", "").column("class", "").column("why", "");
    for judged in outcome.cells.iter().filter(|j| !j.why.is_empty()) {
        let cell = &judged.cell;
        let key = super::Cell::key(&cell.group, cell.form, cell.scalar);
        table = table.row([key.into(), word(&judged.class).into(), judged.why.as_str().into()]);
    }
    table
}
