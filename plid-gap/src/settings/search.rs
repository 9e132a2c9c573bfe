//! Settings of the search for explanations.

use super::group::group;

group! {
    /// The search for explanations. Gains and prices are in twice the log likelihood.
    SearchSettings {
        /// Number of entries of the screen that are fitted at each stage. In all labelled cases, the true effect was
        /// among the first six entries. The others allow for effects whose shape differs.
        fitted: usize = 12, "entries", 1.0..=1000.0;
        /// Number of these fits that are repeated on whole records.
        polished: usize = 4, "entries", 1.0..=1000.0;
        /// A quick fit is not repeated on whole records if its gain trails the best gain by more than this share of the
        /// latter and by more than `trailing_gain`: it would not come first on whole records.
        trailing_share: f64 = 0.25, "1", 0.0..=1.0;
        /// See `trailing_share`.
        trailing_gain: f64 = 500.0, "2 ln L", 0.0..=1e9;
        /// A quick fit that replaces an effect by another one is not repeated on whole records if its gain trails that
        /// of the quick fit with the replaced effect by more than this share of the latter and by more than
        /// `replacing_gain`. In two cases, all 24 such fits trailed by more on whole records than in the quick fits.
        replacing_share: f64 = 0.1, "1", 0.0..=1.0;
        /// See `replacing_share`.
        replacing_gain: f64 = 100.0, "2 ln L", 0.0..=1e9;
        /// An effect is not reconsidered if it gained more than this many times the gain of the latest effect, which
        /// then hardly changes the lead of the former over its rivals.
        questioned: f64 = 20.0, "1", 1.0..=1e9;
        /// Number of leading samples of each record that the quick fits use. A third of a record ranks explanations as
        /// a whole record does, because an effect of a few per cent gains thousands.
        first_samples: usize = 2000, "samples", 64.0..=1e9;
        /// Smallest ratio of the mean square of the refit's error in that part to its mean square in the whole record;
        /// otherwise, a longer part is used. In the first third of a record, a drift has a ninth of its mean square.
        first_share: f64 = 0.1, "1", 0.0..=1.0;
        /// Factor by which the level of the loudest record must exceed that of other records for a strong effect to be
        /// searched for in the latter first.
        level_step: f64 = 1.4, "1", 1.0..=1e3;
        /// Gap that the bounded refit must leave in a driven record for the search to use windows of the records. A
        /// resonance that has moved by its width leaves about this gap.
        windows_gap: f64 = 0.3, "1", 0.0..=1e6;
        /// Length of a window, in periods of the frequency below which half of the output's power lies.
        windows_periods: f64 = 3.0, "periods", 0.5..=1e6;
        /// Smallest length of a window.
        least_window: usize = 64, "samples", 16.0..=1e9;
        /// Largest number of initial states of all windows together. The time of a fit grows with the square of this
        /// number.
        window_states: usize = 240, "states", 1.0..=1e6;
        /// Largest number of linear parameters for which fits always use the derivatives of the simulation with its
        /// effects, which take a run for each parameter.
        #[serde(alias = "few_numbers")]
        few_parameters: usize = 12, "parameters", 0.0..=1e6;
        /// Largest number of linear parameters for which a search uses windows. The fits then use the derivatives named
        /// under `few_parameters`, too.
        #[serde(alias = "strong_numbers")]
        strong_parameters: usize = 24, "parameters", 0.0..=1e6;
        /// Number of single effects after the best one to which a second effect is added, too, if the linear parameters
        /// are few.
        runners_up: usize = 2, "effects", 0.0..=100.0;
        /// Residual power of the best single effect, over the power of the noise, above which `runners_up` applies: the
        /// best effect may then only imitate the cause.
        imitation_left: f64 = 2.0, "1", 1.0..=1e9;
        /// Largest number of effects in one explanation.
        most_effects: usize = 3, "effects", 1.0..=10.0;
        /// Gain that an effect must have beyond the price of its parameters and of its choice from the library: odds of
        /// 150 : 1.
        accept_gain: f64 = 10.0, "2 ln L", 0.0..=1e9;
        /// Power that an effect must explain, over that of the noise: a gap of a twentieth of the noise. Smaller gains
        /// can be due to errors of the noise model, for example at a resonance whose ambient force is slightly wrong.
        material_power: f64 = 0.003, "1", 0.0..=1.0;
        /// Penalty of the linear parameters that an effect must remove if it does not explain that power. A sound
        /// simulation within its limits has a penalty of about the number of modal parameters times the square of the
        /// fraction of the limits that they use. One parameter at four standard deviations has a penalty of 16.
        straightened_penalty: f64 = 14.0, "2 ln L", 0.0..=1e9;
        /// Largest number of effects that are added to an error of the simulation itself because they bring the linear
        /// parameters back to their prior.
        most_straightened: usize = 2, "effects", 0.0..=10.0;
        /// Gain with which a physical parameter of the simulation, such as an inertia, must explain the changes of a
        /// refit for the search to start from this parameter: the price of a choice and of a parameter. A single
        /// parameter that is off by twenty times the scale of the others gains about as much.
        absorbed_gain: f64 = 20.0, "2 ln L", 0.0..=1e9;
        /// Largest ratio of what a model with such a parameter leaves, in amplitude beyond the noise, to what a model
        /// within the limits leaves without it: half, as for every main cause (`judge.most_left`).
        absorbed_left: f64 = 0.5, "1", 0.0..=1.0;
        /// Largest number of such parameters that are fitted.
        absorbed: usize = 3, "effects", 0.0..=100.0;
        /// Smallest price of an effect that was not accepted, compared with no effect. In 93 % of 229 blind cases in
        /// which no effect was named, nothing was missing, or everything that was missing was too small to detect. With
        /// a price of 10, the stated probability of this was 0.80; with 15, it is 0.91.
        not_accepted_price: f64 = 15.0, "2 ln L", 0.0..=1e9;
        /// Share of the power above the noise that a further effect must explain. A true second effect explains nearly
        /// all of it, a wrong one a small part.
        further_share: f64 = 0.4, "1", 0.0..=1.0;
        /// Residual power, over that of the assumed noise, below which that noise is overstated. A further effect must
        /// then explain its share of the whole residual.
        overstated: f64 = 0.5, "1", 0.0..=1.0;
        /// Price of an effect: twice the logarithm of the number of entries of the library, which are equally likely
        /// before the data are seen.
        choice_price: f64 = 9.0, "2 ln L", 0.0..=1e9;
        /// Price of an effect that is also a parameter of the bounded refit: twice the logarithm of the factor, in
        /// standard deviations, by which the effect's range exceeds the limits.
        release_price: f64 = 5.0, "2 ln L", 0.0..=1e9;
        /// Number of linear parameters for which `release_price` and `straightened_penalty` hold. If the simulation has
        /// fewer, fewer of them can be off by chance, and both values are lower by twice the logarithm of the ratio.
        released_of: f64 = 80.0, "parameters", 1.0..=1e6;
        /// Bonus of an effect or location that the case suspects: odds of 50 : 1.
        suspect_bonus: f64 = 8.0, "2 ln L", 0.0..=1e9;
        /// Smallest factor by which the screen may scale the starting value of an effect that is not linear in its
        /// size.
        least_size: f64 = 0.1, "1", 1e-6..=1.0;
        /// Largest such factor.
        most_size: f64 = 3.0, "1", 1.0..=1e6;
        /// Gain that a free shape must have in the quick fits: eight coefficients gain eight by chance.
        shape_gain: f64 = 40.0, "2 ln L", 0.0..=1e9;
        /// Gain that a free shape must have on whole records.
        shape_gain_whole: f64 = 160.0, "2 ln L", 0.0..=1e9;
        /// Share of the gap beyond noise and limits, in amplitude, that an explanation must leave for a free shape to
        /// be tried in addition to an error of the simulation itself.
        shape_left: f64 = 0.2, "1", 0.0..=1.0;
        /// Half-width of the range over which the curve of a free shape is compared with the laws of the vocabulary, in
        /// RMS of the loudest record.
        curve_range: f64 = 3.0, "RMS", 0.1..=100.0;
        /// A free shape is named after another law if the curve's misfit with that law is below this share of the
        /// misfit with the present law.
        nearer_law: f64 = 0.7, "1", 0.0..=1.0;
        /// Probability of something else above which a search continues: with the remainder as an error of the
        /// simulation itself, and with effects on single modes.
        inadequate: f64 = 0.35, "1", 0.0..=1.0;
        /// Gain by which a change that is constant within each record must exceed a drift with time for the drift to be
        /// rejected: odds of three million to one.
        by_record_gain: f64 = 30.0, "2 ln L", 0.0..=1e9;
        /// Share of the excess of the bounded refit that must be left for effects on single modes to be tried. A cause
        /// at another location leaves more than an error in the third digit of a shape does.
        modal_left: f64 = 0.05, "1", 0.0..=1.0;
        /// Smallest gain of one effect on a single mode by itself, over the gain of the first search, for such effects
        /// to be searched for.
        modal_gain: f64 = 0.5, "1", 0.0..=1e6;
        /// Largest number of modes on which effects are tried.
        modes: usize = 3, "modes", 1.0..=100.0;
        /// Share of the error's power near a mode above which effects are tried on that mode.
        mode_share: f64 = 0.1, "1", 0.0..=1.0;
        /// Half-width of the band around a mode, over the frequency of the mode.
        mode_width: f64 = 0.03, "1", 0.0..=1.0;
        /// Gain that a stochastic effect must have. If a few dozen locations are tested, noise alone reaches 12.
        stochastic_gain: f64 = 40.0, "2 ln L", 0.0..=1e9;
        /// Variance of a sensor, over the variance expected from the other sensors, above which the sensor counts as
        /// noisy.
        noisier: f64 = 1.3, "1", 1.0..=1e6;
        /// Smallest variance of a sensor, over the declared one, that counts as common to all sensors: about 1 /
        /// `misjudged`^2. A single sensor that is even quieter does not make the others noisy.
        least_common: f64 = 0.4, "1", 1e-6..=1.0;
        /// Factor by which the declared standard deviations of all sensors may be wrong together.
        misjudged: f64 = 1.5, "1", 1.0..=1e6;
    }
}
