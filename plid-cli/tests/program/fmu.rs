//! FMUs in the program, which runs them in a child process. The tests need a C compiler and are skipped, visibly,
//! without.

use crate::common;
#[path = "../../../plid-fmu/tests/common/mod.rs"]
mod oscillator;

use std::fmt::Write;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};

use common::plid;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use serde_json::Value;

const NOISE: f64 = 2e-5;
const FRICTION: f64 = 1.5;

/// What the cases of these tests begin with.
const HEAD: &str = "sample_rate_hz = 100.0\ninputs = [\"force\"]\noutputs = [\"position\"]\n\n[simulator]\n";

/// The oscillator with its port at the force.
const FMU: &str = r#"fmu = "models/oscillator2.fmu"
parameters = ["mass"]
steps_per_sample = 2

[[simulator.port]]
name = "spring"
force = "force"
displacement = "position"
velocity = "velocity"
"#;

/// The oscillator with dry friction, by short steps.
fn truth(u: &[f64]) -> Vec<f64> {
    let (mut x, mut v, h) = (0.0_f64, 0.0_f64, 1e-5);
    let mut sample = |force: &f64| {
        let y = x;
        for _ in 0..1000 {
            v += h * (force - 800.0 * x - 4.0 * v - FRICTION * (v / 1e-4).tanh()) / 2.0;
            x += h * v;
        }
        y
    };
    u.iter().map(&mut sample).collect()
}

/// Writes a record of the truth, and returns its outputs without noise.
fn record(seed: u64, level: f64, file: &Path) -> Vec<f64> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut normal = || -> f64 { rng.sample(StandardNormal) };
    let u: Vec<f64> = (0..60).flat_map(|_| std::iter::repeat_n(level * normal(), 8)).collect();
    let y = truth(&u);
    let mut text = "force,position\n".to_string();
    for (u, y) in u.iter().zip(&y) {
        writeln!(text, "{u},{}", y + NOISE * normal()).unwrap();
    }
    std::fs::write(file, text).unwrap();
    y
}

