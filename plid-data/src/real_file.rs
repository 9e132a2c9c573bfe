//! The location of public benchmark records, for the tests here and in plid-lab.

use std::path::{Path, PathBuf};

/// Returns the path of a benchmark file under `$PLID_SHARED/real` (or `../shared/real` next to the workspace).
pub(crate) fn real_file(name: &str) -> Option<PathBuf> {
    let shared = std::env::var_os("PLID_SHARED")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared"), PathBuf::from);
    let path = shared.join("real").join(name);
    if path.is_file() {
        Some(path)
    } else {
        eprintln!("skipped: there is no {}", path.display());
        None
    }
}
