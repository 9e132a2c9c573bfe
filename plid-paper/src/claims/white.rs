//! Claim: the difference between measured and predicted outputs is white.

use plid_lab::experiment::Experiment;
use plid_lab::run::Outcome;
use plid_report::correlation_plot;
use rayon::prelude::*;
use serde::Deserialize;

use crate::claim::{Claim, Context, Finding, Result, claim};
use crate::truss::{SENSOR, with_samples, with_seed};

pub const CLAIM: Claim = claim!("white",
    statement: "No structured difference is left between measured and predicted output.",
    limit: "The paper judged by eye; here tests at 99 % judge, which see more the longer the record is.",
    timed: false,
);

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Vary {
    states: Vec<usize>,
    samples: usize,
}

/// Adds the correlation functions of the residual of sensor 2.
fn pictures(mut finding: Finding, outcomes: &[(usize, Outcome)]) -> Finding {
    for (states, outcome) in outcomes {
        let correlations = &outcome.validation;
        let mut functions = vec![(format!("sensor 2 with itself, {states} states"), &correlations.whiteness[SENSOR])];
        functions.extend(correlations.cross[SENSOR].iter().zip(1..).map(|(c, j)| (format!("with actuator {j}"), c)));
        finding = finding.picture(
            correlation_plot("correlation", 4, &functions),
            format!("The residual of sensor 2 on held-out data, {states} states."),
        );
    }
    finding
}

/// Returns the number of states and the outcome of each run.
fn outcomes(context: &Context<'_>, base: &Experiment, vary: &Vary) -> Result<Vec<(usize, Outcome)>> {
    vary.states
        .par_iter()
        .map(|&states| Ok((states, context.validate(&with_samples(&with_seed(base, states, 1), vary.samples))?)))
        .collect()
}

fn run(context: &Context<'_>) -> Result<Finding> {
    let (base, vary): (_, Vary) = (context.experiment()?, context.vary()?);
    let outcomes = outcomes(context, &base, &vary)?;
    let mut finding = Finding::default();
    let (mut rows, mut clean, mut whites) = (Vec::new(), Vec::new(), Vec::new());
    for (states, outcome) in &outcomes {
        let validation = &outcome.validation;
        if let Some(reason) = &validation.tests_failed {
            return Err(format!("{states} states: {reason}").into());
        }
        let white = validation.whiteness.iter().filter(|c| c.test.passes).count();
        let pairs = validation.cross.iter().flatten();
        let uncorrelated = pairs.clone().filter(|c| c.test.passes).count();
        // The largest correlation shows how much structure remains, whatever the length of the record.
        let largest = |value: &[f64]| value.iter().fold(0.0_f64, |most, v| most.max(v.abs()));
        let own = validation.whiteness.iter().map(|c| largest(&c.value[..])).fold(0.0, f64::max);
        let with_input = pairs.map(|c| largest(&c.value)).fold(0.0, f64::max);
        finding = finding
            .figure(format!("white residuals, {states} states"), white as f64, "of 3")
            .figure(format!("pairs without correlation with the inputs, {states} states"), uncorrelated as f64, "of 9")
            .figure(format!("largest autocorrelation, {states} states"), own, "")
            .figure(format!("largest correlation with an input, {states} states"), with_input, "");
        rows.push(vec![
            states.to_string(),
            white.to_string(),
            uncorrelated.to_string(),
            format!("{own:.3}"),
            format!("{with_input:.3}"),
        ]);
        clean.push(uncorrelated == 9);
        whites.push(white == 3);
    }
    finding = pictures(finding, &outcomes);
    let text: Vec<String> = rows.iter().map(|r| format!("{} states {}/3 and {}/9", r[0], r[1], r[2])).collect();
    let (reduced, full) = (&vary.states[..vary.states.len() - 1], vary.states.last().ok_or("no states")?);
    Ok(finding
        .part(
            format!("At {reduced:?} states, the paper's, no residual is correlated with an input."),
            clean[..reduced.len()].iter().all(|&c| c),
        )
        .part(format!("At {reduced:?} states every residual is white."), whites[..reduced.len()].iter().all(|&w| w))
        .part(
            format!("At {full} states, the full order, no residual is correlated with an input."),
            *clean.last().unwrap_or(&false),
        )
        .part(format!("At {full} states every residual is white."), *whites.last().unwrap_or(&false))
        .table(
            "Tests at 99 % on held-out one-step residuals.",
            &[
                ("states", ""),
                ("white", "of 3"),
                ("uncorrelated with inputs", "of 9"),
                ("largest autocorrelation", ""),
                ("largest with an input", ""),
            ],
            rows,
        )
        .say(format!(
            "Residuals that are white, and pairs of residual and input without correlation: {}.",
            text.join("; ")
        )))
}
