//! Claim: parameter noise compensates for finite precision.

use plid_bench::stability::{self, Class, Config, Judged};
use plid_catalogue::{CovarianceName, ScalarName};
use plid_work::Inner;
use serde::Deserialize;

use super::twelve::word;
use crate::claim::{Claim, Context, Finding, Result, claim};

pub const CLAIM: Claim = claim!("parnoise",
    statement: "Where neither a square root is taken nor the order is small, noise must be added to the parameters.",
    limit: "The precision that the paper's computer worked in is not known; both scalars are shown.",
    timed: false,
);

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Vary {
    states: usize,
    steps: usize,
    parameter_noise: Vec<f64>,
}

fn list(values: &[f64]) -> String {
    if values.is_empty() {
        "none".into()
    } else {
        values.iter().map(|v| format!("{v:e}")).collect::<Vec<_>>().join(", ")
    }
}

fn run(context: &Context<'_>) -> Result<Finding> {
    let (mut config, vary): (Config, Vary) = (context.config()?, context.vary()?);
    (config.states, config.steps) = (vec![vary.states], vary.steps);
    config.variations.states = vec![vary.states];
    config.variations.parameter_noise = vary.parameter_noise.clone();
    let outcome = stability::carry_out(&config, context.directory, false, &Inner(context.progress))?;
    let find = |noise: f64, scalar: ScalarName| -> Result<&Judged> {
        let found = outcome.cells.iter().find(|j| {
            (j.cell.group.parameter_noise, j.cell.scalar, j.cell.form) == (noise, scalar, CovarianceName::Direct)
        });
        Ok(found.ok_or("the study lacks a cell")?)
    };
    let mut finding = Finding::default();
    let (mut rows, mut cured, mut harmless) = (Vec::new(), Vec::new(), Vec::new());
    let without = find(0.0, ScalarName::F64)?.cell.free_run.unwrap_or(f64::INFINITY);
    for noise in [0.0].into_iter().chain(vary.parameter_noise.iter().copied()) {
        let (single, double) = (find(noise, ScalarName::F32)?, find(noise, ScalarName::F64)?);
        let error = |j: &Judged| j.cell.free_run.map_or("–".into(), |e| format!("{:.2}", 100.0 * e));
        rows.push(vec![format!("{noise:e}"), word(single), error(single), word(double), error(double)]);
        for (name, judged) in [("f32", single), ("f64", double)] {
            let steps = judged.lost_at.unwrap_or(judged.cell.done) as f64;
            finding = finding.figure(format!("steps until lost or done, {name}, parameter noise {noise:e}"), steps, "");
            let error = 100.0 * judged.cell.free_run.unwrap_or(f64::NAN);
            finding = finding.figure(format!("free-run error, {name}, parameter noise {noise:e}"), error, "%");
        }
        if noise > 0.0 && single.class != Class::Lost {
            cured.push(noise);
            // The limit is a tenth more than without parameter noise in f64, as in the study.
            if single.cell.free_run.is_some_and(|e| e < 1.1 * without) {
                harmless.push(noise);
            }
        }
    }
    let class = |scalar| -> Result<Class> { Ok(find(0.0, scalar)?.class) };
    let (single, double) = (class(ScalarName::F32)?, class(ScalarName::F64)?);
    Ok(finding
        .part("Without noise on the parameters the direct form is lost in f32.", single == Class::Lost)
        .part("Without it the direct form is not sound in f64.", double != Class::Sound)
        .part("With some of the levels tried it is not lost in f32: noise is a cure.", !cured.is_empty())
        .part(
            "With one of these the model simulates within 10 % as well as in f64 without noise: the cure has no \
            price.",
            !harmless.is_empty(),
        )
        .table(
            &format!("The direct form with {} states over {} steps.", vary.states, vary.steps),
            &[("noise a step", "variance"), ("f32", ""), ("free run", "%"), ("f64", ""), ("free run", "%")],
            rows,
        )
        .say(format!(
            "With {} states over {} steps the direct form without noise is {} in f64 and {} in f32. In f32 these \
             levels keep it: {}; of them these simulate as well: {}.",
            vary.states,
            vary.steps,
            word(find(0.0, ScalarName::F64)?),
            word(find(0.0, ScalarName::F32)?),
            list(&cured),
            list(&harmless)
        )))
}
