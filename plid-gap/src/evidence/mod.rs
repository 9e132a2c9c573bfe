//! Evidence that the diagnosis does not rest on: what the records show to anybody who looks, in the engineer's own terms.

pub(crate) mod lines;
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

/// What stands beside the diagnosis.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Evidence {
    /// What an adaptive PLID run sees.
    pub tracks: Tracks,
    /// The resonances of each record by itself.
    pub resonances: Vec<Alone>,
    /// What a multisine of odd lines shows at those that it leaves out.
    pub lines: Option<Lines>,
}

impl Evidence {
    /// Of the records of a case. `refitted` is the simulation after the bounded refit; `linear` and `with` run a record without and with what was found.
    pub fn of(
        problem: &Problem,
        refitted: &Plant,
        noise: &NoiseModel,
        records: &[Record],
        linear: impl Fn(&Record) -> Channels,
        with: impl Fn(&Record) -> Channels,
    ) -> Self {
        let settings = &problem.settings.evidence;
        Self {
            tracks: Tracks::of(&problem.plant, &problem.records, &noise.rms(), settings),
            resonances: each_alone(problem, refitted, noise),
            lines: Lines::of(records, refitted.rate, linear, with, settings),
        }
    }

    /// In words, as far as they say something. `found`: whether the simulation has an effect to compare with.
    pub fn words(&self, plant: &Plant, found: bool, settings: &GapSettings) -> impl Iterator<Item = String> {
        let resonances = resonances::words(&self.resonances, plant, settings);
        let lines = self.lines.as_ref().and_then(|lines| lines.words(found, &settings.evidence));
        resonances.into_iter().chain(lines).chain(self.tracks.words(plant, settings))
    }
}
