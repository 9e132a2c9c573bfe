//! How plid writes files.
//!
//! - [`write_atomic`] writes a file whole or not at all.
//! - [`Staged`] does the same for several files that belong together in one folder.
//! - [`to_json`] refuses a number that is not finite, because JSON has none.
//! - [`file_name`] turns any name into one that stays in its folder.

mod atomic;
mod leftover;
mod name;
mod staged;
mod strict;

pub use atomic::write_atomic;
pub use name::file_name;
pub use staged::Staged;
pub use strict::{NotFinite, require_finite, to_json, to_value};
