//! Lines of code and prose fit in 120 columns.

use std::fs;
use std::path::{Path, PathBuf};

const COLUMNS: usize = 120;

/// The files of the repository with this extension; hidden folders and what is built are left out.
fn files(folder: &Path, extension: &str, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        if path.is_dir() && !name.starts_with('.') && name != "target" && name != "out" {
            files(&path, extension, found);
        } else if path.extension().is_some_and(|there| there == extension) {
            found.push(path);
        }
    }
}

/// The long lines of all such files, apart from those that `may_be_long`.
fn long_lines(extension: &str, may_be_long: impl Fn(&str) -> bool) -> Vec<String> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut paths = Vec::new();
    files(root, extension, &mut paths);
    assert!(!paths.is_empty(), "no file ends in .{extension}");
    let mut long = Vec::new();
    for path in paths {
        let place = path.strip_prefix(root).unwrap();
        let text = fs::read_to_string(&path).unwrap();
        for (number, line) in (1..).zip(text.lines()) {
            if line.chars().count() > COLUMNS && !may_be_long(line) {
                long.push(format!("{}:{number}", place.display()));
            }
        }
    }
    long
}

#[test]
fn code_fits() {
    let long = long_lines("rs", |_| false);
    assert!(long.is_empty(), "longer than {COLUMNS} columns: {long:#?}");
}

/// Scripts, configs and the C code of tests.
#[test]
fn python_toml_and_c_fit() {
    let long: Vec<String> = ["py", "toml", "c"].iter().flat_map(|extension| long_lines(extension, |_| false)).collect();
    assert!(long.is_empty(), "longer than {COLUMNS} columns: {long:#?}");
}

/// Tables and links cannot be broken.
#[test]
fn prose_fits() {
    let long = long_lines("md", |line| line.trim_start().starts_with('|') || line.contains("]("));
    assert!(long.is_empty(), "longer than {COLUMNS} columns: {long:#?}");
}
