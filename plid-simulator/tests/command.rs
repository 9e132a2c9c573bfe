//! Other programs as simulators. The tests need `python3` and are skipped, visibly, without it.

use std::path::{Path, PathBuf};
use std::time::Duration;

use plid_simulator::{Checked, Command, Instance, Simulator, SimulatorError, check};

fn examples() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/simulator")
}

fn has_python() -> bool {
    let found = std::process::Command::new("python3").arg("--version").output().is_ok();
    if !found {
        eprintln!("SKIPPED: there is no python3");
    }
    found
}

fn python(script: &str, folder: &Path, patience: Duration) -> Result<Command, SimulatorError> {
    Command::start(&["python3".into(), script.into()], folder, patience)
}

/// A simulator of these lines in the template's place, with one input and one output.
fn written(lines: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    std::fs::copy(examples().join("plid_simulator.py"), folder.path().join("plid_simulator.py")).unwrap();
    std::fs::write(folder.path().join("sim.py"), lines).unwrap();
    folder
}

const HEAD: &str = "import sys, time\nfrom plid_simulator import serve\nclass S:\n    description = {'name': 's', \
                    'rate_hz': 10.0, 'inputs': [{'name': 'u'}], 'outputs': [{'name': 'y'}]}\n";

/// Returns the message of a run of a simulator whose `run` has this body.
fn failure(body: &str, patience: Duration) -> String {
    let folder = written(&format!("{HEAD}    def run(self, parameters, u):\n        {body}\nserve(S())\n"));
    let mut simulator = python("sim.py", folder.path(), patience).unwrap();
    Checked::new(&mut simulator).unwrap().run(&[], &[vec![1.0, 2.0]]).unwrap_err().to_string()
}

/// The template's oscillator: the closed form of its integrator, run and stepped.
#[test]
fn the_template_follows_the_closed_form() {
    if !has_python() {
        return;
    }
    let mut simulator = python("oscillator.py", &examples(), Command::PATIENCE).unwrap();
    assert_eq!(simulator.description().values(), [800.0, 4.0]);
    let samples = 50;
    let (h, mut x, mut v, mut expected) = (1e-3, 0.0, 0.0, Vec::new());
    for _ in 0..samples {
        expected.push(x);
        for _ in 0..10 {
            v += h * (3.0 + 0.5 - 5.0 * v - 700.0 * x) / 2.0;
            x += h * v;
        }
    }
    let mut checked = Checked::new(&mut simulator).unwrap();
    let run = checked.run(&[700.0, 5.0], &[vec![3.5; samples]]).unwrap();
    let stepped = checked.run_with(&[700.0, 5.0], &[vec![3.0; 10 * samples]], |_, _, forces| forces.fill(0.5)).unwrap();
    for k in 0..samples {
        assert!((run[0][k] - expected[k]).abs() < 1e-15 && (stepped[0][k] - expected[k]).abs() < 1e-15, "{k}");
    }
}

#[test]
fn the_checker_passes_the_template() {
    if !has_python() {
        return;
    }
    let mut simulator = python("oscillator.py", &examples(), Command::PATIENCE).unwrap();
    let findings = check(&mut simulator, 1.0).unwrap();
    assert!(findings.len() >= 7 && findings.iter().all(|finding| finding.holds), "{findings:#?}");
}

#[test]
fn the_checker_finds_what_is_wrong() {
    if !has_python() {
        return;
    }
    let lines = "import random\nfrom plid_simulator import serve\nclass S:\n    description = {'name': 's', \
                 'rate_hz': 10.0, 'inputs': [{'name': 'u'}], 'outputs': [{'name': 'y'}], 'parameters': \
                 [{'name': 'unused', 'value': 1.0}], 'steps_per_sample': 1, 'ports': [{'name': 'p'}]}\n    def \
                 start(self, parameters):\n        self.x = 0.0\n        return [(0.0, 0.0)]\n    def step(self, u, \
                 forces):\n        self.x += u[0]\n        return [self.x + random.random()], [(self.x, 0.0)]\n\
                 serve(S())\n";
    let folder = written(lines);
    let mut simulator = python("sim.py", folder.path(), Command::PATIENCE).unwrap();
    let findings = check(&mut simulator, 1.0).unwrap();
    let wrong: Vec<&str> = findings.iter().filter(|f| f.required && !f.holds).map(|f| f.what.as_str()).collect();

    assert_eq!(wrong, ["repeats", "steps", "motion at p", "force at p"]);
}

