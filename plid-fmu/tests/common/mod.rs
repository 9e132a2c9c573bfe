//! The oscillator of these tests as an FMU, compiled and packed when a test runs.

use std::fs::{self, File};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;

use zip::ZipWriter;
use zip::write::SimpleFileOptions;

fn sources() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../plid-fmu/tests/oscillator")
}

/// The folder of binaries for this machine.
pub fn platform(version: u32) -> String {
    let (os, arch) = (std::env::consts::OS, std::env::consts::ARCH);
    let system = if os == "macos" { "darwin" } else { os };
    if version == 2 && (os, arch) == ("linux", "x86_64") { "linux64".into() } else { format!("{arch}-{system}") }
}

/// Writes an archive of these entries.
pub fn pack(file: &Path, entries: &[(&str, &[u8])]) {
    let mut archive = ZipWriter::new(File::create(file).unwrap());
    for (name, bytes) in entries {
        archive.start_file(*name, SimpleFileOptions::default()).unwrap();
        archive.write_all(bytes).unwrap();
    }
    archive.finish().unwrap();
}

/// The description of the oscillator.
pub fn description(version: u32) -> String {
    fs::read_to_string(sources().join(format!("fmi{version}.xml"))).unwrap()
}

/// Compiles the oscillator into a folder and packs it with a description; nothing without a C compiler.
pub fn built_with(folder: &Path, version: u32, description: &str) -> Option<PathBuf> {
    let compiler = std::env::var("CC").unwrap_or_else(|_| "cc".into());
    let library = folder.join(format!("oscillator{version}{}", std::env::consts::DLL_SUFFIX));
    let compiled = Command::new(&compiler)
        .args(["-shared", "-fPIC", "-O2", "-Wall", "-Wextra", &format!("-DFMI={version}"), "-o"])
        .arg(&library)
        .arg(sources().join("oscillator.c"))
        .status();
    let Ok(status) = compiled else {
        eprintln!("SKIPPED: there is no C compiler {compiler:?}, so no FMU is built");
        return None;
    };
    assert!(status.success(), "{compiler} failed");
    let file = folder.join(format!("oscillator{version}.fmu"));
    let binary = format!("binaries/{}/oscillator{}", platform(version), std::env::consts::DLL_SUFFIX);
    let library = fs::read(library).unwrap();
    pack(&file, &[("modelDescription.xml", description.as_bytes()), (&binary, &library)]);
    Some(file)
}

/// The oscillator as an FMU in a folder; nothing without a C compiler.
pub fn built(folder: &Path, version: u32) -> Option<PathBuf> {
    built_with(folder, version, &description(version))
}
