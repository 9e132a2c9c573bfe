//! The truths are plain difference equations, which share no code with the signals and filters of the black box.

use nalgebra::{Matrix4, RowVector4, Vector4};
use plid_gap::case::Excitation;
use plid_gap::research::{Known, prepare};
use plid_model::Model;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha12Rng;
use serde_json::json;

use super::*;

const RATE: f64 = 400.0;
const NOISE: f64 = 0.002;

/// Two lightly damped modes of 22 and 57 Hz: x+ = A x + B u, y = C x.
struct TwoModes {
    a: Matrix4<f64>,
    b: Vector4<f64>,
    c: RowVector4<f64>,
}

impl TwoModes {
    fn new() -> Self {
        let mut a = Matrix4::zeros();
        for (k, (radius, angle)) in [(0.99_f64, 0.35_f64), (0.98, 0.9)].into_iter().enumerate() {
            let (sin, cos) = angle.sin_cos();
            let block = [[cos, sin], [-sin, cos]];
            (0..4).for_each(|i| a[(2 * k + i / 2, 2 * k + i % 2)] = radius * block[i / 2][i % 2]);
        }
        Self { a, b: Vector4::new(0.0, 0.3, 0.0, 0.2), c: RowVector4::new(0.4, 0.0, 0.5, 0.0) }
    }

    fn model(&self) -> Model {
        let rows = |k: usize| (0..4).map(|j| self.a[(k, j)]).collect::<Vec<f64>>();
        let text = json!({
            "format": "state-space", "sample_rate_hz": RATE, "inputs": ["u1"], "outputs": ["y1"],
            "A": (0..4).map(rows).collect::<Vec<_>>(),
            "B": self.b.iter().map(|b| [*b]).collect::<Vec<_>>(),
            "C": [self.c.iter().copied().collect::<Vec<f64>>()], "D": [[0.0]],
        });
        Model::from_json(&text, "here").unwrap()
    }

    /// Returns the output if one law distorts the command, another the output, and a third feeds the output back.
    fn output(&self, u: &[f64], truth: &Truth) -> Vec<f64> {
        let mut x = Vector4::zeros();
        let step = |u: &f64| {
            let y: f64 = (self.c * x)[0];
            x = self.a * x + self.b * ((truth.actuator)(*u) - (truth.feedback)(y));
            (truth.sensor)(y)
        };
        u.iter().map(step).collect()
    }
}

struct Truth {
    actuator: fn(f64) -> f64,
    sensor: fn(f64) -> f64,
    feedback: fn(f64) -> f64,
}

const LINEAR: Truth = Truth { actuator: |u| u, sensor: |y| y, feedback: |_| 0.0 };

/// Returns records from rest at several levels. No model learns from the last one.
fn records(system: &TwoModes, truth: &Truth) -> Vec<Record> {
    let mut rng = ChaCha12Rng::seed_from_u64(5);
    let mut start = 0;
    let mut one = |(k, level): (usize, f64)| {
        let samples = 3000;
        let mut held = 0.0;
        let u: Vec<f64> = (0..samples)
            .map(|_| {
                held = 0.6 * held + rng.random_range(-1.0..1.0);
                1.4 * level * held
            })
            .collect();
        let mut y = system.output(&u, truth);
        y.iter_mut().for_each(|y| *y += NOISE * rng.random_range(-1.0..1.0) * 3f64.sqrt());
        let start_s = start as f64 / RATE;
        start += samples;
        Record {
            name: format!("r{k}"),
            excitation: if level == 0.0 { Excitation::Zero } else { Excitation::Random },
            from_rest: true,
            start_s,
            held_out: k == 3,
            u: vec![u],
            y: vec![y],
            simulated: None,
        }
    };
    [0.0, 1.0, 0.5, 0.7, 1.0, 1.0].into_iter().enumerate().map(&mut one).collect()
}

