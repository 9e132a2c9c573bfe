//! The plant stepped through time with the forces that depend on its motion. A diagnosis spends most of its time here.

use nalgebra::{DMatrix, DVector};

use crate::effects::{Drive, Force};
use crate::fourier::C;
use crate::plant::{Carried, Plant, phi1};
use crate::simulate::State;
use crate::simulate::lanes::{self, Lane, Quad, Rows};

/// Runs all samples. The loops over modes are short and gain from wide registers.
#[multiversion::multiversion(targets("x86_64+avx2+fma"))]
pub fn advance(
    runner: &mut Runner,
    plant: &Plant,
    drive: &Drive,
    disturbances: &[(usize, Vec<f64>)],
    factors: &[f64],
    drift: usize,
    y: &mut [Vec<f64>],
) {
    let samples = y[0].len();
    let mut held = vec![0.0; plant.m];
    for k in 0..samples {
        if !factors.is_empty() && k % drift == 0 {
            runner.stiffen(plant, factors[k / drift]);
        }
        for value in 0..drive.parts {
            let at = k * drive.parts + value;
            let same = value > 0 && held.iter().zip(&drive.u).all(|(h, u)| *h == u[at]);
            if !same {
                held.iter_mut().zip(&drive.u).for_each(|(h, u)| *h = u[at]);
                runner.hold(&held);
            }
            if value == 0 {
                runner.sample(drive, k);
                // The outputs are sampled before the next value of a disturbance acts, which an accelerometer without a
                // filter would show.
                runner.output(&held, y, k);
                for (d, (_, signal)) in disturbances.iter().enumerate() {
                    runner.push(d, signal[k]);
                }
            }
            for part in 0..runner.parts_a_value {
                runner.step(value + 1 == drive.parts && part + 1 == runner.parts_a_value);
            }
        }
    }
}

/// The plant stepped over parts of a sample, with its state.
pub struct Runner<'a> {
    /// Number of parts of a sample for each value of the command.
    parts_a_value: usize,
    step: f64,
    turn: Vec<Lane>,
    /// For each input, the increment of a unit over a part.
    b: Vec<Vec<Lane>>,
    /// Output row of each mode, doubled.
    c: Vec<Vec<Lane>>,
    d: DMatrix<f64>,
    rest: NonModalStep,
    /// Increment of the held input and of the disturbances over a part.
    held: Vec<Lane>,
    held_rest: Vec<Quad>,
    added: Vec<Lane>,
    added_rest: Vec<Quad>,
    z: Vec<Lane>,
    x: Vec<Quad>,
    ports: Vec<Port<'a>>,
    pushes: Vec<Push>,
    /// For each port, the force that is held over a part.
    forces: Vec<f64>,
    /// For each port, the change of its force over the last part, which the state does not yet contain.
    changes: Vec<f64>,
    /// For each port, its motion after a part.
    moved: Vec<Motion>,
}

/// The step of the rest: over each part if its continuous form is known, otherwise over a sample with the mean input.
struct NonModalStep {
    a: Rows,
    /// For each input, the increment of a unit.
    b: Vec<Vec<Quad>>,
    /// Of each output.
    c: Vec<Vec<Quad>>,
    each_part: bool,
    next: Vec<Quad>,
}

/// A port over one part of a sample.
struct Port<'a> {
    law: &'a dyn Force,
    /// Number of the port in the plant.
    number: usize,
    /// Of the law.
    state: f64,
    /// Displacement and velocity now, and the displacement to which the law's state belongs (that of the predictor).
    d: f64,
    v: f64,
    path: f64,
    /// Increments by a force over a part: by a held unit, by a ramp from 0 to 1, and by such a ramp in the part before.
    held: Vec<Lane>,
    ramp: Vec<Lane>,
    past: Vec<Lane>,
    held_rest: Vec<Quad>,
    ramp_rest: Vec<Quad>,
    past_rest: Vec<Quad>,
    /// Rows of displacement and velocity.
    sees_d: Vec<Lane>,
    sees_v: Vec<Lane>,
    sees_d_rest: Vec<Quad>,
    sees_v_rest: Vec<Quad>,
    /// Increments of displacement and velocity by each port's force.
    coupled: Vec<Coupled>,
    /// Direct response of the outputs to a unit.
    output: Vec<f64>,
    /// Increments of the outputs by its ramp.
    shown: Vec<f64>,
    /// Friction that can hold the port.
    hold: Option<Hold>,
}

/// Displacement and velocity at a port.
type Motion = [f64; 2];

