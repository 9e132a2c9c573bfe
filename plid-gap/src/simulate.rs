//! The forward simulation: command, structure, sensors, with any effects.
//!
//! The structure's modes are advanced exactly for a held input. A force that depends on the motion is a straight line over each
//! part of a sample, by a predictor and a corrector (exponential time differencing, second order: Cox and Matthews, J. Comput.
//! Phys. 176, 2002), in continuous time: [`Fineness`] says how many parts a sample has.

use nalgebra::{DMatrix, DVector};

use crate::effects::{Action, Drive, Force};
use crate::plant::{C, Carried, Plant};
use crate::record::Channels;

/// How finely a sample is divided.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Fineness {
    /// Parts of a sample over which a force of the motion is a straight line.
    pub force: usize,
    /// Samples after which a drifting pole is brought up to date.
    pub drift: usize,
}

impl Fineness {
    /// For fits and predictions.
    pub const FINE: Self = Self { force: 8, drift: 16 };
    /// For the screen, which only ranks.
    pub const COARSE: Self = Self { force: 4, drift: 64 };
}

/// A state: of each mode, then of the rest.
#[derive(Debug, Clone, PartialEq)]
pub struct State {
    /// Of each mode.
    pub modes: Vec<C>,
    /// Of the rest.
    pub rest: Vec<f64>,
}

impl State {
    /// At rest.
    pub fn rest(plant: &Plant) -> Self {
        Self { modes: vec![C::ZERO; plant.modes.len()], rest: vec![0.0; plant.rest.a.nrows()] }
    }
}

/// The outputs (p channels) for held inputs (m channels) from time `t0`, with effects.
pub fn simulate(
    plant: &Plant,
    actions: &[Action],
    u: &[Vec<f64>],
    t0: f64,
    start: Option<&State>,
    fineness: Fineness,
) -> Channels {
    let samples = u.first().map_or(0, Vec::len);
    let changed = changed_plant(plant, actions);
    let plant = changed.as_ref().unwrap_or(plant);
    let mut drive = Drive::new(u, plant.rate, t0);
    for action in actions {
        if let Action::Command(command) = action {
            command.apply(&mut drive);
        }
    }
    let forces: Vec<(usize, &dyn Force)> = actions
        .iter()
        .filter_map(|action| if let Action::Force(port, law) = action { Some((*port, law.as_ref())) } else { None })
        .collect();
    if !forces.is_empty() {
        drive.refine(fineness.force.max(drive.parts));
    }
    let disturbances: Vec<(usize, Vec<f64>)> = actions
        .iter()
        .filter_map(|action| match action {
            Action::Disturbance(port, of) => {
                Some((*port, (0..samples).map(|k| of(t0 + k as f64 / plant.rate)).collect()))
            }
            _ => None,
        })
        .collect();
    let stiffness: Vec<_> =
        actions.iter().filter_map(|action| if let Action::Stiffness(of) = action { Some(of) } else { None }).collect();
    let factor = |t: f64| stiffness.iter().map(|of| of(t)).product::<f64>();

    let mut runner = Runner::new(plant, drive.parts, &forces, &disturbances);
    if let Some(start) = start {
        runner.start(start);
    }
    let mut y = vec![vec![0.0; samples]; plant.p];
    let factors: Vec<f64> = if stiffness.is_empty() {
        Vec::new()
    } else {
        let middle = |k: usize| t0 + (k as f64 + 0.5) * fineness.drift as f64 / plant.rate;
        (0..samples.div_ceil(fineness.drift)).map(|k| factor(middle(k))).collect()
    };
    advance(&mut runner, plant, &drive, &disturbances, &factors, fineness.drift, &mut y);
    for action in actions {
        if let Action::Sensor(sensor) = action {
            sensor.apply(&mut y, t0, plant.rate);
        }
    }
    y
}

/// All samples. The loops over modes are short, and gain by wide registers.
#[multiversion::multiversion(targets("x86_64+avx2+fma", "x86_64+avx512f+avx512vl+avx2+fma"))]
fn advance(
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
        for part in 0..drive.parts {
            let at = k * drive.parts + part;
            let same = part > 0 && held.iter().zip(&drive.u).all(|(h, u)| *h == u[at]);
            if !same {
                held.iter_mut().zip(&drive.u).for_each(|(h, u)| *h = u[at]);
                runner.hold(&held);
            }
            if part == 0 {
                runner.sample(drive, k);
                // Sampled before the next value of a disturbance acts, which an accelerometer without a filter would show.
                runner.output(&held, y, k);
                for (d, (_, signal)) in disturbances.iter().enumerate() {
                    runner.push(d, signal[k]);
                }
            }
            runner.step(part + 1 == drive.parts);
        }
    }
}

