//! The linear maps of a block, which consists of all parts of a sample or of some of them.
//!
//! A force depends only on the motion at its port, not on the modes themselves. The motion at the ends of all parts
//! is the motion without forces, which is one product with the state, plus the responses to the forces of the parts
//! so far, which are a few numbers. Another product then adds the response of the state to the forces. The modes are
//! thus visited once per block and not in every part.

use std::ops::Range;

use nalgebra::{DMatrix, DVector};

use crate::plant::{Carried, Plant, phi1};
use crate::simulate::lanes::{self, Quad, Rows, WIDE};
use plid_fourier::C;

/// The time-stepped system: a plant over blocks, with forces and disturbances at ports, which are given by their
/// numbers.
pub struct Block {
    /// Number of parts of a block.
    pub parts: usize,
    /// Number of parts over which a value of the command is held.
    each: usize,
    /// Length of a part in s.
    step: f64,
    forces: Vec<usize>,
    pushes: Vec<usize>,
    rest: RestStep,
    /// Whether the rest is stepped once per sample, with its mean input, because its continuous form is not known.
    pub late: bool,
    /// Numbers of modes and of states of the rest.
    modes: usize,
    states: usize,
}

/// The step of the rest over a part.
struct RestStep {
    a: DMatrix<f64>,
    /// Increments due to a held unit and due to a ramp from 0 to 1, for each input, then for each force and each
    /// disturbance.
    held: DMatrix<f64>,
    ramp: DMatrix<f64>,
}

/// The maps of a block for given poles. A motion is that of all ports: for each port, the displacements at the ends
/// of all parts, then the velocities. Forces are stored in the same order: for each port, the values that are held
/// over the parts, then the changes over them.
pub struct Maps {
    /// Factors of the modes' states over a block.
    pub turn: Vec<Quad>,
    /// State matrix of the rest over a block.
    pub rest: Rows,
    /// Increments of the state and then of the motion due to the values of each input.
    pub driven: Rows,
    /// For each disturbance, the same increments due to a held unit.
    pub pushed: Vec<Vec<Quad>>,
    /// Outputs from the state.
    pub outputs: Rows,
    /// Displacement and velocity at each port from the state.
    pub seen: Rows,
    /// Motion from the state.
    pub motion: Rows,
    /// Increment of the state from the forces.
    pub forces: Rows,
    /// For each force and each part, the motion due to a held unit, and due to a change by one.
    pub held: Vec<Vec<Quad>>,
    pub ramp: Vec<Vec<Quad>>,
}

/// A column or a row of the states.
#[derive(Clone)]
struct States {
    modes: Vec<C>,
    rest: DVector<f64>,
}

impl States {
    fn new(modes: Vec<C>, rest: DVector<f64>) -> Self {
        Self { modes, rest }
    }

    /// Returns the real part of the product of a row with a column.
    fn dot(&self, column: &Self) -> f64 {
        self.modes.iter().zip(&column.modes).map(|(a, b)| (a * b).re).sum::<f64>() + self.rest.dot(&column.rest)
    }

    fn add(&mut self, other: &Self) {
        self.modes.iter_mut().zip(&other.modes).for_each(|(sum, more)| *sum += more);
        self.rest += &other.rest;
    }

    fn subtract(&mut self, other: &Self) {
        self.modes.iter_mut().zip(&other.modes).for_each(|(sum, less)| *sum -= less);
        self.rest -= &other.rest;
    }

    /// Returns `count` states: the present one, and that after each further part.
    fn turned(self, turn: &[C], a: &DMatrix<f64>, count: usize) -> Vec<Self> {
        let next = |at: &Self| {
            let modes = at.modes.iter().zip(turn).map(|(z, turn)| z * turn).collect();
            Some(Self::new(modes, a * &at.rest))
        };
        std::iter::successors(Some(self), next).take(count).collect()
    }
}

