//! The elastic joint between two bodies that move together, such as the shaft between a motor and its load.

use nalgebra::DVector;

use super::{Plant, Port};
use plid_fourier::C;

/// Name of the port.
pub(super) const NAME: &str = "joint";

/// Largest ratio of the other poles to that of the mode: both bodies are then nearly free, so that the force in the
/// joint and its reaction leave their common motion as it is.
const SLOW: f64 = 0.1;

/// Smallest share of the acceleration at a port that its common motion, or its mode, must have. With less, one of the
/// bodies has almost no inertia.
const LEAST: f64 = 0.01;

/// Largest share of the acceleration at a port that the common motion has if the port is the joint itself.
const ITSELF: f64 = 0.05;

/// Returns the port across the elastic joint of a drive: two bodies with one mode, of which the input drives the first.
/// `ports` are the others, that of the input first. `None` if the plant is no such drive, or if one of the ports is the
/// joint.
///
/// Let j1 and j2 be the inertias. A unit input accelerates its axis by 1 / (j1 + j2) in the common motion, and by
/// 1 / j1 - 1 / (j1 + j2) in the mode. The ratio of the second number to their sum is s = j2 / (j1 + j2). If the bodies
/// turn by d against each other, the mode moves the axis by s d. The force in the joint drives the mode 1 / s times as
/// strongly as the input does.
pub(super) fn infer(plant: &Plant, ports: &[Port]) -> Option<Port> {
    let ([mode], 1) = (plant.modes.as_slice(), plant.m) else { return None };
    let axis = ports.first()?;
    let poles = plant.rest.a.complex_eigenvalues();
    let is_slow = |z: &C| z.ln().norm() * plant.rate < SLOW * mode.pole.norm();
    if poles.is_empty() || !poles.iter().all(is_slow) || ports.iter().any(|port| port.name == NAME) {
        return None;
    }
    let in_mode = |port: &Port| 2.0 * (port.velocity[0] * port.force[0]).re;
    let common = |port: &Port| port.velocity_rest.dot(&port.force_rest);
    let is_itself = |port: &Port| common(port).abs() < ITSELF * in_mode(port).abs();
    let s = in_mode(axis) / (in_mode(axis) + common(axis));
    if !(LEAST..1.0 - LEAST).contains(&s) || ports.iter().any(is_itself) {
        return None;
    }
    let none = DVector::zeros(plant.rest.a.nrows());
    Some(Port {
        name: NAME.into(),
        input: None,
        scale: axis.scale,
        force: vec![axis.force[0] / s],
        // The mode moves freely between the bodies, so its displacement is the integral of its velocity.
        displacement: vec![axis.velocity[0] / mode.pole / s],
        velocity: vec![axis.velocity[0] / s],
        force_rest: none.clone(),
        displacement_rest: none.clone(),
        velocity_rest: none,
        output: Vec::new(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plant::PortSource;
    use nalgebra::{DMatrix, dmatrix};
    use plid_model::{Model, OutputKind};

    const MOTOR: f64 = 0.01;
    const LOAD: f64 = 0.04;

    /// Returns a motor and a load with an elastic shaft of this stiffness; bearings brake both in proportion to their
    /// inertias, and a spring of this stiffness may hold the motor. The position or the velocity of the motor is
    /// measured.
    fn drive(k: f64, spring: f64, kind: OutputKind) -> Plant {
        let (c, brake) = (0.2, 1.5);
        let a = dmatrix![
            0.0, 1.0, 0.0, 0.0;
            -(k + spring) / MOTOR, -c / MOTOR - brake, k / MOTOR, c / MOTOR;
            0.0, 0.0, 0.0, 1.0;
            k / LOAD, c / LOAD, -k / LOAD, -c / LOAD - brake
        ];
        let row = if kind == OutputKind::Position { 0 } else { 1 };
        // Without a position, the common motion has no position either.
        let twist = dmatrix![1.0, 0.0, -1.0, 0.0; 0.0, 1.0, 0.0, 0.0; 0.0, 0.0, 0.0, 1.0];
        let (a, b, c) = if kind == OutputKind::Position {
            (a, dmatrix![0.0; 1.0 / MOTOR; 0.0; 0.0], DMatrix::from_fn(1, 4, |_, j| f64::from(u8::from(j == row))))
        } else {
            let back = twist.clone().pseudo_inverse(1e-12).unwrap();
            (&twist * a * &back, dmatrix![0.0; 1.0 / MOTOR; 0.0], dmatrix![0.0, 1.0, 0.0])
        };
        let (a, b) = crate::testing::held(&a, &b, 2e-3);
        let mut model = Model::new(500.0, a, b, c, DMatrix::zeros(1, 1)).unwrap();
        model.output_kinds = vec![Some(kind)];
        Plant::new(&model).unwrap()
    }

    /// The joint has the stiffness of the shaft and the mobility 1 / j1 + 1 / j2 of both inertias.
    #[test]
    fn the_joint_of_a_drive_is_that_of_its_equations() {
        for kind in [OutputKind::Position, OutputKind::Velocity] {
            let plant = drive(400.0, 0.0, kind);
            assert_eq!(plant.port_source, PortSource::Axis);
            let names: Vec<&str> = plant.ports.iter().map(|port| port.name.as_str()).collect();
            assert_eq!(names, ["u1", NAME], "{kind:?}");
            let (stiffness, mobility) = (plant.stiffness(&plant.ports[1]), plant.mobility(1));
            assert!((stiffness / 400.0 - 1.0).abs() < 1e-3, "{kind:?}: {stiffness}");
            assert!((mobility / (1.0 / MOTOR + 1.0 / LOAD) - 1.0).abs() < 1e-6, "{kind:?}: {mobility}");
            assert!(plant.ports[1].sees_displacement());
        }
    }

    /// A motor that a spring holds does not move freely with its load.
    #[test]
    fn a_held_motor_has_no_such_joint() {
        let plant = drive(400.0, 100.0, OutputKind::Position);
        assert!(plant.ports.iter().all(|port| port.name != NAME));
    }
}
