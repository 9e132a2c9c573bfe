//! A motor that turns a load through an elastic shaft with free play. The true drive is integrated as in the blind
//! cases, with the shaft as a port. The simulation has no port, and the motor's speed is the only output.

use std::path::Path;

use nalgebra::{DMatrix, dmatrix};
use plid_model::{Continuous, Model, Port};

use crate::answer::predict::Predictor;
use crate::case::record::{Channels, rms};
use crate::effects::Library;
use crate::testing::blind::integrate;
use crate::testing::{case_of_axis, first_is, held, only, random_input};
use crate::{Outcome, diagnose};

const RATE: f64 = 250.0;

/// Number of samples over which a command is held.
const HOLD: usize = 5;

/// Inertias of the motor and of the load.
pub const MOTOR: f64 = 0.01;
pub const LOAD: f64 = 0.04;

/// The stiffness of the shaft, and half of its free play. The shaft turns by about 0.01.
const SHAFT: f64 = 100.0;
const PLAY: f64 = 0.002;

/// Returns the matrix of the position and velocity of the motor, and of those of the load. The shaft has a stiffness
/// and a damper; `brakes` are the viscous frictions of motor and load over their inertias.
pub fn matrix(shaft: f64, damper: f64, brakes: [f64; 2]) -> DMatrix<f64> {
    dmatrix![
        0.0, 1.0, 0.0, 0.0;
        -shaft / MOTOR, -damper / MOTOR - brakes[0], shaft / MOTOR, damper / MOTOR;
        0.0, 0.0, 0.0, 1.0;
        shaft / LOAD, damper / LOAD, -shaft / LOAD, -damper / LOAD - brakes[1]
    ]
}

/// Returns the drive without free play.
fn drive() -> Model {
    let a = matrix(SHAFT, 0.02, [1.5, 0.8]);
    let b = dmatrix![0.0; 1.0 / MOTOR; 0.0; 0.0];
    let (step, input) = held(&a, &b, 1.0 / RATE);
    let speed = dmatrix![0.0, 1.0, 0.0, 0.0];
    let mut model = Model::new(RATE, step, input, speed, DMatrix::zeros(1, 1)).unwrap();
    model.continuous = Some(Continuous { a, b });
    model.ports = vec![Port {
        name: "shaft".into(),
        input: None,
        force: vec![0.0, 1.0 / MOTOR, 0.0, -1.0 / LOAD],
        displacement: vec![1.0, 0.0, -1.0, 0.0],
        velocity: vec![0.0, 1.0, 0.0, -1.0],
        output: None,
    }];
    model
}

/// Nothing is declared: neither the kind of the output nor a port. The simulation that is written predicts a new
/// record.
#[test]
fn play_in_the_shaft_of_a_drive_is_named_at_its_joint() {
    let input = |k: usize| -> Channels {
        let drawn = &random_input(k as u64 + 1, 2000, 1)[0];
        vec![(0..2000).map(|n| drawn[n / HOLD]).collect()]
    };
    let lost = |d: f64, _: f64| SHAFT * d.clamp(-PLAY, PLAY);
    let simulation = Model { continuous: None, ports: Vec::new(), ..drive() };
    let mut case = case_of_axis(&simulation, input, |u| integrate(&drive(), u, Some(&lost)).0);
    case.config.units.insert("y1".into(), "rad/s".into());
    let rivals = ["clearance", "modal-frequency", "modal-damping", "added-mass", "coulomb-friction", "actuator-lag"];
    only(&mut case, &[&["backlash"], &rivals[..]].concat());
    let Outcome { diagnosis: found, simulation, .. } = diagnose(&case, &Library::standard(), &mut |_| {}).unwrap();
    let first = first_is(&found, "backlash", "port:joint");
    let near = |name: &str, truth: f64| (first.parameters[name].value / truth - 1.0).abs() < 0.1;
    assert!(near("k", SHAFT) && near("g", PLAY), "{}", found.text());
    assert!(found.gap.with_effect < 1.5 * found.gap.noise_floor, "{}", found.sentence);
    let said = "on the axis of u1 and in the elastic joint (port:joint)";
    assert!(found.evidence.iter().any(|evidence| evidence.contains(said)), "{:?}", found.evidence);
    let predictor = Predictor::new(simulation, &Library::standard(), Path::new("here")).unwrap();
    let (new, right) = (input(9), integrate(&drive(), &input(9), Some(&lost)).0.remove(0));
    let predicted = predictor.predict(&new, 0.0).unwrap().outputs.remove(0);
    let error: Vec<f64> = predicted.iter().zip(&right).map(|(a, b)| a - b).collect();
    assert!(rms(&error) < found.gap.noise_floor * rms(&right), "{}", rms(&error) / rms(&right));
}