impl Block {
    /// Returns a block of a plant. The numbers are those of the blocks of a sample, of the values of the command in
    /// each block, and of the parts over which each value is held.
    pub fn new(plant: &Plant, [blocks, values, each]: [usize; 3], forces: Vec<usize>, pushes: Vec<usize>) -> Self {
        let (parts, all) = (values * each, blocks * values * each);
        let step = 1.0 / (plant.rate * all as f64);
        let at: Vec<usize> = forces.iter().chain(&pushes).copied().collect();
        let rest = RestStep::new(plant, all, step, &at);
        let late = plant.rest.continuous.is_none() && all > 1;
        Self { parts, each, step, forces, pushes, rest, late, modes: plant.modes.len(), states: plant.rest.a.nrows() }
    }

    /// Returns the number of lanes of the modes.
    pub fn mode_lanes(&self) -> usize {
        2 * self.modes.div_ceil(WIDE)
    }

    /// Returns the number of lanes of the state.
    pub fn state_lanes(&self) -> usize {
        self.mode_lanes() + self.states.div_ceil(WIDE)
    }

    /// Returns the number of lanes of a motion.
    pub fn motion_lanes(&self) -> usize {
        2 * self.forces.len() * self.parts.div_ceil(WIDE)
    }

    /// Returns the index of a displacement in a motion, and of a held value among the forces.
    pub fn d(&self, port: usize, part: usize) -> usize {
        2 * port * self.parts.next_multiple_of(WIDE) + part
    }

    /// Returns the index of a velocity in a motion, and of a change among the forces.
    pub fn v(&self, port: usize, part: usize) -> usize {
        (2 * port + 1) * self.parts.next_multiple_of(WIDE) + part
    }

    /// Returns a state in lanes.
    pub fn state(&self, modes: &[C], rest: &[f64]) -> Vec<Quad> {
        self.in_lanes(modes, rest, 1.0)
    }

    /// Returns a state or a row in lanes. Four real parts are followed by the four imaginary parts, and all modes by
    /// the rest.
    fn in_lanes(&self, modes: &[C], rest: &[f64], sign: f64) -> Vec<Quad> {
        let mut lanes = lanes::zeros(WIDE * self.state_lanes());
        for (k, z) in modes.iter().enumerate() {
            let four = &mut lanes[2 * (k / WIDE)..];
            (four[0].0[k % WIDE], four[1].0[k % WIDE]) = (z.re, sign * z.im);
        }
        let first = WIDE * self.mode_lanes();
        rest.iter().enumerate().for_each(|(j, x)| *lanes::get_mut(&mut lanes, first + j) = *x);
        lanes
    }

    fn rows(&self, rows: &[States]) -> Rows {
        let rows: Vec<Vec<Quad>> =
            rows.iter().map(|row| self.in_lanes(&row.modes, row.rest.as_slice(), -1.0)).collect();
        Rows::new(rows.len(), WIDE * self.state_lanes(), |i, j| lanes::get(&rows[i], j))
    }

    /// Returns the maps of a plant whose modes have these poles, with the factors on their rows.
    pub fn maps(&self, plant: &Plant, poles: &[(C, Carried)]) -> Maps {
        let turn: Vec<C> = poles.iter().map(|(pole, _)| (pole * self.step).exp()).collect();
        let ports: Vec<[States; 2]> = self.forces.iter().map(|&number| seen(plant, number, poles)).collect();
        let whole: Vec<C> = poles.iter().map(|(pole, _)| (pole * self.step * self.parts as f64).exp()).collect();
        let mut rest = self.rest.a.clone();
        (1..self.parts).for_each(|_| rest = &rest * &self.rest.a);
        let mut maps = Maps {
            turn: self.in_lanes(&whole, &[], 1.0),
            rest: Rows::new(self.states, self.states, |i, j| rest[(i, j)]),
            driven: Rows::default(),
            pushed: Vec::new(),
            outputs: self.rows(&outputs(plant, poles)),
            seen: self.rows(&ports.concat()),
            motion: self.motion(&ports, &turn),
            forces: Rows::default(),
            held: Vec::new(),
            ramp: Vec::new(),
        };
        let unit = |modes, column: usize, parts: Range<usize>| {
            let states = self.by(modes, poles, phi1, self.rest.held.column(column).into_owned());
            self.driven(states, &ports, &turn, parts)
        };
        let inputs = |i: usize| plant.modes.iter().map(|mode| mode.b[i]).collect();
        let value = |i: usize| (0..self.parts).step_by(self.each).map(move |from| (i, from));
        let driven = (0..plant.m).flat_map(value).map(|(i, from)| unit(inputs(i), i, from..from + self.each));
        let driven: Vec<Vec<Quad>> = driven.collect();
        let rows = WIDE * (self.state_lanes() + self.motion_lanes());
        maps.driven = Rows::new(rows, driven.len(), |i, j| lanes::get(&driven[j], i));
        let first = plant.m + self.forces.len();
        let force = |number: usize| plant.ports[number].force.clone();
        let pushed = self.pushes.iter().zip(first..).map(|(&number, at)| unit(force(number), at, 0..self.parts));
        maps.pushed = pushed.collect();
        self.set_forces(plant, poles, &ports, &turn, &mut maps);
        maps
    }

