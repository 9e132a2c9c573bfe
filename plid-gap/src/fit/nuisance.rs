//! The linear parameters with their Gaussian prior: frequency, damping ratio and shapes of every mode, or poles and
//! gains if there are no modes; and the initial states of records that do not start from rest. Changes within the prior
//! do not count as effects.

use crate::case::Limits;
use crate::case::record::Record;
use crate::fit::jacobian::Jacobian;
use crate::fourier::C;
use crate::plant::{Passed, Plant, RestNumber, Spectrum};
use crate::simulate::{Fineness, State, simulate};

/// Prior standard deviation of an initial state, relative to the state that the input excites: wide enough for the
/// record alone to determine the state.
const INITIAL_STATE_STD: f64 = 3.0;

/// Median of the absolute value of a standard normal variable.
const NORMAL_MEDIAN: f64 = 0.6745;

/// Relative step of a pole or gain of the rest, for differences of the outputs: four of their digits are then right.
const REST_STEP: f64 = 1e-4;

/// Relative step of a pole, for differences of the gain of actuators and filters: four of their digits are then right.
const POLE_STEP: f64 = 1e-4;

/// The linear parameters and their prior: frequency, damping, input shape (m) and output shape (p) of each mode,
/// followed by poles and gains of a simulation without modes, and by the initial states.
#[derive(Debug, Clone)]
pub struct Nuisance {
    m: usize,
    p: usize,
    modes: usize,
    rest: usize,
    /// Poles and gains of a simulation without modes.
    spectrum: Option<Spectrum>,
    /// The directions of each mode's shapes in the simulation as given.
    nominal: Vec<(C, C)>,
    /// Index of each record's initial state, if it is fitted.
    starts: Vec<Option<usize>>,
    /// RMS of each mode's state under the records' inputs, followed by the other states.
    sizes: Vec<f64>,
    /// Standard deviations of the prior.
    pub std: Vec<f64>,
    /// Whether a port follows the shapes of its input. The derivatives of the linear simulation leave out how that
    /// changes a force at the port, so only fits with the derivatives of the whole simulation set it.
    pub ports_follow: bool,
}

impl Nuisance {
    /// Lays out the parameters for a simulation and the records that are fitted.
    pub fn new(plant: &Plant, records: &[Record], limits: &Limits) -> Self {
        let (m, p, modes, rest) = (plant.m, plant.p, plant.modes.len(), plant.rest.a.nrows());
        let mut std = Vec::new();
        for _ in 0..modes {
            std.extend([limits.frequency / 2.0, limits.damping / 2.0]);
            std.extend(std::iter::repeat_n(limits.shape / 2.0, m + p));
        }
        let spectrum = Spectrum::of(plant);
        std.extend(spectrum.iter().flat_map(|spectrum| &spectrum.numbers).map(|number| match number {
            RestNumber::Frequency(_) => limits.frequency / 2.0,
            RestNumber::Rate(_) | RestNumber::Damping(_) => limits.damping / 2.0,
            RestNumber::Input(_) | RestNumber::Output(_) => limits.shape / 2.0,
        }));
        let starts = records
            .iter()
            .map(|record| {
                (!record.from_rest).then(|| {
                    let at = std.len();
                    std.extend(std::iter::repeat_n(INITIAL_STATE_STD, 2 * modes + rest));
                    at
                })
            })
            .collect();
        let sizes = state_sizes(plant, records);
        let nominal = plant.modes.iter().map(directions).collect();
        Self { m, p, modes, rest, spectrum, nominal, starts, sizes, std, ports_follow: false }
    }

    /// Widens the prior for a simulation that was itself estimated, by the standard deviations of its parameters.
    pub fn with_prior_std(mut self, prior_std: &[f64]) -> Self {
        self.std.iter_mut().zip(prior_std).for_each(|(std, prior)| *std = std.hypot(*prior));
        self
    }

