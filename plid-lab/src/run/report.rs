//! The report of a run: the verdict and the plots, followed by the detailed figures.

use nalgebra::DMatrix;
use num_complex::Complex64;

use super::error::RunError;
use super::report_simulation;
use super::simulation::Aligned;
use super::validate::{Errors, Shown};
use super::{Outcome, PeakRow};
use crate::experiment::to_toml;
use crate::identify::Trial;
use plid_data::Record;
use plid_model::signal::{Correlation, WelchFrf, WelchOptions, convergence, welch_frf};
use plid_model::{FrequencyResponse, Mode, mode_deviations, response_variance};
use plid_report::{
    Axis, Cell, Chart, ConvergencePlot, FrfCurve, FrfPlot, ModeSet, Report, Scale, Series, Table, Trace, chart,
    convergence_plot, correlation_plot, frf_grid, mode_map, percent, trace_plot,
};

/// Number of frequencies at which a model's response is plotted.
const LINES: usize = 400;
/// Largest number of inputs, and of outputs, whose pairs are plotted. More panels side by side cannot be read.
const DRAWN: usize = 6;
/// Modes weaker than the strongest by more than this, in dB, are omitted from the plot; the table lists all of them.
const FAINT_DB: f64 = 70.0;

/// Modes are plotted if their damping ratio is below this; poles with more damping have no resonance peak.
const LIGHT: f64 = 0.05;

/// Returns the page, and its first figure as a separate document.
pub(super) fn page(outcome: &Outcome) -> Result<(String, String), RunError> {
    let record = &outcome.prepared.records[outcome.prepared.records.len() - 1];
    let rate = record.sample_rate_hz;
    let measured = measured_response(outcome, rate);
    let band = band(outcome, rate);

    let mut report = Report::new(format!("Identification: {}", outcome.experiment.name));
    for sentence in verdict(outcome) {
        report = report.verdict(sentence);
    }
    let responses = responses(outcome, measured.as_ref(), band)?;
    report = report.figure(responses.clone(), response_caption(outcome, measured.as_ref()));
    report = convergence_figure(report, outcome, rate);
    report = traces(report, outcome, record, rate);
    report = report
        .warnings(outcome.warnings.iter().cloned())
        .advice(outcome.advice.iter().cloned())
        .heading("Errors on held-out data")
        .table(error_table(outcome));
    report = report_simulation::section(report, outcome, measured.as_ref(), band)?;
    if !outcome.peaks.is_empty() {
        report = report
            .heading("Identified and true peaks")
            .paragraph(peak_sentence(&outcome.peaks))
            .details(format!("All {} peaks", outcome.peaks.len()), |report| report.table(peak_table(&outcome.peaks)));
    }
    report = modes(report, outcome)?;
    report = residuals(report, outcome);
    report = searches(report, outcome);
    report = report
        .details("Preparation, noise and covariance", |report| preparation(report, outcome))
        .listing("The experiment with all defaults. `plid run` repeats it.", to_toml(&outcome.experiment))
        .provenance("plid", env!("CARGO_PKG_VERSION"));
    for source in &outcome.sources {
        report = report.provenance(source.file.clone(), format!("SHA-256 {}", source.sha256));
    }
    Ok((report.to_html(), responses))
}

fn convergence_figure(report: Report, outcome: &Outcome, rate: f64) -> Report {
    let validation = &outcome.validation;
    let errors = match validation.innovations.last() {
        Some(own) => convergence(own.view(), 200),
        None => convergence(ndarray::Array2::zeros((0, 1)).view(), 1),
    };
    report.figure(
        convergence_plot(&ConvergencePlot {
            convergence: &errors,
            sample_rate_hz: rate,
            unit: outcome
                .experiment
                .data
                .output_unit
                .clone()
                .filter(|unit| !unit.is_empty())
                .unwrap_or("data's unit".into()),
            noise_floor: None,
            time_scale: Scale::Linear,
            error_scale: Scale::Log,
        }),
        format!(
            "Convergence (compare Fig. 6 of the paper): the largest absolute one-step error over the outputs at each \
             sample. From {:.2} s on the model is fixed.",
            validation.training as f64 / rate
        ),
    )
}

