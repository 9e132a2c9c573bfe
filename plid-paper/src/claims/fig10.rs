//! Fig. 10: the costs and benefits of more states.

use ndarray::{Axis as Way, s};
use plid_bench::study::Machine;
use plid_core::NoiseModel;
use plid_report::{Axis, Chart, Series, chart};
use plid_testbed::TrussConfig;
use serde::Deserialize;

use crate::claim::{Claim, Context, Finding, Result, claim};
use crate::course::{course, form_and_start};
use crate::truss::{mean_and_spread, truss_of};

pub const CLAIM: Claim = claim!("fig10",
    statement: "SIMO, 24, 30, 35, 40, 45, 50 and 64 states: the time of an iteration against the mean absolute \
        one-step error over the last 200 iterations. More states cost more time and bring less and less.",
    limit: "Times are this machine's. The error's level is the simulated noise's.",
    timed: true,
);

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Vary {
    states: Vec<usize>,
    samples: usize,
    seeds: u64,
}

/// The cost and the error for one number of states.
struct Point {
    states: usize,
    /// Duration of an iteration in µs.
    micros: f64,
    /// Mean absolute one-step error over the seeds with its standard error in mV.
    error: f64,
    standard_error: f64,
}

fn measure(truss: &mut TrussConfig, vary: &Vary) -> Result<Vec<Point>> {
    let mut points = Vec::new();
    for &states in &vary.states {
        let noise = NoiseModel::paper_literal(plid_testbed::OUTPUTS, 1, states);
        let (mut errors, mut micros) = (Vec::new(), f64::INFINITY);
        for seed in 1..=vary.seeds {
            truss.seed = seed;
            let simulation = plid_testbed::simulate(truss)?;
            let input = simulation.commands.select(Way(1), &[0]);
            let record = (input.view(), simulation.outputs[0].view());
            let start = form_and_start(states, record)?;
            let done = course(record, simulation.sample_rate_hz, &start, &noise, vary.samples)?;
            let last = done.innovations.slice(s![vary.samples - 200.., ..]);
            errors.push(1e3 * last.iter().map(|e| e.abs()).sum::<f64>() / last.len() as f64);
            // Other work of the machine can only increase the time.
            micros = micros.min(1e6 * done.seconds / vary.samples as f64);
        }
        let (error, spread) = mean_and_spread(&errors);
        points.push(Point { states, micros, error, standard_error: spread / (errors.len() as f64).sqrt() });
    }
    Ok(points)
}

fn picture(points: &[Point]) -> String {
    chart(&Chart {
        title: String::new(),
        x: Axis::linear("time of an iteration, µs"),
        y: Axis::linear("mean |e|, mV"),
        series: vec![
            Series::line("", points.iter().map(|p| (p.micros, p.error)).collect()).colour("#0072b2"),
            Series::points("24 to 64 states", points.iter().map(|p| (p.micros, p.error)).collect()).colour("#0072b2"),
        ],
        height: 230.0,
    })
}

fn run(context: &Context<'_>) -> Result<Finding> {
    let (mut base, vary): (_, Vary) = (context.experiment()?, context.vary()?);
    let truss = truss_of(&mut base);
    truss.duration_s = vary.samples as f64 / truss.sample_rate_hz;
    let points = measure(truss, &vary)?;
    let (first, last) = (&points[0], points.last().ok_or("no states")?);
    let middle =
        points.iter().min_by_key(|p| p.states.abs_diff((first.states + last.states) / 2)).ok_or("no states")?;
    let machine = Machine::here();
    let picture = picture(&points);
    let rows = points.iter().map(|Point { states, micros, error, standard_error }| {
        vec![states.to_string(), format!("{micros:.1}"), format!("{error:.2}"), format!("{standard_error:.2}")]
    });
    let mut finding = Finding::default()
        .picture(
            picture,
            format!(
                "One input, three outputs, direct form, f64, on {} ({} logical cores).",
                machine.cpu, machine.logical_cores
            ),
        )
        .table(
            "Least time over the seeds; mean error over the seeds with its standard error.",
            &[("states", ""), ("iteration", "µs"), ("mean |e|", "mV"), ("±", "mV")],
            rows.collect(),
        );
    for Point { states, micros, error, .. } in &points {
        finding = finding.timed(format!("iteration, {states} states"), *micros, "µs").figure(
            format!("mean |e|, {states} states"),
            *error,
            "mV",
        );
    }
    let (early, late) = (first.error - middle.error, middle.error - last.error);
    Ok(finding
        .part(
            "The error falls from the fewest states to the most, by more than two standard \
            errors.",
            first.error - last.error > 2.0 * first.standard_error.hypot(last.standard_error),
        )
        .part("It falls less over the upper half of the orders than over the lower.", late < early)
        .part("An iteration takes longer with every order.", points.windows(2).all(|w| w[1].micros > w[0].micros))
        .say(format!(
            "From {} to {} states an iteration goes from {:.0} to {:.0} µs and the mean error from {:.2} to {:.2} mV, \
             of which {early:.2} mV come with the first {} states.",
            first.states,
            last.states,
            first.micros,
            last.micros,
            first.error,
            last.error,
            middle.states - first.states
        )))
}
