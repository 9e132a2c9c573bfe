//! Settings of the diagnosis with a simulator in the loop.

use super::group::group;

group! {
    /// The diagnosis with the engineer's own simulator in the loop.
    LoopSettings {
        /// Largest number of runs of the simulator, on one record each. The answer states whether the limit ended the
        /// search early, and what was left out. The drawn MuJoCo cases took 224 runs in the median with one cause, and
        /// up to 843 with two.
        calls: usize = 1000, "1", 10.0..=1e9;
        /// Longest time in the simulator, over all runs; the time of parallel runs counts once. It ends a search as
        /// `calls` does, but the answer then depends on the speed of the machine. The default, about thirty years, is
        /// no limit.
        seconds: f64 = 1e9, "s", 1.0..=1e9;
        /// Number of parallel runs, if the simulator allows them. A program is started that many times. The answer does
        /// not depend on this number. The default is one because a program may hold a licence or a file.
        side_by_side: usize = 1, "1", 1.0..=1e3;
        /// Largest number of states of a linear model that may take the simulator's place. A simulator that is linear
        /// and has no parameters is then diagnosed like a model.json. With zero, every simulator stays in the loop. The
        /// time of the realisation, a singular value decomposition, grows with the cube of this number.
        model_states: usize = 200, "1", 0.0..=1e4;
        /// Number of samples of one record on which effects are screened. It is the loudest record whose gap is smaller
        /// than half of the output, or else the loudest one whose gap is smaller than the output. The time of a run
        /// grows with this number, and a screen takes up to `starts` runs for each effect at each location.
        screened_samples: usize = 8192, "samples", 64.0..=1e9;
        /// Number of entries of a screen that are simulated at three sizes, on the first samples of that record. The
        /// order of a screen is uncertain, because a trace is only a first-order approximation. This takes at most 72
        /// runs.
        tried: usize = 24, "1", 1.0..=1e3;
        /// Number of these entries that are then fitted in a few steps: the better half of `tried`, because a fit takes
        /// more runs than three sizes do. Effects of the measurement alone take no runs, so all of them are fitted.
        /// This is also the number of pairs of effects that are simulated at three sizes.
        stepped: usize = 12, "1", 1.0..=1e3;
        /// Largest number of steps of such a fit. The fit only has to rank the effects; the leading ones are fitted to
        /// convergence later.
        quick_steps: usize = 3, "1", 1.0..=1e3;
        /// Largest number of effects that are then fitted to all records. Each step of such a fit takes a run for each
        /// record and parameter. This is also the number of pairs, and of rivals of a pair, that are fitted in a few
        /// steps.
        fitted: usize = 5, "1", 1.0..=1e3;
        /// An effect is fitted to all records only if the gap that it leaves after those few steps is at most this many
        /// times the gap that the best effect leaves. The factor allows for fits that have not converged.
        far: f64 = 4.0, "1", 1.0..=1e6;
        /// Largest number of starting values of one effect at one location that are screened, where the linearisation
        /// of the simulator can choose among them, and that are tried. With two, the better starting value is still
        /// tried if it is ranked second, and there is room for other effects.
        starts: usize = 2, "1", 1.0..=100.0;
        /// Largest number of steps of a fit. Each step takes a run for every parameter and one for each damping that is
        /// tried, so this number limits the runs of a fit that converges slowly.
        steps: usize = 8, "1", 1.0..=1e3;
        /// Decrease of the cost, over the number of whitened values, below which a fit ends. At the noise level, it
        /// corresponds to 0.05 % of the RMS of the residuals.
        fit_gain: f64 = 1e-3, "1", 0.0..=1.0;
        /// Number of explanations that are fitted again after the weights have changed. New weights change the order
        /// mainly among the leading explanations, and each fit takes as many runs as before.
        refined: usize = 3, "1", 1.0..=100.0;
        /// Share of the whole gap above which the gap that an explanation leaves is doubtful. If a first effect leaves
        /// a doubtful gap, pairs of effects are tried; if such a pair does, each of its effects is replaced in turn by
        /// all others. A first effect that only imitates a part of both causes leaves more than a law that is nearly
        /// the true one does (`least_of_gap`).
        doubtful: f64 = 0.1, "1", 0.0..=1.0;
        /// Largest number of effects in an explanation. Each further effect takes another screen or further fits, and
        /// the drawn cases contain at most two.
        effects: usize = 2, "1", 1.0..=10.0;
        /// Share of the material gap that a further effect must close, in amplitude. A smaller effect may exist, but
        /// the integration error of the simulator looks the same.
        least_material: f64 = 0.5, "1", 0.0..=1.0;
        /// Share of the whole gap that a further effect must close, in amplitude. A law that is nearly the true one
        /// (friction that does not stick in place of friction that does) leaves a few hundredths of the gap that it
        /// closes.
        least_of_gap: f64 = 0.05, "1", 0.0..=1.0;
        /// Distance between two explanations, in standard deviations, above which the records separate them (Vuong
        /// 1989).
        clear: f64 = 3.0, "1", 0.0..=100.0;
        /// Largest number of runs for the gap to expect on a further record. Each fitted record, or each part of one
        /// that is louder than all others, is predicted by a fit to the others: one step from the fit to all, which
        /// takes a run of every record. If these runs exceed this number or what `calls` leaves, the gap of the fitted
        /// records themselves is stated. With zero, it always is.
        crossed_calls: usize = 100, "1", 0.0..=1e9;
        /// Relative half-width of the 80 % interval of the stated gap if it is that of the fitted records themselves:
        /// twice 1.28 times a standard deviation of a tenth, by which single records of a lightly damped structure
        /// scatter. A fit leaves less in its own records than in others, by an amount that is not known then.
        prediction_width: f64 = 0.26, "1", 0.0..=1.0;
        /// Share of the remaining gap that a further effect must close. With long records, an effect that closes less
        /// can be significant although the gap hardly changes.
        least_closed: f64 = 0.1, "1", 0.0..=1.0;
    }
}
