//! The derivatives of a record's outputs by the linear parameters.
//!
//! A mode's ten or so parameters act through the same few signals: its state under each input, and what passes the
//! actuators and filters. Each derivative is a sum of them. A whitened derivative takes as much memory as all outputs,
//! and hundreds of them many times that of the records, so they are kept as signals and gains.

use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, MatRef, Par};
use nalgebra::DMatrix;

use crate::case::record::{Channels, Record};
use crate::fit::nuisance::Nuisance;
use crate::plant::{Actuator, Filter, Mode, Passed, Plant, Spectrum};
use crate::simulate::{Fineness, simulate};
use plid_fourier::C;

/// Relative step of a pole or gain of the rest, for differences of the outputs: four of their digits are then right.
const REST_STEP: f64 = 1e-4;

/// Relative step of a pole, for differences of the gain of actuators and filters: four of their digits are then right.
const POLE_STEP: f64 = 1e-4;

/// Relative step of a parameter of a mode in closed loop, for differences of the outputs: small compared with any
/// damping ratio.
const LOOP_STEP: f64 = 1e-5;

/// The derivatives of the outputs of one record.
#[derive(Clone)]
pub struct Derivatives {
    /// The derivative by each parameter that acts on the record.
    pub columns: Vec<Column>,
    samples: usize,
    /// The signals, one after the other.
    signals: Vec<f64>,
}

/// A derivative.
#[derive(Clone)]
pub struct Column {
    /// The number of its parameter.
    pub parameter: usize,
    parts: Vec<Part>,
}

/// A signal's part in an output.
#[derive(Clone)]
struct Part {
    output: usize,
    signal: usize,
    gain: f64,
}

impl Derivatives {
    fn new(samples: usize) -> Self {
        Self { columns: Vec::new(), samples, signals: Vec::new() }
    }

    /// Writes a derivative of the outputs.
    pub fn write(&self, column: &Column, y: &mut [Vec<f64>]) {
        y.iter_mut().for_each(|y| y.fill(0.0));
        for part in &column.parts {
            let signal = &self.signals[part.signal * self.samples..][..self.samples];
            y[part.output].iter_mut().zip(signal).for_each(|(y, s)| *y += part.gain * s);
        }
    }

    /// Adds the products of every derivative with several sets of channels (p each, from the first sample on): a column
    /// of `to` for each set, a row for each parameter.
    pub fn add_products(&self, sets: &[Channels], to: &mut DMatrix<f64>) {
        let Some(length) = sets.first().map(|channels| channels[0].len()) else { return };
        let all = self.signals.len() / self.samples;
        let signals = MatRef::from_column_major_slice(&self.signals, self.samples, all).subrows(0, length);
        // The signals are read once for all sets.
        let channels: Vec<f64> = sets.iter().flatten().flatten().copied().collect();
        let channels = MatRef::from_column_major_slice(&channels, length, channels.len() / length);
        let mut products = Mat::zeros(all, channels.ncols());
        matmul(products.as_mut(), Accum::Replace, signals.transpose(), channels, 1.0, Par::Seq);
        let p = sets[0].len();
        for column in &self.columns {
            for set in 0..sets.len() {
                let product = |part: &Part| part.gain * products[(part.signal, set * p + part.output)];
                to[(column.parameter, set)] += column.parts.iter().map(product).sum::<f64>();
            }
        }
    }

    /// Keeps a signal and returns its number.
    fn real(&mut self, signal: impl IntoIterator<Item = f64>) -> usize {
        let number = self.signals.len() / self.samples;
        self.signals.extend(signal.into_iter().take(self.samples));
        self.signals.resize((number + 1) * self.samples, 0.0);
        number
    }

    /// Keeps a complex signal as two real ones and returns the number of the first.
    fn complex(&mut self, signal: &[C]) -> usize {
        let first = self.real(signal.iter().map(|z| z.re));
        self.real(signal.iter().map(|z| z.im));
        first
    }

    /// Keeps a derivative that shares no signal with others.
    fn alone(&mut self, parameter: usize, outputs: Channels) {
        let mut column = Column::new(parameter);
        for (o, y) in outputs.into_iter().enumerate() {
            column.add(o, self.real(y), 1.0);
        }
        self.columns.push(column);
    }
}

