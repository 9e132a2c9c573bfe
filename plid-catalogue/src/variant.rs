//! A recursion whose parts are chosen by name.

use plid_core::{
    AnyForm, Checkpoint, ConditionalExpectations, Dense, FormFacts, Health, IdentifiedModel, Identifier,
    IdentifierError, NoiseModel, ObservableForm, Settings, StepSize, Term,
};
use serde::{Deserialize, Serialize};

#[cfg(feature = "count")]
use crate::count::Counted;
use crate::registry::{Number, registry};
use crate::{BackendName, CovarianceName, ExpectationName, ScalarName};

/// A recursion whose types were chosen by name.
pub trait Recursion: Send {
    /// Takes one sample; a NaN output is missing if `nan_is_missing`.
    ///
    /// # Errors
    /// Returns the errors of [`Identifier::step`].
    fn step(&mut self, z: &[f64], u: &[f64], nan_is_missing: bool) -> Result<(), IdentifierError>;
    /// Returns the innovation of the last step.
    fn innovation(&self) -> &[f64];
    /// Returns the model estimated so far.
    fn identified(&self) -> IdentifiedModel;
    /// Returns the estimate of s (N entries), each entry as an unevaluated sum of two numbers, which is exact in
    /// every scalar.
    fn estimate(&self) -> Vec<[f64; 2]>;
    /// Returns P in double-double, computed from the stored numbers without rounding to the scalar of the recursion.
    fn exact_covariance(&self) -> Dense<qd::Quad>;
    /// Returns the numerical condition of P.
    fn health(&self) -> Health;
    /// Returns everything that is needed to continue the recursion.
    fn checkpoint(&self) -> Checkpoint;
    /// Continues from a checkpoint.
    ///
    /// # Errors
    /// Returns an error for a checkpoint of another size.
    fn restore(&mut self, checkpoint: &Checkpoint) -> Result<(), IdentifierError>;
}

/// A recursion whose form and expectation were chosen at run time.
type Run<S> = Identifier<dyn AnyForm<Scalar = S>, dyn ConditionalExpectations<Scalar = S>>;

impl<S: Number> Recursion for Run<S> {
    fn step(&mut self, z: &[f64], u: &[f64], nan_is_missing: bool) -> Result<(), IdentifierError> {
        if nan_is_missing { self.step_with_missing(z, u) } else { Identifier::step(self, z, u) }
    }
    fn innovation(&self) -> &[f64] {
        Identifier::innovation(self)
    }
    fn identified(&self) -> IdentifiedModel {
        IdentifiedModel::from_estimate(self.model(), Identifier::estimate(self), &self.covariance().own_dense())
    }
    fn estimate(&self) -> Vec<[f64; 2]> {
        Identifier::estimate(self).iter().map(|x| x.to_parts()).collect()
    }
    fn exact_covariance(&self) -> Dense<qd::Quad> {
        self.covariance().exact_dense()
    }
    fn health(&self) -> Health {
        self.covariance().own_health()
    }
    fn checkpoint(&self) -> Checkpoint {
        Identifier::checkpoint(self)
    }
    fn restore(&mut self, checkpoint: &Checkpoint) -> Result<(), IdentifierError> {
        Identifier::restore(self, checkpoint)
    }
}

/// The recursion that a config names.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Variant {
    /// The covariance form.
    pub covariance: CovarianceName,
    /// The conditional expectation.
    pub expectations: ExpectationName,
    /// The matrix library.
    pub backend: BackendName,
    /// The number type.
    pub scalar: ScalarName,
}

