//! The derivatives of a record's outputs with respect to the linear parameters.
//!
//! The ten or so parameters of a mode act through the same few signals: its state under each input, and the signals
//! that pass the actuators and filters. Each derivative is a weighted sum of these signals. A whitened derivative
//! takes as much memory as all outputs, and hundreds of them many times that of the records. Therefore, only the
//! gains are kept, and the signals are computed where they are needed.

use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, MatRef, Par};
use nalgebra::DMatrix;

use crate::case::record::{Channels, Record};
use crate::fit::nuisance::Nuisance;
use crate::fit::signals::{Recurrence, Signal, Signals};
use crate::plant::{Actuator, Mode, Passed, Plant, Spectrum};
use crate::simulate::{Fineness, simulate};
use plid_fourier::C;

/// Relative step of a pole or gain of the rest, for differences of the outputs. These are then accurate to four
/// digits.
const REST_STEP: f64 = 1e-4;

/// Relative step of a pole, for differences of the gains of actuators and filters. These are then accurate to four
/// digits.
const POLE_STEP: f64 = 1e-4;

/// Relative step of a parameter of a mode in closed loop, for differences of the outputs: small compared with any
/// damping ratio.
const LOOP_STEP: f64 = 1e-5;

/// The derivatives of the outputs of one record.
#[derive(Clone)]
pub struct Derivatives {
    /// The derivative with respect to each parameter that acts on the record. Those that share signals are adjacent.
    pub columns: Vec<Column>,
    samples: usize,
    signals: Signals,
}

/// A derivative.
#[derive(Clone)]
pub struct Column {
    /// The number of its parameter.
    pub parameter: usize,
    parts: Vec<Part>,
}

/// The contribution of a signal to an output.
#[derive(Clone)]
struct Part {
    output: usize,
    signal: Signal,
    gain: f64,
}

impl Derivatives {
    fn new(samples: usize) -> Self {
        Self { columns: Vec::new(), samples, signals: Signals::default() }
    }

    /// Returns the groups of columns that share their first source of signals.
    pub fn groups(&self) -> impl Iterator<Item = &[Column]> {
        let source = |column: &Column| column.parts.first().map(|part| part.signal.source);
        self.columns.chunk_by(move |a, b| source(a) == source(b))
    }

    /// Computes derivatives of the outputs under a record's inputs, one after the other, and passes each to `work`.
    pub fn write<'c>(
        &self,
        columns: &'c [Column],
        u: &[Vec<f64>],
        y: &mut [Vec<f64>],
        mut work: impl FnMut(&'c Column, &[Vec<f64>]),
    ) {
        let mut sources: Vec<usize> = columns.iter().flat_map(|c| &c.parts).map(|part| part.signal.source).collect();
        sources.sort_unstable();
        sources.dedup();
        let wholes: Vec<Vec<f64>> = sources.iter().map(|&s| self.signals.whole(s, u, self.samples)).collect();
        for column in columns {
            y.iter_mut().for_each(|y| y.fill(0.0));
            for part in &column.parts {
                let whole = sources.binary_search(&part.signal.source).expect("the sources of all parts are there");
                let signal = &wholes[whole][part.signal.number * self.samples..][..self.samples];
                y[part.output].iter_mut().zip(signal).for_each(|(y, s)| *y += part.gain * s);
            }
            work(column, y);
        }
    }

