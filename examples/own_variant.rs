//! User-defined variants outside plid's crates: a backend, a covariance form and a conditional expectation. Each is
//! used through [`Identifier`] and compared with a built-in one.
//!
//!     cargo run --example own_variant

use plid::backends::Plain;
use plid::covariance::Direct;
use plid::expectations::MomentMatched;
use plid::kernels::{BadPivot, Kernels, axpy, cholesky, pivoted_cholesky, solve_lower};
use plid::{
    Backend, Checkpointed, ConditionalExpectations, CovarianceBlocks, CovariancePropagation, Dense, Expectation, Form,
    FormFacts, Identifier, ImplicitModel, InitialCovariance, Inspect, Matrix, NoiseModel, NoiseTerms, ObservableForm,
    Scalar, ScalarOf, Settings, StepSize, StepView, Term, Transition, View, ViewMut,
};
use rand::SeedableRng;
use rand_chacha::ChaCha12Rng;
use rand_distr::{Distribution, StandardNormal};

// ANCHOR: backend
/// The core's storage and kernels, but products without fused multiply-add, which are rounded twice.
#[derive(Clone, Copy, Debug)]
struct Unfused;

impl Backend for Unfused {
    type Scalar = f64;
    type Matrix = Dense<f64>;

    fn symmetric_product_lower(mut c: ViewMut<'_, f64>, alpha: f64, a: View<'_, f64>, b: View<'_, f64>) {
        for j in 0..c.columns() {
            for k in 0..a.columns() {
                let weight = alpha * b.at(j, k);
                for (c, &a) in c.column_mut(j)[j..].iter_mut().zip(&a.column(k)[j..]) {
                    *c += weight * a;
                }
            }
        }
    }
}
// ANCHOR_END: backend

// ANCHOR: expectation
/// An expectation E[.] for independent w, v and xi. When z_k takes the place of C x_k, its sensor noise also acts as
/// state noise. This expectation treats the two as independent, so it omits the covariance E[G] S of Eq. 8.
#[derive(Clone, Debug)]
struct Uncorrelated<S> {
    inflation: S,
    weights: Dense<S>,
}

/// The options of the expectation.
#[derive(Clone, Debug)]
struct UncorrelatedOptions {
    /// Factor on Qbar.
    inflation: f64,
}

impl Default for UncorrelatedOptions {
    fn default() -> Self {
        Self { inflation: 1.0 }
    }
}

impl<S: Kernels> ConditionalExpectations for Uncorrelated<S> {
    type Scalar = S;
    type Options = UncorrelatedOptions;

    fn new(model: &dyn ImplicitModel, options: &UncorrelatedOptions) -> Self {
        let weights = Dense::zeros(model.parameter_columns(), model.parameter_columns());
        Self { inflation: S::from_f64(options.inflation), weights }
    }

    fn after(
        &mut self,
        step: &StepView<'_, S>,
        covariance: &mut dyn CovarianceBlocks<S>,
        transition: &mut Transition<S>,
    ) {
        let StepView { model, noise, s, z, u, .. } = step;
        let (n, p) = (model.states(), model.outputs());
        let theta = |t: usize| &s[(1 + t) * n..(2 + t) * n];
        // The measurement is used in place of the state; for a missing output, its estimate is used.
        transition.drift.fill(S::from_f64(0.0));
        for (i, &row) in model.output_states().iter().enumerate() {
            transition.phi[i] = s[row];
            transition.abar.column_mut(i).copy_from_slice(theta(i));
        }
        transition.phi[p..].copy_from_slice(u);
        self.weights.fill(S::from_f64(0.0));
        for (k, &i) in noise.available().iter().enumerate() {
            transition.phi[i] = z[i];
            transition.abar.column_mut(i).fill(S::from_f64(0.0));
            for (l, &j) in noise.available().iter().enumerate() {
                *self.weights.at_mut(i, j) = noise.sensor(k, l);
            }
        }
        for i in 0..model.inputs() {
            for j in 0..model.inputs() {
                *self.weights.at_mut(p + i, p + j) = noise.actuator().at(i, j);
            }
        }
        // E[G Q0 G^T] = Sigma + the sum over a, b of weight_ab (theta_a theta_b^T + P_{theta_a theta_b})
        for c in 0..n {
            transition.qbar.column_mut(c).copy_from_slice(noise.state_given().column(c));
            for a in 0..model.parameter_columns() {
                for b in 0..model.parameter_columns() {
                    let weight = self.weights.at(a, b) * theta(b)[c];
                    axpy(weight, theta(a), transition.qbar.column_mut(c));
                }
            }
        }
        covariance.add_parameter_blocks(&self.weights, transition.qbar.view_mut());
        for c in 0..n {
            transition.qbar.column_mut(c).iter_mut().for_each(|x| *x *= self.inflation);
        }
    }
}
// ANCHOR_END: expectation

