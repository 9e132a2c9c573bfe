//! numeris: fixed sizes, SIMD products of its own. Its extended filter: Joseph's update, made symmetric.

use numeris::estimate::Ekf;
use numeris::{Matrix, Vector};

use crate::joint::Joint;
use crate::peer::{Failure, Peer};
use crate::workload::{CHANNELS, Case};

/// numeris.
pub struct Numeris<const N: usize> {
    joint: Joint,
    rows: Vec<usize>,
    r: Matrix<f64, CHANNELS, CHANNELS>,
    h: Matrix<f64, CHANNELS, N>,
    f: Box<Matrix<f64, N, N>>,
    q: Box<Matrix<f64, N, N>>,
    filter: Box<Ekf<f64, N, CHANNELS>>,
}

impl<const N: usize> Numeris<N> {
    /// For the shapes and the noise of `case`.
    pub fn new(case: &Case) -> Self {
        let (mut h, mut r) = (Matrix::zeros(), Matrix::zeros());
        for (i, &row) in case.rows.iter().enumerate() {
            h[(i, row)] = 1.0;
            r[(i, i)] = case.sensor[i];
        }
        Self {
            joint: Joint::new(case),
            rows: case.rows.clone(),
            r,
            h,
            f: Box::new(Matrix::zeros()),
            q: Box::new(Matrix::zeros()),
            filter: Box::new(Ekf::new(Vector::zeros(), Matrix::zeros())),
        }
    }
}

impl<const N: usize> Peer for Numeris<N> {
    fn load(&mut self, s: &[f64], p: &[f64]) -> Result<(), Failure> {
        self.filter.x.as_mut_slice().copy_from_slice(s);
        self.filter.p.as_mut_slice().copy_from_slice(p);
        Ok(())
    }

    fn step(&mut self, z: &[f64; CHANNELS], u: &[f64; CHANNELS]) -> Result<(), Failure> {
        let Self { joint, rows, r, h, f, q, filter } = self;
        let observe = |s: &Vector<f64, N>| Vector::from_array(std::array::from_fn(|i| s.as_slice()[rows[i]]));
        filter.update(&Vector::from_array(*z), observe, |_| *h, r).map_err(|error| format!("{error:?}"))?;
        joint.jacobian(filter.x.as_slice(), u, |i, j, value| f[(i, j)] = value);
        joint.process_noise(filter.x.as_slice(), |i, j, value| q[(i, j)] = value);
        let advance = |s: &Vector<f64, N>| {
            let mut s = *s;
            joint.advance(s.as_mut_slice(), u);
            s
        };
        filter.predict(advance, |_| **f, Some(q));
        Ok(())
    }

    fn estimate(&self) -> Result<(Vec<f64>, Vec<f64>), Failure> {
        Ok((self.filter.x.as_slice().to_vec(), self.filter.p.as_slice().to_vec()))
    }
}