    /// Adds the products of every derivative with several sets of channels (p each, from the first sample on). `to`
    /// has a column for each set and a row for each parameter. `u` are the record's inputs.
    pub fn add_products(&self, u: &[Vec<f64>], sets: &[Channels], to: &mut DMatrix<f64>) {
        let Some(length) = sets.first().map(|channels| channels[0].len()) else { return };
        // The signals are computed once for all sets.
        let channels: Vec<f64> = sets.iter().flatten().flatten().copied().collect();
        let channels = MatRef::from_column_major_slice(&channels, length, channels.len() / length);
        let mut products = Mat::zeros(self.signals.count(), channels.ncols());
        self.signals.for_each_block(u, length, |range, block| {
            let signals = MatRef::from_column_major_slice(block, range.len(), self.signals.count());
            let channels = channels.subrows(range.start, range.len());
            matmul(products.as_mut(), Accum::Add, signals.transpose(), channels, 1.0, Par::Seq);
        });
        let p = sets[0].len();
        for column in &self.columns {
            for set in 0..sets.len() {
                let product =
                    |part: &Part| part.gain * products[(self.signals.place(part.signal), set * p + part.output)];
                to[(column.parameter, set)] += column.parts.iter().map(product).sum::<f64>();
            }
        }
    }

    /// Adds a derivative that shares no signal with others.
    fn alone(&mut self, parameter: usize, outputs: Channels) {
        let mut column = Column::new(parameter);
        for (o, mut y) in outputs.into_iter().enumerate() {
            y.resize(self.samples, 0.0);
            column.add(o, self.signals.kept(y), 1.0);
        }
        self.columns.push(column);
    }
}

impl Column {
    fn new(parameter: usize) -> Self {
        Self { parameter, parts: Vec::new() }
    }

    /// Adds a signal to an output.
    fn add(&mut self, output: usize, signal: Signal, gain: f64) {
        match self.parts.iter_mut().find(|part| (part.output, part.signal) == (output, signal)) {
            Some(part) => part.gain += gain,
            None => self.parts.push(Part { output, signal, gain }),
        }
    }

    /// Adds the real part of a gain times a complex signal.
    fn add_complex(&mut self, output: usize, signal: Signal, gain: C) {
        self.add(output, signal, gain.re);
        self.add(output, signal.imaginary(), -gain.im);
    }
}