// ANCHOR: expectation_facts
impl<S: Kernels> Expectation for Uncorrelated<S> {
    // Its operations are not stated.
    const FLOPS: fn(&StepSize, &FormFacts) -> Vec<Term> = |_, _| Vec::new();
}
// ANCHOR_END: expectation_facts

// ANCHOR: covariance
/// The textbook form with P and F as full matrices, O(N^3) per step. It is slow, but short enough to check by
/// reading.
#[derive(Clone, Debug)]
struct Textbook {
    n: usize,
    p: Dense<f64>,
    f: Dense<f64>,
    product: Dense<f64>,
    /// Y of P+ = P - Y Y^T, N x p.
    gain: Dense<f64>,
    factor: Dense<f64>,
    work: Vec<f64>,
}

impl CovariancePropagation for Textbook {
    type Scalar = f64;
    type Options = ();

    fn new(model: &dyn ImplicitModel, initial: &InitialCovariance, _: &()) -> Result<Self, BadPivot> {
        let (size, outputs) = (model.joint_states(), model.outputs());
        let p = match initial {
            InitialCovariance::Diagonal(variances) => Dense::from_diagonal(variances),
            InitialCovariance::Full(p0) => p0.clone(),
        };
        pivoted_cholesky(p.clone().view_mut(), Dense::zeros(size, size).view_mut(), &mut vec![0.0; size], 1e-13, 1e-8)?;
        let (f, product) = (Dense::zeros(size, size), Dense::zeros(size, size));
        let (gain, factor) = (Dense::zeros(size, outputs), Dense::zeros(outputs, outputs));
        Ok(Self { n: model.states(), p, f, product, gain, factor, work: vec![0.0; outputs] })
    }

    fn output_columns(&self, rows: &[usize], mut out: ViewMut<'_, f64>) {
        for (k, &row) in rows.iter().enumerate() {
            out.column_mut(k).copy_from_slice(self.p.column(row));
        }
    }

    fn add_parameter_blocks(&mut self, weights: &Dense<f64>, mut out: ViewMut<'_, f64>) {
        let n = self.n;
        for t in 0..weights.columns() {
            for s in 0..weights.rows() {
                for c in 0..n {
                    let block = &self.p.column((1 + t) * n + c)[(1 + s) * n..(2 + s) * n];
                    axpy(weights.at(s, t), block, out.column_mut(c));
                }
            }
        }
    }

    fn measurement_update(
        &mut self,
        rows: &[usize],
        noise: &NoiseTerms<f64>,
        innovation: &[f64],
        s: &mut [f64],
    ) -> Result<(), BadPivot> {
        let (k, size) = (rows.len(), s.len());
        for (j, &column) in rows.iter().enumerate() {
            for (i, &row) in rows.iter().enumerate() {
                *self.factor.at_mut(i, j) = self.p.at(row, column) + noise.sensor(i, j);
            }
        }
        // Re = L L^T and Y = P H^T L^-T: P+ = P - Y Y^T, s+ = s + Y L^-1 e.
        let mut factor = self.factor.view_mut();
        let mut factor = factor.block_mut(0, 0, k, k);
        cholesky(factor.reborrow())?;
        for i in 0..size {
            for (work, &row) in self.work.iter_mut().zip(rows) {
                *work = self.p.at(i, row);
            }
            solve_lower(factor.view(), &mut self.work[..k]);
            for j in 0..k {
                *self.gain.at_mut(i, j) = self.work[j];
            }
        }
        self.work[..k].copy_from_slice(innovation);
        solve_lower(factor.view(), &mut self.work[..k]);
        for j in 0..k {
            axpy(self.work[j], self.gain.column(j), s);
        }
        let y = self.gain.view().block(0, 0, size, k);
        Unfused::symmetric_product_lower(self.p.view_mut(), -1.0, y, y);
        self.mirror();
        Ok(())
    }

