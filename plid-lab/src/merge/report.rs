//! The report of a merge: the verdict and the plots, followed by the detailed figures.

use std::borrow::Cow;

use ndarray::Axis as Dimension;
use plid_model::{FrequencyResponse, Mode, ModeDeviation, Model, mode_deviations, modes, response_variance};

use super::carry_out::Outcome;
use super::consistency::{Agreement, LEVEL};
use super::held_out::HeldOut;
use crate::experiment::to_toml;
use crate::run::RunError;
use crate::run::report::{bank, complex, peak_sentence, peak_table};
use plid_report::{
    Cell, FrfCurve, FrfPlot, ModeSet, Report, Scale, Table, Trace, frf_grid, mode_map, percent, trace_plot,
};

/// Number of frequencies at which a model's response is plotted.
const LINES: usize = 400;
/// Number of samples in the time plots.
const WINDOW: usize = 400;
/// Modes weaker than the strongest by more than this, in dB, are omitted from the plot.
const FAINT_DB: f64 = 70.0;
/// Modes are plotted if their damping ratio is below this.
const LIGHT: f64 = 0.05;

/// Returns the page.
pub(super) fn page(outcome: &Outcome) -> Result<String, RunError> {
    let mut report = Report::new(format!("Merge: {}", outcome.name));
    for sentence in verdict(outcome) {
        report = report.verdict(sentence);
    }
    report = report.figure(responses(outcome)?, response_caption(outcome));
    for held_out in &outcome.held_out {
        report = report.figure(
            traces(outcome, held_out),
            format!(
                "The first held-out samples of the record {}: measured and simulated. The lower panel shows the error.",
                held_out.record
            ),
        );
    }
    report = report.warnings(outcome.warnings.iter().cloned()).heading("Consistency of the \
        runs").table(runs(outcome)).paragraph(
        "Scale: the mean square of the settled innovations relative to the value predicted by P and R; the covariance \
         of the run is multiplied by it. Chi-square: the difference between the A of this run and that of all others, \
         weighted by the inverse of its covariance, per degree of freedom; its expected value is 1 if the model has as \
         many states as the plant. Others: the same figure for the other runs among themselves, by which chi-square is \
         divided. Chance: the probability of a larger quotient if all runs share A.",
    );
    for held_out in &outcome.held_out {
        report = report.heading(format!("Simulation of {}", held_out.record)).table(errors(outcome, held_out));
    }
    if !outcome.peaks.is_empty() {
        report = report
            .heading("Identified and true peaks")
            .paragraph(peak_sentence(&outcome.peaks))
            .details(format!("All {} peaks", outcome.peaks.len()), |report| report.table(peak_table(&outcome.peaks)));
    }
    report = with_modes(report, outcome)?;
    if !outcome.bank.is_empty() {
        report = bank(report, &outcome.bank).paragraph(
            "Here each filter of the bank was run on every record, and the \
            merged model simulated the reserved parts of the records.",
        );
    }
    if let Some(experiment) = &outcome.experiment {
        report = report.listing("The experiment. `plid run` repeats it.", to_toml(experiment));
    }
    report = report.provenance("plid", env!("CARGO_PKG_VERSION"));
    for run in &outcome.runs {
        report = report
            .provenance(run.name.clone(), format!("{}, input {}", run.experiment.name, run.model.inputs.join(", ")));
    }
    Ok(report.to_html())
}

/// Returns the verdict as a list of sentences.
pub fn verdict(outcome: &Outcome) -> Vec<String> {
    let model = &outcome.merged.model;
    let mut sentences = vec![format!(
        "{} runs with one input each were merged into one model of {} states and {} inputs.",
        outcome.runs.len(),
        model.n(),
        model.m()
    )];
    for held_out in &outcome.held_out {
        let error = held_out.errors.overall_relative;
        let simulates = if error.is_finite() {
            format!(
                "It simulates held-out data in which all inputs act ({}) with an error of {}",
                held_out.record,
                percent(error)
            )
        } else if error.is_nan() {
            format!("All outputs of {} are constant, so its simulation has no relative error", held_out.record)
        } else {
            format!("It diverges in simulation of {}", held_out.record)
        };
        sentences.push(match &held_out.truth_errors {
            Some(truth) => format!(
                "{simulates}; the true plant has an error of {}, caused by noise that no model can simulate.",
                percent(truth.overall_relative)
            ),
            None => format!("{simulates}."),
        });
    }
    sentences.push(agreement(outcome));
    sentences
}

