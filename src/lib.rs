//! Pseudo-linear identification (PLID): recursive joint estimation of the states and parameters of a linear plant.
//!
//! [`identify`] estimates a model from two arrays. [`Identification`] has its options, including the variants:
//!
//! ```
//! use plid::catalogue::{BackendName, CovarianceName};
//! use plid::model::{frequency_response, mode_deviations, response_variance};
//! use plid::ndarray::Array2;
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! // One row per sample and one column per channel, at 100 Hz: y(k) = 1.2 y(k-1) - 0.81 y(k-2) + u(k-1), and noise.
//! let u = Array2::from_shape_fn((400, 1), |(k, _)| if (7 * k * k) % 23 < 11 { 1.0 } else { -1.0 });
//! let mut y = Array2::zeros((400, 1));
//! for k in 2..400 {
//!     y[(k, 0)] = 1.2 * y[(k - 1, 0)] - 0.81 * y[(k - 2, 0)] + u[(k - 1, 0)];
//! }
//! y.indexed_iter_mut().for_each(|((k, _), y)| *y += 0.1 * (k as f64 * k as f64).sin());
//! // Identify: the order and the noise covariances are found.
//! let identified = plid::identify(u.view(), y.view(), 100.0)?;
//! println!("{} states", identified.model.n());
//!
//! // Swap a variant.
//! let other = plid::Identification::default()
//!     .states(2)
//!     .covariance(CovarianceName::ArraySqrt)
//!     .backend(BackendName::Nalgebra)
//!     .run(u.view(), y.view(), 100.0)?;
//! assert_eq!(other.variant.covariance, CovarianceName::ArraySqrt);
//!
//! // Read the model, x(k+1) = A x(k) + B u(k), y(k) = C x(k), its uncertainty and its frequency response.
//! let model = identified.model;
//! println!("A = {}B = {}C = {}", model.a, model.b, model.c);
//! for found in mode_deviations(&model)? {
//!     println!("{:.3} Hz, standard deviation {:?}", found.mode.hz, found.hz_std);
//! }
//! let magnitude = frequency_response(&model, &[10.0, 20.0])?[0][(0, 0)].norm();
//! println!("|H(10 Hz)| = {magnitude:.3} ± {:.1e}", response_variance(&model, &[10.0], 0)?[0].magnitude_std()[(0, 0)]);
//!
//! // Save it.
//! model.write(&std::env::temp_dir().join("model.json"))?;
//! # Ok(())
//! # }
//! ```
//!
//! The recursion itself is [`Identifier`], which takes one sample at a time. It is generic over a
//! [`CovariancePropagation`], [`ConditionalExpectations`] and an [`ImplicitModel`]; the types that implement them are
//! in [`covariance`], [`expectations`] and [`backends`], and [`catalogue`] selects them by name. [`ToModel`] converts
//! its estimate into a [`model::Model`].
//!
//! # Features
//!
//! | feature | adds |
//! |---|---|
//! | `nalgebra`, `faer` | backends on these matrix libraries |
//! | `threads` | a backend on two threads; the search for noise covariances on all threads |
//! | `signal` | spectra, correlations and error measures of records |
//! | `refine` | models refined for simulation |
//! | `data`, `plots` | data files and their preparation; plots and reports |
//! | `testbed` | the simulated truss |
//! | `lab` | experiments, from data files to reports; it has all of the above |
//! | `gap` | where a simulation disagrees with records, and why; your own simulator in the loop |
//! | `fmu` | FMUs as simulators |
//!
//! # Profile
//!
//! A release build needs no settings. In a debug build the arithmetic is slow unless these lines in your `Cargo.toml`
//! optimise it. The last two omit the debug information of the dependencies, which takes a long time to compile.
//!
//! ```toml
//! [profile.dev]
//! opt-level = 2
//!
//! [profile.dev.package."*"]
//! debug = false
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
#[cfg(feature = "fmu")]
#[doc(inline)]
pub use plid_fmu as fmu;
#[cfg(feature = "gap")]
#[doc(inline)]
pub use plid_gap as gap;
pub use plid_identify::{Identification, IdentificationError, Identified, IdentifyError, ToModel, Watch, identify};
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
#[cfg(any(feature = "gap", feature = "fmu"))]
#[doc(inline)]
pub use plid_simulator as simulator;
#[cfg(feature = "testbed")]
#[doc(inline)]
pub use plid_testbed as testbed;
#[doc(inline)]
pub use plid_variants::{covariance, expectations};
// These crates appear in public signatures.
pub use {nalgebra, ndarray};

/// Double-double, a [`Scalar`] of about 31 digits.
pub use qd::Quad;

/// The README's code is compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
