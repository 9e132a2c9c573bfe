//! Evidence that does not enter the verdict, in the engineer's own terms.

pub(crate) mod lines;
pub(crate) mod repetition;
pub(crate) mod resonances;
pub(crate) mod tracks;
pub(crate) mod trend;

use crate::case::record::{Channels, Record};
use crate::evidence::lines::Lines;
use crate::evidence::resonances::{Alone, each_alone};
use crate::evidence::tracks::Tracks;
use crate::fit::problem::Problem;
use crate::noise::NoiseModel;
use crate::plant::Plant;
use crate::settings::GapSettings;

/// Observations that do not enter the verdict.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Evidence {
    /// The modes that an adaptive PLID run follows.
    pub tracks: Tracks,
    /// The resonances of each record alone.
    pub resonances: Vec<Alone>,
    /// The response to a multisine of odd lines at the lines that it leaves out.
    pub lines: Option<Lines>,
    /// Share of the power of the remainder that repeats in every period of the periodic records.
    pub repeats: Option<f64>,
}

impl Evidence {
    /// Collects the evidence of a case's records. `refitted` is the simulation after the bounded refit; `linear` and
    /// `with` simulate a record without and with the effects that were found.
    pub fn of(
        problem: &Problem,
        refitted: &Plant,
        noise: &NoiseModel,
        records: &[Record],
        linear: impl Fn(&Record) -> Channels,
        with: impl Fn(&Record) -> Channels,
    ) -> Self {
        let settings = &problem.settings.evidence;
        // In closed loop, the records show the modes of the loop.
        let tracks = match &problem.plant.controller {
            Some(_) => Tracks::default(),
            None => Tracks::of(&problem.plant, &problem.records, &noise.rms(), settings),
        };
        Self {
            repeats: repetition::repeats(records, |k| with(&records[k])),
            tracks,
            resonances: each_alone(problem, refitted, noise),
            lines: Lines::of(records, refitted.rate, linear, with, &problem.settings),
        }
    }

    /// Returns sentences about significant findings. `found` says whether the simulation has effects to compare with.
    pub fn words(&self, plant: &Plant, found: bool, settings: &GapSettings) -> impl Iterator<Item = String> {
        let resonances = resonances::words(&self.resonances, plant, settings);
        let lines = self.lines.as_ref().and_then(|lines| lines.words(found, &settings.evidence));
        let repeats = self.repeats.map(repetition::words);
        resonances.into_iter().chain(lines).chain(repeats).chain(self.tracks.words(plant, settings))
    }
}
