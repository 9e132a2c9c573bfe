//! Small structures and their records, for tests.

pub mod accelerometers;
pub mod arm;
pub(crate) mod axis;
mod blind;
mod controlled;
pub mod drive;
mod joint;
pub(crate) mod laws;
mod levels;
mod sound;
mod truss;
mod unquiet;

use nalgebra::DMatrix;
use plid_model::Model;
pub use plid_model::held;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

use crate::answer::schema::{Diagnosis, NamedEffect};
use crate::case::record::{Channels, Excitation, Record, rms};
use crate::case::{Case, CaseConfig};
use crate::effects::Library;
use crate::testing::truss::Truss;
pub use crate::testing::truss::{RATE, Sensor};

/// Frequencies in Hz and damping ratios of the modes.
pub const MODES: [(f64, f64); 4] = [(58.0, 0.01), (137.0, 0.008), (186.0, 0.012), (243.0, 0.006)];

/// Returns a truss with two actuators with a pole at 260 Hz, two accelerometers behind a two-pole filter at 600 Hz,
/// and declared ports.
pub fn truss(seed: u64) -> Model {
    truss_with(seed, |_, _, _| {})
}

/// Returns a [`truss`] with changed frequencies and damping ratios, input shapes (modes x 2) and output shapes (2 x
/// modes).
pub fn truss_with(seed: u64, change: impl FnOnce(&mut [(f64, f64)], &mut DMatrix<f64>, &mut DMatrix<f64>)) -> Model {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut truss = Truss::draw(&MODES, &mut rng);
    change(&mut truss.modes, &mut truss.beta, &mut truss.gamma);
    truss.model(&mut rng)
}

/// Returns a [`truss`] with other sensors, and with changed frequencies and damping ratios.
pub fn truss_sensed(seed: u64, sensor: Sensor, change: impl FnOnce(&mut [(f64, f64)])) -> Model {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut truss = Truss { sensor, ..Truss::draw(&MODES, &mut rng) };
    change(&mut truss.modes);
    // The outputs have similar sizes for all sensors.
    truss.gamma *= match sensor {
        Sensor::Position => 1e6,
        Sensor::Velocity => 1e3,
        Sensor::Acceleration => 1.0,
    };
    truss.model(&mut rng)
}

/// Returns white Gaussian channels of unit RMS.
pub fn random_input(seed: u64, samples: usize, channels: usize) -> Channels {
    let mut rng = ChaCha8Rng::seed_from_u64(seed ^ 0x5eed);
    (0..channels).map(|_| (0..samples).map(|_| rng.sample(StandardNormal)).collect()).collect()
}

/// Simulates a free run from rest.
pub fn run(model: &Model, u: &[Vec<f64>]) -> Channels {
    let inputs = ndarray::Array2::from_shape_fn((u[0].len(), u.len()), |(k, i)| u[i][k]);
    let outputs = plid_model::simulate(model, inputs.view(), &model.rest()).expect("a sound model").outputs;
    crate::case::columns(&outputs)
}

/// Creates a record that is driven at random, from rest.
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

/// Returns a case in memory with the simulation `sim` and records of `real` with 0.2 % of noise on each output. The
/// record `quiet` has 1024 samples without input, and `random-1` to `random-3` have 3072 samples each at levels 1, 0.5
/// and 1.
pub fn case(sim: &Model, real: &Model) -> Case {
    let level_one = run(real, &random_input(0, 4096, real.m()));
    let std: Vec<f64> = level_one.iter().map(|y| 0.002 * rms(y)).collect();
    let input = |k: usize| random_input(10 + k as u64, if k > 0 { 3072 } else { 1024 }, real.m());
    let measure = |k: usize, u: &Channels| {
        let mut y = run(real, u);
        add_noise(&mut y, 110 + k as u64, &std);
        y
    };
    let mut case = four_records(sim, &std, [1.0, 0.5, 1.0], input, measure);
    case.config.sim = Some("sim.json".into());
    case
}

/// Returns the relative difference of the free runs of two models for an input to which neither was fitted.
pub fn apart(a: &Model, b: &Model) -> f64 {
    let u = random_input(99, 2048, a.m());
    let (a, b) = (run(a, &u), run(b, &u));
    let difference: Vec<f64> = a.iter().flatten().zip(b.iter().flatten()).map(|(a, b)| a - b).collect();
    rms(&difference) / rms(b.iter().flatten())
}

