//! The files of a diagnosis.

use std::path::{Path, PathBuf};

use plid_report::Report;
use serde::Serialize;

use crate::case::Case;
use crate::diagnose::Outcome;
use crate::error::GapError;
use crate::report;
use plid_file::{Staged, to_json, write_atomic};

/// The file of the diagnosis. It is written last, so its presence shows that the other files are complete.
const DIAGNOSIS: &str = "diagnosis.json";

/// The file that a prediction reads.
const SIMULATION: &str = "sim-with-effect.json";

/// Writes diagnosis.json, sim-with-effect.json and report.html into a folder. Together they replace those of an
/// earlier diagnosis. If anything fails, the earlier files are not changed.
///
/// # Errors
/// [`GapError::NotFinite`] with the file and the key, before anything is written; [`GapError::Io`] with the file.
pub fn write(outcome: &Outcome, case: &Case, directory: &Path) -> Result<(), GapError> {
    write_answer(&outcome.diagnosis, &outcome.simulation, || report::page(outcome, case), directory)
}

/// Writes the files of any diagnosis.
///
/// # Errors
/// The errors of [`write()`].
pub(crate) fn write_answer(
    diagnosis: &impl Serialize,
    simulation: &impl Serialize,
    page: impl FnOnce() -> Report,
    directory: &Path,
) -> Result<(), GapError> {
    let not_finite = |file: PathBuf| move |source| GapError::NotFinite { file, source };
    let said = to_json(diagnosis).map_err(not_finite(directory.join(DIAGNOSIS)))?;
    let predicts = to_json(simulation).map_err(not_finite(directory.join(SIMULATION)))?;
    let page = page().to_html();
    let failed = |file: PathBuf| move |source| GapError::Io { file, source };
    let staged = Staged::new(directory).map_err(failed(directory.into()))?;
    for (name, text) in [(SIMULATION, predicts), ("report.html", page), (DIAGNOSIS, said)] {
        write_atomic(&staged.path().join(name), text.as_bytes()).map_err(failed(directory.join(name)))?;
    }
    staged.commit(DIAGNOSIS, &[]).map_err(failed(directory.into()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::Library;
    use crate::testing::{case, truss};

    #[test]
    fn a_result_that_is_no_number_is_not_written() {
        let case = case(&truss(1), &truss(1));
        let library = Library::standard();
        let names: Vec<String> =
            library.effects().map(|e| e.name().to_string()).filter(|n| n != "sensor-gain").collect();
        let mut outcome = crate::diagnose::diagnose(&case, &library.without(&names), &mut |_| {}).unwrap();
        let folder = tempfile::tempdir().unwrap();
        outcome.simulation.noise_rms[1] = f64::NAN;
        let said = write(&outcome, &case, folder.path()).unwrap_err().to_string();
        assert!(said.contains("sim-with-effect.json: `noise_rms[1]` is NaN"), "{said}");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
        outcome.simulation.noise_rms[1] = 0.0;
        write(&outcome, &case, folder.path()).unwrap();
        let predictor =
            crate::answer::predict::Predictor::read(&folder.path().join("sim-with-effect.json"), &Library::standard())
                .unwrap();
        assert_eq!((predictor.noise_rms, predictor.fitted), (outcome.simulation.noise_rms, outcome.simulation.fitted));
    }
}