fn agreement(outcome: &Outcome) -> String {
    let test = &outcome.merged.consistency;
    let spread = format!("chi-square per degree of freedom is {:.2}", test.overdispersion);
    match &test.agreement {
        Agreement::Agree => {
            format!(
                "The runs are consistent with one A: {spread}, and no run differs from the others by more than \
                that explains."
            )
        }
        Agreement::Departs { run } => {
            let chance = test.departures.iter().find(|d| &d.run == run).map_or(f64::NAN, |d| d.p_value);
            format!(
                "The run {run} does not fit the others (chance {chance:.1e}): its plant differs, or its record is \
                 disturbed. Do not use the merged model until the cause is known."
            )
        }
        Agreement::Open => format!(
            "The test of a common A is inconclusive: {spread}. Either the order is too small for the plant, or the \
             plants differ; a third run would decide between them."
        ),
        Agreement::Alone => "There is only one run, so consistency cannot be tested.".into(),
    }
}

fn runs(outcome: &Outcome) -> Table {
    let mut table = Table::new(format!(
        "A run is rejected if the chance is below {:.2e}, a level of 1 % over all runs together.",
        LEVEL / outcome.runs.len() as f64
    ))
    .column("run", "")
    .column("input", "")
    .column("training samples", "")
    .column("own simulation error", "%")
    .column("scale", "")
    .column("chi-square", "")
    .column("degrees of freedom", "")
    .column("others", "")
    .column("chance", "");
    for (run, departure) in outcome.runs.iter().zip(&outcome.merged.consistency.departures) {
        table = table.row([
            run.name.clone().into(),
            run.model.inputs.join(", ").into(),
            run.training_samples.into(),
            Cell::significant(100.0 * run.free_run.unwrap_or(f64::INFINITY), 3),
            Cell::significant(run.estimate.innovation_ratio, 3),
            Cell::significant(departure.ratio(), 3),
            Cell::fixed(departure.effective, 1),
            departure.overdispersion.map_or("".into(), |others| Cell::significant(others, 3)),
            Cell::significant(departure.p_value, 2),
        ]);
    }
    table
}

fn errors(outcome: &Outcome, held_out: &HeldOut) -> Table {
    let mut table = Table::new(
        "Errors on the held-out part. Relative: RMS of the error over RMS of the output about \
        its mean. Fit: as MATLAB's compare.",
    )
    .column("output", "")
    .column("free run", "%")
    .column("fit", "%");
    if held_out.one_step_errors.is_some() {
        table = table.column("one step", "%");
    }
    if held_out.truth_errors.is_some() {
        table = table.column("true plant", "%");
    }
    for (i, name) in outcome.merged.model.outputs.iter().enumerate() {
        let mut row: Vec<Cell> = vec![
            name.clone().into(),
            Cell::significant(100.0 * held_out.errors.relative[i], 3),
            Cell::fixed(held_out.errors.fit_percent[i], 1),
        ];
        row.extend(
            held_out
                .one_step_errors
                .iter()
                .chain(&held_out.truth_errors)
                .map(|errors| Cell::significant(100.0 * errors.relative[i], 3)),
        );
        table = table.row(row);
    }
    let mut row: Vec<Cell> =
        vec!["all".into(), Cell::significant(100.0 * held_out.errors.overall_relative, 3), "".into()];
    row.extend(
        held_out
            .one_step_errors
            .iter()
            .chain(&held_out.truth_errors)
            .map(|errors| Cell::significant(100.0 * errors.overall_relative, 3)),
    );
    table.row(row)
}

fn traces(outcome: &Outcome, held_out: &HeldOut) -> String {
    let columns: Vec<[Vec<f64>; 2]> = (0..held_out.measured.ncols())
        .map(|i| [&held_out.measured, &held_out.free_run].map(|array| array.index_axis(Dimension(1), i).to_vec()))
        .collect();
    let unit = outcome.runs[0].experiment.data.output_unit.clone().unwrap_or_default();
    let traces: Vec<Trace<'_>> = columns
        .iter()
        .zip(&outcome.merged.model.outputs)
        .map(|([measured, free_run], name)| Trace {
            name: name.clone(),
            unit: unit.clone(),
            measured,
            predicted: None,
            free_run: held_out.errors.overall_relative.is_finite().then_some(free_run.as_slice()),
        })
        .collect();
    trace_plot(&traces, held_out.sample_rate_hz, 0..WINDOW.min(held_out.measured.nrows()))
}

/// Returns the frequency band of the plots, which is that of a run's config or the whole range.
fn band(outcome: &Outcome) -> (f64, f64) {
    let given = outcome.runs.iter().find_map(|run| run.experiment.validation.band_hz);
    given.map_or((0.0, 0.5 * outcome.merged.model.sample_rate_hz), |[low, high]| (low, high))
}

