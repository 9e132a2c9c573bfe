//! Diagnoses of plants without lightly damped modes, against truths that are integrated here.

use std::f64::consts::TAU;

use nalgebra::dmatrix;
use plid_model::Model;

use crate::answer::schema::Diagnosis;
use crate::case::record::{Excitation, Record, rms};
use crate::case::{Case, CaseConfig};
use crate::effects::Library;
use crate::judge::verdict::Verdict;
use crate::testing::{held, random_input, record};

const RATE: f64 = 250.0;
const SAMPLES: usize = 2500;

/// Samples over which a command is held, so that the axis moves.
const HOLD: usize = 10;

/// Parts of a sample in which the truth is integrated.
const PARTS: usize = 40;

/// A unit mass on a viscous damper `c` and a spring `k`, with a force of velocity and displacement beside them.
struct Axis {
    c: f64,
    k: f64,
    force: fn(f64, f64) -> f64,
    position: bool,
}

impl Axis {
    fn simulation(&self) -> Model {
        let (a, b) = held(&dmatrix![0.0, 1.0; -self.k, -self.c], &dmatrix![0.0; 1.0], 1.0 / RATE);
        let c = if self.position { dmatrix![1.0, 0.0] } else { dmatrix![0.0, 1.0] };
        let mut model = Model::new(RATE, a, b, c, dmatrix![0.0]).unwrap();
        if !self.position && self.k == 0.0 {
            // The position is no state of a motor that is seen by its velocity.
            let (a, b) = held(&dmatrix![-self.c], &dmatrix![1.0], 1.0 / RATE);
            model = Model::new(RATE, a, b, dmatrix![1.0], dmatrix![0.0]).unwrap();
        }
        model
    }

    /// The output by the classical Runge-Kutta method of fourth order.
    fn run(&self, u: &[f64]) -> Vec<f64> {
        let (mut x, mut v) = (0.0, 0.0);
        let step = 1.0 / (RATE * PARTS as f64);
        let slope = |u: f64, x: f64, v: f64| (v, u - self.c * v - self.k * x + (self.force)(v, x));
        u.iter()
            .map(|&u| {
                let seen = if self.position { x } else { v };
                for _ in 0..PARTS {
                    let k1 = slope(u, x, v);
                    let k2 = slope(u, x + 0.5 * step * k1.0, v + 0.5 * step * k1.1);
                    let k3 = slope(u, x + 0.5 * step * k2.0, v + 0.5 * step * k2.1);
                    let k4 = slope(u, x + step * k3.0, v + step * k3.1);
                    x += step / 6.0 * (k1.0 + 2.0 * k2.0 + 2.0 * k3.0 + k4.0);
                    v += step / 6.0 * (k1.1 + 2.0 * k2.1 + 2.0 * k3.1 + k4.1);
                }
                seen
            })
            .collect()
    }

    /// A quiet record and three driven ones, with 0.5 % of noise.
    fn case(&self) -> Case {
        let mut model = self.simulation();
        let command = |seed: u64, level: f64| -> Vec<f64> {
            let drawn = &random_input(seed, SAMPLES, 1)[0];
            (0..SAMPLES).map(|k| level * drawn[k / HOLD]).collect()
        };
        let std = 0.005 * rms(self.run(&command(1, 1.0)));
        let mut records = Vec::new();
        for (k, level) in [0.0, 1.0, 0.5, 1.0].into_iter().enumerate() {
            let u = command(k as u64 + 1, level);
            let mut y = self.run(&u);
            y.iter_mut().zip(&random_input(k as u64 + 50, SAMPLES, 1)[0]).for_each(|(y, e)| *y += std * e);
            let excitation = if level > 0.0 { Excitation::Random } else { Excitation::Zero };
            let start_s = (k * SAMPLES) as f64 / RATE;
            records.push(Record { name: format!("r{k}"), excitation, start_s, ..record(vec![u], vec![y]) });
        }
        model.noise.sensor_std = Some(vec![std]);
        model.noise.actuator_std = Some(vec![0.0]);
        let config = CaseConfig::new(RATE, model.inputs.clone(), model.outputs.clone());
        Case { config, model: Some(model), records, for_simulation: Vec::new(), warnings: Vec::new() }
    }

    fn diagnosed(&self) -> Diagnosis {
        crate::diagnose(&self.case(), &Library::standard(), &mut |_| {}).unwrap().diagnosis
    }
}

fn friction(v: f64, _x: f64) -> f64 {
    -0.1 * (v / 0.01).tanh()
}

fn none(_v: f64, _x: f64) -> f64 {
    0.0
}

fn is_friction(found: &Diagnosis) {
    assert_eq!(found.verdict, Verdict::Effects, "{}", found.sentence);
    let first = &found.effects[0];
    assert_eq!(
        (first.effect.as_str(), first.location.as_str()),
        ("coulomb-friction", "input:u1"),
        "{}",
        found.sentence
    );
    let size = first.parameters["F"].value;
    assert!((size / 0.1 - 1.0).abs() < 0.05, "{size}: {}", found.sentence);
}

#[test]
fn friction_in_a_motor_seen_by_its_velocity() {
    is_friction(&Axis { c: 4.0, k: 0.0, force: friction, position: false }.diagnosed());
}

#[test]
fn friction_on_a_slider_without_a_spring() {
    is_friction(&Axis { c: 4.0, k: 0.0, force: friction, position: true }.diagnosed());
}

#[test]
fn friction_in_a_well_damped_servo() {
    let w = TAU * 1.5;
    is_friction(&Axis { c: 1.4 * w, k: w * w, force: friction, position: true }.diagnosed());
}

#[test]
fn nothing_is_missing_from_a_sound_motor() {
    let found = Axis { c: 4.0, k: 0.0, force: none, position: false }.diagnosed();
    assert_eq!(found.verdict, Verdict::None, "{}", found.sentence);
}

/// A viscous damper that is 5 % off is within the stated limits (two standard deviations are 10 %), and is no friction.
#[test]
fn a_pole_within_its_limits_is_no_effect() {
    let real = Axis { c: 4.2, k: 0.0, force: none, position: false };
    let mut case = real.case();
    let noise = case.model.as_ref().unwrap().noise.clone();
    case.model = Some(Model { noise, ..Axis { c: 4.0, ..real }.simulation() });
    let found = crate::diagnose(&case, &Library::standard(), &mut |_| {}).unwrap().diagnosis;
    assert_eq!(found.verdict, Verdict::None, "{}", found.sentence);
}
