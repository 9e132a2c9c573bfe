//! Bodies that move along separate axes, such as a motor, a slide or the joints of an arm.

use std::f64::consts::PI;

use nalgebra::DMatrix;

use crate::plant::StrutPort;
use crate::state_space::StateSpace;
use crate::{INPUTS, OUTPUTS};

/// M q" + C q' + K q = G a. The actuator of input j acts along axis j with the force G_jj a_j, and the sensor of
/// output j measures the motion of axis j. Torques and forces are in V of the actuator, motions in V of the sensor.
/// There is no filter, and there is no actuator pole unless an effect adds one.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Axes {
    /// M (n x n), symmetric and positive definite.
    pub inertia: DMatrix<f64>,
    /// C (n x n).
    pub damping: DMatrix<f64>,
    /// K (n x n).
    pub stiffness: DMatrix<f64>,
    /// The diagonal of G (n entries).
    pub drive: Vec<f64>,
    /// The quantity that the sensors measure.
    pub shown: Shown,
}

/// The quantities that the sensors of axes measure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Shown {
    Position,
    Velocity,
}

impl Shown {
    /// Returns its name in the file of a simulation.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Shown::Position => "position",
            Shown::Velocity => "velocity",
        }
    }
}

/// The inertia, damping and stiffness of an axis: force in V per acceleration, velocity and displacement.
pub(crate) struct Own {
    pub inertia: f64,
    pub damping: f64,
    pub stiffness: f64,
}

impl Axes {
    /// Creates a single axis with an inertia of 1, the given damping and stiffness, and a drive of 1.
    pub(crate) fn single(damping: f64, stiffness: f64, shown: Shown) -> Self {
        let one = |value| DMatrix::from_element(1, 1, value);
        Self { inertia: one(1.0), damping: one(damping), stiffness: one(stiffness), drive: vec![1.0], shown }
    }

    /// Closes the loop of each axis with a controller a_j = kp (r_j - q_j) - kd dq_j/dt. The references r_j replace
    /// the inputs. The gains are forces per motion, whatever the drive was before.
    pub(crate) fn held(mut self, gains: &[(f64, f64)]) -> Self {
        for (j, (kp, kd)) in gains.iter().enumerate() {
            self.stiffness[(j, j)] += kp;
            self.damping[(j, j)] += kd;
            self.drive[j] = *kp;
        }
        self
    }

    /// Returns the continuous model. Its states are q, dq/dt, and the outputs of the actuators with finite poles.
    pub(crate) fn model(&self, poles_hz: [f64; INPUTS]) -> StateSpace {
        let count = self.drive.len();
        let lagging: Vec<usize> = (0..count).filter(|j| poles_hz[*j].is_finite()).collect();
        let states = 2 * count + lagging.len();
        let (mut a, mut b) = (DMatrix::zeros(states, states), DMatrix::zeros(states, INPUTS));
        let mut c = DMatrix::zeros(OUTPUTS, states);
        let mobility = self.mobility();
        a.view_mut((0, count), (count, count)).fill_with_identity();
        a.view_mut((count, 0), (count, count)).copy_from(&(-&mobility * &self.stiffness));
        a.view_mut((count, count), (count, count)).copy_from(&(-&mobility * &self.damping));
        for j in 0..count {
            let pushed = mobility.column(j) * self.drive[j];
            match lagging.iter().position(|lags| *lags == j) {
                Some(lag) => {
                    let (state, pole) = (2 * count + lag, 2.0 * PI * poles_hz[j]);
                    a.view_mut((count, state), (count, 1)).copy_from(&pushed);
                    a[(state, state)] = -pole;
                    b[(state, j)] = pole;
                }
                None => b.view_mut((count, j), (count, 1)).copy_from(&pushed),
            }
            c[(j, self.shown_state(j))] = 1.0;
        }
        StateSpace { a, b, c, d: DMatrix::zeros(OUTPUTS, INPUTS) }
    }

