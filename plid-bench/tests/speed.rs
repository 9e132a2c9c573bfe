//! A whole speed study, small: its files, its resumption, its allocations. One test a process, since those of all
//! threads count.

use std::alloc::System;
use std::fs;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

use cap::Cap;
use plid_bench::speed::{self, Config, Outcome, compare, peers};
use plid_bench::study::{Progress, Silent, StudyError, from_toml_checked};

#[global_allocator]
static ALLOCATOR: Cap<System> = Cap::new(System, usize::MAX);

const CONFIG: &str = r#"
rounds = 2
visit_ms = 0.0
steps = 40
warm_up = 5
[[cross]]
states = [12]
inputs = [3, 1]
covariance = ["direct", "joseph", "bierman-ud", "array-sqrt"]
expectations = ["moment-matched", "joint-ekf"]
[[cross]]
states = [24, 32, 40]
covariance = ["direct", "bierman-ud"]
expectations = ["prior"]
noise = ["diagonal", "full"]
[[cross]]
states = [12]
covariance = ["bierman-ud"]
expectations = ["joint-ekf"]
backend = ["nalgebra", "faer"]
scalar = ["f32"]
[[cross]]
states = [12]
covariance = ["bierman-ud"]
expectations = ["joint-ekf"]
threads = [2]
"#;

/// Asks for an end after so many measurements.
struct Impatient(AtomicUsize);

impl Progress for Impatient {
    fn stage(&self, _name: &str) {}
    fn advance(&self, _done: usize, _total: usize) {}
    fn interrupted(&self) -> bool {
        self.0.fetch_sub(1, Ordering::Relaxed) == 0
    }
}

fn lines(directory: &Path) -> usize {
    fs::read_to_string(directory.join("cells.jsonl")).unwrap().lines().count()
}

#[test]
fn a_small_study_is_interrupted_resumed_and_written() {
    speed::count_allocations_by(|| ALLOCATOR.total_allocated());
    let directory = tempfile::tempdir().unwrap();
    let at = directory.path();
    let config: Config = from_toml_checked(CONFIG, "small", Config::problems).unwrap();

    let error = speed::carry_out(&config, at, false, &Impatient(AtomicUsize::new(7))).unwrap_err();
    assert!(matches!(error, StudyError::Interrupted { .. }) && error.to_string().contains("cells.jsonl"));
    assert_eq!(lines(at), 1 + 7);
    let first = fs::read_to_string(at.join("cells.jsonl")).unwrap();
    let outcome = speed::carry_out(&config, at, true, &Silent).unwrap();
    let all = fs::read_to_string(at.join("cells.jsonl")).unwrap();
    assert!(all.starts_with(&first), "what was done is measured again");
    let again = speed::carry_out(&config, at, true, &Silent).unwrap();
    assert_eq!(fs::read_to_string(at.join("cells.jsonl")).unwrap(), all);
    assert_eq!(again.timings, outcome.timings);
    let other = Config { steps: 41, ..config.clone() };
    let error = speed::carry_out(&other, at, true, &Silent).unwrap_err().to_string();
    assert!(error.contains("cells.jsonl, line 1") && error.contains("another config"), "{error}");

    check(&outcome);
    files(&config, &outcome, at);

    // Against itself nothing has changed.
    let old = compare::read(&at.join("speed.json")).unwrap();
    let comparison = compare::compare(&old, &outcome, 0.0);
    assert_eq!((comparison.compared, comparison.unmatched), (outcome.timings.len(), 0));
    assert!(comparison.slower.is_empty() && comparison.faster.is_empty());
}

fn check(outcome: &Outcome) {
    // That on two threads is measured only where there are two cores.
    assert_eq!(outcome.timings.len() + outcome.skipped.len(), 16 + 12 + 2 + 1);
    for timing in &outcome.timings {
        assert_eq!((timing.steps, timing.restarts, timing.pass_ratios.len()), (40, 0, 2), "{}", timing.key);
        assert_eq!(timing.allocated_bytes, Some(0), "{}", timing.key);
        assert!(timing.median_us > 0.0 && timing.least_us <= timing.median_us, "{}", timing.key);
        assert!(timing.p99_us <= timing.p99_9_us && timing.p99_9_us <= timing.longest_us, "{}", timing.key);
        let joint = timing.joint_states as u64;
        // A step does more than one operation for each entry of P's triangle, and less than a product of N x N
        // matrices.
        assert!(timing.operations.total() > joint * joint / 2, "{}", timing.key);
        assert!(timing.operations.total() < 2 * joint.pow(3), "{}", timing.key);
    }
    let sizes: Vec<_> = outcome.slopes.iter().map(|slope| slope.sizes.as_slice()).collect();
    // Multiples of eight: kernels fill whole lines, so that operations grow by steps in between.
    assert_eq!(sizes, [[168, 224, 280], [168, 224, 280]], "direct and UD");
    for slope in &outcome.slopes {
        assert!((1.5..3.1).contains(&slope.operations), "{slope:?}");
    }
    assert!(outcome.limits.iter().all(|limit| limit.full_us > 0.0 && limit.triangle_us > 0.0 && limit.gbytes_s > 0.0));
    assert!(outcome.peaks.iter().all(|peak| peak.gflops > 0.0));
}

fn files(config: &Config, outcome: &Outcome, at: &Path) {
    let peers_file = at.join("peers.json");
    let text = r#"{"sizes": [{"n": 12, "inputs": 3, "outputs": 3, "peers": [{"name": "numpy <dense>", "version": "2",
        "form": "direct",
        "dtype": "f64", "us_per_step": 600.0, "plid_us_per_step": 6.0, "ratio": 100.0, "agreement": 1e-9,
            "structured": false}]}]}"#;
    fs::write(&peers_file, text).unwrap();
    speed::write_all(outcome, Some(&peers::read(&peers_file).unwrap()), at).unwrap();

    let csv = fs::read_to_string(at.join("speed.csv")).unwrap();
    assert_eq!(csv.lines().count(), 1 + outcome.timings.len());
    assert!(csv.starts_with("states,inputs,outputs,joint_states,covariance,"), "{csv}");
    let page = fs::read_to_string(at.join("report.html")).unwrap();
    for part in ["<svg", "10x more", "passes over P", "numpy &lt;dense&gt;", "RUSTFLAGS", "visit_ms = 0.0"] {
        assert!(page.contains(part), "{part}");
    }
    assert!(!page.contains("NaN"), "a figure is missing");
    assert!(fs::read_to_string(at.join("machine.json")).unwrap().contains("\"target\""));
    let again = fs::read_to_string(at.join("config.toml")).unwrap();
    assert_eq!(from_toml_checked::<Config>(&again, "again", Config::problems).unwrap(), *config);
}
