//! The `plid` program with a covariance form of another crate, which experiments and studies may name.
//!
//!     cargo run -p plid-cli --example own_form -- run EXPERIMENT

// ANCHOR: main
use std::process::ExitCode;

use plid::catalogue::{Entry, forms};

pub(crate) fn main() -> ExitCode {
    forms! { "own" = Own; }.add();
    plid_cli::main()
}
// ANCHOR_END: main

mod form;

use form::Own;
// What the form is written with; another crate may have the same from the crates below `plid`.
use plid::covariance::Direct;
use plid::kernels::BadPivot;
use plid::{
    Backend, Checkpointed, CovariancePropagation, Dense, Form, FormFacts, ImplicitModel, InitialCovariance, Inspect,
    NoiseTerms, Scalar, Transition, ViewMut,
};
