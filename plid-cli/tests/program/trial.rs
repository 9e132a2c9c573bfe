//! `plid gap trial` as a user meets it.

use crate::common;

use std::fs;
use std::path::Path;

use common::plid;

const TRIAL: &str = r#"name = "one"
[cases]
singles_per_effect = 1
[draw]
effects = ["sensor-offset"]
least_over_floor = 5.0
length = 0.2
channels = [{ inputs = 1, outputs = 1 }]
"#;

/// Runs it and gives status, standard output and standard error.
fn run(at: &Path, arguments: &[&str]) -> (i32, String, String) {
    let output = plid(at, arguments);
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (output.status.code().unwrap_or(-1), text(&output.stdout), text(&output.stderr))
}

#[test]
fn a_trial_in_one_command() {
    let directory = tempfile::tempdir().unwrap();
    let at = directory.path();
    fs::write(at.join("trial.toml"), TRIAL).unwrap();
    let command = ["gap", "trial", "run", "trial.toml", "--out", "out"];
    let (status, said, wrong) = run(at, &[&command[..], &["--seed", "5", "--jobs", "1"]].concat());
    assert_eq!(status, 0, "{wrong}");
    assert!(said.contains("1 cases, seed 5") && said.contains("report: out/report.html"), "{said}");
    let read = |name: &str| fs::read_to_string(at.join("out").join(name)).unwrap();
    let scores: serde_json::Value = serde_json::from_str(&read("scores.json")).unwrap();
    assert_eq!(scores["cases"][0]["truth"], "sensor-offset");
    assert_eq!(scores["cases"][0]["judged"][0]["said"], "sensor-offset");
    assert!(read("report.html").contains("Power against strength"));

    // The same directory again is refused, and goes on where that is asked for: here with nothing left to do.
    let (status, _, wrong) = run(at, &command);
    assert!(status == 2 && wrong.contains("not empty"), "{wrong}");
    let (status, said, wrong) = run(at, &[&command[..], &["--resume", "--json"]].concat());
    assert_eq!(status, 0, "{wrong}");
    let said: serde_json::Value = serde_json::from_str(&said).unwrap();
    assert_eq!(said["report"], "out/report.html");
    // What two steps are worth in this one case: nothing off gives the same bytes, or it would be refused.
    let command = ["gap", "trial", "ablate", "out/trial", "--sealed", "out/sealed", "--out", "ablation"];
    let (status, said, wrong) =
        run(at, &[&command[..], &["--steps", "modal-places,noise-fit", "--jobs", "1"]].concat());
    assert_eq!(status, 0, "{wrong}");
    assert!(said.contains("report: ablation/report.html"), "{said}");
    let changed = |step: &str| said.lines().any(|line| line.contains(step) && line.contains("1 of 1 answers changed"));
    assert!(changed("noise-fit") && !changed("modal-places"), "{said}");
    let page = fs::read_to_string(at.join("ablation/report.html")).unwrap();
    assert!(page.contains("No answer changed without modal-places"));

    let (status, _, wrong) = run(at, &["gap", "trial", "run", "--quick", "--out", "out", "--resume"]);
    assert!(status == 2 && wrong.contains("out holds another trial"), "{wrong}");
}

#[test]
fn what_is_wrong_is_said() {
    let directory = tempfile::tempdir().unwrap();
    let at = directory.path();
    fs::write(at.join("trial.toml"), "name = \"none\"\n[cases]\nnone = 2\n").unwrap();
    fs::write(at.join("wrong.toml"), "name = \"none\"\n[cases]\nnon = 2\n").unwrap();
    let refused = |arguments: &[&str], expected: &str| {
        let (status, _, wrong) = run(at, &[&["gap", "trial"], arguments].concat());
        assert!(status == 2 && wrong.contains(expected), "{arguments:?}: {status}, {wrong}");
    };
    refused(&["draw", "wrong.toml", "--out", "T", "--sealed", "S"], "wrong.toml, line 3");
    refused(&["draw", "trial.toml", "--out", "T", "--sealed", "T/S"], "must be in a folder outside");
    assert!(!at.join("T").exists());
    let (status, _, wrong) = run(at, &["gap", "trial", "draw", "trial.toml", "--out", "T", "--sealed", "S"]);
    assert_eq!(status, 0, "{wrong}");
    refused(&["draw", "trial.toml", "--out", "T", "--sealed", "S"], "not empty");
    refused(&["score", "T", "--sealed", "S"], "2 of 2 cases have no answer yet, case-001");
    refused(&["score", "S", "--sealed", "S"], "trial.json");
    refused(&["merge", "T"], "no shard to merge");
    refused(&["diagnose", "T", "--shard", "3/2"], "i from 1 to N");
    refused(&["diagnose", "T", "--jobs", "0"], "--jobs 0");
    for command in [&["diagnose", "T", "--off"][..], &["ablate", "T", "--sealed", "S", "--out", "A", "--steps"]] {
        let command = [command, &["audit,polish"]].concat();
        refused(&command, "`polish` is not a step that can be switched off; those are audit, noise-fit");
        refused(&command, "temperature");
    }
}
