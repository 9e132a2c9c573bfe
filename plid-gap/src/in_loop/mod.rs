//! The diagnosis with any simulator in the loop.
//!
//! A linear simulation is decomposed into modes, and its fits use exact derivatives in thousands of runs. An external
//! simulator can only be run, and a run may take a second. This diagnosis therefore limits the number of runs.
//! Effects on commands and on measurements wrap around [`plid_simulator::Simulator::run`]; effects at ports act
//! between its steps; the simulator's own parameters are possible causes, too. Each effect is screened by one run for
//! each promising starting value, and the best effects are fitted on the simulator itself. The fits are compared by
//! their residuals, which are whitened by the residual of the best fit (docs/your-simulator.md).

mod answer;
mod answered;
mod bounds;
mod coupling;
mod crossed;
mod exchange;
mod fit;
mod judge;
mod measure;
mod noise;
mod outcome;
mod pairs;
mod parameter;
mod predict;
mod problem;
mod realise;
mod report;
mod runs;
mod screen;
mod search;
mod side;
mod slopes;
mod stand_in;
mod survey;

pub use answer::{LoopDiagnosis, LoopGap, SimulatorWithEffects, WrittenPort};
pub use answered::Answered;
pub use predict::{FORMAT, LoopPredictor};

use plid_data::nearest;
use plid_simulator::{Checked, Description, Simulator};

use crate::audit;
use crate::case::Case;
use crate::case::levels::loudest;
use crate::case::record::{Channels, Record};
use crate::case::split::split;
use crate::effects::{Effect, Library, Place};
use crate::error::GapError;
use crate::fit::problem::Placed;
use crate::in_loop::bounds::Bounds;
use crate::in_loop::judge::judge;
use crate::in_loop::measure::Opened;
use crate::in_loop::outcome::Told;
use crate::in_loop::parameter::SimulatorParameter;
use crate::in_loop::problem::{Nuisance, Problem};
use crate::in_loop::runs::Runs;
use crate::in_loop::search::Search;
use crate::in_loop::side::places;
use crate::in_loop::survey::{Survey, survey};
use crate::search::rules::{Rules, Scope, require_names};

/// The result of a diagnosis with a simulator in the loop.
pub struct LoopOutcome {
    /// The answer.
    pub diagnosis: LoopDiagnosis,
    /// Everything that a prediction needs besides the simulator.
    pub simulation: SimulatorWithEffects,
    /// The contents of the report that the answer does not contain.
    pub shown: Shown,
}

/// The contents of the report that the answer does not contain: the traces of one record, the screens and the fits.
pub struct Shown {
    /// Name of the record.
    pub record: String,
    /// Sample rate in Hz.
    pub rate: f64,
    /// Names of the outputs (p).
    pub outputs: Vec<String>,
    /// Unit of each output, if it is known.
    pub units: Vec<Option<String>>,
    /// The outputs: measured, simulated as given, and simulated with the effects (p channels each).
    pub trace: [Channels; 3],
    /// For each output, pairs of a frequency in Hz and the density of the noise there.
    pub noise: Vec<Vec<(f64, f64)>>,
    /// The best entries of each screen: effect, location, and the expected share of the squared gap that the effect
    /// explains.
    pub screens: Vec<Vec<(String, String, f64)>>,
    /// All fitted explanations, each with the gap that it leaves beyond the noise, relative to the output.
    pub fits: Vec<(String, f64)>,
}

/// Diagnoses the gap between records and a simulator. If the simulator is linear and has no parameters, its linear
/// model is diagnosed like a model.json.
///
/// # Errors
/// [`GapError::Simulator`] if the simulator fails as given; [`GapError::Key`] if it does not match the case;
/// [`GapError::Record`] if a record does not begin at rest; the errors of an audit of the records.
pub fn diagnose(
    case: &Case,
    simulator: &mut dyn Simulator,
    library: &Library,
    say: &mut dyn FnMut(String),
) -> Result<Answered, GapError> {
    if let Some(answered) = answered::by_model(case, simulator, library, say)? {
        return Ok(answered);
    }
    Ok(Answered::InLoop(Box::new(diagnose_in_loop(case, simulator, library, say)?)))
}

