//! The page with NEES, accuracy and free-run error against the signal-to-noise ratio, followed by the numbers.

use plid_report::{Axis, Cell, Chart, Report, Series, Table, chart};

use super::cell::{DEFAULT, Finished, Score};
use super::config::{Config, Plant};
use super::statistics::Figure;
use super::table::band;
use super::verdict::{best_sigma, names, score, sentences, standings};
use crate::study::Machine;

const HEIGHT: f64 = 260.0;
const SNR: &str = "signal-to-noise ratio (RMS over RMS)";

/// Returns the report of a finished study.
pub fn page(config: &Config, cells: &[Finished], machine: &Machine, text: &str) -> Report {
    let mut report = Report::new("Comparison of the conditional expectations");
    for sentence in sentences(cells) {
        report = report.verdict(sentence);
    }
    for plant in config.plants() {
        let name = plant.name();
        let own: Vec<&Finished> = cells.iter().filter(|cell| cell.plant == name).collect();
        report = match plant {
            Plant::Truss(_) => truss(report, &name, cells, &own),
            _ => in_class(report, config, &name, &own),
        };
    }
    report = report.table(summary(cells)).details("All figures", |report| {
        config.plants().fold(report, |report, plant| {
            let name = plant.name();
            report.table(figures(&name, cells.iter().filter(|cell| cell.plant == name)))
        })
    });
    report = report.listing("The config that repeats this report:", text);
    machine.lines().into_iter().fold(report, |report, (name, value)| report.provenance(name, value))
}

/// Returns one line with markers per method over the signal-to-noise ratios of `cells`.
fn line(
    cells: &[&Finished],
    method: &str,
    label: &str,
    of: impl Fn(&Score) -> Option<Figure>,
) -> Vec<(String, Vec<(f64, f64)>)> {
    let points: Vec<(f64, f64)> =
        cells.iter().filter_map(|cell| Some((cell.signal_to_noise, of(score(cell, method)?)?.value))).collect();
    if points.is_empty() { Vec::new() } else { vec![(label.to_string(), points)] }
}

fn draw(title: String, x: &str, y: &str, before: Vec<Series>, lines: Vec<(String, Vec<(f64, f64)>)>) -> String {
    let mut series = before;
    series.extend(lines.into_iter().map(|(label, points)| Series::line(label, points)));
    chart(&Chart { title, x: Axis::log(x), y: Axis::log(y), series, height: HEIGHT })
}

fn one() -> Series {
    Series::level("", 1.0).colour("#8f8f8f")
}

fn in_class(mut report: Report, config: &Config, name: &str, own: &[&Finished]) -> Report {
    let right: Vec<&Finished> = own.iter().copied().filter(|cell| cell.sigma == 1.0).collect();
    let consistent: Vec<(f64, f64, f64)> = right
        .iter()
        .filter_map(|cell| band(config, cell).map(|(low, high)| (cell.signal_to_noise, low, high)))
        .collect();
    let with = |cells: &[&Finished], more: &[&str], of: &dyn Fn(&Score) -> Option<Figure>| {
        let all = names().into_iter().chain(more.iter().copied());
        all.flat_map(|method| line(cells, method, method, of)).collect::<Vec<_>>()
    };
    report = report.heading(name.to_string());
    if !right.is_empty() {
        let before = vec![Series::band("consistent, 95 %", consistent).colour("#8f8f8f"), one()];
        report = report.figure(
            draw(
                format!("{name}: honesty"),
                SNR,
                "NEES / parameters",
                before,
                with(&right, &["exact-bayes"], &|s| s.nees),
            ),
            "Normalised estimation error squared over the number of parameters, with the true Sigma. Values above one \
             mean overconfidence.",
        );
        // The batch estimates without a prior or with biased equations are only in the table, because they would
        // determine the range of the axis.
        let batch = ["batch-maximum-posterior", "batch-maximum-likelihood"];
        let reference = right[0].reference.clone().unwrap_or_default();
        let lines = with(&right, &batch, &|s| s.rmse_a_over_reference);
        report = report.figure(
            draw(format!("{name}: accuracy"), SNR, &format!("rmse of a over {reference}"), vec![one()], lines),
            "Root mean square error of A's parameters over that of the reference on the same runs, with the true \
             Sigma.",
        );
    }
    let mut lines = with(&right, &[], &|s| s.free_run_over_default);
    let mut others: Vec<f64> = own.iter().map(|cell| cell.sigma).filter(|&sigma| sigma != 1.0).collect();
    others.dedup();
    for sigma in others {
        let point = |cell: &Finished| {
            let other = own.iter().find(|o| o.sigma == sigma && o.signal_to_noise == cell.signal_to_noise)?;
            let free_run = |cell: &Finished| Some(score(cell, DEFAULT.name())?.free_run?.value);
            Some((cell.signal_to_noise, free_run(other)? / free_run(cell)?))
        };
        let points = right.iter().filter_map(|cell| point(cell)).collect();
        lines.push((format!("{}, Sigma x {sigma}", DEFAULT.name()), points));
    }
    report.figure(
        draw(
            format!("{name}: simulation"),
            SNR,
            &format!("simulation error over that of {}", DEFAULT.name()),
            vec![one()],
            lines,
        ),
        "Error of the model's free run on inputs not seen against the true response without noise, over that of the \
         default with the true \
         Sigma: the five with the true Sigma, and the default with another one.",
    )
}

