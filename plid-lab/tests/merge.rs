//! Runs of the recursion merged: synthetic plants, uncontrollable modes, and whole merges from files.

use nalgebra::{DMatrix, DVector};
use ndarray::Array2;
use plid_core::{ImplicitModel, NoiseModel, ObservableForm, Settings};
use plid_lab::identify::{Ending, Plan, Samples, run};
use plid_lab::merge::{Combined, Knowledge, combine, consistency, Agreement};
use plid_catalogue::Variant;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// Two outputs with two states each.
const INDICES: [usize; 2] = [2, 2];
const STATES: usize = 4;
const OUTPUTS: usize = 2;

/// [a_1; a_2; b_1; ..; b_m] of a plant with modes of radius 0.9 or so, its columns of B random.
fn plant(random: &mut ChaCha8Rng, inputs: usize) -> Vec<f64> {
    let mut normal = || -> f64 { StandardNormal.sample(&mut *random) };
    let mut parameters = vec![
        -0.81 + 0.02 * normal(), 1.1 + 0.05 * normal(), 0.05 * normal(), 0.1 * normal(),
        0.05 * normal(), 0.1 * normal(), -0.85 + 0.02 * normal(), 0.3 + 0.05 * normal(),
    ];
    parameters.extend((0..inputs * STATES).map(|_| normal()));
    parameters
}

/// One record: x' = A x + b u + xi, z = C x + w, with `input` the number of the column of B that acts.
fn record(
    random: &mut ChaCha8Rng,
    parameters: &[f64],
    input: usize,
    samples: usize,
    sensor: f64,
    state: f64,
) -> (Array2<f64>, Array2<f64>) {
    let mut normal = || -> f64 { StandardNormal.sample(&mut *random) };
    let column = |t: usize| &parameters[t * STATES..(t + 1) * STATES];
    let (mut inputs, mut outputs) = (Array2::zeros((samples, 1)), Array2::zeros((samples, OUTPUTS)));
    let mut x = [0.0; STATES];
    for k in 0..samples {
        let u = normal();
        inputs[[k, 0]] = u;
        outputs[[k, 0]] = x[1] + sensor * normal();
        outputs[[k, 1]] = x[3] + sensor * normal();
        let next = |i: usize| {
            let shifted = if i % 2 == 1 { x[i - 1] } else { 0.0 };
            shifted + column(0)[i] * x[1] + column(1)[i] * x[3] + column(OUTPUTS + input)[i] * u
        };
        let moved: Vec<f64> = (0..STATES).map(next).collect();
        x = std::array::from_fn(|i| moved[i] + state * normal());
    }
    (inputs, outputs)
}

/// What PLID knows after a record, told the true noise.
fn knowledge(name: &str, input: usize, inputs: &Array2<f64>, outputs: &Array2<f64>, sensor: f64, state: f64) -> Knowledge {
    let form = ObservableForm::new(&INDICES, 1).unwrap();
    let noise = NoiseModel::diagonal(&[sensor * sensor; OUTPUTS], &[0.0], &[state * state; STATES]);
    let plan = Plan { settings: Settings::new(&form, 1.0, 1.0), form, noise, variant: Variant::default(), passes: 1 };
    let samples = Samples { inputs: inputs.view(), outputs: outputs.view(), nan_is_missing: false };
    let Ending::Done(done) = run(&plan, &[samples], None, &mut |_, _| true).unwrap() else { panic!("it was not interrupted") };
    let size = (OUTPUTS + 1) * STATES;
    let covariance = DMatrix::from_fn(size, size, |i, j| done.identified.covariance.at(STATES + i, STATES + j));
    let own = (OUTPUTS + input) * STATES;
    Knowledge {
        run: name.into(),
        places: (0..OUTPUTS * STATES).chain(own..own + STATES).collect(),
        estimate: DVector::from_vec(done.identified.parameters(&plan.form)),
        covariance,
        prior_variances: vec![1.0; size],
        overdispersion: 1.0,
    }
}

fn nees(merged: &Combined, truth: &[f64]) -> f64 {
    let error = &merged.estimate - DVector::from_column_slice(truth);
    error.dot(&merged.covariance.clone().cholesky().unwrap().solve(&error)) / truth.len() as f64
}

/// The normalised estimation error squared over seeds, for runs of different lengths and noise: its mean is within what chi-square allows.
#[test]
fn the_merged_covariance_is_honest() {
    const SEEDS: u64 = 60;
    let (mut merged_nees, mut single, mut disagree) = (0.0, 0.0, 0);
    for seed in 0..SEEDS {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let truth = plant(&mut random, 3);
        let runs: Vec<Knowledge> = [(1200, 0.02), (500, 0.02), (800, 0.1)]
            .iter()
            .enumerate()
            .map(|(j, &(samples, sensor))| {
                let (inputs, outputs) = record(&mut random, &truth, j, samples, sensor, 0.01);
                knowledge(&format!("run {j}"), j, &inputs, &outputs, sensor, 0.01)
            })
            .collect();
        let size = truth.len();
        let merged = combine(&runs, size).unwrap();
        merged_nees += nees(&merged, &truth) / SEEDS as f64;
        let alone = combine(&runs[..1], size).unwrap();
        let own = alone.estimate.rows(0, 8) - DVector::from_column_slice(&truth[..8]);
        let covariance = alone.covariance.view((0, 0), (8, 8)).into_owned();
        single += own.dot(&covariance.cholesky().unwrap().solve(&own)) / 8.0 / SEEDS as f64;
        disagree += usize::from(consistency(&runs, size).unwrap().agreement != Agreement::Agree);
    }
    println!("NEES merged {merged_nees:.3}, A of one run {single:.3}; {disagree} of {SEEDS} disagree");
    // 60 x 20 degrees of freedom: a standard deviation of 0.041; three of them.
    assert!((0.87..1.13).contains(&merged_nees), "{merged_nees}");
    assert!(disagree <= 3, "{disagree}");
}
