//! A value that is not available has no key in the files that are written, rather than `null`: every optional field of
//! a serialised type is skipped if it is `None`.

use std::fs;

use crate::packages::{members, sources};

/// Keys whose format says that they may be `null`.
const MAY_BE_NULL: [&str; 2] = ["gap_after", "next_experiment"];

/// The optional fields of the serialised types in this text that are written as `null` if they are `None`.
///
/// Left out are the rows of a CSV table, whose columns are always there, types that are converted before they are
/// written, flattened fields, and tests.
fn written_as_null(text: &str) -> Vec<&str> {
    let mut found = Vec::new();
    let (mut attributes, mut is_written) = (String::new(), false);
    let code = text.split("#[cfg(test)]\nmod tests {").next().unwrap_or_default();
    for line in code.lines().map(str::trim).filter(|line| !line.starts_with("//")) {
        if line.starts_with("#[") {
            attributes.push_str(line);
            continue;
        }
        let words: Vec<&str> = line.split(' ').filter(|word| *word != "pub" && !word.starts_with("pub(")).collect();
        if let ["struct" | "enum", name, ..] = words[..] {
            let is_row = name.starts_with("Row");
            is_written = attributes.contains("Serialize") && !attributes.contains("into = ") && !is_row;
        } else if line == "}" {
            is_written = false;
        } else if let [name, kind, ..] = words[..] {
            let is_skipped = ["skip_serializing", "flatten"].iter().any(|word| attributes.contains(word));
            if is_written && kind.starts_with("Option<") && !is_skipped {
                found.push(name.trim_end_matches(':'));
            }
        }
        attributes.clear();
    }
    found
}

#[test]
fn a_value_that_is_not_available_has_no_key() {
    let mut files = Vec::new();
    members().iter().for_each(|member| sources(&member.join("src"), &mut files));
    assert!(files.len() > 300);
    let mut wrong = Vec::new();
    for file in files {
        let text = fs::read_to_string(&file).unwrap();
        let keys = written_as_null(&text).into_iter().filter(|key| !MAY_BE_NULL.contains(key));
        wrong.extend(keys.map(|key| format!("{}: {key}", file.display())));
    }
    assert!(wrong.is_empty(), "without `skip_serializing_if = \"Option::is_none\"`: {wrong:#?}");
}

#[test]
fn a_field_that_is_written_as_null_is_found() {
    let text = "#[derive(Debug, Serialize)]\npub struct A {\n    /// A figure.\n    pub(crate) a: Option<f64>,\n    \
        #[serde(skip_serializing_if = \"Option::is_none\")]\n    b: Option<f64>,\n}\n\n\
        fn f(\n    c: Option<f64>,\n) {}\n\n\
        #[derive(Debug)]\nstruct B {\n    d: Option<f64>,\n}\n\n\
        #[derive(Serialize)]\nenum C {\n    D {\n        e: Option<f64>,\n    },\n}\n\n\
        #[derive(Serialize)]\nstruct Row {\n    f: Option<f64>,\n}\n";
    assert_eq!(written_as_null(text), ["a", "e"]);
}