/// The first held-out samples of every output.
fn traces(report: Report, outcome: &Outcome, record: &Record, rate: f64) -> Report {
    let validation = &outcome.validation;
    let unit = outcome.experiment.data.output_unit.clone().unwrap_or_default();
    let Shown { measured, predicted, free_run } = &validation.shown;
    let shown = validation.training..validation.training + measured.nrows();
    let free_run = Some(free_run).filter(|_| validation.free_run_errors.overall_relative.is_finite());
    let columns: Vec<[Option<Vec<f64>>; 3]> = (0..record.output_names.len())
        .map(|i| [Some(measured), predicted.as_ref(), free_run].map(|array| array.map(|a| a.column(i).to_vec())))
        .collect();
    let traces: Vec<Trace<'_>> = columns
        .iter()
        .zip(&record.output_names)
        .map(|([measured, predicted, free_run], name)| Trace {
            name: name.clone(),
            unit: unit.clone(),
            measured: measured.as_deref().unwrap_or_default(),
            predicted: predicted.as_deref(),
            free_run: free_run.as_deref(),
        })
        .collect();
    report.figure(
        trace_plot(&traces, rate, shown),
        "The first held-out samples: measured, predicted one step ahead, and simulated from the last training state. \
         The lower panel shows the errors.",
    )
}

/// The preparation of the data, the noise covariances, and the state of P at the end.
fn preparation(report: Report, outcome: &Outcome) -> Report {
    let health = &outcome.health;
    report
        .paragraph(if outcome.steps.is_empty() {
            "The data were used without preparation.".into()
        } else {
            format!("{}.", outcome.steps.join("; "))
        })
        .paragraph(advance_sentence(outcome))
        .paragraph(format!(
            "Noise covariances, for channels scaled to unit RMS: R_ii = {}, mean Sigma_ii = {:.2e}.",
            outcome.noise_levels.0.iter().map(|x| format!("{x:.2e}")).collect::<Vec<_>>().join(", "),
            outcome.noise_levels.1
        ))
        .paragraph(format!(
            "Covariance at the end: smallest pivot {:.2e} (entry {} of s), condition at least {:.1e}, symmetry \
                     defect {:.1e}.",
            health.smallest_pivot, health.index, health.condition, health.symmetry_defect
        ))
}

fn verdict(outcome: &Outcome) -> Vec<String> {
    let validation = &outcome.validation;
    let states: usize = outcome.form.indices().iter().sum();
    let free_run = validation.free_run_errors.overall_relative;
    if free_run.is_nan() {
        return vec![format!("A model of {states} states cannot be judged: all held-out outputs are constant.")];
    }
    let simulated = if free_run.is_finite() {
        format!("simulates held-out data with an error of {}", percent(free_run))
    } else {
        "diverges in simulation of held-out data".into()
    };
    let predicted = match &validation.one_step_errors {
        Some(errors) => format!("predicts them one step ahead with {}", percent(errors.overall_relative)),
        None => "has no stable one-step predictor".into(),
    };
    let mut sentences = vec![format!(
        "A model of {states} states {simulated} and {predicted} (RMS of the error over RMS of the output)."
    )];
    if let Some(truth) = &validation.truth_errors {
        sentences.push(format!(
            "The true plant has an error of {}, caused by noise that no model can simulate. The error of the \
             identified model is {:.3} times that.",
            percent(truth.overall_relative),
            free_run / truth.overall_relative
        ));
    } else if let Some(floor) = &validation.noise_floor {
        let floor = (floor.iter().map(|x| x * x).sum::<f64>() / floor.len() as f64).sqrt();
        sentences.push(format!("The noise floor estimated from the repeats is {}.", percent(floor)));
    }
    sentences.extend(report_simulation::verdict(outcome));
    sentences
}

fn advance_sentence(outcome: &Outcome) -> String {
    match (outcome.prepared.advanced, outcome.model.d.iter().any(|&d| d != 0.0)) {
        (1, _) => {
            "The plant has feedthrough (as from a force to an acceleration), so the input was advanced by one sample \
             for \
             the identification; the model was converted back and has the corresponding D."
                .into()
        }
        _ => "The plant has no feedthrough: D is zero.".into(),
    }
}

/// Returns the frequency band of the response plots, which is that of the config or the band that contains 99.9 % of
/// the power of the inputs.
pub(super) fn band(outcome: &Outcome, rate: f64) -> (f64, f64) {
    if let Some([low, high]) = outcome.experiment.validation.band_hz {
        return (low, high);
    }
    let bands = &outcome.prepared.bands[0];
    let low = bands.iter().map(|b| b.low_hz).fold(f64::INFINITY, f64::min);
    let high = bands.iter().map(|b| b.high_hz).fold(0.0, f64::max);
    if low.is_finite() && high > low {
        ((0.8 * low).max(0.0), (1.25 * high).min(0.5 * rate))
    } else {
        (0.0, 0.5 * rate)
    }
}

