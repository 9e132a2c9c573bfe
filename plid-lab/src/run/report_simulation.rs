//! The report section on models for simulation: the recursive, the refined and the subspace model side by side.

use nalgebra::DMatrix;
use num_complex::Complex64;
use plid_model::signal::WelchFrf;
use plid_model::{Mode, modes};
use plid_refine::{Noise, Score};

use super::Outcome;
use super::error::RunError;
use super::report::{curve, drawn, is_drawn, lines, measured_pair, over, undrawn};
use super::simulation::Alternative;
use plid_report::{Cell, FrfCurve, FrfPlot, ModeSet, Report, Table, frf_grid, mode_map, percent};

/// Returns a sentence that compares the models.
pub(super) fn verdict(outcome: &Outcome) -> Option<String> {
    let simulation = &outcome.simulation;
    let own = outcome.validation.free_run_errors.overall_relative;
    let (refined, _) = simulation.refined.as_ref()?;
    let error = refined.free_run_errors.overall_relative;
    let of_baseline = simulation.subspace.as_ref().map_or(String::new(), |baseline| {
        format!(" The error of the subspace estimate is {}.", percent(baseline.free_run_errors.overall_relative))
    });
    let compared = if simulation.refined_is_worse {
        format!(
            "has a simulation error of {}, larger than that of the recursive model, and is not \
            written.",
            percent(error)
        )
    } else if error > own {
        format!(
            "has a simulation error of {}, no better than the recursive model: either may be used for \
            simulation.",
            percent(error)
        )
    } else {
        format!(
            "has a simulation error of {}: use model-refined.json for simulation, and model.json for prediction and \
             for continuing the recursion.",
            percent(error)
        )
    };
    Some(format!(
        "The model refined for simulation (output error), with the same number of states, \
        {compared}{of_baseline}"
    ))
}

/// Adds the errors, frequency responses and poles of all models.
pub(super) fn section(
    report: Report,
    outcome: &Outcome,
    measured: Option<&WelchFrf>,
    band: (f64, f64),
) -> Result<Report, RunError> {
    let models = alternatives(outcome);
    if models.is_empty() {
        return Ok(report);
    }
    let mut report =
        report.heading("Models for simulation").paragraph(origin(outcome)).table(errors(outcome, &models)).figure(
            responses(outcome, &models, measured, band)?,
            format!(
                "Frequency responses of the models; the band of the refined model is two standard deviations and \
                 accounts for noise alone.{}",
                undrawn(outcome)
            ),
        );
    let poles = poles(outcome, &models, band)?;
    if poles.iter().any(|set| !set.frequency_hz.is_empty()) {
        report = report.figure(mode_map(&poles), "Lightly damped modes in the band, of each model.");
    }
    let Some((refined, path)) = &outcome.simulation.refined else { return Ok(report) };
    let deviations = path.mode_deviations(&refined.model)?;
    let mut table = Table::new("Modes of the refined model, with one standard deviation.")
        .column("frequency", "Hz")
        .column("damping ratio", "%")
        .column("strength", "dB");
    let cell = |value: f64, std: Option<f64>| match std {
        Some(std) if std.is_finite() && std > 0.0 => Cell::with_std(value, std),
        _ => Cell::fixed(value, 3),
    };
    for deviation in &deviations {
        let mode = &deviation.mode;
        table = table.row([
            cell(mode.hz, deviation.hz_std),
            cell(100.0 * mode.damping, deviation.damping_std.map(|s| 100.0 * s)),
            Cell::fixed(mode.strongest_db(), 1),
        ]);
    }
    Ok(report.details(format!("All {} modes of the refined model", deviations.len()), |report| report.table(table)))
}

fn alternatives(outcome: &Outcome) -> Vec<(&'static str, &Alternative)> {
    let refined = outcome.simulation.refined.as_ref().map(|(model, _)| ("refined", model));
    refined.into_iter().chain(outcome.simulation.subspace.as_ref().map(|model| ("subspace", model))).collect()
}

