//! x
pub mod batch;
pub mod grid;
pub mod method;
pub mod plants;
pub mod prediction_error;
pub mod statistics;
pub mod trial;
