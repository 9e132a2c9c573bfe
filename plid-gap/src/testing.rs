//! A small structure for tests: modes behind actuators' poles and filters, in an arbitrary basis. Its equations are written out
//! here in physical form, so that they check the modal form.

use std::f64::consts::TAU;

use nalgebra::DMatrix;
use plid_model::{Continuous, Model, Port};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

use crate::case::{Case, CaseConfig};
use crate::nuisance::Limits;
use crate::record::{Channels, Excitation, Record, rms};

/// Samples a second.
pub const RATE: f64 = 1600.0;

/// Frequencies and damping ratios.
pub const MODES: [(f64, f64); 4] = [(58.0, 0.01), (137.0, 0.008), (186.0, 0.012), (243.0, 0.006)];

/// Two actuators with a pole at 260 Hz, two accelerometers behind a two-pole filter at 600 Hz, declared ports.
pub fn truss(seed: u64) -> Model {
    truss_with(seed, |_, _, _| {})
}

/// The same with frequencies and damping ratios, input shapes (modes x 2) and output shapes (2 x modes) changed.
pub fn truss_with(seed: u64, change: impl FnOnce(&mut [(f64, f64)], &mut DMatrix<f64>, &mut DMatrix<f64>)) -> Model {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut normal = || -> f64 { rng.sample(StandardNormal) };
    let (q, m, p) = (MODES.len(), 2, 2);
    let mut beta = DMatrix::from_fn(q, m, |_, _| normal());
    let mut gamma = DMatrix::from_fn(p, q, |_, _| 0.05 * normal());
    let mut modes = MODES;
    change(&mut modes, &mut beta, &mut gamma);
    let n = 2 * q + m + 2 * p;
    let (mut a, mut b, mut c) = (DMatrix::zeros(n, n), DMatrix::zeros(n, m), DMatrix::zeros(p, n));
    let mut ports: Vec<Port> = (0..m)
        .map(|i| Port {
            name: format!("strut{}", i + 1),
            input: Some(format!("u{}", i + 1)),
            force: vec![0.0; n],
            displacement: vec![0.0; n],
            velocity: vec![0.0; n],
            output: None,
        })
        .collect();
    let (actuator, filter) = (TAU * 260.0, TAU * 600.0);
    let acting = 2 * q;
    let filters = acting + m;
    for (k, (hz, zeta)) in modes.iter().enumerate() {
        let w = TAU * hz;
        a[(2 * k, 2 * k + 1)] = 1.0;
        a[(2 * k + 1, 2 * k)] = -w * w;
        a[(2 * k + 1, 2 * k + 1)] = -2.0 * zeta * w;
        for i in 0..m {
            a[(2 * k + 1, acting + i)] = beta[(k, i)];
            ports[i].force[2 * k + 1] = beta[(k, i)];
            ports[i].displacement[2 * k] = beta[(k, i)];
            ports[i].velocity[2 * k + 1] = beta[(k, i)];
        }
    }
    for i in 0..m {
        a[(acting + i, acting + i)] = -actuator;
        b[(acting + i, i)] = actuator;
    }
    for o in 0..p {
        let at = filters + 2 * o;
        a[(at, at + 1)] = 1.0;
        a[(at + 1, at)] = -filter * filter;
        a[(at + 1, at + 1)] = -2_f64.sqrt() * filter;
        // filter^2 times the acceleration.
        for k in 0..q {
            for j in 0..n {
                let acceleration = a[(2 * k + 1, j)];
                a[(at + 1, j)] += filter * filter * gamma[(o, k)] * acceleration;
            }
            for port in &mut ports {
                port.force[at + 1] += filter * filter * gamma[(o, k)] * port.force[2 * k + 1];
            }
        }
        c[(o, at)] = 1.0;
    }
    // Another basis, of states of like size, so that nothing rests on this one.
    let basis = DMatrix::from_fn(n, n, |i, j| if i == j { 1.0 } else { 0.2 * normal() });
    let scale = DMatrix::from_diagonal(&nalgebra::DVector::from_fn(n, |j, _| match j {
        j if j < 2 * q && j % 2 == 0 => 1e4,
        j if j < 2 * q => 10.0,
        j if j < filters => 1.0,
        j if (j - filters) % 2 == 0 => 10.0,
        _ => 10.0 / filter,
    }));
    let basis = basis * scale;
    let inverse = basis.clone().try_inverse().expect("a random matrix has an inverse");
    let (a, b, c) = (&basis * a * &inverse, &basis * b, c * &inverse);
    for port in &mut ports {
        let row = |values: &[f64]| DMatrix::from_row_slice(1, n, values);
        port.force = (&basis * DMatrix::from_column_slice(n, 1, &port.force)).as_slice().to_vec();
        port.displacement = (row(&port.displacement) * &inverse).as_slice().to_vec();
        port.velocity = (row(&port.velocity) * &inverse).as_slice().to_vec();
    }
    let mut whole = DMatrix::zeros(n + m, n + m);
    whole.view_mut((0, 0), (n, n)).copy_from(&(&a / RATE));
    whole.view_mut((0, n), (n, m)).copy_from(&(&b / RATE));
    let whole = whole.exp();
    let held = whole.view((0, n), (n, m)).into_owned();
    let step = whole.view((0, 0), (n, n)).into_owned();
    let mut model = Model::new(RATE, step, held, c, DMatrix::zeros(p, m)).expect("a sound model");
    model.continuous = Some(Continuous { a, b });
    model.ports = ports;
    model.noise.sensor_std = Some(vec![0.005; p]);
    model.noise.actuator_std = Some(vec![0.005; m]);
    model
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
        records.push(Record { name, excitation, from_rest: true, start_s, held_out: false, u, y, simulated: None });
        start_s += samples as f64 / RATE;
    }
    let mut sim = sim.clone();
    sim.noise.sensor_std = Some(std);
    sim.noise.actuator_std = Some(vec![0.0; sim.m()]);
    Case { config, model: Some(sim), records, for_simulation: Vec::new(), warnings: Vec::new() }
}
