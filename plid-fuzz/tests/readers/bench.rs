//! The configs of studies, and the files of times that `plid bench speed` compares with.

use plid_bench::{expectations, speed, stability};

use crate::{configs::read, fuzz, require_same, with_folder, words};

#[cfg_attr(test, test)]
pub fn speed_config() {
    fuzz("speed-config", 2000, 5000, |bytes| read(bytes, speed::Config::problems));
}

#[cfg_attr(test, test)]
pub fn stability_config() {
    fuzz("stability-config", 2000, 5000, |bytes| read(bytes, stability::Config::problems));
}

#[cfg_attr(test, test)]
pub fn expectations_config() {
    fuzz("expectations-config", 2000, 5000, |bytes| read(bytes, expectations::Config::problems));
}

#[cfg_attr(test, test)]
pub fn peers() {
    fuzz("peers", 1000, 5000, |bytes| {
        with_folder(|folder| {
            let file = folder.join("peers.json");
            std::fs::write(&file, bytes).unwrap();
            words(speed::peers::read(&file).map(|peers| {
                let _ = peers.fastest(64, true);
            }))
        })
    });
}

#[cfg_attr(test, test)]
pub fn speed_results() {
    fuzz("speed-results", 2000, 5000, |bytes| {
        with_folder(|folder| {
            let file = folder.join("speed.json");
            std::fs::write(&file, bytes).unwrap();
            let read = speed::compare::read(&file);
            if let Ok(outcome) = &read {
                let text = plid_file::to_json(outcome).unwrap();
                require_same(outcome, &text, serde_json::from_str(&text));
                let compared = speed::compare::compare(outcome, outcome, speed::compare::TOLERANCE);
                assert!(compared.slower.is_empty() && compared.faster.is_empty(), "{compared:?}");
            }
            words(read)
        })
    });
}
