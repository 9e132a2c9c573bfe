//! The program, started as a user does.

use std::path::Path;
use std::process::{Command, Output, Stdio};

/// Runs it in a directory, with nothing on standard input.
pub fn plid(directory: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_plid"))
        .current_dir(directory)
        .args(arguments)
        .stdin(Stdio::null())
        .output()
        .expect("the program starts")
}
