//! Claim: unstable and nonminimum-phase plants are identified.

use std::fmt::Write as _;

use nalgebra::{Complex, DMatrix};
use ndarray::Array2;
use plid_bench::study;
use plid_lab::experiment::Experiment;
use plid_model::signal::median;
use plid_model::{Model, simulate};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use serde::Deserialize;

use crate::claim::{Claim, Context, Finding, Result, claim};

pub const CLAIM: Claim = claim!("unstable",
    statement: "Neither open-loop stability nor minimum phase is assumed.",
    limit: "Two small plants of known poles and zeros, in open loop; the unstable one over a record that is short \
        enough to stay finite.",
    timed: false,
);

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Vary {
    seeds: u64,
}

/// A plant of three states with one input and one output, in observable canonical form: its characteristic polynomial
/// q^3 + a[0] q^2 + a[1] q + a[2] and its numerator b[0] q^2 + b[1] q + b[2].
struct Plant {
    name: &'static str,
    denominator: [f64; 3],
    numerator: [f64; 3],
    samples: usize,
}

/// Poles at 1.03 and 0.9 exp(+-0.7i). The response grows by a factor of 30 000 over the record.
const UNSTABLE: Plant = Plant {
    name: "unstable",
    denominator: [-2.406_715_937_112_079_7, 2.228_017_415_225_442, -0.8343],
    numerator: [1.0, -0.9, 0.32],
    samples: 350,
};
/// Poles at 0.8 and 0.9 exp(+-0.7i), zeros at 1.4 and 0.5.
const NON_MINIMUM_PHASE: Plant = Plant {
    name: "non-minimum-phase",
    denominator: [-2.176_715_937_112_079_2, 1.911_372_749_689_663_8, -0.648],
    numerator: [1.0, -1.9, 0.7],
    samples: 1000,
};
/// RMS of the sensor noise for an input of RMS 1.
const NOISE: f64 = 0.02;
const RATE_HZ: f64 = 100.0;

impl Plant {
    fn model(&self) -> Result<Model> {
        let [d1, d2, d3] = self.denominator;
        let [n1, n2, n3] = self.numerator;
        let a = DMatrix::from_row_slice(3, 3, &[0.0, 0.0, -d3, 1.0, 0.0, -d2, 0.0, 1.0, -d1]);
        let b = DMatrix::from_column_slice(3, 1, &[n3, n2, n1]);
        Ok(Model::new(RATE_HZ, a, b, DMatrix::from_row_slice(1, 3, &[0.0, 0.0, 1.0]), DMatrix::zeros(1, 1))?)
    }

    /// Returns the record u1,y1 with a white input of unit RMS and the response with sensor noise.
    fn csv(&self, seed: u64) -> Result<String> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
        let inputs = Array2::from_shape_simple_fn((self.samples, 1), &mut normal);
        let model = self.model()?;
        let outputs = simulate(&model, inputs.view(), &model.rest())?.outputs;
        let mut text = String::from("u1,y1\n");
        for (u, y) in inputs.iter().zip(&outputs) {
            writeln!(text, "{u:.6},{:.6}", y + NOISE * normal())?;
        }
        Ok(text)
    }
}

/// Returns the poles or the zeros: the eigenvalues of A, or those of A - B (C B)^-1 C A without the one at zero that
/// this form adds.
fn poles(model: &Model) -> Vec<Complex<f64>> {
    model.a.complex_eigenvalues().iter().copied().collect()
}

fn zeros(model: &Model) -> Vec<Complex<f64>> {
    let through = (&model.c * &model.b)[(0, 0)];
    let inner = &model.a - &model.b * (&model.c * &model.a) / through;
    let mut all: Vec<Complex<f64>> = inner.complex_eigenvalues().iter().copied().collect();
    all.sort_by(|x, y| y.norm().total_cmp(&x.norm()));
    all.pop();
    all
}

/// Returns the largest distance of a true root from the nearest root that was found.
fn distance(truth: &[Complex<f64>], found: &[Complex<f64>]) -> f64 {
    let nearest = |t: &Complex<f64>| found.iter().map(|f| (f - t).norm()).fold(f64::INFINITY, f64::min);
    truth.iter().map(nearest).fold(0.0, f64::max)
}

fn largest(roots: &[Complex<f64>]) -> f64 {
    roots.iter().map(|root| root.norm()).fold(0.0, f64::max)
}

/// The results of all seeds for one plant.
struct Found {
    pole_errors: Vec<f64>,
    zero_errors: Vec<f64>,
    /// The moduli of the outermost pole and zero of each model.
    outermost: Vec<(f64, f64)>,
}

