//! Claim: some imperfections do no harm.

use plid_core::ImplicitModel;
use plid_lab::experiment::{Covariance, Experiment, NoiseSource};
use plid_testbed::{ConverterConfig, CubicJoint, EffectsConfig, NoiseConfig};
use rayon::prelude::*;
use serde::Deserialize;

use crate::claim::{Claim, Context, Finding, Result, claim};
use crate::course::noise_of;
use crate::truss::{BAND_HZ, band_error, modes_of_all_pairs, truss_of, truth};

pub const CLAIM: Claim = claim!("robust",
    statement: "12-bit converters, noise that is not white or misjudged, a weak nonlinearity and a slow drift do no \
        harm.",
    limit: "How weak and how slow the real truss's effects were is not known: those here are stated, and the outputs \
        change by about 1 %.",
    timed: false,
);

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Vary {
    duration_s: f64,
    /// Cubic coefficient at strut 2 in 1/V^2.
    cubic_per_v2: f64,
    drift_per_s: f64,
    /// Factors by which the covariances are wrong.
    factors: Vec<f64>,
}

/// The result of one setting: free-run error on held-out data, error in the band, and number of peaks within 3 dB.
struct Row {
    name: String,
    free_run: f64,
    band: f64,
    close: usize,
    peaks: usize,
    worst_db: f64,
}

impl Row {
    /// Whether every peak of every pair is within 3 dB.
    fn is_harmless(&self) -> bool {
        self.close == self.peaks
    }

    fn cells(&self) -> Vec<String> {
        vec![
            self.name.clone(),
            format!("{:.2}", self.free_run),
            format!("{:.2}", self.band),
            format!("{} of {}", self.close, self.peaks),
            format!("{:.2}", self.worst_db),
        ]
    }
}

fn row(context: &Context<'_>, name: String, experiment: &Experiment) -> Result<Row> {
    let truth = truth(experiment)?;
    let outcome = context.identify(experiment)?;
    let rows = modes_of_all_pairs(&truth, &outcome.model)?;
    Ok(Row {
        name,
        free_run: 100.0 * outcome.validation.free_run_errors.overall_relative,
        band: 100.0 * band_error(&truth, &outcome.model, BAND_HZ),
        close: rows.iter().filter(|row| row.is_close()).count(),
        peaks: rows.len(),
        worst_db: rows
            .iter()
            .map(|row| row.db_off().abs())
            .fold(0.0, |worst, db| if db > worst || db.is_nan() { db } else { worst }),
    })
}

/// Returns the experiments with their names, and the number of those before the misjudged covariances.
fn settings(context: &Context<'_>, mut base: Experiment, vary: &Vary) -> Result<(Vec<(String, Experiment)>, usize)> {
    let converters = truss_of(&mut base).converters.clone();
    let noise = truss_of(&mut base).noise.clone();
    let truss = truss_of(&mut base);
    truss.duration_s = vary.duration_s;
    truss.converters = ConverterConfig { step_v: 0.0, range_v: f64::INFINITY };
    truss.noise = NoiseConfig { ambient_rms_v: 0.0, amplifier_rms_v: 0.0, ..noise.clone() };
    truss.effects = EffectsConfig::default();
    let with = |change: &dyn Fn(&mut Experiment)| {
        let mut experiment = base.clone();
        change(&mut experiment);
        experiment
    };
    let bits = |e: &mut Experiment| truss_of(e).converters = converters.clone();
    let coloured = |e: &mut Experiment| truss_of(e).noise = noise.clone();
    let cubic = |e: &mut Experiment| {
        truss_of(e).effects.cubic_joint = Some(CubicJoint { input: 2, stiffness_per_v2: vary.cubic_per_v2 });
    };
    let drift = |e: &mut Experiment| truss_of(e).effects.stiffness_drift_per_s = vary.drift_per_s;
    let all = with(&|e| {
        bits(e);
        coloured(e);
        cubic(e);
        drift(e);
    });
    let mut settings = vec![
        ("none: white sensor noise of 5 mV".to_string(), base.clone()),
        ("12-bit converters".into(), with(&bits)),
        ("ambient and amplifier noise, coloured by the structure".into(), with(&coloured)),
        (format!("cubic stiffness {:e} /V²", vary.cubic_per_v2), with(&cubic)),
        (format!("stiffness drift {:e} /s", vary.drift_per_s), with(&drift)),
        ("all together".into(), all.clone()),
    ];
    let factors = settings.len();
    // The misjudged covariances are those that the bank found, with R, Sigma or both wrong by a factor.
    let tuned = context.identify(&all)?;
    let found = noise_of(&tuned);
    let told = |r: f64, sigma: f64| {
        let mut experiment = all.clone();
        experiment.noise.from = NoiseSource::Given;
        let p = tuned.form.outputs();
        experiment.noise.sensor = Some(Covariance::Diagonal((0..p).map(|i| r * found.sensor.at(i, i)).collect()));
        experiment.noise.state =
            Some(Covariance::Diagonal((0..tuned.form.states()).map(|i| sigma * found.state.at(i, i)).collect()));
        experiment
    };
    for &factor in &vary.factors {
        settings.push((format!("all, R wrong by {factor:e}"), told(factor, 1.0)));
        settings.push((format!("all, Σ wrong by {factor:e}"), told(1.0, factor)));
        settings.push((format!("all, R and Σ wrong by {factor:e}"), told(factor, factor)));
    }
    Ok((settings, factors))
}

fn run(context: &Context<'_>) -> Result<Finding> {
    let (base, vary): (Experiment, Vary) = (context.experiment()?, context.vary()?);
    let (settings, factors) = settings(context, base, &vary)?;
    let rows = settings
        .into_par_iter()
        .map(|(name, experiment)| row(context, name, &experiment))
        .collect::<Result<Vec<Row>>>()?;
    let mut finding = Finding::default();
    for row in &rows {
        finding = finding.figure(format!("error in band, {}", row.name), row.band, "%").figure(
            format!("peaks within 3 dB, {}", row.name),
            row.close as f64,
            &format!("of {}", row.peaks),
        );
    }
    let table = rows.iter().map(Row::cells);
    let worst = rows[factors..].iter().max_by(|a, b| a.band.total_cmp(&b.band)).ok_or("no factors")?;
    let wrong = rows[factors..].iter().filter(|row| row.is_harmless()).count();
    let rule = "every peak of every pair stays within 3 dB";
    for row in &rows[1..factors] {
        finding = finding.part(format!("With {}, {rule}.", row.name), row.is_harmless());
    }
    let misjudged = rows.len() - factors;
    Ok(finding
        .part(format!("With all of it and covariances wrong by up to two decades, {rule}."), wrong == misjudged)
        .table(
            "One factor at a time, all together, and all with misjudged covariances.",
            &[
                ("what is not ideal", ""),
                ("free run", "%"),
                ("error in band", "%"),
                ("peaks within 3 dB", ""),
                ("worst peak", "dB"),
            ],
            table.collect(),
        )
        .say(format!(
            "The error in the band is {:.2} % under ideal conditions and {:.2} % with all factors together, and {} of \
             {} peaks stay within 3 dB. Of {misjudged} misjudged settings {wrong} keep every peak within 3 dB; the \
             worst ({}) has an error of {:.1} %.",
            rows[0].band,
            rows[factors - 1].band,
            rows[factors - 1].close,
            rows[factors - 1].peaks,
            worst.name,
            worst.band
        )))
}
