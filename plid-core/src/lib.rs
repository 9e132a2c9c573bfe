//! The PLID recursion: traits, canonical form, implicit model, noise model, identifier.
//!
//! PLID (Hopkins and VanLandingham 1994; Vallone and Hopkins 1995) is a Kalman-like filter whose state contains the
//! plant's n states *and* the unknown columns of its A and B in the MIMO observable canonical form,
//! s = [x; a_1 .. a_p; b_1 .. b_m], with N = (p + m + 1) n entries. Because an output *is* a state plus sensor noise,
//! the model is linear in s with known coefficients z and u: it is pseudo-linear.
//!
//! [`Identifier`] runs the recursion. It is generic over the form in which P is propagated
//! ([`CovariancePropagation`]), over what is taken as known when noise multiplies an unknown parameter
//! ([`ConditionalExpectations`]), and over the canonical form ([`ImplicitModel`]). A [`Backend`] provides storage,
//! kernels and the [`Scalar`]. The variants are in `plid-variants`, the backends in `plid-backends`.

mod backend;
#[cfg(any(feature = "nalgebra", feature = "ndarray"))]
mod convert;
mod covariance;
mod expectations;
mod facts;
mod identified;
mod identifier;
pub mod kernels;
mod matrix;
mod model;
mod noise;
mod scalar;

pub use backend::Backend;
pub use covariance::{
    Checkpointed, CovariancePropagation, Health, InitialCovariance, Inspect, ScalarOf, ScalarUpdate, Transition,
    Unsupported,
};
pub use expectations::{ConditionalExpectations, CovarianceBlocks, StepView};
pub use facts::{AnyForm, Expectation, Form, FormFacts, StepSize, Term};
pub use identified::IdentifiedModel;
pub use identifier::{Checkpoint, Identifier, IdentifierError, Settings};
pub use matrix::{Dense, Matrix, View, ViewMut};
pub use model::{ImplicitModel, ObservableForm, StructureError};
pub use noise::{NoiseError, NoiseModel, NoiseTerms};
pub use scalar::Scalar;