    /// Returns the factor, at least one, by which the modes' parameters exceed their prior. It is estimated from the
    /// median of those that the records determine, which is insensitive to a few that an effect has moved. The records
    /// determine a parameter if its information, the prior included, exceeds that of the prior by the factor
    /// `determined`.
    pub fn needed(&self, eta: &[f64], jacobian: &Jacobian, determined: f64) -> f64 {
        let told = |k: &usize| jacobian.normal[(*k, *k)] * self.std[*k].powi(2) > determined;
        let mut off: Vec<f64> = (0..self.of_simulation()).filter(told).map(|k| (eta[k] / self.std[k]).abs()).collect();
        off.sort_by(f64::total_cmp);
        off.get(off.len() / 2).map_or(1.0, |median| (median / NORMAL_MEDIAN).max(1.0))
    }

    /// Adds initial states for records that are cut into windows, `windows[k]` of record k. The first window of a
    /// record begins as the record does. The existing entries keep their places.
    pub fn with_windows(mut self, windows: &[usize]) -> Self {
        let states = 2 * self.modes + self.rest;
        let mut starts = Vec::new();
        for (first, &count) in self.starts.iter().zip(windows) {
            starts.push(*first);
            for _ in 1..count {
                starts.push(Some(self.std.len()));
                self.std.extend(std::iter::repeat_n(INITIAL_STATE_STD, states));
            }
        }
        self.starts = starts;
        self
    }

    /// Removes one of the records. Its initial state remains a parameter that nothing acts on.
    pub fn forget(&mut self, record: usize) {
        self.starts.remove(record);
    }

    /// Returns the number of entries that belong to the simulation; the initial states follow.
    pub fn of_simulation(&self) -> usize {
        self.of_modes() + self.numbers().len()
    }

    /// Returns the number of entries that belong to the modes.
    fn of_modes(&self) -> usize {
        self.modes * self.each()
    }

    /// Returns the parameters of the rest, in the order of their entries.
    fn numbers(&self) -> &[RestNumber] {
        self.spectrum.as_ref().map_or(&[], |spectrum| &spectrum.numbers)
    }

    /// States which values the parameters of the rest get by their entries of `eta`.
    pub fn rest_in_words(&self, eta: &[f64], inputs: &[String], outputs: &[String]) -> Vec<String> {
        let Some(spectrum) = &self.spectrum else { return Vec::new() };
        let numbers = spectrum.numbers.iter().zip(&eta[self.of_modes()..]);
        numbers.map(|(number, eta)| spectrum.words(*number, *eta, inputs, outputs)).collect()
    }

    /// Returns the record to whose initial state an entry belongs.
    pub fn record_of(&self, index: usize) -> Option<usize> {
        let states = 2 * self.modes + self.rest;
        self.starts.iter().position(|start| start.is_some_and(|at| (at..at + states).contains(&index)))
    }

    /// Returns the number of entries.
    pub fn len(&self) -> usize {
        self.std.len()
    }

    /// Returns whether there are no entries.
    pub fn is_empty(&self) -> bool {
        self.std.is_empty()
    }

    /// Returns the number of entries of each mode.
    fn each(&self) -> usize {
        2 + self.m + self.p
    }

    /// Returns the mode of an entry and its part (0 frequency, 1 damping, then inputs, then outputs); `None` for
    /// numbers of the rest and for initial states.
    pub fn entry(&self, index: usize) -> Option<(usize, usize)> {
        (index < self.of_modes()).then(|| (index / self.each(), index % self.each()))
    }

