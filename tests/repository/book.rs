//! The book and the README are consistent: every chapter exists and is listed, every link and every include leads
//! somewhere, and every command names targets that exist.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use pulldown_cmark::{Event, Options, Parser, Tag, TagEnd};

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

fn read(path: &Path) -> String {
    fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// Targets of links and images within this repository, as path and fragment.
fn local_links(text: &str) -> Vec<(String, Option<String>)> {
    let parser = Parser::new_ext(text, Options::ENABLE_TABLES);
    let targets = parser.filter_map(|event| match event {
        Event::Start(Tag::Link { dest_url, .. } | Tag::Image { dest_url, .. }) => Some(dest_url.to_string()),
        _ => None,
    });
    targets
        .filter(|target| !target.contains("://"))
        .map(|target| match target.split_once('#') {
            Some((path, fragment)) => (path.to_string(), Some(fragment.to_string())),
            None => (target, None),
        })
        .collect()
}

/// The fragments by which the headings of a chapter are reached.
fn headings(text: &str) -> BTreeSet<String> {
    let mut found = BTreeSet::new();
    let mut heading: Option<String> = None;
    for event in Parser::new_ext(text, Options::ENABLE_TABLES) {
        match (event, &mut heading) {
            (Event::Start(Tag::Heading { .. }), _) => heading = Some(String::new()),
            (Event::Text(text) | Event::Code(text), Some(title)) => title.push_str(&text),
            (Event::End(TagEnd::Heading(_)), Some(title)) => {
                let kept = title.to_lowercase().replace(' ', "-");
                found.insert(kept.chars().filter(|c| c.is_alphanumeric() || "-_".contains(*c)).collect());
                heading = None;
            }
            _ => {}
        }
    }
    found
}

/// What `{{#include path:anchor}}` asks for.
fn includes(text: &str) -> Vec<(String, Option<String>)> {
    let inner = text.split("{{#include ").skip(1).map(|rest| rest.split("}}").next().unwrap_or_default().trim());
    let split = |inner: &str| match inner.split_once(':') {
        Some((path, anchor)) => (path.to_string(), Some(anchor.to_string())),
        None => (inner.to_string(), None),
    };
    inner.map(split).collect()
}

/// Everything in `file` that leads nowhere, in words.
fn dead_ends(file: &Path) -> Vec<String> {
    let text = read(file);
    let folder = file.parent().expect("a file has a folder");
    let mut dead = Vec::new();
    for (target, fragment) in local_links(&text) {
        let path = if target.is_empty() { file.to_path_buf() } else { folder.join(&target) };
        if !path.exists() {
            dead.push(format!("{}: link to {target}", file.display()));
        } else if let Some(fragment) = fragment
            && !headings(&read(&path)).contains(&fragment)
        {
            dead.push(format!("{}: link to heading {fragment} of {target}", file.display()));
        }
    }
    for (target, anchor) in includes(&text) {
        let path = folder.join(&target);
        let Ok(source) = fs::read_to_string(&path) else {
            dead.push(format!("{}: include of {target}", file.display()));
            continue;
        };
        if let Some(anchor) = anchor {
            let has = |mark: &str| source.lines().any(|line| line.trim_start_matches(['/', '#', ' ']) == mark);
            if !has(&format!("ANCHOR: {anchor}")) || !has(&format!("ANCHOR_END: {anchor}")) {
                dead.push(format!("{}: anchor {anchor} of {target}", file.display()));
            }
        }
    }
    dead
}

/// Chapters (.md) in docs/.
fn chapters() -> BTreeSet<String> {
    let entries = fs::read_dir(root().join("docs")).expect("docs/ exists");
    let names = entries.map(|entry| entry.expect("readable").file_name().to_string_lossy().into_owned());
    names.filter(|name| name.ends_with(".md") && name != "SUMMARY.md").collect()
}

#[test]
fn the_summary_lists_every_chapter_once() {
    let listed = local_links(&read(&root().join("docs/SUMMARY.md")));
    let unique: BTreeSet<String> = listed.iter().map(|(path, _)| path.clone()).collect();
    assert_eq!(unique.len(), listed.len(), "a chapter is listed twice");
    assert_eq!(unique, chapters());
}

#[test]
fn links_and_includes_of_the_book_lead_somewhere() {
    let dead: Vec<String> = chapters().iter().flat_map(|name| dead_ends(&root().join("docs").join(name))).collect();
    assert!(dead.is_empty(), "{dead:#?}");
}

#[test]
fn links_of_the_readme_lead_somewhere() {
    let dead = dead_ends(&root().join("README.md"));
    assert!(dead.is_empty(), "{dead:#?}");
}

/// The names after `flag` in all commands of `text`, such as `nist` for `--test`.
fn named<'t>(text: &'t str, flag: &str) -> Vec<&'t str> {
    let words: Vec<&str> = text.split_whitespace().collect();
    let after = words.windows(2).filter(|pair| pair[0] == flag).map(|pair| pair[1]);
    after.map(|name| name.trim_matches(|c: char| !(c.is_alphanumeric() || "_-".contains(c)))).collect()
}

