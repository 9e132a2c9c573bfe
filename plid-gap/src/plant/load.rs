use nalgebra::{DMatrix, DVector};

use super::{Mode, NonModal, Plant, Port, SignalChain, put_pair, put_rotation};
use plid_fourier::C;

/// A linear force at a port: f = -k d - c v - m dv/dt. Each number is in the units of the port and may be negative.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Load {
    /// k, force over displacement.
    pub stiffness: f64,
    /// c, force over velocity.
    pub damping: f64,
    /// m, force over acceleration.
    pub mass: f64,
}

impl Load {
    /// Least share of its inertia that a port keeps, however much a fit removes.
    pub const LEAST_INERTIA: f64 = 0.05;
}

/// Ratio of the acceleration at a port to the product of force and velocity rows below which it is a rounding error of
/// the matrix logarithm.
const ROUNDING: f64 = 1e-6;

impl Port {
    /// Returns the rate at which a unit force at the port changes the value of a row of the states.
    pub(super) fn at_once(&self, modes: &[C], rest: &DVector<f64>) -> f64 {
        let modes: f64 = modes.iter().zip(&self.force).map(|(row, force)| 2.0 * (row * force).re).sum();
        modes + rest.dot(&self.force_rest)
    }
}

impl Plant {
    /// Returns the acceleration that a unit force causes at a port at once, which is one over the inertia there. Zero
    /// if the force first passes through another state, such as the lag of a torque.
    pub fn mobility(&self, port: usize) -> f64 {
        let port = &self.ports[port];
        let at_once = port.at_once(&port.velocity, &port.velocity_rest);
        let modes: f64 = port.velocity.iter().zip(&port.force).map(|(row, force)| (row * force).norm()).sum();
        let rest = port.velocity_rest.norm() * port.force_rest.norm();
        if at_once.abs() > ROUNDING * (modes + rest) { at_once } else { 0.0 }
    }

    /// Returns the viscous damper between the port and the outside, in force over velocity. With v' = ... - c v / m at
    /// the port, a unit force changes v' at a rate of -c / m^2. Zero if a force does not accelerate the port at once.
    pub fn damper(&self, port: usize) -> f64 {
        let mobility = self.mobility(port);
        let Some((a, _)) = self.rest.continuous.as_ref().filter(|_| mobility > 0.0) else { return 0.0 };
        let port = &self.ports[port];
        let parts = port.velocity.iter().zip(&port.force).zip(&self.modes);
        let modes: f64 = parts.map(|((v, f), mode)| 2.0 * (v * mode.pole * f).re).sum();
        -(modes + port.velocity_rest.dot(&(a * &port.force_rest))) / mobility.powi(2)
    }

    /// Adds a linear force at a port. The result is exact for a mass of any size, because force and acceleration,
    /// which depend on each other, are solved for together. The force couples the modes, so all states are then in
    /// one block. Nothing changes without a continuous form of the rest.
    pub fn load(&mut self, number: usize, load: &Load) {
        if self.rest.continuous.is_none() {
            return;
        }
        self.couple();
        let Some((a, b)) = self.rest.continuous.take() else { return };
        let (force, at_once) = (self.ports[number].force_rest.clone(), self.ports[number].output.clone());
        let (row, velocity) = {
            let port = &self.ports[number];
            let accelerations = a.tr_mul(&port.velocity_rest);
            let row = &port.displacement_rest * load.stiffness
                + &port.velocity_rest * load.damping
                + accelerations * load.mass;
            (row, port.velocity_rest.clone())
        };
        let carries = (1.0 + load.mass * velocity.dot(&force)).max(Load::LEAST_INERTIA);
        let row = row / -carries;
        // The force is row . x + gain u for each input, and likewise for each further force.
        let gain = |column: &DVector<f64>| -load.mass * velocity.dot(column) / carries;
        let at_once = DVector::from_fn(self.p, |o, _| at_once.get(o).copied().unwrap_or(0.0));
        let gains = DVector::from_iterator(self.m, b.column_iter().map(|column| gain(&column.into_owned())));
        for port in &mut self.ports {
            let gain = gain(&port.force_rest);
            port.force_rest += &force * gain;
            if gain != 0.0 && at_once.norm() > 0.0 {
                let before = DVector::from_fn(self.p, |o, _| port.output.get(o).copied().unwrap_or(0.0));
                port.output = (before + &at_once * gain).iter().copied().collect();
            }
        }
        self.d += &at_once * gains.transpose();
        let c = &self.rest.c + &at_once * row.transpose();
        self.rest = held(a + &force * row.transpose(), b + &force * gains.transpose(), c, 1.0 / self.rate);
    }

