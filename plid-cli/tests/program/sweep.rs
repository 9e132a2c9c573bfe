//! `plid sweep` as a user meets it.

use std::fs;
use std::path::Path;

use crate::cli::record;
use crate::common::plid;
use crate::contents::{Files, contents};

const BASE: &str = "name = \"small\"\n[data]\nfiles = [\"r.csv\"]\ninputs = [\"u\"]\noutputs = [\"y\"]\n";

/// Two runs of four cannot be carried out.
const ORDERS: &str = "experiment = \"base/small.toml\"\n[vary]\nstructure.states = [1, 2]\n\
    identification.forgetting = [1.0, 2.0]\n";

pub fn prepare(at: &Path) {
    fs::create_dir(at.join("base")).unwrap();
    fs::write(at.join("base/r.csv"), record(400, 0.001)).unwrap();
    fs::write(at.join("base/small.toml"), BASE).unwrap();
    fs::write(at.join("orders.toml"), ORDERS).unwrap();
}

/// Runs the program and returns its status with what it said.
fn run(at: &Path, arguments: &[&str]) -> (i32, String) {
    let output = plid(at, &[&["sweep"], arguments].concat());
    let said = [output.stdout, output.stderr].concat();
    (output.status.code().unwrap(), String::from_utf8(said).unwrap())
}

fn succeeds(at: &Path, arguments: &[&str]) -> String {
    let (status, said) = run(at, arguments);
    assert_eq!(status, 0, "{arguments:?}: {said}");
    said
}

fn refuses(at: &Path, arguments: &[&str], expected: &str) {
    let (status, said) = run(at, arguments);
    assert!(status == 2 && said.contains(expected), "{arguments:?}: {status}, {said}");
}

fn files(at: &Path, folder: &str) -> Files {
    contents(&at.join(folder), &["."])
}

#[test]
fn every_point_is_a_run_and_a_row() {
    let directory = tempfile::tempdir().unwrap();
    let at = directory.path();
    prepare(at);
    let said = succeeds(at, &["orders.toml", "--out", "out"]);
    let reason = "forgetting: 2 is not above 0 and at most 1";
    assert!(said.starts_with(&format!("4 points, 2 of them failed\n  2: {reason}\n  4: {reason}\n")), "{said}");
    assert!(said.ends_with("report: out/report.html\n"), "{said}");

    let table = fs::read_to_string(at.join("out/table.csv")).unwrap();
    let rows: Vec<&str> = table.lines().collect();
    let head = "point,structure.states,identification.forgetting,states,training_samples,one_step_relative";
    assert!(rows[0].starts_with(head) && rows[0].ends_with(",warnings,error") && rows.len() == 5, "{table}");
    assert!(rows[1].starts_with("1,1,1.0,1,299,0.") && rows[3].starts_with("3,2,1.0,2,299,0."), "{table}");
    assert!(rows[2].starts_with("2,1,2.0,,") && rows[2].ends_with(&format!(",,{reason}")), "{table}");
    let result: serde_json::Value =
        serde_json::from_slice(&fs::read(at.join("out/points/3/result.json")).unwrap()).unwrap();
    let cell = |name: &str| rows[3].split(',').nth(rows[0].split(',').position(|cell| cell == name).unwrap()).unwrap();
    assert_eq!(cell("free_run_relative"), result["held_out"]["free_run"]["overall_relative"].to_string());
    let page = fs::read_to_string(at.join("out/report.html")).unwrap();
    assert!(page.contains("<svg") && page.contains(reason) && page.contains("refined model, %"));

    // A point is the run of its experiment.
    fs::write(at.join("base/two.toml"), format!("{BASE}[structure]\nstates = 2\n")).unwrap();
    assert_eq!(plid(at, &["run", "base/two.toml", "--out", "two"]).status.code(), Some(0));
    assert_eq!(files(at, "out/points/3"), files(at, "two"));

    let said = succeeds(at, &["orders.toml", "--out", "json", "--json"]);
    let said: serde_json::Value = serde_json::from_str(&said).unwrap();
    assert_eq!(said, serde_json::json!({ "points": 4, "failed": ["2", "4"], "folder": "json" }));
}

