//! Matrix backends of plid, one file each and each behind its feature: nalgebra, faer, and plain loops for any scalar.

#[cfg(feature = "faer")]
mod faer_backend;
#[cfg(feature = "nalgebra")]
mod nalgebra_backend;
mod plain;
#[cfg(feature = "threads")]
mod two_threads;

#[cfg(feature = "faer")]
pub use faer_backend::Faer;
#[cfg(feature = "nalgebra")]
pub use nalgebra_backend::{Nalgebra, NalgebraMatrix};
pub use plain::Plain;
#[cfg(feature = "threads")]
pub use two_threads::{TwoThreads, on_threads};
