//! Fig. 6: the convergence of the recursion, without averages and with ten.

use ndarray::{Array2, s};
use plid_core::NoiseModel;
use plid_lab::experiment::{Experiment, NoiseSource};
use plid_model::signal::convergence;
use plid_model::signal::median;
use plid_report::{Axis, Chart, ConvergencePlot, Scale, Series, chart, convergence_plot};
use rayon::prelude::*;
use serde::Deserialize;

use crate::claim::{Claim, Context, Finding, Result, claim};
use crate::course::{course, form_and_start};
use crate::truss::{MODES_HZ, curve, mean_and_spread, truss_of, with_and_without_averages};

pub const CLAIM: Claim = claim!("fig6",
    statement: "The convergence plot (largest absolute one-step error over the sensors, a sample at a time) comes down \
        to about 30 mV without averages and 20 mV with ten; single peaks come down from 40 to 20 mV.",
    limit: "The levels depend on the noise of the real outputs, which is known only as a figure for the whole (15-20 \
        mV at rest), and on the assumed covariances. That averaging lowers them can be tested.",
    timed: false,
);

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Vary {
    seeds: u64,
    duration_s: f64,
    /// Interval between plots of the transfer function, and the last step plotted.
    every: usize,
    until: usize,
}

/// Duration in s at the end over which the final level is computed.
const END_S: f64 = 1.0;

/// Carries out one run and returns the largest |e| of every training sample in V.
fn errors(context: &Context<'_>, experiment: &Experiment) -> Result<Array2<f64>> {
    let outcome = context.identify(experiment)?;
    let learnt = outcome.validation.training;
    Ok(outcome.validation.innovations[0].slice(s![..learnt, ..]).to_owned())
}

/// Returns median and maximum of the largest |e| over the last second in mV.
fn end(errors: &Array2<f64>, rate: f64) -> (f64, f64) {
    let largest = convergence(errors.view(), 1).largest;
    let last = &largest[largest.len().saturating_sub((END_S * rate) as usize)..];
    (1e3 * median(last), 1e3 * last.iter().copied().fold(0.0, f64::max))
}

/// Adds the figures and the picture of the runs of one kind, and returns their row of the table.
fn end_of_runs(mut finding: Finding, name: &str, runs: &[Array2<f64>], rate: f64) -> (Finding, Vec<String>) {
    let (levels, peaks): (Vec<f64>, Vec<f64>) = runs.iter().map(|errors| end(errors, rate)).unzip();
    let ((level, spread), (peak, peak_spread)) = (mean_and_spread(&levels), mean_and_spread(&peaks));
    finding = finding
        .figure(format!("level, {name}"), level, "mV")
        .figure(format!("spread of the level, {name}"), spread, "mV")
        .figure(format!("peak, {name}"), peak, "mV");
    let row = vec![
        name.into(),
        format!("{level:.1}"),
        format!("{spread:.1}"),
        format!("{peak:.0}"),
        format!("{peak_spread:.0}"),
    ];
    let plot = convergence_plot(&ConvergencePlot {
        convergence: &convergence(runs[0].view(), 60),
        sample_rate_hz: rate,
        unit: "V".into(),
        noise_floor: None,
        time_scale: Scale::Linear,
        error_scale: Scale::Log,
    });
    finding = finding.picture(plot, format!("Largest one-step error over the sensors: {name}, seed 1."));
    (finding, row)
}

