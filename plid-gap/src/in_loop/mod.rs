//! The diagnosis with anybody's simulator in the loop.
//!
//! A linear simulation is taken apart into modes, and its fits use exact derivatives in thousands of runs. A foreign
//! simulator can only be run, and a run may take a second. So this diagnosis counts runs. Effects on commands and on
//! measurements wrap around [`plid_simulator::Simulator::run`]; effects at ports act between its steps; the simulator's
//! own parameters are causes like any other. Each effect is screened by one run for each start, the best ones are
//! fitted on the simulator itself, and the fits are compared by what they leave, whitened by what the best one leaves
//! (docs/gap-simulator.md).

mod answer;
mod coupling;
mod judge;
mod noise;
mod parameter;
mod predict;
mod problem;
mod report;
mod runs;
mod screen;
mod search;
mod survey;

pub use answer::{LoopDiagnosis, LoopGap, SimulatorWithEffects, Used, WrittenPort};
pub use predict::LoopPredictor;
pub use report::write;

use plid_data::nearest;
use plid_simulator::{Checked, Description, Simulator};

use crate::answer::schema::{Located, Remainder, RemainderPlace};
use crate::answer::simulation::written_effect;
use crate::answer::whereabouts;
use crate::audit;
use crate::case::Case;
use crate::case::levels::loudest;
use crate::case::record::{Channels, Record};
use crate::case::split::split;
use crate::effects::{Effect, Library, Place, Side};
use crate::error::GapError;
use crate::fit::candidate::{all_same, same};
use crate::fit::problem::Placed;
use crate::in_loop::judge::{Judged, judge};
use crate::in_loop::noise::Noise;
use crate::in_loop::parameter::SimulatorParameter;
use crate::in_loop::problem::{Fit, Nuisance, Problem};
use crate::in_loop::runs::Runs;
use crate::in_loop::search::{Found, Search};
use crate::in_loop::survey::{Survey, survey};
use crate::judge::gap::{self, Blocks};
use crate::judge::locate;
use crate::judge::verdict::Verdict;
use crate::search::rules::{Rules, Scope, require_names};

/// The result of a diagnosis with a simulator in the loop.
pub struct LoopOutcome {
    /// The answer.
    pub diagnosis: LoopDiagnosis,
    /// All that a prediction uses besides the simulator.
    pub simulation: SimulatorWithEffects,
    /// The record that the report shows: its name, sample rate and outputs measured, as given and with the effects.
    pub shown: Shown,
}

/// The record that a report shows.
pub struct Shown {
    /// Its name.
    pub record: String,
    /// Sample rate in Hz.
    pub rate: f64,
    /// Names of the outputs (p).
    pub outputs: Vec<String>,
    /// Measured, as given, and with the effects (p channels each).
    pub trace: [Channels; 3],
    /// The best entries of each screen: effect, location, promised share of the gap's square.
    pub screens: Vec<Vec<(String, String, f64)>>,
    /// All fitted explanations with the share of the output that they leave beyond the noise.
    pub fits: Vec<(String, f64)>,
}

/// Number of entries of a screen that are shown.
const SHOWN_ENTRIES: usize = 8;

