//! Small structures and records of them, for tests.

mod axis;
mod blind;
mod truss;

use nalgebra::DMatrix;
use plid_model::Model;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

use crate::case::record::{Channels, Excitation, Record, rms};
use crate::case::{Case, CaseConfig};
use crate::testing::truss::Truss;
pub use crate::testing::truss::{RATE, Sensor, held};

/// Frequencies and damping ratios.
pub const MODES: [(f64, f64); 4] = [(58.0, 0.01), (137.0, 0.008), (186.0, 0.012), (243.0, 0.006)];

/// Two actuators with a pole at 260 Hz, two accelerometers behind a two-pole filter at 600 Hz, declared ports.
pub fn truss(seed: u64) -> Model {
    truss_with(seed, |_, _, _| {})
}

/// The same with frequencies and damping ratios, input shapes (modes x 2) and output shapes (2 x modes) changed.
pub fn truss_with(seed: u64, change: impl FnOnce(&mut [(f64, f64)], &mut DMatrix<f64>, &mut DMatrix<f64>)) -> Model {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut truss = Truss::draw(&MODES, &mut rng);
    change(&mut truss.modes, &mut truss.beta, &mut truss.gamma);
    truss.model(&mut rng)
}

/// The truss of [`truss`] with other sensors, and changed frequencies and damping ratios.
pub fn truss_sensed(seed: u64, sensor: Sensor, change: impl FnOnce(&mut [(f64, f64)])) -> Model {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut truss = Truss { sensor, ..Truss::draw(&MODES, &mut rng) };
    change(&mut truss.modes);
    // Outputs of like size, whatever is sensed.
    truss.gamma *= match sensor {
        Sensor::Position => 1e6,
        Sensor::Velocity => 1e3,
        Sensor::Acceleration => 1.0,
    };
    truss.model(&mut rng)
}

/// White Gaussian channels of unit RMS.
pub fn random_input(seed: u64, samples: usize, channels: usize) -> Channels {
    let mut rng = ChaCha8Rng::seed_from_u64(seed ^ 0x5eed);
    (0..channels).map(|_| (0..samples).map(|_| rng.sample(StandardNormal)).collect()).collect()
}

/// Free run from rest.
pub fn run(model: &Model, u: &[Vec<f64>]) -> Channels {
    let inputs = ndarray::Array2::from_shape_fn((u[0].len(), u.len()), |(k, i)| u[i][k]);
    let outputs = plid_model::simulate(model, inputs.view(), &model.rest()).expect("a sound model").outputs;
    crate::case::columns(&outputs)
}

/// Driven at random, from rest.
pub fn record(u: Channels, y: Channels) -> Record {
    Record {
        name: "random".into(),
        excitation: Excitation::Random,
        from_rest: true,
        start_s: 0.0,
        held_out: false,
        u,
        y,
        simulated: None,
    }
}

/// A case in memory: what `sim` says, and records of what `real` does, 0.2 % of noise on each output: one of 1024 samples without input, and
/// `random-1` to `random-3` of 3072 samples each at levels 1, 0.5 and 1.
pub fn case(sim: &Model, real: &Model) -> Case {
    let config =
        CaseConfig { sim: Some("sim.json".into()), ..CaseConfig::new(RATE, sim.inputs.clone(), sim.outputs.clone()) };
    let level_one = run(real, &random_input(0, 4096, real.m()));
    let std: Vec<f64> = level_one.iter().map(|y| 0.002 * rms(y)).collect();
    let mut records = Vec::new();
    let mut start_s = 0.0;
    for (k, level) in [0.0, 1.0, 0.5, 1.0].into_iter().enumerate() {
        let seed = 10 + k as u64;
        let samples = if level > 0.0 { 3072 } else { 1024 };
        let mut u = random_input(seed, samples, real.m());
        u.iter_mut().flatten().for_each(|u| *u *= level);
        let noise = random_input(seed + 100, samples, real.p());
        let mut y = run(real, &u);
        for ((y, noise), std) in y.iter_mut().zip(&noise).zip(&std) {
            y.iter_mut().zip(noise).for_each(|(y, e)| *y += std * e);
        }
        let (name, excitation) = match level {
            0.0 => ("quiet".to_string(), Excitation::Zero),
            _ => (format!("random-{k}"), Excitation::Random),
        };
        records.push(Record { name, excitation, start_s, ..record(u, y) });
        start_s += samples as f64 / RATE;
    }
    let mut sim = sim.clone();
    sim.noise.sensor_std = Some(std);
    sim.noise.actuator_std = Some(vec![0.0; sim.m()]);
    Case { config, model: Some(sim), records, for_simulation: Vec::new(), warnings: Vec::new() }
}
