//! The files of a blind trial.

use std::fs;

use crate::{fuzz, with_folder, words};

#[test]
fn seal() {
    fuzz("seal", 2000, 5000, |bytes| {
        with_folder(|folder| {
            fs::write(folder.join("seal.json"), bytes).unwrap();
            words(plid_trial::config_of(folder))
        })
    });
}

/// The manifest of a trial with one shard.
#[test]
fn manifest() {
    fuzz("manifest", 2000, 2000, |bytes| {
        with_folder(|folder| {
            fs::write(folder.join("trial.json"), bytes).unwrap();
            words(plid_trial::merge(folder, &[]))
        })
    });
}
