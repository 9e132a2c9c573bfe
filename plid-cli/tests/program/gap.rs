//! `plid gap` as a user meets it: a case in files, the answer in files, the prediction on a new input.

use crate::common;

use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;

use common::plid;
use plid::gap::in_loop::{FORMAT, SimulatorWithEffects};
use plid::model::{Continuous, Model, simulate};
use plid::simulator::{Description, Input, Output};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

const RATE: f64 = 400.0;
const NOISE: f64 = 0.01;
/// What the sensor adds and the simulation does not have.
const OFFSET: f64 = 0.06;

/// Two lightly damped modes, one input, one output.
fn model() -> Model {
    let mut a = nalgebra::DMatrix::zeros(4, 4);
    for (k, hz) in [23.0, 61.0].into_iter().enumerate() {
        let w = std::f64::consts::TAU * hz;
        a[(2 * k, 2 * k + 1)] = w;
        a[(2 * k + 1, 2 * k)] = -w;
        a[(2 * k + 1, 2 * k + 1)] = -0.04 * w;
    }
    let b = nalgebra::dmatrix![0.0; 20.0; 0.0; 35.0];
    let c = nalgebra::dmatrix![1.0, 0.3, -0.7, 0.2];
    let mut whole = nalgebra::DMatrix::zeros(5, 5);
    whole.view_mut((0, 0), (4, 4)).copy_from(&(&a / RATE));
    whole.view_mut((0, 4), (4, 1)).copy_from(&(&b / RATE));
    let whole = whole.exp();
    let step = whole.view((0, 0), (4, 4)).into_owned();
    let held = whole.view((0, 4), (4, 1)).into_owned();
    let mut model = Model::new(RATE, step, held, c, nalgebra::DMatrix::zeros(1, 1)).unwrap();
    model.continuous = Some(Continuous { a, b });
    model.noise.sensor_std = Some(vec![NOISE]);
    model.noise.actuator_std = Some(vec![0.0]);
    model
}

fn record(rng: &mut ChaCha8Rng, samples: usize, level: f64, file: &Path) -> Vec<f64> {
    let mut normal = || -> f64 { rng.sample(StandardNormal) };
    let u = ndarray::Array2::from_shape_simple_fn((samples, 1), || level * normal());
    let model = model();
    let y = simulate(&model, u.view(), &model.rest()).unwrap().outputs;
    let mut text = "u1,y1\n".to_string();
    for k in 0..samples {
        writeln!(text, "{},{}", u[(k, 0)], y[(k, 0)] + OFFSET + NOISE * normal()).unwrap();
    }
    std::fs::write(file, text).unwrap();
    y.column(0).to_vec()
}

/// The prediction of the response to new.csv.
const PREDICT: [&str; 8] =
    ["gap", "predict", "--diagnosis", "out/diagnosis.json", "--input", "new.csv", "--out", "y.csv"];

fn write_case(at: &Path, rng: &mut ChaCha8Rng) {
    let mut case = format!("sim = \"sim.json\"\nsample_rate_hz = {RATE}\ninputs = [\"u1\"]\noutputs = [\"y1\"]\n");
    for (k, (level, samples)) in [(0.0, 1000), (1.0, 1800), (0.4, 1800), (1.0, 1800)].into_iter().enumerate() {
        record(rng, samples, level, &at.join(format!("r{k}.csv")));
        let excitation = if level > 0.0 { "random" } else { "zero" };
        write!(case, "\n[[record]]\nfile = \"r{k}.csv\"\nexcitation = \"{excitation}\"\n").unwrap();
    }
    std::fs::write(at.join("case.toml"), case).unwrap();
}

