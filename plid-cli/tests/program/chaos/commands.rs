//! Each command that can be resumed.

use std::fs;
use std::path::Path;
use std::sync::OnceLock;

use tempfile::TempDir;

use super::{Work, chaos, kept};
use crate::cli::record;
use crate::common::plid;

pub const RUN: Work = Work {
    first: &["run", "experiment.toml", "--out", "out"],
    again: &["--resume"],
    results: &["out"],
    prepare: |at| {
        fs::write(at.join("r.csv"), record(400, 0.001)).unwrap();
        let text = "[data]\nfiles = [\"r.csv\"]\ninputs = [\"u\"]\noutputs = [\"y\"]\n[structure]\nstates = 2\n";
        fs::write(at.join("experiment.toml"), format!("name = \"small\"\n{text}")).unwrap();
    },
};

#[test]
fn run() {
    chaos(&RUN);
}

pub const SWEEP: Work = Work {
    first: &["sweep", "orders.toml", "--out", "out"],
    again: &["--resume"],
    results: &["out"],
    prepare: crate::sweep::prepare,
};

#[test]
fn sweep() {
    chaos(&SWEEP);
}

static DATA: OnceLock<TempDir> = OnceLock::new();

/// The data are in one place, because the written experiment states where they are.
pub const IDENTIFY: Work = Work {
    first: &["identify", "r.csv", "--inputs", "u", "--outputs", "y", "--states", "2", "--out", "out"],
    again: &["--resume"],
    results: &["out"],
    prepare: |at| {
        let data = DATA.get_or_init(|| tempfile::tempdir().unwrap()).path().join("r.csv");
        fs::write(&data, record(400, 0.001)).unwrap();
        std::os::unix::fs::symlink(&data, at.join("r.csv")).unwrap();
    },
};

#[test]
fn identify() {
    chaos(&IDENTIFY);
}

const STABILITY: &str = "states = [3]
steps = 60
reference_work = 1e4
[variations]
states = [3]
expectations = [\"joint-ekf\"]
parameter_noise = [1e-6]
[long]
states = 3
steps = 0
[adversarial]
states = 3
steps = 0
";

pub const BENCH_STABILITY: Work = Work {
    first: &["bench", "stability", "study.toml", "--out", "out"],
    again: &["--resume"],
    results: &["out"],
    prepare: |at| fs::write(at.join("study.toml"), STABILITY).unwrap(),
};

#[test]
fn bench_stability() {
    chaos(&BENCH_STABILITY);
}

pub const BENCH_EXPECTATIONS: Work = Work {
    first: &["bench", "expectations", "study.toml", "--out", "out"],
    again: &["--resume"],
    results: &["out"],
    prepare: |at| {
        let scalar = "[[scalar]]\nruns = 40\nsteps = 20\ntold_sigma = [1.0, 10.0]\ngrid_points = 40\n";
        let head = "seed = 5\nsignal_to_noise = [3.0]\nstate_noise_share = 0.2\ncovariance = \"direct\"\n";
        fs::write(at.join("study.toml"), format!("{head}{scalar}")).unwrap();
    },
};

#[test]
fn bench_expectations() {
    chaos(&BENCH_EXPECTATIONS);
}

pub const REPRODUCE: Work = Work {
    first: &["reproduce", "--quick", "--only", "sizing", "--only", "fig5", "--out", "out"],
    again: &[],
    results: &["out"],
    prepare: |_| {},
};

#[test]
fn reproduce() {
    chaos(&REPRODUCE);
}

/// The results are times, so what is finished must be kept: no cell is measured twice.
#[test]
fn bench_speed() {
    kept(&Work {
        first: &["bench", "speed", "study.toml", "--out", "out"],
        again: &["--resume"],
        results: &["out"],
        prepare: |at| {
            let cross = "[[cross]]\nstates = [6]\ncovariance = [\"direct\", \"joseph\"]\nexpectations = [\"prior\"]\n";
            let head = "rounds = 4\nvisit_ms = 5.0\nsteps = 40\nwarm_up = 1\n";
            fs::write(at.join("study.toml"), format!("{head}{cross}")).unwrap();
        },
    });
}

const TRIAL: &str = "name = \"two\"
[cases]
none = 1
singles_per_effect = 1
[draw]
effects = [\"sensor-offset\"]
least_over_floor = 5.0
length = 0.1
channels = [{ inputs = 1, outputs = 1 }]
";

/// Runs the program in a folder for what a test needs.
fn succeeds(at: &Path, arguments: &[&str]) {
    let output = plid(at, arguments);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

/// Copies a trial that is drawn and diagnosed once for all tests.
fn diagnosed(at: &Path) {
    static DRAWN: OnceLock<TempDir> = OnceLock::new();
    let drawn = DRAWN.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("trial.toml"), TRIAL).unwrap();
        let draw = ["gap", "trial", "draw", "trial.toml", "--out", "T", "--sealed", "S", "--seed", "5", "--quiet"];
        succeeds(folder.path(), &draw);
        succeeds(folder.path(), &["gap", "trial", "diagnose", "T", "--quiet"]);
        folder
    });
    copy(drawn.path(), at);
}

/// Copies such a trial without its answers.
fn drawn(at: &Path) {
    diagnosed(at);
    fs::remove_dir_all(at.join("T/answers")).unwrap();
}

fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap() {
        let path = entry.unwrap().path();
        let place = to.join(path.file_name().unwrap());
        if path.is_dir() {
            copy(&path, &place);
        } else {
            fs::copy(&path, &place).unwrap();
        }
    }
}

pub const GAP_TRIAL_DIAGNOSE: Work = Work {
    first: &["gap", "trial", "diagnose", "T", "--jobs", "2"],
    again: &[],
    results: &["T/answers"],
    prepare: drawn,
};

#[test]
fn gap_trial_diagnose() {
    chaos(&GAP_TRIAL_DIAGNOSE);
}

pub const GAP_TRIAL_ABLATE: Work = Work {
    first: &["gap", "trial", "ablate", "T", "--sealed", "S", "--steps", "audit", "--jobs", "2", "--out", "out"],
    again: &[],
    results: &["T/ablation", "out"],
    prepare: diagnosed,
};

#[test]
fn gap_trial_ablate() {
    chaos(&GAP_TRIAL_ABLATE);
}