fn changed_plant(plant: &Plant, actions: &[Action]) -> Option<Plant> {
    let mut changed = None;
    for action in actions {
        if let Action::Plant(change) = action {
            change(changed.get_or_insert_with(|| plant.clone()));
        }
    }
    changed
}

/// A port's numbers over one part of a sample.
struct Bound<'a> {
    law: &'a dyn Force,
    /// Its number in the plant.
    port: usize,
    state: f64,
    /// d and v now, and the displacement to which the internal state belongs (the predictor's).
    d: f64,
    v: f64,
    path: f64,
    /// What a unit force adds over a part (held), and what a ramp from 0 to 1 adds.
    held_re: Vec<f64>,
    held_im: Vec<f64>,
    ramp_re: Vec<f64>,
    ramp_im: Vec<f64>,
    held_rest: DVector<f64>,
    ramp_rest: DVector<f64>,
    d_re: Vec<f64>,
    d_im: Vec<f64>,
    v_re: Vec<f64>,
    v_im: Vec<f64>,
    d_rest: DVector<f64>,
    v_rest: DVector<f64>,
    output: Vec<f64>,
}

/// The plant at the step of one part of a sample, with its state. Complex numbers lie apart, so that loops over modes vectorise.
struct Runner<'a> {
    poles_re: Vec<f64>,
    poles_im: Vec<f64>,
    /// m blocks of modes.
    b_re: Vec<Vec<f64>>,
    b_im: Vec<Vec<f64>>,
    /// p blocks of modes, already doubled.
    c_re: Vec<Vec<f64>>,
    c_im: Vec<Vec<f64>>,
    rest: RestSteps,
    d: DMatrix<f64>,
    /// What the held input (and disturbances) add over a part.
    in_re: Vec<f64>,
    in_im: Vec<f64>,
    in_rest: Vec<f64>,
    held_in_re: Vec<f64>,
    held_in_im: Vec<f64>,
    held_in_rest: Vec<f64>,
    z_re: Vec<f64>,
    z_im: Vec<f64>,
    x: Vec<f64>,
    next: Vec<f64>,
    ports: Vec<Bound<'a>>,
    /// What a unit of each disturbance adds over a part.
    pushes: Vec<Push>,
    pushed: Vec<f64>,
    /// Of each port: the force before a part, then its change.
    forces: Vec<f64>,
    step: f64,
}

/// A disturbance at a port: what a unit adds over a part to the modes, to the rest and at once to the outputs.
struct Push {
    /// Its number in the plant.
    port: usize,
    modal: Vec<C>,
    rest: DVector<f64>,
    output: Vec<f64>,
}

/// How the rest steps: at each part where its continuous time is known, otherwise once a sample with the mean input.
struct RestSteps {
    a: DMatrix<f64>,
    b: DMatrix<f64>,
    c: DMatrix<f64>,
    each_part: bool,
}

