//! The construction of the answer from a judged search.

use crate::answer::range::FittedRange;
use crate::answer::schema::{Located, Remainder, RemainderPlace, Used};
use crate::answer::simulation::written_effect;
use crate::answer::{MOST_NEAREST, place, whereabouts};
use crate::case::SimulatorConfig;
use crate::case::record::{Channels, Record};
use crate::effects::{Names, Place};
use crate::error::GapError;
use crate::evidence::repetition::repeats;
use crate::fit::candidate::{all_same, in_words, same};
use crate::fit::problem::Placed;
use crate::in_loop::answer::{self, LoopDiagnosis, SimulatorWithEffects, WrittenPort};
use crate::in_loop::judge::{self, Judged};
use crate::in_loop::measure::{Measured, Opened, blocks};
use crate::in_loop::predict::FORMAT;
use crate::in_loop::runs::Runs;
use crate::in_loop::screen::Entry;
use crate::in_loop::search::{Found, Search};
use crate::in_loop::{LoopOutcome, Shown};
use crate::judge::gap;
use crate::judge::locate::{self, Map};
use crate::judge::side::PlaceShare;
use crate::judge::verdict::{Verdict, Weighted};
use crate::noise::NoiseModel;

/// Largest number of entries of a screen that are shown.
const SHOWN_ENTRIES: usize = 8;

/// The results of a diagnosis, from which the answer is written.
pub(super) struct Told<'t, 's, 'a> {
    /// The runs.
    pub runs: &'t Runs<'s>,
    /// The search and its bounds.
    pub search: &'t Search<'t, 'a>,
    /// The result of the search.
    pub found: &'t Found<'a>,
    /// The judgement of the result.
    pub judged: &'t Judged<'a>,
    /// The share of the residual that each place explains.
    pub places: &'t [PlaceShare],
    /// Warnings about the records.
    pub warnings: Vec<String>,
}

