//! The built-in catalogue. The test of a program's own entries has a process of its own.

mod build;
mod count;
mod recommendation;
