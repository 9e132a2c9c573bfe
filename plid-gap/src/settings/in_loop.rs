//! Settings of the diagnosis with a simulator in the loop.

use super::group::group;

group! {
    /// The diagnosis with the engineer's own simulator in the loop.
    LoopSettings {
        /// Largest number of runs of the simulator, on one record each. What could not be finished is said.
        calls: usize = 1000, "1", 10.0..=1e9;
        /// Number of runs that go side by side, if the simulator allows it. A program is started so many times. The
        /// answer does not depend on it.
        side_by_side: usize = 1, "1", 1.0..=1e3;
        /// Largest number of states of a linear model that may take the simulator's place: a simulator that is linear
        /// and has no parameters is diagnosed as a model.json is. Zero keeps every simulator in the loop.
        model_states: usize = 200, "1", 0.0..=1e4;
        /// Number of samples of one record on which effects are screened: the loudest one in which the gap is smaller
        /// than the output.
        screened_samples: usize = 8192, "samples", 64.0..=1e9;
        /// Number of entries of a screen that are run in three sizes, on the head of that record.
        tried: usize = 24, "1", 1.0..=1e3;
        /// Number of these that are then fitted in a few steps. Effects of the measurement alone take no runs, and are
        /// all fitted.
        stepped: usize = 12, "1", 1.0..=1e3;
        /// Largest number of steps of such a fit.
        quick_steps: usize = 3, "1", 1.0..=1e3;
        /// Number of effects that are then fitted to all records.
        fitted: usize = 5, "1", 1.0..=1e3;
        /// What an effect may leave after those few steps, over what the best one leaves, to be fitted to all records.
        far: f64 = 4.0, "1", 1.0..=1e6;
        /// Number of starts of one effect at one place among them.
        starts: usize = 2, "1", 1.0..=100.0;
        /// Largest number of steps of a fit. Each takes a run for every parameter and one for each trial.
        steps: usize = 8, "1", 1.0..=1e3;
        /// Decrease of the cost, over the number of whitened values, below which a fit ends.
        fit_gain: f64 = 1e-3, "1", 0.0..=1.0;
        /// Number of explanations that are fitted again after the weights have changed.
        refined: usize = 3, "1", 1.0..=100.0;
        /// Share of the whole gap that a further effect must leave for the effects before it to be doubted: others are
        /// then tried in their places.
        doubtful: f64 = 0.1, "1", 0.0..=1.0;
        /// Largest number of effects of an explanation.
        effects: usize = 2, "1", 1.0..=10.0;
        /// Share of the material gap that a further effect must close, in amplitude. A smaller one may be there, but it
        /// is also what a foreign integrator's error looks like.
        least_material: f64 = 0.5, "1", 0.0..=1.0;
        /// Share of the whole gap that a further effect must close, in amplitude. A law that is nearly the true one
        /// (friction without stick for friction with it) leaves a few hundredths of the gap that it closes.
        least_of_gap: f64 = 0.05, "1", 0.0..=1.0;
        /// Standard deviations between two explanations from which the records separate them (Vuong 1989).
        clear: f64 = 3.0, "1", 0.0..=100.0;
        /// Share of the remaining gap that a further effect must close.
        least_closed: f64 = 0.1, "1", 0.0..=1.0;
    }
}