impl<'a> Runner<'a> {
    fn new(plant: &Plant, parts: usize, forces: &[(usize, &'a dyn Force)], disturbances: &[(usize, Vec<f64>)]) -> Self {
        let step = 1.0 / (plant.rate * parts as f64);
        let (q, r, m) = (plant.modes.len(), plant.rest.a.nrows(), plant.m);
        let turn: Vec<C> = plant.modes.iter().map(|mode| (mode.pole * step).exp()).collect();
        let held: Vec<C> = plant.modes.iter().map(|mode| phi1(mode.pole * step) * step).collect();
        let b: Vec<Vec<C>> = (0..m).map(|i| (0..q).map(|k| held[k] * plant.modes[k].b[i]).collect()).collect();
        let each_part = parts == 1 || plant.rest.continuous.is_some();
        let rest = match &plant.rest.continuous {
            Some((a, b)) if parts > 1 => {
                let (a, b, _) = held_and_ramp(a, b, step);
                RestSteps { a, b, c: plant.rest.c.clone(), each_part }
            }
            _ => RestSteps { a: plant.rest.a.clone(), b: plant.rest.b.clone(), c: plant.rest.c.clone(), each_part },
        };
        let ports = forces.iter().map(|&(port, law)| bind(plant, port, law, step, &held)).collect();
        let pushes = disturbances
            .iter()
            .map(|&(port, _)| {
                let of = &plant.ports[port];
                let modal = (0..q).map(|k| held[k] * of.force[k]).collect();
                let (rest, _) = rest_force(plant, &of.force_rest, step);
                Push { port, modal, rest, output: of.output.clone() }
            })
            .collect();
        let parts_of = |values: &[Vec<C>], of: fn(&C) -> f64| -> Vec<Vec<f64>> {
            values.iter().map(|row| row.iter().map(of).collect()).collect()
        };
        let c: Vec<Vec<C>> = (0..plant.p).map(|o| plant.modes.iter().map(|mode| 2.0 * mode.c[o]).collect()).collect();
        Self {
            poles_re: turn.iter().map(|z| z.re).collect(),
            poles_im: turn.iter().map(|z| z.im).collect(),
            b_re: parts_of(&b, |z| z.re),
            b_im: parts_of(&b, |z| z.im),
            c_re: parts_of(&c, |z| z.re),
            c_im: parts_of(&c, |z| z.im),
            rest,
            d: plant.d.clone(),
            in_re: vec![0.0; q],
            in_im: vec![0.0; q],
            in_rest: vec![0.0; r],
            held_in_re: vec![0.0; q],
            held_in_im: vec![0.0; q],
            held_in_rest: vec![0.0; r],
            z_re: vec![0.0; q],
            z_im: vec![0.0; q],
            x: vec![0.0; r],
            next: vec![0.0; r],
            ports,
            pushes,
            pushed: vec![0.0; disturbances.len()],
            forces: vec![0.0; forces.len()],
            step,
        }
    }

    fn start(&mut self, state: &State) {
        for (k, z) in state.modes.iter().enumerate() {
            (self.z_re[k], self.z_im[k]) = (z.re, z.im);
        }
        self.x.copy_from_slice(&state.rest);
        for j in 0..self.ports.len() {
            let (d, v) = self.seen(j);
            (self.ports[j].d, self.ports[j].v, self.ports[j].path) = (d, v, d);
        }
    }

    /// Every w^2 times `factor`: the force 2 zeta w q' stays, so the real part of each pole does, and a mode's rows go with its pole.
    /// What lies before and behind the structure is taken as at the old pole.
    fn stiffen(&mut self, plant: &Plant, factor: f64) {
        for (k, mode) in plant.modes.iter().enumerate() {
            let from = mode.pole;
            let square = from.norm_sqr() * factor - from.re * from.re;
            let pole = C::new(from.re, square.max(1e-6 * from.norm_sqr()).sqrt());
            let rows = Carried::new(from, pole);
            let turn = (pole * self.step).exp();
            let held = phi1(pole * self.step) * self.step;
            let ramp = phi2(pole * self.step) * self.step;
            (self.poles_re[k], self.poles_im[k]) = (turn.re, turn.im);
            for i in 0..plant.m {
                let b = held * mode.b[i];
                (self.b_re[i][k], self.b_im[i][k]) = (b.re, b.im);
            }
            for o in 0..plant.p {
                let c = 2.0 * mode.c[o] * rows.acceleration;
                (self.c_re[o][k], self.c_im[o][k]) = (c.re, c.im);
            }
            for to in &mut self.ports {
                let port = &plant.ports[to.port];
                let (held, ramp) = (held * port.force[k], ramp * port.force[k]);
                let d = 2.0 * port.displacement[k] * rows.displacement;
                let v = 2.0 * port.velocity[k] * rows.velocity;
                (to.held_re[k], to.held_im[k]) = (held.re, held.im);
                (to.ramp_re[k], to.ramp_im[k]) = (ramp.re, ramp.im);
                (to.d_re[k], to.d_im[k]) = (d.re, d.im);
                (to.v_re[k], to.v_im[k]) = (v.re, v.im);
            }
            for push in &mut self.pushes {
                push.modal[k] = held * plant.ports[push.port].force[k];
            }
        }
        for j in 0..self.ports.len() {
            (self.ports[j].d, self.ports[j].v) = self.seen(j);
        }
    }

    /// A new held input.
    #[inline(always)]
    fn hold(&mut self, u: &[f64]) {
        self.held_in_re.fill(0.0);
        self.held_in_im.fill(0.0);
        for (i, &u) in u.iter().enumerate() {
            add(&mut self.held_in_re, &self.b_re[i], u);
            add(&mut self.held_in_im, &self.b_im[i], u);
        }
        if self.rest.each_part {
            multiply(&mut self.held_in_rest, &self.rest.b, u);
        }
        self.renew();
    }

    #[inline(always)]
    fn renew(&mut self) {
        self.in_re.copy_from_slice(&self.held_in_re);
        self.in_im.copy_from_slice(&self.held_in_im);
        self.in_rest.copy_from_slice(&self.held_in_rest);
        for (push, &value) in self.pushes.iter().zip(&self.pushed) {
            for (k, g) in push.modal.iter().enumerate() {
                self.in_re[k] += g.re * value;
                self.in_im[k] += g.im * value;
            }
            if self.rest.each_part {
                add(&mut self.in_rest, push.rest.as_slice(), value);
            }
        }
    }

    /// A new value of a disturbance.
    #[inline(always)]
    fn push(&mut self, disturbance: usize, value: f64) {
        self.pushed[disturbance] = value;
        self.renew();
    }

    /// Where the rest steps once a sample: its mean input.
    fn sample(&mut self, drive: &Drive, k: usize) {
        if self.rest.each_part {
            return;
        }
        let mean: Vec<f64> = drive
            .u
            .iter()
            .map(|u| u[k * drive.parts..(k + 1) * drive.parts].iter().sum::<f64>() / drive.parts as f64)
            .collect();
        multiply(&mut self.held_in_rest, &self.rest.b, &mean);
        self.in_rest.copy_from_slice(&self.held_in_rest);
    }

    #[inline(always)]
    fn output(&self, u: &[f64], y: &mut [Vec<f64>], sample: usize) {
        for (o, channel) in y.iter_mut().enumerate() {
            let mut sum = dot(&self.c_re[o], &self.z_re) - dot(&self.c_im[o], &self.z_im);
            for (j, x) in self.x.iter().enumerate() {
                sum += self.rest.c[(o, j)] * x;
            }
            for (i, u) in u.iter().enumerate() {
                sum += self.d[(o, i)] * u;
            }
            for port in &self.ports {
                if let Some(gain) = port.output.get(o) {
                    sum += gain * port.law.force(port.d, port.v, port.state);
                }
            }
            for (push, value) in self.pushes.iter().zip(&self.pushed) {
                sum += push.output.get(o).map_or(0.0, |gain| gain * value);
            }
            channel[sample] = sum;
        }
    }

    #[inline(always)]
    fn seen(&self, j: usize) -> (f64, f64) {
        let port = &self.ports[j];
        let row = |re: &[f64], im: &[f64], rest: &DVector<f64>| {
            dot(re, &self.z_re) - dot(im, &self.z_im) + dot(rest.as_slice(), &self.x)
        };
        (row(&port.d_re, &port.d_im, &port.d_rest), row(&port.v_re, &port.v_im, &port.v_rest))
    }

    /// One part of a sample.
    #[inline(always)]
    fn step(&mut self, last: bool) {
        for (force, port) in self.forces.iter_mut().zip(&self.ports) {
            *force = port.law.force(port.d, port.v, port.state);
        }
        for k in 0..self.z_re.len() {
            let (re, im) = (self.z_re[k], self.z_im[k]);
            self.z_re[k] = self.poles_re[k] * re - self.poles_im[k] * im + self.in_re[k];
            self.z_im[k] = self.poles_re[k] * im + self.poles_im[k] * re + self.in_im[k];
        }
        let rest_steps = self.rest.each_part || last;
        if rest_steps {
            multiply(&mut self.next, &self.rest.a, &self.x);
            std::mem::swap(&mut self.x, &mut self.next);
            add(&mut self.x, &self.in_rest, 1.0);
        }
        if self.ports.is_empty() {
            return;
        }
        for (port, &force) in self.ports.iter().zip(&self.forces) {
            add(&mut self.z_re, &port.held_re, force);
            add(&mut self.z_im, &port.held_im, force);
            if self.rest.each_part {
                add(&mut self.x, port.held_rest.as_slice(), force);
            }
        }
        for j in 0..self.ports.len() {
            let (d, v) = self.seen(j);
            let port = &mut self.ports[j];
            port.state = port.law.advance(port.path, d, port.state);
            port.path = d;
            self.forces[j] = port.law.force(d, v, port.state) - self.forces[j];
        }
        for (port, &change) in self.ports.iter().zip(&self.forces) {
            add(&mut self.z_re, &port.ramp_re, change);
            add(&mut self.z_im, &port.ramp_im, change);
            if self.rest.each_part {
                add(&mut self.x, port.ramp_rest.as_slice(), change);
            }
        }
        for j in 0..self.ports.len() {
            let (d, v) = self.seen(j);
            let port = &mut self.ports[j];
            (port.d, port.v) = (d, v);
        }
    }
}

fn bind<'a>(plant: &Plant, number: usize, law: &'a dyn Force, step: f64, held: &[C]) -> Bound<'a> {
    let port = &plant.ports[number];
    let q = plant.modes.len();
    let re = |values: &[C]| values.iter().map(|z| z.re).collect::<Vec<f64>>();
    let im = |values: &[C]| values.iter().map(|z| z.im).collect::<Vec<f64>>();
    let doubled = |values: &[C]| values.iter().map(|z| 2.0 * z).collect::<Vec<C>>();
    let hold: Vec<C> = (0..q).map(|k| held[k] * port.force[k]).collect();
    let ramp: Vec<C> = (0..q).map(|k| phi2(plant.modes[k].pole * step) * step * port.force[k]).collect();
    let (displacement, velocity) = (doubled(&port.displacement), doubled(&port.velocity));
    let (held_rest, ramp_rest) = rest_force(plant, &port.force_rest, step);
    Bound {
        law,
        port: number,
        state: 0.0,
        d: 0.0,
        v: 0.0,
        path: 0.0,
        held_re: re(&hold),
        held_im: im(&hold),
        ramp_re: re(&ramp),
        ramp_im: im(&ramp),
        held_rest,
        ramp_rest,
        d_re: re(&displacement),
        d_im: im(&displacement),
        v_re: re(&velocity),
        v_im: im(&velocity),
        d_rest: port.displacement_rest.clone(),
        v_rest: port.velocity_rest.clone(),
        output: port.output.clone(),
    }
}

