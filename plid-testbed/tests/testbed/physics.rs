//! The equations of motion as one would write them on paper, in plain modal coordinates, with a classical Runge-Kutta
//! rule and steps so small that its error does not matter.

use ndarray::{Array2, ArrayView2};
use plid_testbed::{ACTUATOR_POLE_HZ, ANTI_ALIAS_HZ, Mode};
use std::f64::consts::{PI, SQRT_2};

type OfTime = Box<dyn Fn(f64) -> f64>;
type OfStruts = Box<dyn Fn([f64; 3], [f64; 3]) -> [f64; 3]>;
type OfMotion = Box<dyn Fn(f64, f64) -> f64>;

/// The structure with what effects change of it.
pub struct Physics<'a> {
    pub modes: &'a [Mode],
    pub poles_hz: [f64; 3],
    /// Factors of w^2 and of the damping ratio over time.
    pub stiffness: OfTime,
    pub damping: OfTime,
    /// An inner force at a strut (from 0), of its displacement and velocity.
    pub force: Option<(usize, OfMotion)>,
    /// Inner forces at all struts, of the actuators' outputs and of the displacements.
    pub forces: Option<OfStruts>,
    /// A force along a strut over the samples' times.
    pub disturbance: Option<(usize, OfTime)>,
}

#[derive(Clone)]
struct Motion {
    actuator: [f64; 3],
    q: Vec<f64>,
    dq: Vec<f64>,
    y: [f64; 3],
    dy: [f64; 3],
}

impl Motion {
    fn plus(&self, h: f64, rate: &Motion) -> Motion {
        let three = |a: &[f64; 3], b: &[f64; 3]| std::array::from_fn(|i| a[i] + h * b[i]);
        let many = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a + h * b).collect();
        Motion {
            actuator: three(&self.actuator, &rate.actuator),
            q: many(&self.q, &rate.q),
            dq: many(&self.dq, &rate.dq),
            y: three(&self.y, &rate.y),
            dy: three(&self.dy, &rate.dy),
        }
    }
}

impl<'a> Physics<'a> {
    /// Without any effect.
    pub fn of(modes: &'a [Mode]) -> Self {
        let poles_hz = [ACTUATOR_POLE_HZ; 3];
        let (stiffness, damping) = (Box::new(|_t| 1.0), Box::new(|_t| 1.0));
        Self { modes, poles_hz, stiffness, damping, force: None, forces: None, disturbance: None }
    }

    /// A strut's displacement in V, or its velocity.
    fn seen(&self, strut: usize, q: &[f64]) -> f64 {
        let squares = |m: &Mode| (m.input_shape[strut] / (2.0 * PI * m.frequency_hz)).powi(2);
        let unit: f64 = self.modes.iter().map(squares).sum();
        self.modes.iter().zip(q).map(|(m, q)| m.input_shape[strut] * q).sum::<f64>() / unit
    }

    fn rate(&self, t: f64, s: &Motion, u: &[f64; 3], shake: [f64; 3]) -> Motion {
        let corner = 2.0 * PI * ANTI_ALIAS_HZ;
        let mut push: [f64; 3] = std::array::from_fn(|j| s.actuator[j] + shake[j]);
        if let Some((strut, force)) = &self.force {
            push[*strut] += force(self.seen(*strut, &s.q), self.seen(*strut, &s.dq));
        }
        if let Some(forces) = &self.forces {
            let inner = forces(s.actuator, std::array::from_fn(|j| self.seen(j, &s.q)));
            (0..3).for_each(|j| push[j] += inner[j]);
        }
        let mut acceleration = [0.0; 3];
        let mut ddq = Vec::new();
        for (m, mode) in self.modes.iter().enumerate() {
            let w = 2.0 * PI * mode.frequency_hz;
            let force: f64 = (0..3).map(|j| mode.input_shape[j] * push[j]).sum();
            let damping = 2.0 * mode.damping_ratio * w * (self.damping)(t);
            let a = force - damping * s.dq[m] - w * w * (self.stiffness)(t) * s.q[m];
            for i in 0..3 {
                acceleration[i] += mode.output_shape[i] * a;
            }
            ddq.push(a);
        }
        Motion {
            actuator: std::array::from_fn(|j| 2.0 * PI * self.poles_hz[j] * (u[j] - s.actuator[j])),
            q: s.dq.clone(),
            dq: ddq,
            y: s.dy,
            dy: std::array::from_fn(|i| corner * corner * (acceleration[i] - s.y[i]) - SQRT_2 * corner * s.dy[i]),
        }
    }

    /// Outputs at the samples, from rest, with commands held between.
    pub fn run(&self, commands: ArrayView2<f64>, rate_hz: f64, steps: usize) -> Array2<f64> {
        let n = self.modes.len();
        let mut s = Motion { actuator: [0.0; 3], q: vec![0.0; n], dq: vec![0.0; n], y: [0.0; 3], dy: [0.0; 3] };
        let h = 1.0 / (rate_hz * steps as f64);
        let mut outputs = Array2::zeros((commands.nrows(), 3));
        for k in 0..commands.nrows() {
            (0..3).for_each(|i| outputs[(k, i)] = s.y[i]);
            let u = std::array::from_fn(|j| commands[(k, j)]);
            let mut shake = [0.0; 3];
            if let Some((strut, force)) = &self.disturbance {
                shake[*strut] = force(k as f64 / rate_hz);
            }
            for step in 0..steps {
                let t = k as f64 / rate_hz + step as f64 * h;
                let k1 = self.rate(t, &s, &u, shake);
                let k2 = self.rate(t + h / 2.0, &s.plus(h / 2.0, &k1), &u, shake);
                let k3 = self.rate(t + h / 2.0, &s.plus(h / 2.0, &k2), &u, shake);
                let k4 = self.rate(t + h, &s.plus(h, &k3), &u, shake);
                s = s.plus(h / 6.0, &k1).plus(h / 3.0, &k2).plus(h / 3.0, &k3).plus(h / 6.0, &k4);
            }
        }
        outputs
    }
}