    /// Returns the increment of the states over a part due to a unit that enters the modes with these factors.
    /// `weight` is `phi1` for a held unit, and `phi2` for a ramp.
    fn by(&self, modes: Vec<C>, poles: &[(C, Carried)], weight: fn(C) -> C, rest: DVector<f64>) -> States {
        let of = |(b, (pole, _)): (C, &(C, Carried))| weight(pole * self.step) * self.step * b;
        States::new(modes.into_iter().zip(poles).map(of).collect(), rest)
    }

    /// Returns the rows that give the motion from the state.
    fn motion(&self, ports: &[[States; 2]], turn: &[C]) -> Rows {
        let none = States::new(vec![C::ZERO; self.modes], DVector::zeros(self.states));
        let mut rows = vec![none; WIDE * self.motion_lanes()];
        let a = self.rest.a.transpose();
        for (port, [d, v]) in ports.iter().enumerate() {
            let later = |row: &States| row.clone().turned(turn, &a, self.parts + 1).into_iter().skip(1).enumerate();
            later(d).for_each(|(part, row)| rows[self.d(port, part)] = row);
            later(v).for_each(|(part, row)| rows[self.v(port, part)] = row);
            if self.late {
                // The rest is stepped before its contribution to the last motion is added.
                rows[self.d(port, self.parts - 1)].rest.fill(0.0);
                rows[self.v(port, self.parts - 1)].rest.fill(0.0);
            }
        }
        self.rows(&rows)
    }

    /// Returns the motion due to columns of the states, the first of which belongs to the part `from`, and each
    /// further one to the next part.
    fn moved(&self, ports: &[[States; 2]], columns: &[States], from: usize) -> Vec<Quad> {
        let mut motion = lanes::zeros(WIDE * self.motion_lanes());
        for (port, [d, v]) in ports.iter().enumerate() {
            for (part, column) in (from..self.parts).zip(columns) {
                *lanes::get_mut(&mut motion, self.d(port, part)) = d.dot(column);
                *lanes::get_mut(&mut motion, self.v(port, part)) = v.dot(column);
            }
        }
        motion
    }

    /// Returns the increments of the state and of the motion due to a unit that is held over some parts.
    fn driven(&self, over_a_part: States, ports: &[[States; 2]], turn: &[C], parts: Range<usize>) -> Vec<Quad> {
        let mut sums = over_a_part.turned(turn, &self.rest.a, self.parts - parts.start);
        for part in 1..sums.len() {
            let (before, at) = sums.split_at_mut(part);
            at[0].add(&before[part - 1]);
        }
        // After the end of the hold, the response to a unit that begins there is subtracted.
        for part in (parts.len()..sums.len()).rev() {
            let (before, at) = sums.split_at_mut(part);
            at[0].subtract(&before[part - parts.len()]);
        }
        let last = &sums[sums.len() - 1];
        [self.state(&last.modes, last.rest.as_slice()), self.moved(ports, &sums, parts.start)].concat()
    }

