//! The plant stepped through time with the forces that depend on its motion. A diagnosis spends most of its time here.

use nalgebra::DMatrix;

use crate::effects::{Drive, Force};
use crate::plant::{Carried, Plant};
use crate::simulate::State;
use crate::simulate::block::{Block, Maps};
use crate::simulate::lanes::{self, Quad, Rows};
use plid_fourier::C;

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
            runner.step(value + 1 == drive.parts);
        }
    }
}

/// The plant stepped over blocks, with its state.
pub struct Runner<'a> {
    block: Block,
    maps: Maps,
    late: Option<Late>,
    /// Direct feedthrough of the inputs.
    d: DMatrix<f64>,
    /// Increments of the state, and then of the motion, over a block: by the held input, and with the disturbances.
    held: Vec<Quad>,
    added: Vec<Quad>,
    state: Vec<Quad>,
    motion: Vec<Quad>,
    forces: Vec<Quad>,
    /// The next state of the rest, and the outputs.
    next: Vec<Quad>,
    shown: Vec<Quad>,
    ports: Vec<Port<'a>>,
    pushes: Vec<Push>,
}

/// The rest, if its continuous form is not known: it is stepped at the end of a sample with its mean input.
struct Late {
    a: Rows,
    /// For each input, the increment of a unit over a sample.
    b: Vec<Vec<Quad>>,
    held: Vec<Quad>,
    /// Its part in the motion at the end of a block.
    sees: Rows,
}

/// A port over one part of a sample.
struct Port<'a> {
    law: &'a dyn Force,
    /// Of the law.
    state: f64,
    /// Displacement and velocity now, and the displacement to which the law's state belongs (that of the predictor).
    d: f64,
    v: f64,
    path: f64,
    /// Direct response of the outputs to a unit.
    output: Vec<f64>,
    /// Friction that can hold the port.
    hold: Option<Hold>,
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

/// A disturbance at a port: its value, and the direct response of the outputs to a unit.
struct Push {
    value: f64,
    output: Vec<f64>,
}

