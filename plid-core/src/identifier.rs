//! The recursion. A step consists of the expectations that need P before the measurement, the measurement update, the
//! expectations that need P after it, and the time update.

use serde::{Deserialize, Serialize};

use crate::kernels::{BadPivot, axpy};
use crate::{
    Checkpointed, ConditionalExpectations, CovarianceBlocks, CovariancePropagation, Dense, Health, IdentifiedModel,
    ImplicitModel, InitialCovariance, Inspect, NoiseError, NoiseModel, NoiseTerms, ObservableForm, Scalar, ScalarOf,
    StepView, Transition, Unsupported,
};

/// The errors of the recursion.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum IdentifierError {
    /// The noise model is invalid.
    #[error(transparent)]
    Noise(#[from] NoiseError),
    /// A vector has the wrong number of entries.
    #[error("{name} has {found} entries; {expected} are needed")]
    Length {
        /// The name of the vector.
        name: &'static str,
        /// The number of its entries.
        found: usize,
        /// The number of entries needed.
        expected: usize,
    },
    /// A setting is outside its range.
    #[error("{name} is {value}; it must be {range}")]
    Range {
        /// The name of the setting.
        name: &'static str,
        /// Its value.
        value: f64,
        /// The allowed range.
        range: &'static str,
    },
    /// P0 is not positive semidefinite.
    #[error("the initial covariance is not positive semidefinite (pivot {value:.3e} at entry {index} of s, from 0)")]
    InitialCovariance {
        /// The entry of s, from 0.
        index: usize,
        /// The pivot.
        value: f64,
    },
    /// P0 is not symmetric.
    #[error("the initial covariance is not symmetric at row {row}, column {column} (from 1)")]
    InitialNotSymmetric {
        /// Row, from 1.
        row: usize,
        /// Column, from 1.
        column: usize,
    },
    /// An input, or an output that is not marked as missing, is NaN or infinite.
    #[error("step {step}: {channel} is {value}")]
    NotFinite {
        /// The step, from 0.
        step: u64,
        /// The channel, such as "input 2" or "output 1", from 1.
        channel: String,
        /// The value.
        value: f64,
    },
    /// P has lost its positive definiteness.
    #[error("step {step}: the covariance is no longer positive ({phase}: pivot {value:.3e} at index {index})")]
    Indefinite {
        /// The step, from 0.
        step: u64,
        /// "measurement update" or "time update".
        phase: &'static str,
        /// The index of the pivot.
        index: usize,
        /// The pivot.
        value: f64,
    },
    /// The estimate is no longer finite.
    #[error("step {step}: the estimate has diverged (entry {index} of s, from 0)")]
    Diverged {
        /// The step, from 0.
        step: u64,
        /// The entry of s, from 0.
        index: usize,
    },
    /// The settings require an operation that the covariance form does not have.
    #[error(transparent)]
    Unsupported(#[from] Unsupported),
    /// A checkpoint belongs to another identifier.
    #[error("the checkpoint does not fit: {0}")]
    Checkpoint(&'static str),
}

/// The initial conditions and options of a run, apart from structure and noise.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// The initial covariance P0.
    pub initial_covariance: InitialCovariance,
    /// The initial estimate of s, N entries.
    pub initial_estimate: Vec<f64>,
    /// The variance that is added to the variance of each parameter at each step (the paper's remedy for finite
    /// precision); 0 for none.
    pub parameter_noise: f64,
    /// The factor of exponential forgetting, by which P is divided at each step; 1 for none.
    pub forgetting: f64,
}

impl Settings {
    /// Returns settings with a zero estimate, the variance `state` for each entry of x and `parameter` for each entry
    /// of theta, no parameter noise and no forgetting.
    pub fn new(model: &dyn ImplicitModel, state: f64, parameter: f64) -> Self {
        let (n, joint) = (model.states(), model.joint_states());
        let mut diagonal = vec![parameter; joint];
        diagonal[..n].fill(state);
        Self {
            initial_covariance: InitialCovariance::Diagonal(diagonal),
            initial_estimate: vec![0.0; joint],
            parameter_noise: 0.0,
            forgetting: 1.0,
        }
    }

    /// Returns the settings of [`Settings::new`] with the redundant parameters of `form` fixed at zero, which makes
    /// the form unique.
    pub fn of_unique_form(form: &ObservableForm, state: f64, parameter: f64) -> Self {
        let n = form.states();
        let mut settings = Self::new(form, state, parameter);
        if let InitialCovariance::Diagonal(variances) = &mut settings.initial_covariance {
            for output in 0..form.outputs() {
                for row in (0..n).filter(|&row| form.is_redundant(row, output)) {
                    variances[(1 + output) * n + row] = 0.0;
                }
            }
        }
        settings
    }

    /// Returns the settings for the next record: the parameters identified so far with their covariance times
    /// `widening`, and a zero state with the variances of these settings. `widening` is 1, or larger if the plant may
    /// have changed between the records.
    pub fn carry_over(&self, model: &dyn ImplicitModel, former: &IdentifiedModel, widening: f64) -> Self {
        let (n, size) = (model.states(), model.joint_states());
        let state_variance = |i: usize| match &self.initial_covariance {
            InitialCovariance::Diagonal(variances) => variances[i],
            InitialCovariance::Full(p0) => p0.at(i, i),
        };
        let covariance = Dense::from_fn(size, size, |i, j| match (i < n, j < n) {
            (false, false) => widening * former.covariance.at(i, j),
            (true, true) if i == j => state_variance(i),
            _ => 0.0,
        });
        let mut estimate = vec![0.0; n];
        estimate.extend(former.parameters(model));
        Self { initial_covariance: InitialCovariance::Full(covariance), initial_estimate: estimate, ..self.clone() }
    }

    fn check(&self, model: &dyn ImplicitModel) -> Result<(), IdentifierError> {
        check_length("the initial estimate", self.initial_estimate.len(), model.joint_states())?;
        match &self.initial_covariance {
            InitialCovariance::Diagonal(d) => check_length("the initial variances", d.len(), model.joint_states())?,
            InitialCovariance::Full(p0) => {
                check_length("the initial covariance", p0.rows(), model.joint_states())?;
                check_length("the initial covariance", p0.columns(), model.joint_states())?;
                check_symmetric(p0)?;
            }
        }
        if let Some(index) = self.initial_estimate.iter().position(|x| !x.is_finite()) {
            return Err(IdentifierError::Diverged { step: 0, index });
        }
        if !(self.forgetting > 0.0 && self.forgetting <= 1.0) {
            let (name, value) = ("the forgetting factor", self.forgetting);
            return Err(IdentifierError::Range { name, value, range: "above 0 and at most 1" });
        }
        if !(self.parameter_noise >= 0.0 && self.parameter_noise.is_finite()) {
            let (name, value) = ("the parameter noise", self.parameter_noise);
            return Err(IdentifierError::Range { name, value, range: "at least 0" });
        }
        Ok(())
    }
}

/// The data that are needed to continue a run with bit-identical results.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Checkpoint {
    step: u64,
    estimate: Vec<[f64; 2]>,
    covariance: Vec<[f64; 2]>,
}