/// Whether a package of the workspace has a target of this name in `folder`: a file or a folder, or a target that its
/// manifest names.
fn has_target(folder: &str, name: &str) -> bool {
    let packages = fs::read_dir(root()).expect("the root is a folder").map(|entry| entry.expect("readable").path());
    let declared = format!("name = \"{name}\"");
    packages.chain([root()]).any(|package| {
        let at = package.join(folder);
        let manifest = fs::read_to_string(package.join("Cargo.toml")).unwrap_or_default();
        at.join(format!("{name}.rs")).exists() || at.join(name).join("main.rs").exists() || manifest.contains(&declared)
    })
}

#[test]
fn tests_examples_and_benches_in_commands_exist() {
    let files = chapters().into_iter().map(|name| root().join("docs").join(name)).chain([root().join("README.md")]);
    let mut missing = Vec::new();
    for file in files {
        let text = read(&file);
        for (flag, folder) in [("--test", "tests"), ("--example", "examples"), ("--bench", "benches")] {
            let absent = named(&text, flag).into_iter().filter(|name| !has_target(folder, name));
            missing.extend(absent.map(|name| format!("{}: {flag} {name}", file.display())));
        }
    }
    assert!(missing.is_empty(), "{missing:#?}");
}

/// The checks above find what they are there to find.
#[test]
fn dead_links_includes_and_anchors_are_found() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    fs::write(folder.path().join("code.rs"), "// ANCHOR: here\n// ANCHOR_END: here\n").unwrap();
    let page = folder.path().join("page.md");
    let text = "# A, part\n\n[a](code.rs) [b](https://x.org/y) [c](#a-part) [c](#no-part) ![d](gone.svg) \
        `[e](not-a-link.md)`\n\n```rust\n\
        {{#include code.rs:here}}\n{{#include code.rs:there}}\n{{#include gone.rs}}\n```\n";
    fs::write(&page, text).unwrap();
    let dead = dead_ends(&page).join("\n");
    for said in ["link to gone.svg", "link to heading no-part", "anchor there of code.rs", "include of gone.rs"] {
        assert!(dead.contains(said), "{dead}");
    }
    assert_eq!(dead.lines().count(), 4, "{dead}");
}

/// The command that the README gives for all tests is the one that the checks run; it must be found there, once.
#[test]
fn the_readme_gives_the_test_command_once() {
    let readme = read(&root().join("README.md"));
    let (_, after) = readme.split_once("<!-- tests -->\n```sh\n").expect("a marked block");
    let (block, _) = after.split_once("\n```").expect("which ends");
    assert_eq!(block, "cargo test --workspace");
    assert_eq!(readme.matches(block).count(), 1);
}
