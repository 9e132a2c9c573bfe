//! The engineer's prior knowledge of the effects.

use plid_data::nearest;

use crate::case::CaseConfig;
use crate::effects::{Effect, Library, Names, Observation, Setting};
use crate::error::GapError;
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

    /// Returns whether an effect may be named at all.
    pub fn may_name(&self, effect: &dyn Effect) -> bool {
        self.knows(effect) && !self.exclude.iter().any(|word| word == effect.name())
    }

    /// Returns whether any effect that appears in this kind of observation may be named at all.
    pub fn may_show(&self, library: &Library, observed: Observation) -> bool {
        library.effects().any(|effect| effect.observed_in() == observed && self.may_name(effect))
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

/// Checks that every suspicion and every exclusion names an effect or a location.
///
/// # Errors
/// [`GapError::Name`] with the most similar name.
pub(crate) fn require_names<'e>(
    config: &CaseConfig,
    effects: impl Iterator<Item = &'e dyn Effect>,
    setting: &Setting,
) -> Result<(), GapError> {
    let mut names: Vec<String> = Vec::new();
    for effect in effects {
        names.push(effect.name().to_string());
        names.extend(effect.places(setting).iter().map(|place| place.location(&setting.names)));
    }
    // A missing mode and a line may have any frequency.
    let is_frequency = |name: &str| {
        let hz = name.strip_prefix("mode:").or(name.strip_prefix("freq:"));
        hz.is_some_and(|hz| hz.parse::<f64>().is_ok())
    };
    for (key, said) in [("suspects", &config.suspects), ("exclude", &config.exclude)] {
        if let Some(name) = said.iter().find(|name| !names.contains(name) && !is_frequency(name)) {
            return Err(GapError::Name { key, name: name.clone(), suggestion: nearest(name, &names) });
        }
    }
    Ok(())
}

fn means(word: &str, placed: &Placed, names: &Names) -> bool {
    word == placed.effect.name() || word == placed.place.location(names)
}

/// The effects that a search may name, and its options.
#[derive(Clone)]
pub struct Scope<'s, 'a> {
    /// The effects that the search knows.
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
    /// Whether the residual of an earlier explanation counts as noise, because the simulation is imperfect.
    pub imperfect: bool,
}

impl Scope<'_, '_> {
    /// Returns whether a free run can show this effect and the rules allow it at this location.
    pub fn allows(&self, placed: &Placed) -> bool {
        !placed.effect.is_stochastic() && self.rules.allow(placed, &self.names)
    }

    /// Returns whether a search may add an effect. A finer law of another effect may only take the place of that
    /// effect, unless the case suspects the finer law.
    pub fn admits(&self, placed: &Placed) -> bool {
        self.allows(placed) && (placed.effect.refines().is_none() || self.rules.suspects(placed, &self.names))
    }

    /// Returns the bonus for a suspicion, in twice the log likelihood.
    pub fn bonus(&self, placed: &Placed) -> f64 {
        if self.rules.suspects(placed, &self.names) { self.settings.suspect_bonus } else { 0.0 }
    }

    /// Returns whether a step is switched off.
    pub fn skips(&self, step: Step) -> bool {
        self.off.contains(&step)
    }
}
