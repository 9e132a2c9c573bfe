use nalgebra::DVector;

use super::reciprocal::{IDENTIFIED, collocated_outputs};
use super::{Mode, Plant, Port};
use plid_fourier::C;

/// The source of the ports.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum PortSource {
    /// The simulation or the case declares them.
    Declared,
    /// The port of each input is inferred from the modes' input shapes, and the scale of each mode from reciprocity
    /// (input and output shapes of equal norm, as if sensors were near the actuators). If each actuator has a
    /// collocated sensor, the shapes of these sensors alone give the scale, and each further output has a port.
    Inferred,
    /// The port is the axis of each input, inferred from the output that measures its motion. The simulation has no
    /// lightly damped mode, or its outputs are positions and velocities, with a collocated one for each input.
    Axis,
}

/// The quantities in which the force and the motion at a port are given.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PortScale {
    /// Those of the simulation, which declares the port.
    Own,
    /// The force has the quantity of an input, the motion that of an output.
    Shown {
        /// The input.
        input: usize,
        /// The output.
        output: usize,
    },
    /// The motion has the quantity of an output. The force is such that it does the same work as an input on the axis
    /// whose motion another output measures.
    Reciprocal {
        /// The input of the axis.
        input: usize,
        /// The output that measures the motion of the axis.
        axis: usize,
        /// The output that measures the motion at the port.
        output: usize,
    },
    /// The motion is an input, as on a testing machine, and the force is an output.
    Moved {
        /// The input.
        input: usize,
        /// The output.
        output: usize,
    },
    /// The force has the quantity of an input, if the port belongs to one. The motion has no known quantity, because
    /// the modes do not determine its scale.
    Inferred(Option<usize>),
}

/// Largest relative difference of two rows that are equal up to rounding.
pub(crate) const SAME_ROW: f64 = 1e-6;

/// Infers the port of each input from the modes, and that of each further output if all inputs have collocated
/// outputs.
///
/// A mode in physical form is q" + 2 zeta w q' + w^2 q = beta f, and a sensor measures gamma q^(k); the mode's port
/// sees d = beta q. The simulation gives g = beta g0 (its input shape without the actuator's pole) and k = gamma / g0,
/// up to one number g0 for each mode. At a collocated sensor beta = gamma, which gives g0. A force at another output
/// then has beta = gamma there, too (Maxwell, Betti).
///
/// There are no ports if no output measures a motion.
pub(super) fn infer(plant: &Plant, inputs: &[String], outputs: &[String]) -> Vec<Port> {
    if !plant.shows_motion() {
        return Vec::new();
    }
    let at = collocated_outputs(plant, &IDENTIFIED);
    let modal = modal_ports(plant, at.as_deref());
    let of_input = |(i, name): (usize, &String)| {
        let scale = PortScale::Inferred(Some(i));
        Port { name: name.clone(), input: Some(i), scale, ..of_input(plant, &modal, i, &|_| true) }
    };
    let further = |o: &usize| at.as_ref().is_some_and(|at| !at.contains(o)) && plant.sensed[*o].is_motion();
    let of_output = |o: usize| Port { name: outputs[o].clone(), ..of_output(plant, &modal, o) };
    inputs.iter().enumerate().map(of_input).chain((0..plant.p).filter(further).map(of_output)).collect()
}

/// Returns a port on a single mode, for an effect that no input's port explains: the port of the input that drives this
/// mode most, restricted to this mode.
pub(super) fn of_mode(plant: &Plant, k: usize) -> Port {
    let modal = modal_ports(plant, collocated_outputs(plant, &IDENTIFIED).as_deref());
    let size = |i: usize| modal[k].force[i].norm_sqr();
    let i = (0..plant.m).max_by(|&a, &b| size(a).total_cmp(&size(b))).expect("a plant has inputs");
    of_input(plant, &modal, i, &|mode| mode == k)
}

fn modal_ports(plant: &Plant, at: Option<&[usize]>) -> Vec<ModalPorts> {
    plant.modes.iter().map(|mode| ModalPorts::new(plant, mode, at)).collect()
}

/// The shapes of forces and displacements of a mode.
struct ModalPorts {
    /// Force column of each input.
    force: Vec<C>,
    /// Shape of each output; zero if it measures no motion.
    sensed: Vec<C>,
    /// g0^2, the ratio of the force to the sensor's shape at a collocated sensor.
    square: C,
    /// 2 j times the damped frequency.
    twice: C,
}