fn check_diagnosis(at: &Path) {
    let output = plid(at, &["gap", "diagnose", "case.toml", "--out", "out", "--json"]);
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    let said: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let written: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(at.join("out/diagnosis.json")).unwrap()).unwrap();
    assert_eq!(said, written);
    assert_eq!(said["verdict"], "effects", "{said}");
    assert_eq!(
        (&said["effects"][0]["effect"], &said["effects"][0]["location"]),
        (&"sensor-offset".into(), &"output:y1".into())
    );
    let interval = &said["effects"][0]["parameters"]["o"]["ci95"];
    let (low, high) = (interval[0].as_f64().unwrap(), interval[1].as_f64().unwrap());
    assert!(low < OFFSET && OFFSET < high && high - low < 0.01, "{interval}");
    let probabilities: f64 =
        said["candidates"].as_array().unwrap().iter().map(|c| c["probability"].as_f64().unwrap()).sum();
    assert!((probabilities - 1.0).abs() < 1e-9);
    assert!(std::fs::read_to_string(at.join("out/report.html")).unwrap().contains("sensor-offset"));
}

fn check_prediction(at: &Path, truth: &[f64]) {
    let output = plid(at, &PREDICT);
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    let text = std::fs::read_to_string(at.join("y.csv")).unwrap();
    let mut lines = text.lines();
    assert_eq!(lines.next(), Some("y1"));
    for (line, truth) in lines.zip(truth) {
        let y: f64 = line.parse().unwrap();
        assert!((y - truth - OFFSET).abs() < 0.02, "{y} for {truth}");
    }
}

fn check_own_simulator(at: &Path, truth: &[f64]) {
    // The engineer's own simulator, which knows something that the model does not: its outputs stay, and the effect's
    // correction is added.
    let own = |rows: usize| {
        let lines: String = truth[..rows].iter().map(|y| format!("{}\n", y + 1.0)).collect();
        std::fs::write(at.join("own.csv"), format!("y1\n{lines}")).unwrap();
        plid(at, &[&PREDICT[..], &["--simulated", "own.csv"]].concat())
    };
    assert_eq!(own(truth.len()).status.code(), Some(0));
    let text = std::fs::read_to_string(at.join("y.csv")).unwrap();
    assert_eq!(text.lines().count(), 1 + truth.len());
    for (line, truth) in text.lines().skip(1).zip(truth) {
        let y: f64 = line.parse().unwrap();
        assert!((y - truth - 1.0 - OFFSET).abs() < 0.02, "{y} for {truth}");
    }
    let short = own(truth.len() - 1);
    assert_eq!(short.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&short.stderr).contains("own.csv: 499 rows, but the input has 500"));
}

fn check_refused_files(at: &Path) {
    // An input that is read is not written over, nor one taken that is sampled otherwise; and beyond the fitted level
    // the expected gap grows.
    let into_itself = plid(at, &[&PREDICT[..5], &["new.csv", "--out", "new.csv"]].concat());
    assert_eq!(into_itself.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&into_itself.stderr).contains("overwrite"));
    let row = |k: usize| format!("{},{}\n", k as f64 / (2.0 * RATE), (k % 7) as f64);
    std::fs::write(at.join("fast.csv"), format!("t,u1\n{}", (0..100).map(row).collect::<String>())).unwrap();
    let fast = plid(at, &[&PREDICT[..5], &["fast.csv", "--out", "y.csv"]].concat());
    assert_eq!(fast.status.code(), Some(2), "{}", String::from_utf8_lossy(&fast.stderr));
    let rows: String = (0..500).map(|k| format!("{},0\n", k as f64 / (2.0 * RATE))).collect();
    std::fs::write(at.join("own.csv"), format!("t,y1\n{rows}")).unwrap();
    let fast = plid(at, &[&PREDICT[..], &["--simulated", "own.csv"]].concat());
    assert_eq!(fast.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&fast.stderr).contains("own.csv"), "{}", String::from_utf8_lossy(&fast.stderr));
    let over_the_simulation = plid(at, &[&PREDICT[..7], &["out/sim-with-effect.json"]].concat());
    assert_eq!(over_the_simulation.status.code(), Some(2));
}

