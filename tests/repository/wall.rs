//! What makes the truths and what diagnoses them share no code: a wall in the graph of dependencies.

use std::collections::{BTreeMap, BTreeSet};
use std::process::Command;

use serde_json::Value;

/// Of each package of the workspace, the names of its normal dependencies.
fn dependencies() -> BTreeMap<String, Vec<String>> {
    let mut cargo = Command::new(env!("CARGO"));
    cargo.args(["metadata", "--no-deps", "--offline", "--format-version", "1"]);
    let output = cargo.current_dir(env!("CARGO_MANIFEST_DIR")).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let metadata: Value = serde_json::from_slice(&output.stdout).unwrap();
    let name = |of: &Value| of["name"].as_str().unwrap().to_owned();
    let list = |of: &Value| of.as_array().unwrap().clone();
    let normal = |package: &Value| {
        list(&package["dependencies"]).iter().filter(|dependency| dependency["kind"].is_null()).map(name).collect()
    };
    list(&metadata["packages"]).iter().map(|package| (name(package), normal(package))).collect()
}

/// The packages of the workspace that `package` is compiled with, itself left out.
fn reach(package: &str) -> BTreeSet<String> {
    let all = dependencies();
    let mut found = BTreeSet::new();
    let mut open = vec![package.to_owned()];
    while let Some(next) = open.pop() {
        let members = all[&next].iter().filter(|name| all.contains_key(*name));
        open.extend(members.filter(|name| found.insert((*name).clone())).cloned());
    }
    found
}

#[test]
fn the_diagnosis_does_not_reach_the_testbed() {
    let reached = reach("plid-gap");
    assert!(reached.contains("plid-core"), "{reached:?}");
    for beyond in ["plid-testbed", "plid-lab", "plid-catalogue", "plid-trial"] {
        assert!(!reached.contains(beyond), "plid-gap reaches {beyond}: {reached:?}");
    }
}

/// Writing files is not part of either's mathematics.
#[test]
fn the_testbed_reaches_only_the_crate_that_writes_files() {
    assert_eq!(reach("plid-testbed"), BTreeSet::from(["plid-file".to_owned()]));
}

/// The trial alone stands above both.
#[test]
fn the_trial_reaches_both() {
    let reached = reach("plid-trial");
    assert!(reached.contains("plid-gap") && reached.contains("plid-testbed"), "{reached:?}");
}