    /// Sets the responses of the state and of the motion to forces.
    fn set_forces(&self, plant: &Plant, poles: &[(C, Carried)], ports: &[[States; 2]], turn: &[C], to: &mut Maps) {
        let mut columns = vec![Vec::new(); WIDE * self.motion_lanes()];
        for (port, &number) in self.forces.iter().enumerate() {
            let force = &plant.ports[number].force;
            let by = |weight, rest: &DMatrix<f64>| {
                let rest = rest.column(plant.m + port).into_owned();
                self.by(force.clone(), poles, weight, rest).turned(turn, &self.rest.a, self.parts)
            };
            let (held, ramp) = (by(phi1, &self.rest.held), by(phi2, &self.rest.ramp));
            for part in 0..self.parts {
                let state = |by: &[States]| {
                    let last = &by[self.parts - 1 - part];
                    self.state(&last.modes, last.rest.as_slice())
                };
                columns[self.d(port, part)] = state(&held);
                columns[self.v(port, part)] = state(&ramp);
                to.held.push(self.moved(ports, &held, part));
                to.ramp.push(self.moved(ports, &ramp, part));
            }
        }
        let entry = |i: usize, j: usize| if columns[j].is_empty() { 0.0 } else { lanes::get(&columns[j], i) };
        to.forces = Rows::new(WIDE * self.state_lanes(), columns.len(), entry);
    }
}

impl RestStep {
    fn new(plant: &Plant, parts: usize, step: f64, ports: &[usize]) -> Self {
        let rest = &plant.rest;
        let (r, m) = rest.b.shape();
        let none = |columns: usize| DMatrix::zeros(r, columns);
        let force = DMatrix::from_fn(r, ports.len(), |i, j| plant.ports[ports[j]].force_rest[i]);
        let (mut a, mut held, ramp) = match &rest.continuous {
            Some((a, b)) if r > 0 && (parts > 1 || !ports.is_empty()) => {
                let both =
                    DMatrix::from_fn(r, m + ports.len(), |i, j| if j < m { b[(i, j)] } else { force[(i, j - m)] });
                held_and_ramp(a, &both, step)
            }
            _ => (DMatrix::identity(r, r), none(m + ports.len()), none(m + ports.len())),
        };
        if parts == 1 {
            a.copy_from(&rest.a);
            held.columns_mut(0, m).copy_from(&rest.b);
        }
        Self { a, held, ramp }
    }
}

/// Returns the rows of the outputs.
fn outputs(plant: &Plant, poles: &[(C, Carried)]) -> Vec<States> {
    let row = |o: usize| {
        let modes = plant.modes.iter().zip(poles);
        let modes = modes.map(|(mode, (_, rows))| 2.0 * mode.c[o] * rows.sensed(plant.sensed[o])).collect();
        States::new(modes, plant.rest.c.row(o).transpose())
    };
    (0..plant.p).map(row).collect()
}

/// Returns the rows of displacement and velocity at a port.
fn seen(plant: &Plant, number: usize, poles: &[(C, Carried)]) -> [States; 2] {
    let port = &plant.ports[number];
    let d = port.displacement.iter().zip(poles).map(|(d, (_, rows))| 2.0 * d * rows.displacement);
    let v = port.velocity.iter().zip(poles).map(|(v, (_, rows))| 2.0 * v * rows.velocity);
    [States::new(d.collect(), port.displacement_rest.clone()), States::new(v.collect(), port.velocity_rest.clone())]
}

/// Returns e^{A h}, int e^{A (h - s)} B ds and int e^{A (h - s)} B s / h ds, from one exponential (Van Loan, IEEE TAC
/// 23, 1978).
fn held_and_ramp(a: &DMatrix<f64>, b: &DMatrix<f64>, h: f64) -> (DMatrix<f64>, DMatrix<f64>, DMatrix<f64>) {
    let (r, m) = b.shape();
    let size = r + 2 * m;
    let mut whole = DMatrix::zeros(size, size);
    whole.view_mut((0, 0), (r, r)).copy_from(&(a * h));
    whole.view_mut((0, r), (r, m)).copy_from(&(b * h));
    whole.view_mut((r, r + m), (m, m)).fill_with_identity();
    let whole = plid_model::exponential(&whole);
    (
        whole.view((0, 0), (r, r)).into_owned(),
        whole.view((0, r), (r, m)).into_owned(),
        whole.view((0, r + m), (r, m)).into_owned(),
    )
}

/// Returns (e^x - 1 - x) / x^2.
fn phi2(x: C) -> C {
    if x.norm() < 1e-2 {
        C::from(0.5) + x / 6.0 * (C::ONE + x / 4.0 * (C::ONE + x / 5.0 * (C::ONE + x / 6.0)))
    } else {
        (x.exp() - 1.0 - x) / (x * x)
    }
}
