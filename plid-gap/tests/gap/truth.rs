//! The independent solution: the equations of a truss in continuous time, integrated by another library's Runge-Kutta
//! method (Dormand and Prince, order 8), sample by sample of the held command.

use nalgebra::{DMatrix, DVector};
use ode_solvers::{Dop853, OutputType, System};
use plid_model::{Model, Port};

use crate::truss::RATE;

/// Channels of samples (p or m).
pub type Channels = Vec<Vec<f64>>;

/// Error of a step, relative to the largest state. A hundredth of it changes no result here by more than 2e-8 of the
/// outputs (`a_finer_integration_changes_nothing`).
pub const TOLERANCE: f64 = 1e-10;

/// A force inside the structure, as a function of displacement d and velocity v of its port and of an internal state z.
pub struct Joint<'a> {
    /// The port of the force.
    pub port: &'a Port,
    /// f(d, v, z).
    pub force: &'a dyn Fn(f64, f64, f64) -> f64,
    /// Unit of z, chosen for z to be of similar size as the other states, because the tolerance is relative to the
    /// largest.
    pub unit: f64,
    /// dz/dt as a function of d, v and z.
    pub slip: &'a dyn Fn(f64, f64, f64) -> f64,
}

/// A force at a port as a function of time, held over a sample.
pub struct Push<'a> {
    /// The port of the force.
    pub port: &'a Port,
    /// The force from t_k on, as a function of the number of the sample.
    pub force: &'a dyn Fn(usize) -> f64,
}

/// A number as a function of time.
pub type OfTime<'a> = &'a dyn Fn(f64) -> f64;

/// dx/dt = (a + (factor(t) - 1) stiffening) x + b u + forces, y = c x.
pub struct Equations<'a> {
    /// State matrix (n x n).
    pub a: &'a DMatrix<f64>,
    /// Input matrix (n x m).
    pub b: &'a DMatrix<f64>,
    /// Output matrix (p x n), as a function of the factor.
    pub c: &'a dyn Fn(f64) -> DMatrix<f64>,
    /// Change of `a` by a further unit of stiffness, and the factor of the stiffness as a function of time.
    pub stiffening: Option<(&'a DMatrix<f64>, OfTime<'a>)>,
    /// A force that depends on the motion.
    pub joint: Option<Joint<'a>>,
    /// A force that depends on time.
    pub push: Option<Push<'a>>,
}

/// The result of a run.
pub struct Motion {
    /// Outputs.
    pub y: Channels,
    /// Displacement of the joint's port at the samples.
    pub d: Vec<f64>,
    /// Its velocity.
    pub v: Vec<f64>,
}

struct Field<F>(F);

impl<F: Fn(f64, &[f64], &mut [f64])> System<f64, ode_solvers::DVector<f64>> for Field<F> {
    fn system(&self, t: f64, x: &ode_solvers::DVector<f64>, rate: &mut ode_solvers::DVector<f64>) {
        (self.0)(t, x.as_slice(), rate.as_mut_slice());
    }
}

/// Integrates dx/dt = rate(t, x) from one time to another.
pub fn advance(x: &mut [f64], from: f64, to: f64, tolerance: f64, rate: impl Fn(f64, &[f64], &mut [f64])) {
    let absolute = tolerance * x.iter().fold(1e-3, |most: f64, x| most.max(x.abs()));
    let start = ode_solvers::DVector::from_column_slice(x);
    let (time, parameters) = (to - from, (0.9, 0.0, 0.333, 6.0));
    let (safety, beta, least, most) = parameters;
    let mut solver = Dop853::from_param(
        Field(rate),
        from,
        to,
        time,
        start,
        tolerance,
        absolute,
        safety,
        beta,
        least,
        most,
        time,
        0.3 * time,
        100_000,
        u32::MAX,
        OutputType::Sparse,
    );
    solver.integrate().expect("the equations are smooth enough");
    x.copy_from_slice(solver.y_out().last().expect("the end").as_slice());
}

