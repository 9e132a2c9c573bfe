//! States that no output depends on: a displacement that is only the integral of a measured velocity.
//!
//! The position of a motor is no combination of its speed and its current. If the speed is measured, the position is
//! a further state, which only a force that depends on it can show. Such states are the last ones of the rest. They
//! influence neither the outputs nor the other states, so they have no part in responses, poles and gains.

use nalgebra::DVector;

use super::{NonModal, Plant, Port, SAME_ROW};

impl NonModal {
    /// Returns the number of leading states, up to the last one on which an output or an earlier state depends.
    pub(crate) fn seen(&self) -> usize {
        let is_zero = |x: &f64| *x == 0.0;
        let unseen =
            |j: &usize| self.c.column(*j).iter().all(is_zero) && self.a.view((0, *j), (*j, 1)).iter().all(is_zero);
        self.a.nrows() - (0..self.a.nrows()).rev().take_while(unseen).count()
    }

    /// Returns the block of these states by itself.
    pub(super) fn leading(&self) -> Self {
        let (seen, m) = (self.seen(), self.b.ncols());
        Self {
            a: self.a.view((0, 0), (seen, seen)).into_owned(),
            b: self.b.rows(0, seen).into_owned(),
            c: self.c.columns(0, seen).into_owned(),
            continuous: self
                .continuous
                .as_ref()
                .map(|(a, b)| (a.view((0, 0), (seen, seen)).into_owned(), b.view((0, 0), (seen, m)).into_owned())),
        }
    }

    /// Computes the change over a step of the states from `first` on, from their equations in continuous time.
    pub(super) fn renew_from(&mut self, first: usize, step: f64) {
        let last = self.a.nrows() - first;
        let Some((a, b)) = self.continuous.as_ref().filter(|_| last > 0) else { return };
        let (over, entered) = plid_model::held(a, b, step);
        self.a.rows_mut(first, last).copy_from(&over.rows(first, last));
        self.b.rows_mut(first, last).copy_from(&entered.rows(first, last));
    }
}

impl Plant {
    /// Adds the displacement of an output to the states if the output shows a velocity whose integral is not a
    /// combination of the states. The displacement is measured from its initial value. Nothing changes in a plant with
    /// modes.
    pub(super) fn integrate(&mut self, output: usize) {
        let shown = if self.modes.is_empty() { self.motion(output) } else { None };
        let Some(velocity) = shown.filter(|motion| motion.displacement.is_none()).map(|motion| motion.velocity.rest)
        else {
            return;
        };
        let (r, size) = (velocity.len(), velocity.norm());
        let Some((a, b)) = self.rest.continuous.take() else { return };
        // The unit of the state is such that its equation is as large as the others.
        let scale = if a.norm() > 0.0 && size > 0.0 { a.norm() / size } else { 1.0 };
        let mut a = a.insert_row(r, 0.0).insert_column(r, 0.0);
        a.view_mut((r, 0), (1, r)).copy_from(&(velocity.transpose() * scale));
        let rest = &mut self.rest;
        rest.a = std::mem::take(&mut rest.a).insert_row(r, 0.0).insert_column(r, 0.0);
        rest.b = std::mem::take(&mut rest.b).insert_row(r, 0.0);
        rest.c = std::mem::take(&mut rest.c).insert_column(r, 0.0);
        rest.continuous = Some((a, b.insert_row(r, 0.0)));
        rest.renew_from(r, 1.0 / self.rate);
        for port in &mut self.ports {
            for of in [&mut port.force_rest, &mut port.displacement_rest, &mut port.velocity_rest] {
                *of = std::mem::take(of).insert_row(r, 0.0);
            }
        }
        self.chain.resize(r + 1);
    }

