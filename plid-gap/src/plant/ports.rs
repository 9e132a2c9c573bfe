use nalgebra::DVector;

use super::{Mode, Plant, Port};
use plid_fourier::C;

/// The source of the ports.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum PortSource {
    /// The simulation or the case declares them.
    Declared,
    /// The port of each input, from the modes' input shapes; the scale of each mode by reciprocity (input and output
    /// shapes of equal norm, as if sensors were near the actuators).
    Inferred,
    /// The axis of each input, from the output that shows its motion, because the simulation has no lightly damped
    /// mode.
    Axis,
}

/// The quantities in which the force and the motion at a port are given.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PortScale {
    /// Those of the simulation, which declares the port.
    Own,
    /// The force in that of an input, the motion in that of an output.
    Shown {
        /// The input.
        input: usize,
        /// The output.
        output: usize,
    },
    /// The motion in that of an output, and the force such that it does the same work as an input on the axis that
    /// another output shows.
    Reciprocal {
        /// The input of the axis.
        input: usize,
        /// The output that shows the motion of the axis.
        axis: usize,
        /// The output that shows the motion at the port.
        output: usize,
    },
    /// The motion is an input, as on a testing machine, and the force is an output.
    Moved {
        /// The input.
        input: usize,
        /// The output.
        output: usize,
    },
    /// The force in that of an input, if it is that of one; the motion in none, because the modes leave its scale open.
    Inferred(Option<usize>),
}

/// Largest relative difference of two rows that are one row but for rounding.
pub(crate) const SAME_ROW: f64 = 1e-6;

/// Infers the port of each input from the modes.
///
/// A mode in physical form is q" + 2 zeta w q' + w^2 q = beta f, and a sensor measures gamma q^(k); the mode's port
/// sees d = beta q. The simulation gives g = beta g0 (its input shape without the actuator's pole) and k = gamma / g0,
/// up to one number g0 for each mode.
pub(super) fn infer(plant: &Plant, inputs: &[String]) -> Vec<Port> {
    let modal = modal_ports(plant);
    let port = |(i, name): (usize, &String)| {
        let scale = PortScale::Inferred(Some(i));
        Port { name: name.clone(), input: Some(i), scale, ..port(plant, &modal, i, &|_| true) }
    };
    inputs.iter().enumerate().map(port).collect()
}

/// Returns a port on a single mode, for an effect that no input's port explains: the port of the input that drives this
/// mode most, restricted to this mode.
pub(super) fn of_mode(plant: &Plant, k: usize) -> Port {
    let modal = modal_ports(plant);
    let size = |i: usize| modal[k].0[i].norm_sqr();
    let i = (0..plant.m).max_by(|&a, &b| size(a).total_cmp(&size(b))).expect("a plant has inputs");
    port(plant, &modal, i, &|mode| mode == k)
}

/// Force columns and displacement rows of all ports, for each mode.
type ModalPorts = Vec<(Vec<C>, Vec<C>)>;

fn modal_ports(plant: &Plant) -> ModalPorts {
    plant.modes.iter().map(|mode| modal_port(plant, mode)).collect()
}

/// Returns the port of an input, restricted to the modes that are kept, without a name.
fn port(plant: &Plant, modal: &ModalPorts, i: usize, kept: &dyn Fn(usize) -> bool) -> Port {
    let keep = |k: usize, x: C| if kept(k) { x } else { C::ZERO };
    let displacement: Vec<C> = modal.iter().enumerate().map(|(k, (_, row))| keep(k, row[i])).collect();
    let velocity: Vec<C> = displacement.iter().zip(&plant.modes).map(|(row, mode)| row * mode.pole).collect();
    Port {
        name: String::new(),
        input: None,
        scale: PortScale::Inferred(None),
        force: modal.iter().enumerate().map(|(k, (force, _))| keep(k, force[i])).collect(),
        force_rest: through_filters(plant, i, kept),
        displacement_rest: without_actuators(plant, &displacement),
        velocity_rest: without_actuators(plant, &velocity),
        displacement,
        velocity,
        output: at_once(plant, i, kept),
    }
}

/// Returns the force of a port on the poles of the filters. It passes no actuator.
fn through_filters(plant: &Plant, i: usize, kept: &dyn Fn(usize) -> bool) -> DVector<f64> {
    let modes = plant.modes.iter().enumerate().filter(|(k, _)| kept(*k));
    modes.fold(DVector::zeros(plant.rest.a.nrows()), |sum, (_, mode)| sum + plant.filters_part(mode, i))
}

/// Returns the direct response to a force, which accelerations without a filter have.
fn at_once(plant: &Plant, i: usize, kept: &dyn Fn(usize) -> bool) -> Vec<f64> {
    if !plant.understood() {
        return Vec::new();
    }
    let modes = || plant.modes.iter().enumerate().filter(|(k, _)| kept(*k));
    (0..plant.p).map(|o| modes().map(|(_, mode)| plant.at_once_part(mode, o, i)).sum()).collect()
}

/// A mode's state z contains a part kappa_j a_j of each actuator's output that is not motion: z = z_motion + sum of
/// kappa_j a_j with kappa_j = g_j / (pole + pole_j).
fn without_actuators(plant: &Plant, row: &[C]) -> DVector<f64> {
    let parts = plant.modes.iter().zip(row).map(|(mode, &row)| plant.actuators_part(mode, row));
    -parts.fold(DVector::zeros(plant.rest.a.nrows()), |sum, part| sum + part)
}