/// What a held force and a ramp from 0 to 1 add to the rest over a step.
fn rest_force(plant: &Plant, force: &DVector<f64>, step: f64) -> (DVector<f64>, DVector<f64>) {
    let r = force.len();
    match &plant.rest.continuous {
        Some((a, _)) if r > 0 => {
            let column = DMatrix::from_column_slice(r, 1, force.as_slice());
            let (_, held, ramp) = held_and_ramp(a, &column, step);
            (held.column(0).into_owned(), ramp.column(0).into_owned())
        }
        _ => (DVector::zeros(r), DVector::zeros(r)),
    }
}

/// e^{A h}, int e^{A (h - s)} B ds and int e^{A (h - s)} B s / h ds, from one exponential (Van Loan, IEEE TAC 23, 1978).
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

/// (e^x - 1) / x.
fn phi1(x: C) -> C {
    if x.norm() < 1e-3 { C::ONE + x * (0.5 + x / 6.0 * (1.0 + x / 4.0)) } else { (x.exp() - 1.0) / x }
}

/// (e^x - 1 - x) / x^2.
fn phi2(x: C) -> C {
    if x.norm() < 1e-2 {
        C::from(0.5) + x / 6.0 * (C::ONE + x / 4.0 * (C::ONE + x / 5.0 * (C::ONE + x / 6.0)))
    } else {
        (x.exp() - 1.0 - x) / (x * x)
    }
}

