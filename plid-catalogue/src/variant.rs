//! Names turned into types: the one place that knows all variants, backends and scalars.
//!
//! A new covariance form, expectation, backend or scalar is one line in its list below, and at once can be named in a config.

use plid_backends::{Faer, Nalgebra, Plain, TwoThreads};
use plid_core::{
    Backend, Checkpoint, ConditionalExpectations, CovariancePropagation, Health, IdentifiedModel, Identifier,
    IdentifierError, NoiseModel, ObservableForm, Scalar, ScalarOf, Settings,
};
use plid_variants::covariance::{ArraySqrt, BiermanUd, Direct, Joseph};
use plid_variants::expectations::{CertaintyEquivalent, JointEkf, MomentMatched, Posterior, Prior};
use serde::{Deserialize, Serialize};

/// How P is carried.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum CovarianceName {
    /// Eq. 8-10 as they stand: the fastest, and the first to lose positivity.
    Direct,
    /// Joseph's measurement update.
    Joseph,
    /// U D U^T: cannot lose positivity.
    #[default]
    BiermanUd,
    /// S S^T by orthogonal transformations.
    ArraySqrt,
}

/// What is taken as known when noise multiplies an unknown parameter.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ExpectationName {
    /// Eq. 8-10, psi = Z^{k-1}.
    Prior,
    /// Eq. 8-10, psi = Z^k for the parameters.
    Posterior,
    /// psi = Z^k throughout.
    #[default]
    MomentMatched,
    /// No covariances.
    CertaintyEquivalent,
    /// Linearised about the estimate.
    JointEkf,
}

/// The matrix library.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum BackendName {
    /// Plain loops.
    #[default]
    Plain,
    /// Plain loops on two threads, to the same bits.
    TwoThreads,
    /// nalgebra
    Nalgebra,
    /// faer
    Faer,
}

/// The number type.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ScalarName {
    /// Single precision.
    F32,
    /// Double precision.
    #[default]
    F64,
    /// Double-double, about 31 digits.
    DoubleDouble,
}

/// A recursion whose types were chosen by name.
pub trait Recursion: Send {
    /// Takes one sample; a NaN output is missing if `nan_is_missing`.
    ///
    /// # Errors
    /// As [`Identifier::step`].
    fn step(&mut self, z: &[f64], u: &[f64], nan_is_missing: bool) -> Result<(), IdentifierError>;
    /// The innovation of the last step.
    fn innovation(&self) -> &[f64];
    /// The plant as it stands.
    fn identified(&self) -> IdentifiedModel;
    /// The estimate of s, N entries, each as an unevaluated sum of two numbers: exactly, in every scalar.
    fn estimate(&self) -> Vec<[f64; 2]>;
    /// The numbers that P's form consists of, as [`CovariancePropagation::state`] lays them out, each likewise exactly.
    fn covariance_state(&self) -> Vec<[f64; 2]>;
    /// How sound P is.
    fn health(&self) -> Health;
    /// All that is needed to go on.
    fn checkpoint(&self) -> Checkpoint;
    /// Goes on from a checkpoint.
    ///
    /// # Errors
    /// A checkpoint of another size.
    fn restore(&mut self, checkpoint: &Checkpoint) -> Result<(), IdentifierError>;
}