    /// Returns the simulation changed by `eta`.
    pub fn apply(&self, plant: &Plant, eta: &[f64]) -> Plant {
        let mut changed = plant.clone();
        for k in 0..self.modes {
            let at = &eta[k * self.each()..(k + 1) * self.each()];
            if at.iter().all(|x| *x == 0.0) {
                continue;
            }
            let (w, zeta) = (plant.modes[k].pole.norm(), plant.modes[k].damping());
            let (w, zeta) = (w * (1.0 + at[0]).max(0.1), (zeta * at[1].clamp(-3.0, 3.0).exp()).min(0.99));
            changed.move_pole(k, C::new(-zeta * w, w * (1.0 - zeta * zeta).sqrt()));
            let (b, c) = self.directions(k, &changed.modes[k]);
            let before = self.ports_follow.then(|| changed.modes[k].clone());
            changed.change(k, |mode| {
                for i in 0..self.m {
                    mode.b[i] += b * at[2 + i];
                }
                for o in 0..self.p {
                    mode.c[o] += c * at[2 + self.m + o];
                }
            });
            if let Some(before) = before {
                changed.ports_follow(k, &before);
            }
        }
        if let Some(spectrum) = &self.spectrum {
            let at = &eta[self.of_modes()..self.of_simulation()];
            if at.iter().any(|x| *x != 0.0) {
                spectrum.change(&mut changed, at);
            }
        }
        changed
    }

    /// Returns the directions of a mode's shapes, moved or not, with the signs of the simulation as given. Half an
    /// angle is ambiguous in sign, and the choice may change as the pole moves.
    fn directions(&self, k: usize, mode: &crate::plant::Mode) -> (C, C) {
        let towards = |nominal: C, now: C| if (nominal.conj() * now).re < 0.0 { -now } else { now };
        let ((b, c), nominal) = (directions(mode), self.nominal[k]);
        (towards(nominal.0, b), towards(nominal.1, c))
    }

    /// Returns the initial state of a record, if it is fitted; at rest where `eta` lacks it.
    pub fn start(&self, record: usize, eta: &[f64]) -> Option<State> {
        let at = self.starts[record]?;
        let entry = |k: usize| eta.get(at + k).copied().unwrap_or(0.0);
        let modes = (0..self.modes).map(|k| C::new(entry(2 * k), entry(2 * k + 1)) * self.sizes[k]);
        let rest = (0..self.rest).map(|j| entry(2 * self.modes + j) * self.sizes[self.modes + j]);
        Some(State { modes: modes.collect(), rest: rest.collect() })
    }

    /// Computes the derivatives of the outputs of a record: `put(column, outputs)` is called for each entry that acts
    /// on it. `spectrum` is that of the plant ([`Spectrum::of`]), which all records share; without it the parameters of
    /// the rest are left out.
    pub fn derivatives(
        &self,
        plant: &Plant,
        spectrum: Option<&Spectrum>,
        record: &Record,
        index: usize,
        mut put: impl FnMut(usize, &[Vec<f64>]),
    ) {
        let mut y = vec![vec![0.0; record.samples()]; self.p];
        let through = Through::new(plant, record);
        for k in 0..self.modes {
            let response = Response::new(&plant.modes[k], 1.0 / plant.rate, record);
            self.shape_derivatives(plant, k, &response, &through, &mut y, &mut put);
            self.pole_derivatives(plant, k, &response, &through, &mut y, &mut put);
        }
        if let Some(spectrum) = spectrum {
            self.rest_derivatives(plant, spectrum, record, &mut put);
        }
        if let Some(at) = self.starts[index] {
            self.start_derivatives(plant, at, &mut y, &mut put);
        }
    }

    /// Computes the derivatives by the entries of a mode's shapes.
    fn shape_derivatives(
        &self,
        plant: &Plant,
        k: usize,
        response: &Response,
        through: &Through,
        y: &mut [Vec<f64>],
        put: &mut impl FnMut(usize, &[Vec<f64>]),
    ) {
        let (mode, base) = (&plant.modes[k], k * self.each());
        let (b, c) = self.directions(k, mode);
        for i in 0..self.m {
            write(y, &response.units[i], |o| 2.0 * mode.c[o] * b);
            let mut changed = mode.clone();
            changed.b.iter_mut().enumerate().for_each(|(j, x)| *x = if j == i { b } else { C::ZERO });
            through.add(plant, &Passed::new(plant, &changed), y, 1.0);
            put(base + 2 + i, y);
        }
        for o in 0..self.p {
            write(y, &response.sum, |j| if j == o { 2.0 * c } else { C::ZERO });
            let mut changed = mode.clone();
            changed.c.iter_mut().enumerate().for_each(|(j, x)| *x = if j == o { c } else { C::ZERO });
            through.add(plant, &Passed::new(plant, &changed), y, 1.0);
            put(base + 2 + self.m + o, y);
        }
    }

