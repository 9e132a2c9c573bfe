//! Nonlinear least squares: one search for every fit of this workspace.
//!
//! A problem ([`Problem`]) gives the cost of a point and its normal equations there, and [`minimise`] takes damped
//! Gauss-Newton steps until the cost stops falling. With the residual r = data - model, the Jacobian J of the model and
//! a positive diagonal matrix D, a step solves
//!
//! ```text
//! (J'J + damping D) step = J'r,
//! ```
//!
//! which gives a Gauss-Newton step without damping, and a short step of steepest descent in the scale of D with strong
//! damping (Levenberg, *Q. Appl. Math.* 2, 1944, 164; Marquardt, *J. SIAM* 11, 1963, 431). Since only J'J and J'r are
//! needed, a long record is summed block by block and its Jacobian is never stored. A Gaussian prior adds its precision
//! to J'J and its pull to J'r. Nothing is allocated within a step, apart from what the problem itself allocates.
//!
//! # Example
//! The decay rate of y = e^(-bt) is fitted by its logarithm, so that it stays positive:
//!
//! ```
//! use std::convert::Infallible;
//!
//! use nalgebra::{DVector, dvector, matrix};
//! use plid_lsq::{Damping, Normal, Problem, Stop, minimise};
//!
//! struct Decay;
//!
//! const DATA: [(f64, f64); 4] = [(0.5, 0.3679), (1.0, 0.1353), (1.5, 0.0498), (2.0, 0.0183)];
//!
//! impl Problem for Decay {
//!     type Point = f64;
//!     type Equations = Normal;
//!     type Error = Infallible;
//!
//!     fn equations(&self) -> Normal {
//!         Normal::new(1)
//!     }
//!
//!     fn linearise(&mut self, &b: &f64, normal: &mut Normal) -> Result<(), Infallible> {
//!         normal.clear();
//!         for (t, y) in DATA {
//!             let model = (-b * t).exp();
//!             normal.add(matrix![-b * t * model].as_view(), dvector![y - model].as_view());
//!         }
//!         Ok(())
//!     }
//!
//!     fn advance(&self, &b: &f64, step: &DVector<f64>, to: &mut f64) {
//!         *to = b * step[0].exp();
//!     }
//!
//!     fn cost(&self, &b: &f64) -> f64 {
//!         DATA.iter().map(|(t, y)| (y - (-b * t).exp()).powi(2)).sum()
//!     }
//! }
//!
//! let found = minimise(&mut Decay, 0.1, Damping::default(), Stop::default())?;
//! assert!(found.ended.converged() && (found.point - 2.0).abs() < 1e-3);
//! # Ok::<(), Infallible>(())
//! ```

mod minimise;
mod normal;
mod problem;

pub use minimise::{Damping, Ended, Minimum, Stop, minimise};
pub use normal::Normal;
pub use problem::{Equations, Problem};
