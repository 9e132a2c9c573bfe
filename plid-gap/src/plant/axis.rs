use nalgebra::{DMatrix, DVector};
use plid_model::OutputKind;

use super::{CasePort, KindSource, Plant, Port, PortScale};
use plid_fourier::C;

/// Frequencies, relative to the sample rate, at which the response to a motion is compared.
const SLOW_AND_FAST: [f64; 2] = [1e-3, 0.25];

/// Infers the axis of each input, as a port, for a plant without lightly damped modes: a motor, a servo or a slider.
///
/// The axis is the port between the input and the collocated output. Of the outputs that sense a position or a
/// velocity, or are declared to sense an acceleration, this is the one to which the input contributes the largest
/// share. A velocity gives the displacement only if a spring holds the axis. Otherwise the displacement is not a
/// combination of the states. If the velocity is declared as such, its integral is then a further state. An undeclared
/// output whose response falls with frequency like the speed of a motor may also be a temperature, whose integral has
/// no meaning.
///
/// If no output measures a motion, the input itself may be a motion and an output the force that it requires, as for
/// a damper on a testing machine. `kinds` are the declared kinds of the outputs.
pub(super) fn infer(plant: &mut Plant, inputs: &[String], kinds: &[Option<OutputKind>]) -> Vec<Port> {
    for output in (0..plant.m).filter_map(|input| collocated(plant, input)).collect::<Vec<usize>>() {
        if plant.sensed[output].source == KindSource::Declared {
            plant.integrate(output);
        }
    }
    let plant = &*plant;
    let axis = |(input, name): (usize, &String)| {
        let Some(output) = collocated(plant, input) else { return moved(plant, input, name, kinds) };
        let port = plant.between(&CasePort { name: name.clone(), input, output }).ok()?;
        Some(Port { input: Some(input), ..port })
    };
    inputs.iter().enumerate().filter_map(axis).collect()
}

/// Returns the port of an input that is a motion, if an output is the force that it requires. Either the output is
/// declared as a force, or it responds to the input at once, and several times more strongly to a fast input than to
/// a slow one. The force on a damper or a mass does so; the force on a spring, or a motion, does not.
fn moved(plant: &Plant, input: usize, name: &str, kinds: &[Option<OutputKind>]) -> Option<Port> {
    let at_once = |o: usize| plant.d[(o, input)].abs();
    let is_force = |o: &usize| match kinds.get(*o).copied().flatten() {
        Some(OutputKind::Force) => at_once(*o) > 0.0,
        Some(_) => false,
        None => {
            let [slow, fast] = SLOW_AND_FAST.map(|share| plant.response(share * plant.rate)[(*o, input)].norm());
            at_once(*o) > 0.5 * fast && fast > plant.settings.force_rise * slow
        }
    };
    let output = (0..plant.p).filter(is_force).max_by(|&x, &y| at_once(x).total_cmp(&at_once(y)))?;
    // The device resists the motion, so a force at the port appears in the output with the sign opposite to the
    // feedthrough.
    let measured = -plant.d[(output, input)].signum();
    let none = DVector::zeros(plant.rest.a.nrows());
    Some(Port {
        name: name.into(),
        input: Some(input),
        scale: PortScale::Moved { input, output },
        force: Vec::new(),
        displacement: Vec::new(),
        velocity: Vec::new(),
        force_rest: none.clone(),
        displacement_rest: none.clone(),
        velocity_rest: none,
        output: (0..plant.p).map(|o| if o == output { measured } else { 0.0 }).collect(),
    })
}

/// Returns the output that measures the motion of an input's axis, if there is one.
fn collocated(plant: &Plant, input: usize) -> Option<usize> {
    let share = |o: usize| {
        let size = |i: usize| plant.rest.c.row(o).dot(&plant.rest.b.column(i).transpose()).abs();
        let all: f64 = (0..plant.m).map(size).sum();
        if all > 0.0 { size(input) / all } else { 0.0 }
    };
    let shows_motion = |o: &usize| {
        let sensed = plant.sensed[*o];
        sensed.order().is_some_and(|order| order < 2 || sensed.source == KindSource::Declared)
    };
    (0..plant.p).filter(shows_motion).max_by(|&x, &y| share(x).total_cmp(&share(y))).filter(|&o| share(o) > 0.0)
}

/// Distance from the origin at which the compliance is evaluated to detect a pole there, relative to a bound on the
/// fastest pole. Rounding moves a double pole by the square root of the machine precision.
const NEAR_ORIGIN: f64 = 1e-7;

