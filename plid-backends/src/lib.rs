//! The matrix backends of plid, one per file: plain loops for any scalar and, each behind its feature, the same loops
//! on two threads, nalgebra and faer.

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

/// The only list of backends. It passes the documentation, name, type and scalars of each backend to the macro
/// `$then`, after any further arguments. A `feature` list contains the features that the caller's crate must have
/// enabled.
#[macro_export]
macro_rules! every_backend {
    ($then:ident $(, $argument:tt)*) => {
        $then! {
            $($argument)*
            /// Plain loops.
            "plain" = Plain: [f32, f64, qd::Quad], feature [];
            /// Plain loops on two threads, with bit-identical results.
            "two-threads" = TwoThreads: [f32, f64, qd::Quad], feature [feature = "threads"];
            /// nalgebra
            "nalgebra" = Nalgebra: [f32, f64], feature [feature = "nalgebra"];
            /// faer
            "faer" = Faer: [f32, f64], feature [feature = "faer"];
        }
    };
}