fn run(context: &Context<'_>) -> Result<Finding> {
    let (mut base, vary): (_, Vary) = (context.experiment()?, context.vary()?);
    truss_of(&mut base).duration_s = vary.duration_s;
    let ten = truss_of(&mut base.clone()).repeats;
    let rate = truss_of(&mut base.clone()).sample_rate_hz;
    let setting = |seed: u64, repeats: usize, from: NoiseSource| {
        let mut experiment = base.clone();
        experiment.noise.from = from;
        let truss = truss_of(&mut experiment);
        (truss.seed, truss.repeats) = (seed, repeats);
        experiment
    };
    let kinds = with_and_without_averages(ten);
    let mut finding = Finding::default();
    let mut rows = Vec::new();
    for (name, repeats, from) in kinds {
        let runs: Vec<Array2<f64>> = (1..=vary.seeds)
            .into_par_iter()
            .map(|seed| errors(context, &setting(seed, repeats, from)))
            .collect::<Result<_>>()?;
        let row;
        (finding, row) = end_of_runs(finding, name, &runs, rate);
        rows.push(row);
    }
    let value = |what: &str, name: &str| finding.value(&format!("{what}, {name}"));
    let [one, ten_averages, tuned_one, tuned_ten] = kinds.map(|(name, ..)| value("level", name));
    let [peak_one, peak_ten, ..] = kinds.map(|(name, ..)| value("peak", name));
    let (watched, unheard) = waterfall(&setting(1, ten, NoiseSource::PaperLiteral), &vary)?;
    Ok(finding
        .figure("modes that show within 3 dB at the last curve", watched as f64, "of 5")
        .part(
            "Averaging ten records lowers the level at the end, by more than its spread over seeds, with the paper's \
            covariances.",
            one > ten_averages,
        )
        .part(
            "The level without averages is 30 mV within half of that, for the real noise is known no \
            better.",
            (15.0..=45.0).contains(&one),
        )
        .part("The level with ten averages is 20 mV within half of that.", (10.0..=30.0).contains(&ten_averages))
        .part("Single peaks come down by a factor of two, 1.5 at least.", peak_one > 1.5 * peak_ten)
        .picture(
            unheard,
            format!(
                "The identified transfer function every {} steps, actuator 1 to sensor 2, ten \
            averages, the paper's covariances; each curve is 10 dB above the former. The measured peaks are \
            marked.",
                vary.every
            ),
        )
        .table(
            &format!("The last second, over {} seeds: median of the largest error, and its largest value.", vary.seeds),
            &[("run", ""), ("level", "mV"), ("spread", "mV"), ("peak", "mV"), ("spread", "mV")],
            rows,
        )
        .say(format!(
            "With the paper's covariances the level at the end is {one:.1} mV without averages and {ten_averages:.1} \
             mV with ten, single peaks {peak_one:.0} and {peak_ten:.0} mV; with tuned covariances the level is \
             {tuned_one:.1} and {tuned_ten:.1} mV."
        )))
}

/// Plots how the transfer function converges, and counts the modes that the last curve has within 3 dB.
fn waterfall(experiment: &Experiment, vary: &Vary) -> Result<(usize, String)> {
    let mut experiment = experiment.clone();
    let states = experiment.structure.states.unwrap_or(30);
    let truth = crate::truss::truth(&experiment)?;
    let truss = truss_of(&mut experiment);
    let simulation = plid_testbed::simulate(truss)?;
    let mean = simulation.outputs.iter().fold(Array2::zeros(simulation.noise_free.dim()), |sum, y| sum + y)
        / simulation.outputs.len() as f64;
    let part = s![..vary.until.min(mean.nrows()), ..];
    let noise = NoiseModel::paper_literal(mean.ncols(), simulation.commands.ncols(), states);
    let record = (simulation.commands.slice(part), mean.slice(part));
    let course = course(record, simulation.sample_rate_hz, &form_and_start(states, record)?, &noise, vary.every)?;
    let mut series: Vec<Series> = MODES_HZ.iter().map(|&hz| Series::vertical("", hz).colour("#bdbdbd")).collect();
    for (number, (_, model)) in course.models.iter().enumerate() {
        let curve = curve(model, crate::truss::SENSOR, crate::truss::ACTUATOR);
        // The points are one hertz apart, which is the width of the narrowest mode.
        let points = curve.frequency_hz.iter().zip(&curve.response).step_by(4);
        let points = points.map(|(hz, h)| (*hz, 20.0 * h.norm().log10().max(-4.0) + 10.0 * number as f64)).collect();
        series.push(Series::line("", points).colour("#0072b2").width(0.8));
    }
    let picture = chart(&Chart {
        title: String::new(),
        x: Axis::linear("frequency, Hz").range(50.0, 300.0).step(50.0),
        y: Axis::linear("|H|, dB, each curve 10 dB up"),
        series,
        height: 560.0,
    });
    let last = course.models.last().ok_or("no model was kept: `until` is below `every`")?;
    let rows = crate::truss::modes(&truth, &last.1, crate::truss::SENSOR, crate::truss::ACTUATOR)?;
    Ok((rows.iter().filter(|row| row.is_close()).count(), picture))
}
