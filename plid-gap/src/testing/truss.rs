//! A small structure for tests, with modes, actuators and filters. Its equations are written here in physical form, as
//! a check of the modal form, and use no code of this crate.

use std::f64::consts::TAU;

use nalgebra::{DMatrix, DVector};
use plid_model::{Continuous, Model, Port, held};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

/// Sample rate in Hz.
pub const RATE: f64 = 1600.0;

/// The quantity that a sensor measures.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sensor {
    /// Position, gamma q.
    Position,
    /// Velocity, gamma q'.
    Velocity,
    /// Acceleration, gamma q".
    Acceleration,
}

/// A structure with q" + 2 zeta w q' + w^2 q = beta a for each mode and a' = pole (u - a) for each actuator. Sensors
/// have a two-pole filter.
#[derive(Debug, Clone)]
pub struct Truss {
    /// Frequencies in Hz and damping ratios.
    pub modes: Vec<(f64, f64)>,
    /// Input shapes (modes x inputs).
    pub beta: DMatrix<f64>,
    /// Output shapes (outputs x modes).
    pub gamma: DMatrix<f64>,
    /// Poles of the actuators in Hz.
    pub actuators_hz: Vec<f64>,
    /// Frequency of the filters in Hz. Without filters, the motion is measured directly.
    pub filter_hz: Option<f64>,
    /// The sensor of all outputs.
    pub sensor: Sensor,
}

/// The equations dx/dt = a x + b u + the sum of force f over the ports, and y = c x + the sum of output f.
#[derive(Debug, Clone)]
pub struct Equations {
    /// State matrix (n x n).
    pub a: DMatrix<f64>,
    /// Input matrix (n x m).
    pub b: DMatrix<f64>,
    /// Output matrix (p x n).
    pub c: DMatrix<f64>,
    /// The port of each input.
    pub ports: Vec<Port>,
}

impl Truss {
    /// Draws two inputs and two outputs of random shapes, actuators with a pole at 260 Hz, and filters at 600 Hz.
    pub fn draw(modes: &[(f64, f64)], rng: &mut ChaCha8Rng) -> Self {
        let mut normal = || -> f64 { rng.sample(StandardNormal) };
        let beta = DMatrix::from_fn(modes.len(), 2, |_, _| normal());
        let gamma = DMatrix::from_fn(2, modes.len(), |_, _| 0.05 * normal());
        Self {
            modes: modes.to_vec(),
            beta,
            gamma,
            actuators_hz: vec![260.0; 2],
            filter_hz: Some(600.0),
            sensor: Sensor::Acceleration,
        }
    }

    /// Returns a port at each actuator. Its vectors of `n` states are zero; the caller fills them.
    fn ports(&self, n: usize) -> Vec<Port> {
        let (m, p) = (self.beta.ncols(), self.gamma.nrows());
        (0..m)
            .map(|i| Port {
                name: format!("strut{}", i + 1),
                input: Some(format!("u{}", i + 1)),
                force: vec![0.0; n],
                displacement: vec![0.0; n],
                velocity: vec![0.0; n],
                output: self.filter_hz.is_none().then(|| vec![0.0; p]),
            })
            .collect()
    }

    /// Returns the equations in the states (q, q') of each mode, a of each actuator, and two of each filter.
    pub fn equations(&self) -> Equations {
        let (q, m, p) = (self.modes.len(), self.beta.ncols(), self.gamma.nrows());
        let (acting, filters) = (2 * q, 2 * q + m);
        let n = if self.filter_hz.is_some() { filters + 2 * p } else { filters };
        let (mut a, mut b, mut c) = (DMatrix::zeros(n, n), DMatrix::zeros(n, m), DMatrix::zeros(p, n));
        let mut ports = self.ports(n);
        for (k, (hz, zeta)) in self.modes.iter().enumerate() {
            let w = TAU * hz;
            a[(2 * k, 2 * k + 1)] = 1.0;
            a[(2 * k + 1, 2 * k)] = -w * w;
            a[(2 * k + 1, 2 * k + 1)] = -2.0 * zeta * w;
            for i in 0..m {
                a[(2 * k + 1, acting + i)] = self.beta[(k, i)];
                ports[i].force[2 * k + 1] = self.beta[(k, i)];
                ports[i].displacement[2 * k] = self.beta[(k, i)];
                ports[i].velocity[2 * k + 1] = self.beta[(k, i)];
            }
        }
        for (i, hz) in self.actuators_hz.iter().enumerate() {
            a[(acting + i, acting + i)] = -TAU * hz;
            b[(acting + i, i)] = TAU * hz;
        }
        for o in 0..p {
            // The measured motion is a function of the states and, for an acceleration, also a direct function of the
            // force.
            let mut motion = DVector::zeros(n);
            let mut at_once = vec![0.0; m];
            for k in 0..q {
                match self.sensor {
                    Sensor::Position => motion[2 * k] += self.gamma[(o, k)],
                    Sensor::Velocity => motion[2 * k + 1] += self.gamma[(o, k)],
                    Sensor::Acceleration => {
                        motion += a.row(2 * k + 1).transpose() * self.gamma[(o, k)];
                        let forces = ports.iter().map(|port| port.force[2 * k + 1]);
                        at_once.iter_mut().zip(forces).for_each(|(sum, force)| *sum += self.gamma[(o, k)] * force);
                    }
                }
            }
            let Some(hz) = self.filter_hz else {
                c.row_mut(o).copy_from(&motion.transpose());
                for (port, at_once) in ports.iter_mut().zip(at_once) {
                    port.output.as_mut().expect("without a filter")[o] = at_once;
                }
                continue;
            };
            let (at, w) = (filters + 2 * o, TAU * hz);
            a[(at, at + 1)] = 1.0;
            let mut row = motion * (w * w);
            row[at] -= w * w;
            row[at + 1] -= 2_f64.sqrt() * w;
            a.row_mut(at + 1).copy_from(&row.transpose());
            for (port, at_once) in ports.iter_mut().zip(at_once) {
                port.force[at + 1] = w * w * at_once;
            }
            c[(o, at)] = 1.0;
        }
        Equations { a, b, c, ports }
    }

    /// Returns the structure as a model in a random basis, with states of similar size. No test depends on the basis.
    pub fn model(&self, rng: &mut ChaCha8Rng) -> Model {
        let Equations { a, b, c, mut ports } = self.equations();
        let (n, m, p) = (a.nrows(), b.ncols(), c.nrows());
        let (modal, filters) = (2 * self.modes.len(), 2 * self.modes.len() + m);
        let mut normal = || -> f64 { rng.sample(StandardNormal) };
        let basis = DMatrix::from_fn(n, n, |i, j| if i == j { 1.0 } else { 0.2 * normal() });
        let scale = DMatrix::from_diagonal(&DVector::from_fn(n, |j, _| match j {
            j if j < modal && j % 2 == 0 => 1e4,
            j if j < modal => 10.0,
            j if j < filters => 1.0,
            j if (j - filters) % 2 == 0 => 10.0,
            _ => 10.0 / (TAU * self.filter_hz.unwrap_or(RATE)),
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
        let (step, held) = held(&a, &b, 1.0 / RATE);
        let mut model = Model::new(RATE, step, held, c, DMatrix::zeros(p, m)).expect("a sound model");
        model.continuous = Some(Continuous { a, b });
        model.ports = ports;
        model.noise.sensor_std = Some(vec![0.005; p]);
        model.noise.actuator_std = Some(vec![0.005; m]);
        model
    }
}