impl Plant {
    /// Returns whether a force at a port acts as an input does after its actuator.
    pub fn is_pushed_by(&self, port: usize, input: usize) -> bool {
        let (force, rest, _) = self.entry(input);
        let port = &self.ports[port];
        if self.modes.is_empty() {
            same(port.force_rest.as_slice(), rest.as_slice())
        } else {
            alike(&port.force, &force)
        }
    }

    /// Returns whether an output shows the displacement at a port, before its filters.
    pub fn is_shown_by(&self, port: usize, output: usize) -> bool {
        let port = &self.ports[port];
        let Some(row) = self.motion(output).and_then(|motion| motion.displacement) else { return false };
        if self.modes.is_empty() {
            same(port.displacement_rest.as_slice(), row.rest.as_slice())
        } else {
            alike(&port.displacement, &row.modes)
        }
    }

    /// Changes the ports with a mode's input shapes. A port lies where its actuator pushes. If the input shape of a
    /// mode was changed from that of `before`, the force of the port on the mode and its displacement row change in the
    /// same ratio. Otherwise the size of an effect there would belong to the former shape.
    pub fn ports_follow(&mut self, k: usize, before: &Mode) {
        let after = self.modes[k].clone();
        for index in 0..self.ports.len() {
            let port = &self.ports[index];
            let Some(i) = port.input.filter(|&i| before.b[i] != C::ZERO) else { continue };
            let ratio = after.b[i] / before.b[i];
            let [displacement, velocity] = [port.displacement[k], port.velocity[k]]
                .map(|row| self.actuators_part(before, row) - self.actuators_part(&after, row * ratio));
            let filters = self.filters_part(&after, i) - self.filters_part(before, i);
            let more = |o: usize| self.at_once_part(&after, o, i) - self.at_once_part(before, o, i);
            let output: Vec<f64> = port.output.iter().enumerate().map(|(o, now)| now + more(o)).collect();
            let port = &mut self.ports[index];
            for row in [&mut port.force, &mut port.displacement, &mut port.velocity] {
                row[k] *= ratio;
            }
            port.displacement_rest += displacement;
            port.velocity_rest += velocity;
            port.force_rest += filters;
            port.output = output;
        }
    }

    /// Returns the force of an input's port on the poles of the filters, through one mode.
    fn filters_part(&self, mode: &Mode, i: usize) -> DVector<f64> {
        let mut column = DVector::zeros(self.rest.a.nrows());
        for (o, filters) in self.chain.filter.iter().enumerate() {
            for (f, filter) in filters.iter().enumerate() {
                let order = self.sensed[o].order;
                let response = Plant::derivative(order, mode.pole, filter.pole) * self.product(mode, o, i);
                let gain = self.chain.residue(o, f) * response;
                let both = if filter.pole.im == 0.0 { 1.0 } else { 2.0 };
                column += filter.column.map(|v| both * (v * gain).re);
            }
        }
        column
    }

    /// Returns the direct response of an output to such a force through one mode.
    fn at_once_part(&self, mode: &Mode, o: usize, i: usize) -> f64 {
        if self.answers_at_once(o) { self.product(mode, o, i) } else { 0.0 }
    }

    /// Returns the part of a row on a mode's state that is not motion: kappa_j a_j of each actuator's output, as a row
    /// of the rest's states.
    fn actuators_part(&self, mode: &Mode, row: C) -> DVector<f64> {
        let mut seen = DVector::zeros(self.rest.a.nrows());
        for (j, actuator) in self.chain.actuator.iter().enumerate() {
            let Some(actuator) = actuator else { continue };
            let kappa = mode.b[j] / self.chain.before(j, mode.pole) / (mode.pole + actuator.pole);
            seen += &actuator.row * (2.0 * (row * kappa).re);
        }
        seen
    }
}

fn alike(a: &[C], b: &[C]) -> bool {
    let parts = |x: &[C]| -> Vec<f64> { x.iter().flat_map(|x| [x.re, x.im]).collect() };
    same(&parts(a), &parts(b))
}

fn same(a: &[f64], b: &[f64]) -> bool {
    let square = |x: &mut dyn Iterator<Item = f64>| x.map(|x| x * x).sum::<f64>();
    let far = square(&mut a.iter().zip(b).map(|(a, b)| a - b));
    a.len() == b.len() && far.sqrt() <= SAME_ROW * square(&mut a.iter().copied()).sqrt()
}

/// Returns the force columns and displacement rows of all ports on one mode.
fn modal_port(plant: &Plant, mode: &Mode) -> (Vec<C>, Vec<C>) {
    let pole = mode.pole;
    let force: Vec<C> = (0..plant.m).map(|i| mode.b[i] / plant.chain.before(i, pole)).collect();
    // After the filter, y = gamma q^(k) has c = gamma pole^k F(pole) / (2 j Im(pole) g0).
    let twice = C::new(0.0, 2.0 * pole.im);
    let sensed =
        (0..plant.p).map(|o| mode.c[o] * twice / (pole.powi(plant.sensed[o].order) * plant.chain.behind(o, pole)));
    let norm = |sum: f64| sum.sqrt().max(f64::MIN_POSITIVE);
    let size = norm(force.iter().map(|g| g.norm_sqr()).sum()) / norm(sensed.map(|k| k.norm_sqr()).sum());
    // The phase of g0 makes all of g / g0 as nearly real as possible.
    let phase = force.iter().map(|g| g * g).sum::<C>().arg();
    let square = C::from_polar(size, phase);
    let row = force.iter().map(|g| g / (square * twice)).collect();
    (force, row)
}
