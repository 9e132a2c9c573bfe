//! Settings of the judgement of explanations.

use super::group::group;

group! {
    /// The judgement of explanations. "Something else" is a cause outside the vocabulary. The figures from blind cases
    /// are those of the trials on which the calibration was developed.
    JudgeSettings {
        /// Excess of the residual over the noise, in standard deviations of the noise level, at which something else is
        /// as likely as not.
        excess: f64 = 4.0, "std", 0.0..=1e6;
        /// Share of the excess of the bounded refit below which an excess does not count: a thousandth of a large gap
        /// is due to the third digit of an effect's parameters, not to another cause.
        material_left: f64 = 0.004, "1", 1e-9..=1.0;
        /// Change of a linear parameter, in standard deviations of its prior, at which something else is as likely as
        /// not. The largest of eighty parameters within their limits is about 2.5.
        max_prior_z: f64 = 3.8, "std", 0.0..=1e6;
        /// Width of the transition at `max_prior_z`.
        prior_z_width: f64 = 0.3, "std", 1e-6..=1e6;
        /// Gain of the best remaining candidate of the screen, on the first samples, at which something else is as
        /// likely as not. With the right explanation in place, the best of a hundred other entries still gains up to
        /// 20.
        next_gain: f64 = 50.0, "2 ln L", 0.0..=1e9;
        /// Width of the transition at `next_gain`.
        next_gain_width: f64 = 8.0, "2 ln L", 1e-6..=1e9;
        /// Difference in twice the log likelihood at which the probability falls by a factor of e. The textbook's value
        /// is 2; it is doubled because the noise model is estimated.
        temperature: f64 = 4.0, "2 ln L", 1e-3..=1e9;
        /// Addition to `temperature`, as a share of the misfit of the best explanation beyond twice the uncertainty of
        /// the noise level. Differences between inadequate models are not significant.
        misfit_temperature: f64 = 0.05, "1", 0.0..=1e3;
        /// Power that effects explain, over that of the noise, at which their faintness is one half. The calibration of
        /// probabilities considers how faint effects are.
        faint_power: f64 = 0.4, "1", 1e-9..=1e9;
        /// Largest share of the innovations of the remainder that the inputs may predict for the remainder to count as
        /// noise, if no record shows the noise level. For simulated and measured linear plants with process noise, the
        /// inputs predicted at most 0.07; for unmodelled nonlinearities, they predicted at least 0.12.
        noise_predicted: f64 = 0.08, "1", 1e-6..=1.0;
        /// Largest gap that counts as noise in this way. The engineer would know of larger noise.
        most_noise: f64 = 0.3, "1", 0.0..=1e3;
        /// Smallest additional standard deviation of a sensor's noise, over the declared one, for the sensor to be
        /// called noisy if no record shows the noise alone. Causes outside the vocabulary add less.
        residual_noisier: f64 = 2.0, "1", 0.0..=1e6;
        /// Largest exponent with which a residual may grow with the level of the inputs and still count as noise. The
        /// exponent of noise is zero, and that of an error in proportion to the motion is one.
        noise_follows: f64 = 0.5, "1", 0.0..=10.0;
        /// Correlation of the squared residual with the square of the simulated output above which noise is not that of
        /// a sensor. The correlation is 0.5 for noise in proportion to a normally distributed output, and zero for
        /// sensor noise.
        noise_grows: f64 = 0.1, "1", 0.0..=1.0;
        /// Smallest probability of something else.
        least_unknown: f64 = 0.02, "1", 0.0..=1.0;
        /// Largest probability of something else, even if held-out records refute the best explanation. In half of the
        /// blind cases in which no explanation from the vocabulary sufficed, the cause was nevertheless in the
        /// vocabulary, with another shape or together with another effect.
        most_unknown: f64 = 0.6, "1", 0.0..=1.0;
        /// Largest share, in amplitude, that an explanation may leave of the gap beyond noise and limits. With
        /// imperfect truths, the true causes left 0.03 to 0.36, and imitations of a cause outside the vocabulary left
        /// 0.70 or more.
        most_left: f64 = 0.5, "1", 1e-6..=1.0;
        /// Largest share, in amplitude beyond the noise, that an explanation may leave of the gap as given to count
        /// although a refit imitates it. One of its effects must by itself make more than `most_left` of that gap. True
        /// causes that a refit imitates left 0.14 to 0.18, and imitations of a cause outside the vocabulary left 0.29
        /// or more.
        given_left: f64 = 0.25, "1", 0.0..=1.0;
        /// Largest ratio of the remainder beyond the noise that a linear model with more states leaves to the
        /// remainders of the simulation with linear effects and of a linear model with as many states, for the
        /// simulation to lack states.
        states_left: f64 = 0.5, "1", 0.0..=1.0;
        /// Gap with effects over that of the noise above which it is examined whether states are lacking.
        states_above_noise: f64 = 1.1, "1", 1.0..=1e6;
        /// Gain on held-out records, in standard deviations of this gain, that an explanation must reach if it is
        /// expected to be visible there.
        held_out_gain: f64 = 3.0, "std", 0.0..=1e6;
        /// An explanation is expected to be visible in held-out records if the standard deviation of its gain exceeds
        /// this multiple of `held_out_gain`: the expected gain is then twice the required one.
        held_out_power: f64 = 8.0, "1", 0.0..=1e6;
        /// Size of an offset that an explanation leaves, in standard deviations from the scatter between blocks of the
        /// records, above which the prediction contains the offset.
        offset_deviations: f64 = 2.0, "std", 0.0..=1e6;
        /// Scatter of the gap of one record about the stated gap, as a standard deviation of its logarithm, before any
        /// record has shown this scatter. The gap of one record of a lightly damped structure scatters by a tenth.
        prediction_scatter: f64 = 0.12, "1", 0.0..=10.0;
        /// Number of records to which `prediction_scatter` is equivalent.
        prediction_records: f64 = 4.0, "records", 0.0..=1e6;
        /// Number of parts into which the only driven record is divided, each of which is predicted from the others.
        prediction_parts: usize = 4, "parts", 2.0..=100.0;
        /// Expected difference in log likelihood above which records can separate two explanations: odds of 150 : 1.
        separable: f64 = 5.0, "ln L", 0.0..=1e9;
        /// Explanations that are worse than the best by more than this are refuted and not compared further.
        compared_within: f64 = 60.0, "ln L", 0.0..=1e9;
        /// Largest number of explanations that are compared with the best one, each by a fit to whole records.
        compared: usize = 8, "explanations", 0.0..=1000.0;
        /// Gain on the first samples above which an entry of the screen joins the flexible model with which the effects
        /// are compared. The best of a hundred wrong entries gains up to the default.
        ceiling_gain: f64 = 20.0, "2 ln L", 0.0..=1e9;
        /// Largest number of entries that join it: as many as an explanation may have effects (`search.most_effects`).
        ceiling_effects: usize = 3, "effects", 0.0..=100.0;
        /// Sum of the squared deviations of the logarithms of the levels from their mean above which a slope of the gap
        /// over the level is stated. Two records reach the default if one is 1.22 times as loud as the other.
        level_spread: f64 = 0.02, "1", 0.0..=1e6;
        /// Smallest share of the squared held-out gap that an effect other than the largest must close to be named: a
        /// tenth in amplitude. Smaller shares belong to the many small errors of every simulation.
        least_share: f64 = 0.01, "1", 0.0..=1.0;
        /// Ratio of the squared gap that effects at one location close together to the sum of what each closes in the
        /// presence of the others, above which they count as one law of another shape, under the name of the first
        /// nonlinear one.
        replaceable: f64 = 2.0, "1", 1.0..=1e6;
        /// Smallest confidence with which an effect other than the largest is named if the simulation is imperfect as a
        /// whole: the effect is then more likely than not at work. Of 23 smaller effects that answers for 29 imperfect
        /// truths named, none was the planted cause; 19 of them had a confidence of 0.4 or less.
        least_confidence: f64 = 0.5, "1", 0.0..=1.0;
        /// The effects are written into the simulation if the held-out gap with them is at most this multiple of the
        /// gap without them.
        no_worse: f64 = 1.001, "1", 1.0..=10.0;
        /// Held-out gap of an explanation, over that of the best one, below which it replaces the best one if it fits
        /// as well. Likewise, the gap of the simulation as given, over that with which fits of the effects to some
        /// records predict the others, below which the effects are not accepted.
        outdone: f64 = 0.7, "1", 0.0..=1.0;
        /// Largest number of explanations that are tried in place of one that diverges or predicts the held-out records
        /// worse than no effect. After these, the refit is used.
        most_refused: usize = 5, "explanations", 1.0..=100.0;
        /// Number of explanations for which the next experiment is chosen. If the records leave fewer of them
        /// unseparated from the best one, the most probable others are added.
        experiment_rivals: usize = 3, "explanations", 0.0..=100.0;
        /// Smallest probability of the explanations that are added.
        open_probability: f64 = 0.02, "1", 0.0..=1.0;
        /// Probability of something else above which a general experiment is proposed, if no explanation is open.
        open_unknown: f64 = 0.05, "1", 0.0..=1.0;
        /// Length of the next experiment.
        experiment_samples: usize = 2000, "samples", 64.0..=1e9;
        /// Length of the next experiment over `experiment_samples` if the shorter one is not expected to separate the
        /// explanations. Against noise, the expected difference grows at least in proportion to the length.
        experiment_longer: usize = 4, "1", 1.0..=1000.0;
        /// Factor by which an experiment must separate better than a simpler one to be proposed. The expected
        /// difference for one drawn signal scatters by a few per cent.
        experiment_better: f64 = 1.1, "1", 1.0..=1e3;
        /// Largest number of experiments that are considered at the greater length, and of those to which a sensor is
        /// added.
        experiment_best: usize = 3, "experiments", 1.0..=100.0;
        /// Smallest gain of the location that explains most of the residual for the side of the gap to be stated: the
        /// gain of an effect beyond doubt, with odds of three million to one.
        side_gain: f64 = 30.0, "2 ln L", 0.0..=1e9;
        /// Smallest share of the misfit beyond noise and limits that a location must explain for its side to be stated:
        /// more than half, so that no two locations of different sides explain separate parts of that size.
        side_share: f64 = 0.5, "1", 0.0..=1.0;
        /// Smallest lead of that share over the largest one on any other side. Smaller leads belong to the many small
        /// errors of every simulation.
        side_lead: f64 = 0.05, "1", 0.0..=1.0;
        /// Smallest ratio of the misfit that the best location of any other side leaves to the misfit that the best
        /// location leaves.
        side_ratio: f64 = 2.0, "1", 1.0..=1e3;
        /// Explanations with a smaller probability are not listed.
        least_probability: f64 = 1e-4, "1", 0.0..=1.0;
    }
}
