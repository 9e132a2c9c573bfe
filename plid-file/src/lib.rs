//! How plid writes files.
//!
//! - [`write_atomic`] writes a file completely or not at all.
//! - [`Folders`] does the same for new folders in one place.
//! - [`Staged`] does the same for several files that belong together in one folder.
//! - [`Scratch`] is a temporary folder. It is also removed, later, if its process is killed.
//! - [`to_json`] and [`to_line`] refuse a number that is not finite, because JSON cannot represent it.
//! - [`file_name`] turns any name into one that stays in its folder.
//! - With the feature `hash`, `sha256` identifies files by their content, and `Hashing` identifies files that are too
//!   large for memory.

mod atomic;
mod folder;
#[cfg(feature = "hash")]
mod hash;
mod leftover;
mod name;
mod scratch;
mod staged;
mod strict;

pub use atomic::write_atomic;
pub use folder::Folders;
#[cfg(feature = "hash")]
pub use hash::{Hashing, digest, executable_sha256, hex, sha256};
pub use name::file_name;
pub use scratch::Scratch;
pub use staged::Staged;
pub use strict::{NotFinite, require_finite, to_json, to_line, to_value};
