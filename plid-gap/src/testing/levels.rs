//! A strongly stiffening oscillator at several levels, integrated by a Runge-Kutta method of fourth order.

use std::f64::consts::TAU;

use nalgebra::dmatrix;
use plid_model::Model;

use crate::case::record::{Channels, rms};
use crate::case::{Case, PortConfig};
use crate::effects::Library;
use crate::testing::{add_noise, four_records, held, only, random_input};

const RATE: f64 = 200.0;
const SAMPLES: usize = 800;

/// Steps within a sample.
const STEPS: usize = 12;

/// Frequency in rad/s and damping ratio of small motions.
const W: f64 = TAU * 17.0;
const ZETA: f64 = 0.05;

/// The cubic stiffness over the linear one. In the loudest record, the spring stiffens by about its own stiffness.
const CUBIC: f64 = 0.8;

/// Returns the displacement under a command.
fn displacement(u: &[f64]) -> Vec<f64> {
    let h = 1.0 / (RATE * STEPS as f64);
    let rates = |u: f64, [d, v]: [f64; 2]| [v, W * W * (u - d - CUBIC * d * d * d) - 2.0 * ZETA * W * v];
    let mut x = [0.0; 2];
    let mut seen = Vec::new();
    for &u in u {
        seen.push(x[0]);
        for _ in 0..STEPS {
            let beside = |k: [f64; 2], by: f64| [x[0] + by * k[0], x[1] + by * k[1]];
            let a = rates(u, x);
            let b = rates(u, beside(a, 0.5 * h));
            let c = rates(u, beside(b, 0.5 * h));
            let d = rates(u, beside(c, h));
            x = std::array::from_fn(|k| x[k] + h / 6.0 * (a[k] + 2.0 * b[k] + 2.0 * c[k] + d[k]));
        }
    }
    seen
}

fn case() -> Case {
    let (a, b) = held(&dmatrix![0.0, 1.0; -W * W, -2.0 * ZETA * W], &dmatrix![0.0; W * W], 1.0 / RATE);
    let sim = Model::new(RATE, a, b, dmatrix![1.0, 0.0], dmatrix![0.0]).unwrap();
    let std = [1e-3];
    // A mean of two neighbours keeps most of the power below the fastest motion.
    let input = |k: usize| -> Channels {
        let drawn = &random_input(k as u64 + 1, SAMPLES + 1, 1)[0];
        vec![drawn.windows(2).map(|pair| 0.5 * (pair[0] + pair[1])).collect()]
    };
    let mut case = four_records(&sim, &std, [0.15, 0.5, 1.5], input, |k, u| {
        let mut y = vec![displacement(&u[0])];
        add_noise(&mut y, k as u64 + 50, &std);
        y
    });
    case.config.port = vec![PortConfig { name: "axis".into(), input: "u1".into(), output: "y1".into() }];
    case
}

/// The law is found in the weakest record and carried up to the loudest.
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