    fn time_update(&mut self, model: &dyn ImplicitModel, transition: &Transition<f64>) -> Result<(), BadPivot> {
        let (n, size) = (self.n, self.p.rows());
        self.f.fill(0.0);
        for i in 0..n {
            if let Some(from) = model.shift_source(i) {
                *self.f.at_mut(i, from) = 1.0;
            }
            for (k, &column) in model.output_states().iter().enumerate() {
                *self.f.at_mut(i, column) += transition.abar.at(i, k);
            }
            for (t, &weight) in transition.phi.iter().enumerate() {
                *self.f.at_mut(i, (1 + t) * n + i) = weight;
            }
        }
        for i in n..size {
            *self.f.at_mut(i, i) = 1.0;
        }
        // F P, then (F P) F^T + Qbar
        self.product.fill(0.0);
        for j in 0..size {
            for k in 0..size {
                axpy(self.p.at(k, j), self.f.column(k), self.product.column_mut(j));
            }
        }
        self.p.fill(0.0);
        for k in 0..size {
            for j in 0..size {
                axpy(self.f.at(j, k), self.product.column(k), self.p.column_mut(j));
            }
        }
        for j in 0..n {
            axpy(1.0, &transition.qbar.column(j)[j..], &mut self.p.column_mut(j)[j..n]);
        }
        self.mirror();
        match (0..size).find(|&i| !(self.p.at(i, i) >= 0.0)) {
            Some(index) => Err(BadPivot { index, value: self.p.at(index, index) }),
            None => Ok(()),
        }
    }
}
// ANCHOR_END: covariance

// ANCHOR: inspect
impl Inspect for Textbook {
    fn dense_in<T: Scalar>(&self) -> Dense<T> {
        Dense::from_fn(self.p.rows(), self.p.columns(), |i, j| T::from_f64(self.p.at(i, j)))
    }
}

impl Checkpointed for Textbook {
    fn state(&self) -> Vec<f64> {
        self.p.data().to_vec()
    }

    fn restore(&mut self, state: &[f64]) -> bool {
        let mut p = self.p.view_mut();
        let fits = state.len() == p.data_mut().len();
        if fits {
            p.data_mut().copy_from_slice(state);
        }
        fits
    }
}

impl Form for Textbook {
    // Its operations are not stated.
    const FACTS: FormFacts = FormFacts {
        factored: false,
        updates: |_| Vec::new(),
        parameter_blocks: |_, _| Vec::new(),
        output_columns: |_| Vec::new(),
    };
}
// ANCHOR_END: inspect

impl Textbook {
    /// Copies the lower triangle of P to the upper one.
    fn mirror(&mut self) {
        for j in 0..self.p.columns() {
            for i in 0..j {
                *self.p.at_mut(i, j) = self.p.at(j, i);
            }
        }
    }
}

/// A plant in canonical form, with its inputs and its measured outputs.
struct Record {
    form: ObservableForm,
    noise: NoiseModel,
    inputs: Vec<f64>,
    outputs: Vec<Vec<f64>>,
}

