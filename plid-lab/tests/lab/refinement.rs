//! Models for simulation beside PLID's, in whole runs on a plant whose answer is known.

use std::fmt::Write as _;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

use nalgebra::{DMatrix, DVector};
use ndarray::{Array2, s};
use plid_lab::experiment::{self, Experiment};
use plid_lab::run::{self, Progress, RunError, Silent};
use plid_model::signal::rms;
use plid_model::{Model, frequency_response, simulate};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// Two light modes that answer within the sample or not; one input, two outputs at 100 Hz.
fn plant(direct: bool) -> Model {
    let mut a = DMatrix::zeros(4, 4);
    for (at, radius, angle) in [(0, 0.98_f64, 0.6_f64), (2, 0.96, 1.3)] {
        let (re, im) = (radius * angle.cos(), radius * angle.sin());
        for (i, j, x) in [(0, 0, re), (0, 1, im), (1, 0, -im), (1, 1, re)] {
            a[(at + i, at + j)] = x;
        }
    }
    let c = DMatrix::from_row_slice(2, 4, &[1.0, 0.0, 0.6, 0.1, -0.3, 0.4, 1.0, 0.0]);
    let d = if direct { [2.0, -3.0] } else { [0.0, 0.0] };
    let b = DMatrix::from_column_slice(4, 1, &[1.0, 0.5, -0.4, 1.0]);
    Model::new(100.0, a, b, c, DMatrix::from_column_slice(2, 1, &d)).unwrap()
}

/// A record of it with means, from an unknown state.
fn write_record(path: &Path, direct: bool, samples: usize, noise: f64, seed: u64) {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
    let inputs = Array2::from_shape_simple_fn((samples, 1), &mut normal);
    let outputs = simulate(&plant(direct), inputs.view(), &DVector::from_element(4, 2.0)).unwrap().outputs;
    let mut text = String::from("t,u,y1,y2\n");
    for (k, (u, y)) in inputs.rows().into_iter().zip(outputs.rows()).enumerate() {
        let y = [y[0] + noise * normal() + 40.0, 1e3 * (y[1] + noise * normal())];
        writeln!(text, "{},{},{},{}", k as f64 / 100.0, u[0] + 5.0, y[0], y[1]).unwrap();
    }
    std::fs::write(path, text).unwrap();
}

fn config(files: &str, rest: &str) -> Experiment {
    let text = format!(
        "name = \"small\"\n[data]\nfiles = [{files}]\ninputs = [\"u\"]\noutputs = [\"y1\", \"y2\"]\n[noise]\n\
         from = \"paper-squared\"\n[structure]\nstates = 4\n{rest}"
    );
    experiment::from_toml(&text, "test").unwrap()
}

/// Largest difference of the responses over the true peak; the second output is in thousandths.
fn response_error(found: &Model, truth: &Model) -> f64 {
    let hz: Vec<f64> = (1..100).map(|k| 0.49 * f64::from(k)).collect();
    let (found, truth) = (frequency_response(found, &hz).unwrap(), frequency_response(truth, &hz).unwrap());
    let of = |(i, unit): (usize, f64)| {
        let peak = truth.iter().map(|h| h[(i, 0)].norm()).fold(0.0, f64::max);
        found.iter().zip(&truth).map(|(f, t)| (f[(i, 0)] / unit - t[(i, 0)]).norm()).fold(0.0, f64::max) / peak
    };
    [(0, 1.0), (1, 1e3)].into_iter().map(of).fold(0.0, f64::max)
}

#[test]
fn the_refined_model_finds_the_plant_with_as_many_states_as_it_has() {
    let directory = tempfile::tempdir().unwrap();
    for direct in [false, true] {
        write_record(&directory.path().join("a.csv"), direct, 1200, 0.02, 1);
        write_record(&directory.path().join("b.csv"), direct, 3000, 0.02, 2);
        let experiment = config("\"a.csv\", \"b.csv\"", "");
        let outcome = run::carry_out(&experiment, directory.path(), None, false, &Silent).unwrap();
        assert_eq!(outcome.prepared.advanced, usize::from(direct));
        // A D of its own costs PLID, behind an advanced input, states that these four do not hold.
        let (refined, path) = outcome.simulation.refined.as_ref().unwrap();
        let error = response_error(&refined.model, &plant(direct));
        assert!(error < 0.003, "direct {direct}: {error}");
        let subspace = outcome.simulation.subspace.as_ref().unwrap();
        assert!(response_error(&subspace.model, &plant(direct)) < 0.02);
        // Noise is what it leaves, over the very samples that PLID's model is held against.
        let held_out =
            &outcome.prepared.records[1].outputs.column(0).slice(s![outcome.validation.training..]).to_owned();
        let floor = 0.02 / (outcome.prepared.output_scales[0] * rms(held_out));
        let left = refined.free_run_errors.relative[0];
        assert!((0.85 * floor..1.15 * floor).contains(&left), "direct {direct}: {left} against {floor}");
        assert_eq!(refined.free_run_errors.samples, outcome.validation.free_run_errors.samples);
        assert!(refined.one_step_errors.as_ref().unwrap().relative[0] < 1.2 * floor);
        assert_eq!(refined.model.d.iter().any(|d| *d != 0.0), direct);
        // The recursive model, far worse where D costs it states, may not be worth a refinement.
        let starts: Vec<&str> = path.scores.iter().map(|score| score.start.as_str()).collect();
        let recursive = if path.scores[2].noise.is_some() { 2 } else { 1 };
        assert_eq!(starts, [["subspace"; 2].as_slice(), &["plid"; 2][..recursive]].concat());
        assert!(path.poles_at_limit == 0 && path.chosen < starts.len());
        // The band is in the data's units: the second output's is a thousand times the first's in size.
        let std = path.response_variance(&[9.5]).unwrap()[0].magnitude_std();
        assert!((100.0..10_000.0).contains(&(std[(1, 0)] / std[(0, 0)])), "{std}");
        let truth = frequency_response(&plant(direct), &[9.5]).unwrap();
        let off = (path.response_variance(&[9.5]).unwrap()[0].response[(0, 0)] - truth[0][(0, 0)]).norm();
        assert!(off < 5.0 * std[(0, 0)], "{off} {std}");
    }
}

