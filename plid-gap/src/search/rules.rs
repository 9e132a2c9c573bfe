//! What the engineer knows beforehand of what may be wrong.

use crate::effects::{Effect, Library, Names, Observation};
use crate::fit::problem::Placed;
use crate::settings::SearchSettings;
use crate::settings::step::Step;

/// What the engineer knows, as effects or locations.
pub struct Rules<'r> {
    /// What is expected.
    pub suspects: &'r [String],
    /// What cannot be.
    pub exclude: &'r [String],
    /// Effects of the library that the diagnosis does not know.
    pub without: &'r [String],
}

impl Rules<'_> {
    /// Whether it knows an effect.
    pub fn knows(&self, effect: &dyn Effect) -> bool {
        !self.without.iter().any(|name| name == effect.name())
    }

    /// Whether an effect that is observed there may be named at all.
    pub fn may_show(&self, library: &Library, observed: Observation) -> bool {
        let excluded = |effect: &dyn Effect| self.exclude.iter().any(|word| word == effect.name());
        let may_be = |effect: &dyn Effect| self.knows(effect) && !excluded(effect);
        library.effects().any(|effect| effect.observed_in() == observed && may_be(effect))
    }

    /// Whether an effect may be named at a place.
    pub fn allow(&self, placed: &Placed, names: &Names) -> bool {
        self.knows(placed.effect) && !self.exclude.iter().any(|word| means(word, placed, names))
    }

    /// Whether the engineer suspects an effect or its place.
    pub(crate) fn suspects(&self, placed: &Placed, names: &Names) -> bool {
        self.suspects.iter().any(|word| means(word, placed, names))
    }
}

fn means(word: &str, placed: &Placed, names: &Names) -> bool {
    word == placed.effect.name() || word == placed.place.location(names)
}

/// What a search may name, and how it goes about it.
#[derive(Clone)]
pub struct Scope<'s, 'a> {
    /// Effects that it knows.
    pub library: &'a Library,
    /// What the engineer knows.
    pub rules: &'s Rules<'s>,
    /// Thresholds of the search.
    pub settings: SearchSettings,
    /// Names of channels, ports and modes.
    pub names: Names,
    /// Steps that are left out.
    pub off: Vec<Step>,
    /// Whether effects on single modes are screened at several sizes.
    pub bold: bool,
}

impl Scope<'_, '_> {
    /// Whether a free run may show this effect at this place.
    pub fn allows(&self, placed: &Placed) -> bool {
        !placed.effect.is_stochastic() && self.rules.allow(placed, &self.names)
    }

    /// What a suspicion is worth, in twice the log likelihood.
    pub fn bonus(&self, placed: &Placed) -> f64 {
        if self.rules.suspects(placed, &self.names) { self.settings.suspect_bonus } else { 0.0 }
    }

    /// Whether a step is left out.
    pub fn skips(&self, step: Step) -> bool {
        self.off.contains(&step)
    }
}