/// Simulates the plant of `parameters` [a_1 .. a_p; b] with sensor noise of variance `sensor` and state noise of
/// variance `state`.
fn record(indices: &[usize], parameters: &[f64], [sensor, state]: [f64; 2], samples: usize, seed: u64) -> Record {
    let form = ObservableForm::new(indices, 1).expect("indices above zero");
    let (n, p) = (form.states(), form.outputs());
    let mut random = ChaCha12Rng::seed_from_u64(seed);
    let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
    let (mut inputs, mut outputs) = (Vec::new(), Vec::new());
    let mut x = vec![0.0; n];
    for _ in 0..samples {
        let u = normal().signum();
        let y: Vec<f64> = form.output_states().iter().map(|&row| x[row]).collect();
        inputs.push(u);
        outputs.push(y.iter().map(|y| y + sensor.sqrt() * normal()).collect());
        form.shift(&mut x);
        for (column, weight) in parameters.chunks_exact(n).zip(y.iter().copied().chain([u])) {
            axpy(weight, column, &mut x);
        }
        x.iter_mut().for_each(|x| *x += state.sqrt() * normal());
    }
    let noise = NoiseModel::diagonal(&vec![sensor; p], &[0.0], &vec![state; n]);
    Record { form, noise, inputs, outputs }
}

// ANCHOR: identify
/// Runs any variant over the record. Another variant requires only another type.
fn identify<C, E>(record: &Record) -> Result<Identifier<C, E>, plid::IdentifierError>
where
    C: CovariancePropagation,
    E: ConditionalExpectations<Scalar = ScalarOf<C>>,
{
    let settings = Settings::new(&record.form, 1.0, 1.0);
    let mut identifier = Identifier::new(record.form.clone(), &record.noise, &settings)?;
    for (z, &u) in record.outputs.iter().zip(&record.inputs) {
        identifier.step_with_missing(z, &[u])?;
    }
    Ok(identifier)
}
// ANCHOR_END: identify

/// Returns the largest difference of P between two runs, relative to sqrt(P_ii P_jj).
fn difference(one: &impl Inspect, other: &impl Inspect) -> f64 {
    let (p, q) = (one.dense_in::<f64>(), other.dense_in::<f64>());
    let mut largest = 0.0_f64;
    for i in 0..p.rows() {
        for j in 0..p.rows() {
            let scale = (p.at(i, i) * p.at(j, j)).sqrt();
            largest = largest.max((p.at(i, j) - q.at(i, j)).abs() / scale);
        }
    }
    largest
}

fn main() -> Result<(), plid::IdentifierError> {
    // Two outputs with two states and one, some samples missing.
    let parameters = [-0.5, 0.9, 0.1, 0.2, -0.1, 0.6, 0.5, 1.0, -0.4];
    let mut two_outputs = record(&[2, 1], &parameters, [0.04, 0.01], 300, 1);
    for k in (0..300).step_by(7) {
        two_outputs.outputs[k][k % 2] = f64::NAN;
    }
    // ANCHOR: swap
    let built_in = identify::<Direct<Plain<f64>>, MomentMatched<f64>>(&two_outputs)?;
    let backend = identify::<Direct<Unfused>, MomentMatched<f64>>(&two_outputs)?;
    let form = identify::<Textbook, MomentMatched<f64>>(&two_outputs)?;
    // ANCHOR_END: swap
    let apart =
        [difference(built_in.covariance(), backend.covariance()), difference(built_in.covariance(), form.covariance())];
    println!("P of own backend and own form, relative to the built-in one: {:.1e}, {:.1e} apart", apart[0], apart[1]);
    assert!(apart.iter().all(|&d| d > 0.0 && d < 1e-10), "other rounding, the same recursion");

    // A scalar plant with much noise, x' = 0.5 x + u + xi, in enough runs to show a bias.
    let (mut ours, mut theirs) = (0.0, 0.0);
    const RUNS: u64 = 40;
    for seed in 0..RUNS {
        let scalar = record(&[1], &[0.5, 1.0], [1.0, 0.1], 400, seed);
        ours += identify::<Textbook, Uncorrelated<f64>>(&scalar)?.identified().a.at(0, 0) / RUNS as f64;
        theirs += identify::<Direct<Plain<f64>>, MomentMatched<f64>>(&scalar)?.identified().a.at(0, 0) / RUNS as f64;
    }
    println!("mean estimate of a = 0.5: {theirs:.3} moment-matched, {ours:.3} without the correlation of z_k's noise");
    assert!((theirs - 0.5).abs() < 0.02, "moment matching is not biased");
    assert!(ours < 0.45, "without E[G] S the estimate of a is biased towards zero");
    Ok(())
}
