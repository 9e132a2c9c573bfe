//! An actuator that lags within the loop that its input commands.
//!
//! The input of a position servo is a reference. Its torque depends on the reference and on the motion, and it is
//! this torque that lags. Unlike a lag of the command, this lag reduces the damping of the loop. In continuous time,
//! the motion at the port obeys M dv/dt = T + f, where the torque T is a linear function of the state and the inputs.
//! The lagged torque z replaces T: dz/dt = w (T - z). Everything that accelerates the port counts as torque, so
//! friction outside the loop lags, too.

use nalgebra::{DMatrix, DVector};

use super::Plant;
use super::load::held;

/// Largest difference between a servo's static position and its command, relative to the command.
const FOLLOWS: f64 = 0.01;

impl Plant {
    /// Returns whether the input of a port commands the port's position, that is, whether the static position of the
    /// port equals the input.
    pub fn commands_position(&self, port: usize) -> bool {
        let Some(input) = self.ports[port].input.filter(|_| self.mobility(port) > 0.0) else { return false };
        let Some((a, b)) = &self.rest.continuous else { return false };
        let port = &self.ports[port];
        let modes = self.modes.iter().zip(&port.displacement);
        let modes: f64 = modes.map(|(mode, row)| -2.0 * (row * mode.b[input] / mode.pole).re).sum();
        let seen = self.rest.seen();
        let rest = if seen == 0 {
            Some(0.0)
        } else {
            let at_rest = a.view((0, 0), (seen, seen)).into_owned().lu().solve(&b.view((0, input), (seen, 1)));
            at_rest.map(|x| -port.displacement_rest.rows(0, seen).dot(&x.column(0)))
        };
        rest.is_some_and(|rest| (modes + rest - 1.0).abs() < FOLLOWS)
    }

    /// Passes the force that accelerates a port through a lag with this pole in rad/s. The state of the lag follows the
    /// first `modal` states: those of the modes, which a load may already have coupled. Nothing changes without a
    /// continuous form of the rest.
    pub fn lag_drive(&mut self, number: usize, pole: f64, modal: usize) {
        let mobility = self.mobility(number);
        if self.rest.continuous.is_none() || mobility <= 0.0 {
            return;
        }
        self.couple();
        let Some((a, b)) = self.rest.continuous.take() else { return };
        let (force, velocity, at_once) = {
            let port = &self.ports[number];
            (&port.force_rest, &port.velocity_rest, &port.output)
        };
        // T = row . x + gain . u
        let (row, gain) = (a.tr_mul(velocity) / mobility, b.tr_mul(velocity) / mobility);
        let at_once = DVector::from_fn(self.p, |o, _| at_once.get(o).copied().unwrap_or(0.0));
        let mut lagged = (&a - force * row.transpose()).insert_column(modal, 0.0);
        lagged.set_column(modal, force);
        let mut lagged = lagged.insert_row(modal, 0.0);
        lagged.set_row(modal, &(row.transpose().insert_column(modal, -1.0) * pole));
        let mut driven = (&b - force * gain.transpose()).insert_row(modal, 0.0);
        driven.set_row(modal, &(gain.transpose() * pole));
        let mut seen: DMatrix<f64> = (&self.rest.c - &at_once * row.transpose()).insert_column(modal, 0.0);
        seen.set_column(modal, &at_once);
        self.d -= &at_once * gain.transpose();
        for port in &mut self.ports {
            for of in [&mut port.force_rest, &mut port.displacement_rest, &mut port.velocity_rest] {
                *of = std::mem::take(of).insert_row(modal, 0.0);
            }
        }
        self.rest = held(lagged, driven, seen, 1.0 / self.rate);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plant::CasePort;
    use nalgebra::dmatrix;
    use plid_model::{Model, OutputKind};

    const RATE: f64 = 500.0;

    /// Returns a servo of unit mass with these position and velocity gains. If its drive lags, `pole` is the pole of
    /// the drive in rad/s.
    fn servo(stiffness: f64, damping: f64, pole: Option<f64>, kind: OutputKind) -> Plant {
        let (mut a, mut b) = (dmatrix![0.0, 1.0; -stiffness, -damping], dmatrix![0.0; stiffness]);
        let (mut seen, mut direct) = match kind {
            OutputKind::Position => (dmatrix![1.0, 0.0], 0.0),
            OutputKind::Velocity => (dmatrix![0.0, 1.0], 0.0),
            _ => (dmatrix![-stiffness, -damping], stiffness),
        };
        if let Some(w) = pole {
            a = dmatrix![0.0, 1.0, 0.0; 0.0, 0.0, 1.0; -w * stiffness, -w * damping, -w];
            b = dmatrix![0.0; 0.0; w * stiffness];
            seen = if direct == 0.0 { seen.insert_column(2, 0.0) } else { dmatrix![0.0, 0.0, 1.0] };
            direct = 0.0;
        }
        let (a, b) = crate::testing::held(&a, &b, 1.0 / RATE);
        let mut model = Model::new(RATE, a, b, seen, dmatrix![direct]).unwrap();
        model.output_kinds = vec![Some(kind)];
        let mut plant = Plant::new(&model).unwrap();
        plant.declare(&[CasePort { name: "axis".into(), input: 0, output: 0 }]).unwrap();
        plant
    }

    /// A force that passes the lag of a drive accelerates nothing at once, whatever rounding leaves.
    #[test]
    fn a_servo_whose_drive_lags_has_no_mobility() {
        for kind in [OutputKind::Position, OutputKind::Velocity] {
            let plant = servo(436.0, 31.0, Some(220.0), kind);
            assert_eq!(plant.mobility(0), 0.0, "{kind:?}");
            assert!(!plant.commands_position(0), "{kind:?}");
        }
    }

    /// Whether the servo is lightly damped or not, and whatever its sensor measures, its response is that of a servo
    /// that is built with the lag.
    #[test]
    fn a_lagged_drive_is_a_servo_built_so() {
        for kind in [OutputKind::Position, OutputKind::Velocity, OutputKind::Acceleration] {
            for damping in [31.0, 4.0] {
                let (mut lagged, built) = (servo(436.0, damping, None, kind), servo(436.0, damping, Some(220.0), kind));
                assert!(lagged.commands_position(0), "{kind:?} {damping}");
                let modal = 2 * lagged.modes.len();
                lagged.lag_drive(0, 220.0, modal);
                for hz in [0.1, 1.0, 3.0, 10.0, 60.0, 200.0] {
                    let far = (lagged.response(hz) - built.response(hz)).norm() / built.response(hz).norm();
                    assert!(far < 1e-6, "{kind:?} {damping} {hz} Hz: {far}");
                }
            }
        }
    }

    /// A force on a mass with a spring is not a commanded position.
    #[test]
    fn a_shaker_commands_no_position() {
        let (a, b) = crate::testing::held(&dmatrix![0.0, 1.0; -436.0, -4.0], &dmatrix![0.0; 1.0], 1.0 / RATE);
        let mut model = Model::new(RATE, a, b, dmatrix![1.0, 0.0], dmatrix![0.0]).unwrap();
        model.output_kinds = vec![Some(OutputKind::Position)];
        let mut plant = Plant::new(&model).unwrap();
        plant.declare(&[CasePort { name: "axis".into(), input: 0, output: 0 }]).unwrap();
        assert!(plant.mobility(0) > 0.0 && !plant.commands_position(0));
    }
}
