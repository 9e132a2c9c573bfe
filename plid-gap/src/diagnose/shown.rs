//! The data of the report.

use nalgebra::DMatrix;

use crate::answer::simulation::refit_summary;
use crate::case::levels::{LevelRun, is_linear, loudest, one_of_each_level};
use crate::case::record::{Channels, Record};
use crate::diagnose::finding::Finding;
use crate::effects::Names;
use crate::evidence::Evidence;
use crate::fit::free_run::run;
use crate::judge::explained::Explained;
use crate::judge::locate::Map;
use crate::judge::verdict::Adequacy;
use crate::noise::NoiseModel;
use crate::search::screen::Entry;
use crate::simulate::{Fineness, simulate};
use plid_fourier::C;

/// The data of the report.
pub struct Shown {
    /// Names of the outputs.
    pub outputs: Vec<String>,
    /// Unit of each output, if it is known.
    pub units: Vec<Option<String>>,
    /// Sample rate in Hz.
    pub rate: f64,
    /// The map of the gap as given.
    pub before: Map,
    /// The map of the gap with the effects.
    pub after: Map,
    /// The adequacy of the best explanation.
    pub adequacy: Adequacy,
    /// The best entries of each stage's screen: name, location, gain, share that a refit absorbs.
    pub stages: Vec<Vec<(String, String, f64, f64)>>,
    /// Name of the record of `trace`.
    pub trace_record: String,
    /// Outputs of that record: measured, as given, and with the effects (p channels each).
    pub trace: [Channels; 3],
    /// Stochastic effects: name, location, gain in twice the log likelihood.
    pub stochastic: Vec<(String, String, f64)>,
    /// For each mode, its frequency in Hz and the changes by the bounded refit in standard deviations of the prior:
    /// the change of the frequency, the change of the damping ratio, and the largest change of the shapes.
    pub refit: Vec<(f64, f64, f64, f64)>,
    /// Mean squared whitened residual: as given, after the refit, with the effects.
    pub costs: [f64; 3],
    /// The records that were fitted, in order: name, start in s, number of samples.
    pub fitted: Vec<(String, f64, usize)>,
    /// One record of each level with its simulations.
    pub levels: Vec<LevelRun>,
    /// For each output, frequencies in Hz with the density of the noise, in the output's unit squared per Hz.
    pub noise: Vec<Vec<(f64, f64)>>,
    /// The evidence that does not enter the verdict.
    pub evidence: Evidence,
    /// Whether the simulation with the effects is linear in its inputs.
    pub linear: bool,
}

/// Number of equal intervals between zero and half the sample rate, at whose inner ends the noise is shown.
const NOISE_LINES: usize = 200;

/// Number of entries of each stage's screen that are shown.
const ENTRIES: usize = 15;

impl Finding<'_, '_> {
    /// Returns the data of the report.
    pub(super) fn shown(self) -> Shown {
        let levels = self.levels();
        let (plant, actions) = (&self.judged.plant, &self.judged.actions);
        let Explained { ready, refitted, found, judged, given_cost, .. } = self.explained;
        let problem = &ready.problem;
        let names = &problem.setting.names;
        let rows = problem.values();
        let trace = ready.held_out.last().or(problem.records.last()).expect("a case has records");
        let loudest = loudest(&problem.records, problem.settings.case.same_level);
        let [before, after] = self.maps;
        Shown {
            outputs: names.outputs.clone(),
            units: problem.setting.units.outputs.clone(),
            rate: plant.rate,
            before,
            after,
            adequacy: *judged,
            stages: found.stages.iter().map(|entries| shown(entries, names)).collect(),
            trace: [trace.y.clone(), run(ready.as_given(), &[], trace), run(plant, actions, trace)],
            trace_record: trace.name.clone(),
            evidence: self.evidence,
            stochastic: self
                .stochastic
                .iter()
                .map(|u| (u.placed.effect.name().into(), u.placed.place.location(names), u.gain))
                .collect(),
            refit: refit_summary(problem, &self.explained.fit().eta),
            costs: [given_cost / rows, refitted.cost / rows, self.explained.fit().cost / rows],
            fitted: problem.records.iter().map(|r| (r.name.clone(), r.start_s, r.samples())).collect(),
            levels,
            noise: densities(&ready.noise, plant.p, plant.rate),
            linear: is_linear(&loudest.u, |u| simulate(plant, actions, u, 0.0, None, Fineness::FINE)),
        }
    }

    /// Simulates one record of each level.
    fn levels(&self) -> Vec<LevelRun> {
        let given = self.explained.ready.as_given();
        let one = |record: &Record| LevelRun {
            record: record.name.clone(),
            level: record.level(),
            u: record.u.clone(),
            y: record.y.clone(),
            given: run(given, &[], record),
            with: run(&self.judged.plant, &self.judged.actions, record),
        };
        let same_level = self.audit.case.config.settings.case.same_level;
        one_of_each_level(&self.audit.case.records, same_level).into_iter().map(one).collect()
    }
}

/// Returns the first entries of a screen.
fn shown(entries: &[Entry], names: &Names) -> Vec<(String, String, f64, f64)> {
    let line = |e: &Entry| (e.placed.effect.name().to_string(), e.placed.place.location(names), e.gain, e.absorbed);
    entries.iter().take(ENTRIES).map(line).collect()
}

/// Returns, for each of p outputs, frequencies in Hz with the one-sided density of its noise. The density of the noise
/// model equals the variance for white noise.
fn densities(noise: &NoiseModel, p: usize, rate: f64) -> Vec<Vec<(f64, f64)>> {
    let hz = (1..NOISE_LINES).map(|k| 0.5 * rate * k as f64 / NOISE_LINES as f64);
    let lines: Vec<(f64, DMatrix<C>)> = hz.map(|hz| (hz, noise.density(hz))).collect();
    (0..p).map(|o| lines.iter().map(|(hz, s)| (*hz, 2.0 * s[(o, o)].re / rate)).collect()).collect()
}
