//! The example that writes a model.json from the matrices of a mechanical model, compared with closed forms.

use std::io::Write;
use std::path::Path;
use std::process::Command;

use plid_model::{Model, frequency_response, modes};

const SCRIPT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../examples/model_from_matrices.py");

const MASS: f64 = 2.0;
const DAMPER: f64 = 3.0;
const SPRING: f64 = 50.0;

/// A mass on a spring and a damper, written by NumPy.
const MATRICES: &str = "import sys, numpy as np; one = lambda x: np.array([[x]]); np.savez(sys.argv[1], M=one(2.), \
                        C=one(3.), K=one(50.), inputs=one(1.), outputs=one(1.), ports=one(1.), port_names=['mount'])";

fn succeeds(command: &mut Command) {
    let ran = command.output().unwrap();
    assert!(ran.status.success(), "{}", String::from_utf8_lossy(&ran.stderr));
}

fn model(folder: &Path, kind: &str) -> Model {
    let (matrices, out) = (folder.join("matrices.npz"), folder.join(format!("{kind}.json")));
    succeeds(Command::new("python3").args(["-c", MATRICES]).arg(&matrices));
    let run = ["--rate", "100", "--kind", kind, "--out"];
    succeeds(Command::new("python3").arg(SCRIPT).arg(&matrices).args(run).arg(&out));
    Model::read(&out).unwrap()
}

#[test]
fn matrices_become_a_simulation_with_ports() {
    if !Command::new("python3").args(["-c", "import numpy, scipy"]).output().is_ok_and(|ran| ran.status.success()) {
        // Writes past the test harness, which suppresses the output of a passing test.
        let skipped = "SKIPPED matrices_become_a_simulation_with_ports: no python3 with numpy and scipy";
        writeln!(std::io::stderr(), "{skipped}").unwrap();
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let position = model(folder.path(), "position");
    let found = modes(&position).unwrap();
    assert!((found[0].hz / ((SPRING / MASS).sqrt() / std::f64::consts::TAU) - 1.0).abs() < 1e-9, "{found:?}");
    assert!((found[0].damping / (DAMPER / (2.0 * (SPRING * MASS).sqrt())) - 1.0).abs() < 1e-9, "{found:?}");
    let at_rest = |model: &Model| frequency_response(model, &[0.0]).unwrap()[0][(0, 0)].re;
    assert!((at_rest(&position) * SPRING - 1.0).abs() < 1e-9);
    let port = &position.ports[0];
    assert_eq!((port.name.as_str(), &port.output), ("mount", &None));
    assert_eq!((&port.force[..], &port.displacement[..]), (&[0.0, 1.0 / MASS][..], &[1.0, 0.0][..]));
    let acceleration = model(folder.path(), "acceleration");
    assert!(at_rest(&acceleration).abs() < 1e-9);
    // A force moves an accelerometer at once.
    assert_eq!((acceleration.d[(0, 0)], &acceleration.ports[0].output), (1.0 / MASS, &Some(vec![1.0 / MASS])));
}