fn stderr(output: &std::process::Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// A failure of the oscillator as it is given, told by the checker of a case.
fn failure(version: u32, fault: u32) -> Option<String> {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let text = oscillator::description(version);
    // The start value after the name is that of the fault.
    let (before, after) = text.split_once("name=\"fault\"").unwrap();
    let text = format!("{before}name=\"fault\"{}", after.replacen("start=\"0\"", &format!("start=\"{fault}\""), 1));
    oscillator::built_with(at, version, &text)?;
    let simulator = format!("fmu = \"oscillator{version}.fmu\"\nparameters = [\"fault\"]\npatience_s = 2.0\n");
    std::fs::write(at.join("case.toml"), format!("{HEAD}{simulator}\n[[record]]\nfile = \"r.csv\"\n")).unwrap();
    let output = plid(at, &["gap", "check-simulator", "case.toml"]);
    assert_eq!(output.status.code(), Some(1), "{}", stderr(&output));
    Some(stderr(&output))
}

#[test]
fn a_failing_fmu_is_named() {
    for version in [2, 3] {
        let Some(crash) = failure(version, 4) else { return };
        assert!(crash.contains("it ended before it answered (signal: 6"), "{crash}");
        // What the FMU prints goes to the log and not among the numbers.
        assert!(crash.contains(".fmu") && crash.contains("lost among the numbers"), "{crash}");
        let hang = failure(version, 5).unwrap();
        assert!(hang.contains("serve-fmu") && hang.contains("did not answer within 2 s and was stopped"), "{hang}");
        let error = failure(version, 2).unwrap();
        assert!(error.contains("DoStep returned \"error\" at 0.1 s") && error.contains("the spring broke"), "{error}");
        let unsound = failure(version, 1).unwrap();
        assert!(unsound.contains("variable \"position\" is NaN"), "{unsound}");
    }
}

/// A server of an FMU whose temporary files are in a folder, once it has said what it serves.
fn server(at: &Path, temporary: &Path) -> Child {
    let mut child = Command::new(env!("CARGO_BIN_EXE_plid"))
        .current_dir(at)
        .args(["gap", "serve-fmu", "oscillator2.fmu", "--rate", "100"])
        .env("TMPDIR", temporary)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut hello = String::new();
    BufReader::new(child.stdout.as_mut().unwrap()).read_line(&mut hello).unwrap();
    assert!(hello.contains("\"protocol\""), "{hello}");
    child
}

/// What a killed server has unpacked is removed by the next one, and what a running one needs is not.
#[cfg(unix)]
#[test]
fn unpacked_fmus_are_removed() {
    let folder = tempfile::tempdir().unwrap();
    let (at, temporary) = (folder.path(), folder.path().join("temporary"));
    std::fs::create_dir(&temporary).unwrap();
    if oscillator::built(at, 2).is_none() {
        return;
    }
    let unpacked = || std::fs::read_dir(&temporary).unwrap().map(|entry| entry.unwrap().path()).collect::<Vec<_>>();
    let mut killed = server(at, &temporary);
    killed.kill().unwrap();
    killed.wait().unwrap();
    let [left] = &unpacked()[..] else { panic!("{:?}", unpacked()) };
    assert!(left.join("modelDescription.xml").exists());

    let mut first = server(at, &temporary);
    let [used] = &unpacked()[..] else { panic!("{:?}", unpacked()) };
    assert_ne!(used, left);
    let mut second = server(at, &temporary);
    assert!(unpacked().len() == 2 && used.join("modelDescription.xml").exists(), "{:?}", unpacked());
    for server in [&mut first, &mut second] {
        drop(server.stdin.take());
        assert!(server.wait().unwrap().success());
    }
    assert!(unpacked().is_empty(), "{:?}", unpacked());

    // The other commands end their servers before they end.
    let check = ["gap", "check-simulator", "oscillator2.fmu", "--rate", "100", "--parameter", "mass"];
    let mut command = Command::new(env!("CARGO_BIN_EXE_plid"));
    let output = command.current_dir(at).args(check).env("TMPDIR", &temporary).output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    assert!(unpacked().is_empty(), "{:?}", unpacked());
}

#[test]
fn an_fmu_is_checked_without_a_case() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    for version in [2, 3] {
        if oscillator::built(at, version).is_none() {
            return;
        }
        let file = format!("oscillator{version}.fmu");
        let check = |more: &[&str]| plid(at, &[&["gap", "check-simulator", &file, "--json"], more].concat());
        let output = check(&["--rate", "100", "--parameter", "mass", "--port", "spring=push,position,velocity"]);
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        let said: Value = serde_json::from_slice(&output.stdout).unwrap();
        assert_eq!((&said["sound"], &said["simulator"]["steps_per_sample"]), (&true.into(), &10.into()));
        let wrong = check(&["--parameter", "stifness"]);
        assert!(stderr(&wrong).contains("did you mean \"stiffness\"?"), "{}", stderr(&wrong));
        let missing = plid(at, &["gap", "check-simulator", "none.fmu"]);
        assert!(missing.status.code() == Some(1) && stderr(&missing).contains("none.fmu"), "{}", stderr(&missing));
    }
    let other = plid(at, &["gap", "check-simulator", "--rate", "100", "--", "true"]);
    assert_eq!((other.status.code(), stderr(&other).contains("for an FMU only")), (Some(2), true));
}

