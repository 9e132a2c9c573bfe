//! Kernels and the noise model.

mod factored_kernels;
mod kernels;
mod noise;