    /// Computes the derivatives by a mode's frequency and damping ratio.
    fn pole_derivatives(
        &self,
        plant: &Plant,
        k: usize,
        response: &Response,
        through: &Through,
        y: &mut [Vec<f64>],
        put: &mut impl FnMut(usize, &[Vec<f64>]),
    ) {
        let mode = &plant.modes[k];
        let (size, zeta) = (mode.pole.norm(), mode.damping());
        let faster = mode.pole;
        let damped = C::new(-zeta * size, -size * zeta * zeta / (1.0 - zeta * zeta).sqrt());
        let passed = Passed::new(plant, mode);
        for (part, change) in [faster, damped].into_iter().enumerate() {
            let shape = 2.0 * change / mode.pole - change.im / mode.pole.im;
            // Actuators and filters have other gains at the new pole.
            let relative_slope =
                |gain: &dyn Fn(C) -> C| (gain(mode.pole + change * POLE_STEP) / gain(mode.pole)).ln() / POLE_STEP;
            let before: Vec<C> =
                (0..self.m).map(|i| mode.b[i] * relative_slope(&|s| plant.chain.before(i, s))).collect();
            let behind: Vec<C> = (0..self.p).map(|o| relative_slope(&|s| plant.chain.behind(o, s))).collect();
            let moved: Vec<C> = (0..response.sum.len())
                .map(|n| {
                    let through_gain: C = before.iter().zip(&response.units).map(|(slope, unit)| slope * unit[n]).sum();
                    response.slope[n] * change + response.sum[n] * shape + through_gain
                })
                .collect();
            write(y, &moved, |o| 2.0 * mode.c[o]);
            for (o, y) in y.iter_mut().enumerate() {
                let gain = 2.0 * mode.c[o] * behind[o];
                y.iter_mut().zip(&response.sum).for_each(|(y, z)| *y += gain.re * z.re - gain.im * z.im);
            }
            through.add(plant, &passed.at(mode.pole + change * POLE_STEP), y, 1.0 / POLE_STEP);
            through.add(plant, &passed, y, -1.0 / POLE_STEP);
            put(k * self.each() + part, y);
        }
    }

    /// Computes the derivatives by the parameters of the rest as differences, because the rest has few states.
    fn rest_derivatives(
        &self,
        plant: &Plant,
        spectrum: &Spectrum,
        record: &Record,
        put: &mut impl FnMut(usize, &[Vec<f64>]),
    ) {
        let outputs = |plant: &Plant| simulate(plant, &[], &record.u, record.start_s, None, Fineness::COARSE);
        let nominal = outputs(plant);
        for k in 0..self.numbers().len().min(spectrum.numbers.len()) {
            let mut eta = vec![0.0; spectrum.numbers.len()];
            eta[k] = REST_STEP;
            let mut moved = plant.clone();
            spectrum.change(&mut moved, &eta);
            let mut slope = outputs(&moved);
            for (slope, nominal) in slope.iter_mut().zip(&nominal) {
                slope.iter_mut().zip(nominal).for_each(|(to, from)| *to = (*to - from) / REST_STEP);
            }
            put(self.of_modes() + k, &slope);
        }
    }

