//! Claim: the number of samples required at each sample rate.

use plid_lab::experiment::Experiment;
use plid_model::signal::median;
use plid_report::{Axis, Chart, Series, chart};
use rayon::prelude::*;
use serde::Deserialize;

use crate::claim::{Claim, Context, Finding, Result, claim};
use crate::course::{course, form_and_start, noise_of};
use crate::truss::{band_error, truss_of, truth, with_seed};

pub const CLAIM: Claim = claim!("rate",
    statement: "A rate of 1600 Hz keeps the information that a sample carries high.",
    limit: "The structure, its converters and its noise figures are the same at every rate; the real ones were sampled \
        at one rate only.",
    timed: false,
);

/// The band common to all rates, below the Nyquist frequency of the lowest.
const BAND: [f64; 2] = [100.0, 260.0];

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Vary {
    rates_hz: Vec<f64>,
    samples: usize,
    /// Number of samples given to the noise bank at each rate.
    tune_samples: usize,
    every: usize,
    seeds: u64,
    /// A run has converged if its error in the band stays below this value.
    target_percent: f64,
}

/// Error in the band in per cent against the number of samples.
type Line = Vec<(f64, f64)>;

/// Returns the number of samples after which the error stays below the target, or `None` if it never does.
fn needed(line: &[(f64, f64)], target: f64) -> Option<f64> {
    let last_above = line.iter().rposition(|(_, error)| !(*error < target));
    match last_above {
        None => line.first().map(|p| p.0),
        Some(k) => line.get(k + 1).map(|p| p.0),
    }
}

/// Returns the error in the band during the runs of all seeds at one sample rate.
fn lines_at(rate: f64, context: &Context<'_>, base: &Experiment, vary: &Vary) -> Result<Vec<Line>> {
    let states = base.structure.states.unwrap_or(30);
    let mut experiment = base.clone();
    truss_of(&mut experiment).sample_rate_hz = rate;
    let truth = truth(&experiment)?;
    let noise = noise_of(&context.identify(&crate::truss::with_samples(&experiment, vary.tune_samples))?);
    (1..=vary.seeds)
        .into_par_iter()
        .map(|seed| {
            let mut run = with_seed(&experiment, states, seed);
            truss_of(&mut run).duration_s = vary.samples as f64 / rate;
            let simulation = plid_testbed::simulate(truss_of(&mut run))?;
            let record = (simulation.commands.view(), simulation.outputs[0].view());
            let done = course(record, rate, &form_and_start(states, record)?, &noise, vary.every)?;
            Ok(done.models.iter().map(|(k, model)| (*k as f64, 100.0 * band_error(&truth, model, BAND))).collect())
        })
        .collect::<Result<Vec<Line>>>()
}

fn picture(series: Vec<Series>) -> String {
    chart(&Chart {
        title: String::new(),
        x: Axis::log("samples"),
        y: Axis::log("error in 100-260 Hz, %"),
        series,
        height: 240.0,
    })
}

fn run(context: &Context<'_>) -> Result<Finding> {
    let (base, vary): (_, Vary) = (context.experiment()?, context.vary()?);
    let states = base.structure.states.unwrap_or(30);
    let lines = vary
        .rates_hz
        .par_iter()
        .map(|&rate| lines_at(rate, context, &base, &vary))
        .collect::<Result<Vec<Vec<Line>>>>()?;
    let mut finding = Finding::default();
    let (mut rows, mut series, mut counts) = (Vec::new(), Vec::new(), Vec::new());
    for (&rate, runs) in vary.rates_hz.iter().zip(&lines) {
        let count = median(
            &runs.iter().map(|line| needed(line, vary.target_percent).unwrap_or(f64::INFINITY)).collect::<Vec<_>>(),
        );
        let at = |k: usize| (runs[0][k].0, median(&runs.iter().map(|line| line[k].1).collect::<Vec<_>>()));
        let middle: Line = (0..runs[0].len()).map(at).collect();
        let last = middle.last().ok_or("`samples` is below `every`")?.1;
        let shown = if count.is_finite() { format!("{count:.0}") } else { format!("more than {}", vary.samples) };
        finding = finding.figure(format!("samples needed at {rate} Hz"), count, "").figure(
            format!("error at the end at {rate} Hz"),
            last,
            "%",
        );
        rows.push(vec![format!("{rate:.0}"), shown, format!("{:.2}", count / rate), format!("{last:.2}")]);
        series.push(Series::line(format!("{rate:.0} Hz"), middle));
        counts.push(count);
    }
    let of = |rate: f64| vary.rates_hz.iter().position(|&r| r == rate).map_or(f64::NAN, |k| counts[k]);
    let paper = of(1600.0);
    let faster: Vec<f64> =
        vary.rates_hz.iter().zip(&counts).filter(|(rate, _)| **rate > 1600.0).map(|p| *p.1).collect();
    let slower: Vec<f64> =
        vary.rates_hz.iter().zip(&counts).filter(|(rate, _)| **rate < 1600.0).map(|p| *p.1).collect();
    series.push(Series::level("converged", vary.target_percent));
    let picture = picture(series);
    let text: Vec<String> = rows.iter().map(|row| format!("{} at {} Hz", row[1], row[0])).collect();
    Ok(finding
        .part("At 1600 Hz fewer samples are needed than at any higher rate.", faster.iter().all(|&count| paper < count))
        .part(
            "At 1600 Hz no more samples are needed than at a lower rate, within a quarter.",
            slower.iter().all(|&count| paper <= 1.25 * count),
        )
        .picture(
            picture,
            format!("Error of all nine responses against samples, {states} states, median over {} seeds.", vary.seeds),
        )
        .table(
            &format!("Samples after which the error stays below {} %.", vary.target_percent),
            &[("rate", "Hz"), ("samples", ""), ("time", "s"), ("error at the end", "%")],
            rows,
        )
        .say(format!(
            "The error in 100-260 Hz remains below {} % after this many samples: {}.",
            vary.target_percent,
            text.join(", ")
        )))
}

#[cfg(test)]
mod tests {
    use super::needed;

    #[test]
    fn what_counts_is_where_the_error_comes_to_stay() {
        let line = |errors: &[f64]| errors.iter().zip(1..).map(|(e, k)| (f64::from(k), *e)).collect::<Vec<_>>();
        assert_eq!(needed(&line(&[9.0, 2.0, 8.0, 3.0, 1.0]), 5.0), Some(4.0));
        assert_eq!(needed(&line(&[9.0, 2.0, 8.0]), 5.0), None);
        assert_eq!(needed(&line(&[1.0, 2.0]), 5.0), Some(1.0));
        assert_eq!(needed(&line(&[1.0, f64::NAN, 2.0]), 5.0), Some(3.0));
    }
}
