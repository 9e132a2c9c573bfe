use super::{KindSource, Plant, Sensed};
use plid_fourier::C;
use plid_model::OutputKind;

impl Plant {
    /// Returns the same plant with the forces at these ports as further outputs, after its own. A controller does not
    /// read these outputs.
    pub(crate) fn showing_forces(&self, ports: &[usize]) -> Self {
        let mut shown = self.clone();
        shown.p += ports.len();
        shown.modes.iter_mut().for_each(|mode| mode.c.resize(shown.p, C::ZERO));
        shown.rest.c.resize_vertically_mut(shown.p, 0.0);
        shown.d.resize_vertically_mut(shown.p, 0.0);
        shown.sensed.resize(shown.p, Sensed { kind: OutputKind::Position, source: KindSource::Declared });
        shown.chain.filter.resize(shown.p, Vec::new());
        shown.ports.iter_mut().for_each(|port| port.output.resize(shown.p, 0.0));
        for (k, port) in ports.iter().enumerate() {
            shown.ports[*port].output[self.p + k] = 1.0;
        }
        shown
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::{CubicStiffness, Effect, Place, Setting};
    use crate::simulate::{Fineness, simulate};
    use crate::testing;

    /// The force of a cubic spring follows from the displacement at its port, and the plant's own outputs stay.
    #[test]
    fn the_force_at_a_port_is_an_output() {
        let model = testing::truss(1);
        let plant = Plant::new(&model).unwrap();
        let actions = CubicStiffness.act(&Setting::bare(&plant, &model), &Place::Port(1), &[2.0]);
        let u = testing::random_input(4, 400, plant.m);
        let run = |plant: &Plant| simulate(plant, &actions, &u, 0.0, None, Fineness::FINE);
        let mut shown = plant.showing_forces(&[1]);
        let (own, with_force) = (run(&plant), run(&shown));
        assert_eq!(own, with_force[..plant.p]);
        // A further output measures the displacement.
        shown.p += 1;
        let port = shown.ports[1].clone();
        shown.modes.iter_mut().zip(&port.displacement).for_each(|(mode, row)| mode.c.push(*row));
        shown.rest.c.resize_vertically_mut(shown.p, 0.0);
        shown.rest.c.row_mut(plant.p + 1).copy_from(&port.displacement_rest.transpose());
        shown.d.resize_vertically_mut(shown.p, 0.0);
        shown.sensed.push(Sensed { kind: OutputKind::Position, source: KindSource::Declared });
        shown.ports.iter_mut().for_each(|port| port.output.push(0.0));
        let seen = run(&shown);
        let (force, d) = (&seen[plant.p], &seen[plant.p + 1]);
        let most = force.iter().fold(0.0_f64, |most, f| most.max(f.abs()));
        assert!(most > 0.0);
        assert!(force.iter().zip(d).all(|(f, d)| (f + 2.0 * d.powi(3)).abs() < 1e-12 * most));
    }
}
