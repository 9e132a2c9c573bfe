//! A short study of stability, and its table: which form stays positive definite in which scalar at which size, and how
//! far it is from double-double.
//!
//!     cargo bench -- stability
//!
//! `plid bench stability` is the whole study.

use std::error::Error;

use plid_bench::stability::{BENCH, Config, carry_out};
use plid_bench::study::{Silent, from_toml_checked};

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let filter = arguments.iter().find(|argument| !argument.starts_with('-'));
    if filter.is_some_and(|filter| !"stability".contains(filter.as_str())) {
        return Ok(());
    }
    let mut config: Config = from_toml_checked(BENCH, "stability-bench.toml", Config::problems)?;
    if !arguments.iter().any(|argument| argument == "--bench") {
        // Not a bench, but a test that the bench still works.
        (config.states, config.steps) = (vec![3], 10);
    }
    let journal = tempfile::tempdir()?;
    let outcome = carry_out(&config, journal.path(), false, &Silent)?;
    print!("{}", outcome.table());
    Ok(())
}
