//! Results on standard output, remarks on standard error.

use std::io::{self, ErrorKind, Write};

use plid_file::to_json;
use serde::Serialize;

use super::Failure;

/// How much is printed, and in which format.
#[derive(Clone, Copy)]
pub struct Voice {
    /// Neither progress nor remarks.
    pub quiet: bool,
    /// Results as JSON.
    pub json: bool,
}

/// Prints a result. A closed pipe, as left by `head`, is not an error.
pub fn print(text: &str) -> Result<(), Failure> {
    let mut stdout = io::stdout().lock();
    match stdout.write_all(text.as_bytes()).and_then(|()| stdout.flush()) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => Err(Failure::work(format!("standard output: {error}"))),
        _ => Ok(()),
    }
}

/// Prints a result as JSON. A number that is not finite is refused, because JSON cannot represent it.
pub fn json(value: &impl Serialize) -> Result<(), Failure> {
    print(&to_json(value).map_err(Failure::work)?)
}

/// Prints a remark; a failure to print it is ignored.
pub fn remark(text: &str) {
    let _ = writeln!(io::stderr(), "{text}");
}