/// A recursion that cannot be built.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum VariantError {
    /// Only plain loops run in double-double.
    #[error("scalar = \"double-double\" needs backend = \"plain\"; {0} has no such numbers")]
    NoDoubleDouble(&'static str),
    /// The combination does not exist. It contains a form, expectation or backend that the program has added.
    #[error("there is no {covariance} with {expectations} on {backend} in {scalar}")]
    Absent {
        /// The form.
        covariance: CovarianceName,
        /// The expectation.
        expectations: ExpectationName,
        /// The backend.
        backend: BackendName,
        /// The scalar.
        scalar: &'static str,
    },
    /// The initial conditions are invalid.
    #[error(transparent)]
    Identifier(#[from] IdentifierError),
}

/// A recursion, or the reason why it cannot be built.
pub type Built = Result<Box<dyn Recursion>, VariantError>;

impl Variant {
    /// Builds the recursion.
    ///
    /// # Errors
    /// [`VariantError`]
    pub fn build(self, form: ObservableForm, noise: &NoiseModel, settings: &Settings) -> Built {
        match self.scalar {
            ScalarName::F32 => self.in_scalar::<f32>("f32", form, noise, settings),
            ScalarName::F64 => self.in_scalar::<f64>("f64", form, noise, settings),
            ScalarName::DoubleDouble => self.in_scalar::<qd::Quad>("double-double", form, noise, settings),
        }
    }

    /// Checks by one step of a plant with one state that the combination exists, and that it supports forgetting and
    /// parameter noise if they are used. An invalid config is thus refused when it is read.
    ///
    /// # Errors
    /// [`VariantError::Absent`], [`VariantError::NoDoubleDouble`], or [`IdentifierError::Unsupported`].
    pub fn check(self, forgetting: f64, parameter_noise: f64) -> Result<(), VariantError> {
        let Ok(form) = ObservableForm::new(&[1], 1) else { return Ok(()) };
        let settings = Settings { forgetting, parameter_noise, ..Settings::new(&form, 1.0, 1.0) };
        let step = |mut recursion: Box<dyn Recursion>| Ok(recursion.step(&[0.0], &[0.0], false)?);
        match self.build(form, &NoiseModel::diagonal(&[1.0], &[1.0], &[1.0]), &settings).and_then(step) {
            // Any other error is specific to this plant.
            Err(VariantError::Identifier(error)) if !matches!(error, IdentifierError::Unsupported(_)) => Ok(()),
            result => result,
        }
    }

    /// Builds the recursion over numbers that count their operations, on plain loops.
    ///
    /// # Errors
    /// [`VariantError`]
    #[cfg(feature = "count")]
    pub fn build_counted(self, form: ObservableForm, noise: &NoiseModel, settings: &Settings) -> Built {
        let plain = Variant { backend: BackendName::Plain, ..self };
        plain.in_scalar::<Counted>("counted f64", form, noise, settings)
    }

    fn in_scalar<S: Number>(
        self,
        scalar: &'static str,
        form: ObservableForm,
        noise: &NoiseModel,
        settings: &Settings,
    ) -> Built {
        let Self { covariance, expectations, backend, .. } = self;
        let absent = || match (self.scalar, backend) {
            (ScalarName::DoubleDouble, BackendName::Nalgebra | BackendName::Faer) => {
                VariantError::NoDoubleDouble(backend.as_str())
            }
            _ => VariantError::Absent { covariance, expectations, backend, scalar },
        };
        let (start_form, start_expectation) = {
            let registry = registry();
            let cells = registry.forms.iter().find(|entry| entry.name == covariance.as_str()).map(|e| &e.cells);
            let on = cells.into_iter().flatten().filter(|(name, _)| *name == backend.as_str());
            let expectation = registry.expectations.iter().find(|entry| entry.name == expectations.as_str());
            let of = expectation.into_iter().flat_map(|entry| &entry.cells).find_map(S::of_expectation);
            let found = on.map(|(_, start)| start).find_map(S::of_form).zip(of);
            found.ok_or_else(absent)?
        };
        let expectation = start_expectation(&form);
        Ok(Box::new(Run::<S>::begin(form, noise, settings, start_form, expectation)?))
    }

    /// Returns the leading operations of a step, part by part. The list is empty if the form or the expectation does
    /// not state them.
    pub fn flops(self, size: &StepSize) -> Vec<Term> {
        let facts = self.covariance.facts();
        let mut terms = (facts.updates)(size);
        let registry = registry();
        let expectation = registry.expectations.iter().find(|entry| entry.name == self.expectations.as_str());
        terms.extend(expectation.map(|entry| (entry.flops)(size, &facts)).unwrap_or_default());
        terms
    }
}

impl CovarianceName {
    /// Returns the facts about the form.
    pub fn facts(self) -> FormFacts {
        let registry = registry();
        let entry = registry.forms.iter().find(|entry| entry.name == self.as_str());
        // A name is a constant of the built-in list, or it has been read, which succeeds only for an existing form.
        entry.expect("every name has an entry").facts
    }

    /// Whether the form stores a factor of P.
    pub fn is_factored(self) -> bool {
        self.facts().factored
    }
}
