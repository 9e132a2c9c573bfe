use std::f64::consts::PI;

use nalgebra::DMatrix;
use plid_testbed::{ANTI_ALIAS_HZ, ConverterConfig, InputConfig, NoiseConfig, TrussConfig, simulate, truss};

use crate::{ideal, largest, rms};

fn noise_only(sensor_rms_v: f64, amplifier_rms_v: f64, ambient_rms_v: f64) -> TrussConfig {
    TrussConfig {
        duration_s: 1.0,
        noise: NoiseConfig { sensor_rms_v, amplifier_rms_v, ambient_rms_v, ..NoiseConfig::NONE },
        ..ideal()
    }
}

/// The covariance at rest obeys the continuous Lyapunov equation A P + P A^T + W = 0 with W of white forces on the
/// corners, built here from the shapes alone.
#[test]
fn ambient_covariance_obeys_the_continuous_lyapunov_equation() {
    for rate in [1600.0, 200.0] {
        let config = TrussConfig { sample_rate_hz: rate, input: InputConfig::Zero, ..TrussConfig::default() };
        let plant = truss(&config).unwrap();
        let (a, p) = (&plant.continuous.a, &plant.noise.at_rest);
        let w = -(a * p + p * a.transpose());
        let mut corners = DMatrix::<f64>::zeros(a.nrows(), 3);
        for l in 0..3 {
            for (m, mode) in plant.modes.iter().enumerate() {
                corners[(3 + 2 * m + 1, l)] = mode.output_shape[l];
                for i in 0..3 {
                    let row = a.nrows() - 6 + 2 * i + 1;
                    corners[(row, l)] += 2.0 * PI * ANTI_ALIAS_HZ * mode.output_shape[i] * mode.output_shape[l];
                }
            }
        }
        let shape = &corners * corners.transpose();
        let scale = w.dot(&shape) / shape.dot(&shape);
        let error = (&w - shape * scale).amax() / w.amax();
        assert!(error < 1e-6, "{error} at {rate} Hz");
    }
}

/// Q = int_0^T exp(A s) W exp(A s)^T ds by Simpson's rule, with W from the equation above.
#[test]
fn ambient_state_noise_is_the_integral_over_a_sample() {
    let plant = truss(&TrussConfig::default()).unwrap();
    let (a, p) = (&plant.continuous.a, &plant.noise.at_rest);
    let w = -(a * p + p * a.transpose());
    let intervals = 256;
    let h = 1.0 / 1600.0 / f64::from(intervals);
    let step = (a * h).exp();
    let mut transition = DMatrix::identity(a.nrows(), a.nrows());
    let mut integral = DMatrix::zeros(a.nrows(), a.nrows());
    for i in 0..=intervals {
        let weight = if i == 0 || i == intervals {
            1.0
        } else if i % 2 == 1 {
            4.0
        } else {
            2.0
        };
        integral += &transition * &w * transition.transpose() * (weight * h / 3.0);
        transition = &step * transition;
    }
    let error = (&plant.noise.state - &integral).amax() / integral.amax();
    assert!(error < 1e-6, "{error}");
}

#[test]
fn outputs_at_rest_are_15_to_20_millivolts() {
    let config = TrussConfig { input: InputConfig::Zero, repeats: 3, ..TrussConfig::default() };
    let run = simulate(&config).unwrap();
    let noise = &run.truth.noise;
    let model = &run.truth.discrete;
    // The amplifier's share by summing the squared pulse response.
    let mut through = model.b.clone();
    let mut amplifier = DMatrix::<f64>::zeros(3, 3);
    for _ in 0..12_000 {
        let g = &model.c * &through;
        amplifier += &g * &noise.actuator * g.transpose();
        through = &model.a * through;
    }
    let ambient = &model.c * &noise.at_rest * model.c.transpose();
    assert!(((ambient.trace() / 3.0).sqrt() - 0.016).abs() < 1e-9);
    for i in 0..3 {
        let expected = (ambient[(i, i)] + amplifier[(i, i)] + noise.sensor[(i, i)]).sqrt();
        assert!((0.015..=0.020).contains(&expected), "y{}: {expected} V", i + 1);
        let seen = rms(run.outputs.iter().flat_map(|y| y.column(i).to_vec()));
        assert!((seen / expected - 1.0).abs() < 0.12, "y{}: {seen} V, expected {expected} V", i + 1);
        println!("y{}: expected {expected:.5}, seen {seen:.5} V RMS at rest", i + 1);
    }
}

#[test]
fn records_start_in_ambient_motion() {
    let mut config = noise_only(0.0, 0.0, 0.016);
    config.input = InputConfig::Zero;
    config.duration_s = 1.0 / 1600.0;
    config.repeats = 600;
    let run = simulate(&config).unwrap();
    let seen = rms(run.outputs.iter().flat_map(|y| y.iter().copied().collect::<Vec<_>>()));
    // 600 independent triples: the standard error is at most 3 %.
    assert!((seen / 0.016 - 1.0).abs() < 0.1, "{seen}");
}

#[test]
fn a_source_turned_off_leaves_the_others_as_they_were() {
    let outputs = |config: &TrussConfig| simulate(config).unwrap().outputs.remove(0);
    let quiet = outputs(&noise_only(0.0, 0.0, 0.0));
    let all = outputs(&noise_only(0.005, 0.005, 0.016));
    let parts = [noise_only(0.005, 0.0, 0.0), noise_only(0.0, 0.005, 0.0), noise_only(0.0, 0.0, 0.016)];
    let mut sum = quiet.clone();
    for part in &parts {
        sum = sum + outputs(part) - &quiet;
    }
    assert!(largest((&all - &sum).view()) < 1e-12);
    assert!(largest((&all - &quiet).view()) > 0.01);
}

#[test]
fn sensor_noise_is_white_with_the_declared_covariance() {
    let config = TrussConfig {
        input: InputConfig::Zero,
        noise: NoiseConfig { sensor_rms_v: 0.005, ..NoiseConfig::NONE },
        ..TrussConfig::default()
    };
    let run = simulate(&config).unwrap();
    let w = &run.outputs[0];
    let (samples, declared) = (w.nrows(), &run.truth.noise.sensor);
    assert!((declared[(0, 0)] - (0.005_f64.powi(2) + 0.0025_f64.powi(2) / 12.0)).abs() < 1e-12);
    for i in 0..3 {
        for j in 0..3 {
            for lag in [0, 1, 2] {
                let seen = (lag..samples).map(|k| w[(k, i)] * w[(k - lag, j)]).sum::<f64>() / samples as f64;
                let expected = if lag == 0 { declared[(i, j)] } else { 0.0 };
                // Four standard errors of a mean of 20 800 products.
                let bound = 4.0 * declared[(0, 0)] * (2.0 / samples as f64).sqrt();
                assert!((seen - expected).abs() < bound, "{i} {j} {lag}: {seen} {expected}");
            }
        }
    }
}

#[test]
fn without_rounding_the_sensor_covariance_is_the_noise_alone() {
    let config = TrussConfig { converters: ConverterConfig { step_v: 0.0, range_v: 5.0 }, ..TrussConfig::default() };
    let noise = truss(&config).unwrap().noise;
    assert!((noise.sensor[(1, 1)] - 2.5e-5).abs() < 1e-18 && (noise.actuator[(2, 2)] - 2.5e-5).abs() < 1e-18);
    assert_eq!(noise.sensor[(0, 1)], 0.0);
}