fn find(context: &Context<'_>, base: &Experiment, plant: &Plant, seeds: u64) -> Result<Found> {
    let truth = plant.model()?;
    let (mut pole_errors, mut zero_errors, mut outermost) = (Vec::new(), Vec::new(), Vec::new());
    for seed in 1..=seeds {
        let file = format!("{}-{seed}.csv", plant.name);
        study::write(&context.directory.join(&file), plant.csv(seed)?)?;
        let mut experiment = base.clone();
        experiment.data.files = vec![file.into()];
        let model = context.identify(&experiment)?.model;
        pole_errors.push(distance(&poles(&truth), &poles(&model)));
        zero_errors.push(distance(&zeros(&truth), &zeros(&model)));
        outermost.push((largest(&poles(&model)), largest(&zeros(&model))));
    }
    Ok(Found { pole_errors, zero_errors, outermost })
}

/// Adds the figures and the part of one plant.
fn judge(mut finding: Finding, plant: &Plant, found: &Found, seeds: u64) -> Finding {
    let (pole, zero) = (median(&found.pole_errors), median(&found.zero_errors));
    let outside = |of: &dyn Fn(&(f64, f64)) -> f64| found.outermost.iter().filter(|x| of(x) > 1.0).count();
    finding = finding.figure(format!("error of the poles, {}", plant.name), pole, "").figure(
        format!("error of the zeros, {}", plant.name),
        zero,
        "",
    );
    let counted = if plant.name == UNSTABLE.name { outside(&|x| x.0) } else { outside(&|x| x.1) };
    let what = if plant.name == UNSTABLE.name { "pole" } else { "zero" };
    finding = finding
        .figure(
            format!("runs with a {what} outside of the unit circle, {}", plant.name),
            counted as f64,
            &format!("of {seeds}"),
        )
        .part(
            format!(
                "{}: in every run the model has its {what} outside of the unit circle, and poles and zeros are \
                    right to 0.05 in the median.",
                plant.name
            ),
            counted as u64 == seeds && pole < 0.05 && zero < 0.05,
        );
    finding
}

fn run(context: &Context<'_>) -> Result<Finding> {
    let (base, vary): (Experiment, Vary) = (context.experiment()?, context.vary()?);
    let mut finding = Finding::default();
    let mut rows = Vec::new();
    for plant in [&UNSTABLE, &NON_MINIMUM_PHASE] {
        let truth = plant.model()?;
        let found = find(context, &base, plant, vary.seeds)?;
        let (pole, zero) = (median(&found.pole_errors), median(&found.zero_errors));
        finding = judge(finding, plant, &found, vary.seeds);
        rows.push(vec![
            plant.name.into(),
            format!("{:.3}", largest(&poles(&truth))),
            format!("{:.3}", median(&found.outermost.iter().map(|x| x.0).collect::<Vec<_>>())),
            format!("{:.3}", largest(&zeros(&truth))),
            format!("{:.3}", median(&found.outermost.iter().map(|x| x.1).collect::<Vec<_>>())),
            format!("{pole:.4}"),
            format!("{zero:.4}"),
        ]);
    }
    let sentence = format!(
        "An unstable plant in open loop is identified with its poles right to {:.4}, one of non-minimum phase with \
         its zeros right to {:.4}, medians over {} records each.",
        finding.value("error of the poles, unstable"),
        finding.value("error of the zeros, non-minimum-phase"),
        vary.seeds
    );
    Ok(finding
        .table(
            &format!(
                "The outermost pole and zero, and the largest errors; medians over {} records with sensor noise \
                of 2 % of the input's RMS.",
                vary.seeds
            ),
            &[
                ("plant", ""),
                ("pole", "true"),
                ("pole", "found"),
                ("zero", "true"),
                ("zero", "found"),
                ("poles off", ""),
                ("zeros off", ""),
            ],
            rows,
        )
        .say(sentence))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_plants_have_the_poles_and_zeros_that_are_said() {
        let near = |found: Vec<Complex<f64>>, expected: &[Complex<f64>]| {
            assert!(distance(expected, &found) < 1e-9, "{found:?}")
        };
        let pair = [Complex::from_polar(0.9, 0.7), Complex::from_polar(0.9, -0.7)];
        let real = |x: f64| Complex::new(x, 0.0);
        near(poles(&UNSTABLE.model().unwrap()), &[pair[0], pair[1], real(1.03)]);
        near(poles(&NON_MINIMUM_PHASE.model().unwrap()), &[pair[0], pair[1], real(0.8)]);
        near(zeros(&NON_MINIMUM_PHASE.model().unwrap()), &[real(1.4), real(0.5)]);
        assert!(largest(&zeros(&UNSTABLE.model().unwrap())) < 1.0);
    }

    /// The records that `plid run` uses are those of seed 1.
    #[test]
    fn the_committed_records_are_those_of_seed_1() {
        let built_in = include_str!("../../experiments/unstable-1.csv");
        assert_eq!(UNSTABLE.csv(1).unwrap(), built_in);
    }
}
