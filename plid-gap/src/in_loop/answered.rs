//! The answer about any simulator, from its linear model or with the simulator itself in the loop.

use std::path::Path;

use plid_file::{NotFinite, to_json};
use plid_simulator::{Checked, Simulator};

use crate::answer::predict::{Prediction, Predictor};
use crate::answer::schema::Used;
use crate::case::Case;
use crate::case::levels::loudest;
use crate::case::record::Channels;
use crate::diagnose::{Outcome, diagnose};
use crate::effects::Library;
use crate::error::GapError;
use crate::in_loop::predict::LoopPredictor;
use crate::in_loop::realise::realise;
use crate::in_loop::{LoopOutcome, report, require_same_channels};

/// The answer about a simulator.
pub enum Answered {
    /// The simulator is linear, and its model was diagnosed. The case contains the model.
    ByModel(Box<(Outcome, Case)>),
    /// The simulator itself was run with effects.
    InLoop(Box<LoopOutcome>),
}

/// Diagnoses the linear model of a simulator. Returns `None` if the simulator is not linear or has parameters, or if
/// the linear diagnosis cannot use its model.
pub(super) fn by_model(
    case: &Case,
    simulator: &mut dyn Simulator,
    library: &Library,
    say: &mut dyn FnMut(String),
) -> Result<Option<Answered>, GapError> {
    let most = case.config.settings.in_loop.model_states;
    let mut checked = Checked::new(simulator)?;
    let description = checked.description().clone();
    require_same_channels(case, &description)?;
    if most == 0 || !description.parameters.is_empty() || case.records.is_empty() {
        return Ok(None);
    }
    say("testing whether the simulator is linear".into());
    let loud = loudest(&case.records, case.config.settings.case.same_level);
    let Some(realised) = realise(&mut checked, &loud.u)? else { return Ok(None) };
    let states = realised.model.n();
    if states > most {
        return Ok(None);
    }
    let mut model = realised.model;
    case.config.declare_kinds(&mut model);
    let mut case = Case { model: Some(model), ..case.clone() };
    let inputs = description.inputs.iter().map(|input| (&input.name, &input.unit));
    for (name, unit) in inputs.chain(description.outputs.iter().map(|output| (&output.name, &output.unit))) {
        if let Some(unit) = unit.as_ref().filter(|unit| !unit.trim().is_empty()) {
            case.config.units.entry(name.clone()).or_insert_with(|| unit.clone());
        }
    }
    // A simulator whose model the linear diagnosis cannot use, such as an unstable one, is diagnosed in the loop.
    let Ok(mut outcome) = diagnose(&case, library, say) else { return Ok(None) };
    let calls = checked.calls();
    let name = description.name;
    outcome.diagnosis.evidence.push(format!(
        "The simulator {name} is linear: a model of {states} states, realised from its impulse responses, reproduces \
        it to {:.0e} of each output in the loudest record. This model was diagnosed in its place.",
        realised.error
    ));
    let seconds = calls.time.as_secs_f64();
    outcome.diagnosis.simulator =
        Some(Used { name, runs: calls.runs, seconds, cut_short: false, ended_by: None, left_out: Vec::new() });
    Ok(Some(Answered::ByModel(Box::new((outcome, case)))))
}

impl Answered {
    /// Returns the answer as text, with the parameters and their intervals.
    pub fn text(&self) -> String {
        match self {
            Self::ByModel(found) => found.0.diagnosis.text(),
            Self::InLoop(outcome) => outcome.diagnosis.text(),
        }
    }

    /// Returns the contents of diagnosis.json.
    ///
    /// # Errors
    /// [`NotFinite`] with the key of a number that is not finite.
    pub fn diagnosis(&self) -> Result<String, NotFinite> {
        match self {
            Self::ByModel(found) => to_json(&found.0.diagnosis),
            Self::InLoop(outcome) => to_json(&outcome.diagnosis),
        }
    }

    /// Returns the contents of sim-with-effect.json.
    ///
    /// # Errors
    /// [`NotFinite`] with the key of a number that is not finite.
    pub fn simulation(&self) -> Result<String, NotFinite> {
        match self {
            Self::ByModel(found) => to_json(&found.0.simulation),
            Self::InLoop(outcome) => to_json(&outcome.simulation),
        }
    }

    /// Returns the record that the report shows: its name, and its outputs measured, simulated as given and simulated
    /// with the effects (p channels each).
    pub fn shown(&self) -> (&str, &[Channels; 3]) {
        match self {
            Self::ByModel(found) => (&found.0.shown.trace_record, &found.0.shown.trace),
            Self::InLoop(outcome) => (&outcome.shown.record, &outcome.shown.trace),
        }
    }

    /// Returns the end of the last record, in s since the first began.
    pub fn t0(&self) -> f64 {
        match self {
            Self::ByModel(found) => found.0.simulation.t0,
            Self::InLoop(outcome) => outcome.simulation.t0,
        }
    }

    /// Predicts the outputs (p channels) for inputs (m channels), from rest at time `t0`. A linear simulator is not
    /// called again.
    ///
    /// # Errors
    /// [`GapError::Simulator`] if the simulator fails; [`GapError::Failed`] if it is a different simulator;
    /// [`GapError::Diverged`].
    pub fn predict(
        &self,
        simulator: &mut dyn Simulator,
        library: &Library,
        u: &[Vec<f64>],
        t0: f64,
    ) -> Result<Prediction, GapError> {
        match self {
            Self::ByModel(found) => {
                let written = found.0.simulation.clone();
                Predictor::new(written, library, Path::new("the diagnosis"))?.predict(u, t0)
            }
            Self::InLoop(outcome) => {
                let predictor = LoopPredictor::new(outcome.simulation.clone(), library).map_err(GapError::Failed)?;
                predictor.predict(simulator, u, t0)
            }
        }
    }

    /// Writes diagnosis.json, sim-with-effect.json and report.html into a folder, either all of them or none.
    ///
    /// # Errors
    /// The errors of [`crate::write`].
    pub fn write(&self, case: &Case, folder: &Path) -> Result<(), GapError> {
        match self {
            Self::ByModel(found) => crate::report::write(&found.0, case, folder),
            Self::InLoop(outcome) => report::write(outcome, case, folder),
        }
    }

    /// Writes only the report to a file, completely or not at all. The page needs no other file.
    ///
    /// # Errors
    /// [`GapError::NotFinite`] with the key of a number of the diagnosis that is not finite; [`GapError::Io`] with
    /// the file.
    pub fn write_page(&self, case: &Case, file: &Path) -> Result<(), GapError> {
        self.diagnosis().map_err(|source| GapError::NotFinite { file: file.into(), source })?;
        let page = match self {
            Self::ByModel(found) => crate::report::page(&found.0, case),
            Self::InLoop(outcome) => report::page(outcome, case),
        };
        page.write(file).map_err(|source| GapError::Io { file: file.into(), source })
    }
}