/// Increments of the motion at a port by a force there or elsewhere: by a held unit, by a ramp from 0 to 1, and by such
/// a ramp in the part before.
#[derive(Clone, Copy)]
struct Coupled {
    held: Motion,
    ramp: Motion,
    past: Motion,
}

/// Dry friction that holds a port while it stands still.
struct Hold {
    /// The largest force.
    most: f64,
    /// Whether the port stands still.
    stuck: bool,
    /// The force of the last part.
    force: f64,
}

/// A disturbance at a port: the increment by a unit over a part, and its direct response.
struct Push {
    /// Of the port in the plant.
    number: usize,
    modes: Vec<Lane>,
    rest: Vec<Quad>,
    output: Vec<f64>,
    value: f64,
}

impl<'a> Runner<'a> {
    /// A runner at rest, with a given number of values of the command in a sample, each of a given number of parts.
    pub fn new(
        plant: &Plant,
        (values, parts_a_value): (usize, usize),
        forces: &[(usize, &'a dyn Force)],
        disturbances: &[(usize, Vec<f64>)],
    ) -> Self {
        let parts = values * parts_a_value;
        let step = 1.0 / (plant.rate * parts as f64);
        let rest = NonModalStep::new(plant, parts, step);
        let none = lanes::complex(std::iter::repeat_n(C::ZERO, plant.modes.len()));
        let nought = rest.next.clone();
        let ports = forces.iter().map(|&(number, law)| Port::new(plant, number, law, step, &rest)).collect();
        let push = |number: usize| {
            let (rest, _) = rest_force(plant, &plant.ports[number].force_rest, step);
            Push { number, modes: none.clone(), rest, output: plant.ports[number].output.clone(), value: 0.0 }
        };
        let mut runner = Self {
            parts_a_value,
            step,
            turn: none.clone(),
            b: vec![none.clone(); plant.m],
            c: vec![none.clone(); plant.p],
            d: plant.d.clone(),
            rest,
            held: none.clone(),
            held_rest: nought.clone(),
            added: none.clone(),
            added_rest: nought.clone(),
            z: none.clone(),
            x: nought,
            ports,
            pushes: disturbances.iter().map(|&(number, _)| push(number)).collect(),
            forces: vec![0.0; forces.len()],
            changes: vec![0.0; forces.len()],
            moved: vec![Motion::default(); forces.len()],
        };
        for (k, mode) in plant.modes.iter().enumerate() {
            runner.place(plant, k, mode.pole, Carried::UNMOVED);
        }
        runner.couple();
        runner
    }

    /// Starts from a state.
    pub fn start(&mut self, state: &State) {
        self.z = lanes::complex(state.modes.iter().copied());
        self.x = lanes::real(&state.rest);
        for j in 0..self.ports.len() {
            let [d, v] = self.seen(j);
            (self.ports[j].d, self.ports[j].v, self.ports[j].path) = (d, v, d);
            self.ports[j].hold.iter_mut().for_each(|hold| hold.stuck = v == 0.0);
        }
    }

    /// Sets a mode's pole and all that follows from it over a part.
    fn place(&mut self, plant: &Plant, k: usize, pole: C, rows: Carried) {
        let mode = &plant.modes[k];
        let (held, ramp) = (phi1(pole * self.step) * self.step, phi2(pole * self.step) * self.step);
        let turn = (pole * self.step).exp();
        lanes::set(&mut self.turn, k, turn);
        for (to, b) in self.b.iter_mut().zip(mode.b.iter()) {
            lanes::set(to, k, held * b);
        }
        for ((to, c), &sensed) in self.c.iter_mut().zip(&mode.c).zip(&plant.sensed) {
            lanes::set(to, k, 2.0 * c * rows.sensed(sensed));
        }
        for to in &mut self.ports {
            let port = &plant.ports[to.number];
            lanes::set(&mut to.held, k, held * port.force[k]);
            lanes::set(&mut to.ramp, k, ramp * port.force[k]);
            lanes::set(&mut to.past, k, turn * ramp * port.force[k]);
            lanes::set(&mut to.sees_d, k, 2.0 * port.displacement[k] * rows.displacement);
            lanes::set(&mut to.sees_v, k, 2.0 * port.velocity[k] * rows.velocity);
        }
        for push in &mut self.pushes {
            lanes::set(&mut push.modes, k, held * plant.ports[push.number].force[k]);
        }
    }

    /// Computes the increments by each port's force at each port and at the outputs.
    fn couple(&mut self) {
        let seen = |at: &Port, modes: &[Lane], rest: &[Quad]| {
            let d = lanes::real_dot(&at.sees_d, modes) + lanes::dot(&at.sees_d_rest, rest);
            let v = lanes::real_dot(&at.sees_v, modes) + lanes::dot(&at.sees_v_rest, rest);
            [d, v]
        };
        let coupled = |at: &Port, by: &Port| Coupled {
            held: seen(at, &by.held, &by.held_rest),
            ramp: seen(at, &by.ramp, &by.ramp_rest),
            past: seen(at, &by.past, &by.past_rest),
        };
        for j in 0..self.ports.len() {
            let at = &self.ports[j];
            let coupled = self.ports.iter().map(|by| coupled(at, by)).collect();
            let rows = self.c.iter().zip(&self.rest.c);
            let shown = |(c, rest): (&Vec<Lane>, &Vec<Quad>)| {
                lanes::real_dot(c, &at.ramp) + lanes::dot(rest, &at.ramp_rest)
            };
            (self.ports[j].shown, self.ports[j].coupled) = (rows.map(shown).collect(), coupled);
        }
    }

    /// Adds the last changes of the forces to the state.
    fn catch_up(&mut self) {
        for (port, change) in self.ports.iter().zip(&mut self.changes) {
            lanes::add(&mut self.z, &port.ramp, *change);
            if self.rest.each_part {
                lanes::add_real(&mut self.x, &port.ramp_rest, *change);
            }
            *change = 0.0;
        }
    }

    /// Multiplies every w^2 by `factor`. The force 2 zeta w q' stays, and so does the real part of each pole; a mode's
    /// rows follow its pole. The gains of actuators and filters are those at the former pole.
    fn stiffen(&mut self, plant: &Plant, factor: f64) {
        self.catch_up();
        for (k, mode) in plant.modes.iter().enumerate() {
            let from = mode.pole;
            let square = from.norm_sqr() * factor - from.re * from.re;
            let pole = C::new(from.re, square.max(1e-6 * from.norm_sqr()).sqrt());
            self.place(plant, k, pole, Carried::new(from, pole));
        }
        self.couple();
        for j in 0..self.ports.len() {
            [self.ports[j].d, self.ports[j].v] = self.seen(j);
        }
    }

    /// Sets a new held input.
    #[inline(always)]
    fn hold(&mut self, u: &[f64]) {
        self.held.fill(Lane::default());
        for (b, &u) in self.b.iter().zip(u) {
            lanes::add(&mut self.held, b, u);
        }
        if self.rest.each_part {
            self.rest.driven(u.iter().copied(), &mut self.held_rest);
        }
        self.renew();
    }

    #[inline(always)]
    fn renew(&mut self) {
        self.added.copy_from_slice(&self.held);
        self.added_rest.copy_from_slice(&self.held_rest);
        for push in &self.pushes {
            lanes::add(&mut self.added, &push.modes, push.value);
            if self.rest.each_part {
                lanes::add_real(&mut self.added_rest, &push.rest, push.value);
            }
        }
    }

    /// Sets a new value of a disturbance.
    #[inline(always)]
    fn push(&mut self, disturbance: usize, value: f64) {
        self.pushes[disturbance].value = value;
        self.renew();
    }

    /// Steps the rest by a sample with its mean input, if it has no continuous form.
    #[inline(always)]
    fn sample(&mut self, drive: &Drive, k: usize) {
        if self.rest.each_part {
            return;
        }
        let mean = |u: &Vec<f64>| u[k * drive.parts..(k + 1) * drive.parts].iter().sum::<f64>() / drive.parts as f64;
        self.rest.driven(drive.u.iter().map(mean), &mut self.held_rest);
        self.added_rest.copy_from_slice(&self.held_rest);
    }

    #[inline(always)]
    fn output(&self, u: &[f64], y: &mut [Vec<f64>], sample: usize) {
        for (o, channel) in y.iter_mut().enumerate() {
            let mut sum = lanes::real_dot(&self.c[o], &self.z) + lanes::dot(&self.rest.c[o], &self.x);
            for (i, u) in u.iter().enumerate() {
                sum += self.d[(o, i)] * u;
            }
            for (port, change) in self.ports.iter().zip(&self.changes) {
                sum += port.shown[o] * change;
                if let Some(gain) = port.output.get(o) {
                    sum += gain * port.acting();
                }
            }
            for push in &self.pushes {
                sum += push.output.get(o).map_or(0.0, |gain| gain * push.value);
            }
            channel[sample] = sum;
        }
    }

    /// Returns the motion at a port without the last changes of the forces.
    #[inline(always)]
    fn seen(&self, j: usize) -> Motion {
        let port = &self.ports[j];
        let d = lanes::real_dot(&port.sees_d, &self.z) + lanes::dot(&port.sees_d_rest, &self.x);
        let v = lanes::real_dot(&port.sees_v, &self.z) + lanes::dot(&port.sees_v_rest, &self.x);
        [d, v]
    }

    /// Steps by one part of a sample.
    ///
    /// Each force must be known before the next one, and that chain takes most of the time. The sums over modes are
    /// therefore kept out of it: a part is stepped without forces and seen at the ports, while the forces are still
    /// being computed, and what these add there is known from their increments ([`Coupled`]).
    #[inline(always)]
    fn step(&mut self, last: bool) {
        for ((z, turn), added) in self.z.iter_mut().zip(&self.turn).zip(&self.added) {
            *z = z.turned(*turn, *added);
        }
        if self.rest.each_part || last {
            self.rest.step(&mut self.x, &self.added_rest);
        }
        if self.ports.is_empty() {
            return;
        }
        for j in 0..self.ports.len() {
            self.moved[j] = self.seen(j);
        }
        for j in 0..self.ports.len() {
            let (force, change) = (self.ports[j].acting(), self.changes[j]);
            self.forces[j] = force;
            self.push_on(j, force, change);
            for (at, moved) in self.ports.iter().zip(&mut self.moved) {
                let by = &at.coupled[j];
                *moved = std::array::from_fn(|q| moved[q] + by.held[q] * force + by.past[q] * change);
            }
        }
        for j in 0..self.ports.len() {
            self.hold_still(j);
            let port = &mut self.ports[j];
            [port.d, port.v] = self.moved[j];
            port.state = port.law.advance(port.path, port.d, port.state);
            port.path = port.d;
            let stuck = port.hold.as_ref().is_some_and(|hold| hold.stuck);
            self.changes[j] = if stuck { 0.0 } else { port.law.force(port.d, port.v, port.state) - self.forces[j] };
        }
        for port in &mut self.ports {
            for (by, &change) in port.coupled.iter().zip(&self.changes) {
                port.d += by.ramp[0] * change;
                port.v += by.ramp[1] * change;
            }
        }
    }

    /// Adds a force that is held over a part, and the change that the last part had, to the state.
    #[inline(always)]
    fn push_on(&mut self, j: usize, force: f64, change: f64) {
        let port = &self.ports[j];
        lanes::add(&mut self.z, &port.held, force);
        lanes::add(&mut self.z, &port.past, change);
        if self.rest.each_part {
            lanes::add_real(&mut self.x, &port.held_rest, force);
            lanes::add_real(&mut self.x, &port.past_rest, change);
        }
    }

    /// Friction that holds a port, or on whose way the velocity passes zero, becomes the force that brings the port to
    /// rest at the end of a part, as far as it can. (This is the time stepping of Moreau for unilateral constraints: J.
    /// J. Moreau, in Nonsmooth Mechanics and Applications, 1988.)
    #[inline(always)]
    fn hold_still(&mut self, j: usize) {
        let (v, held) = (self.moved[j][1], self.forces[j]);
        let port = &mut self.ports[j];
        let Some(hold) = &mut port.hold else { return };
        hold.stuck = hold.stuck || port.v * v <= 0.0;
        if !hold.stuck {
            return;
        }
        let wanted = held - v / port.coupled[j].held[1];
        hold.force = wanted.clamp(-hold.most, hold.most);
        hold.stuck = hold.force == wanted;
        let (force, stuck) = (hold.force, hold.stuck);
        self.forces[j] = force;
        self.push_on(j, force - held, 0.0);
        for (at, moved) in self.ports.iter().zip(&mut self.moved).skip(j) {
            *moved = std::array::from_fn(|q| moved[q] + at.coupled[j].held[q] * (force - held));
        }
        if stuck {
            self.moved[j][1] = 0.0;
        }
    }
}

impl NonModalStep {
    fn new(plant: &Plant, parts: usize, step: f64) -> Self {
        let rest = &plant.rest;
        let r = rest.a.nrows();
        let continuous = rest.continuous.as_ref().filter(|_| parts > 1);
        let stepped = continuous.map(|(a, b)| held_and_ramp(a, b, step));
        let (a, b) = stepped.as_ref().map_or((&rest.a, &rest.b), |(a, b, _)| (a, b));
        Self {
            a: Rows::new(a),
            b: b.column_iter().map(|column| lanes::real(column.into_owned().as_slice())).collect(),
            c: rest.c.row_iter().map(|row| lanes::real(row.transpose().as_slice())).collect(),
            each_part: parts == 1 || continuous.is_some(),
            next: lanes::real(&vec![0.0; r]),
        }
    }

    /// Adds the increment of a held input.
    #[inline(always)]
    fn driven(&self, u: impl Iterator<Item = f64>, to: &mut [Quad]) {
        to.fill(Quad::default());
        for (b, u) in self.b.iter().zip(u) {
            lanes::add_real(to, b, u);
        }
    }

    /// x = A x + increment.
    #[inline(always)]
    fn step(&mut self, x: &mut Vec<Quad>, added: &[Quad]) {
        self.a.times(x, added, &mut self.next);
        std::mem::swap(x, &mut self.next);
    }
}

impl<'a> Port<'a> {
    /// Sets all that does not depend on a mode's pole.
    fn new(plant: &Plant, number: usize, law: &'a dyn Force, step: f64, rest: &NonModalStep) -> Self {
        let port = &plant.ports[number];
        let none = lanes::complex(std::iter::repeat_n(C::ZERO, plant.modes.len()));
        let (held_rest, ramp_rest) = rest_force(plant, &port.force_rest, step);
        let mut past_rest = rest.next.clone();
        rest.a.times(&ramp_rest, &rest.next, &mut past_rest);
        Self {
            law,
            number,
            state: 0.0,
            d: 0.0,
            v: 0.0,
            path: 0.0,
            held: none.clone(),
            ramp: none.clone(),
            past: none.clone(),
            held_rest,
            ramp_rest,
            past_rest,
            sees_d: none.clone(),
            sees_v: none,
            sees_d_rest: lanes::real(port.displacement_rest.as_slice()),
            sees_v_rest: lanes::real(port.velocity_rest.as_slice()),
            coupled: Vec::new(),
            output: port.output.clone(),
            shown: Vec::new(),
            hold: law.holds().map(|most| Hold { most, stuck: true, force: 0.0 }),
        }
    }

    /// Returns the force that acts now.
    #[inline(always)]
    fn acting(&self) -> f64 {
        match &self.hold {
            Some(hold) if hold.stuck => hold.force,
            _ => self.law.force(self.d, self.v, self.state),
        }
    }
}

/// Returns the increments of the rest over a step by a held force and by a ramp from 0 to 1; zero if its continuous
/// form is not known.
fn rest_force(plant: &Plant, force: &DVector<f64>, step: f64) -> (Vec<Quad>, Vec<Quad>) {
    let r = force.len();
    match &plant.rest.continuous {
        Some((a, _)) if r > 0 => {
            let column = DMatrix::from_column_slice(r, 1, force.as_slice());
            let (_, held, ramp) = held_and_ramp(a, &column, step);
            (lanes::real(held.as_slice()), lanes::real(ramp.as_slice()))
        }
        _ => (lanes::real(&vec![0.0; r]), lanes::real(&vec![0.0; r])),
    }
}

/// e^{A h}, int e^{A (h - s)} B ds and int e^{A (h - s)} B s / h ds, from one exponential (Van Loan, IEEE TAC 23,
/// 1978).
fn held_and_ramp(a: &DMatrix<f64>, b: &DMatrix<f64>, h: f64) -> (DMatrix<f64>, DMatrix<f64>, DMatrix<f64>) {
    let (r, m) = b.shape();
    let size = r + 2 * m;
    let mut whole = DMatrix::zeros(size, size);
    whole.view_mut((0, 0), (r, r)).copy_from(&(a * h));
    whole.view_mut((0, r), (r, m)).copy_from(&(b * h));
    whole.view_mut((r, r + m), (m, m)).fill_with_identity();
    let whole = whole.exp();
    (
        whole.view((0, 0), (r, r)).into_owned(),
        whole.view((0, r), (r, m)).into_owned(),
        whole.view((0, r + m), (r, m)).into_owned(),
    )
}

/// (e^x - 1 - x) / x^2.
fn phi2(x: C) -> C {
    if x.norm() < 1e-2 {
        C::from(0.5) + x / 6.0 * (C::ONE + x / 4.0 * (C::ONE + x / 5.0 * (C::ONE + x / 6.0)))
    } else {
        (x.exp() - 1.0 - x) / (x * x)
    }
}