    /// Returns each axis as a port, in a model with the given number of states.
    pub(crate) fn ports(&self, states: usize) -> Vec<StrutPort> {
        let (count, mobility) = (self.drive.len(), self.mobility());
        let row = |state: usize| (0..states).map(|i| f64::from(u8::from(i == state))).collect();
        let port = |input: usize| {
            let mut force = vec![0.0; states];
            (0..count).for_each(|i| force[count + i] = mobility[(i, input)] * self.drive[input]);
            StrutPort { input, force, displacement: row(input), velocity: row(count + input) }
        };
        (0..count).map(port).collect()
    }

    /// Returns the states of the model without actuator poles on which its outputs depend. Without a spring, a
    /// velocity does not depend on the position of its axis.
    pub(crate) fn needed_states(&self) -> Vec<usize> {
        let count = self.drive.len();
        let free = self.shown == Shown::Velocity && self.stiffness.iter().all(|k| *k == 0.0);
        (if free { count } else { 0 }..2 * count).collect()
    }

    /// Returns the inertia, damping and stiffness of an axis. The inertia is the one that a force along this axis
    /// alone meets.
    pub(crate) fn own(&self, axis: usize) -> Own {
        let at = (axis, axis);
        let drive = self.drive[axis];
        Own {
            inertia: 1.0 / (self.mobility()[at] * drive),
            damping: self.damping[at] / drive,
            stiffness: self.stiffness[at] / drive,
        }
    }

    fn mobility(&self) -> DMatrix<f64> {
        self.inertia.clone().try_inverse().expect("an inertia is positive")
    }

    fn shown_state(&self, axis: usize) -> usize {
        match self.shown {
            Shown::Position => axis,
            Shown::Velocity => self.drive.len() + axis,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Compares a slide under a controller with an integration of the slide and the controller in small steps.
    #[test]
    fn a_held_axis_moves_as_its_controller_makes_it_move() {
        let (damping, kp, kd) = (0.7, 90.0, 11.0);
        let held = Axes::single(damping, 0.0, Shown::Position).held(&[(kp, kd)]);
        let model = held.model([f64::INFINITY; INPUTS]).sampled(0.5);
        let (mut q, mut v) = (0.0, 0.0);
        let steps = 500_000;
        for _ in 0..steps {
            let force = kp * (1.0 - q) - kd * v;
            v += (force - damping * v) * 0.5 / f64::from(steps);
            q += v * 0.5 / f64::from(steps);
        }
        assert!((model.b[(0, 0)] - q).abs() < 1e-5 && (model.b[(1, 0)] - v).abs() < 1e-5, "{} for {q}", model.b);
        let own = held.own(0);
        let natural = (own.stiffness / own.inertia).sqrt();
        assert!((natural - kp.sqrt()).abs() < 1e-12);
    }

    /// With an actuator pole far above everything else, the model equals the one without a pole.
    #[test]
    fn a_fast_pole_changes_nothing() {
        let axis = Axes::single(3.0, 50.0, Shown::Velocity);
        let (without, with) = (axis.model([f64::INFINITY; INPUTS]), axis.model([1e7, f64::INFINITY, f64::INFINITY]));
        assert_eq!((without.states(), with.states()), (2, 3));
        let [without, with] = [without, with].map(|model| model.sampled(0.01));
        let gained = &with.c * &with.b - &without.c * &without.b;
        assert!(gained.amax() < 1e-5 * without.b.amax(), "{gained}");
    }

    #[test]
    fn only_what_a_velocity_depends_on_is_kept() {
        let kept = |stiffness, shown| Axes::single(1.0, stiffness, shown).needed_states();
        assert_eq!(kept(0.0, Shown::Velocity), [1]);
        assert_eq!(kept(2.0, Shown::Velocity), [0, 1]);
        assert_eq!(kept(0.0, Shown::Position), [0, 1]);
    }
}