/// Diagnoses the gap between records and a simulator.
///
/// # Errors
/// [`GapError::Simulator`] if the simulator fails as it is given, or does not fit the case; the errors of an audit of
/// the records.
pub fn diagnose(
    case: &Case,
    simulator: &mut dyn Simulator,
    library: &Library,
    say: &mut dyn FnMut(String),
) -> Result<LoopOutcome, GapError> {
    let mut simulator = Checked::new(simulator)?;
    let description = limited(simulator.description().clone(), case)?;
    require_same_channels(case, &description)?;
    let mut warnings = case.warnings.clone();
    warnings.extend(audit::of_records(case, true)?);
    require_rest(case)?;
    let settings = &case.config.settings;
    let (records, held_out) = split(&case.records, &settings.case);
    let loud = loudest(&records, settings.case.same_level).clone();
    say("running the simulator as given".into());
    let Survey { setting, responses } = survey(&mut simulator, &case.config, &records, &loud)?;
    let written_ports = WrittenPort::all(&description, &responses);
    let mut runs = Runs::new(simulator, responses);
    let run = |runs: &mut Runs, record: &Record| runs.simulate(&setting, &[], record);
    let given: Vec<Channels> = records.iter().map(|record| run(&mut runs, record)).collect::<Result<_, _>>()?;
    let noise = noise::estimate(&records, &given);
    if !noise.seen {
        warnings.push(
            "no record without input and no repeated input shows the noise: it is estimated from the highest \
            frequencies of the gap"
                .into(),
        );
    }
    let parameters = SimulatorParameter::all(&description.parameters);
    let mut problem = Problem::new(records, &given, setting.clone(), &noise.std, case.config.band_hz);
    problem.nuisances = nuisances(&description, &parameters);
    problem.measure_nuisances(&mut runs, &given)?;
    let rules = Rules { suspects: &case.config.suspects, exclude: &case.config.exclude, without: &[] };
    let effects: Vec<&dyn Effect> =
        library.effects().chain(parameters.iter().map(|parameter| parameter as &dyn Effect)).collect();
    require_names(&case.config, effects.iter().copied(), &setting)?;
    let scope = Scope {
        library,
        rules: &rules,
        settings: settings.search.clone(),
        names: setting.names.clone(),
        off: Vec::new(),
        bold: false,
    };
    let search = Search {
        effects,
        scope,
        settings: settings.in_loop.clone(),
        noise: noise.std.clone(),
        material: case.config.material,
    };
    let found = search.run(&mut problem, &mut runs, &given, say)?;
    let judged = judge(&search, &problem, &found, case.config.material, &settings.judge);
    let opened = Opened { case, problem: &problem, noise: &noise, held_out: &held_out };
    let measured = opened.measure(&mut runs, &found, &judged)?;
    let described = (description, written_ports);
    Ok(opened.outcome(&runs, &search, (&found, &judged, measured), described, warnings))
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
        return Err(wrong("sample_rate_hz", format!("the records have {rate} Hz, the simulator {own} Hz")));
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
/// [`GapError::Record`] if a record does not begin at rest: nobody can set the state of a foreign simulator.
fn require_rest(case: &Case) -> Result<(), GapError> {
    let Some(record) = case.records.iter().find(|record| !record.from_rest) else { return Ok(()) };
    let message = "it begins in motion (start = \"unknown\"), but a simulator in the loop begins at rest".into();
    Err(GapError::Record { record: record.name.clone(), message })
}

/// Returns the parameters that may be off within a limit.
fn nuisances<'a>(description: &Description, parameters: &'a [SimulatorParameter]) -> Vec<Nuisance<'a>> {
    let limited = description.parameters.iter().zip(parameters).enumerate();
    limited
        .filter_map(|(k, (given, effect))| {
            let (place, std) = (Place::Parameter(k), 0.5 * given.limit?);
            Some(Nuisance { effect, place, value: given.value, std, change: Vec::new(), trace: Vec::new() })
        })
        .collect()
}

/// What is measured after the search.
struct Opened<'o, 'a> {
    case: &'o Case,
    problem: &'o Problem<'a>,
    noise: &'o Noise,
    held_out: &'o [Record],
}

/// Runs on the records on which the gap is measured.
struct Measured {
    records: Vec<Record>,
    given: Vec<Channels>,
    with: Vec<Channels>,
    gap: LoopGap,
    shares: Vec<Option<f64>>,
    with_blocks: Option<Blocks>,
}

