//! A rule for the choice of the covariance form, which follows from the stability study.
//!
//! `plid bench stability` compares the rule with its own cells; docs/stability.md has the figures.

use plid_core::{InitialCovariance, NoiseModel, Settings};
use serde::{Deserialize, Serialize};

use crate::{BackendName, CovarianceName, ExpectationName, ScalarName, Variant, VariantError};

/// The conditions on which the choice of the form depends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Conditions {
    /// n
    pub states: usize,
    /// The number type.
    pub scalar: ScalarName,
    /// The number of samples.
    pub steps: usize,
    /// The ratio of the largest variance of P0 to the smallest variance of R.
    pub start_ratio: f64,
    /// Whether P is divided by a forgetting factor, so that it may grow without bound while the input is zero.
    pub forgets: bool,
}

/// The largest number of states that the study covers.
pub const STATES: usize = 64;
/// The longest runs of the direct form in f64 that the study covers.
pub const STEPS: usize = 100_000;
/// The largest P0 / R at which the direct form in f64 is recommended. The study found it sound up to 1e12, and lost
/// at 1e16.
pub const START_RATIO: f64 = 1e8;

impl Conditions {
    /// The conditions of a run over `steps` samples.
    pub fn of(scalar: ScalarName, settings: &Settings, noise: &NoiseModel, steps: usize) -> Self {
        let largest = match &settings.initial_covariance {
            InitialCovariance::Diagonal(variances) => variances.iter().copied().fold(0.0, f64::max),
            InitialCovariance::Full(p0) => (0..p0.rows()).map(|i| p0.at(i, i)).fold(0.0, f64::max),
        };
        let sensor = &noise.sensor;
        let smallest = (0..sensor.rows()).map(|i| sensor.at(i, i)).fold(f64::INFINITY, f64::min);
        let forgets = settings.forgetting < 1.0;
        Self { states: noise.state.rows(), scalar, steps, start_ratio: largest / smallest, forgets }
    }

    /// Returns the fastest form that the study found sound with a margin under such conditions. If the study did not
    /// cover the conditions or found no such form (12 states in f32 over 10^5 steps), it is Bierman UD.
    ///
    /// In f64 that is the direct form, within the bounds of [`STATES`], [`STEPS`] and [`START_RATIO`] and without
    /// forgetting. In f32 it is Bierman UD for every size and length, because a P that is stored as a matrix is lost
    /// within hundreds to thousands of steps even with 12 states. Double-double has enough digits for the direct
    /// form.
    pub fn recommended(&self) -> CovarianceName {
        match self.scalar {
            ScalarName::F32 => CovarianceName::BiermanUd,
            ScalarName::DoubleDouble => CovarianceName::Direct,
            ScalarName::F64 => {
                let within = self.states <= STATES && self.steps <= STEPS && self.start_ratio <= START_RATIO;
                if within && !self.forgets { CovarianceName::Direct } else { CovarianceName::BiermanUd }
            }
        }
    }
}

/// A recursion as named in a config, in which the form may be omitted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct VariantChoice {
    /// The covariance form. If it is omitted, the form is that of [`Conditions::recommended`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub covariance: Option<CovarianceName>,
    /// The conditional expectation.
    pub expectations: ExpectationName,
    /// The matrix library.
    pub backend: BackendName,
    /// The number type.
    pub scalar: ScalarName,
}

impl VariantChoice {
    /// Checks the variant like [`Variant::check`], with a recommended form if none was named.
    ///
    /// # Errors
    /// Returns the errors of [`Variant::check`].
    pub fn check(self, forgetting: f64, parameter_noise: f64) -> Result<(), VariantError> {
        let (states, steps, start_ratio) = (1, 1, 1.0);
        let forgets = forgetting < 1.0;
        let conditions = Conditions { states, scalar: self.scalar, steps, start_ratio, forgets };
        self.settle(&conditions).check(forgetting, parameter_noise)
    }

    /// Returns the recursion with the recommended form if none was named.
    pub fn settle(self, conditions: &Conditions) -> Variant {
        Variant {
            covariance: self.covariance.unwrap_or_else(|| conditions.recommended()),
            expectations: self.expectations,
            backend: self.backend,
            scalar: self.scalar,
        }
    }
}