impl Nuisance {
    /// Returns the derivatives of the outputs of a record. `spectrum` is that of the plant ([`Spectrum::of`]), which
    /// all records share. Without it, the parameters of the rest are left out.
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
        let through = Through::new(plant, &mut found.signals);
        for (k, (units, slope)) in
            found.signals.modes(&plant.modes[..self.modes], 1.0 / plant.rate).into_iter().enumerate()
        {
            let response = Response { units, slope };
            self.by_shapes(plant, k, &response, &through, &mut found);
            self.by_pole(plant, k, &response, &through, &mut found);
        }
        if let Some(spectrum) = spectrum {
            self.by_rest(plant, spectrum, record, &mut found);
        }
        for (o, (parameter, size)) in self.offsets().enumerate() {
            let mut outputs = vec![vec![0.0; record.samples()]; self.p];
            outputs[o].fill(size);
            found.alone(parameter, outputs);
        }
        self.add_start(plant, index, &mut found);
        found
    }

    /// Returns only the derivatives with respect to the initial state of a record.
    pub fn by_start(&self, plant: &Plant, samples: usize, index: usize) -> Derivatives {
        let mut found = Derivatives::new(samples);
        self.add_start(plant, index, &mut found);
        found
    }

    /// Adds the derivatives with respect to the entries of a mode's shapes.
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
            response.add_sum(mode, &mut column, o, 2.0 * c);
            let mut changed = mode.clone();
            changed.c.iter_mut().enumerate().for_each(|(j, x)| *x = if j == o { c } else { C::ZERO });
            through.add(plant, &Passed::new(plant, &changed), &mut column, 1.0);
            to.columns.push(column);
        }
    }

    /// Adds the derivatives with respect to a mode's frequency and damping ratio.
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
                response.add_sum(mode, &mut column, o, row * (shape + behind));
                before.iter().zip(&response.units).for_each(|(gain, &unit)| column.add_complex(o, unit, row * gain));
            }
            through.add(plant, &passed.at(mode.pole + change * POLE_STEP), &mut column, 1.0 / POLE_STEP);
            through.add(plant, &passed, &mut column, -1.0 / POLE_STEP);
            to.columns.push(column);
        }
    }

    /// Adds the derivatives with respect to the parameters of the modes in closed loop. They are computed as
    /// differences, because the controller responds to each change of the outputs.
    fn by_modes_in_loop(&self, plant: &Plant, record: &Record, to: &mut Derivatives) {
        let outputs = |plant: &Plant| simulate(plant, &[], &record.u, record.start_s, None, Fineness::COARSE);
        let nominal = outputs(plant);
        for k in 0..self.of_modes() {
            let mut eta = vec![0.0; self.of_simulation()];
            eta[k] = LOOP_STEP;
            to.alone(k, slope(outputs(&self.apply(plant, &eta)), &nominal, LOOP_STEP));
        }
    }

    /// Adds the derivatives with respect to the parameters of the rest. They are computed as differences, because the
    /// rest has few states.
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

    /// Adds the derivatives with respect to the initial state of a record, if it is fitted.
    fn add_start(&self, plant: &Plant, index: usize, to: &mut Derivatives) {
        let Some(at) = self.starts[index] else { return };
        if plant.controller.is_some() {
            return self.add_start_in_loop(plant, index, at, to);
        }
        for (k, mode) in plant.modes.iter().take(self.modes).enumerate() {
            let turn = (mode.pole / plant.rate).exp();
            let decay = Recurrence { turn, driven: None, start: C::from(self.sizes[k]), real: false };
            let decay = to.signals.recurrence(decay);
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
    /// Adds the derivatives with respect to the initial state in closed loop: the controller responds to each free
    /// response, and has its own state.
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

/// The signals of a mode's state under a record's inputs.
struct Response {
    /// The state under each input alone, with an input shape of one.
    units: Vec<Signal>,
    /// The derivative of the state with respect to the pole, under all inputs, with the mode's own shape.
    slope: Signal,
}

impl Response {
    /// Adds the real part of a gain times the mode's state to an output.
    fn add_sum(&self, mode: &Mode, column: &mut Column, output: usize, gain: C) {
        self.units.iter().zip(&mode.b).for_each(|(&unit, b)| column.add_complex(output, unit, gain * b));
    }
}

/// The signals of actuators and filters under a record's inputs.
struct Through {
    /// The output of each actuator (m), if it has a pole.
    actuators: Vec<Option<Signal>>,
    /// The states of the filters under each input: p x poles x m.
    filters: Vec<Vec<Vec<Signal>>>,
    /// The inputs (m).
    u: Vec<Signal>,
}

impl Through {
    fn new(plant: &Plant, to: &mut Signals) -> Self {
        let chain = &plant.chain;
        let actuator = |(i, actuator): (usize, &Option<Actuator>)| {
            let pole = C::from(-actuator.as_ref()?.pole);
            let turn = (pole / plant.rate).exp();
            Some(to.recurrence(Recurrence { turn, driven: Some((i, 1.0 - turn)), start: C::ZERO, real: true }))
        };
        let actuators = chain.actuator.iter().enumerate().map(actuator).collect();
        let poles: Vec<C> = chain.filter.iter().flatten().map(|filter| filter.pole).collect();
        let mut of_all = to.filters(&poles, plant.m, 1.0 / plant.rate).into_iter();
        let filters = chain.filter.iter().map(|poles| of_all.by_ref().take(poles.len()).collect()).collect();
        let u = if chain.known() { (0..plant.m).map(|i| to.input(i)).collect() } else { Vec::new() };
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
        found.add_products(&u, &[other, channels.clone()], &mut products);
        let mut derivative = vec![vec![0.0; 800]; 2];
        found.write(&found.columns, &u, &mut derivative, |column, derivative| {
            const STEP: f64 = 1e-5;
            let mut eta = zero.clone();
            eta[column.parameter] = STEP;
            let moved = run(&eta);
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
        });
    }
}
