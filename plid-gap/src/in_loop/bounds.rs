//! The bounds on the runs of a simulator, and the work that is left out because of them.

use crate::answer::schema::Bound;
use crate::settings::LoopSettings;

/// The runs of a simulator so far.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Spent {
    /// The number of runs.
    pub runs: usize,
    /// The time that the runs took in s. Runs in parallel count with their elapsed time only.
    pub seconds: f64,
    /// The samples of the runs from which the time of a further run is estimated, and the time of these runs in s.
    pub timed: (usize, f64),
}

/// The bounds on the runs of a search. Some runs are reserved for the work after the search: the intervals of the
/// parameters, the gap on other records and the range of the motion.
#[derive(Debug, Clone, Copy)]
pub(super) struct Bounds {
    calls: usize,
    seconds: f64,
    kept: usize,
    /// Number of samples of a reserved run.
    samples: usize,
}

impl Bounds {
    /// No bounds.
    pub const NONE: Self = Self { calls: usize::MAX, seconds: f64::INFINITY, kept: 0, samples: 0 };

    /// Returns the bounds of a case, which reserve `kept` runs of `samples` samples each.
    pub fn of(settings: &LoopSettings, kept: usize, samples: usize) -> Self {
        Self { calls: settings.calls, seconds: settings.seconds, kept, samples }
    }

    /// Returns the number of further runs of `samples` samples that are within the bounds, and the bound that limits
    /// it. The time of a run is estimated from its samples.
    pub fn left(&self, spent: Spent, samples: usize) -> (usize, Bound) {
        let calls = self.calls.saturating_sub(spent.runs.saturating_add(self.kept));
        let each = spent.timed.1 / spent.timed.0.max(1) as f64;
        let seconds = self.seconds_left(spent) / (each * samples.max(1) as f64).max(f64::MIN_POSITIVE);
        if seconds < calls as f64 { (seconds.max(0.0) as usize, Bound::Seconds) } else { (calls, Bound::Calls) }
    }

    /// Returns the bounds that allow half of the further runs.
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

/// The work that a search left out.
#[derive(Debug, Clone)]
pub(super) struct Cut {
    /// The bound that was reached first.
    pub by: Bound,
    /// Descriptions of the omitted work, in order.
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
        // A run of 2000 samples takes 1 s; 5 s are reserved, and 35 s remain.
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