    /// Returns whether the displacement at a port is only the integral of its velocity: a state that nothing depends
    /// on, and whose initial value no output shows.
    pub(crate) fn integrates(&self, port: &Port) -> bool {
        let row: &DVector<f64> = &port.displacement_rest;
        let seen = self.rest.seen().min(row.len());
        row.rows(seen, row.len() - seen).norm() > SAME_ROW * row.norm()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::{Action, Load};
    use crate::plant::{CasePort, Spectrum};
    use crate::simulate::{Fineness, simulate};
    use crate::testing::{held, random_input};
    use nalgebra::{DMatrix, dmatrix};
    use plid_model::{Model, OutputKind};

    const RATE: f64 = 250.0;

    /// Returns a motor of mass 2 with this damper, whose speed is measured, and whether the speed is declared as such.
    fn motor(damper: f64, declared: bool) -> Model {
        let (a, b) = held(&dmatrix![-damper / 2.0], &dmatrix![0.5], 1.0 / RATE);
        let mut model = Model::new(RATE, a, b, dmatrix![1.0], dmatrix![0.0]).unwrap();
        model.output_kinds = vec![declared.then_some(OutputKind::Velocity)];
        model
    }

    fn run(plant: &Plant, actions: &[Action], u: &[Vec<f64>]) -> Vec<f64> {
        simulate(plant, actions, u, 0.0, None, Fineness::FINE).swap_remove(0)
    }

    fn is_near(found: &[f64], expected: &[f64], tolerance: f64) {
        let size = expected.iter().map(|x| x.abs()).fold(0.0, f64::max);
        let far = found.iter().zip(expected).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(found.len() == expected.len() && far <= tolerance * size, "{far} of {size}");
    }

    /// Without effects, nothing changes: neither runs nor responses, even at zero frequency, nor poles and gains. A
    /// mass without a damper is an integrator itself.
    #[test]
    fn no_output_shows_the_integral_of_its_velocity() {
        let u = random_input(3, 500, 1);
        for damper in [3.0, 0.0] {
            let [bare, more] = [false, true].map(|declared| Plant::new(&motor(damper, declared)).unwrap());
            assert_eq!([bare.n(), more.n(), more.seen_states()], [1, 2, 1]);
            assert!(!bare.ports[0].sees_displacement() && more.integrates(&more.ports[0]));
            is_near(&run(&more, &[], &u), &run(&bare, &[], &u), 1e-12);
            let hz = if damper > 0.0 { 0.0 } else { 0.1 };
            assert_eq!(
                (more.response(hz), more.port_response(0, 1.0)),
                (bare.response(hz), bare.port_response(0, 1.0))
            );
            assert_eq!((more.mobility(0), more.stiffness(&more.ports[0])), (bare.mobility(0), 0.0));
            let [of_bare, of_more] = [&bare, &more].map(|plant| Spectrum::of(plant).unwrap());
            assert_eq!(of_bare.numbers, of_more.numbers);
            let (mut moved, mut expected) = (more.clone(), bare.clone());
            let eta = vec![0.2; of_bare.numbers.len()];
            of_more.change(&mut moved, &eta);
            of_bare.change(&mut expected, &eta);
            is_near(&run(&moved, &[], &u), &run(&expected, &[], &u), 1e-12);
            // The position still is the integral of the velocity.
            let (a, b) = moved.rest.continuous.clone().unwrap();
            let (over, entered) = held(&a, &b, 1.0 / RATE);
            assert!((over - &moved.rest.a).norm() < 1e-12 && (entered - &moved.rest.b).norm() < 1e-12);
        }
    }

    /// A spring at the axis makes an oscillator of the motor, whose speed after a step of the force is known. The
    /// plant that is written and read again is the same.
    #[test]
    fn a_spring_at_a_motor_makes_an_oscillator() {
        let (mass, damper, k) = (2.0, 3.0, 180.0);
        let model = motor(damper, true);
        let plant = Plant::new(&model).unwrap();
        let again = Plant::new(&plant.to_model(&model)).unwrap();
        assert_eq!((again.seen_states(), &again.chain), (1, &plant.chain));
        let (decay, w) = (damper / (2.0 * mass), (k / mass - (damper / (2.0 * mass)).powi(2)).sqrt());
        let speed = |n: usize| {
            let t = n as f64 / RATE;
            (-decay * t).exp() * (w * t).sin() / (mass * w)
        };
        let expected: Vec<f64> = (0..400).map(speed).collect();
        for plant in [plant, again] {
            let spring = Action::Load(0, Load { stiffness: k, ..Load::default() });
            is_near(&run(&plant, &[spring], &[vec![1.0; 400]]), &expected, 1e-8);
        }
    }

    /// A port that the case declares shows that its output measures a motion.
    #[test]
    fn a_declared_port_integrates_its_velocity() {
        let mut plant = Plant::new(&motor(3.0, false)).unwrap();
        plant.declare(&[CasePort { name: "axis".into(), input: 0, output: 0 }]).unwrap();
        assert!(plant.integrates(&plant.ports[0]) && plant.ports[0].sees_displacement());
    }

    /// Beside a motor, a servo keeps its stiffness and the position that its input commands.
    #[test]
    fn another_axis_stays_as_it_is() {
        let a = dmatrix![-1.5, 0.0, 0.0; 0.0, 0.0, 1.0; 0.0, -900.0, -60.0];
        let b = dmatrix![0.5, 0.0; 0.0, 0.0; 0.0, 900.0];
        let (a, b) = held(&a, &b, 1.0 / RATE);
        let c = dmatrix![1.0, 0.0, 0.0; 0.0, 1.0, 0.0];
        let mut model = Model::new(RATE, a, b, c, DMatrix::zeros(2, 2)).unwrap();
        let bare = Plant::new(&model).unwrap();
        model.output_kinds = vec![Some(OutputKind::Velocity), Some(OutputKind::Position)];
        let plant = Plant::new(&model).unwrap();
        assert!(plant.integrates(&plant.ports[0]) && !plant.integrates(&plant.ports[1]));
        assert!(bare.commands_position(1) && plant.commands_position(1));
        let [found, expected] = [&plant, &bare].map(|plant| plant.stiffness(&plant.ports[1]));
        assert!((found / expected - 1.0).abs() < 1e-9 && expected > 0.0, "{found} {expected}");
    }
}
