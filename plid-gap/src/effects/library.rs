use super::{Effect, built_in};

/// The effects of a diagnosis.
pub struct Library {
    effects: Vec<Box<dyn Effect>>,
}

impl Library {
    /// Returns the whole vocabulary.
    pub fn standard() -> Self {
        Self { effects: built_in() }
    }

    /// Adds an effect.
    pub fn with(mut self, effect: Box<dyn Effect>) -> Self {
        self.effects.push(effect);
        self
    }

    /// Removes the effects of these names.
    pub fn without(mut self, names: &[String]) -> Self {
        self.effects.retain(|effect| !names.iter().any(|name| name == effect.name()));
        self
    }

    /// Keeps only the effects of these names, for a search that is short.
    pub fn only(mut self, names: &[&str]) -> Self {
        self.effects.retain(|effect| names.contains(&effect.name()));
        self
    }

    /// Returns all effects.
    pub fn effects(&self) -> impl Iterator<Item = &dyn Effect> {
        self.effects.iter().map(AsRef::as_ref)
    }

    /// Returns an effect by its name.
    pub fn get(&self, name: &str) -> Option<&dyn Effect> {
        self.effects().find(|effect| effect.name() == name)
    }

    /// Returns the number of effects.
    pub fn len(&self) -> usize {
        self.effects.len()
    }

    /// Returns whether there is no effect.
    pub fn is_empty(&self) -> bool {
        self.effects.is_empty()
    }
}
