//! The built-in forms and expectations.

mod algebra;
mod conformance;
mod errors;
mod recovery;
