//! What long work says and asks while it runs.

/// A bar, a log, or nothing.
pub trait Progress: Sync {
    /// A stage begins.
    fn stage(&self, name: &str);
    /// `done` of `total` steps of the stage; `total` may grow.
    fn advance(&self, done: usize, total: usize);
    /// Whether the user has asked for an end; the work then stops at the next sample and leaves a checkpoint.
    fn interrupted(&self) -> bool;
}

/// Nothing is said, and the work runs to its end.
pub struct Silent;

impl Progress for Silent {
    fn stage(&self, _name: &str) {}
    fn advance(&self, _done: usize, _total: usize) {}
    fn interrupted(&self) -> bool {
        false
    }
}
