//! The engineer's prior knowledge of the effects.

use crate::effects::{Effect, Library, Names, Observation};
use crate::fit::problem::Placed;
use crate::settings::SearchSettings;
use crate::settings::step::Step;

/// The engineer's prior knowledge, as effects or locations.
pub struct Rules<'r> {
    /// Expected effects or locations.
    pub suspects: &'r [String],
    /// Effects or locations that are ruled out.
    pub exclude: &'r [String],
    /// Effects of the library that the diagnosis does not use.
    pub without: &'r [String],
}

impl Rules<'_> {
    /// Returns whether the diagnosis uses an effect.
    pub fn knows(&self, effect: &dyn Effect) -> bool {
        !self.without.iter().any(|name| name == effect.name())
    }

    /// Returns whether an effect that is observed there may be named at all.
    pub fn may_show(&self, library: &Library, observed: Observation) -> bool {
        let excluded = |effect: &dyn Effect| self.exclude.iter().any(|word| word == effect.name());
        let may_be = |effect: &dyn Effect| self.knows(effect) && !excluded(effect);
        library.effects().any(|effect| effect.observed_in() == observed && may_be(effect))
    }

    /// Returns whether an effect may be named at a location.
    pub fn allow(&self, placed: &Placed, names: &Names) -> bool {
        self.knows(placed.effect) && !self.exclude.iter().any(|word| means(word, placed, names))
    }

    /// Returns whether the engineer suspects an effect or its location.
    pub(crate) fn suspects(&self, placed: &Placed, names: &Names) -> bool {
        self.suspects.iter().any(|word| means(word, placed, names))
    }
}

fn means(word: &str, placed: &Placed, names: &Names) -> bool {
    word == placed.effect.name() || word == placed.place.location(names)
}

/// The effects that a search may name, and its options.
#[derive(Clone)]
pub struct Scope<'s, 'a> {
    /// The effects that it knows.
    pub library: &'a Library,
    /// The engineer's prior knowledge.
    pub rules: &'s Rules<'s>,
    /// Thresholds of the search.
    pub settings: SearchSettings,
    /// Names of channels, ports and modes.
    pub names: Names,
    /// Steps that are switched off.
    pub off: Vec<Step>,
    /// Whether effects on single modes are screened at several sizes.
    pub bold: bool,
}

impl Scope<'_, '_> {
    /// Returns whether a free run may show this effect at this location.
    pub fn allows(&self, placed: &Placed) -> bool {
        !placed.effect.is_stochastic() && self.rules.allow(placed, &self.names)
    }

    /// Returns the bonus of a suspicion, in twice the log likelihood.
    pub fn bonus(&self, placed: &Placed) -> f64 {
        if self.rules.suspects(placed, &self.names) { self.settings.suspect_bonus } else { 0.0 }
    }

    /// Returns whether a step is switched off.
    pub fn skips(&self, step: Step) -> bool {
        self.off.contains(&step)
    }
}
