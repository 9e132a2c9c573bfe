//! What the figures mean, and what to do about it, in words.

use super::Outcome;
use super::error::RunError;
use plid_data::Warning;
use plid_model::{mode_deviations, stability};

/// A free-run error this many times the one-step error says that the predictor leans on the measured outputs.
const LEANS: f64 = 4.0;
/// A free-run error that is good enough not to be remarked on.
const GOOD: f64 = 0.05;
/// A mode whose frequency is known to no better than this share is not told by the data.
const VAGUE: f64 = 0.05;

/// Warnings about the model, and advice on it and on what the data warn of.
pub(super) fn advise(outcome: &Outcome, of_data: &[Warning]) -> Result<(Vec<String>, Vec<String>), RunError> {
    let (mut warnings, mut advice) = (Vec::new(), Vec::new());
    let validation = &outcome.validation;
    let free_run = validation.free_run_errors.overall_relative;
    if let Some(unstable) = stability(&outcome.model)?.warning() {
        warnings.push(unstable.to_string());
    }
    if !free_run.is_finite() {
        warnings.push("the free run of the model diverges on the held-out part".into());
        advice
            .push("Do not simulate with this model. Try fewer states, a lower sample rate, or a longer record.".into());
    }
    let Some(one_step) = validation.one_step_errors.as_ref().map(|e| e.overall_relative) else {
        if outcome.experiment.validation.model_only {
            return Ok((warnings, advice));
        }
        warnings.push("no predictor gain keeps the one-step prediction bounded".into());
        return Ok((warnings, advice));
    };
    let oversampled = of_data.iter().find(|w| matches!(w, Warning::Oversampled { .. }));
    if free_run.is_finite() && free_run > LEANS * one_step && free_run > GOOD {
        advice.push(format!(
            "The two errors disagree: {:.2} % one step ahead, {:.1} % in free run. One-step errors flatter a model that follows the measured outputs; for simulation trust the free run.",
            100.0 * one_step,
            100.0 * free_run
        ));
        if oversampled.is_none() {
            advice.push("Try more states (`structure.scan`), a longer record, or a lower sample rate (`preparation.decimate_to_hz`).".into());
        }
    }
    if let Some(warning) = oversampled {
        advice.push(format!("The sample rate is high against the band: {warning}. Set `preparation.decimate_to_hz`."));
    }
    if of_data.iter().any(|w| matches!(w, Warning::PoorExcitation { .. } | Warning::IllConditionedInput { .. })) {
        advice.push(
            "The inputs excite few frequencies. Outside of their band the model is a guess; add lines or noise there if it matters, or use fewer states."
                .into(),
        );
    }
    let coloured = validation.cross.iter().flatten().filter(|c| !c.test.passes).count();
    if coloured > 0 {
        advice.push(format!(
            "{coloured} of {} residual-input pairs are still correlated: the order is too small, the plant is nonlinear, or it changes. Compare orders with `structure.scan`.",
            validation.cross.iter().flatten().count()
        ));
    } else if validation.whiteness.iter().any(|w| !w.test.passes) {
        advice.push(
            "The residuals are coloured but not correlated with the inputs: the dynamics are found, a disturbance is not modelled."
                .into(),
        );
    }
    let deviations = mode_deviations(&outcome.canonical)?;
    let vague =
        deviations.iter().filter(|d| d.mode.hz > 0.0 && d.hz_std.is_some_and(|std| std > VAGUE * d.mode.hz)).count();
    if 2 * vague > deviations.len() {
        advice.push(format!(
            "{vague} of {} modes are not told by the data (frequency known to no better than {:.0} %): fewer states may do as well.",
            deviations.len(),
            100.0 * VAGUE
        ));
    }
    if let (Some(scan), states) = (&outcome.scan, outcome.form.indices().iter().sum::<usize>())
        && scan.recommended != states
    {
        advice.push(format!("The scan recommends {} states; this model has {states}.", scan.recommended));
    }
    if let Some(floor) = &validation.noise_floor {
        let floor = (floor.iter().map(|x| x * x).sum::<f64>() / floor.len() as f64).sqrt();
        if free_run.is_finite() && free_run < 1.2 * floor {
            advice.push(format!(
                "The free run reaches the noise floor ({:.2} %): more states cannot show in this record.",
                100.0 * floor
            ));
        }
    }
    Ok((warnings, advice))
}
