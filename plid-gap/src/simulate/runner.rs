//! Time stepping of the plant with the forces that depend on its motion. A diagnosis spends most of its time here.

use nalgebra::DMatrix;

use crate::case::record::Channels;
use crate::effects::{Drive, Force};
use crate::plant::{Carried, Plant};
use crate::simulate::between::Between;
use crate::simulate::block::{Block, Maps};
use crate::simulate::feedback::Feedback;
use crate::simulate::friction::{Part, Response};
use crate::simulate::lanes::{self, Lane, Quad, Rows, WIDE};
use crate::simulate::{State, blocks_of};
use plid_fourier::C;

/// The signals that differ between runs that are stepped together: the command and the disturbances.
pub struct Given {
    /// The command.
    pub drive: Drive,
    /// A value of each disturbance for each sample.
    pub disturbances: Vec<Vec<f64>>,
}

impl Given {
    /// Returns the time of a sample in s.
    fn time(&self, sample: usize) -> f64 {
        self.drive.t0 + sample as f64 / self.drive.rate
    }
}

/// Steps several runs through all samples. A part of a sample has to wait for its force; meanwhile the processor
/// works on the other runs. The loops over modes are short and benefit from wide registers.
#[multiversion::multiversion(targets("x86_64+avx2+fma"))]
pub fn advance<const R: usize>(
    runner: &mut Runner<R>,
    plant: &Plant,
    given: &[&Given; R],
    factors: &[f64],
    drift: usize,
    y: &mut [Channels; R],
) {
    let samples = y[0][0].len();
    let (blocks, values) = (runner.blocks, runner.values);
    let mut held = vec![[0.0; R]; plant.m * values];
    for k in 0..samples {
        if !factors.is_empty() && k % drift == 0 {
            runner.stiffen(plant, factors[k / drift]);
        }
        for block in 0..blocks {
            let first = (k * blocks + block) * values;
            let mut same = block > 0;
            if block == 0 {
                runner.close(given, y, k);
            }
            for (at, held) in held.iter_mut().enumerate() {
                let (i, value) = (at / values, at % values);
                let now = match &runner.feedback {
                    Some(feedback) => feedback.command(i, block * values + value),
                    None => std::array::from_fn(|r| given[r].drive.u[i][first + value]),
                };
                same = same && *held == now;
                *held = now;
            }
            if !same {
                runner.hold(&held);
            }
            if block == 0 {
                runner.sample(given, k);
                // The outputs are sampled before the next value of a disturbance acts. An accelerometer without a
                // filter would otherwise measure this value already.
                runner.output(&held, y, k);
                runner.feedback.iter_mut().for_each(|feedback| feedback.read(y, k, given.map(|given| given.time(k))));
                for d in 0..runner.pushes.len() {
                    runner.push(d, std::array::from_fn(|r| given[r].disturbances[d][k]));
                }
            }
            runner.step(block + 1 == blocks);
        }
    }
}

/// A plant that is stepped over blocks, with the states of its runs.
pub struct Runner<'a, const R: usize> {
    block: Block,
    /// Number of blocks of a sample, and of values of the command in a block.
    blocks: usize,
    values: usize,
    maps: Maps,
    late: Option<Late<R>>,
    feedback: Option<Feedback<'a, R>>,
    /// Direct feedthrough of the inputs.
    d: DMatrix<f64>,
    /// Increments of the state, and then of the motion, over a block: due to the held input alone, and due to it and
    /// the disturbances, if there are any.
    held: Vec<Lane<R>>,
    added: Vec<Lane<R>>,
    /// The values of the command in a block.
    command: Vec<Lane<R>>,
    state: Vec<Lane<R>>,
    motion: Vec<Lane<R>>,
    forces: Vec<Lane<R>>,
    /// The next state of the rest, and the outputs.
    next: Vec<Lane<R>>,
    shown: Vec<Lane<R>>,
    ports: Vec<Port<'a, R>>,
    pushes: Vec<Push<R>>,
}

/// The rest, if its continuous form is not known: it is stepped at the end of a sample with its mean input.
struct Late<const R: usize> {
    a: Rows,
    /// For each input, the increment due to a unit over a sample.
    b: Vec<Vec<Quad>>,
    held: Vec<Lane<R>>,
    /// The contribution of the rest to the motion at the end of a block.
    sees: Rows,
}

/// A port with the laws and the motion of each run.
struct Port<'a, const R: usize> {
    /// The law of each run.
    laws: [&'a dyn Force; R],
    /// Direct response of the outputs to a unit force.
    output: Vec<f64>,
    /// The motion in each run.
    moving: [Moving; R],
}