impl<C: CovariancePropagation, E: ConditionalExpectations<C>> Recursion for Identifier<C, E> {
    fn step(&mut self, z: &[f64], u: &[f64], nan_is_missing: bool) -> Result<(), IdentifierError> {
        if nan_is_missing { self.step_with_missing(z, u) } else { Identifier::step(self, z, u) }
    }
    fn innovation(&self) -> &[f64] {
        Identifier::innovation(self)
    }
    fn identified(&self) -> IdentifiedModel {
        Identifier::identified(self)
    }
    fn estimate(&self) -> Vec<[f64; 2]> {
        Identifier::estimate(self).iter().map(|x| x.to_parts()).collect()
    }
    fn covariance_state(&self) -> Vec<[f64; 2]> {
        self.covariance().state().into_iter().map(Scalar::to_parts).collect()
    }
    fn health(&self) -> Health {
        Identifier::health(self)
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
    /// How P is carried.
    pub covariance: CovarianceName,
    /// What is taken as known when noise multiplies an unknown parameter.
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
    #[error("variant.scalar = \"double-double\" needs variant.backend = \"plain\"; {0} has no such numbers")]
    NoDoubleDouble(&'static str),
    /// The start is impossible.
    #[error(transparent)]
    Identifier(#[from] IdentifierError),
}

/// A recursion, or why there is none.
pub type Built = Result<Box<dyn Recursion>, VariantError>;

impl Variant {
    /// Builds the recursion.
    ///
    /// # Errors
    /// [`VariantError`]
    pub fn build(self, form: ObservableForm, noise: &NoiseModel, settings: &Settings) -> Built {
        let start = (form, noise, settings);
        match (self.backend, self.scalar) {
            (BackendName::Plain, ScalarName::F32) => self.on::<Plain<f32>>(start),
            (BackendName::Plain, ScalarName::F64) => self.on::<Plain<f64>>(start),
            (BackendName::Plain, ScalarName::DoubleDouble) => self.on::<Plain<qd::Quad>>(start),
            (BackendName::TwoThreads, ScalarName::F32) => self.on::<TwoThreads<f32>>(start),
            (BackendName::TwoThreads, ScalarName::F64) => self.on::<TwoThreads<f64>>(start),
            (BackendName::TwoThreads, ScalarName::DoubleDouble) => self.on::<TwoThreads<qd::Quad>>(start),
            (BackendName::Nalgebra, ScalarName::F32) => self.on::<Nalgebra<f32>>(start),
            (BackendName::Nalgebra, ScalarName::F64) => self.on::<Nalgebra<f64>>(start),
            (BackendName::Faer, ScalarName::F32) => self.on::<Faer<f32>>(start),
            (BackendName::Faer, ScalarName::F64) => self.on::<Faer<f64>>(start),
            (BackendName::Nalgebra, ScalarName::DoubleDouble) => Err(VariantError::NoDoubleDouble("nalgebra")),
            (BackendName::Faer, ScalarName::DoubleDouble) => Err(VariantError::NoDoubleDouble("faer")),
        }
    }

    /// Builds the recursion on a backend of one's own, whatever `backend` and `scalar` name.
    ///
    /// # Errors
    /// An impossible start.
    pub fn build_on<B: Backend>(self, form: ObservableForm, noise: &NoiseModel, settings: &Settings) -> Built {
        self.on::<B>((form, noise, settings))
    }

    fn on<B: Backend>(self, start: Start<'_>) -> Built {
        match self.covariance {
            CovarianceName::Direct => self.with::<Direct<B>, B::Scalar>(start),
            CovarianceName::Joseph => self.with::<Joseph<B>, B::Scalar>(start),
            CovarianceName::BiermanUd => self.with::<BiermanUd<B>, B::Scalar>(start),
            CovarianceName::ArraySqrt => self.with::<ArraySqrt<B>, B::Scalar>(start),
        }
    }

    fn with<C, S>(self, start: Start<'_>) -> Built
    where
        S: Scalar,
        C: CovariancePropagation<Backend: Backend<Scalar = S>>,
    {
        match self.expectations {
            ExpectationName::Prior => finish::<C, Prior<ScalarOf<C>>>(start),
            ExpectationName::Posterior => finish::<C, Posterior<ScalarOf<C>>>(start),
            ExpectationName::MomentMatched => finish::<C, MomentMatched<ScalarOf<C>>>(start),
            ExpectationName::CertaintyEquivalent => finish::<C, CertaintyEquivalent<ScalarOf<C>>>(start),
            ExpectationName::JointEkf => finish::<C, JointEkf<ScalarOf<C>>>(start),
        }
    }
}

type Start<'a> = (ObservableForm, &'a NoiseModel, &'a Settings);

fn finish<C: CovariancePropagation, E: ConditionalExpectations<C>>((form, noise, settings): Start<'_>) -> Built {
    Ok(Box::new(Identifier::<C, E>::new(form, noise, settings)?))
}