impl Column {
    fn new(parameter: usize) -> Self {
        Self { parameter, parts: Vec::new() }
    }

    /// Adds a signal to an output.
    fn add(&mut self, output: usize, signal: usize, gain: f64) {
        match self.parts.iter_mut().find(|part| (part.output, part.signal) == (output, signal)) {
            Some(part) => part.gain += gain,
            None => self.parts.push(Part { output, signal, gain }),
        }
    }

    /// Adds the real part of a gain times a complex signal.
    fn add_complex(&mut self, output: usize, signal: usize, gain: C) {
        self.add(output, signal, gain.re);
        self.add(output, signal + 1, -gain.im);
    }
}

impl Nuisance {
    /// Returns the derivatives of the outputs of a record. `spectrum` is that of the plant ([`Spectrum::of`]), which
    /// all records share; without it the parameters of the rest are left out.
    pub fn derivatives(
        &self,
        plant: &Plant,
        spectrum: Option<&Spectrum>,
        record: &Record,
        index: usize,
    ) -> Derivatives {
        let mut found = Derivatives::new(record.samples());
        if plant.controller.is_some() {
            self.by_modes_in_loop(plant, record, &mut found);
            spectrum.iter().for_each(|spectrum| self.by_rest(plant, spectrum, record, &mut found));
            self.add_start(plant, index, &mut found);
            return found;
        }
        let through = Through::new(plant, record, &mut found);
        for k in 0..self.modes {
            let response = Response::new(&plant.modes[k], 1.0 / plant.rate, record, &mut found);
            self.by_shapes(plant, k, &response, &through, &mut found);
            self.by_pole(plant, k, &response, &through, &mut found);
        }
        if let Some(spectrum) = spectrum {
            self.by_rest(plant, spectrum, record, &mut found);
        }
        self.add_start(plant, index, &mut found);
        found
    }

    /// Returns only those by the initial state of a record.
    pub fn by_start(&self, plant: &Plant, samples: usize, index: usize) -> Derivatives {
        let mut found = Derivatives::new(samples);
        self.add_start(plant, index, &mut found);
        found
    }

    /// Adds the derivatives by the entries of a mode's shapes.
    fn by_shapes(&self, plant: &Plant, k: usize, response: &Response, through: &Through, to: &mut Derivatives) {
        let (mode, base) = (&plant.modes[k], k * self.each());
        let (b, c) = self.directions(k, mode);
        for i in 0..self.m {
            let mut column = Column::new(base + 2 + i);
            for o in 0..self.p {
                column.add_complex(o, response.units[i], 2.0 * mode.c[o] * b);
            }
            let mut changed = mode.clone();
            changed.b.iter_mut().enumerate().for_each(|(j, x)| *x = if j == i { b } else { C::ZERO });
            through.add(plant, &Passed::new(plant, &changed), &mut column, 1.0);
            to.columns.push(column);
        }
        for o in 0..self.p {
            let mut column = Column::new(base + 2 + self.m + o);
            column.add_complex(o, response.sum, 2.0 * c);
            let mut changed = mode.clone();
            changed.c.iter_mut().enumerate().for_each(|(j, x)| *x = if j == o { c } else { C::ZERO });
            through.add(plant, &Passed::new(plant, &changed), &mut column, 1.0);
            to.columns.push(column);
        }
    }

