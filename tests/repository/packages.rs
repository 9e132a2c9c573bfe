//! A package holds everything that it includes, because what lies outside its folder is not published with it, and its
//! manifest says what a registry asks for.

use std::fs;
use std::path::{Component, Path, PathBuf};

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

/// The Rust files below a folder.
pub(crate) fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).into_iter().flatten() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            sources(&path, found);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            found.push(path);
        }
    }
}

/// The folders of all packages.
pub(crate) fn members() -> Vec<PathBuf> {
    let members = manifest(&root())["workspace"]["members"].clone();
    let folders = members.as_array().unwrap().iter().map(|member| member.as_str().unwrap()).chain(["."]);
    let folders: Vec<PathBuf> = folders.map(|member| plain(&root().join(member))).collect();
    assert!(folders.len() > 20);
    folders
}

/// The manifest in a folder.
fn manifest(folder: &Path) -> toml::Table {
    toml::from_str(&fs::read_to_string(folder.join("Cargo.toml")).unwrap()).unwrap()
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
    for member in members() {
        let strange = strangers(&member);
        assert!(strange.is_empty(), "{} includes {strange:#?}", member.display());
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

/// The value of a key of `[package]`, which may be that of the workspace.
fn of_package(manifest: &toml::Table, key: &str) -> Option<toml::Value> {
    let value = manifest["package"].get(key)?;
    let is_inherited = value.get("workspace").is_some();
    if is_inherited { self::manifest(&root())["workspace"]["package"].get(key).cloned() } else { Some(value.clone()) }
}

/// What crates.io asks for and `cargo publish --dry-run` does not check.
#[test]
fn a_published_package_has_the_metadata_that_a_registry_asks_for() {
    for member in members() {
        let manifest = manifest(&member);
        if manifest["package"].get("publish").is_some() {
            continue;
        }
        let name = member.display();
        for key in ["description", "license", "readme", "rust-version"] {
            assert!(of_package(&manifest, key).is_some_and(|text| !text.as_str().unwrap().is_empty()), "{name}: {key}");
        }
        for key in ["keywords", "categories"] {
            let words = of_package(&manifest, key).unwrap_or_else(|| panic!("{name}: no {key}"));
            let words: Vec<&str> = words.as_array().unwrap().iter().map(|word| word.as_str().unwrap()).collect();
            assert!((1..=5).contains(&words.len()), "{name}: {key} {words:?}");
            // The limit is that of a keyword.
            let long: Vec<&&str> = words.iter().filter(|word| key == "keywords" && word.len() > 20).collect();
            assert!(long.is_empty(), "{name}: {long:?} has more than 20 letters");
        }
    }
}
