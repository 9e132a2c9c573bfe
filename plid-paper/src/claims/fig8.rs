//! Fig. 8: more states, more samples.

use plid_lab::experiment::{Experiment, NoiseSource};
use plid_model::Model;
use plid_model::signal::median;
use plid_report::{Axis, Chart, Series, chart};
use rayon::prelude::*;
use serde::Deserialize;

use crate::claim::{Claim, Context, Finding, Result, claim};
use crate::truss::{
    ACTUATOR, BAND_HZ, MODES_HZ, ModeRow, SENSOR, band_error, covariances, modes, overlay, truth, with_mode_columns,
    with_samples, with_seed,
};

pub const CLAIM: Claim = claim!("fig8",
    statement: "With 27 and 30 states the MIMO transfer function is better than with 24: more states are better. The \
        peak at 168 Hz is too low because too few samples were used.",
    limit: "Which peaks need how many states depends on shapes and damping that the paper does not give.",
    timed: false,
);

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Vary {
    states: Vec<usize>,
    samples: Vec<usize>,
    seeds: u64,
    /// The number of samples at which numbers of states are compared, and the number of states at which numbers of
    /// samples are compared.
    at_samples: usize,
    at_states: usize,
    noise: Vec<NoiseSource>,
}

/// The quality of a model: its error in the band, and the modes of the paper's pair.
#[derive(Clone)]
struct Worth {
    band: f64,
    modes: Vec<ModeRow>,
}

fn worth(truth: &Model, model: &Model) -> Result<Worth> {
    Ok(Worth { band: band_error(truth, model, BAND_HZ), modes: modes(truth, model, SENSOR, ACTUATOR)? })
}

/// Returns the experiment with a number of states and of samples.
fn experiment(base: &Experiment, (states, samples): (usize, usize), seed: u64, noise: NoiseSource) -> Experiment {
    let mut experiment = with_samples(&with_seed(base, states, seed), samples);
    experiment.noise.from = noise;
    experiment
}

/// Returns the median over seeds of the error in the band.
fn band(worths: &[Worth]) -> f64 {
    median(&worths.iter().map(|w| w.band).collect::<Vec<_>>())
}

/// Returns the median over seeds of the error in the height of a mode in dB.
fn height(worths: &[Worth], mode: usize) -> f64 {
    median(&worths.iter().map(|w| w.modes[mode].db_off()).collect::<Vec<_>>())
}

/// Returns the mean over seeds of the number of modes that are close.
fn close(worths: &[Worth]) -> f64 {
    worths.iter().flat_map(|w| &w.modes).filter(|row| row.is_close()).count() as f64 / worths.len() as f64
}

/// The models of all seeds for every number of states and of samples.
struct Study {
    /// Numbers of states and of samples.
    cells: Vec<(usize, usize)>,
    /// For every cell, the models of its seeds.
    table: Vec<Vec<Worth>>,
}

impl Study {
    fn run(context: &Context<'_>, truth: &Model, base: &Experiment, vary: &Vary, noise: NoiseSource) -> Result<Self> {
        let cells: Vec<(usize, usize)> =
            vary.states.iter().flat_map(|&n| vary.samples.iter().map(move |&k| (n, k))).collect();
        let table = cells
            .par_iter()
            .map(|&cell| {
                let seeds = (1..=vary.seeds).into_par_iter();
                seeds.map(|seed| worth(truth, &context.identify(&experiment(base, cell, seed, noise))?.model)).collect()
            })
            .collect::<Result<_>>()?;
        Ok(Self { cells, table })
    }

    fn at(&self, n: usize, k: usize) -> Result<&[Worth]> {
        let place = self.cells.iter().position(|&cell| cell == (n, k));
        let place =
            place.ok_or_else(|| format!("{n} states and {k} samples are not in the lists of fig8.vary.toml"))?;
        Ok(&self.table[place])
    }

    fn picture(&self, vary: &Vary) -> Result<String> {
        let lines = vary.states.iter().map(|&n| {
            let points = vary
                .samples
                .iter()
                .map(|&k| Ok((k as f64, 100.0 * band(self.at(n, k)?))))
                .collect::<Result<Vec<_>>>()?;
            Ok(Series::line(format!("{n} states"), points))
        });
        Ok(chart(&Chart {
            title: String::new(),
            x: Axis::log("samples learnt from"),
            y: Axis::log("error in 50-300 Hz, %"),
            series: lines.collect::<Result<_>>()?,
            height: 230.0,
        }))
    }