impl<'a> Runner<'a> {
    /// A runner at rest, with a given number of values of the command in a sample, each of a given number of parts.
    pub fn new(
        plant: &Plant,
        parts: (usize, usize),
        forces: &[(usize, &'a dyn Force)],
        disturbances: &[(usize, Vec<f64>)],
    ) -> Self {
        let numbers = forces.iter().map(|(number, _)| *number).collect();
        let block = Block::new(plant, parts, numbers, disturbances.iter().map(|(number, _)| *number).collect());
        let poles: Vec<_> = plant.modes.iter().map(|mode| (mode.pole, Carried::UNMOVED)).collect();
        let output = |number: &usize| plant.ports[*number].output.clone();
        let all = vec![Quad::default(); block.state_lanes() + block.motion_lanes()];
        let (state, motion) = all.split_at(block.state_lanes());
        Self {
            maps: block.maps(plant, &poles),
            late: block.late.then(|| Late::new(plant, &block, forces)),
            d: plant.d.clone(),
            state: state.to_vec(),
            motion: motion.to_vec(),
            forces: motion.to_vec(),
            next: lanes::zeros(plant.rest.a.nrows()),
            shown: lanes::zeros(plant.p),
            ports: forces.iter().map(|(number, law)| Port::new(*law, output(number))).collect(),
            pushes: disturbances.iter().map(|(number, _)| Push { value: 0.0, output: output(number) }).collect(),
            held: all.clone(),
            added: all,
            block,
        }
    }

    /// Starts from a state.
    pub fn start(&mut self, state: &State) {
        self.state = self.block.state(&state.modes, &state.rest);
        self.see();
        for port in &mut self.ports {
            port.path = port.d;
            port.hold.iter_mut().for_each(|hold| hold.stuck = port.v == 0.0);
        }
    }

    /// Sets the motion of the ports to that of the state.
    fn see(&mut self) {
        let mut seen = lanes::zeros(2 * self.ports.len());
        self.maps.seen.add_times(&self.state, &mut seen);
        for (j, port) in self.ports.iter_mut().enumerate() {
            (port.d, port.v) = (lanes::get(&seen, 2 * j), lanes::get(&seen, 2 * j + 1));
        }
    }

    /// Multiplies every w^2 by `factor`. The force 2 zeta w q' stays, and so does the real part of each pole; a mode's
    /// rows follow its pole. The gains of actuators and filters are those at the former pole.
    fn stiffen(&mut self, plant: &Plant, factor: f64) {
        let pole = |from: C| {
            let square = from.norm_sqr() * factor - from.re * from.re;
            let to = C::new(from.re, square.max(1e-6 * from.norm_sqr()).sqrt());
            (to, Carried::new(from, to))
        };
        let poles: Vec<_> = plant.modes.iter().map(|mode| pole(mode.pole)).collect();
        self.maps = self.block.maps(plant, &poles);
        self.see();
    }

    /// Sets a new held input.
    #[inline(always)]
    fn hold(&mut self, u: &[f64]) {
        self.held.fill(Quad::default());
        for (driven, &u) in self.maps.driven.iter().zip(u) {
            lanes::add(&mut self.held, driven, u);
        }
        self.renew();
    }

    #[inline(always)]
    fn renew(&mut self) {
        self.added.copy_from_slice(&self.held);
        let driven = &self.maps.driven[self.maps.driven.len() - self.pushes.len()..];
        for (push, driven) in self.pushes.iter().zip(driven) {
            lanes::add(&mut self.added, driven, push.value);
        }
    }

    /// Sets a new value of a disturbance.
    #[inline(always)]
    fn push(&mut self, disturbance: usize, value: f64) {
        self.pushes[disturbance].value = value;
        self.renew();
    }

    /// Sets the mean input of a sample.
    #[inline(always)]
    fn sample(&mut self, drive: &Drive, k: usize) {
        let Some(late) = &mut self.late else { return };
        let mean = |u: &Vec<f64>| u[k * drive.parts..(k + 1) * drive.parts].iter().sum::<f64>() / drive.parts as f64;
        late.held.fill(Quad::default());
        for (b, u) in late.b.iter().zip(&drive.u) {
            lanes::add(&mut late.held, b, mean(u));
        }
    }

    #[inline(always)]
    fn output(&mut self, u: &[f64], y: &mut [Vec<f64>], sample: usize) {
        self.shown.fill(Quad::default());
        self.maps.outputs.add_times(&self.state, &mut self.shown);
        for (o, channel) in y.iter_mut().enumerate() {
            let mut sum = lanes::get(&self.shown, o);
            for (i, u) in u.iter().enumerate() {
                sum += self.d[(o, i)] * u;
            }
            for port in &self.ports {
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

    /// Steps by a block; the `last` one ends a sample.
    #[inline(always)]
    fn step(&mut self, last: bool) {
        let (to_state, to_motion) = self.added.split_at(self.state.len());
        if !self.ports.is_empty() {
            self.motion.copy_from_slice(to_motion);
            self.maps.motion.add_times(&self.state, &mut self.motion);
        }
        let modes = self.state.len() - self.next.len();
        let (modes, rest) = self.state.split_at_mut(modes);
        let (to_modes, to_rest) = to_state.split_at(modes.len());
        lanes::turn(modes, &self.maps.turn, to_modes);
        match &self.late {
            None => {
                self.next.copy_from_slice(to_rest);
                self.maps.rest.add_times(rest, &mut self.next);
                rest.copy_from_slice(&self.next);
            }
            Some(late) => {
                if last {
                    self.next.copy_from_slice(&late.held);
                    late.a.add_times(rest, &mut self.next);
                    rest.copy_from_slice(&self.next);
                }
                late.sees.add_times(rest, &mut self.motion);
            }
        }
        if self.ports.is_empty() {
            return;
        }
        for part in 0..self.block.parts {
            self.part(part);
        }
        self.maps.forces.add_times(&self.forces, &mut self.state);
    }

    /// Finds the forces of a part. Each is held over the part first, as it was at its beginning, and then becomes what
    /// the law says of the motion at its end.
    #[inline(always)]
    fn part(&mut self, part: usize) {
        let parts = self.block.parts;
        for j in 0..self.ports.len() {
            let force = self.ports[j].acting();
            *lanes::get_mut(&mut self.forces, self.block.d(j, part)) = force;
            lanes::add(&mut self.motion, &self.maps.held[j * parts + part], force);
        }
        for j in 0..self.ports.len() {
            self.hold_still(j, part);
            let held = lanes::get(&self.forces, self.block.d(j, part));
            let (d, v) = self.moved(j, part);
            let port = &mut self.ports[j];
            port.state = port.law.advance(port.path, d, port.state);
            port.path = d;
            let stuck = port.hold.as_ref().is_some_and(|hold| hold.stuck);
            let change = if stuck { 0.0 } else { port.law.force(d, v, port.state) - held };
            *lanes::get_mut(&mut self.forces, self.block.v(j, part)) = change;
        }
        for j in 0..self.ports.len() {
            let change = lanes::get(&self.forces, self.block.v(j, part));
            lanes::add(&mut self.motion, &self.maps.ramp[j * parts + part], change);
        }
        for j in 0..self.ports.len() {
            let (d, v) = self.moved(j, part);
            (self.ports[j].d, self.ports[j].v) = (d, v);
        }
    }

    /// Displacement and velocity at a port after a part.
    #[inline(always)]
    fn moved(&self, j: usize, part: usize) -> (f64, f64) {
        (lanes::get(&self.motion, self.block.d(j, part)), lanes::get(&self.motion, self.block.v(j, part)))
    }

    /// Friction that holds a port, or on whose way the velocity passes zero, becomes the force that brings the port to
    /// rest at the end of a part, as far as it can. (This is the time stepping of Moreau for unilateral constraints: J.
    /// J. Moreau, in Nonsmooth Mechanics and Applications, 1988.)
    #[inline(always)]
    fn hold_still(&mut self, j: usize, part: usize) {
        let (at_d, at_v) = (self.block.d(j, part), self.block.v(j, part));
        let (v, held) = (lanes::get(&self.motion, at_v), lanes::get(&self.forces, at_d));
        let by_held = &self.maps.held[j * self.block.parts + part];
        let port = &mut self.ports[j];
        let Some(hold) = &mut port.hold else { return };
        hold.stuck = hold.stuck || port.v * v <= 0.0;
        if !hold.stuck {
            return;
        }
        let wanted = held - v / lanes::get(by_held, at_v);
        hold.force = wanted.clamp(-hold.most, hold.most);
        hold.stuck = hold.force == wanted;
        *lanes::get_mut(&mut self.forces, at_d) = hold.force;
        lanes::add(&mut self.motion, by_held, hold.force - held);
        if hold.stuck {
            *lanes::get_mut(&mut self.motion, at_v) = 0.0;
        }
    }
}

impl Late {
    fn new(plant: &Plant, block: &Block, forces: &[(usize, &dyn Force)]) -> Self {
        let rest = &plant.rest;
        let r = rest.a.nrows();
        let mut rows = vec![None; lanes::WIDE * block.motion_lanes()];
        for (j, (number, _)) in forces.iter().enumerate() {
            rows[block.d(j, block.parts - 1)] = Some(&plant.ports[*number].displacement_rest);
            rows[block.v(j, block.parts - 1)] = Some(&plant.ports[*number].velocity_rest);
        }
        Self {
            a: Rows::new(r, r, |i, j| rest.a[(i, j)]),
            b: rest.b.column_iter().map(|column| lanes::of(column.into_owned().as_slice())).collect(),
            held: lanes::zeros(r),
            sees: Rows::new(rows.len(), r, |i, j| rows[i].map_or(0.0, |row| row[j])),
        }
    }
}

impl<'a> Port<'a> {
    fn new(law: &'a dyn Force, output: Vec<f64>) -> Self {
        let hold = law.holds().map(|most| Hold { most, stuck: true, force: 0.0 });
        Self { law, state: 0.0, d: 0.0, v: 0.0, path: 0.0, output, hold }
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
