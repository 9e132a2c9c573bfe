//! The journals of studies.

use plid_bench::study::{Journal, merge_shards};
use plid_bench::{expectations, speed, stability};
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::{fuzz, with_folder, words};

/// Opens a journal twice. What the first reading accepts, the second one finds again.
fn read<T: Serialize + DeserializeOwned + PartialEq>(study: &str, bytes: &[u8]) -> String {
    with_folder(|folder| {
        std::fs::write(folder.join("cells.jsonl"), bytes).unwrap();
        let open = || Journal::<T>::open(folder, study, "config", true);
        let first = open();
        if let Ok(first) = &first {
            let second = open().unwrap();
            assert!(first.cells() == second.cells());
            for (key, cell) in first.cells() {
                let text = serde_json::to_string(cell).unwrap();
                assert!(serde_json::from_str::<T>(&text).unwrap() == *cell, "{key}: {text}");
            }
        }
        words(first)
    })
}

#[cfg_attr(test, test)]
pub fn stability_journal() {
    fuzz("stability-journal", 1000, 5000, |bytes| read::<stability::Cell>("stability", bytes));
}

#[cfg_attr(test, test)]
pub fn expectations_journal() {
    fuzz("expectations-journal", 1000, 5000, |bytes| read::<expectations::Finished>("expectations", bytes));
}

#[cfg_attr(test, test)]
pub fn speed_journal() {
    fuzz("speed-journal", 1000, 5000, |bytes| read::<speed::Entry>("speed", bytes));
}

#[cfg_attr(test, test)]
pub fn paper_journal() {
    fuzz("paper-journal", 1000, 5000, |bytes| read::<plid_paper::Done>("reproduce", bytes));
}

/// The file that says which shard a folder holds, and that it is complete.
#[cfg_attr(test, test)]
pub fn study_shard() {
    fuzz("study-shard", 2000, 5000, |bytes| {
        with_folder(|folder| {
            let shard = folder.join("shards/1-of-1");
            std::fs::create_dir_all(&shard).unwrap();
            std::fs::write(shard.join("shard.json"), bytes).unwrap();
            words(merge_shards::<stability::Cell>(folder, "stability", "config"))
        })
    });
}