impl Checkpoint {
    /// Returns the number of completed steps.
    pub fn step(&self) -> u64 {
        self.step
    }
}

/// A PLID run with covariance form `C`, conditional expectation `E` and implicit model `M`.
///
/// `C` and `E` may be trait objects, for a choice at run time; see [`Identifier::begin`].
#[derive(Clone, Debug)]
pub struct Identifier<C: CovariancePropagation + ?Sized, E: ?Sized, M = ObservableForm> {
    model: M,
    noise: NoiseTerms<ScalarOf<C>>,
    covariance: Box<C>,
    expectations: Box<E>,
    s: Vec<ScalarOf<C>>,
    parameter_noise: ScalarOf<C>,
    inverse_forgetting: ScalarOf<C>,
    step: u64,
    // Scratch space of a step.
    transition: Transition<ScalarOf<C>>,
    rows: Vec<usize>,
    z: Vec<ScalarOf<C>>,
    u: Vec<ScalarOf<C>>,
    residual: Vec<ScalarOf<C>>,
    innovation: Vec<f64>,
}

impl<C, E, M> Identifier<C, E, M>
where
    C: CovariancePropagation,
    E: ConditionalExpectations<Scalar = ScalarOf<C>>,
    M: ImplicitModel,
{
    /// Creates a run that is ready for its first sample.
    ///
    /// # Errors
    /// Returns an error for an invalid noise model, initial estimate, covariance, forgetting factor or parameter
    /// noise.
    pub fn new(model: M, noise: &NoiseModel, settings: &Settings) -> Result<Self, IdentifierError> {
        Self::with_options(model, noise, settings, &C::Options::default(), &E::Options::default())
    }

    /// Creates a run that is ready for its first sample, with options of the form and of the expectation.
    ///
    /// # Errors
    /// Returns the errors of [`Identifier::new`].
    pub fn with_options(
        model: M,
        noise: &NoiseModel,
        settings: &Settings,
        form: &C::Options,
        expectations: &E::Options,
    ) -> Result<Self, IdentifierError> {
        let covariance = |model: &dyn ImplicitModel, p0: &InitialCovariance| Ok(Box::new(C::new(model, p0, form)?));
        let expectations = Box::new(E::new(&model, expectations));
        Self::begin(model, noise, settings, covariance, expectations)
    }
}

