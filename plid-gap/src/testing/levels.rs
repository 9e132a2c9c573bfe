//! A strongly stiffening oscillator at several levels, integrated like the true systems of the blind cases.

use std::f64::consts::TAU;

use nalgebra::dmatrix;
use plid_model::{Continuous, Model, Port};

use crate::case::Case;
use crate::case::record::{Channels, rms};
use crate::effects::Library;
use crate::testing::blind::integrate;
use crate::testing::{add_noise, four_records, held, only, random_input};

const RATE: f64 = 200.0;
const SAMPLES: usize = 800;

/// Frequency in rad/s and damping ratio of small motions.
const W: f64 = TAU * 17.0;
const ZETA: f64 = 0.05;

/// Ratio of the cubic to the linear stiffness. In the loudest record, the cubic stiffness is about as large as the
/// linear one.
const CUBIC: f64 = 0.8;

/// Returns the oscillator without its cubic spring, and with a port at which this spring acts.
fn oscillator() -> Model {
    let (a, b) = (dmatrix![0.0, 1.0; -W * W, -2.0 * ZETA * W], dmatrix![0.0; W * W]);
    let (step, input) = held(&a, &b, 1.0 / RATE);
    let mut model = Model::new(RATE, step, input, dmatrix![1.0, 0.0], dmatrix![0.0]).unwrap();
    model.continuous = Some(Continuous { a, b });
    model.ports = vec![Port {
        name: "axis".into(),
        input: Some("u1".into()),
        force: vec![0.0, W * W],
        displacement: vec![1.0, 0.0],
        velocity: vec![0.0, 1.0],
        output: None,
    }];
    model
}

fn case() -> Case {
    let sim = oscillator();
    let std = [1e-3];
    // The mean of two neighbouring samples concentrates the power of the input below the highest frequency of the
    // motion.
    let input = |k: usize| -> Channels {
        let drawn = &random_input(k as u64 + 1, SAMPLES + 1, 1)[0];
        vec![drawn.windows(2).map(|pair| 0.5 * (pair[0] + pair[1])).collect()]
    };
    four_records(&sim, &std, [0.15, 0.5, 1.5], input, |k, u| {
        let (mut y, _) = integrate(&sim, u, Some(&|d, _| -CUBIC * d.powi(3)));
        add_noise(&mut y, k as u64 + 50, &std);
        y
    })
}

/// The law is found in the record with the lowest level and extended to the one with the highest.
#[test]
fn a_strong_law_is_carried_up_from_the_weakest_level() {
    let mut case = case();
    only(&mut case, &["cubic-stiffness", "quadratic-stiffness", "modal-frequency", "actuator-gain"]);
    assert!(rms(&case.records[3].y[0]) > 0.5);
    let mut said = Vec::new();
    let found = crate::diagnose(&case, &Library::standard(), &mut |words| said.push(words)).unwrap().diagnosis;
    assert!(said.iter().any(|words| words.contains("in the weaker records is carried to all")), "{said:#?}");
    let named: Vec<&str> = found.effects.iter().map(|effect| effect.effect.as_str()).collect();
    assert_eq!(named, ["cubic-stiffness"], "{}", found.sentence);
    // A unit of force moves the oscillator by one, so that k is relative to its stiffness.
    let k = found.effects[0].parameters["k"].value;
    assert!((k / CUBIC - 1.0).abs() < 0.02, "{k}: {}", found.sentence);
    assert!(found.gap.as_given > 0.5 && found.gap.with_effect < 0.05 * found.gap.as_given, "{}", found.sentence);
}
