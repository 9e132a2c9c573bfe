//! SIMO runs merged: the truss at 30 states, with what it is to reach, and the command.

use crate::common;

use std::fmt::Write;
use std::path::Path;

use common::plid;
use plid::lab::experiment;
use plid::lab::merge::{self, Agreement};
use plid::lab::run::Silent;

/// Golden figures: the same seed gives the same data on every run. The MIMO run of as many samples (`plid run
/// experiments/truss-mimo-30.toml`, tests/main_job.rs) simulates the same held-out part with an error of 3.121 %.
#[test]
fn three_runs_of_a_third_of_the_samples_simulate_the_truss_nearly_as_well_as_one_of_all_inputs() {
    let directory = tempfile::tempdir().unwrap();
    let experiment = experiment::read(Path::new("../experiments/truss-simo-merge-30.toml")).unwrap();
    let outcome = merge::carry_out(&experiment, Path::new("../experiments"), directory.path(), false, &Silent).unwrap();
    let held_out = &outcome.held_out[0];
    let error = held_out.errors.overall_relative;
    assert!(error < 1.1 * 0.03121, "{error}");
    assert!(held_out.one_step_errors.as_ref().unwrap().overall_relative < 0.02);
    let truth = held_out.truth_errors.as_ref().unwrap().overall_relative;
    assert!((truth - 0.03119).abs() < 1e-4, "the held-out part is another one: {truth}");
    assert_eq!(outcome.runs.iter().map(|run| run.training_samples).sum::<usize>(), 3 * 5200);
    assert!(outcome.peaks.len() >= 40, "{}", outcome.peaks.len());
    for row in &outcome.peaks {
        assert!(row.height_error_db().unwrap_or(f64::INFINITY).abs() < 3.0, "{row:?}");
    }
    assert_eq!(outcome.merged.consistency.agreement, Agreement::Agree);
}

/// x' = 0.6 x + 0.4 u + v, y = x: `u` and `v` are 1, 2 or 3 times a square wave of a period of its own, or zero. The
/// means that a run takes off are those of its training part; over fewer samples they would be off by what the state
/// holds at its ends.
fn csv(u: f64, v: f64) -> String {
    let (mut text, mut x) = (String::from("t,u,v,y\n"), 0.0);
    for k in 0..4000_usize {
        let wave = |period: usize| if (k * k / period).is_multiple_of(2) { 1.0 } else { -1.0 };
        let (a, b) = (u * wave(7), v * wave(11));
        // Rounded as a converter would: what noise there is.
        writeln!(text, "{},{a},{b},{:.3}", 0.1 * k as f64, x).unwrap();
        x = 0.6 * x + 0.4 * a + b;
    }
    text
}

#[test]
fn the_command_merges_finished_runs_and_names_what_is_wrong() {
    let directory = tempfile::tempdir().unwrap();
    let at = directory.path();
    for (name, u, v) in [("u", 1.0, 0.0), ("v", 0.0, 2.0), ("both", 1.0, 3.0)] {
        std::fs::write(at.join(format!("{name}.csv")), csv(u, v)).unwrap();
    }
    for (file, input, out) in [("u.csv", "u", "ru"), ("v.csv", "v", "rv"), ("both.csv", "v", "rboth")] {
        let output = plid(
            at,
            &[
                "identify",
                file,
                "--inputs",
                input,
                "--outputs",
                "y",
                "--states",
                "1",
                "--advance",
                "0",
                "--out",
                out,
                "--quiet",
            ],
        );
        assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    }
    let output = plid(at, &["merge", "ru", "rv", "--held-out", "both.csv", "--out", "merged", "--json"]);
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    let result: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(result["inputs"], serde_json::json!(["u", "v"]));
    assert!(result["held_out"][0]["free_run"]["overall_relative"].as_f64().unwrap() < 0.005, "{}", result["held_out"]);
    for file in ["model.json", "report.html", "result.json"] {
        assert!(at.join("merged").join(file).exists(), "{file}");
    }
    let fails = |arguments: &[&str], said: &[&str]| {
        let output = plid(at, arguments);
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{message}");
        said.iter().for_each(|said| assert!(message.contains(said), "{message}"));
    };
    fails(&["merge", "ru", "rboth", "--out", "x"], &["rboth", "`u`"]);
    fails(&["merge", "ru", "nowhere", "--out", "x"], &["nowhere"]);
    fails(&["merge", "ru", "--out", "x"], &["at least two"]);
    fails(&["merge", "ru", "rv", "--out", "merged"], &["--force"]);
    std::fs::write(at.join("narrow.csv"), "t,u,y\n0,1,0\n0.1,-1,1\n").unwrap();
    fails(&["merge", "ru", "rv", "--out", "x", "--held-out", "narrow.csv"], &["narrow.csv", "`v`"]);
    assert!(!at.join("x").exists());
}