impl<C, E, M> Identifier<C, E, M>
where
    C: CovariancePropagation + ?Sized,
    E: ConditionalExpectations<Scalar = ScalarOf<C>> + ?Sized,
    M: ImplicitModel,
{
    /// Creates a run that is ready for its first sample, with an existing expectation. `covariance` creates the form
    /// from the structure and P0 after both have been checked.
    ///
    /// # Errors
    /// Returns the errors of [`Identifier::new`].
    pub fn begin(
        model: M,
        noise: &NoiseModel,
        settings: &Settings,
        covariance: impl FnOnce(&dyn ImplicitModel, &InitialCovariance) -> Result<Box<C>, BadPivot>,
        expectations: Box<E>,
    ) -> Result<Self, IdentifierError> {
        let (n, m, p) = (model.states(), model.inputs(), model.outputs());
        noise.check(p, m, n)?;
        settings.check(&model)?;
        let covariance = covariance(&model, &settings.initial_covariance)
            .map_err(|BadPivot { index, value }| IdentifierError::InitialCovariance { index, value })?;
        let number = ScalarOf::<C>::from_f64;
        Ok(Self {
            noise: NoiseTerms::new(noise),
            covariance,
            expectations,
            s: settings.initial_estimate.iter().map(|&x| number(x)).collect(),
            parameter_noise: number(settings.parameter_noise),
            inverse_forgetting: number(1.0 / settings.forgetting),
            step: 0,
            transition: Transition::new(&model),
            rows: Vec::with_capacity(p),
            z: vec![number(0.0); p],
            u: vec![number(0.0); m],
            residual: vec![number(0.0); p],
            innovation: vec![0.0; p],
            model,
        })
    }

    /// Processes the outputs z_k (p) and the inputs u_k (m) of one sample.
    ///
    /// # Errors
    /// Returns an [`IdentifierError`] with the step, and with the channel or the pivot. After an error, the estimate
    /// must not be used.
    pub fn step(&mut self, z: &[f64], u: &[f64]) -> Result<(), IdentifierError> {
        self.take(z, u, false)
    }

    /// Processes a sample in which a NaN among the outputs marks a missing output. The update uses the other outputs.
    ///
    /// # Errors
    /// Returns the errors of [`Identifier::step`].
    pub fn step_with_missing(&mut self, z: &[f64], u: &[f64]) -> Result<(), IdentifierError> {
        self.take(z, u, true)
    }

    fn take(&mut self, z: &[f64], u: &[f64], nan_is_missing: bool) -> Result<(), IdentifierError> {
        self.accept(z, u, nan_is_missing)?;
        let step = self.step;
        let count = self.form_residual();
        for (&i, &e) in self.noise.available().iter().zip(&self.residual) {
            self.innovation[i] = e.to_f64();
        }
        self.expect(count, E::before);
        self.covariance
            .measurement_update(&self.rows, &self.noise, &self.residual[..count], &mut self.s)
            .map_err(|e| indefinite(step, "measurement update", e))?;
        self.form_residual();
        self.expect(count, E::after);
        self.advance_estimate();
        self.covariance.time_update(&self.model, &self.transition).map_err(|e| indefinite(step, "time update", e))?;
        if self.inverse_forgetting != num_traits::One::one() {
            self.covariance.scale(self.inverse_forgetting)?;
        }
        if self.parameter_noise != num_traits::Zero::zero() {
            self.covariance.add_parameter_noise(self.parameter_noise, step)?;
        }
        if let Some(index) = self.s.iter().position(|x| !x.is_finite()) {
            return Err(IdentifierError::Diverged { step, index });
        }
        self.step += 1;
        Ok(())
    }

    /// Checks and stores a sample, and determines the available outputs.
    fn accept(&mut self, z: &[f64], u: &[f64], nan_is_missing: bool) -> Result<(), IdentifierError> {
        check_length("the outputs", z.len(), self.model.outputs())?;
        check_length("the inputs", u.len(), self.model.inputs())?;
        let missing = |value: f64| nan_is_missing && value.is_nan();
        let step = self.step;
        let bad = |kind: &str, index: usize, value: f64| IdentifierError::NotFinite {
            step,
            channel: format!("{kind} {}", index + 1),
            value,
        };
        if let Some(i) = z.iter().position(|&x| !x.is_finite() && !missing(x)) {
            return Err(bad("output", i, z[i]));
        }
        if let Some(j) = u.iter().position(|x| !x.is_finite()) {
            return Err(bad("input", j, u[j]));
        }
        for (to, &from) in self.z.iter_mut().zip(z).chain(self.u.iter_mut().zip(u)) {
            *to = ScalarOf::<C>::from_f64(from);
        }
        self.noise.set_available(z.iter().map(|&x| !missing(x)));
        self.rows.clear();
        self.rows.extend(self.noise.available().iter().map(|&i| self.model.output_states()[i]));
        self.innovation.fill(f64::NAN);
        Ok(())
    }

    /// Calls one of the two methods of the expectation with the current state of the step.
    fn expect(&mut self, count: usize, call: Expect<E, ScalarOf<C>>) {
        let view = StepView {
            model: &self.model,
            noise: &self.noise,
            s: &self.s,
            z: &self.z,
            u: &self.u,
            residual: &self.residual[..count],
        };
        call(&mut self.expectations, &view, &mut &mut *self.covariance, &mut self.transition);
    }

    /// Computes z - C x for the available outputs, and returns their number.
    fn form_residual(&mut self) -> usize {
        let available = self.noise.available();
        for (k, (&i, &row)) in available.iter().zip(&self.rows).enumerate() {
            self.residual[k] = self.z[i] - self.s[row];
        }
        available.len()
    }

    /// Computes x <- J x + sum_k phi_k theta_k + d.
    fn advance_estimate(&mut self) {
        let n = self.model.states();
        let (x, theta) = self.s.split_at_mut(n);
        self.model.shift(x);
        for (column, &weight) in theta.chunks_exact(n).zip(&self.transition.phi) {
            axpy(weight, column, x);
        }
        axpy(num_traits::One::one(), &self.transition.drift, x);
    }

    /// Replaces the noise model from the next step on, so that the noise may vary from step to step. Allocates only
    /// on error.
    ///
    /// # Errors
    /// Returns an error for an invalid noise model; the previous one is then kept.
    pub fn set_noise(&mut self, noise: &NoiseModel) -> Result<(), IdentifierError> {
        Ok(self.noise.set(noise)?)
    }

    /// Returns the innovation z - C x- of the last step (p entries), NaN where an output was missing.
    pub fn innovation(&self) -> &[f64] {
        &self.innovation
    }

    /// Returns the estimate of s = [x; a_1 .. a_p; b_1 .. b_m] that predicts the next sample, N entries.
    pub fn estimate(&self) -> &[ScalarOf<C>] {
        &self.s
    }

    /// Returns the covariance of the estimate, in its form.
    pub fn covariance(&self) -> &C {
        &self.covariance
    }

    /// Returns the structure.
    pub fn model(&self) -> &M {
        &self.model
    }

    /// Returns the number of samples processed.
    pub fn steps(&self) -> u64 {
        self.step
    }
}