#[test]
fn its_files_agree_and_nothing_is_left_of_a_former_run() {
    let directory = tempfile::tempdir().unwrap();
    write_record(&directory.path().join("a.csv"), true, 2000, 0.05, 3);
    let out = directory.path().join("out");
    let run = |rest: &str| {
        let outcome = run::carry_out(&config("\"a.csv\"", rest), directory.path(), None, false, &Silent).unwrap();
        run::write(&outcome, &out).unwrap();
        let text = std::fs::read_to_string(out.join("result.json")).unwrap();
        (outcome, serde_json::from_str::<serde_json::Value>(&text).unwrap())
    };
    let (outcome, result) = run("");
    let (refined, _) = outcome.simulation.refined.as_ref().unwrap();
    let read = Model::read(&out.join("model-refined.json")).unwrap();
    assert_eq!((&read.a, &read.d), (&refined.model.a, &refined.model.d));
    assert!(Model::read(&out.join("model-subspace.json")).is_ok());
    let simulation = &result["simulation"];
    let free_run = simulation["refined"]["free_run"]["overall_relative"].as_f64().unwrap();
    assert_eq!(free_run, refined.free_run_errors.overall_relative);
    assert_eq!(simulation["refined"]["modes"].as_array().unwrap().len(), 2);
    assert!(simulation["refined"]["modes"][0]["hz_std"].as_f64().unwrap() > 0.0);
    assert_eq!(simulation["refined"]["handed_over"], true);
    assert_eq!(simulation["best_free_run"], "refined");
    assert!(simulation.get("period_s").is_none());
    let report = std::fs::read_to_string(out.join("report.html")).unwrap();
    assert!(report.contains("Models for simulation") && report.contains("use model-refined.json for simulation"));

    let (outcome, result) = run("[identification]\nrefine = \"off\"\n");
    assert!(outcome.simulation.refined.is_none() && !out.join("model-refined.json").exists());
    assert!(result["simulation"].get("refined").is_none());
    assert!(result["simulation"]["subspace"]["free_run"]["overall_relative"].is_f64());
}

#[test]
fn too_short_a_record_says_what_is_not_there() {
    let directory = tempfile::tempdir().unwrap();
    write_record(&directory.path().join("a.csv"), false, 90, 0.02, 4);
    let outcome = run::carry_out(&config("\"a.csv\"", ""), directory.path(), None, false, &Silent).unwrap();
    assert!(outcome.simulation.subspace.is_none());
    assert!(
        outcome
            .warnings
            .iter()
            .any(|w| w.contains("the subspace estimate could not be computed") && w.contains("at least")),
        "{:?}",
        outcome.warnings
    );
    // PLID's own start is enough to refine from.
    assert_eq!(outcome.simulation.refined.as_ref().unwrap().1.scores.len(), 2);
}

/// Asks for an end at the n-th step of the refinement.
struct StopInRefinement {
    refining: AtomicUsize,
    steps: AtomicUsize,
    at: usize,
}

impl Progress for StopInRefinement {
    fn stage(&self, name: &str) {
        self.refining.store(usize::from(name == "refinement"), Ordering::Relaxed);
    }
    fn advance(&self, _done: usize, _total: usize) {}
    fn interrupted(&self) -> bool {
        self.refining.load(Ordering::Relaxed) == 1 && self.steps.fetch_add(1, Ordering::Relaxed) >= self.at
    }
}

#[test]
fn an_interrupted_refinement_is_taken_up_again() {
    let directory = tempfile::tempdir().unwrap();
    write_record(&directory.path().join("a.csv"), false, 1000, 0.05, 5);
    let experiment = config("\"a.csv\"", "");
    let out = directory.path().join("out");
    let stop = StopInRefinement { refining: AtomicUsize::new(0), steps: AtomicUsize::new(0), at: 3 };
    let error = run::carry_out(&experiment, directory.path(), Some(&out), false, &stop).unwrap_err();
    assert!(matches!(error, RunError::Interrupted { .. }), "{error}");
    assert!(out.join(run::CHECKPOINT).exists());
    let resumed = run::carry_out(&experiment, directory.path(), Some(&out), true, &Silent).unwrap();
    let whole = run::carry_out(&experiment, directory.path(), None, false, &Silent).unwrap();
    let model = |outcome: &run::Outcome| outcome.simulation.refined.as_ref().unwrap().0.model.clone();
    assert_eq!(model(&resumed), model(&whole));
}