    /// Returns the rows of the table, one for each cell.
    fn rows(&self) -> Vec<Vec<String>> {
        let rows = self.cells.iter().zip(&self.table).map(|(&(n, k), worths)| {
            let heights = (0..MODES_HZ.len()).map(|mode| format!("{:+.2}", height(worths, mode)));
            let errors =
                [n.to_string(), k.to_string(), format!("{:.1}", 100.0 * band(worths)), format!("{:.1}", close(worths))];
            errors.into_iter().chain(heights).collect()
        });
        rows.collect()
    }

    /// Adds the figures, the picture and the table of one source of covariances.
    fn add_to(&self, mut finding: Finding, vary: &Vary, name: &str) -> Result<Finding> {
        for &states in &vary.states {
            let worths = self.at(states, vary.at_samples)?;
            finding = finding
                .figure(format!("error in band, {states} states, {name}"), 100.0 * band(worths), "%")
                .figure(format!("peaks within 3 dB, {states} states, {name}"), close(worths), "of 5");
        }
        for &samples in &vary.samples {
            let worths = self.at(vary.at_states, samples)?;
            finding = finding.figure(format!("168 Hz, {samples} samples, {name}"), height(worths, 1), "dB off");
        }
        let picture = self.picture(vary)?;
        let rows = self.rows();
        let heads =
            with_mode_columns(&[("states", ""), ("samples", ""), ("error in band", "%"), ("within 3 dB", "of 5")]);
        finding = finding
            .picture(
                picture,
                format!("Error of all nine responses against samples, {name}, median over {} seeds.", vary.seeds),
            )
            .table(
                &format!("The paper's pair, {name}, medians over seeds; +inf where a peak is not there."),
                &heads,
                rows,
            );
        Ok(finding)
    }
}

fn run(context: &Context<'_>) -> Result<Finding> {
    let (base, vary): (_, Vary) = (context.experiment()?, context.vary()?);
    let truth = truth(&base)?;
    let mut finding = Finding::default();
    for &noise in &vary.noise {
        let name = covariances(noise);
        let study = Study::run(context, &truth, &base, &vary, noise)?;
        finding = study.add_to(finding, &vary, name)?;
    }
    let first = covariances(vary.noise[0]);
    for &states in vary.states.iter().filter(|&&n| n == 24 || n == 30) {
        let model = context.identify(&experiment(&base, (states, vary.at_samples), 1, vary.noise[0]))?.model;
        finding = finding.picture(
            overlay(&truth, &model, SENSOR, ACTUATOR),
            format!("Actuator 1 to sensor 2, {states} states, {} samples, {first}, seed 1.", vary.at_samples),
        );
    }
    let band = |n: usize| finding.value(&format!("error in band, {n} states, {first}"));
    let low = |k: usize| finding.value(&format!("168 Hz, {k} samples, {first}"));
    let (few, many) = (vary.samples[0], *vary.samples.last().ok_or("no samples")?);
    let (b24, b27, b30, few_db, many_db) = (band(24), band(27), band(30), low(few), low(many));
    let never_low = (0..vary.samples.len()).all(|k| low(vary.samples[k]) > -1.0);
    Ok(finding
        .part(
            "At the same samples, 27 states have a smaller error in band than 24, and 30 a smaller one than 27, with \
            the paper's covariances.",
            b30 < b27 && b27 < b24,
        )
        .part("At some number of samples the peak at 168 Hz is too low, by 1 dB at least.", !never_low)
        .part(
            "With the fewest samples it is lower than with the most, by 0.5 dB at least, and with the most it is \
             within 1 dB: too few samples were the cause.",
            many_db - few_db > 0.5 && many_db.abs() < 1.0,
        )
        .say(format!(
            "With {} samples and the paper's covariances the error in band is {b24:.1} % at 24 states, {b27:.1} % at \
             27 and {b30:.1} % at 30. The peak at 168 Hz is off by {few_db:+.2} dB after {few} samples and by \
             {many_db:+.2} dB after {many}.",
            vary.at_samples
        )))
}