    /// Adds the derivatives by a mode's frequency and damping ratio.
    fn by_pole(&self, plant: &Plant, k: usize, response: &Response, through: &Through, to: &mut Derivatives) {
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
            let mut column = Column::new(k * self.each() + part);
            for o in 0..self.p {
                let behind = relative_slope(&|s| plant.chain.behind(o, s));
                let row = 2.0 * mode.c[o];
                column.add_complex(o, response.slope, row * change);
                column.add_complex(o, response.sum, row * (shape + behind));
                before.iter().zip(&response.units).for_each(|(gain, &unit)| column.add_complex(o, unit, row * gain));
            }
            through.add(plant, &passed.at(mode.pole + change * POLE_STEP), &mut column, 1.0 / POLE_STEP);
            through.add(plant, &passed, &mut column, -1.0 / POLE_STEP);
            to.columns.push(column);
        }
    }

    /// Adds the derivatives by the parameters of the modes in closed loop, as differences: the controller answers to
    /// each change of the outputs.
    fn by_modes_in_loop(&self, plant: &Plant, record: &Record, to: &mut Derivatives) {
        let outputs = |plant: &Plant| simulate(plant, &[], &record.u, record.start_s, None, Fineness::COARSE);
        let nominal = outputs(plant);
        for k in 0..self.of_modes() {
            let mut eta = vec![0.0; self.of_simulation()];
            eta[k] = LOOP_STEP;
            to.alone(k, slope(outputs(&self.apply(plant, &eta)), &nominal, LOOP_STEP));
        }
    }

    /// Adds the derivatives by the parameters of the rest as differences, because the rest has few states.
    fn by_rest(&self, plant: &Plant, spectrum: &Spectrum, record: &Record, to: &mut Derivatives) {
        let outputs = |plant: &Plant| simulate(plant, &[], &record.u, record.start_s, None, Fineness::COARSE);
        let nominal = outputs(plant);
        for k in 0..self.numbers().len().min(spectrum.numbers.len()) {
            let mut eta = vec![0.0; spectrum.numbers.len()];
            eta[k] = REST_STEP;
            let mut moved = plant.clone();
            spectrum.change(&mut moved, &eta);
            to.alone(self.of_modes() + k, slope(outputs(&moved), &nominal, REST_STEP));
        }
    }

    /// Adds the derivatives by the initial state of a record, if it is fitted.
    fn add_start(&self, plant: &Plant, index: usize, to: &mut Derivatives) {
        let Some(at) = self.starts[index] else { return };
        if plant.controller.is_some() {
            return self.add_start_in_loop(plant, index, at, to);
        }
        for (k, mode) in plant.modes.iter().take(self.modes).enumerate() {
            let turn = (mode.pole / plant.rate).exp();
            let next = |z: &C| Some(z * turn);
            let decay: Vec<C> = std::iter::successors(Some(C::from(self.sizes[k])), next).take(to.samples).collect();
            let decay = to.complex(&decay);
            for (part, start) in [C::ONE, C::I].into_iter().enumerate() {
                let mut column = Column::new(at + 2 * k + part);
                (0..self.p).for_each(|o| column.add_complex(o, decay, 2.0 * mode.c[o] * start));
                to.columns.push(column);
            }
        }
        for j in 0..self.rest {
            let mut x = nalgebra::DVector::zeros(self.rest);
            x[j] = self.sizes[self.modes + j];
            let mut y = vec![vec![0.0; to.samples]; self.p];
            for n in 0..to.samples {
                let out = &plant.rest.c * &x;
                y.iter_mut().enumerate().for_each(|(o, y)| y[n] = out[o]);
                x = &plant.rest.a * x;
            }
            to.alone(at + 2 * self.modes + j, y);
        }
    }
}

impl Nuisance {
    /// Adds the derivatives by the initial state in closed loop: the controller responds to each free response, and has
    /// its own state.
    fn add_start_in_loop(&self, plant: &Plant, index: usize, at: usize, to: &mut Derivatives) {
        let still = vec![vec![0.0; to.samples]; self.m];
        let mut eta = vec![0.0; self.len()];
        for parameter in at..at + self.states() {
            eta[parameter] = 1.0;
            let start = self.start(index, &eta);
            to.alone(parameter, simulate(plant, &[], &still, 0.0, start.as_ref(), Fineness::COARSE));
            eta[parameter] = 0.0;
        }
    }
}

/// Returns the difference quotient of outputs.
fn slope(mut moved: Channels, nominal: &Channels, step: f64) -> Channels {
    for (moved, nominal) in moved.iter_mut().zip(nominal) {
        moved.iter_mut().zip(nominal).for_each(|(to, from)| *to = (*to - from) / step);
    }
    moved
}

/// The numbers of the signals of a mode's state under a record's inputs.
struct Response {
    /// Under each input alone, through a shape of one.
    units: Vec<usize>,
    /// Under all inputs, through the mode's own shape.
    sum: usize,
    /// Its derivative by the pole.
    slope: usize,
}

