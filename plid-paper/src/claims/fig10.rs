//! Fig. 10: the costs and benefits of more states.

use ndarray::{Axis as Way, s};
use plid_bench::study::Machine;
use plid_core::NoiseModel;
use plid_report::{Axis, Chart, Series, chart};
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

fn run(context: &Context<'_>) -> Result<Finding> {
    let (mut base, vary): (_, Vary) = (context.experiment()?, context.vary()?);
    let truss = truss_of(&mut base);
    truss.duration_s = vary.samples as f64 / truss.sample_rate_hz;
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
            // Whatever else the machine does only adds to the time.
            micros = micros.min(1e6 * done.seconds / vary.samples as f64);
        }
        let (error, spread) = mean_and_spread(&errors);
        points.push((states, micros, error, spread / (errors.len() as f64).sqrt()));
    }
    let (first, last) = (points[0], *points.last().ok_or("no states")?);
    let middle = points.iter().copied().min_by_key(|p| p.0.abs_diff((first.0 + last.0) / 2)).ok_or("no states")?;
    let machine = Machine::here();
    let picture = chart(&Chart {
        title: String::new(),
        x: Axis::linear("time of an iteration, µs"),
        y: Axis::linear("mean |e|, mV"),
        series: vec![
            Series::line("", points.iter().map(|p| (p.1, p.2)).collect()).colour("#0072b2"),
            Series::points("24 to 64 states", points.iter().map(|p| (p.1, p.2)).collect()).colour("#0072b2"),
        ],
        height: 230.0,
    });
    let rows = points.iter().map(|(n, micros, error, spread)| {
        vec![n.to_string(), format!("{micros:.1}"), format!("{error:.2}"), format!("{spread:.2}")]
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
    for (states, micros, error, _) in &points {
        finding = finding.timed(format!("iteration, {states} states"), *micros, "µs").figure(
            format!("mean |e|, {states} states"),
            *error,
            "mV",
        );
    }
    let (early, late) = (first.2 - middle.2, middle.2 - last.2);
    Ok(finding
        .part(
            "The error falls from the fewest states to the most, by more than two standard \
            errors.",
            first.2 - last.2 > 2.0 * first.3.hypot(last.3),
        )
        .part("It falls less over the upper half of the orders than over the lower.", late < early)
        .part("An iteration takes longer with every order.", points.windows(2).all(|w| w[1].1 > w[0].1))
        .say(format!(
            "From {} to {} states an iteration goes from {:.0} to {:.0} µs and the mean error from {:.2} to {:.2} mV, \
             of which {early:.2} mV come with the first {} states.",
            first.0,
            last.0,
            first.1,
            last.1,
            first.2,
            last.2,
            middle.0 - first.0
        )))
}
