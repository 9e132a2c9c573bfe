//! The `plid` program.
fn main() {}
