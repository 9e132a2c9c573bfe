//! The least-squares problem of a simulator in the loop: whitened differences between records and runs.

use std::ops::Range;

use nalgebra::{DMatrix, DVector};
use plid_simulator::SimulatorError;

use crate::case::record::{Channels, Record, rms};
use crate::effects::{Effect, Place, Setting};
use crate::fit::problem::{Placed, dot, sum_of_squares};
use crate::in_loop::parameter::SimulatorParameter;
use crate::in_loop::runs::Runs;
use crate::in_loop::slopes::{Slopes, difference};
use crate::noise::NoiseModel;
use crate::noise::model_error::ModelError;
use crate::noise::whiten::Whitener;

/// A parameter of the simulator that may be wrong within a stated limit. Such an error is expected and is not a
/// cause.
#[derive(Clone)]
pub(super) struct Nuisance<'a> {
    /// The parameter as an effect.
    pub effect: &'a SimulatorParameter,
    /// Its place.
    pub place: Place,
    /// Its value in the simulator as given.
    pub value: f64,
    /// Standard deviation of its error: half the limit.
    pub std: f64,
    /// Change of the outputs of each record if the parameter moves by one standard deviation.
    pub change: Vec<Channels>,
    /// The whitened `change`.
    pub trace: Vec<f64>,
}

/// Records and their weights.
pub(super) struct Problem<'a> {
    /// The fitted records.
    pub records: Vec<Record>,
    /// The sizes of the signals, the channels and the ports, as the effects see them.
    pub setting: Setting,
    /// The spectra of the noise and, once there is a best explanation, of the error of that explanation.
    pub noise: NoiseModel,
    /// The parameters that may be wrong within their limits.
    pub nuisances: Vec<Nuisance<'a>>,
    whiteners: Vec<Whitener>,
}

/// An explanation: effects with their parameters, and the residual.
#[derive(Clone)]
pub(super) struct Fit<'a> {
    /// Its effects.
    pub effects: Vec<Placed<'a>>,
    /// Values of the nuisance parameters, in units of their standard deviations.
    pub eta: Vec<f64>,
    /// Simulated outputs of each record.
    pub simulated: Vec<Channels>,
    /// Whitened residual of all records, followed by that of the nuisances' prior.
    pub residual: Vec<f64>,
    /// Sum of squares of the residual.
    pub cost: f64,
    /// Covariance of the effects' parameters, if they were fitted and the records determine them.
    pub covariance: Option<DMatrix<f64>>,
    /// Derivatives of the outputs at this point, if an earlier step provided them.
    pub slopes: Option<Slopes>,
}

impl<'a> Fit<'a> {
    /// Returns the explanation with the current weights of the problem.
    pub fn weighted_anew(&self, problem: &Problem<'a>) -> Self {
        let again = problem.as_is(self.effects.clone(), self.eta.clone(), self.simulated.clone());
        Self { covariance: self.covariance.clone(), ..again }
    }

    /// Returns the number of effect parameters.
    pub fn parameters(&self) -> usize {
        self.effects.iter().map(|placed| placed.parameters.len()).sum()
    }
}

/// Share of the gap as given that is treated as simulator error from the start, because the first fits need not be
/// more accurate than that.
const FIRST_DISCREPANCY: f64 = 0.1;

impl<'a> Problem<'a> {
    /// Creates a problem whose records are weighted by their noise (p standard deviations) and a share of the gap as
    /// given.
    pub fn new(
        records: Vec<Record>,
        given: &[Channels],
        setting: Setting,
        noise: &[f64],
        band_hz: Option<[f64; 2]>,
    ) -> Self {
        let mut model = NoiseModel::declared(&setting.plant, noise, &vec![0.0; setting.plant.m]);
        model.band_hz = band_hz;
        let mut problem = Self { records, setting, noise: model, nuisances: Vec::new(), whiteners: Vec::new() };
        problem.weigh_for_search(noise, given);
        problem
    }