impl<'a> Opened<'_, 'a> {
    /// Measures the gaps on held-out records, or on the loudest fitted one if nothing is held out.
    fn measure(&self, runs: &mut Runs, found: &Found<'a>, judged: &Judged) -> Result<Measured, GapError> {
        let Self { case, problem, noise, held_out } = self;
        let best = &found.fits[0];
        let same_level = case.config.settings.case.same_level;
        let loud = loudest(&problem.records, same_level);
        // The prediction from the fitted records is stated first.
        let stated = gap::expected(&problem.records, &best.simulated, loud.level());
        let driven = |record: &&Record| record.level() > 0.0;
        let mut records: Vec<Record> = held_out.iter().filter(driven).cloned().collect();
        if records.is_empty() {
            records = vec![loud.clone()];
        }
        let mut run = |effects: &[Placed<'a>], eta: &[f64]| -> Result<Vec<Channels>, GapError> {
            let all = problem.with_nuisances(effects, eta);
            let one = |record: &Record| Ok(runs.simulate(&problem.setting, &all, record)?);
            records.iter().map(one).collect()
        };
        let none = vec![0.0; problem.nuisances.len()];
        let given = run(&[], &none)?;
        let refit = run(&[], &found.refit.eta)?;
        let named = judged.verdict != Verdict::None;
        let with = if named { run(&best.effects, &best.eta)? } else { refit.clone() };
        let mut without = Vec::new();
        if judged.verdict == Verdict::Effects {
            for k in 0..best.effects.len() {
                let mut others = best.effects.clone();
                others.remove(k);
                without.push(run(&others, &best.eta)?);
            }
        }
        let blocks = |y: &[Channels]| {
            Blocks::joined(records.iter().zip(y).map(|(record, y)| Blocks::new(&record.y, y, 0)).collect())
        };
        let of = |y: &[Channels]| blocks(y).map_or(0.0, |blocks| blocks.gap());
        let measured: Vec<&[Vec<f64>]> = records.iter().map(|record| record.y.as_slice()).collect();
        let floor = gap::floor_over(&noise.std, &measured);
        let (as_given, refitted, with_effect) = (of(&given), of(&refit), of(&with));
        let shrink_ci95 = match (blocks(&given), blocks(&with)) {
            (Some(given), Some(with)) => gap::drawn([&given, &with], |[given, with]| gap::shrink(given, with, floor)),
            _ => [0.0; 2],
        };
        let beyond = |gap: f64| (gap * gap - floor * floor).max(0.0);
        let whole = beyond(refitted).max(f64::MIN_POSITIVE);
        let share = |y: &Vec<Channels>| Some(((beyond(of(y)) - beyond(with_effect)) / whole).clamp(0.0, 1.0));
        let gap = LoopGap {
            as_given,
            refit: refitted,
            with_effect,
            noise_floor: floor,
            shrink: gap::shrink(as_given, with_effect, floor),
            shrink_ci95,
            shrink_over_refit: gap::shrink(refitted, with_effect, floor),
            predicted_held_out_gap: stated,
            predicted_ci80: [(1.0 - SCATTER) * stated, (1.0 + SCATTER) * stated],
            measured_on: records.iter().map(|record| record.name.clone()).collect(),
        };
        let with_blocks = blocks(&with);
        Ok(Measured { shares: without.iter().map(share).collect(), records, given, with, gap, with_blocks })
    }

    /// Writes the answer.
    fn outcome(
        &self,
        runs: &Runs,
        search: &Search<'_, 'a>,
        (found, judged, measured): (&Found<'a>, &Judged<'a>, Measured),
        (description, ports): (Description, Vec<WrittenPort>),
        warnings: Vec<String>,
    ) -> LoopOutcome {
        let Self { case, problem, noise, held_out } = self;
        let (best, names) = (&found.fits[0], &problem.setting.names);
        let fitted = judged.verdict == Verdict::Effects;
        let effects =
            if fitted { answer::named(problem, best, &judged.weighted, &measured.shares) } else { Vec::new() };
        let sentence = answer::sentence(problem, judged, best, &effects, &measured.gap, !held_out.is_empty());
        let of = |fit: &Fit| gap::of_driven(&problem.records, &fit.simulated);
        let gap_after = |w: &crate::judge::verdict::Weighted| {
            found.fits.iter().find(|fit| !w.unknown && all_same(&fit.effects, &w.effects)).map(of)
        };
        let calls = runs.calls();
        let side = best.effects.first().map_or(Side::Structure, |placed| placed.effect.side());
        let map = |y: &[Channels]| {
            let errors: Vec<Channels> = measured.records.iter().zip(y).map(|(r, y)| r.error(y)).collect();
            let same_level = case.config.settings.case.same_level;
            let std = problem.setting.plant.m;
            let white = crate::noise::NoiseModel::declared(&problem.setting.plant, &noise.std, &vec![0.0; std]);
            locate::map(&measured.records, &errors, &white, problem.setting.plant.rate, same_level)
        };
        let listed = &case.config.settings.answer;
        let place = whereabouts(side, &map(&measured.given), &names.outputs, listed);
        let after = whereabouts(side, &map(&measured.with), &names.outputs, listed);
        let floor = measured.gap.noise_floor;
        let beyond = |gap: f64| (gap * gap - floor * floor).max(0.0);
        let material = case.config.material;
        let nearest = found.screens.get(best.effects.len()).map_or(&[][..], Vec::as_slice);
        let remainder = Remainder {
            gap: measured.gap.with_effect,
            noise: floor,
            share_of_gap: (beyond(measured.gap.with_effect) / beyond(measured.gap.as_given).max(f64::MIN_POSITIVE))
                .min(1.0),
            further_cause: measured
                .with_blocks
                .as_ref()
                .map_or(0.0, |with| gap::how_often([with], |[with]| beyond(with) > material * material)),
            place: RemainderPlace { channels: after.channels, bands_hz: after.bands_hz },
            nearest: distinct(nearest).take(MOST_NEAREST).map(|placed| located(placed, names)).collect(),
        };
        let refit = problem.nuisances.iter().zip(&found.fits[0].eta).map(|(nuisance, eta)| {
            let name = nuisance.place.location(names);
            (name, [nuisance.value, nuisance.value + eta * nuisance.std, *eta])
        });
        let kept = if judged.verdict == Verdict::Effects { best } else { &found.refit };
        let simulation = self.simulation(kept, description, ports, measured.gap.predicted_held_out_gap);
        let shown = Shown {
            record: measured.records[0].name.clone(),
            rate: problem.setting.plant.rate,
            outputs: names.outputs.clone(),
            trace: [measured.records[0].y.clone(), measured.given[0].clone(), measured.with[0].clone()],
            screens: found.screens.iter().map(|entries| shown_entries(entries, names, found)).collect(),
            fits: found
                .fits
                .iter()
                .map(|fit| (crate::fit::candidate::in_words(&fit.effects, names), search.left(problem, fit)))
                .collect(),
        };
        let diagnosis = LoopDiagnosis {
            verdict: judged.verdict,
            sentence,
            effects,
            candidates: answer::candidates(problem, &judged.weighted, gap_after),
            not_separable: if fitted { answer::class(problem, best, judged) } else { Vec::new() },
            place,
            gap: measured.gap,
            remainder,
            simulator: Used {
                name: simulation.simulator.name.clone(),
                runs: calls.runs,
                seconds: calls.time.as_secs_f64(),
                cut_short: found.cut_short,
            },
            refit: refit.collect(),
            settings: case.config.settings.clone(),
            warnings,
        };
        LoopOutcome { diagnosis, simulation, shown }
    }

    /// Returns what a prediction uses.
    fn simulation(
        &self,
        fit: &Fit<'a>,
        description: Description,
        ports: Vec<WrittenPort>,
        expected_gap: f64,
    ) -> SimulatorWithEffects {
        let Self { case, problem, noise, .. } = self;
        let all = problem.with_nuisances(&fit.effects, &fit.eta);
        let mut values = description.values();
        for placed in &all {
            if let Place::Parameter(k) = placed.place {
                values[k] = description.parameters[k].bounded(placed.parameters[0]);
            }
        }
        let around = all.iter().filter(|placed| !judge::is_parameter(&placed.place));
        let rate = problem.setting.plant.rate;
        let end = |record: &Record| record.start_s + record.samples() as f64 / rate;
        SimulatorWithEffects {
            format: predict::FORMAT.into(),
            parameters: description.parameters.iter().map(|p| p.name.clone()).zip(values).collect(),
            simulator: description,
            command: case.config.simulator.as_ref().map(|simulator| simulator.command.clone()).unwrap_or_default(),
            ports,
            effects: around.map(|placed| written_effect(placed, &problem.setting, &problem.setting)).collect(),
            t0: case.records.iter().map(end).fold(0.0, f64::max),
            noise_rms: noise.std.clone(),
            expected_gap,
        }
    }
}

