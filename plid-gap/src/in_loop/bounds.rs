//! The bounds on the runs of a simulator, and what is left out because of them.

use crate::answer::schema::Bound;
use crate::settings::LoopSettings;

/// The runs of a simulator so far.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Spent {
    /// Their number.
    pub runs: usize,
    /// The time that they took in s. Runs that go side by side take the time of the longest one.
    pub seconds: f64,
    /// The samples of those runs from which the time of a further one is estimated, and the time of these in s.
    pub timed: (usize, f64),
}

/// The bounds on the runs of a search. Some runs are kept back for what follows it: the intervals of the parameters,
/// the gap on other records and the range of the motion.
#[derive(Debug, Clone, Copy)]
pub(super) struct Bounds {
    calls: usize,
    seconds: f64,
    kept: usize,
    /// Samples of a run that is kept back.
    samples: usize,
}

impl Bounds {
    /// No bounds.
    pub const NONE: Self = Self { calls: usize::MAX, seconds: f64::INFINITY, kept: 0, samples: 0 };

    /// Returns the bounds of a case, which keep back this number of runs of so many samples.
    pub fn of(settings: &LoopSettings, kept: usize, samples: usize) -> Self {
        Self { calls: settings.calls, seconds: settings.seconds, kept, samples }
    }

    /// Returns how many further runs of so many samples are within the bounds, and which bound allows no more. The time
    /// of a run is estimated from its samples.
    pub fn left(&self, spent: Spent, samples: usize) -> (usize, Bound) {
        let calls = self.calls.saturating_sub(spent.runs.saturating_add(self.kept));
        let each = spent.timed.1 / spent.timed.0.max(1) as f64;
        let seconds = self.seconds_left(spent) / (each * samples.max(1) as f64).max(f64::MIN_POSITIVE);
        if seconds < calls as f64 { (seconds.max(0.0) as usize, Bound::Seconds) } else { (calls, Bound::Calls) }
    }

    /// Returns the bounds that leave half of the further runs.
    pub fn half(&self, spent: Spent) -> Self {
        let calls = self.calls.saturating_sub(spent.runs.saturating_add(self.kept));
        Self {
            calls: self.calls - calls / 2,
            seconds: self.seconds - 0.5 * self.seconds_left(spent).clamp(0.0, f64::MAX),
            ..*self
        }
    }

    fn seconds_left(&self, spent: Spent) -> f64 {
        let each = spent.timed.1 / spent.timed.0.max(1) as f64;
        self.seconds - spent.seconds - each * (self.kept * self.samples) as f64
    }
}

/// What a search left out.
#[derive(Debug, Clone)]
pub(super) struct Cut {
    /// The bound that was reached first.
    pub by: Bound,
    /// What was left out, in order.
    pub what: Vec<String>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bound_that_is_nearer_ends_a_search() {
        let settings = LoopSettings { calls: 100, seconds: 60.0, ..LoopSettings::default() };
        let bounds = Bounds::of(&settings, 10, 1000);
        // 40 runs of 1000 samples in 20 s: half a second each.
        let spent = Spent { runs: 40, seconds: 20.0, timed: (40_000, 20.0) };
        assert_eq!(bounds.left(spent, 1000), (50, Bound::Calls));
        // Short runs take less time; 5 s are kept back, and 35 s remain.
        assert_eq!(bounds.left(spent, 2000), (35, Bound::Seconds));
        assert_eq!(bounds.half(spent).left(spent, 1000), (25, Bound::Calls));
        assert_eq!(bounds.half(spent).left(spent, 2000), (17, Bound::Seconds));
        let late = Spent { runs: 95, seconds: 59.0, timed: (95_000, 59.0) };
        assert_eq!(bounds.left(late, 1000).0, 0);
        assert_eq!(bounds.half(late).left(late, 1000).0, 0);
        // A simulator whose time is too short to be measured is bounded by the number of runs alone.
        assert_eq!(bounds.left(Spent { runs: 1, ..Spent::default() }, 1000), (89, Bound::Calls));
        assert!(Bounds::NONE.half(spent).left(spent, 1000).0 > usize::MAX / 4);
    }
}
