//! Covariance forms and conditional expectations of plid, with one file per variant.
//!
//! A covariance form determines how P is represented and updated in a step ([`covariance`]). A conditional
//! expectation determines what is taken as known of the parameters when the noise enters ([`expectations`]). Any pair
//! of them forms a [`plid_core::Identifier`].

pub mod covariance;
pub mod expectations;

/// The only list of covariance forms. It passes the documentation, name and type of each form to the macro `$then`,
/// after any further arguments. The catalogue, the tests and the benches use it.
#[macro_export]
macro_rules! every_form {
    ($then:ident $(, $argument:tt)*) => {
        $then! {
            $($argument)*
            /// Eq. 8-10 without modification: the fastest, and the first to lose positivity.
            "direct" = Direct;
            /// Joseph's measurement update.
            "joseph" = Joseph;
            /// U D U^T: cannot lose positivity.
            "bierman-ud" = BiermanUd;
            /// S S^T by orthogonal transformations.
            "array-sqrt" = ArraySqrt;
        }
    };
}

/// The list of conditional expectations, used in the same way.
#[macro_export]
macro_rules! every_expectation {
    ($then:ident $(, $argument:tt)*) => {
        $then! {
            $($argument)*
            /// Eq. 8-10, psi = Z^{k-1}.
            "prior" = Prior;
            /// Eq. 8-10, psi = Z^k for the parameters.
            "posterior" = Posterior;
            /// No covariances.
            "certainty-equivalent" = CertaintyEquivalent;
            /// psi = Z^k throughout.
            "moment-matched" = MomentMatched;
            /// Linearised about the estimate.
            "joint-ekf" = JointEkf;
        }
    };
}