fn truss(report: Report, name: &str, cells: &[Finished], own: &[&Finished]) -> Report {
    let mut ratios: Vec<f64> = own.iter().map(|cell| cell.signal_to_noise).collect();
    ratios.dedup();
    ratios.truncate(ratios.iter().skip(1).position(|r| *r == ratios[0]).map_or(ratios.len(), |k| k + 1));
    let free_run = |cell: &Finished, method: &str| score(cell, method).and_then(|s| s.free_run).map(|f| f.value);
    let best: Vec<(String, Vec<(f64, f64)>)> = names()
        .into_iter()
        .map(|method| {
            let point = |&snr: &f64| Some((snr, free_run(best_sigma(cells, name, snr, method)?, method)?));
            (format!("{method}, best Sigma"), ratios.iter().filter_map(point).collect())
        })
        .collect();
    let large: Vec<(String, Vec<(f64, f64)>)> = names()
        .into_iter()
        .map(|method| {
            let point = |&snr: &f64| {
                let best = best_sigma(cells, name, snr, method)?.sigma;
                let cell =
                    own.iter().find(|c| c.signal_to_noise == snr && (c.sigma / best / 100.0 - 1.0).abs() < 1e-6)?;
                Some((snr, free_run(cell, method)?))
            };
            (format!("{method}, Sigma x 100"), ratios.iter().filter_map(point).collect())
        })
        .filter(|(_, points): &(String, Vec<_>)| !points.is_empty())
        .collect();
    let batch = ["batch-maximum-posterior", "batch-least-squares"];
    let mut lines = best;
    lines.extend(batch.iter().flat_map(|method| line(own, method, method, |s| s.free_run)));
    let y = "free-run error, relative";
    let mut report = report.heading(name.to_string()).figure(
        draw(format!("{name}: best Sigma for each"), SNR, y, vec![], lines),
        "Free-run error on a held-out record against the true response without noise, at the Sigma / R of the \
             study at which each does best; \
             and of batch estimates.",
    );
    if !large.is_empty() {
        report = report.figure(
            draw(format!("{name}: Sigma 100 times too large"), SNR, y, vec![], large),
            "The free-run error with 100 times the best Sigma of each expectation, where this was run.",
        );
    }
    for snr in [ratios.first(), ratios.get(ratios.len() / 2), ratios.last()].into_iter().flatten() {
        let lines = names()
            .into_iter()
            .map(|method| {
                let here = own.iter().filter(|cell| cell.signal_to_noise == *snr);
                (method.to_string(), here.filter_map(|cell| Some((cell.sigma, free_run(cell, method)?))).collect())
            })
            .collect();
        report = report.figure(
            draw(format!("{name}: signal-to-noise ratio {snr}"), "assumed Sigma / R", y, vec![], lines),
            "Simulation error against the Sigma that the filter assumes.",
        );
    }
    report
}

fn number(value: Option<f64>, digits: usize) -> Cell {
    value.map_or(Cell::from("–"), |v| Cell::significant(v, digits))
}

fn interval(value: Option<(f64, f64)>) -> Cell {
    value.map_or(Cell::from("–"), |(low, high)| Cell::Number(format!("{low:.2} – {high:.2}")))
}

fn summary(cells: &[Finished]) -> Table {
    let caption = "The five over all cells. Free run: geometric mean of the ratio to the default, with the true Sigma, \
        and for the truss with the \
                   Sigma at which each does best. Failed: lost, or of a model that is worse than none.";
    let mut table = Table::new(caption)
        .column("expectation", "")
        .column("NEES, true Sigma", "least – largest")
        .column("factor between NEES and one", "mean")
        .column("rmse of a over the reference", "least – largest")
        .column("simulation error over default, in class", "")
        .column("simulation error over default, truss", "")
        .column("failed runs", "");
    for s in standings(cells) {
        table = table.row([
            Cell::from(s.name),
            interval(s.nees),
            number(s.miss, 3),
            interval(s.rmse_a),
            number(s.free_run_in_class, 4),
            number(s.free_run_truss, 4),
            Cell::from(s.failed),
        ]);
    }
    table
}

fn figures<'a>(name: &str, cells: impl Iterator<Item = &'a Finished>) -> Table {
    let sigma = if name.starts_with("truss") { "assumed Sigma / R" } else { "assumed Sigma / true Sigma" };
    let mut table = Table::new(format!("{name}: figures with one standard error."))
        .column("signal to noise", "")
        .column(sigma, "")
        .column("method", "")
        .column("lost", "runs")
        .column("useless", "runs")
        .column("NEES", "")
        .column("NEES of a", "")
        .column("rmse of a", "")
        .column("over reference", "")
        .column("free run", "")
        .column("over default", "");
    let with = |figure: Option<Figure>| figure.map_or(Cell::from("–"), |f| Cell::with_std(f.value, f.error));
    for cell in cells {
        for s in &cell.scores {
            table = table.row([
                Cell::significant(cell.signal_to_noise, 3),
                Cell::significant(cell.sigma, 2),
                Cell::from(s.method.clone()),
                Cell::from(s.lost),
                Cell::from(s.useless),
                with(s.nees),
                with(s.nees_a),
                with(s.rmse_a),
                with(s.rmse_a_over_reference),
                with(s.free_run),
                with(s.free_run_over_default),
            ]);
        }
    }
    table
}
