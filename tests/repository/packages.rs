//! A package holds everything that it includes: what lies outside its folder is not published with it.

use std::fs;
use std::path::{Component, Path, PathBuf};

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

/// The Rust files below a folder.
fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).into_iter().flatten() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            sources(&path, found);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            found.push(path);
        }
    }
}

/// The paths that the text of a file includes, as far as they are written out, relative to the file.
fn included(text: &str) -> impl Iterator<Item = &str> {
    let macros = ["include_str!(", "include_bytes!("];
    let calls = macros.into_iter().flat_map(move |name| text.split(name).skip(1));
    // Of `concat!` the first part is the folder.
    calls.filter_map(|call| call.trim_start().trim_start_matches("concat!(").strip_prefix('"')?.split('"').next())
}

/// A path without `..`, as far as that is possible without looking at the disk.
fn plain(path: &Path) -> PathBuf {
    let mut plain = PathBuf::new();
    for part in path.components() {
        match part {
            Component::ParentDir => drop(plain.pop()),
            other => plain.push(other),
        }
    }
    plain
}

/// What a package's library and program include from outside its folder.
fn strangers(package: &Path) -> Vec<String> {
    let mut files = Vec::new();
    sources(&package.join("src"), &mut files);
    let mut strange = Vec::new();
    for file in files {
        let text = fs::read_to_string(&file).unwrap();
        let folder = file.parent().unwrap();
        let outside = included(&text).filter(|path| !plain(&folder.join(path)).starts_with(package));
        strange.extend(outside.map(|path| format!("{}: {path}", file.strip_prefix(package).unwrap().display())));
    }
    strange
}

#[test]
fn nothing_is_included_from_outside_a_package() {
    let manifest = fs::read_to_string(root().join("Cargo.toml")).unwrap();
    let manifest: toml::Table = toml::from_str(&manifest).unwrap();
    let members = manifest["workspace"]["members"].as_array().unwrap();
    assert!(members.len() > 20);
    for member in members.iter().map(|member| member.as_str().unwrap()).chain(["."]) {
        let strange = strangers(&plain(&root().join(member)));
        assert!(strange.is_empty(), "{member} includes {strange:#?}");
    }
}

/// A file of the neighbour is found, by either macro and with a part that is filled in.
#[test]
fn a_stranger_is_found() {
    let folder = tempfile::tempdir().unwrap();
    fs::create_dir_all(folder.path().join("src/deep")).unwrap();
    let text = "include_str!(\"../../here.toml\"); include_bytes!(\"../../../there.bin\");\n\
        include_str!(concat!(\"../../../all/\", $id, \".toml\"))";
    fs::write(folder.path().join("src/deep/a.rs"), text).unwrap();
    let strange = strangers(folder.path());
    assert_eq!(strange, ["src/deep/a.rs: ../../../all/", "src/deep/a.rs: ../../../there.bin"]);
}
