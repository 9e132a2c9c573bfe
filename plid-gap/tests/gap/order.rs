//! The modules of the crate import only modules below them in the order of the method. A case therefore passes through
//! each of them once.

use std::fs;
use std::path::{Path, PathBuf};

/// From the lowest module to the highest, as in docs/architecture.md.
const ORDER: [&str; 20] = [
    "error", "words", "settings", "case", "plant", "signal", "effects", "simulate", "noise", "fit", "prepare",
    "search", "judge", "evidence", "audit", "answer", "diagnose", "report", "in_loop", "research",
];

/// Returns whether a file belongs to no module of the order: the crate's root, and modules that only tests use.
fn is_apart(module: &str, file: &Path) -> bool {
    module == "lib" || module == "testing" || file.file_name().is_some_and(|name| name == "tests.rs")
}

fn sources(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    entries.flat_map(|path| if path.is_dir() { sources(&path) } else { vec![path] }).collect()
}

/// Returns the module of the first level to which a file belongs.
fn module(file: &Path) -> String {
    let first = file.components().next().unwrap().as_os_str().to_string_lossy();
    first.trim_end_matches(".rs").to_string()
}

/// Returns the names that follow `crate::` in the code, without comments and unit tests.
fn imported(text: &str) -> Vec<String> {
    let code = text.split("#[cfg(test)]\nmod tests").next().unwrap();
    let code = code.split("#[cfg(test)]\npub(crate) mod tests").next().unwrap();
    let lines = code.lines().filter(|line| !line.trim_start().starts_with("//"));
    let names = lines.flat_map(|line| line.split("crate::").skip(1));
    names.map(|rest| rest.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect()).collect()
}

fn height(module: &str) -> Option<usize> {
    ORDER.iter().position(|name| *name == module)
}

/// Returns the forbidden imports of one file.
fn wrong(file: &Path, text: &str) -> Vec<String> {
    let own = module(file);
    let Some(level) = height(&own) else { return vec![format!("{}: `{own}` is not in the order", file.display())] };
    let imported = imported(text).into_iter().filter(|name| *name != own);
    let bad = imported.filter(|name| height(name).is_none_or(|other| other > level));
    bad.map(|name| format!("{}: `{own}` imports `{name}`", file.display())).collect()
}

#[test]
fn modules_import_only_what_stands_below_them() {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let files = sources(&source);
    let relative = files.iter().map(|path| (path.strip_prefix(&source).unwrap(), path));
    let checked: Vec<_> = relative.filter(|(file, _)| !is_apart(&module(file), file)).collect();
    assert!(checked.len() > 100, "only {} files", checked.len());
    let wrong: Vec<String> =
        checked.iter().flat_map(|(file, path)| wrong(file, &fs::read_to_string(path).unwrap())).collect();
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn an_import_from_above_is_found() {
    let file = Path::new("prepare/mod.rs");
    assert_eq!(wrong(file, "use crate::search::screen;\n"), ["prepare/mod.rs: `prepare` imports `search`"]);
    assert_eq!(wrong(file, "use crate::fit::problem;\n// crate::search\n"), Vec::<String>::new());
    assert_eq!(wrong(file, "#[cfg(test)]\nmod tests {\n    use crate::search::screen;\n"), Vec::<String>::new());
}

#[test]
fn the_order_is_that_of_the_book() {
    let book = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/architecture.md");
    let book = fs::read_to_string(book).unwrap();
    let section = book.split("## The modules of `plid-gap`").nth(1).unwrap().split("\n## ").next().unwrap();
    let rows = section.lines().filter_map(|line| line.strip_prefix("| `")?.split('`').next());
    assert_eq!(rows.collect::<Vec<_>>(), ORDER);
}
