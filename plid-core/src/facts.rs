//! Facts about a variant that a catalogue and the studies need in addition to its arithmetic. Every item is required:
//! a variant that lacks one does not compile as part of a catalogue.

use crate::{Checkpointed, ConditionalExpectations, CovariancePropagation, Dense, Health, Inspect};

/// The sizes that determine the number of operations of a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepSize {
    /// The number of states n.
    pub n: f64,
    /// The number of outputs p.
    pub p: f64,
    /// The number of inputs m.
    pub m: f64,
    /// Whether all noise covariances are full. Otherwise R, Q and Sigma are diagonal and the cross-covariances are
    /// zero.
    pub full_noise: bool,
}

impl StepSize {
    /// Returns the number of parameter columns, p + m.
    pub fn columns(&self) -> f64 {
        self.p + self.m
    }

    /// Returns the number of entries of s, N = (p + m + 1) n.
    pub fn joint(&self) -> f64 {
        (self.columns() + 1.0) * self.n
    }

    /// Returns the number of entries of P's lower triangle.
    pub fn triangle(&self) -> f64 {
        self.joint() * (self.joint() + 1.0) / 2.0
    }
}

/// One part of a step.
#[derive(Clone, Debug, PartialEq)]
pub struct Term {
    /// The name of the operation.
    pub what: &'static str,
    /// The number of floating-point operations; a multiplication and an addition are two.
    pub flops: f64,
}

/// Facts about a covariance form. The lists of operations hold leading terms only; an empty list means "not
/// known".
#[derive(Clone, Copy, Debug)]
pub struct FormFacts {
    /// Whether a factor of P is propagated. P is then positive as long as the pivots of the factor are, and parameter
    /// noise is added to one parameter at a time.
    pub factored: bool,
    /// The operations of both updates.
    pub updates: fn(&StepSize) -> Vec<Term>,
    /// The operations of [`CovariancePropagation::add_parameter_blocks`]; the second argument is the number of pairs
    /// of different parameter columns with a nonzero weight.
    pub parameter_blocks: fn(&StepSize, f64) -> Vec<Term>,
    /// The operations of [`CovariancePropagation::output_columns`] for all outputs.
    pub output_columns: fn(&StepSize) -> Vec<Term>,
}

/// A covariance form that can be part of a catalogue.
pub trait Form: CovariancePropagation + Inspect + Checkpointed {
    /// Facts about the form.
    const FACTS: FormFacts;
}

/// A conditional expectation that can be part of a catalogue.
pub trait Expectation: ConditionalExpectations {
    /// The operations of a step, including those that the expectation requires from the form.
    const FLOPS: fn(&StepSize, &FormFacts) -> Vec<Term>;
}

/// A [`Form`] whose type is not known at compile time. As a trait object, it takes the place of the form in an
/// [`Identifier`](crate::Identifier), so that the form can be chosen at run time.
pub trait AnyForm: Checkpointed {
    /// Returns P in the form's own scalar.
    fn own_dense(&self) -> Dense<Self::Scalar>;
    /// Returns P in double-double, from the stored numbers without rounding.
    fn exact_dense(&self) -> Dense<qd::Quad>;
    /// Returns the numerical condition of P.
    fn own_health(&self) -> Health;
}

impl<C: Form> AnyForm for C {
    fn own_dense(&self) -> Dense<C::Scalar> {
        self.dense()
    }
    fn exact_dense(&self) -> Dense<qd::Quad> {
        self.dense_in()
    }
    fn own_health(&self) -> Health {
        self.health()
    }
}
