//! The program as a user meets it: files in, files out, exit status, messages.

use crate::common;

use std::path::Path;
use std::process::{Command, Stdio};

use common::plid;
use plid::lab::report::percent;

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Runs the program, and checks its status and a part of its standard error.
fn fails(directory: &Path, arguments: &[&str], status: i32, said: &str) {
    let output = plid(directory, arguments);
    let message = text(&output.stderr);
    assert_eq!(output.status.code(), Some(status), "{arguments:?}: {message}");
    assert!(message.contains(said), "{arguments:?}: {message}");
}

fn put(directory: &Path, name: &str, content: &str) {
    std::fs::write(directory.join(name), content).unwrap();
}

/// x' = 0.5 x + u, y = 2 x + 3 u.
const MODEL: &str = r#"{"format": "state-space", "sample_rate_hz": 10.0, "inputs": ["u"], "outputs": ["y"],
 "A": [[0.5]], "B": [[1.0]], "C": [[2.0]], "D": [[3.0]], "noise": {}, "predictor_gain": [[0.1]]}"#;

#[test]
fn help_teaches() {
    let directory = tempfile::tempdir().unwrap();
    for arguments in
        [&["--help"][..], &["run", "--help"], &["identify", "--help"], &["simulate", "--help"], &["export", "--help"]]
    {
        let output = plid(directory.path(), arguments);
        assert_eq!(output.status.code(), Some(0));
        let help = text(&output.stdout);
        assert!(help.contains("Example") || help.contains("Start here"), "{arguments:?}: {help}");
        assert!(help.contains("\n  plid "), "{arguments:?}: {help}");
    }
    fails(directory.path(), &["identify"], 2, "required");
    fails(directory.path(), &["indentify"], 2, "identify");
}

