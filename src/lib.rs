//! plid: pseudo-linear identification, the recursive joint estimation of a linear plant's states and parameters.
//!
//! This crate gathers the library. The recursion and its traits stand at the root: [`Identifier`] is the one loop, over a
//! [`CovariancePropagation`], [`ConditionalExpectations`] and an [`ImplicitModel`]. The ready-made types to put in their
//! places are in [`covariance`], [`expectations`] and [`backends`], and by name in [`catalogue`]; [`model`] is what may be
//! asked of a linear model and of sampled signals, [`refine`] the models refined for simulation, [`testbed`] the simulated truss, and [`lab`] the experiments on
//! records: data files, noise covariances, validation, reports.
//!
//! A plant of two states, x1' = -0.81 x2 + 0.5 u, x2' = x1 + 1.2 x2 + u, y = x2, from its input and output alone:
//!
//! ```
//! use plid::backends::Plain;
//! use plid::covariance::BiermanUd;
//! use plid::expectations::MomentMatched;
//! use plid::{Identifier, NoiseModel, ObservableForm, Settings};
//!
//! # fn main() -> Result<(), plid::IdentifierError> {
//! let form = ObservableForm::new(&[2], 1).expect("one output with two states, one input");
//! let noise = NoiseModel::diagonal(&[1e-10], &[0.0], &[1e-14; 2]);
//! let settings = Settings::new(&form, 1.0, 1.0);
//! let mut identifier = Identifier::<BiermanUd<Plain<f64>>, MomentMatched<f64>>::new(form, &noise, &settings)?;
//!
//! let mut x = [0.0, 0.0];
//! for k in 0..200_u32 {
//!     let u = if (7 * k * k) % 23 < 11 { 1.0 } else { -1.0 };
//!     identifier.step(&[x[1]], &[u])?;
//!     x = [-0.81 * x[1] + 0.5 * u, x[0] + 1.2 * x[1] + u];
//! }
//!
//! let plant = identifier.identified();
//! for (found, true_value) in
//!     [(plant.a.at(0, 1), -0.81), (plant.a.at(1, 1), 1.2), (plant.b.at(0, 0), 0.5), (plant.b.at(1, 0), 1.0)]
//! {
//!     assert!((found - true_value).abs() < 1e-6, "{found} for {true_value}");
//! }
//! # Ok(())
//! # }
//! ```

#[doc(inline)]
pub use plid_backends as backends;
#[doc(inline)]
pub use plid_catalogue as catalogue;
#[doc(inline)]
pub use plid_core::*;
#[cfg(feature = "data")]
#[doc(inline)]
pub use plid_data as data;
#[cfg(feature = "gap")]
#[doc(inline)]
pub use plid_gap as gap;
#[cfg(feature = "lab")]
#[doc(inline)]
pub use plid_lab as lab;
#[doc(inline)]
pub use plid_model as model;
#[cfg(feature = "refine")]
#[doc(inline)]
pub use plid_refine as refine;
#[cfg(feature = "plots")]
#[doc(inline)]
pub use plid_report as report;
#[cfg(feature = "testbed")]
#[doc(inline)]
pub use plid_testbed as testbed;
#[doc(inline)]
pub use plid_variants::{covariance, expectations};
// What appears in public signatures.
pub use {nalgebra, ndarray};

/// Double-double, a [`Scalar`] of about 31 digits.
pub use qd::Quad;

/// The README's code is compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
