//! Progress reporting and interruption of long calculations.

/// A receiver of progress reports, such as a progress bar or a log.
pub trait Progress: Sync {
    /// Reports the start of a stage.
    fn stage(&self, name: &str);
    /// Reports that `done` of `total` steps of the stage are complete; `total` may grow.
    fn advance(&self, done: usize, total: usize);
    /// Returns whether the user has requested an interruption; the calculation then stops at the next sample and writes
    /// a checkpoint.
    fn interrupted(&self) -> bool;
}

/// A receiver that ignores all reports and never interrupts.
pub struct Silent;

impl Progress for Silent {
    fn stage(&self, _name: &str) {}
    fn advance(&self, _done: usize, _total: usize) {}
    fn interrupted(&self) -> bool {
        false
    }
}

/// The progress of one part of a larger calculation, which reports nothing but can be interrupted.
pub struct Inner<'a>(pub &'a dyn Progress);

impl Progress for Inner<'_> {
    fn stage(&self, _name: &str) {}
    fn advance(&self, _done: usize, _total: usize) {}
    fn interrupted(&self) -> bool {
        self.0.interrupted()
    }
}