fn measured_response(outcome: &Outcome, rate: f64) -> Option<WelchFrf> {
    let prepared = &outcome.prepared;
    let record = Aligned::of(prepared, prepared.records.len() - 1);
    let options = WelchOptions { sample_rate_hz: rate, segment_length: None };
    // A record that is too short or has too many gaps for a spectrum still gets a report.
    let scaled = welch_frf(record.inputs, record.outputs.view(), &options).ok()?;
    Some(scaled.in_units(&prepared.input_scales, &prepared.output_scales))
}

fn response_caption(outcome: &Outcome, measured: Option<&WelchFrf>) -> String {
    let truth = if outcome.truth.is_some() { ", and the true plant" } else { "" };
    let measured = match measured {
        Some(frf) => format!(
            "measured (Welch, {} segments of {} samples; coherence above)",
            frf.segments_used, frf.segment_length
        ),
        None => "no measured response (the record is too short)".into(),
    };
    format!(
        "Frequency responses of every input-output pair: {measured}; identified, with a band of two standard \
         deviations{truth}.{}",
        undrawn(outcome)
    )
}

fn responses(outcome: &Outcome, measured: Option<&WelchFrf>, band: (f64, f64)) -> Result<String, RunError> {
    let hz = lines(outcome, band);
    let advance = outcome.prepared.advanced as u32;
    let with_covariance = plid_model::Model {
        parameter_covariance: outcome.canonical.parameter_covariance.clone(),
        ..outcome.model.clone()
    };
    let variances = response_variance(&with_covariance, &hz, advance)?;
    let truth = outcome.truth.as_ref().map(|truth| over(&truth.model, &hz));
    let mut plots = Vec::new();
    let (outputs, inputs) = drawn(outcome);
    for i in 0..outputs {
        for j in 0..inputs {
            let identified = FrfCurve {
                frequency_hz: hz.clone(),
                response: variances.iter().map(|v| complex(v.response[(i, j)])).collect(),
                std: Some(variances.iter().map(|v| v.magnitude_std()[(i, j)]).collect()),
            };
            plots.push(FrfPlot {
                identified: Some(identified),
                truth: truth.as_ref().map(|truth| curve(&hz, truth, (i, j))),
                ..measured_pair(outcome, measured, band, (i, j))
            });
        }
    }
    Ok(frf_grid(inputs, &plots))
}

/// Returns the numbers of outputs and inputs that are plotted, which are the first ones.
pub(super) fn drawn(outcome: &Outcome) -> (usize, usize) {
    (outcome.model.p().min(DRAWN), outcome.model.m().min(DRAWN))
}

/// Returns a sentence on the pairs that are not plotted, or nothing.
pub(super) fn undrawn(outcome: &Outcome) -> String {
    let (outputs, inputs) = drawn(outcome);
    if outputs == outcome.model.p() && inputs == outcome.model.m() {
        return String::new();
    }
    format!(
        " Plotted are the first {outputs} of {} outputs and {inputs} of {} inputs.",
        outcome.model.p(),
        outcome.model.m()
    )
}

/// Returns the response of a model (p x m) at frequencies in Hz.
pub(super) fn over(model: &plid_model::Model, hz: &[f64]) -> Vec<DMatrix<Complex64>> {
    let response = FrequencyResponse::of(model);
    hz.iter().map(|&f| response.at(f)).collect()
}

/// Returns the frequencies at which models are plotted, in Hz.
pub(super) fn lines(outcome: &Outcome, (low, high): (f64, f64)) -> Vec<f64> {
    let top = high.min(0.4999 * outcome.model.sample_rate_hz);
    let bottom = low.max(top * 1e-4);
    (0..LINES).map(|k| bottom + (top - bottom) * k as f64 / (LINES - 1) as f64).collect()
}

/// Returns one pair of a response, without an uncertainty band.
pub(super) fn curve(hz: &[f64], response: &[DMatrix<Complex64>], pair: (usize, usize)) -> FrfCurve {
    FrfCurve { frequency_hz: hz.to_vec(), response: response.iter().map(|h| h[pair]).collect(), std: None }
}

