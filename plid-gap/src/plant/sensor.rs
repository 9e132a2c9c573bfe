//! A plant with one more sensor, at a port.

use nalgebra::DVector;

use plid_model::OutputKind;

use super::{KindSource, Plant, Sensed};

impl Plant {
    /// Returns the plant with one more output, the displacement at a port, or the velocity if no displacement is known
    /// there. The sensor has no filter.
    pub(crate) fn with_sensor(&self, port: usize) -> Self {
        let mut more = self.clone();
        let at = &self.ports[port];
        let (kind, modes, rest) = if at.sees_displacement() {
            (OutputKind::Position, &at.displacement, &at.displacement_rest)
        } else {
            (OutputKind::Velocity, &at.velocity, &at.velocity_rest)
        };
        more.modes.iter_mut().zip(modes).for_each(|(mode, row)| mode.c.push(*row));
        more.rest.c = more.rest.c.insert_row(self.p, 0.0);
        more.rest.c.row_mut(self.p).copy_from(&rest.transpose());
        more.d = more.d.insert_row(self.p, 0.0);
        more.sensed.push(Sensed { kind, source: KindSource::Declared });
        more.chain.filter.push(Vec::new());
        // A force changes no displacement or velocity at once.
        more.ports.iter_mut().filter(|port| !port.output.is_empty()).for_each(|port| port.output.push(0.0));
        more.p += 1;
        more
    }

    /// Returns whether a sensor at a port would measure a motion that no output measures yet. Only ports that the
    /// simulation declares are considered.
    pub(crate) fn lacks_sensor(&self, port: usize) -> bool {
        matches!(self.ports[port].scale, super::PortScale::Own)
            && self.rest.continuous.is_some()
            && !(0..self.p).any(|output| self.shows_motion_at(port, output))
    }

    /// Returns whether an output measures the motion at a port, in any unit.
    fn shows_motion_at(&self, port: usize, output: usize) -> bool {
        let Some(motion) = self.motion(output) else { return false };
        let port = &self.ports[port];
        let parts = |modes: &[plid_fourier::C], rest: &DVector<f64>| {
            DVector::from_iterator(
                2 * modes.len() + rest.len(),
                modes.iter().flat_map(|x| [x.re, x.im]).chain(rest.iter().copied()),
            )
        };
        let (own, shown) =
            (parts(&port.velocity, &port.velocity_rest), parts(&motion.velocity.modes, &motion.velocity.rest));
        // The sine of the angle between the rows.
        let along = own.dot(&shown) / (own.norm() * shown.norm());
        1.0 - along * along < SAME_DIRECTION
    }
}

/// Largest squared sine of the angle between two rows of the same motion: a deviation by one part in a thousand of a
/// shape.
const SAME_DIRECTION: f64 = 1e-6;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulate::{Fineness, simulate};
    use crate::testing::{random_input, run, truss};
    use plid_model::Model;

    /// The new output is the displacement row of the port times the states of the simulation.
    #[test]
    fn a_sensor_at_a_port_shows_its_displacement() {
        let model = truss(1);
        let plant = Plant::new(&model).unwrap();
        assert!(plant.lacks_sensor(1));
        let more = plant.with_sensor(1);
        let u = random_input(5, 400, 2);
        let y = simulate(&more, &[], &u, 0.0, None, Fineness::FINE);
        let row = nalgebra::DMatrix::from_row_slice(1, model.n(), &model.ports[1].displacement);
        let shown = Model { c: row, d: nalgebra::DMatrix::zeros(1, 2), outputs: vec!["d".into()], ..model };
        let shown = Model { output_kinds: vec![None], ports: Vec::new(), ..shown };
        let expected = run(&shown, &u);
        let size = crate::case::record::rms(&expected[0]);
        let far = y[2].iter().zip(&expected[0]).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(y.len() == 3 && far < 1e-6 * size, "{far} of {size}");
        // The port with the new sensor no longer lacks one.
        assert!(!more.lacks_sensor(1) && more.lacks_sensor(0));
    }
}
