//! An axis with a slipping joint, whose stiffness is part of the simulation. The Bouc-Wen law is integrated in small
//! steps.

use nalgebra::dmatrix;
use plid_model::Model;

use crate::case::Case;
use crate::case::record::Channels;
use crate::testing::{case_of_axis, diagnosed_among, first_is, held, random_input};

const RATE: f64 = 250.0;
const SAMPLES: usize = 2500;

/// Number of samples over which a command is held.
const HOLD: usize = 10;

/// Number of integration steps per sample.
const STEPS: usize = 40;

/// Stiffness of the axis, which has unit mass and a damper of `DAMPER`. The part `JOINT` of the stiffness belongs to
/// the joint, which yields at the displacement `YIELD`. The motion has an RMS of about 0.003.
const SPRING: f64 = 120.0;
const DAMPER: f64 = 14.0;
const JOINT: f64 = 70.0;
const YIELD: f64 = 0.002;

/// Returns the displacement of the axis under a command.
fn displacement(u: &[f64]) -> Vec<f64> {
    let [mut d, mut v, mut z] = [0.0_f64; 3];
    let h = 1.0 / (RATE * STEPS as f64);
    let rates = |u: f64, [d, v, z]: [f64; 3]| {
        let slip = v - (v.abs() * z + v * z.abs()) / (2.0 * YIELD);
        [v, u - DAMPER * v - (SPRING - JOINT) * d - JOINT * z, slip]
    };
    let mut seen = Vec::new();
    for &u in u {
        seen.push(d);
        for _ in 0..STEPS {
            // Heun's method.
            let first = rates(u, [d, v, z]);
            let second = rates(u, [d + h * first[0], v + h * first[1], z + h * first[2]]);
            let mean: [f64; 3] = std::array::from_fn(|k| 0.5 * (first[k] + second[k]));
            (d, v, z) = (d + h * mean[0], v + h * mean[1], z + h * mean[2]);
        }
    }
    seen
}

/// Returns the axis with a joint that sticks.
fn simulation() -> Model {
    let (a, b) = held(&dmatrix![0.0, 1.0; -SPRING, -DAMPER], &dmatrix![0.0; 1.0], 1.0 / RATE);
    Model::new(RATE, a, b, dmatrix![1.0, 0.0], dmatrix![0.0]).unwrap()
}

fn case() -> Case {
    let input = |k: usize| -> Channels {
        let drawn = &random_input(k as u64 + 1, SAMPLES, 1)[0];
        vec![(0..SAMPLES).map(|n| drawn[n / HOLD]).collect()]
    };
    case_of_axis(&simulation(), input, |u| vec![displacement(&u[0])])
}

/// The joint is named with its stiffness, its yield displacement and the share that the simulation contains.
#[test]
fn a_joint_that_the_simulation_takes_for_stuck_is_named_on_an_axis() {
    let rivals = ["iwan-joint", "clearance", "cubic-stiffness", "coulomb-friction", "stick-friction", "backlash"];
    let all = [&["joint-hysteresis", "added-stiffness", "added-damping"], &rivals[..]].concat();
    let found = diagnosed_among(case(), &all);
    let first = first_is(&found, "joint-hysteresis", "input:u1");
    let near = |name: &str, truth: f64| (first.parameters[name].value / truth - 1.0).abs() < 0.05;
    assert!(near("k", JOINT) && near("dy", YIELD) && near("s", 1.0), "{}", found.text());
    assert!(found.gap.with_effect < 1.2 * found.gap.noise_floor, "{}", found.sentence);
}