#[test]
fn simulate_follows_the_model_by_hand() {
    let directory = tempfile::tempdir().unwrap();
    let at = directory.path();
    put(at, "model.json", MODEL);
    put(at, "u.csv", "t,u\n0,1\n0.1,0\n0.2,-2\n0.3,4\n");
    let output = plid(at, &["simulate", "--model", "model.json", "--input", "u.csv", "--out", "y.csv", "--json"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let said: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(said["samples"], 4);
    // x = 0, 1, 0.5, -1.75
    assert_eq!(std::fs::read_to_string(at.join("y.csv")).unwrap(), "y\n3\n2\n-5\n8.5\n");
}

#[test]
fn wrong_files_are_named_with_the_place() {
    let directory = tempfile::tempdir().unwrap();
    let at = directory.path();
    put(at, "model.json", MODEL);
    put(at, "bad.json", &MODEL.replace("[[0.5]]", "[[0.5, 1.0]]"));
    put(at, "syntax.json", "{\n\"format\": \n");
    put(at, "u.csv", "u\n1\n2\n");
    put(at, "v.csv", "v\n1\n2\n");
    put(at, "nan.csv", "u\n1\nnan\n");
    put(at, "ragged.csv", "a,u\n1,2\n1\n3,4\n");
    put(at, "empty.csv", "");
    put(at, "capital.csv", "a,U\n1,2\n3,4\n");
    put(at, "slow.csv", "Time,u\n0,1\n0.2,1\n0.4,1\n");
    put(at, "missing.json", &MODEL.replace("\"B\"", "\"b\""));
    let simulate = |model: &str, input: &str, said: &str| {
        fails(at, &["simulate", "--model", model, "--input", input, "--out", "y.csv"], 2, said);
        assert!(!at.join("y.csv").exists());
    };
    simulate("none.json", "u.csv", "none.json");
    simulate("bad.json", "u.csv", "`A`");
    simulate("syntax.json", "u.csv", "syntax.json:");
    simulate("model.json", "none.csv", "none.csv");
    simulate("missing.json", "u.csv", "missing.json: key `B` is missing");
    simulate("model.json", "v.csv", "v.csv: there is no channel `u`, only v\n");
    simulate("model.json", "capital.csv", "did you mean `U`?");
    simulate("model.json", "slow.csv", "`slow.csv` is sampled at 5 Hz, model `model.json` at 10 Hz");
    simulate("model.json", "nan.csv", "nan.csv: channel `u` is NaN at line 3");
    simulate("model.json", "ragged.csv", "ragged.csv, line 3");
    simulate("model.json", "empty.csv", "empty.csv");
    // Unstable: the work fails, and leaves no half of a file.
    put(at, "unstable.json", &MODEL.replace("[[0.5]]", "[[50.0]]"));
    put(at, "long.csv", &"1\n".repeat(200).replacen('1', "u", 1).replacen('\n', "\n1\n", 1));
    fails(at, &["simulate", "--model", "unstable.json", "--input", "long.csv", "--out", "y.csv"], 1, "diverged");
    assert!(!at.join("y.csv").exists());
}

#[test]
fn an_output_file_is_replaced_but_never_what_is_read() {
    let directory = tempfile::tempdir().unwrap();
    let at = directory.path();
    put(at, "model.json", MODEL);
    put(at, "u.csv", "u\n1\n2\n");
    put(at, "y.csv", "old");
    let simulate = |out: &'static str| ["simulate", "--model", "model.json", "--input", "u.csv", "--out", out];
    let output = plid(at, &[&simulate("y.csv")[..], &["--quiet"]].concat());
    assert_eq!(output.status.code(), Some(0));
    assert!(output.stdout.is_empty() && output.stderr.is_empty());
    assert_eq!(std::fs::read_to_string(at.join("y.csv")).unwrap(), "y\n3\n8\n");
    fails(at, &simulate("model.json"), 2, "overwrite");
    fails(at, &simulate("./u.csv"), 2, "overwrite");
    fails(at, &simulate("none/y.csv"), 2, "none/y.csv");
    assert_eq!(std::fs::read_to_string(at.join("model.json")).unwrap(), MODEL);
    assert_eq!(std::fs::read_dir(at).unwrap().count(), 3, "nothing else is left");
}

/// Numbered columns, and names that hold a comma, come back as the names of the file that is written.
#[test]
fn names_of_any_kind_read_back() {
    let directory = tempfile::tempdir().unwrap();
    let at = directory.path();
    put(at, "first.json", &MODEL.replace("[\"y\"]", "[\"3\"]").replace("[\"u\"]", "[\"1\"]"));
    put(at, "second.json", &MODEL.replace("[\"y\"]", "[\"left, \\\"x\\\"\"]").replace("[\"u\"]", "[\"3\"]"));
    put(at, "third.json", &MODEL.replace("[\"u\"]", "[\"left, \\\"x\\\"\"]"));
    put(at, "u.csv", "1,9\n1,9\n0,9\n");
    for (model, input, out, content) in [
        ("first.json", "u.csv", "y.csv", "\"3\"\n3\n5\n3\n"),
        ("second.json", "y.csv", "z.csv", "\"left, \"\"x\"\"\"\n9\n21\n22\n"),
        ("third.json", "z.csv", "w.csv", "y\n27\n81\n117\n"),
    ] {
        let output = plid(at, &["simulate", "--model", model, "--input", input, "--out", out]);
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
        assert_eq!(std::fs::read_to_string(at.join(out)).unwrap(), content);
    }
}

/// If `--out` is not a regular file, the table is written through it, and a link remains a link.
#[cfg(target_os = "linux")]
#[test]
fn an_output_may_be_a_device_a_pipe_or_a_link() {
    let directory = tempfile::tempdir().unwrap();
    let at = directory.path();
    put(at, "model.json", MODEL);
    put(at, "u.csv", "u\n1\n2\n");
    let simulate = |out: &str| {
        let arguments = ["simulate", "--model", "model.json", "--input", "u.csv", "--quiet", "--out", out];
        let output = plid(at, &arguments);
        assert_eq!(output.status.code(), Some(0), "{out}: {}", text(&output.stderr));
        text(&output.stdout)
    };
    assert_eq!(simulate("/dev/stdout"), "y\n3\n8\n");
    simulate("/dev/null");
    assert!(!std::fs::metadata("/dev/null").unwrap().is_file());
    std::os::unix::fs::symlink("real.csv", at.join("link.csv")).unwrap();
    simulate("link.csv");
    assert!(at.join("link.csv").is_symlink());
    assert_eq!(std::fs::read_to_string(at.join("real.csv")).unwrap(), "y\n3\n8\n");
}

/// A reader that has gone, as `head` does, is not a failure; a full disk is.
#[cfg(target_os = "linux")]
#[test]
fn standard_output_may_be_closed_or_full() {
    let directory = tempfile::tempdir().unwrap();
    let at = directory.path();
    put(at, "model.json", MODEL);
    put(at, "u.csv", "u\n1\n2\n");
    let simulate = |stdout: Stdio| {
        Command::new(env!("CARGO_BIN_EXE_plid"))
            .current_dir(at)
            .args(["simulate", "--model", "model.json", "--input", "u.csv", "--out", "y.csv"])
            .stdout(stdout)
            .stderr(Stdio::piped())
            .spawn()
            .and_then(std::process::Child::wait_with_output)
            .expect("the program runs")
    };
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    let closed = simulate(writer.into());
    assert_eq!(closed.status.code(), Some(0), "{}", text(&closed.stderr));
    let full = simulate(std::fs::File::create("/dev/full").unwrap().into());
    assert_eq!(full.status.code(), Some(1));
    assert!(text(&full.stderr).starts_with("plid: standard output:"), "{}", text(&full.stderr));
}

/// A record of the model with a small error added to y.
pub fn record(samples: usize, error: f64) -> String {
    let mut content = String::from("Time,u,y\n");
    let (mut x, mut seed) = (0.0, 1u64);
    for k in 0..samples {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let u = (seed >> 40) as f64 / f64::from(1 << 23) - 1.0;
        let wrong = if k % 2 == 0 { error } else { -error };
        content.push_str(&format!("{},{u},{}\n", k as f64 / 10.0, 2.0 * x + 3.0 * u + wrong));
        x = 0.5 * x + u;
    }
    content
}

#[test]
fn validate_ranks_the_true_model_first() {
    let directory = tempfile::tempdir().unwrap();
    let at = directory.path();
    put(at, "true.json", MODEL);
    put(at, "off.json", &MODEL.replace("[[2.0]]", "[[1.5]]"));
    put(at, "r.csv", &record(300, 0.01));
    let both = ["validate", "--model", "off.json", "--model", "true.json", "r.csv", "--json", "--out", "compared"];
    let output = plid(at, &both);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let table: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let error = |k: usize, run: &str| table["trials"][k][run]["scored"]["relative_rms"].as_f64().unwrap();
    assert_eq!(table["trials"][1]["model"], "true.json");
    assert!(error(1, "free_run") < 0.02 && error(0, "free_run") > 5.0 * error(1, "free_run"), "{table}");
    assert!(error(1, "one_step") < 0.02);
    let report = std::fs::read_to_string(at.join("compared/report.html")).unwrap();
    assert!(report.contains("true.json simulates best") && report.contains("<svg"));
    fails(at, &both, 2, "is not empty");
    // Both files or none: a folder is in the place of one of them.
    std::fs::remove_file(at.join("compared/result.json")).unwrap();
    std::fs::create_dir(at.join("compared/result.json")).unwrap();
    put(at, "compared/report.html", "old");
    fails(at, &[&both[..], &["--force"]].concat(), 2, "is a folder");
    assert_eq!(std::fs::read_to_string(at.join("compared/report.html")).unwrap(), "old");
    let table = text(&plid(at, &["validate", "--model", "off.json", "--model", "true.json", "r.csv"]).stdout);
    let row = table.lines().find(|line| line.trim_start().starts_with("free run  all")).unwrap();
    let errors: Vec<&str> = row.split_whitespace().skip(3).collect();
    assert_eq!(errors.join(" "), [0, 1].map(|model| percent(error(model, "free_run"))).join(" "), "{table}");
    put(at, "nan.csv", &format!("{}5,nan,0\n", record(50, 0.0)));
    fails(at, &["validate", "--model", "true.json", "nan.csv"], 2, "nan.csv: channel `u` is NaN at line 52");
    put(at, "infinite.csv", &format!("{}5,0,inf\n", record(50, 0.0)));
    fails(at, &["validate", "--model", "true.json", "infinite.csv"], 2, "infinite.csv: channel `y` is inf at line 52");
    put(at, "other.json", &MODEL.replace("\"y\"", "\"y1\""));
    fails(at, &["validate", "--model", "other.json", "r.csv"], 2, "did you mean `y`?");
    fails(at, &["validate", "--model", "true.json", "r.csv", "--skip", "300"], 2, "300");
    // A model that diverges is a row of the table.
    put(at, "wild.json", &MODEL.replace("[[0.5]]", "[[50.0]]"));
    let output = plid(at, &["validate", "--model", "wild.json", "r.csv"]);
    assert_eq!(output.status.code(), Some(0));
    assert!(text(&output.stdout).contains("diverges at"), "{}", text(&output.stdout));
    put(at, "rate.csv", &record(50, 0.0).replace("Time,", "t,").replace(".1,", ".13,"));
    fails(at, &["validate", "--model", "true.json", "rate.csv"], 2, "rate.csv");
    fails(at, &["validate", "--model", "true.json", "r.csv", "--rate", "20"], 2, "20 Hz");
}

#[test]
fn identify_writes_the_experiment_that_run_repeats() {
    let directory = tempfile::tempdir().unwrap();
    let at = directory.path();
    put(at, "r.csv", &record(400, 0.001));
    let identify = ["identify", "r.csv", "--inputs", "u", "--outputs", "y", "--states", "2", "--out", "first"];
    let output = plid(at, &identify);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    assert!(text(&output.stdout).contains("report: first"), "{}", text(&output.stdout));
    let output = plid(at, &["run", "first/experiment.toml", "--out", "second", "--json"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let result: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(result["input_advanced_by"], 1);
    assert!(result["held_out"]["free_run"]["overall_relative"].as_f64().unwrap() < 0.01, "{result}");
    for file in ["model.json", "result.json", "innovations.csv", "manifest.json", "report.html"] {
        let read = |out: &str| std::fs::read(at.join(out).join(file)).unwrap();
        assert_eq!(read("first"), read("second"), "{file}");
    }
    // y = z / (z - 0.5) (3 z^-1 ... ): D = 3 and the pole at 0.5 are found.
    let model: serde_json::Value =
        serde_json::from_slice(&std::fs::read(at.join("first/model.json")).unwrap()).unwrap();
    assert!((model["D"][0][0].as_f64().unwrap() - 3.0).abs() < 0.01, "{model}");

    fails(at, &identify, 2, "is not empty");
    fails(at, &["identify", "r.csv", "--inputs", "u", "--outputs", "why", "--states", "2", "--out", "x"], 2, "why");
    fails(at, &["identify", "r.csv", "--inputs", "u", "--outputs", "y", "--out", "x"], 2, "states");
    let refused = |extra: &[&str], said: &str| {
        let arguments = ["identify", "r.csv", "--inputs", "u", "--outputs", "y", "--states", "2", "--out", "x"];
        fails(at, &[&arguments[..], extra].concat(), 2, said);
        assert!(!at.join("x").exists(), "{extra:?} leaves nothing behind");
    };
    refused(&["--rate", "0"], "rate");
    refused(&["--rate", "-3"], "-3 Hz");
    refused(&["--scalar", "f16"], "f16");
    refused(&["--scalar", "double-double", "--backend", "faer"], "plain");
    refused(&["--decimate", "3.3"], "10 Hz");
    refused(&["--indices", "1,1"], "indices");
    refused(&["--passes", "0"], "passes");
    refused(&["--training-share", "1.5"], "training_share");
    fails(at, &[&identify[..8], &["--out", "r.csv/x", "--force"]].concat(), 2, "r.csv/x");
    fails(at, &["identify", "r.csv", "--inputs", "1-99999999999", "--outputs", "y", "--states", "1"], 2, "range");
    // Into an old directory only by --force, and a refusal leaves that as it was.
    let output = plid(at, &[&identify[..], &["--force", "--quiet"]].concat());
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    assert!(output.stdout.is_empty() && output.stderr.is_empty());
    let config = std::fs::read(at.join("first/experiment.toml")).unwrap();
    fails(at, &[&identify[..], &["--force", "--decimate", "3.3"]].concat(), 2, "10 Hz");
    assert_eq!(std::fs::read(at.join("first/experiment.toml")).unwrap(), config);
}

#[test]
fn an_experiment_with_a_wrong_key_says_where() {
    let directory = tempfile::tempdir().unwrap();
    let at = directory.path();
    put(at, "e.toml", "[data]\nfiles = [\"r.csv\"]\ninputs = [\"u\"]\noutputs = [\"y\"]\n\n[structure]\nsates = 4\n");
    fails(at, &["run", "e.toml"], 2, "e.toml, line 7");
    fails(at, &["run", "e.toml"], 2, "did you mean `states`?");
    fails(at, &["run", "none.toml"], 2, "none.toml");
    put(at, "e.toml", "[data]\nfiles = [\"r.csv\"]\ninputs = [\"u\"]\noutputs = [\"y\"]\n[structure]\nstates = 4\n");
    fails(at, &["run", "e.toml"], 2, "r.csv");
}

#[test]
fn a_held_out_output_that_never_moves_does_not_diverge() {
    let directory = tempfile::tempdir().unwrap();
    let at = directory.path();
    let still = |(k, line): (usize, &str)| match line.rsplit_once(',') {
        Some((before, _)) if k > 290 => format!("{before},0\n"),
        _ => format!("{line}\n"),
    };
    put(at, "r.csv", &record(400, 0.001).lines().enumerate().map(still).collect::<String>());
    put(
        at,
        "e.toml",
        "[data]\nfiles = [\"r.csv\"]\ninputs = [\"u\"]\noutputs = [\"y\"]\n\
         [preparation]\ntrend = \"none\"\n[structure]\nstates = 2\n",
    );
    let output = plid(at, &["run", "e.toml", "--out", "out"]);
    let said = text(&output.stdout);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let row = said.lines().find(|line| line.trim_start().starts_with("y ")).unwrap();
    assert_eq!(row.split_whitespace().collect::<Vec<_>>(), ["y", "constant", "constant"]);
    assert!(!said.contains("diverges"), "{said}");
}

/// Ctrl-C, then --resume: the same bytes as in one go.
#[cfg(unix)]
#[test]
fn an_interrupted_run_leaves_a_checkpoint_that_resume_takes_up() {
    let directory = tempfile::tempdir().unwrap();
    let at = directory.path();
    put(
        at,
        "e.toml",
        "name = \"e\"\n[data.testbed.truss]\nduration_s = 4.0\n[structure]\nstates = 24\n\
         [noise]\nfrom = \"paper-squared\"\n[variant]\ncovariance = \"array-sqrt\"\n[identification]\npasses = 6\n",
    );
    let mut child = Command::new(env!("CARGO_BIN_EXE_plid"))
        .current_dir(at)
        .args(["run", "e.toml", "--out", "parts", "--quiet"])
        .spawn()
        .expect("the program starts");
    // The directory is made once Ctrl-C is heeded.
    while !at.join("parts").exists() && child.try_wait().unwrap().is_none() {
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    std::thread::sleep(std::time::Duration::from_millis(500));
    // A process that is done cannot be signalled, which is not a failure.
    Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    let status = child.wait().unwrap();
    // On a machine that is done by then there is nothing to resume; the bytes must agree all the same.
    if !status.success() {
        assert_eq!(status.code(), Some(1));
        assert!(at.join("parts/checkpoint.json").exists());
        assert!(!at.join("parts/result.json").exists());
        let output = plid(at, &["run", "e.toml", "--out", "parts", "--resume"]);
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    }
    let output = plid(at, &["run", "e.toml", "--out", "whole"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    for file in ["model.json", "result.json", "innovations.csv", "manifest.json", "report.html"] {
        let read = |out: &str| std::fs::read(at.join(out).join(file)).unwrap();
        assert_eq!(read("parts"), read("whole"), "{file}");
    }
}

#[test]
fn a_model_is_exported_for_other_programs() {
    let directory = tempfile::tempdir().unwrap();
    let at = directory.path();
    let two = MODEL.replace("[[0.5]]", "[[0.5, 0.25], [0.0, 0.5]]").replace("[[1.0]]", "[[1.0], [4.0]]");
    let two = two.replace("[[2.0]]", "[[2.0, 8.0]]").replace("[[0.1]]", "[[0.1], [0.2]]");
    put(at, "model.json", &two);
    for to in ["model.mat", "model.npz", "model.py"] {
        let output = plid(at, &["export", "model.json", "--to", to]);
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
        assert_eq!(text(&output.stdout), format!("2 states, 1 inputs, 1 outputs: {to}\n"));
    }
    // The input matrix, as plid itself reads it.
    for file in ["model.mat", "model.npz"] {
        let table = plid::lab::data::read(&at.join(file), Some("B")).unwrap();
        assert_eq!(table.column("B").unwrap().to_vec(), [1.0, 4.0], "{file}");
    }
    let python = std::fs::read_to_string(at.join("model.py")).unwrap();
    assert!(python.contains("C = np.array([\n    2.0, 8.0,\n]).reshape(1, 2)\n"), "{python}");
    let before = std::fs::read(at.join("model.mat")).unwrap();
    fails(at, &["export", "model.json", "--to", "model.mat"], 2, "--force");
    assert_eq!(plid(at, &["export", "model.json", "--to", "model.mat", "--force"]).status.code(), Some(0));
    assert_eq!(std::fs::read(at.join("model.mat")).unwrap(), before);
    fails(at, &["export", "model.json", "--to", "model.m"], 2, "the ending is not .mat, .npz or .py");
    fails(at, &["export", "none.json", "--to", "model.m.py"], 2, "none.json");
    fails(at, &["export", "model.json", "--to", "no/model.py"], 2, "no/model.py");
}