impl Plant {
    /// Returns the stiffness at a port on an axis: the force over the static displacement that it causes. Zero if
    /// nothing holds the axis, or if its displacement is not known.
    pub(super) fn axis_stiffness(&self, port: &Port) -> f64 {
        let seen = self.rest.seen();
        let Some((a, _)) = self.rest.continuous.as_ref().filter(|_| seen > 0 && !self.integrates(port)) else {
            return 0.0;
        };
        let a = a.view((0, 0), (seen, seen)).into_owned();
        let [force, row] = [&port.force_rest, &port.displacement_rest].map(|of| of.rows(0, seen));
        let size = a.amax() * a.nrows() as f64;
        let compliance = |distance: f64| {
            let shifted = &a - DMatrix::identity(seen, seen) * (distance * size);
            let displaced = shifted.lu().solve(&force);
            displaced.map_or(f64::INFINITY, |x| row.dot(&x).abs())
        };
        // A pole at the origin is there only up to rounding. At half the distance from such a pole, the compliance is
        // twice as large.
        let is_held = compliance(NEAR_ORIGIN) < 1.5 * compliance(2.0 * NEAR_ORIGIN);
        let at_rest = compliance(0.0);
        if is_held && at_rest > 0.0 && at_rest.is_finite() { at_rest.recip() } else { 0.0 }
    }
}

impl Port {
    /// Returns the input that is the motion at the port, if it is one.
    pub fn moved_by(&self) -> Option<usize> {
        match self.scale {
            PortScale::Moved { input, .. } => Some(input),
            _ => None,
        }
    }

