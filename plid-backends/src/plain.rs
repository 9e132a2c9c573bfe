//! The reference backend: the default kernels over a `Vec`, for any scalar.

use std::marker::PhantomData;

use plid_core::kernels::Kernels;
use plid_core::{Backend, Dense};

/// Plain loops over column slices, in any scalar (`f32`, `f64`, `qd::Quad`).
#[derive(Clone, Copy, Debug)]
pub struct Plain<S>(PhantomData<S>);

impl<S: Kernels> Backend for Plain<S> {
    type Scalar = S;
    type Matrix = Dense<S>;
}
