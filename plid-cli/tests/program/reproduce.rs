//! `plid reproduce` as a user meets it.

use crate::common;

use common::plid;

#[test]
fn a_claim_is_run_told_and_kept() {
    let directory = tempfile::tempdir().unwrap();
    let out = directory.path().join("paper").display().to_string();
    let first = plid(directory.path(), &["reproduce", "--only", "sizing", "--out", &out]);
    assert_eq!(first.status.code(), Some(0), "{}", String::from_utf8_lossy(&first.stderr));
    let text = String::from_utf8_lossy(&first.stdout).into_owned();
    assert!(text.starts_with("sizing    confirmed in part") && text.contains("report.html"), "{text}");
    for file in ["report.html", "claims.json", "sizing/claim.json", "sizing/sizing.toml"] {
        assert!(directory.path().join("paper").join(file).exists(), "{file}");
    }
    // The same directory is gone on with, and as JSON the answer is claims.json.
    let again = plid(directory.path(), &["reproduce", "--only", "sizing", "--out", &out, "--json"]);
    assert_eq!(again.stdout, std::fs::read(directory.path().join("paper/claims.json")).unwrap());
}

#[test]
fn a_claim_that_is_not_there_and_a_directory_of_others_are_refused() {
    let directory = tempfile::tempdir().unwrap();
    let out = directory.path().display().to_string();
    let unknown = plid(directory.path(), &["reproduce", "--only", "fig3", "--out", &out]);
    let message = String::from_utf8_lossy(&unknown.stderr).into_owned();
    assert!(unknown.status.code() == Some(2) && message.contains("no claim `fig3`"), "{message}");
    std::fs::write(directory.path().join("mine.txt"), "mine").unwrap();
    let full = plid(directory.path(), &["reproduce", "--only", "sizing", "--out", &out]);
    assert_eq!(full.status.code(), Some(2));
}

/// A merge runs nothing, so a claim that no shard has run is an error.
#[test]
fn a_claim_that_no_shard_has_run_is_named() {
    let directory = tempfile::tempdir().unwrap();
    let run = |more: &[&str]| plid(directory.path(), &[&["reproduce", "--quick", "--out", "paper"], more].concat());
    let shard = run(&["--only", "sizing", "--shard", "1/1"]);
    assert_eq!(shard.status.code(), Some(0), "{}", String::from_utf8_lossy(&shard.stderr));
    let merge = run(&["--only", "sizing", "--only", "fig5", "--merge"]);
    let message = String::from_utf8_lossy(&merge.stderr).into_owned();
    assert!(merge.status.code() == Some(2) && message.contains("fig5: no shard has run this claim"), "{message}");
    assert_eq!(run(&["--only", "sizing", "--merge"]).status.code(), Some(0));
}