impl Response {
    fn new(mode: &Mode, step: f64, record: &Record, to: &mut Derivatives) -> Self {
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
        Self {
            units: units.iter().map(|unit| to.complex(unit)).collect(),
            sum: to.complex(&sum),
            slope: to.complex(&slope),
        }
    }
}

/// The numbers of the signals of actuators and filters under a record's inputs.
struct Through {
    /// The output of each actuator (m), if it has a pole.
    actuators: Vec<Option<usize>>,
    /// The states of the filters under each input: p x poles x m.
    filters: Vec<Vec<Vec<usize>>>,
    /// The inputs (m).
    u: Vec<usize>,
}

impl Through {
    fn new(plant: &Plant, record: &Record, to: &mut Derivatives) -> Self {
        let chain = &plant.chain;
        let step = 1.0 / plant.rate;
        let lagged = |pole: C, gain: C, u: &[f64]| -> Vec<C> {
            let turn = (pole * step).exp();
            let held = (turn - 1.0) / pole * gain;
            let next = |z: &mut C, u: &f64| Some(std::mem::replace(z, turn * *z + held * u));
            u.iter().scan(C::ZERO, next).collect()
        };
        let actuator = |(actuator, u): (&Option<Actuator>, &Vec<f64>)| {
            let pole = C::from(-actuator.as_ref()?.pole);
            Some(to.real(lagged(pole, -pole, u).iter().map(|z| z.re)))
        };
        let actuators = chain.actuator.iter().zip(&record.u).map(actuator).collect();
        let mut filter = |f: &Filter| record.u.iter().map(|u| to.complex(&lagged(f.pole, C::ONE, u))).collect();
        let filters = chain.filter.iter().map(|poles| poles.iter().map(&mut filter).collect()).collect();
        let u = if chain.known() { record.u.iter().map(|u| to.real(u.iter().copied())).collect() } else { Vec::new() };
        Self { actuators, filters, u }
    }

    /// Adds `factor` times the part of the outputs that a mode contributes through actuators and filters.
    fn add(&self, plant: &Plant, passed: &Passed, column: &mut Column, factor: f64) {
        if !plant.chain.known() {
            return;
        }
        for (o, i) in (0..plant.p).flat_map(|o| (0..plant.m).map(move |i| (o, i))) {
            if passed.products[(o, i)] == 0.0 {
                continue;
            }
            if let Some(actuator) = self.actuators[i] {
                column.add(o, actuator, factor * passed.actuator(plant, o, i));
            } else if plant.chain.filter[o].is_empty() {
                column.add(o, self.u[i], factor * passed.products[(o, i)]);
            }
            for (f, states) in self.filters[o].iter().enumerate() {
                let both = if plant.chain.filter[o][f].pole.im == 0.0 { 1.0 } else { 2.0 };
                column.add_complex(o, states[i], passed.filter(plant, o, i, f) * factor * both);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::case::Limits;
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
        let found = nuisance.derivatives(&plant, None, &record, 0);
        assert_eq!(found.columns.len(), nuisance.len());
        let channels = testing::random_input(4, 700, 2);
        let mut products = DMatrix::zeros(nuisance.len(), 2);
        let other = testing::random_input(5, 700, 2);
        found.add_products(&[other, channels.clone()], &mut products);
        let mut derivative = vec![vec![0.0; 800]; 2];
        for column in &found.columns {
            const STEP: f64 = 1e-5;
            let mut eta = zero.clone();
            eta[column.parameter] = STEP;
            let moved = run(&eta);
            found.write(column, &mut derivative);
            let (mut error, mut size, mut product) = (0.0, 0.0, 0.0);
            for o in 0..2 {
                for k in 0..800 {
                    let difference = (moved[o][k] - now[o][k]) / STEP;
                    error += (difference - derivative[o][k]).powi(2);
                    size += difference.powi(2);
                }
                product += channels[o].iter().zip(&derivative[o]).map(|(a, b)| a * b).sum::<f64>();
            }
            assert!(error < 1e-4 * size + 1e-18, "{:?}: {}", nuisance.entry(column.parameter), (error / size).sqrt());
            assert!((products[(column.parameter, 1)] - product).abs() < 1e-9 * size.sqrt());
        }
    }
}