    /// Computes the derivatives by an initial state whose entries begin at `at`.
    fn start_derivatives(
        &self,
        plant: &Plant,
        at: usize,
        y: &mut [Vec<f64>],
        put: &mut impl FnMut(usize, &[Vec<f64>]),
    ) {
        let samples = y[0].len();
        for (k, mode) in plant.modes.iter().take(self.modes).enumerate() {
            let turn = (mode.pole / plant.rate).exp();
            for (part, start) in [C::ONE, C::I].into_iter().enumerate() {
                let mut z = start * self.sizes[k];
                for n in 0..samples {
                    y.iter_mut().enumerate().for_each(|(o, y)| y[n] = 2.0 * (mode.c[o] * z).re);
                    z *= turn;
                }
                put(at + 2 * k + part, y);
            }
        }
        for j in 0..self.rest {
            let mut x = nalgebra::DVector::zeros(self.rest);
            x[j] = self.sizes[self.modes + j];
            for n in 0..samples {
                let out = &plant.rest.c * &x;
                y.iter_mut().enumerate().for_each(|(o, y)| y[n] = out[o]);
                x = &plant.rest.a * x;
            }
            put(at + 2 * self.modes + j, y);
        }
    }
}

/// Writes the real part of gain times z to each output.
fn write(y: &mut [Vec<f64>], z: &[C], gain: impl Fn(usize) -> C) {
    for (o, y) in y.iter_mut().enumerate() {
        let gain = gain(o);
        y.iter_mut().zip(z).for_each(|(y, z)| *y = gain.re * z.re - gain.im * z.im);
    }
}

/// The state of a mode under a record's inputs.
struct Response {
    /// Under each input alone, through a shape of one.
    units: Vec<Vec<C>>,
    /// Under all inputs, through the mode's own shape.
    sum: Vec<C>,
    /// Its derivative by the pole.
    slope: Vec<C>,
}

impl Response {
    fn new(mode: &crate::plant::Mode, step: f64, record: &Record) -> Self {
        let turn = (mode.pole * step).exp();
        let held = (turn - 1.0) / mode.pole;
        let held_slope = (turn * step - held) / mode.pole;
        let response = |u: &Vec<f64>| -> Vec<C> {
            let next = |z: &mut C, u: &f64| Some(std::mem::replace(z, turn * *z + held * u));
            u.iter().scan(C::ZERO, next).collect()
        };
        let units: Vec<Vec<C>> = record.u.iter().map(response).collect();
        let of_all = |n: usize| -> C { mode.b.iter().zip(&units).map(|(b, unit)| b * unit[n]).sum() };
        let sum: Vec<C> = (0..record.samples()).map(of_all).collect();
        let mut slope = Vec::with_capacity(sum.len());
        let mut w = C::ZERO;
        for (n, z) in sum.iter().enumerate() {
            slope.push(w);
            let driven: C = mode.b.iter().zip(&record.u).map(|(b, u)| b * u[n]).sum();
            w = turn * w + turn * step * z + held_slope * driven;
        }
        Self { units, sum, slope }
    }
}

/// The directions in which real shapes change: the largest entry, times the phase that makes the shape as nearly real
/// as possible, with either sign.
fn directions(mode: &crate::plant::Mode) -> (C, C) {
    let of = |shape: &[C]| {
        let size = shape.iter().map(|x| x.norm()).fold(0.0, f64::max);
        C::from_polar(size, shape.iter().map(|x| x * x).sum::<C>().arg() / 2.0)
    };
    (of(&mode.b), of(&mode.c))
}

/// The RMS of each state under the records' inputs; one for a state that nothing excites.
fn state_sizes(plant: &Plant, records: &[Record]) -> Vec<f64> {
    let level = records.iter().map(Record::level).fold(0.0, f64::max);
    let step = 1.0 / plant.rate;
    let modal = plant.modes.iter().map(|mode| {
        let turn = (mode.pole * step).exp();
        let held = ((turn - 1.0) / mode.pole).norm();
        let b: f64 = mode.b.iter().map(|b| b.norm_sqr()).sum();
        held * b.sqrt() * level / (1.0 - turn.norm_sqr()).max(1e-6).sqrt()
    });
    let rest = (0..plant.rest.a.nrows()).map(|j| plant.rest.b.row(j).norm() * level);
    modal.chain(rest).map(|size| if size > 0.0 { size } else { 1.0 }).collect()
}

