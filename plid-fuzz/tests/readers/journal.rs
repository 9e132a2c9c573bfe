//! The journals of studies.

use plid_bench::study::Journal;
use plid_bench::{expectations, stability};
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

#[test]
fn stability_journal() {
    fuzz("stability-journal", 1000, 5000, |bytes| read::<stability::Cell>("stability", bytes));
}

#[test]
fn expectations_journal() {
    fuzz("expectations-journal", 1000, 5000, |bytes| read::<expectations::Finished>("expectations", bytes));
}
