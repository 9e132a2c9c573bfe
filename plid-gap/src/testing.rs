//! A small structure for tests: modes behind actuators' poles and filters, in an arbitrary basis. Its equations are written out
//! here in physical form, so that they check the modal form.

use std::f64::consts::TAU;

use nalgebra::DMatrix;
use plid_model::{Continuous, Model, Port};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

use crate::record::Channels;

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
