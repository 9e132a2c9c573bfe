//! Mutated inputs for every reader: docs/robustness.md. Without `cfg(test)`, this is the program of
//! `plid-fuzz/coverage`, in which libFuzzer makes the inputs.

#![cfg_attr(not(test), no_main)]

mod bench;
mod checkpoint;
mod configs;
#[cfg(not(test))]
mod coverage;
mod data;
mod fmu;
mod journal;
mod model;
mod prediction;
mod protocol;
mod record;
mod runs;
mod sweep;
mod trial;

use std::fmt::Debug;
use std::path::Path;

#[cfg(not(test))]
use coverage::fuzz;
#[cfg(test)]
use plid_fuzz::Target;
use serde::Serialize;
use serde::de::DeserializeOwned;

/// Lets a reader read its corpus and mutations of it.
#[cfg(test)]
fn fuzz(name: &'static str, memory: u64, executions: u64, read: fn(&[u8]) -> String) {
    let corpus = Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus");
    let target = Target { name, read, memory, executions };
    plid_fuzz::run(&target, &corpus, Path::new(env!("CARGO_TARGET_TMPDIR")));
}

/// The words on an input that is accepted or refused.
fn words<T, E: ToString>(read: Result<T, E>) -> String {
    read.map_or_else(|error| error.to_string(), |_| "accepted".into())
}

/// Checks that a value is written and read back the same.
fn require_same<T: PartialEq + Debug>(value: &T, text: &str, again: Result<T, impl Debug>) {
    match again {
        Ok(again) => assert!(again == *value, "{value:?} is read back as {again:?} from {text}"),
        Err(error) => panic!("{value:?} is written as {text}, which is refused: {error:?}"),
    }
}

/// Reads JSON, and checks that an accepted value is written and read back the same.
fn json<T: Serialize + DeserializeOwned + PartialEq + Debug>(bytes: &[u8]) -> Result<T, serde_json::Error> {
    let value: T = serde_json::from_slice(bytes)?;
    let text = serde_json::to_string(&value).unwrap();
    require_same(&value, &text, serde_json::from_str(&text));
    Ok(value)
}

/// A folder of this thread for readers that open files. It is in memory where the system has such a place.
fn with_folder<T>(work: impl FnOnce(&Path) -> T) -> T {
    thread_local! {
        static FOLDER: tempfile::TempDir = {
            let memory = Path::new("/dev/shm");
            if memory.is_dir() { tempfile::tempdir_in(memory) } else { tempfile::tempdir() }.unwrap()
        };
    }
    FOLDER.with(|folder| work(folder.path()))
}
