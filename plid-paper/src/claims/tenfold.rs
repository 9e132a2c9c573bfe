//! Claim: the cost of a square-root form.

use plid_bench::speed::{self, Config, Outcome};
use plid_catalogue::{CovarianceName, ExpectationName};
use plid_work::Inner;
use serde::Deserialize;

use crate::claim::{Claim, Context, Finding, Result, claim};

pub const CLAIM: Claim = claim!("tenfold",
    statement: "Square-root propagation costs as much as ten times more computation.",
    limit: "Ratios of plid's own forms, on this machine: the paper's programs are not available.",
    timed: true,
);

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Vary {
    rounds: usize,
    visit_ms: f64,
    steps: usize,
}

/// Runs ID.toml, a study of speed, for the duration given in ID.vary.toml.
pub fn timed(context: &Context<'_>) -> Result<Outcome> {
    let (mut config, vary): (Config, Vary) = (context.config()?, context.vary()?);
    (config.rounds, config.visit_ms, config.steps) = (vary.rounds, vary.visit_ms, vary.steps);
    Ok(speed::carry_out(&config, context.directory, false, &Inner(context.progress))?)
}

fn run(context: &Context<'_>) -> Result<Finding> {
    let outcome = timed(context)?;
    let config = &outcome.config.cross[0];
    let mut finding = Finding::default();
    let (mut rows, mut most_time, mut most_work) = (Vec::new(), 0.0_f64, 0.0_f64);
    for &states in &config.states {
        for &expectations in &config.expectations {
            let find = |form: CovarianceName, of: ExpectationName| {
                outcome.plain(states, form, of).ok_or("the study lacks a cell")
            };
            let direct = find(CovarianceName::Direct, expectations)?;
            let mut row = vec![states.to_string(), speed::word(&expectations), format!("{:.1}", direct.least_us)];
            for form in CovarianceName::BUILT_IN.into_iter().filter(|&form| form != CovarianceName::Direct) {
                let other = find(form, expectations)?;
                let (time, work) = (
                    other.least_us / direct.least_us,
                    other.operations.total() as f64 / direct.operations.total() as f64,
                );
                row.push(format!("{time:.2}"));
                row.push(format!("{work:.2}"));
                if form.is_factored() {
                    (most_time, most_work) = (most_time.max(time), most_work.max(work));
                    let name = format!("{}, {states} states, {}", speed::word(&form), speed::word(&expectations));
                    finding = finding.timed(format!("time over direct, {name}"), time, "").figure(
                        format!("operations over direct, {name}"),
                        work,
                        "",
                    );
                }
            }
            rows.push(row);
        }
    }
    Ok(finding
        .timed("largest ratio of times", most_time, "")
        .figure("largest ratio of operations", most_work, "")
        .part("No factored form takes more than ten times the time of the direct one.", most_time <= 10.0)
        .part(
            "Some factored form takes at least five times as long: ten is the right order of magnitude.",
            most_time >= 5.0,
        )
        .table(
            "Least time of a step of the direct form; times and operations of the others over it.",
            &[
                ("states", ""),
                ("expectations", ""),
                ("direct", "µs"),
                ("Joseph", "time"),
                ("Joseph", "operations"),
                ("UD", "time"),
                ("UD", "operations"),
                ("array", "time"),
                ("array", "operations"),
            ],
            rows,
        )
        .say(format!(
            "Factored forms take at most {most_time:.1} times as long as the direct one, with at most {most_work:.1} \
             times its operations: up to ten is true as a bound, and far from what the structure of the problem \
             demands."
        )))
}