    /// Weights the records by white noise: that of the outputs (p standard deviations), and a share of the gap of
    /// these runs. The spectrum of the residual is not used, because the residual still contains the effects that are
    /// searched for, and its spectrum would conceal them.
    pub fn weigh_for_search(&mut self, noise: &[f64], simulated: &[Channels]) {
        let gap =
            |o: usize| rms(self.records.iter().zip(simulated).flat_map(|(record, y)| record.measured_error(o, &y[o])));
        let std: Vec<f64> =
            noise.iter().enumerate().map(|(o, noise)| noise.hypot(FIRST_DISCREPANCY * gap(o))).collect();
        self.be_white(&std);
        self.weigh();
    }

    /// Sets the noise to white noise (p standard deviations).
    fn be_white(&mut self, std: &[f64]) {
        let band_hz = self.noise.band_hz;
        self.noise = NoiseModel::declared(&self.setting.plant, std, &vec![0.0; self.setting.plant.m]);
        self.noise.band_hz = band_hz;
    }

    /// Weights the records by the noise and by the residual of an explanation in excess of the noise.
    pub fn weigh_by(&mut self, noise: &[f64], fit: &Fit) {
        let rate = self.setting.plant.rate;
        self.be_white(noise);
        let errors: Vec<Channels> = self.records.iter().zip(&fit.simulated).map(|(r, y)| r.error(y)).collect();
        let squares: Vec<f64> = noise.iter().map(|std| std * std).collect();
        self.noise.model_error = ModelError::left(&self.records, &errors, |_| squares.clone(), rate);
        self.weigh();
    }

    /// Returns the problem weighted by the noise alone (p standard deviations).
    pub fn by_noise_alone(&self, noise: &[f64]) -> Self {
        let band_hz = self.noise.band_hz;
        let (records, setting, nuisances) = (self.records.clone(), self.setting.clone(), self.nuisances.clone());
        let mut white = NoiseModel::declared(&setting.plant, noise, &vec![0.0; setting.plant.m]);
        white.band_hz = band_hz;
        let mut plain = Self { records, setting, nuisances, noise: white, whiteners: Vec::new() };
        plain.weigh();
        plain
    }

    fn weigh(&mut self) {
        let missing = |y: &Vec<f64>| (0..y.len()).filter(|&k| !y[k].is_finite()).collect();
        let one = |record: &Record| {
            let masked = record.y.iter().map(missing).collect();
            Whitener::new(record, &self.noise, self.setting.plant.rate, masked)
        };
        self.whiteners = self.records.iter().map(one).collect();
        let traces: Vec<Vec<f64>> = self.nuisances.iter().map(|nuisance| self.whiten(&nuisance.change)).collect();
        self.nuisances.iter_mut().zip(traces).for_each(|(nuisance, trace)| nuisance.trace = trace);
    }

    /// Returns the problem without some samples of one record, which count as missing.
    pub fn without(&self, record: usize, samples: Range<usize>) -> Self {
        let (records, setting, nuisances) = (self.records.clone(), self.setting.clone(), self.nuisances.clone());
        let mut others = Self { records, setting, nuisances, noise: self.noise.clone(), whiteners: Vec::new() };
        others.records[record].y.iter_mut().for_each(|y| y[samples.clone()].fill(f64::NAN));
        others.weigh();
        others
    }

    /// Returns the problem with the first samples of one record only.
    pub fn head(&self, record: usize, samples: usize) -> Self {
        let samples = self.records[record].samples().min(samples);
        let cut = |y: &Channels| -> Channels { y.iter().map(|y| y[..samples].to_vec()).collect() };
        let part =
            |nuisance: &Nuisance<'a>| Nuisance { change: vec![cut(&nuisance.change[record])], ..nuisance.clone() };
        let mut head = Self {
            records: vec![self.records[record].part(0..samples, self.setting.plant.rate)],
            setting: self.setting.clone(),
            noise: self.noise.clone(),
            nuisances: self.nuisances.iter().map(part).collect(),
            whiteners: Vec::new(),
        };
        head.weigh();
        head
    }