impl ModalPorts {
    /// Determines the scale from the shapes at the inputs and at their collocated outputs, or at all outputs if there
    /// are no collocated ones.
    fn new(plant: &Plant, mode: &Mode, at: Option<&[usize]>) -> Self {
        let pole = mode.pole;
        let force: Vec<C> = (0..plant.m).map(|i| mode.b[i] / plant.chain.before(i, pole)).collect();
        // After the filter, y = gamma q^(k) has c = gamma pole^k F(pole) / (2 j Im(pole) g0).
        let twice = C::new(0.0, 2.0 * pole.im);
        let of_order = |o: usize, order: i32| mode.c[o] * twice / (pole.powi(order) * plant.chain.behind(o, pole));
        let sensed = |o: usize| plant.sensed[o].order().map_or(C::ZERO, |order| of_order(o, order));
        let sensed: Vec<C> = (0..plant.p).map(sensed).collect();
        let norm = |sum: f64| sum.sqrt().max(f64::MIN_POSITIVE);
        let shown = (0..plant.p).filter(|o| at.is_none_or(|at| at.contains(o)));
        let size = norm(force.iter().map(|g| g.norm_sqr()).sum()) / norm(shown.map(|o| sensed[o].norm_sqr()).sum());
        // The phase of g0 makes all g / g0 as nearly real as possible.
        let phase = force.iter().map(|g| g * g).sum::<C>().arg();
        Self { force, sensed, square: C::from_polar(size, phase), twice }
    }
}

/// Returns the unnamed port of an input, restricted to the modes that are kept.
fn of_input(plant: &Plant, modal: &[ModalPorts], i: usize, kept: &dyn Fn(usize) -> bool) -> Port {
    let keep = |k: usize, x: C| if kept(k) { x } else { C::ZERO };
    let shape = |(k, mode): (usize, &ModalPorts)| keep(k, mode.force[i] / (mode.square * mode.twice));
    let force = modal.iter().enumerate().map(|(k, mode)| keep(k, mode.force[i])).collect();
    let product = |k: usize, o: usize| if kept(k) { plant.product(&plant.modes[k], o, i) } else { 0.0 };
    of_shapes(plant, force, modal.iter().enumerate().map(shape).collect(), &product)
}

/// Returns the unnamed port at the motion that an output measures.
fn of_output(plant: &Plant, modal: &[ModalPorts], o: usize) -> Port {
    // The sensors' shapes give the phase of g0 without the apparent advance of the inputs.
    let shape = |mode: &ModalPorts| {
        let phase = mode.sensed.iter().map(|k| k * k).sum::<C>().arg();
        mode.sensed[o] * C::from_polar(mode.square.norm(), -phase)
    };
    let force: Vec<C> = modal.iter().map(shape).collect();
    let product = |k: usize, seen: usize| (modal[k].sensed[seen] * force[k]).re;
    of_shapes(plant, force.clone(), modal.iter().map(|mode| mode.sensed[o] / mode.twice).collect(), &product)
}

/// Returns a port from the shapes of its force and its displacement. `product` is gamma_o beta of a mode and an output.
fn of_shapes(plant: &Plant, force: Vec<C>, displacement: Vec<C>, product: &dyn Fn(usize, usize) -> f64) -> Port {
    let velocity: Vec<C> = displacement.iter().zip(&plant.modes).map(|(row, mode)| row * mode.pole).collect();
    Port {
        name: String::new(),
        input: None,
        scale: PortScale::Inferred(None),
        force,
        force_rest: through_filters(plant, product),
        displacement_rest: without_actuators(plant, &displacement),
        velocity_rest: without_actuators(plant, &velocity),
        displacement,
        velocity,
        output: at_once(plant, product),
    }
}

/// Returns the force of a port on the poles of the filters. The force passes through no actuator.
fn through_filters(plant: &Plant, product: &dyn Fn(usize, usize) -> f64) -> DVector<f64> {
    let part = |(k, mode): (usize, &Mode)| plant.filters_part(mode, &|o| product(k, o));
    plant.modes.iter().enumerate().map(part).fold(DVector::zeros(plant.rest.a.nrows()), |sum, part| sum + part)
}