/// Diagnoses with the simulator itself in the loop, even if it is linear.
///
/// # Errors
/// The errors of [`diagnose`].
pub fn diagnose_in_loop(
    case: &Case,
    simulator: &mut dyn Simulator,
    library: &Library,
    say: &mut dyn FnMut(String),
) -> Result<LoopOutcome, GapError> {
    let mut simulator = Checked::side_by_side(simulator, case.config.settings.in_loop.side_by_side)?;
    let description = limited(simulator.description().clone(), case)?;
    require_same_channels(case, &description)?;
    let mut warnings = case.warnings.clone();
    warnings.extend(audit::of_records(case, true)?);
    require_rest(case)?;
    let settings = &case.config.settings;
    let (records, held_out) = split(&case.records, &settings.case);
    let loud = loudest(&records, settings.case.same_level).clone();
    say("running the simulator as given".into());
    let Survey { setting, responses, start } = survey(&mut simulator, &case.config, &records, &loud)?;
    let written_ports = WrittenPort::all(&description, &responses);
    let mut runs = Runs::new(simulator, responses);
    let asked: Vec<(&[Placed], &Record)> = records.iter().map(|record| (&[][..], record)).collect();
    let given: Vec<Channels> = runs.simulate_all(&setting, &asked).into_iter().collect::<Result<_, _>>()?;
    records.iter().zip(&given).for_each(|(record, y)| runs.learn_rest(record, y, &start));
    let noise = noise::estimate(&records, &given);
    warnings.extend(noise.warning());
    let parameters = SimulatorParameter::all(&description.parameters);
    let mut problem = Problem::new(records, &given, setting.clone(), &noise.std, case.config.band_hz);
    problem.nuisances = nuisances(&description, &parameters);
    problem.measure_nuisances(&mut runs, &given)?;
    let rules = Rules { suspects: &case.config.suspects, exclude: &case.config.exclude, without: &[] };
    let effects: Vec<&dyn Effect> =
        library.effects().chain(parameters.iter().map(|parameter| parameter as &dyn Effect)).collect();
    require_names(&case.config, effects.iter().copied(), &setting)?;
    let (names, of_search) = (setting.names.clone(), settings.search.clone());
    let scope =
        Scope { library, rules: &rules, settings: of_search, names, off: Vec::new(), bold: false, imperfect: false };
    let search = Search {
        effects,
        scope,
        settings: settings.in_loop.clone(),
        noise: noise.std.clone(),
        material: case.config.material,
    };
    runs.bind(Bounds::of(&settings.in_loop, closing_runs(&search, &problem, &held_out), problem.samples()));
    let mut found = search.run(&mut problem, &mut runs, &given, say);
    if !found.fits[0].effects.is_empty() {
        found.fits[0].covariance = problem.stated_covariance(&mut runs, &found.fits[0], &noise.std);
    }
    let mut judged = judge(&search, &problem, &found, &settings.judge);
    let opened = Opened { case, problem: &problem, noise: &noise, held_out: &held_out };
    say("measuring the gaps".into());
    runs.bind(Bounds::of(&settings.in_loop, motion_runs(&problem), problem.samples()));
    let measured = opened.measure(&mut runs, &found, &mut judged)?;
    let places = places(&problem, &mut runs, &found, &noise.std, &settings.judge);
    let simulation = opened.simulation(&mut runs, &measured, written_ports)?;
    let told = Told { runs: &runs, search: &search, found: &found, judged: &judged, places: &places, warnings };
    Ok(opened.outcome(&told, &measured, simulation))
}

/// Returns the number of runs that follow a search: the derivatives of an explanation whose effects have two parameters
/// each, on the fitted records; the gaps on other records, without effects, with all and without each; and one run on
/// each fitted record for the range of the motion.
fn closing_runs(search: &Search, problem: &Problem, held_out: &[Record]) -> usize {
    let (effects, fitted) = (search.settings.effects, problem.records.len());
    2 * effects * fitted + (3 + effects) * held_out.len().max(1) + motion_runs(problem)
}

/// Returns the number of runs for the range of the motion, which come last.
fn motion_runs(problem: &Problem) -> usize {
    if problem.setting.names.ports.is_empty() { 0 } else { problem.records.len() }
}

/// # Errors
/// [`GapError::Key`] if the case's channels or rate are not those of the simulator.
fn require_same_channels(case: &Case, description: &Description) -> Result<(), GapError> {
    let wrong = |key: &str, message: String| GapError::Key { file: "[simulator]".into(), key: key.into(), message };
    let inputs: Vec<&String> = description.inputs.iter().map(|input| &input.name).collect();
    let outputs: Vec<&String> = description.outputs.iter().map(|output| &output.name).collect();
    for (key, of_case, own) in [("inputs", &case.config.inputs, inputs), ("outputs", &case.config.outputs, outputs)] {
        if !of_case.iter().eq(own.iter().copied()) {
            return Err(wrong(
                key,
                format!("the case has {of_case:?}, the simulator {:?} has {own:?}", description.name),
            ));
        }
    }
    let (rate, own) = (case.config.rate(), description.rate_hz);
    if (rate / own - 1.0).abs() > 1e-6 {
        return Err(wrong(
            "sample_rate_hz",
            format!("the records are sampled at {rate} Hz, the simulator at {own} Hz"),
        ));
    }
    Ok(())
}

/// Returns a description with the limits that the case states.
///
/// # Errors
/// [`GapError::Key`] for a parameter that the simulator does not have.
fn limited(mut description: Description, case: &Case) -> Result<Description, GapError> {
    for (name, limit) in case.config.simulator.iter().flat_map(|simulator| &simulator.limits) {
        let Some(parameter) = description.parameters.iter_mut().find(|parameter| parameter.name == *name) else {
            let names: Vec<String> = description.parameters.iter().map(|parameter| parameter.name.clone()).collect();
            let meant = nearest(name, &names).map(|name| format!("; did you mean `{name}`?")).unwrap_or_default();
            let message = format!("the simulator has no parameter `{name}`{meant}");
            return Err(GapError::Key { file: "[simulator.limits]".into(), key: name.clone(), message });
        };
        parameter.limit = Some(*limit);
    }
    Ok(description)
}

/// # Errors
/// [`GapError::Record`] if a record does not begin at rest: the state of a foreign simulator cannot be set.
fn require_rest(case: &Case) -> Result<(), GapError> {
    let Some(record) = case.records.iter().find(|record| !record.from_rest) else { return Ok(()) };
    let message = "it begins in motion (start = \"unknown\"), but a simulator in the loop begins at rest".into();
    Err(GapError::Record { record: record.name.clone(), message })
}

/// Returns the parameters that may be wrong within a stated limit.
fn nuisances<'a>(description: &Description, parameters: &'a [SimulatorParameter]) -> Vec<Nuisance<'a>> {
    let limited = description.parameters.iter().zip(parameters).enumerate();
    limited
        .filter_map(|(k, (given, effect))| {
            let (place, std) = (Place::Parameter(k), 0.5 * given.limit?);
            Some(Nuisance { effect, place, value: given.value, std, change: Vec::new(), trace: Vec::new() })
        })
        .collect()
}

#[cfg(test)]
mod tests;
