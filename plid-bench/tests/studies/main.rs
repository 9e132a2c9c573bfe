//! The studies of expectations and stability, and the exact posterior that they compare with.

mod expectations;
mod grid_bayes;
mod stability;
