//! Tests of everything that reads a file or a message, with mutated inputs.
//!
//! A [`Target`] is a function that reads bytes. [`run`] gives it the files of its corpus, and then mutations of them.
//! It fails if the function panics, takes too long, or allocates more than the size of its input allows. The function
//! itself checks that whatever it accepts can be written and read back unchanged.
//!
//! The function returns a few words about the result of its reading. An input with new words is added to the inputs
//! that are mutated, so that mutations reach deeper than one fault. This replaces a measurement of the coverage, which
//! the program in `plid-fuzz/coverage` makes: there, libFuzzer makes the inputs, and [`check`] reads them.
//!
//! A run is deterministic: it makes a fixed number of executions from a fixed seed. Environment variables change that:
//!
//! | variable | meaning |
//! |---|---|
//! | `PLID_FUZZ_SECONDS` | time for each target, in place of the fixed number |
//! | `PLID_FUZZ_SEED` | seed; default 1 |
//! | `PLID_FUZZ_TRACE` | a file that holds each input before it is read, for faults that end the process |

mod finding;
mod mutate;
mod run;
mod watch;

pub use run::{Target, check, run};