    /// Returns whether the displacement at the port is known, and not only the velocity.
    pub fn sees_displacement(&self) -> bool {
        self.moved_by().is_some()
            || self.displacement.iter().any(|x| *x != C::ZERO)
            || self.displacement_rest.iter().any(|x| *x != 0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plant::PortSource;
    use nalgebra::dmatrix;
    use plid_model::Model;

    /// The poles of two independent sliders are their dampers over their masses, and not those of actuators.
    #[test]
    fn the_poles_of_two_axes_are_no_actuators() {
        let a = dmatrix![0.0, 1.0, 0.0, 0.0; 0.0, -3.0, 0.0, 0.0; 0.0, 0.0, 0.0, 1.0; 0.0, 0.0, 0.0, -5.0];
        let (a, b) = crate::testing::held(&a, &dmatrix![0.0, 0.0; 1.0, 0.0; 0.0, 0.0; 0.0, 1.0], 1e-3);
        let c = dmatrix![1.0, 0.0, 0.0, 0.0; 0.0, 0.0, 1.0, 0.0];
        let plant = Plant::new(&Model::new(1000.0, a, b, c, DMatrix::zeros(2, 2)).unwrap()).unwrap();
        assert!(plant.modes.is_empty() && plant.chain.actuator.iter().all(Option::is_none));
    }

    /// A mass of 2 with a viscous damper of 3 and a spring `k`, whose position or velocity is measured at 1 kHz.
    fn axis(k: f64, position: bool) -> Plant {
        let (a, b) = (dmatrix![0.0, 1.0; -k / 2.0, -1.5], dmatrix![0.0; 0.5]);
        let (a, b) = crate::testing::held(&a, &b, 1e-3);
        let c = if position { dmatrix![1.0, 0.0] } else { dmatrix![0.0, 1.0] };
        Plant::new(&Model::new(1000.0, a, b, c, DMatrix::zeros(1, 1)).unwrap()).unwrap()
    }

    /// The same mass without a spring; only its speed is a state.
    fn motor() -> Plant {
        let (a, b) = crate::testing::held(&dmatrix![-1.5], &dmatrix![0.5], 1e-3);
        Plant::new(&Model::new(1000.0, a, b, dmatrix![1.0], DMatrix::zeros(1, 1)).unwrap()).unwrap()
    }

    /// The temperature of a heater falls with frequency as the speed of a motor does. No force acts there if it is
    /// declared to be something else than a motion, or a force without a direct response.
    #[test]
    fn a_heater_has_no_axis() {
        let of = |kind: Option<OutputKind>| {
            let (a, b) = crate::testing::held(&dmatrix![-0.02], &dmatrix![0.5], 1.0);
            let mut model = Model::new(1.0, a, b, dmatrix![1.0], dmatrix![0.0]).unwrap();
            model.output_kinds = vec![kind];
            Plant::new(&model).unwrap()
        };
        assert_eq!((of(None).ports.len(), of(None).sensed[0].kind), (1, OutputKind::Velocity));
        for kind in [OutputKind::Other, OutputKind::Force] {
            let mut heater = of(Some(kind));
            assert!(heater.ports.is_empty(), "{kind:?}");
            let port = CasePort { name: "coil".into(), input: 0, output: 0 };
            let (_, why) = heater.declare(&[port]).unwrap_err();
            assert!(why.contains(kind.name()) && why.contains("not a motion"), "{why}");
        }
    }

    #[test]
    fn an_overdamped_servo_has_its_axis() {
        let plant = axis(0.7, true);
        assert_eq!((plant.modes.len(), plant.port_source), (0, PortSource::Axis));
        let port = &plant.ports[0];
        assert!(port.sees_displacement());
        // A unit force accelerates the mass by 1/2, and the spring holds it.
        assert!((port.velocity_rest.dot(&port.force_rest) - 0.5).abs() < 1e-6);
        assert!(port.displacement_rest.dot(&port.force_rest).abs() < 1e-6);
        assert!((plant.stiffness(port) / 0.7 - 1.0).abs() < 1e-6, "{}", plant.stiffness(port));
    }

    #[test]
    fn a_velocity_does_not_give_the_displacement_of_a_motor() {
        let plant = motor();
        let port = &plant.ports[0];
        assert!(!port.sees_displacement());
        assert!((port.velocity_rest.dot(&port.force_rest) - 0.5).abs() < 1e-6);
    }

    /// If a spring holds the axis, its displacement is a state, whatever is measured.
    #[test]
    fn a_velocity_gives_the_displacement_on_a_spring() {
        let plant = axis(0.7, false);
        let port = &plant.ports[0];
        assert!(port.sees_displacement());
        assert!(port.displacement_rest.dot(&port.force_rest).abs() < 1e-6);
        assert!((plant.stiffness(port) / 0.7 - 1.0).abs() < 1e-6, "{}", plant.stiffness(port));
    }

    /// Nothing holds a slider: its pole at the origin has a continuous form, and its axis has no stiffness.
    #[test]
    fn a_free_slider_has_its_axis() {
        let plant = axis(0.0, true);
        let port = &plant.ports[0];
        assert!((port.velocity_rest.dot(&port.force_rest) - 0.5).abs() < 1e-6);
        assert_eq!(plant.stiffness(port), 0.0);
    }

    /// In another basis, rounding moves the pole of a free slider off the origin. The pole is not mistaken for that
    /// of a spring.
    #[test]
    fn rounding_is_no_spring() {
        for k in 0..20 {
            let angle = 0.1 + f64::from(k);
            let basis = dmatrix![angle.cos(), 0.7 * angle.sin(); -1.3 * angle.sin(), angle.cos() + 0.01];
            let inverse = basis.clone().try_inverse().unwrap();
            for (stiffness, expected) in [(0.0, 0.0), (1e-3, 1e-3)] {
                let (a, b) = (dmatrix![0.0, 1.0; -stiffness / 2.0, -1.5], dmatrix![0.0; 0.5]);
                let (a, b) = crate::testing::held(&(&basis * a * &inverse), &(&basis * b), 1e-3);
                let c = dmatrix![1.0, 0.0] * &inverse;
                let plant = Plant::new(&Model::new(1000.0, a, b, c, DMatrix::zeros(1, 1)).unwrap()).unwrap();
                let found = plant.stiffness(&plant.ports[0]);
                assert!((found - expected).abs() <= 1e-3 * expected, "{angle}: {found} instead of {expected}");
            }
        }
    }

    /// A damper on a testing machine, as a model of its records represents it: its response rises with frequency up
    /// to the frequency of its lag. An undeclared spring, a servo and a motor have no such port.
    #[test]
    fn what_moves_a_damper_is_the_motion_at_its_port() {
        let lag: f64 = 0.3;
        // y = 40 (u - x) with x+ = lag x + (1 - lag) u.
        let damper = |gain: f64, kind: Option<OutputKind>| {
            let (a, b) = (dmatrix![lag], dmatrix![1.0 - lag]);
            let mut model = Model::new(1000.0, a, b, dmatrix![-gain], dmatrix![gain]).unwrap();
            model.output_kinds = vec![kind];
            Plant::new(&model).unwrap()
        };
        for (gain, measured) in [(40.0, -1.0), (-40.0, 1.0)] {
            let plant = damper(gain, None);
            assert_eq!(plant.port_source, PortSource::Axis);
            assert_eq!(plant.ports[0].scale, PortScale::Moved { input: 0, output: 0 });
            assert_eq!(plant.ports[0].output, [measured]);
            assert!(plant.ports[0].sees_displacement());
        }
        assert!(damper(40.0, Some(OutputKind::Other)).ports.is_empty());
        // A spring with some damping has such a port only if its output is declared.
        let spring = |kind: Option<OutputKind>| {
            let (a, b) = (dmatrix![lag], dmatrix![1.0 - lag]);
            let mut model = Model::new(1000.0, a, b, dmatrix![-1.0], dmatrix![3.0]).unwrap();
            model.output_kinds = vec![kind];
            Plant::new(&model).unwrap().ports.len()
        };
        assert_eq!([spring(None), spring(Some(OutputKind::Force))], [0, 1]);
        assert!(axis(0.7, true).ports[0].moved_by().is_none() && motor().ports[0].moved_by().is_none());
    }
}