/// A parameter that does nothing upwards and fails at its lower bound; states that come back wrong.
#[test]
fn the_checker_tries_both_sides_and_states() {
    if !has_python() {
        return;
    }
    let lines = r#"from plid_simulator import serve
class S:
    description = {"name": "s", "rate_hz": 10.0, "inputs": [{"name": "u"}], "outputs": [{"name": "y"}],
                   "parameters": [{"name": "k", "value": 1.0, "lower": 0.5}], "steps_per_sample": 1, "states": True}

    def start(self, parameters):
        self.k, self.x = min(parameters[0], 1.0), 0.0
        if self.k < 0.6:
            raise ValueError("too soft")
        return []

    def step(self, u, forces):
        self.x += self.k * u[0]
        return [self.x], []

    def save(self, slot):
        self.kept = self.x

    def restore(self, slot):
        self.x = self.kept
        return []

serve(S())
"#;
    let folder = written(lines);
    let mut simulator = python("sim.py", folder.path(), Command::PATIENCE).unwrap();
    let findings = check(&mut simulator, 1.0).unwrap();
    let not: Vec<(&str, bool)> = findings.iter().filter(|f| !f.holds).map(|f| (f.what.as_str(), f.required)).collect();
    // Both slots are one: the second state is in the place of the first.
    assert_eq!(not, [("parameter k = 1.05", true), ("bound k = 0.5", false), ("states", true)]);
    let bound = findings.iter().find(|finding| finding.what == "bound k = 0.5").unwrap();
    assert!(bound.found.contains("too soft"), "{}", bound.found);
}

/// A program is started once more, and both give the same numbers side by side.
#[test]
fn a_program_runs_side_by_side() {
    if !has_python() {
        return;
    }
    let mut simulator = python("oscillator.py", &examples(), Command::PATIENCE).unwrap();
    let inputs: Vec<Vec<Vec<f64>>> = (1..6).map(|k| vec![vec![f64::from(k); 40]]).collect();
    let runs: Vec<_> = inputs.iter().map(|u| |one: &mut Instance| one.run(&[800.0, 4.0], u)).collect();
    let [alone, both] = [1, 2].map(|count| Checked::side_by_side(&mut simulator, count).unwrap().all(&runs));
    assert!(alone.iter().all(Result::is_ok));
    assert_eq!(alone, both);
}

/// Each failure names what happened, and the end of the log.
#[test]
fn a_failing_program_is_named_with_its_log() {
    if !has_python() {
        return;
    }
    let patience = Duration::from_secs(20);
    let raised = failure("raise ValueError('no such mass')", patience);
    assert!(raised.contains("run 1 of simulator \"s\"") && raised.contains("ValueError: no such mass"), "{raised}");
    let ended = failure("print('out of memory', file=sys.stderr, flush=True); sys.exit(3)", patience);
    assert!(ended.contains("it ended before it answered") && ended.contains("out of memory"), "{ended}");
    let hangs = failure("time.sleep(60)", Duration::from_millis(300));
    assert!(hangs.contains("did not answer within 0.3 s"), "{hangs}");
    let unsound = failure("return [[0.0], [float('nan')]]", patience);
    assert!(unsound.contains("NaN for output \"y\" at sample 1"), "{unsound}");
    let none = Command::start(&["no-such-program".into()], Path::new("."), patience).err().unwrap().to_string();
    assert!(none.contains("\"no-such-program\" cannot be started"), "{none}");
    let other = Command::start(&["echo".into(), "hello".into()], Path::new("."), patience).err().unwrap().to_string();
    assert!(other.contains("it wrote \"hello\" where a line of JSON is expected"), "{other}");
}

/// The time limit counts from the last part of an answer that came.
#[test]
fn a_long_answer_takes_its_time() {
    if !has_python() {
        return;
    }
    let lines = r#"import json, sys, time
source, sink = sys.stdin.buffer, sys.stdout.buffer
hello = {"protocol": 1, "name": "s", "rate_hz": 1.0, "inputs": [{"name": "u"}], "outputs": [{"name": "y"}]}
sink.write(json.dumps(hello).encode() + b"\n")
sink.flush()
for line in source:
    samples = json.loads(line)["run"]["samples"]
    u = source.read(8 * samples)
    sink.write(b'{"ok": true}\n')
    for k in range(samples):
        time.sleep(0.2)
        sink.write(u[8 * k : 8 * k + 8])
        sink.flush()
"#;
    let folder = written(lines);
    let mut simulator = python("sim.py", folder.path(), Duration::from_millis(800)).unwrap();
    let u = vec![(0..8).map(f64::from).collect::<Vec<f64>>()];
    assert_eq!(simulator.run(&[], &u).unwrap(), u);
}

/// What a simulator prints goes to the log and not among the numbers.
#[test]
fn printing_does_no_harm() {
    if !has_python() {
        return;
    }
    let body = "print('x' * 100000)\n        return [[2.0 * x for x in row] for row in u]";
    let folder = written(&format!("{HEAD}    def run(self, parameters, u):\n        {body}\nserve(S())\n"));
    let mut simulator = python("sim.py", folder.path(), Duration::from_secs(20)).unwrap();
    assert_eq!(simulator.run(&[], &[vec![1.0, -2.0]]).unwrap(), [[2.0, -4.0]]);
}

/// At the end of its input a program may still do something, and one that goes on is stopped.
#[test]
fn a_program_is_left_a_moment_to_end() {
    if !has_python() {
        return;
    }
    let lines = format!("{HEAD}    def run(self, parameters, u):\n        return [u]\nserve(S())\n");
    let folder = written(&format!("{lines}open('ended', 'w').close()\ntime.sleep(600)\n"));
    let simulator = python("sim.py", folder.path(), Command::PATIENCE).unwrap();
    let began = std::time::Instant::now();
    drop(simulator);
    assert!(folder.path().join("ended").exists());
    assert!(began.elapsed() < Duration::from_secs(60));
}