/// The states of actuators and filters under a record's inputs.
struct Through {
    /// The output of each actuator (m); empty where there is no actuator pole.
    actuators: Vec<Vec<f64>>,
    /// The states of the filters under each input: p x poles x m.
    filters: Vec<Vec<Vec<Vec<C>>>>,
    /// The inputs (m).
    u: Vec<Vec<f64>>,
}

impl Through {
    fn new(plant: &Plant, record: &Record) -> Self {
        let chain = &plant.chain;
        let step = 1.0 / plant.rate;
        let lagged = |pole: C, gain: C, u: &[f64]| -> Vec<C> {
            let turn = (pole * step).exp();
            let held = (turn - 1.0) / pole * gain;
            let mut z = C::ZERO;
            u.iter()
                .map(|u| {
                    let now = z;
                    z = turn * z + held * u;
                    now
                })
                .collect()
        };
        let actuators = (0..plant.m)
            .map(|i| match &chain.actuator[i] {
                Some(actuator) => {
                    let pole = C::from(-actuator.pole);
                    lagged(pole, C::from(actuator.pole), &record.u[i]).iter().map(|z| z.re).collect()
                }
                None => Vec::new(),
            })
            .collect();
        let filters = chain
            .filter
            .iter()
            .map(|poles| poles.iter().map(|f| record.u.iter().map(|u| lagged(f.pole, C::ONE, u)).collect()).collect())
            .collect();
        Self { actuators, filters, u: record.u.clone() }
    }

