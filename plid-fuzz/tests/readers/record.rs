//! The records of a case, measured and simulated.

use std::fs;

use plid_gap::case::Case;

use crate::{fuzz, with_folder, words};

/// A case with a simulation, or one with simulated outputs.
fn read(case: &str, bytes: &[u8], file: &str) -> String {
    with_folder(|folder| {
        let measured = include_str!("../../corpus/record/measured.csv");
        let files = [("case.toml", case), ("sim.json", include_str!("../../corpus/model/port.json"))];
        let records = [("r1.csv", measured), ("s1.csv", include_str!("../../corpus/simulated-record/simulated.csv"))];
        for (name, text) in files.into_iter().chain(records) {
            fs::write(folder.join(name), text).unwrap();
        }
        fs::write(folder.join(file), bytes).unwrap();
        let read = Case::read(&folder.join("case.toml"));
        if let Ok(case) = &read {
            for record in &case.records {
                let samples = record.u[0].len();
                assert!(record.u.iter().chain(&record.y).all(|channel| channel.len() == samples));
                // A missing sample of an output is masked.
                assert!(record.u.iter().flatten().all(|x| x.is_finite()));
                assert!(!record.y.iter().flatten().any(|x| x.is_infinite()));
            }
        }
        words(read)
    })
}

#[cfg_attr(test, test)]
pub fn record() {
    fuzz("record", 1000, 5000, |bytes| read(include_str!("../../corpus/case/record.toml"), bytes, "r1.csv"));
}

#[cfg_attr(test, test)]
pub fn simulated_record() {
    fuzz("simulated-record", 1000, 5000, |bytes| {
        read(include_str!("../../corpus/case/simulated.toml"), bytes, "s1.csv")
    });
}