#[inline(always)]
fn add(to: &mut [f64], from: &[f64], factor: f64) {
    for (t, f) in to.iter_mut().zip(from) {
        *t += f * factor;
    }
}

#[inline(always)]
fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// to = matrix * from.
#[inline(always)]
fn multiply(to: &mut [f64], matrix: &DMatrix<f64>, from: &[f64]) {
    to.fill(0.0);
    let rows = matrix.nrows();
    for (j, &x) in from.iter().enumerate() {
        add(to, &matrix.as_slice()[j * rows..(j + 1) * rows], x);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::Effect;
    use crate::testing;

    fn run(plant: &Plant, seed: u64) -> Channels {
        simulate(plant, &[], &testing::random_input(seed, 600, 2), 0.0, None, Fineness::FINE)
    }

    fn state_space(model: &plid_model::Model, seed: u64) -> Channels {
        let u = testing::random_input(seed, 600, 2);
        let inputs = ndarray::Array2::from_shape_fn((600, 2), |(k, i)| u[i][k]);
        let y = plid_model::simulate(model, inputs.view(), &model.rest()).unwrap().outputs;
        crate::case::columns(&y)
    }

    /// Relative to the expected RMS.
    fn difference(found: &Channels, expected: &Channels) -> f64 {
        let error: Vec<f64> = found.iter().flatten().zip(expected.iter().flatten()).map(|(a, b)| a - b).collect();
        crate::record::rms(&error) / crate::record::rms(expected.iter().flatten())
    }

    /// The modal simulation is the simulation: against x+ = A x + B u in its own basis.
    #[test]
    fn without_effects_it_is_the_state_space_simulation() {
        for seed in 0..3 {
            let model = testing::truss(seed);
            let far = difference(&run(&Plant::new(&model).unwrap(), seed), &state_space(&model, seed));
            assert!(far < 1e-6, "{far}");
        }
    }

    /// A mode moved or reshaped in the modal form, against a structure built with that mode.
    #[test]
    fn a_changed_mode_is_a_structure_built_so() {
        let nominal = Plant::new(&testing::truss(1)).unwrap();
        let (hz, zeta) = testing::MODES[2];
        let mut moved = nominal.clone();
        let w = std::f64::consts::TAU * hz * 1.03;
        let zeta_moved = 1.5 * zeta;
        moved.move_pole(2, C::new(-zeta_moved * w, w * (1.0 - zeta_moved * zeta_moved).sqrt()));
        let built = testing::truss_with(1, |modes, _, _| modes[2] = (1.03 * hz, zeta_moved));
        let far = difference(&run(&moved, 5), &state_space(&built, 5));
        assert!(far < 1e-5, "{far}");

        let mut shaped = nominal.clone();
        shaped.change(1, |mode| mode.b[0] *= 1.1);
        let built = testing::truss_with(1, |_, beta, _| beta[(1, 0)] *= 1.1);
        let far = difference(&run(&shaped, 6), &state_space(&built, 6));
        assert!(far < 1e-5, "{far}");

        let mut more = Plant::new(&testing::truss_with(1, |_, beta, _| beta.row_mut(2).fill(0.0))).unwrap();
        let (mut b, mut c) = (vec![0.0; 2], vec![0.0; 2]);
        let whole = testing::truss_with(1, |_, beta, gamma| {
            b = beta.row(2).iter().copied().collect();
            c = gamma.column(2).iter().copied().collect();
        });
        let w = std::f64::consts::TAU * hz;
        more.add_mode(C::new(-zeta * w, w * (1.0 - zeta * zeta).sqrt()), &b, &c);
        let far = difference(&run(&more, 7), &state_space(&whole, 7));
        assert!(far < 1e-5, "{far}");
    }

    /// Where sensors stand at the struts, the inferred ports are the declared ones, whatever the force.
    #[test]
    fn inferred_ports_answer_as_declared_ones() {
        let mut model = testing::truss_with(2, |_, beta, gamma| *gamma = beta.transpose() * 0.05);
        let u = testing::random_input(3, 600, 2);
        let declared = Plant::new(&model).unwrap();
        model.ports.clear();
        let inferred = Plant::new(&model).unwrap();
        let effect = crate::effects::CubicStiffness;
        let respond = |plant: &Plant, k: f64| {
            let setting = crate::prepare::tests::setting_of(plant, &model);
            let actions = effect.act(&setting, &crate::effects::Place::Input(0), &[k]);
            let with = simulate(plant, &actions, &u, 0.0, None, Fineness::FINE);
            let without = simulate(plant, &[], &u, 0.0, None, Fineness::FINE);
            let change: Channels =
                with.iter().zip(&without).map(|(a, b)| a.iter().zip(b).map(|(a, b)| a - b).collect()).collect();
            change
        };
        // Displacements are in other units there: sensors are 0.05 of the shapes.
        let k = 1e12;
        let expected = respond(&declared, k);
        let best = (0..400)
            .map(|j| difference(&respond(&inferred, k * 10_f64.powf(f64::from(j) / 50.0 - 4.0)), &expected))
            .fold(f64::INFINITY, f64::min);
        assert!(best < 0.05, "{best}");
    }
}