/// How far a gap on a new record of the same level lies from that of the fitted ones, for four records in five: the
/// records of a lightly damped structure scatter by about a tenth.
const SCATTER: f64 = 0.13;

/// Largest number of entries of a screen that are named as nearest to a remainder.
const MOST_NEAREST: usize = 3;

/// Returns the entries of a screen, each effect at each place once.
fn distinct<'e, 'a>(entries: &'e [screen::Entry<'a>]) -> impl Iterator<Item = &'e Placed<'a>> {
    let first = |at: usize| !entries[..at].iter().any(|other| same(&other.placed, &entries[at].placed));
    (0..entries.len()).filter(move |&at| first(at)).map(|at| &entries[at].placed)
}

fn located(placed: &Placed, names: &crate::effects::Names) -> Located {
    Located { effect: placed.effect.name().into(), location: placed.place.location(names) }
}

fn shown_entries(
    entries: &[screen::Entry],
    names: &crate::effects::Names,
    found: &Found,
) -> Vec<(String, String, f64)> {
    let whole = found.refit.cost.max(f64::MIN_POSITIVE);
    let gain = |placed: &Placed| {
        entries.iter().filter(|entry| same(&entry.placed, placed)).map(|entry| entry.gain).fold(0.0, f64::max)
    };
    let one = |placed: &Placed| {
        let Located { effect, location } = located(placed, names);
        (effect, location, gain(placed) / whole)
    };
    distinct(entries).take(SHOWN_ENTRIES).map(one).collect()
}

#[cfg(test)]
mod tests;