/// The motion of a port.
struct Moving {
    /// State of the law.
    state: Vec<f64>,
    /// Displacement and velocity now, and the displacement to which the law's state belongs (that of the predictor).
    d: f64,
    v: f64,
    path: f64,
    /// Largest magnitudes of displacement and velocity so far.
    most: [f64; 2],
    /// Friction that can hold the port.
    hold: Option<Hold>,
}

/// Dry friction that holds a port at rest.
#[derive(Clone, Copy)]
struct Hold {
    /// The largest force.
    most: f64,
    /// Whether the port is at rest.
    stuck: bool,
    /// The force that holds the port, or with which it slides off.
    force: f64,
    /// The linear change of the force over a part in which it switches.
    change: f64,
    /// The share of a part, up to its end, in which the port slides.
    slides: f64,
}

/// A disturbance at a port: its value in each run, and the direct response of the outputs to a unit.
struct Push<const R: usize> {
    value: [f64; R],
    output: Vec<f64>,
}

impl<'a, const R: usize> Runner<'a, R> {
    /// Returns a runner at rest, with a given number of values of the command in a sample, each of which is held over
    /// a given number of parts. The forces of all runs act at the same ports. The effects between a controller and the
    /// plant are those of each run.
    pub fn new(
        plant: &'a Plant,
        (values, parts): (usize, usize),
        forces: [&[(usize, &'a dyn Force)]; R],
        disturbances: &[usize],
        between: [Between<'a>; R],
    ) -> Self {
        let feedback = Feedback::new(plant, between, values);
        let ports: Vec<usize> = forces[0].iter().map(|(port, _)| *port).collect();
        let blocks = blocks_of(plant, (values, parts), !ports.is_empty());
        let values = values / blocks;
        let block = Block::new(plant, [blocks, values, parts], ports.clone(), disturbances.to_vec());
        let poles: Vec<_> = plant.modes.iter().map(|mode| (mode.pole, Carried::UNMOVED)).collect();
        let output = |number: &usize| plant.ports[*number].output.clone();
        let all = vec![[Quad::default(); R]; block.state_lanes() + block.motion_lanes()];
        let (state, motion) = all.split_at(block.state_lanes());
        Self {
            maps: block.maps(plant, &poles),
            late: block.late.then(|| Late::new(plant, &block, &ports)),
            feedback,
            d: plant.d.clone(),
            state: state.to_vec(),
            motion: motion.to_vec(),
            forces: motion.to_vec(),
            next: lanes::zeros_of(plant.rest.a.nrows()),
            shown: lanes::zeros_of(plant.p),
            ports: ports
                .iter()
                .enumerate()
                .map(|(j, port)| Port::new(forces.map(|laws| laws[j].1), output(port)))
                .collect(),
            pushes: disturbances.iter().map(|number| Push { value: [0.0; R], output: output(number) }).collect(),
            held: all.clone(),
            added: all,
            command: lanes::zeros_of(plant.m * values),
            block,
            blocks,
            values,
        }
    }

    /// Starts a run from a state.
    pub fn start(&mut self, run: usize, state: &State) {
        let lanes = self.block.state(&state.modes, &state.rest);
        self.state.iter_mut().zip(lanes).for_each(|(to, lane)| to[run] = lane);
        self.feedback.iter_mut().for_each(|feedback| feedback.start(run, &state.controller));
        self.see();
        for port in &mut self.ports {
            let moving = &mut port.moving[run];
            moving.path = moving.d;
            moving.hold.iter_mut().for_each(|hold| hold.stuck = moving.v == 0.0);
        }
    }

    /// Sets the motion of the ports to that of the state.
    fn see(&mut self) {
        let mut seen = lanes::zeros_of(2 * self.ports.len());
        self.maps.seen.add_times(&self.state, &mut seen);
        for (j, port) in self.ports.iter_mut().enumerate() {
            for (r, moving) in port.moving.iter_mut().enumerate() {
                (moving.d, moving.v) = (lanes::get_of(&seen, 2 * j, r), lanes::get_of(&seen, 2 * j + 1, r));
            }
        }
    }

    /// Multiplies every w^2 by `factor`. The force 2 zeta w q' does not change, and neither does the real part of
    /// each pole; a mode's rows follow its pole. The gains of actuators and filters remain those at the former pole.
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

    /// Computes the commands of a sample in closed loop.
    #[inline(always)]
    fn close(&mut self, given: &[&Given; R], y: &mut [Channels; R], sample: usize) {
        let Some(mut feedback) = self.feedback.take() else { return };
        self.output(&[], y, sample);
        let v = |r: usize, i: usize| given[r].drive.u[i][sample * given[r].drive.parts];
        feedback.find(v, y, sample, given.map(|given| given.time(sample)));
        self.feedback = Some(feedback);
    }

    /// Sets the values of the inputs in a block.
    #[inline(always)]
    fn hold(&mut self, u: &[[f64; R]]) {
        u.iter().enumerate().for_each(|(at, u)| lanes::set(&mut self.command, at, *u));
        self.held.fill([Quad::default(); R]);
        self.maps.driven.add_times(&self.command, &mut self.held);
        self.renew();
    }

    #[inline(always)]
    fn renew(&mut self) {
        if self.pushes.is_empty() {
            return;
        }
        self.added.copy_from_slice(&self.held);
        for (push, pushed) in self.pushes.iter().zip(&self.maps.pushed) {
            lanes::add_each(&mut self.added, pushed, push.value);
        }
    }

    /// Sets new values of a disturbance.
    #[inline(always)]
    fn push(&mut self, disturbance: usize, value: [f64; R]) {
        self.pushes[disturbance].value = value;
        self.renew();
    }

    /// Sets the mean input of a sample.
    #[inline(always)]
    fn sample(&mut self, given: &[&Given; R], k: usize) {
        let Some(late) = &mut self.late else { return };
        late.held.fill([Quad::default(); R]);
        for (r, given) in given.iter().enumerate() {
            let drive = &given.drive;
            let values = k * drive.parts..(k + 1) * drive.parts;
            for (i, (b, u)) in late.b.iter().zip(&drive.u).enumerate() {
                let mean = match &self.feedback {
                    Some(feedback) => feedback.mean(i, r),
                    None => u[values.clone()].iter().sum::<f64>() / drive.parts as f64,
                };
                lanes::add(&mut late.held, b, r, mean);
            }
        }
    }

    #[inline(always)]
    fn output(&mut self, u: &[[f64; R]], y: &mut [Channels; R], sample: usize) {
        self.shown.fill([Quad::default(); R]);
        self.maps.outputs.add_times(&self.state, &mut self.shown);
        for (r, y) in y.iter_mut().enumerate() {
            for (o, channel) in y.iter_mut().enumerate() {
                let mut sum = lanes::get_of(&self.shown, o, r);
                for (i, u) in u.iter().step_by(self.values).enumerate() {
                    sum += self.d[(o, i)] * u[r];
                }
                for port in &self.ports {
                    if let Some(gain) = port.output.get(o) {
                        sum += gain * port.moving[r].acting(port.laws[r]);
                    }
                }
                for push in &self.pushes {
                    sum += push.output.get(o).map_or(0.0, |gain| gain * push.value[r]);
                }
                channel[sample] = sum;
            }
        }
    }

    /// Steps by one block; the `last` block ends a sample.
    #[inline(always)]
    fn step(&mut self, last: bool) {
        let added = if self.pushes.is_empty() { &self.held } else { &self.added };
        let (to_state, to_motion) = added.split_at(self.state.len());
        if !self.ports.is_empty() {
            self.maps.motion.sum_times(to_motion, &self.state, &mut self.motion);
        }
        let modes = self.state.len() - self.next.len();
        let (modes, rest) = self.state.split_at_mut(modes);
        let (to_modes, to_rest) = to_state.split_at(modes.len());
        lanes::turn(modes, &self.maps.turn, to_modes);
        match &self.late {
            None => {
                self.maps.rest.sum_times(to_rest, rest, &mut self.next);
                rest.copy_from_slice(&self.next);
            }
            Some(late) => {
                if last {
                    late.a.sum_times(&late.held, rest, &mut self.next);
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

    /// Computes the forces of a part. Each force is first held over the part at its initial value. It then changes
    /// linearly to the value of its law for the motion at the end of the part.
    #[inline(always)]
    fn part(&mut self, part: usize) {
        let Self { block, maps, motion, forces, ports, .. } = self;
        for (j, port) in ports.iter().enumerate() {
            let acting = std::array::from_fn(|r| port.moving[r].acting(port.laws[r]));
            lanes::set(forces, block.d(j, part), acting);
            lanes::add_each(motion, &maps.held[j * block.parts + part], acting);
        }
        for (j, port) in ports.iter_mut().enumerate() {
            let (at_d, at_v) = (block.d(j, part), block.v(j, part));
            let at = j * block.parts + part;
            port.switch(motion, forces, [&maps.held[at], &maps.ramp[at]], [at_d, at_v]);
            let (d, v, held) = (lanes::all(motion, at_d), lanes::all(motion, at_v), lanes::all(forces, at_d));
            let change = std::array::from_fn(|r| {
                let (law, moving) = (port.laws[r], &mut port.moving[r]);
                law.advance(moving.path, d[r], &mut moving.state);
                moving.path = d[r];
                let (slides, force) = moving.hold.map_or((1.0, held[r]), |hold| (hold.slides, hold.force));
                let from = [moving.d, moving.v];
                if slides == 0.0 { 0.0 } else { slides * (law.at_end(from, [d[r], v[r]], &moving.state) - force) }
            });
            lanes::set(forces, at_v, change);
        }
        for j in 0..ports.len() {
            let change = lanes::all(forces, block.v(j, part));
            lanes::add_each(motion, &maps.ramp[j * block.parts + part], change);
        }
        for (j, port) in ports.iter_mut().enumerate() {
            let (at_d, at_v) = (block.d(j, part), block.v(j, part));
            for (r, moving) in port.moving.iter_mut().enumerate() {
                (moving.d, moving.v) = (lanes::get_of(motion, at_d, r), lanes::get_of(motion, at_v, r));
                if let Some(hold) = &moving.hold {
                    *lanes::get_mut_of(forces, at_v, r) += hold.change;
                    moving.v = if hold.stuck { 0.0 } else { moving.v };
                }
                moving.most = [moving.most[0].max(moving.d.abs()), moving.most[1].max(moving.v.abs())];
            }
        }
    }

    /// Returns the largest magnitudes of displacement and velocity at each port in a run.
    pub fn most(&self, run: usize) -> impl Iterator<Item = [f64; 2]> {
        self.ports.iter().map(move |port| port.moving[run].most)
    }
}

impl<const R: usize> Port<'_, R> {
    /// Lets friction hold a port, release it or bring it to rest, at the instant within the part at which it does so.
    /// `by` is the motion due to a unit held over the part, and due to a ramp to one.
    #[inline(always)]
    fn switch(&mut self, motion: &mut [Lane<R>], forces: &mut [Lane<R>], by: [&[Quad]; 2], at @ [at_d, _]: [usize; 2]) {
        for (r, moving) in self.moving.iter_mut().enumerate() {
            let Some(hold) = &mut moving.hold else { continue };
            let acting = lanes::get_of(forces, at_d, r);
            let to = at.map(|at| lanes::get_of(motion, at, r));
            let [held, ramp] = by.map(|by| at.map(|at| lanes::get(by, at)));
            let part = Part { from: [moving.d, moving.v], to, acting, stuck: hold.stuck };
            let Some(switched) = part.switched(hold.most, &Response { held, ramp }) else {
                *hold = Hold { force: acting, change: 0.0, slides: 1.0, ..*hold };
                continue;
            };
            hold.stuck = switched.slides == 0.0;
            (hold.force, hold.change, hold.slides) = (switched.force, switched.change, switched.slides);
            *lanes::get_mut_of(forces, at_d, r) = switched.start;
            lanes::add(motion, by[0], r, switched.start - acting);
            lanes::add(motion, by[1], r, switched.change);
        }
    }
}

impl<const R: usize> Late<R> {
    fn new(plant: &Plant, block: &Block, ports: &[usize]) -> Self {
        let rest = &plant.rest;
        let r = rest.a.nrows();
        let mut rows = vec![None; WIDE * block.motion_lanes()];
        for (j, number) in ports.iter().enumerate() {
            rows[block.d(j, block.parts - 1)] = Some(&plant.ports[*number].displacement_rest);
            rows[block.v(j, block.parts - 1)] = Some(&plant.ports[*number].velocity_rest);
        }
        Self {
            a: Rows::new(r, r, |i, j| rest.a[(i, j)]),
            b: rest.b.column_iter().map(|column| lanes::of(column.into_owned().as_slice())).collect(),
            held: lanes::zeros_of(r),
            sees: Rows::new(rows.len(), r, |i, j| rows[i].map_or(0.0, |row| row[j])),
        }
    }
}

impl<'a, const R: usize> Port<'a, R> {
    fn new(laws: [&'a dyn Force; R], output: Vec<f64>) -> Self {
        let hold =
            |law: &dyn Force| law.holds().map(|most| Hold { most, stuck: true, force: 0.0, change: 0.0, slides: 0.0 });
        let at_rest = |law: &dyn Force| Moving {
            state: vec![0.0; law.states()],
            d: 0.0,
            v: 0.0,
            path: 0.0,
            most: [0.0; 2],
            hold: hold(law),
        };
        let moving = laws.map(at_rest);
        Self { laws, output, moving }
    }
}

impl Moving {
    /// Returns the force that acts now.
    #[inline(always)]
    fn acting(&self, law: &dyn Force) -> f64 {
        match &self.hold {
            Some(hold) if hold.stuck => hold.force,
            _ => law.force(self.d, self.v, &self.state),
        }
    }
}
