//! The responses of the simulation to every measured input at each of its inputs, and their correlation with the
//! measured outputs.

use ndarray::Array2;
use plid_model::Model;

use super::wiring::{Wire, Wiring};
use crate::case::record::{Channels, Excitation, Record};
use crate::error::GapError;
use plid_fourier::C;

/// The largest delay that is considered, in samples.
const REACH: usize = 1024;

/// Measured and simulated outputs of one record, with their transforms.
struct Driven {
    samples: usize,
    /// Length of the transforms.
    length: usize,
    /// Measured outputs (p), without the mean, with zeros for missing samples.
    y: Channels,
    y_bins: Vec<Vec<C>>,
    /// Simulated outputs of the simulation's input i driven by the measured input j: p channels at i m + j.
    s: Vec<Channels>,
    s_bins: Vec<Vec<Vec<C>>>,
}

/// The responses of all driven records.
pub struct Responses {
    /// Number of inputs.
    pub m: usize,
    /// Number of outputs.
    pub p: usize,
    /// Largest delay in samples; delays from minus to plus this value are considered.
    pub reach: usize,
    /// 1 / (sum of squares) of each measured output.
    pub weight: Vec<f64>,
    records: Vec<Driven>,
}

impl Responses {
    /// Simulates the responses.
    ///
    /// # Errors
    /// Returns [`GapError::Model`] if the simulation cannot be run.
    pub fn new(model: &Model, records: &[&Record]) -> Result<Self, GapError> {
        let (m, p) = (model.m(), model.p());
        // A delay by a whole period cannot be distinguished from none.
        let longest = |record: &&Record| match record.excitation {
            Excitation::Periodic(period) => (period / 2).min(record.samples() / 4),
            _ => record.samples() / 4,
        };
        let reach = records.iter().map(longest).min().unwrap_or(0).min(REACH);
        let driven = records.iter().map(|record| driven(model, record, reach)).collect::<Result<Vec<_>, _>>()?;
        let square = |o: usize| driven.iter().map(|d| d.y[o].iter().map(|y| y * y).sum::<f64>()).sum::<f64>();
        let weight = (0..p).map(|o| 1.0 / square(o).max(f64::MIN_POSITIVE)).collect();
        Ok(Self { m, p, reach, weight, records: driven })
    }

    /// Returns the sums of y_o(k + lag) s(k) over all pairs and all records, for the lags -reach..=reach. Each pair
    /// consists of a measured output o and a simulated output s.
    pub fn correlation(&self, pairs: &[(usize, Simulated)]) -> Vec<f64> {
        let mut sums = vec![0.0; 2 * self.reach + 1];
        for record in &self.records {
            let mut bins = vec![C::ZERO; record.length / 2 + 1];
            for &(o, simulated) in pairs {
                let s = &record.s_bins[simulated.input * self.m + simulated.wire][simulated.output];
                for ((to, y), s) in bins.iter_mut().zip(&record.y_bins[o]).zip(s) {
                    *to += y * s.conj() * simulated.factor;
                }
            }
            let lags = plid_fourier::backward(&bins, record.length);
            for (at, sum) in sums.iter_mut().enumerate() {
                let lag = at as i64 - self.reach as i64;
                *sum += lags[lag.rem_euclid(record.length as i64) as usize];
            }
        }
        sums
    }

    /// Returns the sum of the products of two simulated outputs over all records.
    pub fn product(&self, a: Simulated, b: Simulated) -> f64 {
        let of = |record: &Driven| {
            let s = |x: Simulated| &record.s[x.input * self.m + x.wire][x.output];
            s(a).iter().zip(s(b)).map(|(a, b)| a * b).sum::<f64>()
        };
        a.factor * b.factor * self.records.iter().map(of).sum::<f64>()
    }

    /// Returns the relative gap with this wiring.
    pub fn gap(&self, wiring: &Wiring) -> f64 {
        let mut share = 0.0;
        for (o, &Wire { channel, gain }) in wiring.outputs.iter().enumerate() {
            for record in &self.records {
                let inputs: Vec<(f64, &[f64])> = wiring
                    .inputs
                    .iter()
                    .enumerate()
                    .map(|(i, wire)| (gain * wire.gain, record.s[i * self.m + wire.channel][channel].as_slice()))
                    .collect();
                for (k, y) in record.y[o].iter().enumerate() {
                    let at = k as i64 - wiring.delay;
                    if at >= record.samples as i64 || *y == 0.0 {
                        continue;
                    }
                    let s = if at < 0 { 0.0 } else { inputs.iter().map(|(g, s)| g * s[at as usize]).sum() };
                    share += (y - s).powi(2) * self.weight[o];
                }
            }
        }
        (share / self.p as f64).sqrt()
    }
}

/// A simulated output, with the input of the simulation and the measured input that drives it.
#[derive(Debug, Clone, Copy)]
pub struct Simulated {
    /// The simulation's input.
    pub input: usize,
    /// The measured input.
    pub wire: usize,
    /// The simulation's output.
    pub output: usize,
    /// The factor of the output.
    pub factor: f64,
}

fn driven(model: &Model, record: &Record, reach: usize) -> Result<Driven, GapError> {
    let (m, samples) = (model.m(), record.samples());
    let length = plid_fourier::good_length(samples + reach + 1);
    let y: Channels = record.y.iter().map(|y| centred(y)).collect();
    let mut s = Vec::new();
    for input in 0..m {
        for wire in 0..m {
            let mut u = Array2::zeros((samples, m));
            u.column_mut(input).iter_mut().zip(&record.u[wire]).for_each(|(to, u)| *to = *u);
            let run = plid_model::simulate(model, u.view(), &model.rest())?.outputs;
            s.push(run.columns().into_iter().map(|column| centred(&column.to_vec())).collect::<Channels>());
        }
    }
    let bins = |x: &Vec<f64>| {
        let mut x = x.clone();
        x.resize(length, 0.0);
        plid_fourier::forward(&x)
    };
    let y_bins = y.iter().map(bins).collect();
    let s_bins = s.iter().map(|s| s.iter().map(bins).collect()).collect();
    Ok(Driven { samples, length, y, y_bins, s, s_bins })
}

/// Subtracts the mean, because an offset does not concern the wiring. Missing samples become zero.
fn centred(x: &[f64]) -> Vec<f64> {
    let (sum, count) = x.iter().filter(|x| x.is_finite()).fold((0.0, 0.0), |(s, n), x| (s + x, n + 1.0));
    let mean = if count > 0.0 { sum / count } else { 0.0 };
    x.iter().map(|x| if x.is_finite() { x - mean } else { 0.0 }).collect()
}