    /// Adds `factor` times the part of the outputs that a mode contributes through actuators and filters.
    fn add(&self, plant: &Plant, passed: &Passed, y: &mut [Vec<f64>], factor: f64) {
        if !plant.chain.known() {
            return;
        }
        for (o, y) in y.iter_mut().enumerate() {
            for i in 0..plant.m {
                if passed.products[(o, i)] == 0.0 {
                    continue;
                }
                if !self.actuators[i].is_empty() {
                    let gain = factor * passed.actuator(plant, o, i);
                    y.iter_mut().zip(&self.actuators[i]).for_each(|(y, a)| *y += gain * a);
                } else if plant.chain.filter[o].is_empty() {
                    let gain = factor * passed.products[(o, i)];
                    y.iter_mut().zip(&self.u[i]).for_each(|(y, u)| *y += gain * u);
                }
                for (f, states) in self.filters[o].iter().enumerate() {
                    let both = if plant.chain.filter[o][f].pole.im == 0.0 { 1.0 } else { 2.0 };
                    let gain = passed.filter(plant, o, i, f) * factor * both;
                    y.iter_mut().zip(&states[i]).for_each(|(y, z)| *y += gain.re * z.re - gain.im * z.im);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulate::{Fineness, simulate};
    use crate::testing;

    /// Each derivative is the difference of two simulations.
    #[test]
    fn derivatives_are_differences() {
        let plant = Plant::new(&testing::truss(3)).unwrap();
        let u = testing::random_input(3, 800, 2);
        let record = Record { from_rest: false, ..testing::record(u.clone(), vec![vec![0.0; 800]; 2]) };
        let nuisance = Nuisance::new(&plant, std::slice::from_ref(&record), &Limits::default());
        let zero = vec![0.0; nuisance.len()];
        let run = |eta: &[f64]| {
            let start = nuisance.start(0, eta);
            simulate(&nuisance.apply(&plant, eta), &[], &u, 0.0, start.as_ref(), Fineness::FINE)
        };
        let now = run(&zero);
        let mut seen = 0;
        nuisance.derivatives(&plant, None, &record, 0, |column, derivative| {
            const STEP: f64 = 1e-5;
            let mut eta = zero.clone();
            eta[column] = STEP;
            let moved = run(&eta);
            let (mut error, mut size) = (0.0, 0.0);
            for o in 0..2 {
                for k in 0..800 {
                    let difference = (moved[o][k] - now[o][k]) / STEP;
                    error += (difference - derivative[o][k]).powi(2);
                    size += difference.powi(2);
                }
            }
            assert!(error < 1e-4 * size + 1e-18, "{:?}: {}", nuisance.entry(column), (error / size).sqrt());
            seen += 1;
        });
        assert_eq!(seen, nuisance.len());
    }

    /// A shape's parameter keeps its sign however far the pole moves, and in any basis.
    #[test]
    fn directions_follow_the_pole() {
        let plant = Plant::new(&testing::truss(3)).unwrap();
        for turn in 0..64 {
            let turn = C::from_polar(1.0, std::f64::consts::TAU * f64::from(turn) / 64.0);
            let mut turned = plant.clone();
            for mode in &mut turned.modes {
                mode.b.iter_mut().for_each(|b| *b *= turn);
                mode.c.iter_mut().for_each(|c| *c /= turn);
            }
            let nuisance = Nuisance::new(&turned, &[], &Limits::default());
            for (k, mode) in turned.modes.iter().enumerate() {
                let mut moved = turned.clone();
                moved.move_pole(k, mode.pole * 0.8);
                let (b, c) = nuisance.directions(k, &moved.modes[k]);
                let keeps = |shape: &[C], now: C, moved: &[C], then: C| {
                    let sign = |x: C, direction: C| (x * direction.conj()).re.signum();
                    shape.iter().zip(moved).all(|(x, y)| sign(*x, now) == sign(*y, then))
                };
                let (b0, c0) = nuisance.directions(k, mode);
                assert!(keeps(&mode.b, b0, &moved.modes[k].b, b), "mode {k} turned by {turn}");
                assert!(keeps(&mode.c, c0, &moved.modes[k].c, c), "mode {k} turned by {turn}");
            }
        }
    }

    /// A cubic spring at a port whose shape differs from the simulation's: once the input shape is corrected, force and
    /// displacement are right.
    #[test]
    fn ports_follow_their_input_shapes() {
        const MODE: usize = 1;
        let (sim, real) = (testing::truss(3), testing::truss_with(3, |_, input, _| input[(MODE, 0)] *= 1.05));
        let [nominal, truth] = [&sim, &real].map(|model| Plant::new(model).unwrap());
        let u = testing::random_input(3, 2000, 2);
        let mut record = testing::case(&sim, &sim).records[1].clone();
        record.u = u.clone();
        let mut nuisance = Nuisance::new(&nominal, std::slice::from_ref(&record), &Limits::default());
        nuisance.ports_follow = true;
        // The entry is in units of the shape's largest one.
        let shape = &nominal.modes[MODE].b;
        let mut eta = vec![0.0; nuisance.len()];
        eta[MODE * nuisance.each() + 2] = 0.05 * (shape[0] / directions(&nominal.modes[MODE]).0).re;
        let followed = nuisance.apply(&nominal, &eta);
        let cubic = crate::effects::Library::standard();
        let cubic = cubic.get("cubic-stiffness").unwrap();
        let run = |plant: &Plant, k: f64| {
            let setting = crate::effects::Setting::bare(plant, &sim);
            simulate(plant, &cubic.act(&setting, &crate::effects::Place::Port(0), &[k]), &u, 0.0, None, Fineness::FINE)
        };
        let mut seen = crate::effects::Setting::bare(&truth, &sim);
        crate::prepare::of_ports(&mut seen, &record);
        let size = 0.3 * seen.stiffness[0] / seen.d_rms[0].powi(2);
        let difference = |a: &[Vec<f64>], b: &[Vec<f64>]| -> f64 {
            a.iter().flatten().zip(b.iter().flatten()).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
        };
        let (expected, without) = (run(&truth, size), run(&truth, 0.0));
        let effect = difference(&expected, &without);
        let still = difference(&run(&followed, 0.0), &without) / effect;
        let off = difference(&run(&followed, size), &expected) / effect;
        assert!(still < 1e-9 && off < 1e-3, "{still} {off}");
        let mut stays = followed.clone();
        stays.ports.clone_from(&nominal.ports);
        assert!(difference(&run(&stays, size), &expected) > 20.0 * off * effect, "nothing was to follow");
    }
}
