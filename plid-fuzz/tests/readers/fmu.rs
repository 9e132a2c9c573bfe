//! FMUs: the archive, and modelDescription.xml in it. None of them has a binary, so that no foreign code runs.

use std::fs::File;
use std::io::Write;
use std::path::Path;

use plid_fmu::{ChosenParameter, Fmu, Options};
use zip::write::{SimpleFileOptions, ZipWriter};

use crate::{fuzz, with_folder, words};

/// Opens an FMU with all of its inputs and outputs, and then with a parameter and a port.
fn read(file: &Path) -> String {
    let chosen = Options {
        rate_hz: Some(100.0),
        parameters: vec![ChosenParameter::new("mass")],
        ports: vec!["joint=force,position,velocity".parse().unwrap()],
        ..Options::default()
    };
    [Options::default(), chosen].map(|options| words(Fmu::open(file, &options).map(drop))).join("; ")
}

/// Compressed files expand up to a thousand times, but they are unpacked piece by piece.
#[cfg_attr(test, test)]
pub fn archive() {
    fuzz("fmu", 20_000, 2000, |bytes| {
        with_folder(|folder| {
            let file = folder.join("x.fmu");
            std::fs::write(&file, bytes).unwrap();
            read(&file)
        })
    });
}

#[cfg_attr(test, test)]
pub fn model_description() {
    fuzz("model-description", 2000, 3000, |bytes| {
        with_folder(|folder| {
            let file = folder.join("x.fmu");
            let mut archive = ZipWriter::new(File::create(&file).unwrap());
            archive.start_file("modelDescription.xml", SimpleFileOptions::default()).unwrap();
            archive.write_all(bytes).unwrap();
            archive.finish().unwrap();
            read(&file)
        })
    });
}