/// Diagnoses a case with the standard vocabulary.
pub fn diagnosed(case: &Case) -> Diagnosis {
    crate::diagnose(case, &Library::standard(), &mut |_| {}).unwrap().diagnosis
}

/// Diagnoses a case with [`only`] these effects.
pub fn diagnosed_among(mut case: Case, effects: &[&str]) -> Diagnosis {
    only(&mut case, effects);
    diagnosed(&case)
}

/// Checks the name and the location of the first named effect. Returns this effect.
pub fn first_is<'d>(found: &'d Diagnosis, effect: &str, location: &str) -> &'d NamedEffect {
    let first = &found.effects[0];
    assert_eq!((first.effect.as_str(), first.location.as_str()), (effect, location), "{}", found.sentence);
    first
}

/// Restricts the search to these effects and the stochastic ones. Few rivals make the search short.
pub fn only(case: &mut Case, effects: &[&str]) {
    let library = Library::standard();
    let others = library.effects().filter(|effect| !effect.is_stochastic() && !effects.contains(&effect.name()));
    case.config.exclude = others.map(|effect| effect.name().into()).collect();
}

/// Returns a case of [`four_records`] of an axis at levels 1, 0.5 and 1, with a command in N and a position in m. `run`
/// computes the outputs for the inputs of a record, and 0.5 % of noise is added to them.
pub fn case_of_axis(sim: &Model, input: impl Fn(usize) -> Channels, run: impl Fn(&Channels) -> Channels) -> Case {
    let std = [0.005 * rms(&run(&input(0))[0])];
    let measure = |k: usize, u: &Channels| {
        let mut y = run(u);
        add_noise(&mut y, k as u64 + 50, &std);
        y
    };
    let mut case = four_records(sim, &std, [1.0, 0.5, 1.0], input, measure);
    case.config.units = [("u1", "N"), ("y1", "m")].map(|(name, unit)| (name.into(), unit.into())).into();
    case
}

/// Adds white noise of these standard deviations to the outputs.
pub fn add_noise(y: &mut Channels, seed: u64, std: &[f64]) {
    let noise = random_input(seed, y[0].len(), y.len());
    for ((y, noise), std) in y.iter_mut().zip(&noise).zip(std) {
        y.iter_mut().zip(noise).for_each(|(y, e)| *y += std * e);
    }
}

/// Adds to each of two outputs a share of its product with the other output 40 samples earlier: an imperfection that no
/// effect explains. `size` holds the RMS values of the outputs.
pub fn add_products(y: &mut Channels, share: f64, size: &[f64]) {
    let earlier = y.clone();
    for (o, y) in y.iter_mut().enumerate() {
        let changed = y.iter_mut().skip(40).zip(&earlier[1 - o]);
        changed.for_each(|(y, earlier)| *y += share * *y * earlier / size[1 - o]);
    }
}

/// Returns a case of the simulation and of four records: `quiet` without input, and `random-1` to `random-3` at these
/// levels. `input` gives the inputs of a record (numbered from 0) at level one, and `measure` gives the outputs for the
/// inputs of a record. The case declares sensor noise of these standard deviations.
pub fn four_records(
    sim: &Model,
    std: &[f64],
    levels: [f64; 3],
    input: impl Fn(usize) -> Channels,
    mut measure: impl FnMut(usize, &Channels) -> Channels,
) -> Case {
    let mut records = Vec::new();
    let mut start_s = 0.0;
    for (k, level) in std::iter::once(0.0).chain(levels).enumerate() {
        let mut u = input(k);
        u.iter_mut().flatten().for_each(|u| *u *= level);
        let y = measure(k, &u);
        let (name, excitation) = match k {
            0 => ("quiet".to_string(), Excitation::Zero),
            _ => (format!("random-{k}"), Excitation::Random),
        };
        let record = Record { name, excitation, start_s, ..record(u, y) };
        start_s += record.samples() as f64 / sim.sample_rate_hz;
        records.push(record);
    }
    let config = CaseConfig::new(sim.sample_rate_hz, sim.inputs.clone(), sim.outputs.clone());
    let mut sim = sim.clone();
    sim.noise.sensor_std = Some(std.to_vec());
    sim.noise.actuator_std = Some(vec![0.0; sim.m()]);
    Case { config, model: Some(sim), controller: None, records, for_simulation: Vec::new(), warnings: Vec::new() }
}