fn check_expected_gap(at: &Path, rng: &mut ChaCha8Rng) {
    let mut expected = |level: f64| -> serde_json::Value {
        record(rng, 500, level, &at.join("level.csv"));
        let output = plid(at, &[&PREDICT[..5], &["level.csv", "--out", "y.csv", "--json"]].concat());
        assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
        serde_json::from_slice(&output.stdout).unwrap()
    };
    let (within, beyond) = (expected(0.8), expected(20.0));
    assert!(within["expected_gap"].as_f64().unwrap() > 0.0 && within["beyond_fitted"].is_null(), "{within}");
    // The interval is that of the diagnosis, whatever the input.
    let written = std::fs::read_to_string(at.join("out/diagnosis.json")).unwrap();
    let gap = &serde_json::from_str::<serde_json::Value>(&written).unwrap()["gap"];
    for key in ["predicted_held_out_gap", "predicted_ci80"] {
        assert!(!gap[key].is_null() && within[key] == gap[key] && beyond[key] == gap[key], "{key}: {within} {gap}");
    }
    let said = plid(at, &PREDICT);
    let said = String::from_utf8_lossy(&said.stdout).into_owned();
    assert!(said.contains("expected gap") && said.contains("(on a record at full level"), "{said}");
    assert!(said.contains("80 % interval"), "{said}");
    assert!(beyond["beyond_fitted"]["times"].as_f64().unwrap() > 10.0, "{beyond}");
}

#[test]
fn an_offset_is_diagnosed_and_predicted() {
    let directory = tempfile::tempdir().unwrap();
    let at = directory.path();
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    model().write(&at.join("sim.json")).unwrap();
    write_case(at, &mut rng);
    check_diagnosis(at);
    let truth = record(&mut rng, 500, 1.0, &at.join("new.csv"));
    check_prediction(at, &truth);
    check_own_simulator(at, &truth);
    check_refused_files(at);
    check_expected_gap(at, &mut rng);

    // The same again is refused, and an effect that nobody knows is named with the vocabulary.
    assert_eq!(plid(at, &["gap", "diagnose", "case.toml", "--out", "out"]).status.code(), Some(2));
    let output = plid(at, &["gap", "diagnose", "case.toml", "--out", "other", "--without", "sensor-ofset"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&output.stderr).contains("sensor-offset"));
}

#[test]
fn a_wrong_case_names_file_line_and_key() {
    let directory = tempfile::tempdir().unwrap();
    let at = directory.path();
    std::fs::write(
        at.join("case.toml"),
        "sample_rate_hz = 400.0\ninputs = [\"u1\"]\noutputs = [\"y1\"]\nrecords = 3\n",
    )
    .unwrap();
    let output = plid(at, &["gap", "diagnose", "case.toml"]);
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{message}");
    assert!(message.contains("case.toml, line 4") && message.contains("did you mean `record`"), "{message}");
    assert!(!at.join("out").exists() || std::fs::read_dir(at.join("out")).unwrap().next().is_none());
}

/// With a simulator in the loop, outputs of another simulator must fit the input, and there is no feedback to remove.
#[test]
fn what_does_not_fit_a_simulator_in_the_loop_is_refused() {
    let directory = tempfile::tempdir().unwrap();
    let at = directory.path();
    let (inputs, outputs) = (vec![Input::new("u1")], vec![Output::new("y1")]);
    let written = SimulatorWithEffects {
        format: FORMAT.into(),
        simulator: Description::new("own", RATE, inputs, outputs),
        command: vec!["true".into()],
        fmu: None,
        parameters: BTreeMap::new(),
        ports: Vec::new(),
        effects: Vec::new(),
        t0: 0.0,
        noise_rms: vec![NOISE],
        expected_gap: 0.05,
        fitted: None,
    };
    std::fs::create_dir(at.join("out")).unwrap();
    std::fs::write(at.join("out/sim-with-effect.json"), serde_json::to_string(&written).unwrap()).unwrap();
    std::fs::write(at.join("new.csv"), "u1\n0\n1\n2\n").unwrap();
    std::fs::write(at.join("own.csv"), "y1\n0\n1\n").unwrap();
    std::fs::write(at.join("other.csv"), "y2\n0\n1\n2\n").unwrap();
    for (more, said) in [
        (["--simulated", "own.csv"], "own.csv: 2 rows, but the input has 3"),
        (["--simulated", "other.csv"], "y1"),
        (["--measured", "own.csv"], "--measured"),
    ] {
        let output = plid(at, &[&PREDICT[..], &more].concat());
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{message}");
        assert!(message.contains(said) && !at.join("y.csv").exists(), "{message}");
    }
}
