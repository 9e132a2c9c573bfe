//! A sweep is one experiment over a grid of values of its keys, with one run in a separate folder for each point.
//!
//! [`Sweep::read`] reads the grid, [`carry_out`] runs the points of a shard or all of them, [`read`] takes the rows of
//! the table from the folders of finished points, and [`write()`] writes the table and the report.

mod carry_out;
mod grid;
mod picture;
mod point;
mod report;
mod table;

pub use carry_out::{carry_out, read, write};
pub use grid::{Sweep, Varied};
pub use plid_work::Shard;
pub use point::{POINTS, Row};
