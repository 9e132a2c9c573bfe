//! The example `own_form` as a user starts it: an experiment and two studies name a form that plid does not have.
//!
//! The example is compiled into this test, which starts itself as that program.

use std::env;
use std::fs;
use std::path::Path;
use std::process::{Command, ExitCode};

#[path = "../examples/own_form/main.rs"]
mod program;

/// Tells this executable to be the program.
const AS_PROGRAM: &str = "PLID_TEST_AS_PROGRAM";

const EXPERIMENT: &str = r#"
[data]
files = ["record.csv"]
inputs = ["u"]
outputs = ["y"]
sample_rate_hz = 100.0
[structure]
states = 2
[identification]
refine = "off"
[variant]
covariance = "own"
"#;

/// The second and third cells ask for operations that the form lacks.
const STABILITY: &str = r#"
states = [3]
covariance = ["own", "direct"]
steps = 60
reference_work = 1e5
[variations]
states = [3]
expectations = []
parameter_noise = [1e-6]
sensor_rms_v = []
initial_variance = []
in_class = false
[long]
states = 3
steps = 0
[adversarial]
states = 3
steps = 40
start_ratios = []
scenarios = ["wind-up"]
"#;

const SPEED: &str = r#"
rounds = 1
visit_ms = 0.0
steps = 20
warm_up = 2
[[cross]]
states = [12]
covariance = ["own", "direct"]
expectations = ["moment-matched"]
"#;

/// Runs the program on a file in `directory` and returns what it wrote under `name`.
fn written(directory: &Path, command: &[&str], content: &str, name: &str) -> String {
    fs::write(directory.join("config.toml"), content).unwrap();
    let mut program = Command::new(env::current_exe().unwrap());
    program.env(AS_PROGRAM, "1").current_dir(directory).args(command).args(["config.toml", "--quiet", "--force"]);
    let output = program.args(["--out", "out"]).output().unwrap();
    assert!(output.status.success(), "{command:?}: {}", String::from_utf8_lossy(&output.stderr));
    fs::read_to_string(directory.join("out").join(name)).unwrap()
}

/// y = 1 / (z - 0.9) u, with a little noise; u and the noise from a linear congruential generator.
fn record() -> String {
    let (mut state, mut x) = (1_u64, 0.0);
    let mut drawn = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
    };
    let rows = (0..600).map(|_| {
        let (u, y) = (drawn(), x + 0.01 * drawn());
        x = 0.9 * x + u;
        format!("{u},{y}\n")
    });
    std::iter::once("u,y\n".into()).chain(rows).collect()
}

fn an_experiment_names_it(directory: &Path) {
    fs::write(directory.join("record.csv"), record()).unwrap();
    let own = written(directory, &["run"], EXPERIMENT, "model.json");
    let manifest = fs::read_to_string(directory.join("out/manifest.json")).unwrap();
    assert!(manifest.contains(r#""covariance": "own""#), "{manifest}");
    let direct = EXPERIMENT.replace("\"own\"", "\"direct\"");
    assert_eq!(own, written(directory, &["run"], &direct, "model.json"));
}

fn a_stability_study_names_it(directory: &Path) {
    let table = written(directory, &["bench", "stability"], STABILITY, "stability.csv");
    let rows = |part: &str, form: &str| table.lines().filter(|row| row.starts_with(part) && row.contains(form)).count();
    // In f32 and f64; what the form does not offer is left out.
    assert_eq!(rows("map", ",own,"), 2, "{table}");
    for part in ["variation", "adversarial"] {
        assert_eq!((rows(part, ",own,"), rows(part, ",direct,")), (0, 2), "{table}");
    }
    // What the others are judged against is there, and what nobody asked for is not.
    assert_eq!((rows("map", ",bierman-ud,f64,"), rows("map", ",joseph,")), (1, 0), "{table}");
}

fn a_speed_study_names_it(directory: &Path) {
    let table = written(directory, &["bench", "speed"], SPEED, "speed.csv");
    assert_eq!(table.lines().filter(|row| row.contains(",own,")).count(), 1, "{table}");
}

fn main() -> ExitCode {
    if env::var_os(AS_PROGRAM).is_some() {
        return program::main();
    }
    for test in [an_experiment_names_it, a_stability_study_names_it, a_speed_study_names_it] {
        test(tempfile::tempdir().unwrap().path());
    }
    ExitCode::SUCCESS
}