impl Equations<'_> {
    /// Runs from rest at t0 with the held command of each sample. An output is sampled before the command of its sample
    /// acts.
    pub fn run(&self, t0: f64, samples: usize, command: impl Fn(usize) -> Vec<f64>, tolerance: f64) -> Motion {
        let n = self.a.nrows();
        // The last state is that of the joint.
        let mut x = vec![0.0; n + 1];
        let (mut d, mut v) = (Vec::new(), Vec::new());
        let mut y: Channels = Vec::new();
        let row = |row: &[f64], x: &[f64]| row.iter().zip(x).map(|(r, x)| r * x).sum::<f64>();
        for k in 0..samples {
            let start = t0 + k as f64 / RATE;
            let factor = |t: f64| self.stiffening.map_or(1.0, |(_, factor)| factor(t));
            let mut out = (self.c)(factor(start)) * DVector::from_column_slice(&x[..n]);
            if let Some(joint) = &self.joint {
                let (seen_d, seen_v) = (row(&joint.port.displacement, &x), row(&joint.port.velocity, &x));
                d.push(seen_d);
                v.push(seen_v);
                if let Some(output) = &joint.port.output {
                    out += DVector::from_column_slice(output) * (joint.force)(seen_d, seen_v, x[n] * joint.unit);
                }
            }
            if let Some(Push { port: Port { output: Some(output), .. }, force }) = &self.push {
                // The outputs are sampled before the next value acts.
                out += DVector::from_column_slice(output) * if k > 0 { force(k - 1) } else { 0.0 };
            }
            y.resize(out.len(), Vec::new());
            y.iter_mut().zip(out.iter()).for_each(|(y, out)| y.push(*out));
            let held = command(k);
            // Time counts from zero, because far from it the time within a sample loses digits.
            advance(&mut x, 0.0, 1.0 / RATE, tolerance, |since, x, rate| {
                let t = start + since;
                let matrix = self.a.as_slice();
                rate.fill(0.0);
                for j in 0..n {
                    rate.iter_mut().zip(&matrix[j * n..]).take(n).for_each(|(r, a)| *r += a * x[j]);
                }
                if let Some((more, factor)) = self.stiffening {
                    let by = factor(t) - 1.0;
                    let more = more.as_slice();
                    for j in 0..n {
                        rate.iter_mut().zip(&more[j * n..]).take(n).for_each(|(r, a)| *r += by * a * x[j]);
                    }
                }
                for (i, u) in held.iter().enumerate() {
                    rate.iter_mut().zip(self.b.column(i).iter()).for_each(|(r, b)| *r += b * u);
                }
                if let Some(push) = &self.push {
                    let force = (push.force)(k);
                    rate.iter_mut().zip(&push.port.force).for_each(|(r, g)| *r += g * force);
                }
                if let Some(joint) = &self.joint {
                    let (d, v, z) = (row(&joint.port.displacement, x), row(&joint.port.velocity, x), x[n] * joint.unit);
                    let force = (joint.force)(d, v, z);
                    rate.iter_mut().zip(&joint.port.force).for_each(|(r, g)| *r += g * force);
                    rate[n] = (joint.slip)(d, v, z) / joint.unit;
                }
            });
        }
        Motion { y, d, v }
    }
}

/// Runs the linear simulation as in model.json: x+ = A x + B u, y = C x + D u.
pub fn linear(model: &Model, u: &[Vec<f64>]) -> Channels {
    let mut x = DVector::zeros(model.a.nrows());
    let mut y = vec![Vec::new(); model.c.nrows()];
    for k in 0..u[0].len() {
        let now = DVector::from_iterator(u.len(), u.iter().map(|u| u[k]));
        let out = &model.c * &x + &model.d * &now;
        y.iter_mut().zip(out.iter()).for_each(|(y, out)| y.push(*out));
        x = &model.a * x + &model.b * now;
    }
    y
}

/// Returns the RMS over all channels.
pub fn size(channels: &[Vec<f64>]) -> f64 {
    let count = channels.iter().map(Vec::len).sum::<usize>();
    (channels.iter().flatten().map(|x| x * x).sum::<f64>() / count as f64).sqrt()
}

/// Returns the difference of two sets of channels.
pub fn minus(a: &[Vec<f64>], b: &[Vec<f64>]) -> Channels {
    a.iter().zip(b).map(|(a, b)| a.iter().zip(b).map(|(a, b)| a - b).collect()).collect()
}