    /// Moves all states into the rest: (Re z, Im z) of each mode, then the others.
    pub(super) fn couple(&mut self) {
        let (q, r) = (self.modes.len(), self.rest.a.nrows());
        let Some((a_rest, b_rest)) = self.rest.continuous.clone().filter(|_| q > 0) else { return };
        let n = 2 * q + r;
        let (mut a, mut b, mut c) = (DMatrix::zeros(n, n), DMatrix::zeros(n, self.m), DMatrix::zeros(self.p, n));
        for (k, Mode { pole, b: shape, c: seen }) in self.modes.iter().enumerate() {
            put_rotation(&mut a, 2 * k, *pole);
            shape.iter().enumerate().for_each(|(i, b_i)| put_pair(&mut b, 2 * k, i, *b_i));
            for (o, seen) in seen.iter().enumerate() {
                (c[(o, 2 * k)], c[(o, 2 * k + 1)]) = (2.0 * seen.re, -2.0 * seen.im);
            }
        }
        a.view_mut((2 * q, 2 * q), (r, r)).copy_from(&a_rest);
        b.rows_mut(2 * q, r).copy_from(&b_rest);
        c.columns_mut(2 * q, r).copy_from(&self.rest.c);
        for port in &mut self.ports {
            let column = |modal: &[C], rest: &DVector<f64>, of: fn(C) -> [f64; 2]| {
                let all: Vec<f64> = modal.iter().flat_map(|x| of(*x)).chain(rest.iter().copied()).collect();
                DVector::from_vec(all)
            };
            let row: fn(C) -> [f64; 2] = |x| [2.0 * x.re, -2.0 * x.im];
            port.force_rest = column(&port.force, &port.force_rest, |x| [x.re, x.im]);
            port.displacement_rest = column(&port.displacement, &port.displacement_rest, row);
            port.velocity_rest = column(&port.velocity, &port.velocity_rest, row);
            (port.force, port.displacement, port.velocity) = (Vec::new(), Vec::new(), Vec::new());
        }
        self.modes.clear();
        self.chain = SignalChain { actuator: vec![None; self.m], filter: vec![Vec::new(); self.p] };
        self.rest = held(a, b, c, 1.0 / self.rate);
    }
}

/// Returns a block of states with inputs that are held over a step.
pub(super) fn held(a: DMatrix<f64>, b: DMatrix<f64>, c: DMatrix<f64>, step: f64) -> NonModal {
    let (over, entered) = plid_model::held(&a, &b, step);
    NonModal { a: over, b: entered, c, continuous: Some((a, b)) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plant::CasePort;
    use nalgebra::dmatrix;
    use plid_model::{Model, OutputKind};

    /// A mass on a damper and a spring, whose position, velocity or acceleration is measured at 500 Hz, with a port
    /// at the mass.
    fn servo([m, c, k]: [f64; 3], kind: OutputKind) -> Plant {
        let (a, b) = (dmatrix![0.0, 1.0; -k / m, -c / m], dmatrix![0.0; 1.0 / m]);
        let (seen, direct) = match kind {
            OutputKind::Position => (dmatrix![1.0, 0.0], 0.0),
            OutputKind::Velocity => (dmatrix![0.0, 1.0], 0.0),
            _ => (dmatrix![-k / m, -c / m], 1.0 / m),
        };
        let (a, b) = crate::testing::held(&a, &b, 2e-3);
        let mut model = Model::new(500.0, a, b, seen, dmatrix![direct]).unwrap();
        model.output_kinds = vec![Some(kind)];
        let mut plant = Plant::new(&model).unwrap();
        plant.declare(&[CasePort { name: "axis".into(), input: 0, output: 0 }]).unwrap();
        plant
    }

    fn far(one: &Plant, other: &Plant) -> f64 {
        let difference = |hz: &f64| (one.response(*hz) - other.response(*hz)).norm() / other.response(*hz).norm();
        [0.1, 1.0, 5.0, 50.0, 200.0].iter().map(difference).fold(0.0, f64::max)
    }

    const KINDS: [OutputKind; 3] = [OutputKind::Position, OutputKind::Velocity, OutputKind::Acceleration];

    /// The loads are a mass that is several times the plant's own, a mass that is taken away, a damper and a spring.
    /// In each case, the response is that of a servo that is built with the load, lightly damped or not.
    #[test]
    fn a_loaded_servo_is_a_servo_built_so() {
        for own in [[2.0, 60.0, 1800.0], [2.0, 6.0, 1800.0]] {
            for kind in KINDS {
                for load in [[6.0, 0.0, 0.0], [-1.5, 0.0, 0.0], [0.0, 40.0, 0.0], [0.0, 0.0, -900.0], [1.0, 9.0, 700.0]]
                {
                    let mut loaded = servo(own, kind);
                    loaded.load(0, &Load { mass: load[0], damping: load[1], stiffness: load[2] });
                    let built = servo(std::array::from_fn(|j| own[j] + load[j]), kind);
                    assert!(far(&loaded, &built) < 1e-6, "{own:?} {kind:?} {load:?}: {}", far(&loaded, &built));
                    // A further force there acts on the changed mass.
                    assert!((loaded.mobility(0) * (own[0] + load[0]) - 1.0).abs() < 1e-6, "{kind:?} {load:?}");
                }
            }
        }
    }

    #[test]
    fn a_port_knows_its_inertia_and_its_damper() {
        for kind in KINDS {
            for own in [[2.0, 60.0, 1800.0], [2.0, 6.0, 1800.0]] {
                let plant = servo(own, kind);
                let found = [plant.mobility(0).recip(), plant.damper(0), plant.stiffness(&plant.ports[0])];
                let right = found.iter().zip(&own).all(|(found, own)| (found / own - 1.0).abs() < 1e-5);
                assert!(right, "{kind:?}: {found:?} for {own:?}");
            }
        }
    }

    #[test]
    fn no_fit_takes_all_of_the_inertia() {
        let mut plant = servo([2.0, 60.0, 1800.0], OutputKind::Position);
        plant.load(0, &Load { mass: -5.0, ..Load::default() });
        assert!(plant.mobility(0) > 0.0 && plant.mobility(0).is_finite());
    }
}