/// Returns the plot of output i and input j with the measured response, without a model.
pub(super) fn measured_pair(
    outcome: &Outcome,
    measured: Option<&WelchFrf>,
    (low, high): (f64, f64),
    (i, j): (usize, usize),
) -> FrfPlot {
    let data = &outcome.experiment.data;
    let unit = match (&data.output_unit, &data.input_unit) {
        (Some(output), Some(input)) => format!("{output}/{input}"),
        _ => "output/input".into(),
    };
    // Points outside the plotted range are dropped to keep the file small.
    let shown = measured.map_or(0..0, |frf| {
        let count = |limit: f64| frf.frequency_hz.iter().take_while(|f| **f < limit).count();
        count(low)..count(high.next_up())
    });
    FrfPlot {
        title: format!("{} to {}", outcome.model.inputs[j], outcome.model.outputs[i]),
        unit,
        measured: measured.map(|frf| FrfCurve {
            frequency_hz: frf.frequency_hz[shown.clone()].to_vec(),
            response: frf.response.slice(ndarray::s![shown.clone(), i, j]).to_vec(),
            std: None,
        }),
        coherence: measured.map(|frf| frf.multiple_coherence.slice(ndarray::s![shown, i]).to_vec()),
        frequency_scale: Scale::Linear,
        range_hz: Some((low, high)),
        ..FrfPlot::default()
    }
}

pub(crate) fn complex(z: nalgebra::Complex<f64>) -> Complex64 {
    Complex64::new(z.re, z.im)
}

fn error_table(outcome: &Outcome) -> Table {
    let validation = &outcome.validation;
    let mut table = Table::new(
        "Errors on the held-out part, which was not used for training. Relative: RMS of the error \
        over RMS of the output about its mean. Fit: as MATLAB's compare.",
    )
    .column("output", "")
    .column("one-step", "%")
    .column("free run", "%")
    .column("free-run fit", "%");
    if validation.truth_errors.is_some() {
        table = table.column("true plant", "%");
    }
    if validation.noise_floor.is_some() {
        table = table.column("noise floor", "%");
    }
    let relative =
        |errors: Option<&Errors>, i: usize| Cell::significant(errors.map_or(f64::NAN, |e| 100.0 * e.relative[i]), 3);
    for (i, name) in outcome.model.outputs.iter().enumerate() {
        let free_run = &validation.free_run_errors;
        let mut row = vec![
            name.clone().into(),
            relative(validation.one_step_errors.as_ref(), i),
            relative(Some(free_run), i),
            Cell::fixed(free_run.fit_percent[i], 1),
        ];
        if let Some(truth) = &validation.truth_errors {
            row.push(relative(Some(truth), i));
        }
        if let Some(floor) = &validation.noise_floor {
            row.push(Cell::significant(100.0 * floor[i], 3));
        }
        table = table.row(row);
    }
    let overall =
        |errors: Option<&Errors>| Cell::significant(errors.map_or(f64::NAN, |e| 100.0 * e.overall_relative), 3);
    let mut row = vec![
        "all".into(),
        overall(validation.one_step_errors.as_ref()),
        overall(Some(&validation.free_run_errors)),
        "".into(),
    ];
    if validation.truth_errors.is_some() {
        row.push(overall(validation.truth_errors.as_ref()));
    }
    table.row(row)
}

pub(crate) fn peak_sentence(peaks: &[PeakRow]) -> String {
    let largest = |errors: &mut dyn Iterator<Item = Option<f64>>| errors.flatten().map(f64::abs).fold(0.0, f64::max);
    let missed = peaks.iter().filter(|row| row.model.is_none()).count();
    let rest = if missed == 0 { "none is missing".to_string() } else { format!("{missed} are missing") };
    format!(
        "Of {} true peaks of the dominant modes {rest} in the identified model; the largest errors are {:.4} % in \
         frequency and {:.2} dB in height.",
        peaks.len(),
        100.0 * largest(&mut peaks.iter().map(|row| row.frequency_error())),
        largest(&mut peaks.iter().map(|row| row.height_error_db()))
    )
}

