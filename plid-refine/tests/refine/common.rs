//! A plant with known parameters, and records of it.
#![allow(dead_code, reason = "each test binary uses its own part")]

use nalgebra::{DMatrix, DVector};
use ndarray::Array2;
use plid_model::{Model, frequency_response, simulate};
use plid_refine::{Options, Record, Start};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

pub const RATE: f64 = 100.0;

pub fn normal(seed: u64, rows: usize, columns: usize) -> Array2<f64> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    Array2::from_shape_simple_fn((rows, columns), || StandardNormal.sample(&mut random))
}

fn matrix(seed: u64, rows: usize, columns: usize) -> DMatrix<f64> {
    let values = normal(seed, rows, columns);
    DMatrix::from_fn(rows, columns, |i, j| values[(i, j)])
}

/// Returns a plant with two lightly damped modes and a pair of real poles, in general coordinates, with two inputs and
/// two outputs. `odd` removes one real pole.
pub fn plant(odd: bool, feedthrough: bool) -> Model {
    let n = if odd { 5 } else { 6 };
    let mut a = DMatrix::zeros(n, n);
    for (at, radius, angle) in [(0, 0.985_f64, 0.35_f64), (2, 0.97, 1.1)] {
        let (re, im) = (radius * angle.cos(), radius * angle.sin());
        a[(at, at)] = re;
        a[(at, at + 1)] = im;
        a[(at + 1, at)] = -im;
        a[(at + 1, at + 1)] = re;
    }
    a[(4, 4)] = 0.7;
    if !odd {
        a[(5, 5)] = -0.4;
    }
    let change = DMatrix::identity(n, n) + matrix(5, n, n) * 0.3;
    let inverse = change.clone().try_inverse().unwrap();
    let d = if feedthrough { matrix(8, 2, 2) } else { DMatrix::zeros(2, 2) };
    Model::new(RATE, &change * a * &inverse, &change * matrix(6, n, 2), matrix(7, 2, n) * &inverse, d).unwrap()
}

pub struct Data {
    pub inputs: Array2<f64>,
    pub outputs: Array2<f64>,
}

impl Data {
    /// Simulates the plant from `state` and adds white noise of RMS `noise` to each output.
    pub fn new(model: &Model, samples: usize, state: &DVector<f64>, noise: f64, seed: u64) -> Self {
        let inputs = normal(seed, samples, model.m());
        let clean = simulate(model, inputs.view(), state).unwrap().outputs;
        let outputs = clean + normal(seed + 1000, samples, model.p()) * noise;
        Self { inputs, outputs }
    }

    pub fn record(&self, start: Start) -> Record<'_> {
        Record { inputs: self.inputs.view(), outputs: self.outputs.view(), start }
    }
}

pub fn options(feedthrough: bool) -> Options {
    Options { radius: 0.999, feedthrough, iterations: 60, noise: plid_refine::Noise::White }
}

/// Returns the model with perturbed poles, mode shapes and inputs.
pub fn spoilt(model: &Model, share: f64) -> Model {
    let off = |m: &DMatrix<f64>, seed: u64| m.map(|x| x) + matrix(seed, m.nrows(), m.ncols()) * (share * m.amax());
    Model { a: off(&model.a, 21), b: off(&model.b, 22), c: off(&model.c, 23), ..model.clone() }
}

/// Returns the largest difference of the responses over the largest response.
pub fn response_difference(a: &Model, b: &Model) -> f64 {
    let hz: Vec<f64> = (0..200).map(|k| 0.5 * RATE * f64::from(k) / 200.0).collect();
    let (a, b) = (frequency_response(a, &hz).unwrap(), frequency_response(b, &hz).unwrap());
    let peak = b.iter().flatten().map(|h| h.norm()).fold(0.0, f64::max);
    a.iter().flatten().zip(b.iter().flatten()).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max) / peak
}

pub fn silent(_: usize, _: usize) -> bool {
    true
}
