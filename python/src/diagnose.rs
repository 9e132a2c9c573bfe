//! The diagnosis with a Python simulator in the loop.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;

use numpy::{PyArray2, PyReadonlyArray2, ToPyArray};
use plid::gap::GapError;
use plid::gap::answer::predict::Prediction;
use plid::gap::case::{Case, CaseConfig, Channels, Excitation, Record, excitations_of};
use plid::gap::effects::Library;
use plid::gap::in_loop::{self, Answered};
use plid_simulator::Description;
use pyo3::exceptions::{PyOSError, PyRuntimeError, PyValueError};
use pyo3::prelude::*;

use crate::errors::{of_panic, value};
use crate::simulator::{columns, end, ended, of_object, reason, rows};

/// A record: its name, inputs and outputs (samples x channels), its start in s, and whether it is held out.
type Given<'py> = (String, PyReadonlyArray2<'py, f64>, PyReadonlyArray2<'py, f64>, f64, bool);

/// A finished diagnosis.
#[pyclass(frozen, module = "plid._plid")]
pub struct Outcome {
    answered: Answered,
    description: Description,
    case: Case,
}

/// Diagnoses the gap between records and a simulator. `description` is the JSON of a `Description`, `options` that of a
/// case file, with the kinds of the records' excitation.
#[pyfunction]
#[pyo3(signature = (records, simulator, description, options, progress))]
pub fn diagnose(
    py: Python<'_>,
    records: Vec<Given<'_>>,
    simulator: Py<PyAny>,
    description: &str,
    options: &str,
    progress: Option<Py<PyAny>>,
) -> PyResult<Outcome> {
    let description: Description = serde_json::from_str(description).map_err(value)?;
    let config: CaseConfig = serde_json::from_str(options).map_err(value)?;
    let wrong = |(key, message): (&str, String)| value(format!("{key}: {message}"));
    if let Some(problem) = config.problems().into_iter().next() {
        return Err(wrong(problem));
    }
    let mut warnings = Vec::new();
    let mut records: Vec<Record> = records.into_iter().map(record).collect();
    let inputs: Vec<Channels> = records.iter().map(|record| record.u.clone()).collect();
    let excitations = excitations_of(&config, &inputs, &mut warnings).map_err(wrong)?;
    records.iter_mut().zip(excitations).for_each(|(record, excitation)| record.excitation = excitation);
    let case = Case { config, model: None, controller: None, records, for_simulation: Vec::new(), warnings };
    let (mut simulator, shelf) = of_object(py, description.clone(), simulator)?;
    let mut say = |line: String| {
        let told = Python::attach(|py| {
            py.check_signals()?;
            progress.as_ref().map_or(Ok(()), |progress| progress.call1(py, (line,)).map(drop))
        });
        if let Err(error) = told {
            end(&shelf, error);
        }
    };
    let work = || in_loop::diagnose(&case, simulator.as_mut(), &Library::standard(), &mut say);
    let done = py.detach(|| catch_unwind(AssertUnwindSafe(work)));
    if let Some(error) = ended(&shelf) {
        return Err(error);
    }
    match done {
        Ok(Ok(answered)) => Ok(Outcome { answered, description, case }),
        Ok(Err(error)) => Err(reason(py, &shelf, of_gap(&error))),
        Err(panic) => Err(of_panic(panic.as_ref())),
    }
}

/// Returns a record with the excitation of the case.
fn record((name, u, y, start_s, held_out): Given<'_>) -> Record {
    let (u, y) = (columns(u.as_array()), columns(y.as_array()));
    Record { name, excitation: Excitation::Random, from_rest: true, start_s, held_out, u, y, simulated: None }
}

fn of_gap(error: &GapError) -> PyErr {
    let text = error.to_string();
    match error {
        GapError::Io { .. } => PyOSError::new_err(text),
        GapError::Simulator(_) => PyRuntimeError::new_err(text),
        _ => PyValueError::new_err(text),
    }
}

#[pymethods]
impl Outcome {
    /// The contents of diagnosis.json.
    fn diagnosis(&self) -> PyResult<String> {
        self.answered.diagnosis().map_err(value)
    }

    /// The contents of sim-with-effect.json.
    fn simulation(&self) -> PyResult<String> {
        self.answered.simulation().map_err(value)
    }

    /// The answer as text, with the parameters and their intervals.
    fn text(&self) -> String {
        self.answered.text()
    }

    /// The outputs measured, as given and with the effects (samples x outputs each) of the record that the report
    /// shows.
    fn shown<'py>(&self, py: Python<'py>) -> (String, Vec<Bound<'py, PyArray2<f64>>>) {
        let (record, trace) = self.answered.shown();
        (record.into(), trace.iter().map(|trace| rows(trace).to_pyarray(py)).collect())
    }

    /// Writes report.html, diagnosis.json and sim-with-effect.json into a folder.
    fn write(&self, folder: PathBuf) -> PyResult<()> {
        self.answered.write(&self.case, &folder).map_err(|error| of_gap(&error))
    }

    /// Writes the report alone to a file.
    fn write_page(&self, file: PathBuf) -> PyResult<()> {
        self.answered.write_page(&self.case, &file).map_err(|error| of_gap(&error))
    }

    /// Predicts the outputs of the simulator with the effects, with a warning if the input exceeds the fitted range.
    fn predict<'py>(
        &self,
        py: Python<'py>,
        simulator: Py<PyAny>,
        u: PyReadonlyArray2<'py, f64>,
        t0: Option<f64>,
    ) -> PyResult<(Bound<'py, PyArray2<f64>>, Option<String>)> {
        let (mut simulator, shelf) = of_object(py, self.description.clone(), simulator)?;
        let t0 = t0.unwrap_or(self.answered.t0());
        let u = columns(u.as_array());
        let work = || self.answered.predict(simulator.as_mut(), &Library::standard(), &u, t0);
        match py.detach(|| catch_unwind(AssertUnwindSafe(work))) {
            Ok(Ok(Prediction { outputs, beyond, .. })) => {
                Ok((rows(&outputs).to_pyarray(py), beyond.and_then(|beyond| beyond.warning())))
            }
            Ok(Err(error)) => Err(reason(py, &shelf, of_gap(&error))),
            Err(panic) => Err(of_panic(panic.as_ref())),
        }
    }
}
