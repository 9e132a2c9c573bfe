//! Claim: no poles are found above the band of the input.

use plid_lab::experiment::NoiseSource;
use plid_model::{Mode, ModeKind, modes};
use rayon::prelude::*;
use serde::Deserialize;

use super::graceful::whitened;
use crate::claim::{Claim, Context, Finding, Result, claim};
use crate::truss::{covariances, mean_and_spread, with_samples, with_seed};

pub const CLAIM: Claim = claim!("nopoles",
    statement: "No poles are given to the band above about 600 Hz, where the input is below the noise.",
    limit: "The testbed has modes at 640 and 731 Hz, so poles could represent something in this band.",
    timed: false,
);

const ABOVE_HZ: f64 = 600.0;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Vary {
    states: Vec<usize>,
    samples: usize,
    seeds: u64,
    white_cutoff_hz: f64,
    noise: Vec<NoiseSource>,
}

/// Counts the poles above the frequency limit. A complex pair counts twice; a real pole counts if it is negative.
fn above(modes: &[Mode]) -> usize {
    let inside = modes.iter().filter(|mode| mode.pole.re < 0.0 && mode.hz > ABOVE_HZ);
    inside.map(|mode| if mode.kind == ModeKind::Real { 1 } else { 2 }).sum()
}

fn run(context: &Context<'_>) -> Result<Finding> {
    let (base, vary): (_, Vary) = (context.experiment()?, context.vary()?);
    let base = with_samples(&base, vary.samples);
    let mut finding = Finding::default();
    let mut rows: Vec<Vec<String>> = vary.states.iter().map(|n| vec![n.to_string()]).collect();
    let mut heads = vec![("states".to_string(), "")];
    let (mut shaped_poles, mut least_white) = (Vec::new(), f64::INFINITY);
    for &noise in &vary.noise {
        for (input, experiment) in [("shaped", base.clone()), ("white", whitened(&base, vary.white_cutoff_hz))] {
            let words = covariances(noise);
            heads.push((format!("{input}, {words}"), "poles"));
            let counts: Vec<f64> = vary
                .states
                .par_iter()
                .map(|&states| {
                    let runs = (1..=vary.seeds).into_par_iter().map(|seed| {
                        let mut experiment = with_seed(&experiment, states, seed);
                        experiment.noise.from = noise;
                        Ok(above(&modes(&context.identify(&experiment)?.model)?) as f64)
                    });
                    Ok(mean_and_spread(&runs.collect::<Result<Vec<f64>>>()?).0)
                })
                .collect::<Result<_>>()?;
            for ((states, count), row) in vary.states.iter().zip(&counts).zip(&mut rows) {
                finding = finding.figure(format!("poles above 600 Hz, {input}, {words}, {states} states"), *count, "");
                row.push(format!("{count:.1}"));
                match input {
                    "shaped" => shaped_poles.push((*states, *count)),
                    _ => least_white = least_white.min(count / *states as f64),
                }
            }
        }
    }
    let even = 1.0 - ABOVE_HZ / 800.0;
    let most = shaped_poles.iter().map(|(states, count)| count / *states as f64).fold(0.0, f64::max);
    let none = shaped_poles.iter().filter(|(_, count)| *count == 0.0).count();
    let heads: Vec<(&str, &str)> = heads.iter().map(|(name, unit)| (name.as_str(), *unit)).collect();
    Ok(finding
        .figure("largest share of poles above 600 Hz, shaped", 100.0 * most, "%")
        .part("With the shaped input no model has a pole above 600 Hz.", none == shaped_poles.len())
        .part(
            "With the shaped input every model has a smaller share of its poles there than the band has of all \
             frequencies (a quarter): the band gets less than its due.",
            most < even,
        )
        .table(&format!("Poles above 600 Hz, mean over {} seeds.", vary.seeds), &heads, rows)
        .say(format!(
            "With the shaped input {none} of {} models have no pole above 600 Hz, and at most {:.0} % of a model's \
             poles lie there, where an even spread would put {:.0} %; with white input at least {:.0} %.",
            shaped_poles.len(),
            100.0 * most,
            100.0 * even,
            100.0 * least_white
        )))
}
