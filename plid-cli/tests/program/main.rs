//! The program, started as a user starts it. One binary for all of its tests is linked once.

#[cfg(unix)]
mod chaos;
mod cli;
mod common;
mod contents;
mod controlled;
mod documented;
mod fmu;
mod gap;
mod reproduce;
mod simo_merge;
mod sweep;
mod trial;
