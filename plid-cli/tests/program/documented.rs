//! Every subcommand and flag of the program, and every key of its files, has an entry in the book.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::Command;

use serde::de::DeserializeOwned;

/// A chapter of the book, from whichever package of the workspace this test is run.
fn chapter(name: &str) -> String {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let root: PathBuf =
        here.ancestors().find(|folder| folder.join("docs/SUMMARY.md").exists()).expect("the book").into();
    std::fs::read_to_string(root.join("docs").join(name)).unwrap_or_else(|e| panic!("{name}: {e}"))
}

/// The text under the heading `title`, up to the next heading; empty if there is no such heading.
fn section(text: &str, title: &str) -> String {
    let is_heading = |line: &str| line.starts_with('#');
    let mut lines = text.lines().skip_while(|line| !(is_heading(line) && line.trim_start_matches('#').trim() == title));
    lines.next();
    lines.take_while(|line| !is_heading(line)).collect::<Vec<_>>().join("\n")
}

fn help(command: &[String]) -> String {
    let output =
        Command::new(env!("CARGO_BIN_EXE_plid")).args(command).arg("--help").output().expect("the program starts");
    assert!(output.status.success(), "{command:?}");
    String::from_utf8(output.stdout).expect("help is text")
}

/// The lines of a part of a help text, such as `Options:`; empty if there is no such part.
fn part<'h>(help: &'h str, title: &str) -> Vec<&'h str> {
    let after = help.lines().skip_while(|line| *line != title).skip(1);
    after.take_while(|line| line.is_empty() || line.starts_with(' ')).map(str::trim).collect()
}

/// The flags and subcommands that a help text lists.
fn listed(help: &str) -> (BTreeSet<String>, Vec<String>) {
    let flag = |line: &str| {
        let word = line.split_whitespace().find(|word| word.starts_with("--"))?;
        (line.starts_with("--") || line.starts_with("-h,") || line.starts_with("-V,")).then(|| word.to_string())
    };
    let flags = part(help, "Options:").into_iter().filter_map(flag).collect();
    let name = |line: &str| line.split_whitespace().next().filter(|name| *name != "help").map(str::to_string);
    let commands = part(help, "Commands:").into_iter().filter_map(name).collect();
    (flags, commands)
}

/// What `text` leaves out of `command` and all below it.
fn undocumented_flags(command: &mut Vec<String>, text: &str, missing: &mut Vec<String>) {
    let (flags, subcommands) = listed(&help(command));
    let title = format!("`plid {}`", command.join(" "));
    let own = section(text, &title);
    let common = section(text, "Options of every command");
    if !command.is_empty() && own.trim().is_empty() {
        missing.push(title.clone());
    }
    let has = |flag: &str| [&own, &common].iter().any(|part| part.contains(&format!("`{flag}`")));
    missing.extend(flags.iter().filter(|flag| !has(flag)).map(|flag| format!("{title}: {flag}")));
    for name in subcommands {
        command.push(name);
        undocumented_flags(command, text, missing);
        command.pop();
    }
}

#[test]
fn every_command_and_flag_is_documented() {
    let mut missing = Vec::new();
    undocumented_flags(&mut Vec::new(), &chapter("commands.md"), &mut missing);
    assert!(missing.is_empty(), "docs/commands.md lacks {missing:#?}");
}

/// A flag without an entry is found.
#[test]
fn a_missing_flag_is_found() {
    let text = chapter("commands.md").replace("`--scan`", "");
    let mut missing = Vec::new();
    undocumented_flags(&mut Vec::new(), &text, &mut missing);
    assert_eq!(missing, ["`plid identify`: --scan"]);
}

/// No file has such a key.
const NO_KEY: &str = "no_such_key";

/// The keys that a strict file of type `T` may have in the table `path`, which the message about an unknown one lists;
/// none if it is not a table.
fn keys_of<T: DeserializeOwned>(path: &str) -> Option<Vec<String>> {
    let headers = if path.is_empty() { vec![String::new()] } else { vec![format!("[{path}]"), format!("[[{path}]]")] };
    headers.into_iter().find_map(|header| {
        let message = toml::from_str::<T>(&format!("{header}\n{NO_KEY} = 1\n")).err()?.message().to_string();
        // An unknown variant is a word, and no key.
        let (_, known) = message.split_once(&format!("unknown field `{NO_KEY}`, expected "))?;
        Some(known.split('`').skip(1).step_by(2).map(str::to_string).collect())
    })
}

/// All tables of such a file with their keys, from `path` downwards.
fn tables<T: DeserializeOwned>(path: &str, found: &mut Vec<(String, Vec<String>)>) {
    let Some(keys) = keys_of::<T>(path) else { return };
    found.push((path.to_string(), keys.clone()));
    for key in keys {
        tables::<T>(&if path.is_empty() { key } else { format!("{path}.{key}") }, found);
    }
}

/// Keys that `has(table, key)` does not find.
fn undocumented_keys<T: DeserializeOwned>(has: impl Fn(&str, &str) -> bool) -> Vec<String> {
    let mut found = Vec::new();
    tables::<T>("", &mut found);
    assert!(!found.is_empty(), "no table was found");
    let keys = found.iter().flat_map(|(table, keys)| keys.iter().map(move |key| (table, key)));
    keys.filter(|(table, key)| !has(table, key)).map(|(table, key)| format!("[{table}] {key}")).collect()
}

#[test]
fn every_key_of_an_experiment_is_documented() {
    let text = chapter("experiment-file.md");
    let in_section = |text: &str, table: &str, key: &str| {
        let title = if table.is_empty() { "The file".to_string() } else { format!("`[{table}]`") };
        section(text, &title).contains(&format!("`{key}`"))
    };
    let missing = undocumented_keys::<plid::lab::experiment::Experiment>(|table, key| in_section(&text, table, key));
    assert!(missing.is_empty(), "docs/experiment-file.md lacks {missing:#?}");
    let shorter = text.replace("`learning_share`", "");
    let missing = undocumented_keys::<plid::lab::experiment::Experiment>(|table, key| in_section(&shorter, table, key));
    assert_eq!(missing, ["[validation] learning_share"]);
}

#[test]
fn every_key_of_a_case_is_documented() {
    let text = chapter("gap.md") + &chapter("gap-settings.md");
    let missing = undocumented_keys::<plid::gap::case::CaseConfig>(|table, key| {
        let written = [format!("`{key}`"), format!("`[{key}]`"), format!("`[[{key}]]`"), format!("`[{table}.{key}]`")];
        written.iter().any(|entry| text.contains(entry))
    });
    assert!(missing.is_empty(), "docs/gap.md and docs/gap-settings.md lack {missing:#?}");
}