/// Returns the gaps on a fresh record: as given, and with the black box.
fn gaps(truth: &Truth) -> [f64; 2] {
    let system = TwoModes::new();
    let model = system.model();
    let mut records = records(&system, truth);
    let fresh = records.pop().unwrap();
    let ready = prepare(&model, &records, &Known::default()).unwrap();
    let given = &ready.problem.plant;
    // Written and read, as in an answer.
    let written = serde_json::to_string(&learn(&ready, given)).unwrap();
    let learnt: BlackBox = serde_json::from_str(&written).unwrap();
    let gap = |y: &[f64]| {
        let error: Vec<f64> = fresh.y[0].iter().zip(y).map(|(a, b)| a - b).collect();
        rms(&error) / rms(&fresh.y[0])
    };
    let simulated = system.output(&fresh.u[0], &LINEAR);
    [gap(&simulated), gap(&learnt.predict(given, given, &fresh.u, fresh.start_s)[0])]
}

#[test]
fn a_hammerstein_system_is_closed() {
    let [given, left] = gaps(&Truth { actuator: |u| u.tanh(), ..LINEAR });
    assert!(given > 0.2 && left < 0.05 * given, "{given} {left}");
}

#[test]
fn a_wiener_system_is_closed() {
    let [given, left] = gaps(&Truth { sensor: |y| y - 0.1 * y * y * y, ..LINEAR });
    assert!(given > 0.2 && left < 0.05 * given, "{given} {left}");
}

/// A hardening spring feeds the motion back. Without feedback, the black box can only approximate this.
#[test]
fn a_spring_in_the_loop_is_closed_in_part() {
    let [given, left] = gaps(&Truth { feedback: |y| 0.01 * y * y * y, ..LINEAR });
    assert!(given > 0.1 && left < 0.4 * given, "{given} {left}");
}

#[test]
fn where_nothing_is_missing_it_makes_nothing_worse() {
    let [given, left] = gaps(&LINEAR);
    assert!(left < 1.01 * given, "{given} {left}");
}

/// The second mode of the simulation is 2 % too low, and nothing else is wrong. The linear refit is the better start,
/// and its residual is not made worse.
#[test]
fn a_refit_that_is_better_is_corrected_instead_of_the_simulation() {
    let system = TwoModes::new();
    let mut wrong = TwoModes::new();
    let (sin, cos) = (0.98 * 0.9_f64).sin_cos();
    [cos, sin, -sin, cos].iter().enumerate().for_each(|(i, x)| wrong.a[(2 + i / 2, 2 + i % 2)] = 0.98 * x);
    let mut records = records(&system, &LINEAR);
    let fresh = records.pop().unwrap();
    let ready = prepare(&wrong.model(), &records, &Known::default()).unwrap();
    let exact = Plant::new(&system.model()).unwrap();
    let learnt = learn(&ready, &exact);
    assert!(learnt.of_refit);
    let y = &learnt.predict(&ready.problem.plant, &exact, &fresh.u, fresh.start_s)[0];
    let error: Vec<f64> = fresh.y[0].iter().zip(y).map(|(a, b)| a - b).collect();
    assert!(rms(&error) < 1.02 * NOISE, "{}", rms(&error));
}

/// The prediction stays bounded for a command ten times as large as any from which the black box learnt.
#[test]
fn a_prediction_is_bounded() {
    let system = TwoModes::new();
    let records = records(&system, &Truth { feedback: |y| 0.01 * y * y * y, ..LINEAR });
    let ready = prepare(&system.model(), &records[..5], &Known::default()).unwrap();
    let given = &ready.problem.plant;
    let learnt = learn(&ready, given);
    assert!(!learnt.terms.is_empty());
    let u: Vec<f64> = records[5].u[0].iter().map(|u| 10.0 * u).collect();
    let linear = system.output(&u, &LINEAR);
    let y = &learnt.predict(given, given, &[u], 0.0)[0];
    let change: Vec<f64> = y.iter().zip(&linear).map(|(y, linear)| y - linear).collect();
    assert!(rms(&change) < rms(&linear), "{} {}", rms(&change), rms(&linear));
}
