//! The files of a blind trial.

use std::fs;
use std::path::Path;

use plid_trial::judge::{Claim, judge};
use plid_trial::truth::Truth;
use plid_trial::{DrawnCase, Seconds};

use crate::{fuzz, json, with_folder, words};

#[cfg_attr(test, test)]
pub fn seal() {
    fuzz("seal", 2000, 5000, |bytes| {
        with_folder(|folder| {
            fs::write(folder.join("seal.json"), bytes).unwrap();
            words(plid_trial::config_of(folder))
        })
    });
}

/// The manifest of a trial with one shard.
#[cfg_attr(test, test)]
pub fn manifest() {
    fuzz("manifest", 2000, 2000, |bytes| {
        with_folder(|folder| {
            fs::write(folder.join("trial.json"), bytes).unwrap();
            words(plid_trial::merge(folder, &[]))
        })
    });
}

/// A trial of one case with an answer, in one shard.
fn one_shard(folder: &Path) {
    let shard = folder.join("shards/1-of-1");
    let case = shard.join("case-001");
    fs::create_dir_all(&case).unwrap();
    let _ = fs::remove_dir_all(folder.join("answers"));
    let files = [
        (folder.join("trial.json"), include_str!("../../corpus/manifest/trial.json")),
        (shard.join("shard.json"), include_str!("../../corpus/shard/one.json")),
        (case.join("answer.json"), include_str!("../../corpus/answer/answered.json")),
        (case.join("a.json"), "1"),
    ];
    for (file, text) in files {
        fs::write(file, text).unwrap();
    }
}

#[cfg_attr(test, test)]
pub fn shard() {
    fuzz("shard", 2000, 3000, |bytes| {
        with_folder(|folder| {
            one_shard(folder);
            fs::write(folder.join("shards/1-of-1/shard.json"), bytes).unwrap();
            words(plid_trial::merge(folder, &[]))
        })
    });
}

/// What a merge accepts, it copies.
#[cfg_attr(test, test)]
pub fn answer() {
    fuzz("answer", 2000, 2000, |bytes| {
        with_folder(|folder| {
            one_shard(folder);
            fs::write(folder.join("shards/1-of-1/case-001/answer.json"), bytes).unwrap();
            let merged = plid_trial::merge(folder, &[]);
            if merged.is_ok() {
                assert!(fs::read(folder.join("answers/case-001/answer.json")).unwrap() == bytes);
                assert_eq!(plid_trial::merge(folder, &[]).unwrap(), 1, "the second time");
            }
            words(merged)
        })
    });
}

/// What is asked of a label that can be read.
#[cfg_attr(test, test)]
pub fn label() {
    fuzz("label", 2000, 5000, |bytes| {
        let read = serde_json::from_slice::<Truth>(bytes);
        if let Ok(truth) = &read {
            let places =
                ["input:u1", "input:u1->u2", "input:all", "output:y1->y3", "mode:168", "freq:50 Hz", "structure"];
            for effect in truth.effects.iter().chain(&truth.background_effects) {
                places.iter().for_each(|place| _ = effect.is_at(place));
            }
            truth.nuisances();
            judge(truth, &[], &Claim::missing(), Some(0.1));
        }
        words(read)
    });
}

/// What was asked of the testbed, which draws the case again from it.
#[cfg_attr(test, test)]
pub fn drawn() {
    fuzz("drawn", 2000, 5000, |bytes| words(json::<DrawnCase>(bytes)));
}

#[cfg_attr(test, test)]
pub fn seconds() {
    fuzz("seconds", 2000, 5000, |bytes| words(json::<Seconds>(bytes)));
}
