//! The elastic joint between two bodies that move together, such as the shaft between a motor and its load.

use nalgebra::DVector;

use super::{Plant, Port, PortScale, PortSource};

/// Name of the port.
pub(super) const NAME: &str = "joint";

/// Largest ratio of the other poles to that of the mode: both bodies are then nearly free, so that the force in the
/// joint and its reaction leave their common motion as it is.
const SLOW: f64 = 0.1;

/// Smallest share of the acceleration at the axis that the common motion must have, and the mode. With less, one of the
/// bodies has almost no inertia.
const LEAST: f64 = 0.01;

/// Largest ratio of the acceleration in the common motion to that in the mode if a port is the joint itself.
const ITSELF: f64 = 0.05;

/// Returns the port across the elastic joint of a drive: two bodies coupled by one mode, the first of which the input
/// drives. `ports` are the others, that of the input first. `None` if the plant is no such drive, or if one of the
/// ports is the joint.
///
/// Let j1 and j2 be the inertias. A unit input accelerates its axis by 1 / (j1 + j2) in the common motion, and by
/// 1 / j1 - 1 / (j1 + j2) in the mode. The ratio of the second number to their sum is s = j2 / (j1 + j2). If the bodies
/// turn by d against each other, the mode moves the axis by s d. The force in the joint drives the mode 1 / s times as
/// strongly as the input does.
pub(super) fn infer(plant: &Plant, ports: &[Port]) -> Option<Port> {
    let ([mode], 1) = (plant.modes.as_slice(), plant.m) else { return None };
    let (axis, others) = ports.split_first()?;
    if plant.fastest_beside()? > SLOW * mode.pole.norm() || ports.iter().any(|port| port.name == NAME) {
        return None;
    }
    let in_mode = |port: &Port| 2.0 * (port.velocity[0] * port.force[0]).re;
    let common = |port: &Port| port.velocity_rest.dot(&port.force_rest);
    let is_itself = |port: &Port| common(port).abs() < ITSELF * in_mode(port).abs();
    let s = in_mode(axis) / (in_mode(axis) + common(axis));
    if !(LEAST..1.0 - LEAST).contains(&s) || others.iter().any(is_itself) {
        return None;
    }
    // The input accelerates the common motion. A pole that it displaces at once is no motion of bodies.
    let displaced = axis.displacement_rest.dot(&axis.force_rest);
    if mode.pole.norm() * displaced.abs() > plant.settings.at_once * common(axis) {
        return None;
    }
    let none = DVector::zeros(plant.rest.a.nrows());
    let joint = Port {
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
    };
    // A force in the joint does not displace it at once, unless friction couples the mode with the common motion.
    let displaced = joint.at_once(&joint.displacement, &joint.displacement_rest);
    let is_free = mode.pole.norm() * displaced.abs() < plant.settings.at_once * in_mode(&joint);
    is_free.then_some(joint)
}

impl Plant {
    /// Returns whether a port is the elastic joint of a drive, as it is inferred.
    pub fn is_joint(&self, port: usize) -> bool {
        let port = &self.ports[port];
        // A declared port, an input or an output may have the same name.
        let is_inferred = self.port_source == PortSource::Axis && port.input.is_none();
        is_inferred && port.name == NAME && matches!(port.scale, PortScale::Shown { .. })
    }

    /// Returns the magnitude of the fastest pole beside the modes, in rad/s; `None` if there is none.
    pub(super) fn fastest_beside(&self) -> Option<f64> {
        if self.rest.a.is_empty() {
            return None;
        }
        let poles = plid_model::eigenvalues(&self.rest.a).ok()?;
        poles.iter().map(|z| z.ln().norm() * self.rate).reduce(f64::max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::drive::{LOAD, MOTOR, matrix};
    use nalgebra::{DMatrix, dmatrix};
    use plid_model::{Model, OutputKind};

    const SHAFT: f64 = 400.0;

    /// Returns a motor and a load whose bearings brake them; a spring of this stiffness may hold the motor. The
    /// position or the velocity of the motor is measured.
    fn drive(brakes: [f64; 2], spring: f64, kind: OutputKind) -> Plant {
        let mut a = matrix(SHAFT, 0.2, brakes);
        a[(1, 0)] -= spring / MOTOR;
        let (a, b, c) = if kind == OutputKind::Position {
            (a, dmatrix![0.0; 1.0 / MOTOR; 0.0; 0.0], dmatrix![1.0, 0.0, 0.0, 0.0])
        } else {
            // Without a position, the common motion has no position either: the twist and the velocities remain.
            let twist = dmatrix![1.0, 0.0, -1.0, 0.0; 0.0, 1.0, 0.0, 0.0; 0.0, 0.0, 0.0, 1.0];
            let back = twist.clone().pseudo_inverse(1e-12).unwrap();
            (twist * a * back, dmatrix![0.0; 1.0 / MOTOR; 0.0], dmatrix![0.0, 1.0, 0.0])
        };
        let (a, b) = crate::testing::held(&a, &b, 2e-3);
        let mut model = Model::new(500.0, a, b, c, DMatrix::zeros(1, 1)).unwrap();
        model.output_kinds = vec![Some(kind)];
        Plant::new(&model).unwrap()
    }

    /// The joint has the stiffness of the shaft and the mobility 1 / j1 + 1 / j2 of both inertias. If the friction is
    /// that of the motor alone, it couples the mode with the common motion.
    #[test]
    fn the_joint_of_a_drive_is_that_of_its_equations() {
        for kind in [OutputKind::Position, OutputKind::Velocity] {
            for (brakes, error) in [([1.5, 1.5], 1e-3), ([7.5, 0.0], 0.02)] {
                let plant = drive(brakes, 0.0, kind);
                assert_eq!(plant.port_source, PortSource::Axis);
                let names: Vec<&str> = plant.ports.iter().map(|port| port.name.as_str()).collect();
                assert_eq!(names, ["u1", NAME], "{kind:?}");
                let (stiffness, mobility) = (plant.stiffness(&plant.ports[1]), plant.mobility(1));
                assert!((stiffness / SHAFT - 1.0).abs() < error, "{kind:?}: {stiffness}");
                assert!((mobility / (1.0 / MOTOR + 1.0 / LOAD) - 1.0).abs() < error, "{kind:?}: {mobility}");
                assert!(plant.is_joint(1) && !plant.is_joint(0) && plant.ports[1].sees_displacement());
            }
        }
    }

    /// A motor that a spring holds does not move freely with its load, nor does one with much friction.
    #[test]
    fn a_held_motor_has_no_such_joint() {
        for plant in [drive([1.5, 1.5], 100.0, OutputKind::Position), drive([70.0, 0.0], 0.0, OutputKind::Velocity)] {
            assert!(plant.ports.iter().all(|port| port.name != NAME));
        }
    }
}