/// Returns the direct response of the outputs to a force. Only accelerations without a filter have one.
fn at_once(plant: &Plant, product: &dyn Fn(usize, usize) -> f64) -> Vec<f64> {
    if !plant.understood() {
        return Vec::new();
    }
    let by_mode = |o: usize| (0..plant.modes.len()).map(move |k| product(k, o));
    (0..plant.p).map(|o| if plant.answers_at_once(o) { by_mode(o).sum() } else { 0.0 }).collect()
}

/// Returns the row of the rest's states that corrects a row of the modes' states for the actuators. A mode's state z
/// contains a part kappa_j a_j of each actuator's output that is not motion: z = z_motion + sum of kappa_j a_j, with
/// kappa_j = g_j / (pole + pole_j).
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

    /// Returns whether an output measures the displacement at a port, before its filters.
    pub fn is_shown_by(&self, port: usize, output: usize) -> bool {
        let port = &self.ports[port];
        let Some(row) = self.motion(output).and_then(|motion| motion.displacement) else { return false };
        if self.modes.is_empty() {
            same(port.displacement_rest.as_slice(), row.rest.as_slice())
        } else {
            alike(&port.displacement, &row.modes)
        }
    }

    /// Updates the ports after a change of a mode's input shapes from those of `before`. A port lies where its
    /// actuator acts, so its force on the mode and its displacement row change in the same ratio as the input shape.
    /// Otherwise, the size of an effect at the port would refer to the former shape.
    pub fn ports_follow(&mut self, k: usize, before: &Mode) {
        let after = self.modes[k].clone();
        for index in 0..self.ports.len() {
            let port = &self.ports[index];
            let Some(i) = port.input.filter(|&i| before.b[i] != C::ZERO) else { continue };
            let ratio = after.b[i] / before.b[i];
            let [displacement, velocity] = [port.displacement[k], port.velocity[k]]
                .map(|row| self.actuators_part(before, row) - self.actuators_part(&after, row * ratio));
            let filters = |mode: &Mode| self.filters_part(mode, &|o| self.product(mode, o, i));
            let filters = filters(&after) - filters(before);
            let at_once = |mode: &Mode, o: usize| if self.answers_at_once(o) { self.product(mode, o, i) } else { 0.0 };
            let more = |o: usize| at_once(&after, o) - at_once(before, o);
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

    /// Adds or subtracts the part of each port in the rest that is due to one mode: the outputs of the actuators in its
    /// rows, and its force on the poles of the filters.
    pub(super) fn pass_ports(&mut self, k: usize, sign: f64) {
        if !self.chain.known() {
            return;
        }
        for index in 0..self.ports.len() {
            let (mode, port) = (&self.modes[k], &self.ports[index]);
            let [displacement, velocity] =
                [port.displacement[k], port.velocity[k]].map(|row| self.actuators_part(mode, row) * sign);
            let force = port.force[k];
            let filters = self.filters_part(mode, &|o| self.product_at(mode, o, force)) * sign;
            let port = &mut self.ports[index];
            port.displacement_rest -= displacement;
            port.velocity_rest -= velocity;
            port.force_rest += filters;
        }
    }

    /// Returns gamma_o beta for a force that enters a mode with this factor; zero for an output that measures no
    /// motion.
    fn product_at(&self, mode: &Mode, o: usize, force: C) -> f64 {
        let Some(order) = self.sensed[o].order() else { return 0.0 };
        let passed = self.chain.behind(o, mode.pole) * mode.pole.powi(order);
        (mode.c[o] * force * C::new(0.0, 2.0 * mode.pole.im) / passed).re
    }

    /// Returns the force of a port on the poles of the filters, through one mode, from gamma_o beta for each output.
    fn filters_part(&self, mode: &Mode, product: &dyn Fn(usize) -> f64) -> DVector<f64> {
        let mut column = DVector::zeros(self.rest.a.nrows());
        for (o, filters) in self.chain.filter.iter().enumerate() {
            let Some(order) = self.sensed[o].order() else { continue };
            for (f, filter) in filters.iter().enumerate() {
                let response = Plant::derivative(order, mode.pole, filter.pole) * product(o);
                let gain = self.chain.residue(o, f) * response;
                let both = if filter.pole.im == 0.0 { 1.0 } else { 2.0 };
                column += filter.column.map(|v| both * (v * gain).re);
            }
        }
        column
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::case::record::rms;
    use crate::plant::Load;
    use crate::testing;
    use crate::testing::accelerometers::model;
    use nalgebra::dmatrix;

    fn names(plant: &Plant) -> Vec<(&str, Option<usize>)> {
        plant.ports.iter().map(|port| (port.name.as_str(), port.input)).collect()
    }

    /// A spring at the port of the second mass changes the poles and the response as a spring in the matrices does.
    #[test]
    fn a_force_at_a_further_accelerometer_follows_from_reciprocity() {
        let mut plant = Plant::new(&model(0.0, 0.0)).unwrap();
        assert_eq!((plant.modes.len(), plant.port_source), (2, PortSource::Inferred));
        assert_eq!(names(&plant), [("u1", Some(0)), ("y2", None)]);
        plant.load(1, &Load { stiffness: 700.0, ..Default::default() });
        let expected = Plant::new(&model(700.0, 0.0)).unwrap();
        for hz in [3.0, 9.0, 14.0, 40.0] {
            let [found, right] = [&plant, &expected].map(|plant| plant.response(hz));
            assert!((&found - &right).norm() < 1e-3 * right.norm(), "{hz} Hz: {found} for {right}");
        }
    }

    /// The ports of a plant whose mode is moved are those of a structure that is built so. The mode is near the poles
    /// of the actuators. A slow command shows the outputs of the actuators in the velocities, which are small then, and
    /// the response to a force shows what passes the filters.
    #[test]
    fn ports_move_with_their_mode() {
        const MODE: usize = 3;
        let truss = |factor: f64| {
            let model = testing::truss_with(1, |modes, beta, _| {
                modes[MODE].0 *= factor;
                beta.row_mut(MODE).fill(2.0);
            });
            Plant::new(&model).unwrap()
        };
        let (mut moved, built) = (truss(1.0), truss(1.03));
        moved.move_pole(MODE, moved.modes[MODE].pole * 1.03);
        let turn = std::f64::consts::TAU * 10.0 / testing::RATE;
        let slow: Vec<f64> = (0..800).map(|n| (turn * f64::from(n)).sin()).collect();
        let u = [slow.clone(), slow];
        let [found, right] = [&moved, &built].map(|plant| crate::prepare::port_motion(plant, &u));
        for (k, (found, right)) in found.iter().zip(&right).enumerate() {
            let difference: Vec<f64> = found.iter().zip(right).map(|(found, right)| found - right).collect();
            let far = rms(&difference) / rms(right);
            assert!(far < 1e-4, "{} of port {}: {far}", ["displacement", "velocity"][k % 2], k / 2);
        }
        for (port, hz) in [0, 1].into_iter().flat_map(|port| [20.0, 240.0, 700.0].map(|hz| (port, hz))) {
            let [found, right] = [&moved, &built].map(|plant| plant.port_response(port, hz));
            assert!((&found - &right).norm() < 1e-3 * right.norm(), "port {port}, {hz} Hz: {found} for {right}");
        }
    }

    /// In a model that was identified from records, inputs seem to act half a sample early. The port of the second
    /// mass is the same: a force there causes the same displacement, mode by mode. Without the sensor on the first
    /// mass, there is no such port.
    #[test]
    fn inputs_that_seem_to_come_early_leave_the_port_of_a_sensor() {
        let compliance = |plant: &Plant| -> Vec<C> {
            let port = &plant.ports[1];
            port.force.iter().zip(&port.displacement).map(|(force, row)| force * row).collect()
        };
        let [exact, early] = [0.0, 1e-3].map(|early_s| Plant::new(&model(0.0, early_s)).unwrap());
        assert_eq!(names(&early), [("u1", Some(0)), ("y2", None)]);
        for (found, right) in compliance(&early).iter().zip(compliance(&exact)) {
            assert!((found - right).norm() < 1e-2 * right.norm(), "{found} for {right}");
        }
        // The outputs are the motion of the second mass, and its motion relative to the first.
        let mut alone = model(0.0, 0.0);
        let shown = dmatrix![0.0, 1.0; -1.0, 1.0];
        (alone.c, alone.d) = (&shown * &alone.c, &shown * &alone.d);
        assert_eq!(names(&Plant::new(&alone).unwrap()), [("u1", Some(0))]);
    }
}