/// Diagnoses a case of these lines in a folder with records, and returns diagnosis.json.
fn diagnosed(at: &Path, name: &str, simulator: &str) -> Value {
    let mut case = format!("{HEAD}{simulator}");
    for (k, level) in [4.0, 8.0, 8.0, 0.0].into_iter().enumerate() {
        let excitation = if level > 0.0 { "random" } else { "zero" };
        write!(case, "\n[[record]]\nfile = \"r{k}.csv\"\nexcitation = \"{excitation}\"\n").unwrap();
    }
    std::fs::write(at.join(format!("{name}.toml")), case).unwrap();
    // From another folder: the FMU is found next to its case.
    let folder = at.join("elsewhere");
    let output = plid(&folder, &["gap", "diagnose", &format!("../{name}.toml"), "--out", name, "--json"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    serde_json::from_slice(&output.stdout).unwrap()
}

/// Friction is named at the port of an FMU, as `fmu` and as a command, and a new record is predicted.
#[test]
fn an_fmu_is_diagnosed() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    ["models", "elsewhere"].into_iter().for_each(|name| std::fs::create_dir(at.join(name)).unwrap());
    if oscillator::built(&at.join("models"), 2).is_none() {
        return;
    }
    for (k, level) in [4.0, 8.0, 8.0, 0.0].into_iter().enumerate() {
        record(k as u64, level, &at.join(format!("r{k}.csv")));
    }
    let found = diagnosed(at, "fmu", FMU);
    let effect = &found["effects"][0];
    assert_eq!(effect["effect"], "coulomb-friction", "{}", found["sentence"]);
    let force = effect["parameters"].as_object().unwrap().values().next().unwrap()["value"].as_f64().unwrap();
    assert!((force / FRICTION - 1.0).abs() < 0.1, "{}", found["sentence"]);
    assert!(found["gap"]["shrink"].as_f64().unwrap() > 0.9, "{}", found["gap"]);

    let command = format!(
        "command = [{:?}, \"gap\", \"serve-fmu\", \"models/oscillator2.fmu\", \"--rate\", \"100\", \"--parameter\", \
         \"mass\", \"--steps-per-sample\", \"2\", \"--port\", \"spring=force,position,velocity\", \"--input\", \
         \"force\", \"--output\", \"position\"]\n",
        env!("CARGO_BIN_EXE_plid")
    );
    let same = diagnosed(at, "command", &command);
    for key in ["sentence", "effects", "candidates", "gap", "refit"] {
        assert_eq!(found[key], same[key]);
    }

    let expected = record(9, 8.0, &at.join("new.csv"));
    let predict = ["gap", "predict", "--diagnosis", "elsewhere/fmu/diagnosis.json", "--input", "new.csv", "--out"];
    let output = plid(at, &[&predict[..], &["y.csv"]].concat());
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let text = std::fs::read_to_string(at.join("y.csv")).unwrap();
    let y: Vec<f64> = text.lines().skip(1).map(|line| line.parse().unwrap()).collect();
    let size = |values: &mut dyn Iterator<Item = f64>| values.map(|value| value * value).sum::<f64>().sqrt();
    let gap = size(&mut y.iter().zip(&expected).map(|(y, e)| y - e)) / size(&mut expected.iter().copied());
    assert!(y.len() == expected.len() && gap < 0.02, "{gap}");
    // Far beyond the fitted records, the program says so and expects a larger gap.
    record(9, 80.0, &at.join("loud.csv"));
    let loud =
        ["gap", "predict", "--diagnosis", "elsewhere/fmu/diagnosis.json", "--input", "loud.csv", "--out", "y.csv"];
    let said = stderr(&plid(at, &loud));
    assert!(said.contains("warning: extrapolation: ") && said.contains("times that of the fitted"), "{said}");
    let said = |input: &str| -> Value {
        let output = plid(at, &[&predict[..5], &[input, "--out", "y.csv", "--json"]].concat());
        serde_json::from_slice(&output.stdout).unwrap()
    };
    let (near, far) = (said("new.csv"), said("loud.csv"));
    assert!(near["beyond_fitted"].is_null() && far["beyond_fitted"]["times"].as_f64().unwrap() > 5.0, "{near} {far}");
    assert!(far["expected_gap"].as_f64().unwrap() > 1.5 * near["expected_gap"].as_f64().unwrap(), "{near} {far}");
    // What the friction changes is added to the outputs of another simulator.
    let moved: String = (0..y.len()).map(|_| "5\n").collect();
    std::fs::write(at.join("own.csv"), format!("position\n{moved}")).unwrap();
    let added = plid(at, &[&predict[..], &["sum.csv", "--simulated", "own.csv"]].concat());
    assert_eq!(added.status.code(), Some(0), "{}", stderr(&added));
    let text = std::fs::read_to_string(at.join("sum.csv")).unwrap();
    let change: Vec<f64> = text.lines().skip(1).map(|line| line.parse::<f64>().unwrap() - 5.0).collect();
    let (share, of) = (size(&mut change.iter().copied()), size(&mut y.iter().copied()));
    assert!(change.len() == y.len() && share > 0.02 * of && share < 2.0 * of, "{share} of {of}");
    // Its file is looked for in the folder that is named.
    let elsewhere = plid(at, &[&predict[..], &["z.csv", "--folder", "elsewhere"]].concat());
    assert!(stderr(&elsewhere).contains("models/oscillator2.fmu: No such file"), "{}", stderr(&elsewhere));
}