pub(crate) fn peak_table(peaks: &[PeakRow]) -> Table {
    let mut table = Table::new(
        "Peaks of |H| near the dominant modes, for each pair whose true response has a local maximum there.",
    )
    .column("mode", "Hz")
    .column("pair", "")
    .column("true peak", "Hz")
    .column("", "dB")
    .column("identified", "Hz")
    .column("", "dB")
    .column("frequency error", "%")
    .column("height error", "dB");
    for row in peaks {
        let (hz, db) = row.model.unwrap_or((f64::NAN, f64::NAN));
        table = table.row([
            Cell::fixed(row.mode_hz, 1),
            format!("{} to {}", row.input, row.output).into(),
            Cell::fixed(row.truth.0, 3),
            Cell::fixed(row.truth.1, 2),
            Cell::fixed(hz, 3),
            Cell::fixed(db, 2),
            Cell::fixed(100.0 * row.frequency_error().unwrap_or(f64::NAN), 4),
            Cell::fixed(row.height_error_db().unwrap_or(f64::NAN), 3),
        ]);
    }
    table
}

fn modes(report: Report, outcome: &Outcome) -> Result<Report, RunError> {
    let deviations = mode_deviations(&outcome.canonical)?;
    let strongest = deviations.iter().map(|d| d.mode.strongest_db()).fold(f64::NEG_INFINITY, f64::max);
    let cell = |value: f64, std: Option<f64>, digits: usize| match std {
        Some(std) if std.is_finite() && std > 0.0 => Cell::with_std(value, std),
        _ => Cell::fixed(value, digits),
    };
    let mut table = Table::new(
        "Modes of the identified model, with one standard deviation from the covariance of the \
        parameters. Strength: the largest peak over all pairs.",
    )
    .column("frequency", "Hz")
    .column("damping ratio", "%")
    .column("strength", "dB")
    .column("", "");
    for deviation in &deviations {
        let mode = &deviation.mode;
        table = table.row([
            cell(mode.hz, deviation.hz_std, 3),
            cell(100.0 * mode.damping, deviation.damping_std.map(|s| 100.0 * s), 3),
            Cell::fixed(mode.strongest_db(), 1),
            if mode.stable { "" } else { "unstable" }.into(),
        ]);
    }
    let (low, high) = band(outcome, outcome.model.sample_rate_hz);
    let visible = |mode: &Mode| is_drawn(mode, strongest, (low, high));
    let drawn: Vec<_> = deviations.iter().filter(|d| visible(&d.mode)).collect();
    let mut sets = vec![ModeSet {
        label: "identified".into(),
        frequency_hz: drawn.iter().map(|d| d.mode.hz).collect(),
        damping: drawn.iter().map(|d| d.mode.damping).collect(),
        // Bars wider than the plot only show that the mode is poorly determined.
        std: drawn
            .iter()
            .map(|d| (d.hz_std.unwrap_or(0.0).min(0.1 * d.mode.hz), d.damping_std.unwrap_or(0.0).min(0.05)))
            .collect(),
    }];
    if let Some(truth) = &outcome.truth {
        let modes = plid_model::modes(&truth.model)?;
        let shown: Vec<&Mode> = modes.iter().filter(|m| visible(m)).collect();
        sets.push(ModeSet {
            label: "true plant".into(),
            frequency_hz: shown.iter().map(|m| m.hz).collect(),
            damping: shown.iter().map(|m| m.damping).collect(),
            std: Vec::new(),
        });
    }
    let report = report.heading("Modes");
    let report = if drawn.is_empty() {
        report
    } else {
        report.figure(
            mode_map(&sets),
            "Lightly damped modes in the band: frequency and damping ratio, with error bars of two standard \
             deviations.",
        )
    };
    Ok(report.details(format!("All {} modes", deviations.len()), |report| report.table(table)))
}

/// Whether a mode is plotted: lightly damped, in the band, and not too weak relative to the strongest.
pub(super) fn is_drawn(mode: &Mode, strongest_db: f64, (low, high): (f64, f64)) -> bool {
    mode.strongest_db() > strongest_db - FAINT_DB && (low..=high).contains(&mode.hz) && mode.damping < LIGHT
}

