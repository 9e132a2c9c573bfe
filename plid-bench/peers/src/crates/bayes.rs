//! bayes_estimate: sizes at run time (nalgebra). Its covariance filter, and Bierman's and Thornton's UD filter.

use bayes_estimate::estimators::ud::{ObserveScratch, PredictScratch, UDState};
use bayes_estimate::models::{ExtendedLinearObserver, ExtendedLinearPredictor, KalmanEstimator, KalmanState};
use bayes_estimate::noise::{CorrelatedNoise, CoupledNoise, UncorrelatedNoise};
use nalgebra_035::{DMatrix, DVector, Dyn};

use crate::joint::{Joint, make_symmetric};
use crate::peer::{Failure, Peer};
use crate::workload::{CHANNELS, Case};

fn observation(case: &Case) -> DMatrix<f64> {
    DMatrix::from_fn(CHANNELS, case.joint, |i, j| if case.rows[i] == j { 1.0 } else { 0.0 })
}

fn kalman_state(s: &[f64], p: &[f64]) -> KalmanState<f64, Dyn> {
    KalmanState { x: DVector::from_column_slice(s), X: DMatrix::from_column_slice(s.len(), s.len(), p) }
}

/// The covariance filter: P+ = P - K S K^T, made symmetric here. Without that the asymmetry grows until P is lost,
/// within 60 samples.
pub struct BayesCovariance {
    joint: Joint,
    rows: Vec<usize>,
    h: DMatrix<f64>,
    r: CorrelatedNoise<f64, Dyn>,
    f: DMatrix<f64>,
    q: CorrelatedNoise<f64, Dyn>,
    state: KalmanState<f64, Dyn>,
}

impl BayesCovariance {
    /// For the shapes and the noise of `case`.
    pub fn new(case: &Case) -> Self {
        let square = DMatrix::zeros(case.joint, case.joint);
        Self {
            joint: Joint::new(case),
            rows: case.rows.clone(),
            h: observation(case),
            r: CorrelatedNoise { Q: DMatrix::from_diagonal(&DVector::from_column_slice(&case.sensor)) },
            f: square.clone(),
            q: CorrelatedNoise { Q: square.clone() },
            state: KalmanState { x: DVector::zeros(case.joint), X: square },
        }
    }
}

impl Peer for BayesCovariance {
    fn load(&mut self, s: &[f64], p: &[f64]) -> Result<(), Failure> {
        self.state = kalman_state(s, p);
        Ok(())
    }

    fn step(&mut self, z: &[f64; CHANNELS], u: &[f64; CHANNELS]) -> Result<(), Failure> {
        let Self { joint, rows, h, r, f, q, state } = self;
        let innovation = DVector::from_fn(CHANNELS, |i, _| z[i] - state.x[rows[i]]);
        state.observe_innovation(&innovation, h, r)?;
        make_symmetric(state.X.as_mut_slice(), state.x.len());
        let mut s = state.x.clone();
        joint.jacobian(s.as_slice(), u, |i, j, value| f[(i, j)] = value);
        joint.process_noise(s.as_slice(), |i, j, value| q.Q[(i, j)] = value);
        joint.advance(s.as_mut_slice(), u);
        state.predict(&s, f, q)?;
        Ok(())
    }

    fn estimate(&self) -> Result<(Vec<f64>, Vec<f64>), Failure> {
        Ok((self.state.x.as_slice().to_vec(), self.state.X.as_slice().to_vec()))
    }
}

/// The UD filter. Outputs come one at a time, each with its own innovation: given all at once, that crate corrects with
/// the innovations from before the first of them. Qbar = G diag(q) G^T with G = [I, B], q = [Sigma; Q].
pub struct BayesUd {
    joint: Joint,
    n: usize,
    rows: Vec<usize>,
    h: Vec<DMatrix<f64>>,
    r: Vec<UncorrelatedNoise<f64, Dyn>>,
    f: DMatrix<f64>,
    noise: CoupledNoise<f64, Dyn, Dyn>,
    state: UDState<f64, Dyn>,
    observe: ObserveScratch<f64, Dyn>,
    predict: PredictScratch<f64, Dyn, Dyn>,
}

impl BayesUd {
    /// For the shapes and the noise of `case`.
    pub fn new(case: &Case) -> Self {
        let (n, joint) = (case.states, case.joint);
        let whole = observation(case);
        let state = UDState::new(DMatrix::identity(joint, joint), DVector::zeros(joint));
        let mut coupling = DMatrix::zeros(joint, n + CHANNELS);
        coupling.fill_diagonal(1.0);
        coupling.columns_mut(n, CHANNELS).fill(0.0);
        let q = case.state.iter().chain(&case.actuator).copied();
        Self {
            joint: Joint::new(case),
            n,
            rows: case.rows.clone(),
            h: (0..CHANNELS).map(|i| whole.rows(i, 1).into_owned()).collect(),
            r: case.sensor.iter().map(|&r| UncorrelatedNoise { q: DVector::from_element(1, r) }).collect(),
            f: DMatrix::zeros(joint, joint),
            noise: CoupledNoise { q: DVector::from_iterator(n + CHANNELS, q), G: coupling },
            observe: state.new_observe_scratch(),
            predict: state.new_predict_scratch(Dyn(n + CHANNELS)),
            state,
        }
    }
}

impl Peer for BayesUd {
    fn load(&mut self, s: &[f64], p: &[f64]) -> Result<(), Failure> {
        self.state = UDState::try_from(kalman_state(s, p))?;
        Ok(())
    }

    fn step(&mut self, z: &[f64; CHANNELS], u: &[f64; CHANNELS]) -> Result<(), Failure> {
        let n = self.n;
        for (i, (h, r)) in self.h.iter().zip(&self.r).enumerate() {
            let innovation = DVector::from_element(1, z[i] - self.state.x[self.rows[i]]);
            self.state.observe_innovation_use_scratch(&mut self.observe, &innovation, h, r)?;
        }
        let mut s = self.state.x.clone();
        self.joint.jacobian(s.as_slice(), u, |i, j, value| self.f[(i, j)] = value);
        for j in 0..CHANNELS {
            let first = (1 + CHANNELS + j) * n;
            self.noise.G.column_mut(n + j).rows_mut(0, n).copy_from_slice(&s.as_slice()[first..first + n]);
        }
        self.joint.advance(s.as_mut_slice(), u);
        self.state.predict_use_scratch(&mut self.predict, &s, &self.f, &self.noise)?;
        Ok(())
    }

    fn estimate(&self) -> Result<(Vec<f64>, Vec<f64>), Failure> {
        let KalmanState { x, X } = self.state.kalman_state()?;
        Ok((x.as_slice().to_vec(), X.as_slice().to_vec()))
    }
}
