//! Hands the compiler and its settings to the crate, for the machine's description.

use std::env;
use std::process::Command;

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    let variable = |name: &str| env::var(name).unwrap_or_default();
    let version = Command::new(variable("RUSTC")).arg("--version").output();
    let version = version.map(|o| String::from_utf8_lossy(&o.stdout).trim().to_string()).unwrap_or_default();
    // Flags stand apart by the character 0x1f.
    let flags = variable("CARGO_ENCODED_RUSTFLAGS").replace('\u{1f}', " ");
    for (name, value) in [
        ("RUSTC", version),
        ("TARGET", variable("TARGET")),
        ("TARGET_FEATURES", variable("CARGO_CFG_TARGET_FEATURE")),
        ("OPT_LEVEL", variable("OPT_LEVEL")),
        ("RUSTFLAGS", flags),
    ] {
        println!("cargo::rustc-env=PLID_BUILT_WITH_{name}={value}");
    }
}