#[test]
fn shards_give_the_same_bytes() {
    let directory = tempfile::tempdir().unwrap();
    let at = directory.path();
    prepare(at);
    succeeds(at, &["orders.toml", "--out", "whole"]);
    refuses(at, &["orders.toml", "--out", "parts", "--merge"], "sweep.json: there is no such file");
    assert!(succeeds(at, &["orders.toml", "--out", "parts", "--shard", "1/2"]).starts_with("2 points, 0 of them"));
    assert!(!at.join("parts/table.csv").exists());
    refuses(
        at,
        &["orders.toml", "--out", "parts", "--merge"],
        "points: 2 of 4 points have not been run, 2 is the first",
    );
    // A shard that is started again keeps what it has.
    let written = || fs::metadata(at.join("parts/points/1/result.json")).unwrap().modified().unwrap();
    let before = written();
    succeeds(at, &["orders.toml", "--out", "parts", "--shard", "1/2"]);
    assert_eq!(written(), before);
    succeeds(at, &["orders.toml", "--out", "parts", "--shard", "2/2"]);
    succeeds(at, &["orders.toml", "--out", "parts", "--merge"]);
    assert_eq!(files(at, "parts"), files(at, "whole"));
}

#[test]
fn a_sweep_is_resumed_where_it_broke_off() {
    let directory = tempfile::tempdir().unwrap();
    let at = directory.path();
    prepare(at);
    succeeds(at, &["orders.toml", "--out", "out"]);
    let before = files(at, "out");
    for gone in ["table.csv", "report.html", "points/3/result.json", "points/4/error.txt"] {
        fs::remove_file(at.join("out").join(gone)).unwrap();
    }
    refuses(at, &["orders.toml", "--out", "out"], "not empty");
    succeeds(at, &["orders.toml", "--out", "out", "--resume"]);
    assert_eq!(files(at, "out"), before);

    // What failed is tried again, here with another record.
    fs::write(at.join("orders.toml"), ORDERS.replace("[1.0, 2.0]", "[1.0, 0.999]")).unwrap();
    refuses(at, &["orders.toml", "--out", "out", "--resume"], "sweep.json: this folder holds another sweep");
    refuses(at, &["orders.toml", "--out", "out", "--shard", "1/2"], "sweep.json: this folder holds another sweep");
    let said = succeeds(at, &["orders.toml", "--out", "out", "--force"]);
    assert!(said.starts_with("4 points, 0 of them failed"), "{said}");
    assert!(!at.join("out/points/4/error.txt").exists());
    fs::write(at.join("base/r.csv"), record(300, 0.001)).unwrap();
    refuses(at, &["orders.toml", "--out", "out", "--resume"], "of another experiment or of other data");
    refuses(at, &["orders.toml", "--out", "out", "--merge"], "4 of 4 points have not been run");
}

/// The sweep that the book and the help name.
#[test]
fn the_example_can_be_read() {
    let sweep = plid::lab::sweep::Sweep::read(Path::new("../experiments/orders.toml")).unwrap();
    let states = |index| sweep.experiment(index).structure.states;
    assert_eq!((sweep.points(), states(0), states(5)), (6, Some(24), Some(36)));
}

#[test]
fn what_is_wrong_is_said_before_anything_is_run() {
    let directory = tempfile::tempdir().unwrap();
    let at = directory.path();
    prepare(at);
    fs::write(at.join("wrong.toml"), ORDERS.replace("structure.states", "structure.sates")).unwrap();
    refuses(at, &["wrong.toml", "--out", "out"], "wrong.toml, line 3: vary.structure.sates: unknown field `sates`");
    refuses(at, &["wrong.toml", "--out", "out"], "did you mean `states`?");
    refuses(at, &["orders.toml", "--out", "out", "--shard", "3/2"], "i from 1 to N");
    refuses(at, &["orders.toml", "--out", "out", "--shard", "1/2", "--merge"], "cannot be used with");
    refuses(at, &["orders.toml", "--out", "base", "--shard", "1/2"], "not empty");
    assert!(!at.join("out").exists());
}
