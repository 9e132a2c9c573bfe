//! The results of a command, without what differs from run to run.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use serde_json::Value;

/// Contents by path.
pub type Files = BTreeMap<String, Vec<u8>>;

/// Keys of JSON files that hold times or describe the machine.
const VARYING: [&str; 6] = ["seconds", "microseconds_per_step", "median_s", "machine", "load", "diagnosis_s"];

/// Pages that state times, the machine's description, and journals, whose lines are in the order of their completion.
const LEFT_OUT: [&str; 3] = ["machine.json", "seconds.json", "cells.jsonl"];

/// Reads all files in the folders. A report is left out if the folder also holds a study's figures, which vary.
pub fn contents(at: &Path, folders: &[&str]) -> Files {
    let mut found = Files::new();
    folders.iter().for_each(|folder| read(at, &at.join(folder), &mut found));
    found
}

fn read(root: &Path, folder: &Path, found: &mut Files) {
    let states_times = ["machine.json", "scores.json", "ablation.json", "cells.jsonl"];
    let states_times = states_times.iter().any(|name| folder.join(name).exists());
    for entry in fs::read_dir(folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display())) {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        if path.is_dir() {
            read(root, &path, found);
        } else if !(LEFT_OUT.contains(&name.as_str()) || name == "report.html" && states_times) {
            let bytes = fs::read(&path).unwrap();
            let bytes = if name.ends_with(".json") { steady(&bytes) } else { bytes };
            found.insert(path.strip_prefix(root).unwrap().display().to_string(), bytes);
        }
    }
}

/// JSON without the keys that vary; other bytes are kept as they are.
fn steady(bytes: &[u8]) -> Vec<u8> {
    let text = std::str::from_utf8(bytes).expect("JSON is text");
    if !VARYING.iter().any(|key| text.contains(&format!("\"{key}\""))) {
        return bytes.to_vec();
    }
    let mut value: Value = serde_json::from_str(text).expect("a result is JSON");
    remove(&mut value);
    value.to_string().into_bytes()
}

fn remove(value: &mut Value) {
    match value {
        Value::Object(fields) => {
            fields.retain(|key, _| !VARYING.contains(&key.as_str()));
            fields.values_mut().for_each(remove);
        }
        Value::Array(items) => items.iter_mut().for_each(remove),
        _ => {}
    }
}
