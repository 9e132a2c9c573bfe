//! A small study of stability from its config to its files.

use std::fs;
use std::path::Path;

use plid_bench::stability::{Class, Config, Outcome, Part, carry_out, write_all};
use plid_bench::study::{Silent, from_toml_checked};

const SMALL: &str = "
states = [3, 6]
steps = 120
reference_work = 1e5
[variations]
states = [3]
expectations = [\"joint-ekf\"]
parameter_noise = [1e-6]
[long]
states = 3
steps = 200
[adversarial]
states = 6
steps = 60
start_ratios = [1.0, 1e16]
";

fn run(directory: &Path, threads: usize, resume: bool) -> Outcome {
    let config: Config = from_toml_checked(SMALL, "small", Config::problems).unwrap();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    let outcome = pool.install(|| carry_out(&config, directory, resume, &Silent)).unwrap();
    write_all(&outcome, directory).unwrap();
    outcome
}

#[test]
fn a_study_repeats_on_any_number_of_threads_and_resumes_to_the_same_table() {
    let directories = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
    let outcome = run(directories[0].path(), 1, false);
    run(directories[1].path(), 2, false);
    let read = |at: &Path, name: &str| fs::read_to_string(at.join(name)).unwrap();
    let table = read(directories[0].path(), "stability.csv");
    assert_eq!(table, read(directories[1].path(), "stability.csv"));
    // An interrupted study: half of the journal is there.
    let journal = read(directories[0].path(), "cells.jsonl");
    let half: Vec<&str> = journal.lines().take(60).collect();
    fs::write(directories[1].path().join("cells.jsonl"), half.join("\n") + "\n").unwrap();
    fs::remove_file(directories[1].path().join("stability.csv")).unwrap();
    run(directories[1].path(), 2, true);
    assert_eq!(table, read(directories[1].path(), "stability.csv"));

    // 2 sizes, 6 variations, 2 starts, 5 records: 8 cells each; and the long run with its peer.
    assert_eq!(outcome.cells.len(), 8 * (2 + 6 + 2 + 5) + 2);
    assert_eq!(table.lines().count(), 1 + outcome.cells.len());
    let class = |part: Part, label: &str, name: &str| {
        let found = outcome.cells.iter().find(|j| {
            let cell = &j.cell;
            cell.group.part == part && cell.group.label == label && format!("{} {:?}", cell.form, cell.scalar) == name
        });
        found.unwrap_or_else(|| panic!("{label}, {name}")).class
    };
    assert_eq!(class(Part::Adversarial, "P0/R = 1e0", "direct F32"), Class::Sound);
    assert_eq!(class(Part::Adversarial, "P0/R = 1e16", "direct F32"), Class::Lost);
    assert_eq!(class(Part::Adversarial, "P0/R = 1e16", "bierman-ud F64"), Class::Sound);
    // Only plants of the model's class have a NEES.
    for judged in &outcome.cells {
        let in_class = judged.cell.group.label == "plant in class" || judged.cell.group.label.starts_with("jump");
        assert!(judged.cell.nees.is_none() || in_class, "{}", judged.cell.group.label);
    }
    assert!(outcome.cells.iter().any(|j| j.cell.nees.is_some_and(|nees| nees > 0.01 && nees < 100.0)));
    let page = read(directories[0].path(), "report.html");
    for said in [
        "Stability of the covariance forms",
        ">lost<",
        ">sound<",
        "Recommended forms",
        "Adverse initial conditions and records",
    ] {
        assert!(page.contains(said), "{said}");
    }
    let json: serde_json::Value = serde_json::from_str(&read(directories[0].path(), "stability.json")).unwrap();
    assert_eq!(json["cells"].as_array().unwrap().len(), outcome.cells.len());
    assert_eq!(json["claims"].as_array().unwrap().len(), 5);
}
