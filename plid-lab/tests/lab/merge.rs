//! Runs of the recursion merged: synthetic plants, uncontrollable modes, and whole merges from files.

use std::fmt::Write as _;
use std::path::Path;

use nalgebra::{DMatrix, DVector};
use ndarray::Array2;
use plid_catalogue::Variant;
use plid_core::{NoiseModel, ObservableForm, Settings};
use plid_lab::experiment::{self, Experiment};
use plid_lab::identify::{Ending, Plan, Samples, run};
use plid_lab::merge::{self, Agreement, Combined, FinishedRun, Knowledge, MergeError, combine, consistency};
use plid_lab::run::{RunError, Silent};
use plid_model::Model;
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
        -0.81 + 0.02 * normal(),
        1.1 + 0.05 * normal(),
        0.05 * normal(),
        0.1 * normal(),
        0.05 * normal(),
        0.1 * normal(),
        -0.85 + 0.02 * normal(),
        0.3 + 0.05 * normal(),
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
fn knowledge(
    name: &str,
    input: usize,
    inputs: &Array2<f64>,
    outputs: &Array2<f64>,
    sensor: f64,
    state: f64,
) -> Knowledge {
    let form = ObservableForm::new(&INDICES, 1).unwrap();
    let noise = NoiseModel::diagonal(&[sensor * sensor; OUTPUTS], &[0.0], &[state * state; STATES]);
    let plan = Plan { settings: Settings::new(&form, 1.0, 1.0), form, noise, variant: Variant::default(), passes: 1 };
    let samples = Samples { inputs: inputs.view(), outputs: outputs.view(), nan_is_missing: false };
    let Ending::Done(done) = run(&plan, &[samples], None, &mut |_, _| true).unwrap() else {
        panic!("it was not interrupted")
    };
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

/// The normalised estimation error squared over seeds, for runs of different lengths and noise: its mean is within what
/// chi-square allows.
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

/// The first input moves the first output's states only, which the second output does not feel: of the second block its
/// run can tell nothing, and the merge is as good as the other runs alone are.
#[test]
fn a_run_that_cannot_move_a_mode_does_not_spoil_it() {
    const SEEDS: u64 = 30;
    let (mut with, mut without, mut disagree, mut all) = (0.0, 0.0, 0, 0.0);
    for seed in 0..SEEDS {
        let mut random = ChaCha8Rng::seed_from_u64(500 + seed);
        let mut truth = plant(&mut random, 3);
        // a_1 and a_2 keep to their own blocks.
        for entry in [2, 3, 4, 5, 10, 11] {
            truth[entry] = 0.0;
        }
        let runs: Vec<Knowledge> = (0..3)
            .map(|j| {
                let (inputs, outputs) = record(&mut random, &truth, j, 600, 0.05, 0.0);
                knowledge(&format!("run {j}"), j, &inputs, &outputs, 0.05, 1e-4)
            })
            .collect();
        let size = truth.len();
        let own =
            |combined: &Combined| (combined.estimate.rows(6, 2) - DVector::from_column_slice(&truth[6..8])).norm();
        let (merged, others) = (combine(&runs, size).unwrap(), combine(&runs[1..], size).unwrap());
        with += own(&merged) / SEEDS as f64;
        without += own(&others) / SEEDS as f64;
        all += nees(&merged, &truth) / SEEDS as f64;
        disagree += usize::from(consistency(&runs, size).unwrap().agreement != Agreement::Agree);
    }
    println!("error of the second mode {with:.2e}, without the run {without:.2e}; NEES {all:.2}; {disagree} disagree");
    assert!(with < 1.02 * without, "{with} {without}");
    assert!(disagree <= 2, "{disagree}");
}

/// u1, u2, u3, y1, y2 at 100 Hz with the inputs `acting` at work.
fn csv(seed: u64, parameters: &[f64], acting: &[usize], samples: usize) -> String {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
    let column = |t: usize| &parameters[t * STATES..(t + 1) * STATES];
    let mut text = String::from("u1,u2,u3,y1,y2\n");
    let mut x = [0.0; STATES];
    for _ in 0..samples {
        let u: Vec<f64> = (0..3).map(|j| if acting.contains(&j) { 2.0 * normal() } else { 0.0 }).collect();
        let (y1, y2) = (x[1] + 0.05 * normal(), x[3] + 0.05 * normal());
        writeln!(text, "{},{},{},{y1},{y2}", u[0], u[1], u[2]).unwrap();
        let next = |i: usize| {
            let shifted = if i % 2 == 1 { x[i - 1] } else { 0.0 };
            let driven: f64 = (0..3).map(|j| column(OUTPUTS + j)[i] * u[j]).sum();
            shifted + column(0)[i] * x[1] + column(1)[i] * x[3] + driven
        };
        x = std::array::from_fn(next);
    }
    text
}

/// Three records with one input each, of different lengths, and one with all.
fn records(directory: &Path, truth: &[f64]) {
    for (j, samples) in [900, 700, 1200].into_iter().enumerate() {
        let text = csv(70 + j as u64, truth, &[j], samples);
        std::fs::write(directory.join(format!("r{}.csv", j + 1)), text).unwrap();
    }
    std::fs::write(directory.join("all.csv"), csv(80, truth, &[0, 1, 2], 800)).unwrap();
}

fn config(files: &str, rest: &str) -> Experiment {
    let text = format!(
        "name = \"three\"\n[data]\nfiles = [{files}]\ninputs = [\"u1\", \"u2\", \"u3\"]\noutputs = [\"y1\", \"y2\"]\n\
         sample_rate_hz = 100.0\n[structure]\nkind = \"simo-merge\"\nstates = 4\n{rest}"
    );
    experiment::from_toml(&text, "test").unwrap()
}

const FILES: &str = "\"r1.csv\", \"r2.csv\", \"r3.csv\"";

/// The result that an older plid wrote to a finished run lacks a key, which the error names.
fn check_result_of_an_older_program(out: &Path, old: &Path) {
    std::fs::create_dir(old).unwrap();
    for name in ["model.json", "manifest.json"] {
        std::fs::copy(out.join("runs/u1").join(name), old.join(name)).unwrap();
    }
    std::fs::write(old.join("result.json"), "{\"name\": \"old\"}").unwrap();
    let error = FinishedRun::read(old).unwrap_err();
    assert!(
        matches!(&error, RunError::Merge(MergeError::Key { file, key, .. }) if file == &old.join("result.json")
            && key == "estimate"),
        "{error}"
    );
}

#[test]
fn a_config_makes_runs_and_merges_them_and_so_does_the_command_on_finished_runs() {
    let directory = tempfile::tempdir().unwrap();
    let base = directory.path();
    let truth = plant(&mut ChaCha8Rng::seed_from_u64(9), 3);
    records(base, &truth);
    // Files may come in any order: what acts in them says which run they are.
    let experiment = config("\"r3.csv\", \"r1.csv\", \"r2.csv\"", "[validation]\nfile = \"all.csv\"\n");
    let out = base.join("out");
    let outcome = merge::carry_out(&experiment, base, &out, false, &Silent).unwrap();
    merge::write(&outcome, &out).unwrap();
    assert_eq!(outcome.merged.consistency.agreement, Agreement::Agree);
    assert_eq!(outcome.merged.model.inputs, ["u3", "u1", "u2"]);
    assert!(outcome.warnings.is_empty(), "{:?}", outcome.warnings);

    // Sensor noise is all that a free run cannot know.
    let held_out = &outcome.held_out[0];
    for (i, rms) in held_out.errors.rms_error.iter().enumerate() {
        assert!((0.045..0.06).contains(rms), "output {i}: {rms}");
    }
    let column = |t: usize| DVector::from_column_slice(&truth[t * STATES..(t + 1) * STATES]);
    for (place, input) in [2, 0, 1].into_iter().enumerate() {
        let error = outcome.merged.model.b.column(place) - column(OUTPUTS + input);
        assert!(error.amax() < 0.02, "{error}");
    }
    assert!((outcome.merged.model.a.column(1)[0] - truth[0]).abs() < 0.01);
    assert!(outcome.merged.model.predictor_gain.is_some());

    // The same again, from the files of the runs; only the predictor needs data.
    let runs = ["u3", "u1", "u2"].map(|name| FinishedRun::read(&out.join("runs").join(name)).unwrap());
    let mut again = merge::of_runs("again", runs.to_vec()).unwrap();
    let bare = Model { predictor_gain: None, ..outcome.merged.model.clone() };
    assert_eq!(again.merged.model, bare);
    again.judge_file(&base.join("all.csv"), 0.25).unwrap();
    let there = base.join("again");
    merge::write(&again, &there).unwrap();
    let page = std::fs::read_to_string(there.join("report.html")).unwrap();
    for said in ["The runs are consistent with one A", "u1 to y2", "own simulation error", "with an error of"] {
        assert!(page.contains(said), "{said}");
    }
    assert_eq!(Model::read(&there.join("model.json")).unwrap(), bare);
    let result: serde_json::Value = serde_json::from_slice(&std::fs::read(there.join("result.json")).unwrap()).unwrap();
    assert_eq!(result["consistency"]["agreement"], "agree");
    assert_eq!(result["training_samples"], 675 + 525 + 900);
    for merged in [&there, &out] {
        assert!(!std::fs::read_to_string(merged.join("result.json")).unwrap().contains("null"));
    }

    // Resumed, finished runs stay as they are, and the bytes are the same.
    let bytes = |name: &str| std::fs::read(out.join(name)).unwrap();
    let before = (bytes("model.json"), bytes("report.html"), bytes("result.json"));
    let written = std::fs::metadata(out.join("runs/u1/result.json")).unwrap().modified().unwrap();
    merge::write(&merge::carry_out(&experiment, base, &out, true, &Silent).unwrap(), &out).unwrap();
    assert!(before == (bytes("model.json"), bytes("report.html"), bytes("result.json")));
    assert_eq!(std::fs::metadata(out.join("runs/u1/result.json")).unwrap().modified().unwrap(), written);

    check_result_of_an_older_program(&out, &base.join("old"));
    // Another order cannot be merged with these.
    let mut other = runs.to_vec();
    other[1].model.observability_indices = Some(vec![3, 1]);
    let error = merge::of_runs("x", other).unwrap_err().to_string();
    assert!(error.contains("u1: its observability indices are [3, 1], that of"), "{error}");
}

#[test]
fn the_name_of_an_input_leads_to_no_other_folder() {
    let directory = tempfile::tempdir().unwrap();
    let base = directory.path();
    records(base, &plant(&mut ChaCha8Rng::seed_from_u64(9), 3));
    for file in ["r1.csv", "r2.csv", "r3.csv"] {
        let text = std::fs::read_to_string(base.join(file)).unwrap();
        std::fs::write(base.join(file), text.replacen("u1", "../../u1", 1)).unwrap();
    }
    let mut experiment = config(FILES, "");
    experiment.data.inputs[0] = "../../u1".into();
    let out = base.join("out/here");
    merge::write(&merge::carry_out(&experiment, base, &out, false, &Silent).unwrap(), &out).unwrap();
    assert!(out.join("runs/%2E.%2F..%2Fu1/model.json").exists());
    assert!(!base.join("out/u1").exists() && !base.join("u1").exists());
}

#[test]
fn records_in_which_another_input_acts_are_refused_by_file_and_channel() {
    let directory = tempfile::tempdir().unwrap();
    let base = directory.path();
    let truth = plant(&mut ChaCha8Rng::seed_from_u64(9), 3);
    records(base, &truth);
    let refused =
        |files: &str| merge::carry_out(&config(files, ""), base, &base.join("out"), false, &Silent).unwrap_err();
    let error = refused("\"r1.csv\", \"all.csv\", \"r3.csv\"");
    assert!(
        matches!(&error, RunError::Merge(MergeError::AnotherActs { record, share, .. }) if record == "all.csv"
            && *share > 0.5),
        "{error}"
    );
    assert!(error.to_string().contains("all.csv: `u"), "{error}");
    let error = refused("\"r1.csv\", \"r3.csv\"");
    assert!(matches!(&error, RunError::Merge(MergeError::NeverActs { input, .. }) if input == "u2"), "{error}");
    std::fs::write(base.join("rest.csv"), csv(1, &truth, &[], 300)).unwrap();
    let error = refused(&format!("{FILES}, \"rest.csv\""));
    assert!(matches!(&error, RunError::Merge(MergeError::NoneActs { record, .. }) if record == "rest.csv"), "{error}");

    // An error in one run is reported with the run's name.
    std::fs::write(base.join("short.csv"), csv(1, &truth, &[1], 9)).unwrap();
    let error = refused("\"r1.csv\", \"short.csv\", \"r3.csv\"");
    assert!(error.to_string().starts_with("run u2: "), "{error}");

    // A finished run tells too, though it was told of one input only.
    let single = |file: &str, input: &str| {
        let text = format!(
            "name = \"{input}\"\n[data]\nfiles = [\"{file}\"]\ninputs = [\"{input}\"]\n\
             outputs = [\"y1\", \"y2\"]\nsample_rate_hz = 100.0\n\
             [structure]\nstates = 4\n[preparation]\nadvance = 0\n"
        );
        let experiment: Experiment = experiment::from_toml(&text, "test").unwrap();
        let outcome = plid_lab::run::carry_out(&experiment, base, None, false, &Silent).unwrap();
        let out = base.join(format!("{input}-of-{file}"));
        plid_lab::run::write(&outcome, &out).unwrap();
        FinishedRun::read(&out).unwrap()
    };
    let runs = vec![single("r1.csv", "u1"), single("all.csv", "u2")];
    let error = merge::of_runs("x", runs).unwrap_err();
    assert!(
        matches!(&error, RunError::Merge(MergeError::AnotherActs { record, other,
            .. }) if record.ends_with("u2-of-all.csv") && other == "u1"),
        "{error}"
    );
    let error = merge::of_runs("x", vec![single("r1.csv", "u1")]).unwrap_err();
    assert!(matches!(error, RunError::Merge(MergeError::TooFew)), "{error}");
}

/// The second record is of a plant whose first mode lies a little higher.
#[test]
fn the_record_of_another_plant_is_named() {
    let directory = tempfile::tempdir().unwrap();
    let base = directory.path();
    let truth = plant(&mut ChaCha8Rng::seed_from_u64(9), 3);
    records(base, &truth);
    let mut other = truth.clone();
    other[1] -= 0.05;
    std::fs::write(base.join("r2.csv"), csv(71, &other, &[1], 700)).unwrap();
    let outcome = merge::carry_out(&config(FILES, ""), base, &base.join("out"), false, &Silent).unwrap();
    assert_eq!(outcome.merged.consistency.agreement, Agreement::Departs { run: "runs/u2".into() });
    let verdict = merge::verdict(&outcome).join(" ");
    assert!(verdict.contains("The run runs/u2 does not fit the others"), "{verdict}");
}