fn residuals(report: Report, outcome: &Outcome) -> Report {
    let validation = &outcome.validation;
    let report = report.heading("Residual analysis");
    if validation.whiteness.is_empty() {
        let reason = validation.tests_failed.clone().unwrap_or_else(|| "the model has no one-step prediction".into());
        return report.paragraph(format!("The residuals were not tested: {reason}."));
    }
    let auto: Vec<(String, &Correlation)> = outcome.model.outputs.iter().cloned().zip(&validation.whiteness).collect();
    let mut cross: Vec<(String, &Correlation)> = validation
        .cross
        .iter()
        .zip(&outcome.model.outputs)
        .flat_map(|(row, output)| {
            row.iter().zip(&outcome.model.inputs).map(move |(c, input)| (format!("{output} after {input}"), c))
        })
        .collect();
    let count = |list: &[(String, &Correlation)]| list.iter().filter(|(_, c)| c.test.passes).count();
    let sentence = format!(
        "{} of {} outputs pass the whiteness test (Ljung-Box, 1 %), {} of {} pairs the test of independence from past \
         inputs.",
        count(&auto),
        auto.len(),
        count(&cross),
        cross.len()
    );
    let least_likely = keep_least_likely(&mut cross, DRAWN * DRAWN);
    report
        .paragraph(sentence)
        .figure(
            correlation_plot("autocorrelation", auto.len().min(3), &auto),
            "Autocorrelation of the held-out one-step residuals, with 99 % confidence bounds.",
        )
        .figure(
            correlation_plot("cross-correlation", outcome.model.inputs.len().min(3), &cross),
            format!(
                "Correlation of the residuals with the inputs, from lag {} on, with 99 % confidence bounds.\
                 {least_likely}",
                validation.first_lag
            ),
        )
}

/// Keeps the correlations that are least likely to arise by chance, in their order, and returns a sentence that
/// states this. The sentence is empty if all are kept.
fn keep_least_likely(cross: &mut Vec<(String, &Correlation)>, most: usize) -> String {
    let all = cross.len();
    if all <= most {
        return String::new();
    }
    let mut kept: Vec<usize> = (0..all).collect();
    kept.sort_by(|&a, &b| cross[a].1.test.p_value.total_cmp(&cross[b].1.test.p_value));
    kept.truncate(most);
    kept.sort_unstable();
    *cross = kept.into_iter().map(|k| cross[k].clone()).collect();
    format!(" Plotted are the {most} of {all} pairs with the smallest p-values.")
}

fn searches(report: Report, outcome: &Outcome) -> Report {
    let mut report = report;
    if let Some(scan) = &outcome.scan {
        let points =
            scan.rows.iter().filter_map(|r| r.free_run.map(|e| (r.states as f64, 100.0 * e))).collect::<Vec<_>>();
        let plot = chart(&Chart {
            title: String::new(),
            x: Axis::linear("states"),
            y: Axis::log("simulation error on reserved training data, %"),
            series: vec![
                Series::line("", points.clone()),
                Series::points("best filter for each order", points),
                Series::vertical("recommended", scan.recommended as f64),
            ],
            height: 260.0,
        });
        report = report.heading("Order").figure(
            plot,
            format!(
                "{} states are recommended, the smallest number with an error within 5 % of the \
                smallest.",
                scan.recommended
            ),
        );
    }
    if !outcome.index_search.is_empty() {
        let mut table = Table::new("Observability indices tried.").column("indices", "").column("free-run error", "%");
        for row in &outcome.index_search {
            table = table.row([
                format!("{:?}", row.indices).into(),
                Cell::significant(100.0 * row.free_run.unwrap_or(f64::NAN), 3),
            ]);
        }
        report = report.heading("Observability indices").table(table);
    }
    if outcome.bank.is_empty() {
        return report;
    }
    bank(report, &outcome.bank)
}

/// Adds the results of the filter bank.
pub(crate) fn bank(report: Report, trials: &[Trial]) -> Report {
    let mut levels: Vec<f64> = trials.iter().map(|t| t.sensor).collect();
    levels.sort_by(f64::total_cmp);
    levels.dedup();
    let series = levels
        .iter()
        .map(|&level| {
            let mut points: Vec<(f64, f64)> = trials
                .iter()
                .filter(|t| t.sensor == level)
                .filter_map(|t| t.free_run.map(|e| (t.state, 100.0 * e)))
                .collect();
            points.sort_by(|a, b| a.0.total_cmp(&b.0));
            Series::line(format!("R = {level:.1e}"), points)
        })
        .collect();
    let plot = chart(&Chart {
        title: String::new(),
        x: Axis::log("Sigma_ii (channels of unit RMS)"),
        y: Axis::log("simulation error, %"),
        series,
        height: 260.0,
    });
    let diverged = trials.iter().filter(|t| t.free_run.is_none()).count();
    report.heading("Noise covariances").figure(
        plot,
        format!(
            "The filter bank: each filter was run over the first part of the training data, and its model simulated \
             the rest. {diverged} of {} diverged and are not shown.",
            trials.len()
        ),
    )
}