    /// Returns an explanation restricted to the first samples of one record.
    pub fn on_head(&self, fit: &Fit<'a>, record: usize) -> Fit<'a> {
        let samples = self.records[0].samples();
        let y = fit.simulated[record].iter().map(|y| y[..samples].to_vec()).collect();
        self.as_is(fit.effects.clone(), fit.eta.clone(), vec![y])
    }

    /// Returns the number of whitened values.
    pub fn rows(&self) -> usize {
        self.whiteners.iter().map(Whitener::rows).sum()
    }

    /// Returns the number of values that count in a sum of squares: the rows, less those of ignored samples.
    pub fn values(&self) -> f64 {
        self.whiteners.iter().map(Whitener::values).sum()
    }

    /// Returns the whitened residual of runs, without the nuisances' prior.
    pub fn whitened(&self, simulated: &[Channels]) -> Vec<f64> {
        let errors: Vec<Channels> = self.records.iter().zip(simulated).map(|(r, y)| r.error(y)).collect();
        self.whiten(&errors)
    }

    /// Returns the whitened channels of all records.
    pub fn whiten(&self, channels: &[Channels]) -> Vec<f64> {
        let mut to = vec![0.0; self.rows()];
        let mut at = 0;
        for (whitener, y) in self.whiteners.iter().zip(channels) {
            whitener.apply(y, &mut to[at..at + whitener.rows()]);
            at += whitener.rows();
        }
        to
    }

    /// Returns the effects, followed by those nuisances that are not zero and that no effect replaces.
    pub fn with_nuisances(&self, effects: &[Placed<'a>], eta: &[f64]) -> Vec<Placed<'a>> {
        let off = self.nuisances.iter().zip(eta);
        let off = off.filter(|(nuisance, eta)| **eta != 0.0 && !self.is_replaced(nuisance, effects));
        let moved = off.map(|(nuisance, eta)| Placed {
            effect: nuisance.effect as &dyn Effect,
            place: nuisance.place.clone(),
            parameters: vec![nuisance.value + eta * nuisance.std],
        });
        effects.iter().cloned().chain(moved).collect()
    }

    /// Returns whether one of the effects is the parameter of this nuisance, which is then a cause.
    pub fn is_replaced(&self, nuisance: &Nuisance, effects: &[Placed]) -> bool {
        effects.iter().any(|placed| placed.place == nuisance.place)
    }

    /// Simulates the records with these effects and nuisances.
    pub fn simulate(
        &self,
        runs: &mut Runs,
        effects: &[Placed<'a>],
        eta: &[f64],
    ) -> Result<Vec<Channels>, SimulatorError> {
        self.simulate_all(runs, &[(effects.to_vec(), eta.to_vec())]).remove(0)
    }

    /// Simulates the records with each of several sets of effects and nuisances, in parallel if the simulator allows
    /// it.
    pub fn simulate_all(
        &self,
        runs: &mut Runs,
        all: &[(Vec<Placed<'a>>, Vec<f64>)],
    ) -> Vec<Result<Vec<Channels>, SimulatorError>> {
        let with: Vec<Vec<Placed>> = all.iter().map(|(effects, eta)| self.with_nuisances(effects, eta)).collect();
        let asked: Vec<(&[Placed], &Record)> =
            with.iter().flat_map(|effects| self.records.iter().map(|record| (effects.as_slice(), record))).collect();
        let mut done = runs.simulate_all(&self.setting, &asked).into_iter();
        with.iter().map(|_| done.by_ref().take(self.records.len()).collect::<Vec<_>>().into_iter().collect()).collect()
    }

    /// Returns the number of runs that [`Problem::simulate_all`] would take.
    pub fn needed(&self, runs: &Runs, all: &[(Vec<Placed<'a>>, Vec<f64>)]) -> usize {
        let with: Vec<Vec<Placed>> = all.iter().map(|(effects, eta)| self.with_nuisances(effects, eta)).collect();
        let asked: Vec<(&[Placed], &Record)> =
            with.iter().flat_map(|effects| self.records.iter().map(|record| (effects.as_slice(), record))).collect();
        runs.needed(&self.setting, &asked)
    }

    /// Returns whether the bounds allow simulations with these effects and nuisances. If they do not, `what` is
    /// recorded as left out.
    pub fn may_simulate(
        &self,
        runs: &mut Runs,
        all: &[(Vec<Placed<'a>>, Vec<f64>)],
        what: impl FnOnce() -> String,
    ) -> bool {
        let needed = self.needed(runs, all);
        runs.may(needed, self.samples(), what)
    }

    /// Returns the number of samples of the longest record.
    pub fn samples(&self) -> usize {
        self.records.iter().map(Record::samples).max().unwrap_or(0)
    }

    /// Returns an explanation as simulated, without a fit.
    pub fn as_is(&self, effects: Vec<Placed<'a>>, eta: Vec<f64>, simulated: Vec<Channels>) -> Fit<'a> {
        let mut residual = self.whitened(&simulated);
        residual.extend(eta.iter().map(|eta| -eta));
        let cost = sum_of_squares(&residual);
        Fit { effects, eta, simulated, residual, cost, covariance: None, slopes: None }
    }

    /// Measures the change of the outputs that each nuisance causes in the simulator as given.
    pub fn measure_nuisances(&mut self, runs: &mut Runs, given: &[Channels]) -> Result<(), SimulatorError> {
        let count = self.nuisances.len();
        let unit = |at: usize| (Vec::new(), (0..count).map(|k| if k == at { 1.0 } else { 0.0 }).collect());
        let moved = self.simulate_all(runs, &(0..count).map(unit).collect::<Vec<_>>());
        for (nuisance, moved) in self.nuisances.iter_mut().zip(moved) {
            nuisance.change = difference(&moved?, given);
        }
        self.weigh();
        Ok(())
    }

    /// Returns the part of whitened values that the nuisances within their limits do not explain.
    pub fn beyond_limits(&self, values: &[f64]) -> Vec<f64> {
        let count = self.nuisances.len();
        if count == 0 {
            return values.to_vec();
        }
        let trace = |k: usize| self.nuisances[k].trace.as_slice();
        let normal = DMatrix::from_fn(count, count, |i, j| dot(trace(i), trace(j)) + if i == j { 1.0 } else { 0.0 });
        let right = DVector::from_fn(count, |i, _| dot(trace(i), values));
        let Some(factor) = normal.cholesky() else { return values.to_vec() };
        let sizes = factor.solve(&right);
        let mut left = values.to_vec();
        for (k, size) in sizes.iter().enumerate() {
            left.iter_mut().zip(trace(k)).for_each(|(left, trace)| *left -= size * trace);
        }
        left
    }
}

#[cfg(test)]
mod tests {
    use plid_simulator::{Description, Input, Output};

    use super::*;
    use crate::in_loop::survey::bare;
    use crate::testing::{random_input, record};

    /// The share of the gap by which the records are weighted at first is that of the samples that were measured.
    #[test]
    fn missing_samples_are_no_part_of_the_gap() {
        let description = Description::new("s", 100.0, vec![Input::new("u")], vec![Output::new("y")]);
        let y = (0..400).map(|k| if k < 200 { 2.0 } else { f64::NAN }).collect();
        let record = record(random_input(1, 400, 1), vec![y]);
        let setting = bare(&description, &[]).unwrap();
        let problem = Problem::new(vec![record], &[vec![vec![0.0; 400]]], setting, &[1e-9], None);
        let std = problem.noise.rms()[0];
        assert!((std / (2.0 * FIRST_DISCREPANCY) - 1.0).abs() < 1e-6, "{std}");
    }
}
