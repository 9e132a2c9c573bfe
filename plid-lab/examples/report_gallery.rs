//! The report (in work).
fn main() {}