impl<'a> Opened<'_, 'a> {
    /// Builds the answer.
    pub fn outcome(
        &self,
        told: &Told<'_, '_, 'a>,
        measured: &Measured<'a>,
        simulation: SimulatorWithEffects,
    ) -> LoopOutcome {
        let Told { runs, found, judged, .. } = told;
        let Self { case, problem, held_out, .. } = self;
        let (best, names) = (&found.fits[0], &problem.setting.names);
        let fitted = judged.verdict == Verdict::Effects;
        let named = || answer::named(problem, best, &judged.weighted, &measured.shares);
        let effects = if fitted { named() } else { Vec::new() };
        let sentence = answer::sentence(problem, judged, best, &effects, &measured.gap, !held_out.is_empty());
        let gap_after = |w: &Weighted| {
            let fit = found.fits.iter().find(|fit| !w.unknown && all_same(&fit.effects, &w.effects))?;
            Some(gap::of_driven(&problem.records, &fit.simulated))
        };
        let refit = problem.nuisances.iter().zip(&best.eta).map(|(nuisance, eta)| {
            let name = nuisance.place.location(names);
            (name, [nuisance.value, nuisance.value + eta * nuisance.std, *eta])
        });
        let settings = &case.config.settings;
        let (calls, cut) = (runs.calls(), runs.cut());
        let mut warnings = told.warnings.clone();
        warnings.extend(cut.map(|cut| answer::cut_short(cut, &settings.in_loop)));
        let diagnosis = LoopDiagnosis {
            verdict: judged.verdict,
            sentence,
            effects,
            candidates: answer::candidates(problem, &judged.weighted, gap_after),
            not_separable: if fitted { answer::class(problem, best, judged) } else { Vec::new() },
            place: place(
                &self.map(measured, &measured.given),
                &names.outputs,
                told.places,
                &[],
                (&settings.judge, &settings.answer),
            ),
            gap: measured.gap.clone(),
            remainder: self.remainder(told, measured),
            simulator: Used {
                name: simulation.simulator.name.clone(),
                runs: calls.runs,
                seconds: calls.time.as_secs_f64(),
                cut_short: cut.is_some(),
                ended_by: cut.map(|cut| cut.by),
                left_out: cut.map(|cut| cut.what.clone()).unwrap_or_default(),
            },
            refit: refit.collect(),
            settings: settings.clone(),
            evidence: measured.evidence.clone(),
            warnings,
        };
        LoopOutcome { diagnosis, simulation, shown: self.shown(told, measured) }
    }

    /// Returns the map of the errors of runs.
    fn map(&self, measured: &Measured, y: &[Channels]) -> Map {
        let Self { case, problem, noise, .. } = self;
        let plant = &problem.setting.plant;
        let errors: Vec<Channels> = measured.records.iter().zip(y).map(|(record, y)| record.error(y)).collect();
        let white = NoiseModel::declared(plant, &noise.std, &vec![0.0; plant.m]);
        locate::map(&measured.records, &errors, &white, plant.rate, &case.config.settings)
    }

    /// Returns the remainder on the records on which the gap was measured.
    fn remainder(&self, told: &Told, measured: &Measured) -> Remainder {
        let (found, names) = (told.found, &self.problem.setting.names);
        let (gap, material) = (&measured.gap, self.case.config.material);
        let beyond = |x: f64| (x * x - gap.noise_floor * gap.noise_floor).max(0.0);
        let map = self.map(measured, &measured.with);
        let after = whereabouts(None, &map, &names.outputs, &self.case.config.settings.answer);
        let entries = found.screens.get(found.fits[0].effects.len()).map_or(&[][..], Vec::as_slice);
        let share = beyond(gap.with_effect) / beyond(gap.as_given).max(f64::MIN_POSITIVE);
        let further = blocks(&measured.records, &measured.with)
            .map_or(0.0, |with| gap::how_often([&with], |[with]| beyond(with) > material * material));
        Remainder {
            gap: gap.with_effect,
            noise: gap.noise_floor,
            noise_unseen: !self.noise.seen,
            share_of_gap: share.min(1.0),
            further_cause: further,
            material,
            repeats: repeats(&measured.records, |k| measured.with[k].clone()),
            place: RemainderPlace { channels: after.channels, bands_hz: after.bands_hz },
            nearest: distinct(entries).take(MOST_NEAREST).map(|placed| located(placed, names)).collect(),
        }
    }

    /// Returns the content of the report.
    fn shown(&self, told: &Told<'_, '_, 'a>, measured: &Measured) -> Shown {
        let Self { problem, .. } = self;
        let (found, names) = (told.found, &problem.setting.names);
        let fits = found.fits.iter().map(|fit| (in_words(&fit.effects, names), told.search.left(problem, fit)));
        // The one-sided spectrum of white noise.
        let rate = problem.setting.plant.rate;
        let white = |std: &f64| {
            let density = 2.0 * std * std / rate;
            vec![(0.0, density), (0.5 * rate, density)]
        };
        Shown {
            noise: self.noise.std.iter().map(white).collect(),
            record: measured.records[0].name.clone(),
            rate,
            outputs: names.outputs.clone(),
            units: problem.setting.units.outputs.clone(),
            trace: [measured.records[0].y.clone(), measured.given[0].clone(), measured.with[0].clone()],
            screens: found.screens.iter().map(|entries| shown_entries(entries, names, found)).collect(),
            fits: fits.collect(),
        }
    }

    /// Returns the data that a prediction uses. If the simulator has ports, it is run once more on each fitted
    /// record, to obtain the range of their motion.
    pub fn simulation(
        &self,
        runs: &mut Runs,
        measured: &Measured<'a>,
        ports: Vec<WrittenPort>,
    ) -> Result<SimulatorWithEffects, GapError> {
        // This description does not contain the limits of the case, which are not part of the simulator that a
        // prediction runs.
        let description = runs.description().clone();
        let Self { case, problem, noise, .. } = self;
        let (fit, gap) = (&measured.written, &measured.gap);
        let all = problem.with_nuisances(&fit.effects, &fit.eta);
        let mut values = description.values();
        for placed in &all {
            if let Place::Parameter(k) = placed.place {
                values[k] = description.parameters[k].bounded(placed.parameters[0]);
            }
        }
        let mut peaks = vec![Vec::new(); problem.records.len()];
        if !ports.is_empty() {
            for (peaks, record) in peaks.iter_mut().zip(&problem.records) {
                *peaks = runs.simulate_with_motion(&problem.setting, &all, record)?.1;
            }
        }
        let around = all.iter().filter(|placed| !judge::is_parameter(&placed.place));
        let end = |record: &Record| record.start_s + record.samples() as f64 / problem.setting.plant.rate;
        let command = case.config.simulator.as_ref().map(|simulator| simulator.command.clone());
        Ok(SimulatorWithEffects {
            format: FORMAT.into(),
            parameters: description.parameters.iter().map(|p| p.name.clone()).zip(values).collect(),
            simulator: description,
            command: command.unwrap_or_default(),
            fmu: case.config.simulator.as_ref().and_then(SimulatorConfig::source),
            ports,
            effects: around.map(|placed| written_effect(placed, &problem.setting, &problem.setting)).collect(),
            t0: case.records.iter().map(end).fold(0.0, f64::max),
            noise_rms: noise.std.clone(),
            expected_gap: gap.predicted_held_out_gap,
            fitted: Some(FittedRange::of(&problem.records, &peaks, gap.predicted_held_out_gap, gap.noise_floor)),
        })
    }
}

/// Returns the entries of a screen, each effect at each place once.
fn distinct<'e, 'a>(entries: &'e [Entry<'a>]) -> impl Iterator<Item = &'e Placed<'a>> {
    let first = |at: usize| !entries[..at].iter().any(|other| same(&other.placed, &entries[at].placed));
    (0..entries.len()).filter(move |&at| first(at)).map(|at| &entries[at].placed)
}

fn located(placed: &Placed, names: &Names) -> Located {
    Located { effect: placed.effect.name().into(), location: placed.place.location(names) }
}

fn shown_entries(entries: &[Entry], names: &Names, found: &Found) -> Vec<(String, String, f64)> {
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
