//! Measured data: from files to tables, and from tables to records.
//!
//! [`read`] reads a file of any supported format into a [`Table`] of named columns. [`select`] extracts the named
//! inputs and outputs as a [`Record`], finds the sample rate, and reports missing or useless values with their channel.
//!
//! | file | columns |
//! |---|---|
//! | text with a header (comma, semicolon, tab or blanks) | as named |
//! | text without a header | `1`, `2`, ... |
//! | MATLAB .mat v4 or v5, one matrix | `1`, `2`, ... |
//! | MATLAB .mat v4 or v5 or NumPy .npz, several variables | a vector `u`: `u`; a matrix `y`: `y1`, `y2`, ... |
//! | NumPy .npy | `1`, `2`, ... |
//!
//! [`prepare`] converts records for identification and converts results back; [`config`] reads strict TOML.

pub mod config;
pub mod prepare;

mod array;
mod blocks;
mod bytes;
mod checks;
mod delimited;
mod error;
mod mat;
mod numpy;
mod rate;
mod record;
mod select;
mod table;
mod to_csv;
mod variables;
mod warning;

pub use blocks::Blocks;
pub use checks::{check_excited, require_samples};
pub use error::{DataError, nearest};
pub use rate::sample_rate;
pub use record::{Record, require_alike};
pub use select::{MissingPolicy, channels, extract, select, select_all};
pub use table::{Table, read, read_bytes};
pub use to_csv::to_csv;
pub use warning::Warning;

#[cfg(test)]
mod real_file;
#[cfg(test)]
mod real_files;
