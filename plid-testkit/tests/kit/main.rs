//! The kit from outside.

mod expectation;
mod form;