fn responses(outcome: &Outcome) -> Result<String, RunError> {
    let merged = &outcome.merged;
    let model = Model { parameter_covariance: merged.canonical.parameter_covariance.clone(), ..merged.model.clone() };
    let (low, high) = band(outcome);
    let top = high.min(0.4999 * model.sample_rate_hz);
    let bottom = low.max(top * 1e-4);
    let hz: Vec<f64> = (0..LINES).map(|k| bottom + (top - bottom) * k as f64 / (LINES - 1) as f64).collect();
    let variances = response_variance(&model, &hz, merged.advanced as u32)?;
    let truth = outcome.truth.as_ref().map(|truth| FrequencyResponse::of(&truth.model));
    let data = &outcome.runs[0].experiment.data;
    let unit = match (&data.output_unit, &data.input_unit) {
        (Some(output), Some(input)) => format!("{output}/{input}"),
        _ => "output/input".into(),
    };
    let plain = |response| FrfCurve { frequency_hz: hz.clone(), response, std: None };
    let mut plots = Vec::new();
    for (i, output) in model.outputs.iter().enumerate() {
        for (j, input) in model.inputs.iter().enumerate() {
            let own = outcome
                .runs
                .iter()
                .find_map(|run| Some((run, run.model.inputs.iter().position(|name| name == input)?)));
            let beside = own.map(|(run, column)| {
                // The model of a run has its input advanced.
                let undone = match merged.advanced {
                    1 => plid_model::undo_advance(&run.model, None).map_or(Cow::Borrowed(&run.model), Cow::Owned),
                    _ => Cow::Borrowed(&run.model),
                };
                let response = FrequencyResponse::of(&undone);
                ("its own run".to_string(), plain(hz.iter().map(|&f| complex(response.at(f)[(i, column)])).collect()))
            });
            plots.push(FrfPlot {
                title: format!("{input} to {output}"),
                unit: unit.clone(),
                identified: Some(FrfCurve {
                    frequency_hz: hz.clone(),
                    response: variances.iter().map(|v| complex(v.response[(i, j)])).collect(),
                    std: Some(variances.iter().map(|v| v.magnitude_std()[(i, j)]).collect()),
                }),
                others: beside.into_iter().collect(),
                truth: truth.as_ref().map(|truth| plain(hz.iter().map(|&f| complex(truth.at(f)[(i, j)])).collect())),
                frequency_scale: Scale::Linear,
                range_hz: Some((low, high)),
                ..FrfPlot::default()
            });
        }
    }
    Ok(frf_grid(model.m(), &plots))
}

fn response_caption(outcome: &Outcome) -> String {
    let truth = if outcome.truth.is_some() { ", and the true plant" } else { "" };
    let spread = outcome.merged.consistency.overdispersion.sqrt();
    let narrow = if spread > 1.2 {
        format!(
            " The runs disagree by more than their covariances allow, so the uncertainty is {spread:.1} times as \
            large as the band."
        )
    } else {
        String::new()
    };
    format!(
        "Frequency responses of every input-output pair: merged (identified), with a band of two standard deviations, \
         and the run in which the input acts{truth}.{narrow}"
    )
}

/// Adds the modes of the merged model, of each run and of the true plant.
fn with_modes(report: Report, outcome: &Outcome) -> Result<Report, RunError> {
    let (low, high) = band(outcome);
    let visible = |all: &[Mode], mode: &Mode| {
        let strongest = all.iter().map(Mode::strongest_db).fold(f64::NEG_INFINITY, f64::max);
        mode.strongest_db() > strongest - FAINT_DB && (low..=high).contains(&mode.hz) && mode.damping < LIGHT
    };
    let set = |label: &str, deviations: &[ModeDeviation]| {
        let all: Vec<Mode> = deviations.iter().map(|d| d.mode.clone()).collect();
        let drawn: Vec<&ModeDeviation> = deviations.iter().filter(|d| visible(&all, &d.mode)).collect();
        ModeSet {
            label: label.into(),
            frequency_hz: drawn.iter().map(|d| d.mode.hz).collect(),
            damping: drawn.iter().map(|d| d.mode.damping).collect(),
            std: Vec::new(),
        }
    };
    let mut sets = vec![set("merged", &mode_deviations(&outcome.merged.canonical)?)];
    for run in &outcome.runs {
        sets.push(set(&run.name, &mode_deviations(&run.model)?));
    }
    if let Some(truth) = &outcome.truth {
        let all = modes(&truth.model)?;
        let drawn: Vec<&Mode> = all.iter().filter(|mode| visible(&all, mode)).collect();
        sets.push(ModeSet {
            label: "true plant".into(),
            frequency_hz: drawn.iter().map(|mode| mode.hz).collect(),
            damping: drawn.iter().map(|mode| mode.damping).collect(),
            std: Vec::new(),
        });
    }
    if sets[0].frequency_hz.is_empty() {
        return Ok(report);
    }
    Ok(report.heading("Modes").figure(
        mode_map(&sets),
        "Lightly damped modes: frequency and damping ratio of the merged model and of each run.",
    ))
}
