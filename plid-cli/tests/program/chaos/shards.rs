//! Work that is done in shards has the results of the whole.

use std::fs;

use super::{Work, commands, contents, undisturbed};
use crate::common::plid;

/// Does the work in two shards, joins them, and compares with the work of one process. Returns how many lines the
/// journals of the shards have.
fn same_in_shards(work: &Work) -> Vec<usize> {
    let (expected, _) = undisturbed(work);
    let directory = tempfile::tempdir().unwrap();
    let at = directory.path();
    (work.prepare)(at);
    let run = |more: &[&str]| {
        let output = plid(at, &[work.first, more].concat());
        (output.status.code().unwrap(), String::from_utf8_lossy(&[output.stdout, output.stderr].concat()).into_owned())
    };
    for shard in [2, 1] {
        let (status, said) = run(&["--merge"]);
        assert!(status == 2 && said.contains("shard"), "{status}: {said}");
        let (status, said) = run(&["--shard", &format!("{shard}/2")]);
        assert_eq!(status, 0, "{said}");
        assert!(said.contains(&format!("shard {shard} of 2 is complete")), "{said}");
    }
    // Whatever is started again keeps what it has.
    let journals = ["1-of-2", "2-of-2"].map(|shard| at.join("out/shards").join(shard).join("cells.jsonl"));
    let read = || journals.clone().map(|path| fs::read_to_string(path).unwrap());
    let before = read();
    assert_eq!(run(&["--shard", "1/2"]).0, 0);
    assert_eq!(read(), before);
    let (status, said) = run(&["--merge"]);
    assert_eq!(status, 0, "{said}");
    let mut found = contents(at, work.results);
    found.retain(|name, _| !name.starts_with("out/shards/"));
    assert!(found.keys().eq(expected.keys()), "{:?}, not {:?}", found.keys(), expected.keys());
    let differs = expected.iter().find(|(name, content)| found[*name] != **content);
    assert!(differs.is_none(), "{:?}: {differs:?} differs in {found:?}", work.first);
    before.map(|journal| journal.lines().count()).to_vec()
}

/// Both shards have cells, below the head of the journal.
fn both_have_cells(lines: &[usize]) {
    assert!(lines.iter().all(|&lines| lines > 1), "{lines:?}");
}

#[test]
fn stability() {
    both_have_cells(&same_in_shards(&commands::BENCH_STABILITY));
}

#[test]
fn expectations() {
    both_have_cells(&same_in_shards(&commands::BENCH_EXPECTATIONS));
}

#[test]
fn reproduce() {
    both_have_cells(&same_in_shards(&commands::REPRODUCE));
}