fn origin(outcome: &Outcome) -> String {
    let simulation = &outcome.simulation;
    let limit = match simulation.period_s {
        Some(period) => format!(
            "The inputs repeat every {period:.4} s, so time constants were limited to a quarter of that, {:.4} s: a \
             slower pole could fit single spectral lines of this record without being valid for another.",
            simulation.longest_time_constant_s
        ),
        None => format!(
            "Time constants were limited to {:.4} s, the length of the longest training record.",
            simulation.longest_time_constant_s
        ),
    };
    let Some((_, path)) = &simulation.refined else { return limit };
    let name = |score: &Score| {
        let how = match score.noise {
            Some(Noise::White) => "",
            Some(Noise::Coloured) => ", for coloured noise",
            None => ", not refined",
        };
        format!("{}{how}", score.start)
    };
    let scores: Vec<String> =
        path.scores.iter().map(|score| format!("{} {}", name(score), percent(score.error))).collect();
    let end = if path.converged { "and converged" } else { "without converging" };
    let at_limit = match path.poles_at_limit {
        0 => String::new(),
        count => format!(
            " {count} of its poles are at that limit, and their contribution may be specific to this \
            record."
        ),
    };
    format!(
        "Each starting model was refined on the training data without the last quarter of the last record, unless \
         another one was far better, and was scored on that quarter ({}). The best, {}, was refined on all training \
         data in {} iterations {end}. {limit}{at_limit}",
        scores.join("; "),
        name(&path.scores[path.chosen]),
        path.iterations
    )
}

fn errors(outcome: &Outcome, models: &[(&'static str, &Alternative)]) -> Table {
    let validation = &outcome.validation;
    let mut table = Table::new(
        "Errors of each model on held-out data: RMS of the error over RMS of the \
            output.",
    )
    .column("output", "");
    let own = ("PLID", validation.one_step_errors.as_ref(), &validation.free_run_errors);
    let others = models.iter().map(|(name, model)| (*name, model.one_step_errors.as_ref(), &model.free_run_errors));
    let all: Vec<_> = std::iter::once(own).chain(others).collect();
    for (name, _, _) in &all {
        table = table.column(format!("{name}: free run"), "%").column("one-step", "%");
    }
    let percent = |value: Option<f64>| Cell::significant(100.0 * value.unwrap_or(f64::NAN), 3);
    for (i, output) in outcome.model.outputs.iter().enumerate() {
        let figures = all.iter().flat_map(|(_, one_step, free_run)| {
            [percent(Some(free_run.relative[i])), percent(one_step.map(|e| e.relative[i]))]
        });
        table = table.row(std::iter::once(output.clone().into()).chain(figures).collect::<Vec<Cell>>());
    }
    let overall = all.iter().flat_map(|(_, one_step, free_run)| {
        [percent(Some(free_run.overall_relative)), percent(one_step.map(|e| e.overall_relative))]
    });
    table.row(std::iter::once("all".into()).chain(overall).collect::<Vec<Cell>>())
}

fn responses(
    outcome: &Outcome,
    models: &[(&'static str, &Alternative)],
    measured: Option<&WelchFrf>,
    band: (f64, f64),
) -> Result<String, RunError> {
    let hz = lines(outcome, band);
    let own = over(&outcome.model, &hz);
    let others: Vec<_> = models.iter().map(|(name, model)| (*name, over(&model.model, &hz))).collect();
    let bands = match &outcome.simulation.refined {
        Some((_, path)) => Some(path.response_variance(&hz)?.iter().map(|v| v.magnitude_std()).collect::<Vec<_>>()),
        None => None,
    };
    let truth = outcome.truth.as_ref().map(|truth| over(&truth.model, &hz));
    let mut plots = Vec::new();
    let (outputs, inputs) = drawn(outcome);
    for i in 0..outputs {
        for j in 0..inputs {
            let of = |response: &Vec<DMatrix<Complex64>>| curve(&hz, response, (i, j));
            let named = |(name, response): &(&str, Vec<DMatrix<Complex64>>)| {
                let std = bands.as_ref().filter(|_| *name == "refined");
                let std = std.map(|all| all.iter().map(|s| s[(i, j)]).collect());
                (name.to_string(), FrfCurve { std, ..of(response) })
            };
            plots.push(FrfPlot {
                identified: Some(of(&own)),
                others: others.iter().map(named).collect(),
                truth: truth.as_ref().map(of),
                ..measured_pair(outcome, measured, band, (i, j))
            });
        }
    }
    Ok(frf_grid(inputs, &plots))
}

fn poles(
    outcome: &Outcome,
    models: &[(&'static str, &Alternative)],
    band: (f64, f64),
) -> Result<Vec<ModeSet>, RunError> {
    let all = std::iter::once(("PLID", &outcome.model)).chain(models.iter().map(|(name, m)| (*name, &m.model)));
    let mut sets = Vec::new();
    for (label, model) in all {
        let modes = modes(model)?;
        let strongest = modes.iter().map(Mode::strongest_db).fold(f64::NEG_INFINITY, f64::max);
        let drawn: Vec<&Mode> = modes.iter().filter(|mode| is_drawn(mode, strongest, band)).collect();
        sets.push(ModeSet {
            label: label.into(),
            frequency_hz: drawn.iter().map(|mode| mode.hz).collect(),
            damping: drawn.iter().map(|mode| mode.damping).collect(),
            std: Vec::new(),
        });
    }
    Ok(sets)
}