impl<C: Inspect, E: ?Sized, M: ImplicitModel> Identifier<C, E, M> {
    /// Returns the current numerical condition of P.
    pub fn health(&self) -> Health {
        self.covariance.health()
    }

    /// Returns the model that belongs to the current estimate, with the covariance of s.
    pub fn identified(&self) -> IdentifiedModel {
        IdentifiedModel::from_estimate(&self.model, &self.s, &self.covariance.dense())
    }
}

impl<C: Checkpointed + ?Sized, E: ?Sized, M: ImplicitModel> Identifier<C, E, M> {
    /// Returns a checkpoint, from which the run can be continued later.
    pub fn checkpoint(&self) -> Checkpoint {
        Checkpoint {
            step: self.step,
            estimate: self.s.iter().map(|x| x.to_parts()).collect(),
            covariance: self.covariance.state().into_iter().map(Scalar::to_parts).collect(),
        }
    }

    /// Restores the state of a checkpoint from an identifier of the same types and structure.
    ///
    /// # Errors
    /// Returns an error for a checkpoint of another size; nothing is then changed.
    pub fn restore(&mut self, checkpoint: &Checkpoint) -> Result<(), IdentifierError> {
        if checkpoint.estimate.len() != self.s.len() {
            return Err(IdentifierError::Checkpoint("its estimate has another length"));
        }
        let state: Vec<_> = checkpoint.covariance.iter().map(|&x| ScalarOf::<C>::from_parts(x)).collect();
        if !self.covariance.restore(&state) {
            return Err(IdentifierError::Checkpoint("its covariance is of another form or size"));
        }
        for (to, &from) in self.s.iter_mut().zip(&checkpoint.estimate) {
            *to = ScalarOf::<C>::from_parts(from);
        }
        self.step = checkpoint.step;
        Ok(())
    }
}

/// The signature of [`ConditionalExpectations::before`] and [`ConditionalExpectations::after`].
type Expect<E, S> = fn(&mut E, &StepView<'_, S>, &mut dyn CovarianceBlocks<S>, &mut Transition<S>);

fn indefinite(step: u64, phase: &'static str, pivot: BadPivot) -> IdentifierError {
    IdentifierError::Indefinite { step, phase, index: pivot.index, value: pivot.value }
}

fn check_length(name: &'static str, found: usize, expected: usize) -> Result<(), IdentifierError> {
    if found == expected { Ok(()) } else { Err(IdentifierError::Length { name, found, expected }) }
}

/// Checks that P0 is symmetric. A P0 from an earlier model may have been written to a file, so differences within
/// rounding are accepted.
fn check_symmetric(p0: &Dense<f64>) -> Result<(), IdentifierError> {
    for j in 0..p0.columns() {
        for i in j + 1..p0.rows() {
            let scale = (p0.at(i, i) * p0.at(j, j)).abs().sqrt();
            if (p0.at(i, j) - p0.at(j, i)).abs() > 1e-12 * scale {
                return Err(IdentifierError::InitialNotSymmetric { row: i + 1, column: j + 1 });
            }
        }
    }
    Ok(())
}
