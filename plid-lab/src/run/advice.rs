//! Warnings and advice derived from the figures of a run.

use super::Outcome;
use super::error::RunError;
use super::validate::Validation;
use plid_data::Warning;
use plid_model::{mode_deviations, stability};

/// Above this ratio of simulation error to one-step error the predictor relies on the measured outputs.
const LEANS: f64 = 4.0;
/// Simulation errors below this need no remark.
const GOOD: f64 = 0.05;
/// A mode whose relative frequency deviation exceeds this is not determined by the data.
const VAGUE: f64 = 0.05;

/// Returns warnings about the model, and advice on the model and on the warnings about the data.
pub(super) fn advise(outcome: &Outcome, of_data: &[Warning]) -> Result<(Vec<String>, Vec<String>), RunError> {
    let (mut warnings, mut advice) = (Vec::new(), Vec::new());
    let validation = &outcome.validation;
    let free_run = validation.free_run_errors.overall_relative;
    if let Some(unstable) = stability(&outcome.model)?.warning() {
        warnings.push(unstable.to_string());
    }
    if free_run.is_infinite() {
        warnings.push("the simulation of the held-out data diverges".into());
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
            "The one-step error is {:.2} %, but the simulation error is {:.1} %. A small one-step error may only show \
             that the predictor follows the measured outputs; for simulation, rely on the simulation error.",
            100.0 * one_step,
            100.0 * free_run
        ));
        if oversampled.is_none() {
            advice.push(
                "Try more states (`structure.scan`), a longer record, or a lower sample rate \
                (`preparation.decimate_to_hz`)."
                    .into(),
            );
        }
    }
    if let Some(warning) = oversampled {
        advice.push(format!(
            "The sample rate is high compared with the band: {warning}. Set \
            `preparation.decimate_to_hz`."
        ));
    }
    advice.extend(excitation_advice(of_data));
    advice.extend(residual_advice(validation));
    order_advice(outcome, &mut advice)?;
    if let Some(floor) = &validation.noise_floor {
        let floor = (floor.iter().map(|x| x * x).sum::<f64>() / floor.len() as f64).sqrt();
        if free_run.is_finite() && free_run < 1.2 * floor {
            advice.push(format!(
                "The simulation error reaches the noise floor ({:.2} %): this record cannot show whether more states \
                 are better.",
                100.0 * floor
            ));
        }
    }
    Ok((warnings, advice))
}

fn excitation_advice(of_data: &[Warning]) -> Option<String> {
    let poor =
        of_data.iter().any(|w| matches!(w, Warning::PoorExcitation { .. } | Warning::IllConditionedInput { .. }));
    poor.then(|| {
        "The inputs excite few frequencies. The model is not reliable outside their band; excite the missing \
             frequencies if they matter, or use fewer states."
            .into()
    })
}

fn residual_advice(validation: &Validation) -> Option<String> {
    let coloured = validation.cross.iter().flatten().filter(|c| !c.test.passes).count();
    if coloured > 0 {
        return Some(format!(
            "{coloured} of {} residual-input pairs are correlated: the order is too small, or the plant is nonlinear \
             or time-varying. Compare orders with `structure.scan`.",
            validation.cross.iter().flatten().count()
        ));
    }
    if validation.whiteness.iter().any(|w| !w.test.passes) {
        return Some(
            "The residuals are coloured but not correlated with the inputs: the model describes the dynamics, but not \
             the spectrum of a disturbance."
                .into(),
        );
    }
    None
}

/// Advises on the number of states from the modes' deviations and the scan.
fn order_advice(outcome: &Outcome, advice: &mut Vec<String>) -> Result<(), RunError> {
    let deviations = mode_deviations(&outcome.canonical)?;
    let vague =
        deviations.iter().filter(|d| d.mode.hz > 0.0 && d.hz_std.is_some_and(|std| std > VAGUE * d.mode.hz)).count();
    if 2 * vague > deviations.len() {
        advice.push(format!(
            "{vague} of {} modes are not determined by the data (the relative deviation of the frequency exceeds {:.0} \
             %): fewer states may be sufficient.",
            deviations.len(),
            100.0 * VAGUE
        ));
    }
    if let (Some(scan), states) = (&outcome.scan, outcome.form.indices().iter().sum::<usize>())
        && scan.recommended != states
    {
        advice.push(format!("The scan recommends {} states; this model has {states}.", scan.recommended));
    }
    Ok(())
}
