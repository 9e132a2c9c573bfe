//! `plid gap` for a plant that was recorded under control: the commands were recorded, and the simulation drifts away.

use crate::common;

use std::fmt::Write;
use std::path::Path;

use common::plid;
use nalgebra::dmatrix;
use plid::model::Model;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

const STEP_S: f64 = 0.01;
const NOISE: f64 = 1e-4;
/// Gains of the controller, in N/m and N s/m.
const KP: f64 = 40.0;
const KD: f64 = 8.0;

/// A slider of 1 kg in a bearing of 0.5 N s/m, from force to position.
fn slider() -> Model {
    let (a, b) = (dmatrix![1.0, STEP_S; 0.0, 1.0 - 0.5 * STEP_S], dmatrix![0.5 * STEP_S * STEP_S; STEP_S]);
    let mut model = Model::new(1.0 / STEP_S, a, b, dmatrix![1.0, 0.0], dmatrix![0.0]).unwrap();
    (model.inputs, model.outputs) = (vec!["force".into()], vec!["position".into()]);
    model.noise.sensor_std = Some(vec![NOISE]);
    model
}

/// u = -kp y - kd (y - its last value) / h.
fn controller() -> Model {
    let d = KD / STEP_S;
    let mut model = Model::new(1.0 / STEP_S, dmatrix![0.0], dmatrix![1.0], dmatrix![d], dmatrix![-KP - d]).unwrap();
    (model.inputs, model.outputs) = (vec!["position".into()], vec!["force".into()]);
    model
}

/// Writes the commands and the measured positions of a run in which the controller follows a drawn reference. Returns
/// the true positions.
fn record(rng: &mut ChaCha8Rng, samples: usize, file: &Path) -> Vec<f64> {
    let model = slider();
    let (mut x, mut last, mut reference) = (nalgebra::DVector::zeros(2), 0.0, 0.0);
    let (mut text, mut positions) = ("force,position\n".to_string(), Vec::new());
    for k in 0..samples {
        if k % 20 == 0 {
            reference = 0.05 * rng.sample::<f64, _>(StandardNormal);
        }
        let y: f64 = x[0] + NOISE * rng.sample::<f64, _>(StandardNormal);
        let u = KP * (reference - y) - KD * (y - last) / STEP_S;
        last = y;
        writeln!(text, "{u},{y}").unwrap();
        positions.push(x[0]);
        x = &model.a * x + model.b.column(0) * u;
    }
    std::fs::write(file, text).unwrap();
    positions
}

const PREDICT: [&str; 8] =
    ["gap", "predict", "--diagnosis", "out/diagnosis.json", "--input", "new.csv", "--out", "y.csv"];

/// Writes a case of two records, with or without the controller.
fn write_case(at: &Path, name: &str, controller: &str) {
    let mut case = format!("sim = \"slider.json\"\nsample_rate_hz = {}\n", 1.0 / STEP_S);
    case += "inputs = [\"force\"]\noutputs = [\"position\"]\n";
    case += controller;
    for k in 0..2 {
        write!(case, "\n[[record]]\nfile = \"r{k}.csv\"\n").unwrap();
    }
    std::fs::write(at.join(name), case).unwrap();
}

/// The command that was recorded in closed loop contains the controller's answer to the noise. With the measured
/// outputs, that part is removed, and the prediction follows the true positions.
#[test]
fn a_command_that_was_recorded_in_closed_loop_is_predicted() {
    let directory = tempfile::tempdir().unwrap();
    let at = directory.path();
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    slider().write(&at.join("slider.json")).unwrap();
    controller().write(&at.join("controller.json")).unwrap();
    for k in 0..2 {
        record(&mut rng, 800, &at.join(format!("r{k}.csv")));
    }
    write_case(at, "case.toml", "\n[controller]\nmodel = \"controller.json\"\n");
    let output = plid(at, &["gap", "diagnose", "case.toml", "--out", "out", "--json"]);
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    let said: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(said["verdict"], "none", "{}", said["sentence"]);

    let truth = record(&mut rng, 600, &at.join("new.csv"));
    let output = plid(at, &[&PREDICT[..], &["--measured", "new.csv"]].concat());
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    let text = std::fs::read_to_string(at.join("y.csv")).unwrap();
    let predicted: Vec<f64> = text.lines().skip(1).map(|line| line.parse().unwrap()).collect();
    assert_eq!(predicted.len(), truth.len());
    let square = |values: &mut dyn Iterator<Item = f64>| values.map(|x| x * x).sum::<f64>().sqrt();
    let error = square(&mut predicted.iter().zip(&truth).map(|(y, truth)| y - truth));
    let size = square(&mut truth.iter().copied());
    assert!(error < 0.02 * size, "{error} of {size}");

    // Another number of rows is an error that names the file.
    record(&mut rng, 599, &at.join("short.csv"));
    let output = plid(at, &[&PREDICT[..], &["--measured", "short.csv"]].concat());
    assert_eq!(output.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&output.stderr).contains("short.csv: 599 rows, but the input has 600"));
}
