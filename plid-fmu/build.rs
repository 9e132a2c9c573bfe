//! Compiles the logger of FMI 2.0.

fn main() {
    println!("cargo::rerun-if-changed=src/native/logger.c");
    cc::Build::new().file("src/native/logger.c").compile("plid_fmu_logger");
}
