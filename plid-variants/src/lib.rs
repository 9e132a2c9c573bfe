//! Covariance forms and conditional expectations of plid: one file a variant.
//!
//! A covariance form says how P is carried through a step ([`covariance`]); a conditional expectation says what is
//! taken as known of the parameters when the noise enters ([`expectations`]). Any pair makes an
//! [`plid_core::Identifier`].

pub mod covariance;
pub mod expectations;

/// The one list of covariance forms: hands each form's documentation, name and type to the macro `$then`, after any
/// further arguments. The catalogue, the tests and the benches take it from here.
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
