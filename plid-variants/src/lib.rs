//! Covariance forms and conditional expectations of plid: one file a variant.
//!
//! A covariance form says how P is carried through a step ([`covariance`]); a conditional expectation says what is
//! taken as known of the parameters when the noise enters ([`expectations`]). Any pair makes an
//! [`plid_core::Identifier`].

pub mod covariance;
pub mod expectations;
