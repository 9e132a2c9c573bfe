//! Every threshold of the diagnosis, with its reason.

/// Entries of the screen that are fitted at each stage. The truth was among the first six of the screen in all labelled cases;
/// the rest is for near misses.
pub const FITTED: usize = 12;

/// Of these, the ones that are fitted to whole records.
pub const POLISHED: usize = 4;

/// Of these again, what gains less on the heads than the best of them by this share of its gain, and by this much in twice the log likelihood, is not
/// fitted to whole records: it would not come first there.
pub const BEHIND: f64 = 0.25;
/// See [`BEHIND`].
pub const FAR: f64 = 500.0;

/// Samples of each record that the search looks at. A third of a record ranks as a whole one does: effects of a few per cent stand
/// out by thousands in twice the log likelihood.
pub const HEAD: usize = 2000;

/// Effects together, at most.
pub const MOST_EFFECTS: usize = 3;

/// Twice the log likelihood that an effect must gain beyond its parameters' and the library's price: odds of 1 : 150.
pub const ACCEPT: f64 = 10.0;

/// What an effect must explain of the noise's own power: a gap of a twentieth of the noise. Below, the noise model's own errors
/// (a resonance whose ambient force is a little off) look like effects.
pub const MATERIAL: f64 = 0.003;

/// What an effect may explain instead: this much of the linear parameters' penalty. A sound simulation within the stated limits has a
/// penalty of about the number of modes' parameters times the square of how well it uses the limits; what an effect straightens comes
/// on top of that, and does not depend on the noise model. One parameter at twice the limit, four standard deviations, has 16.
pub const STRAIGHTENED: f64 = 14.0;

/// What an effect that explains no material part costs beside nothing at least: it stays among the candidates, behind. Of 229 blind cases in which nothing
/// was named, nothing was missing, or all that was, was too small to see, in 93 %; at 10 that was stated with 0.80, at 15 it would have been with 0.91.
pub const NOT_ACCEPTED: f64 = 15.0;

/// Share of what a fit leaves above the noise that a further effect must explain. A true second effect explains nearly all of it;
/// a wrong one nibbles at what the first left.
pub const FURTHER_SHARE: f64 = 0.4;

/// Excess over the noise, in that uncertainty, at which "something else" is as likely as not.
pub const EXCESS: f64 = 4.0;

/// Change of a linear parameter, in standard deviations of the stated limits, at which "something else" is as likely as not: the
/// largest of eighty within their limits is about two and a half.
pub const BENT: f64 = 3.8;

/// Confidence is spread over fits that differ by less than this in twice the log likelihood: twice the textbook's two, for the
/// noise model is estimated.
pub const TEMPERATURE: f64 = 4.0;

/// And by less than this share of what the best leaves beyond twice the noise level's uncertainty: where a model is inadequate, differences between
/// inadequate models mean little.
pub const MISFIT_TEMPERATURE: f64 = 0.05;

/// The textbook's two, with which the ablation compares.
pub const TEXTBOOK: f64 = 2.0;

/// Twice the log likelihood that a free shape must gain on the heads of the records, and four times that on whole ones: eight
/// numbers gain eight by chance.
pub const WORTH: f64 = 40.0;

/// Twice the log likelihood that the best further entry of the screen would gain on the heads of the records, at which "something
/// else" is as likely as not: beside a right explanation the best of a hundred entries gains up to 20.
pub const NEXT: f64 = 50.0;

/// Probability that is kept for something else where a free shape suffices. Of 52 such answers in development 49 were right, fewer where more causes lie
/// outside the vocabulary; a fifth is what counts as kept open.
pub const SHAPE_DIFFERS: f64 = 0.21;

/// Probability that is kept for something else beside an effect that explains next to nothing: what is small against the noise leaves nothing that could speak
/// for another cause. Of 34 blind cases with active experiments whose effects explained less than half the noise's power and were stated with 0.9 and more, 29
/// were right; of 224 in which they explained more than the noise itself, 218.
pub const FAINT: f64 = 0.15;

/// Power that is explained, over that of the noise, at which half of it is left.
pub const FAINT_POWER: f64 = 0.4;

/// Probability that is kept for something else as well where no record shows the noise: then nothing says whether what is left is more than that. Of 84
/// blind cases that were stated with 0.9 and more 70 were right.
pub const NOISE_UNSEEN: f64 = 0.09;

/// The same where an effect's parameters are at the limit of what its name means ([`Effect::doubt`](crate::effects::Effect::doubt)).
pub const DOUBTFUL: f64 = 0.21;

/// Probability of something else from which places on single modes are tried too: what a strut explains is not looked for elsewhere.
pub const INADEQUATE: f64 = 0.35;

/// And share of the refit's excess that must be left for that: a cause at another place leaves more than a shape's third digit.
pub const ELSEWHERE: f64 = 0.05;

/// Gain on held-out records in its own standard deviations that an explanation must reach where twice as much is expected of it.
pub const HELD_OUT_GAIN: f64 = 3.0;

/// Least and largest probability of something else. Of the blind cases in which nothing of the vocabulary sufficed, half had their cause there
/// all the same, in a shape or beside another effect that the search did not follow: what comes nearest keeps that much.
pub const LEAST_UNKNOWN: f64 = 0.02;
/// See [`LEAST_UNKNOWN`]. What held-out records refute has it too.
pub const MOST_UNKNOWN: f64 = 0.6;

/// Share of the gap beyond noise and limits, in amplitude, that an explanation may leave: of imperfect truths the true causes left 0.03 to 0.36, what imitated
/// a cause outside the vocabulary 0.70 and more.
pub const MOST_LEFT: f64 = 0.5;

/// What an explanation must leave of that gap for a free shape to be tried.
pub const SHAPED: f64 = 0.2;

/// How far the gap of a record is from what is stated of it, as a standard deviation of its logarithm, before any record has shown it: one record of a lightly
/// damped structure scatters by a tenth. And how many records that counts for.
pub const PREDICTION_SCATTER: f64 = 0.12;
/// See [`PREDICTION_SCATTER`].
pub const PREDICTIONS_KNOWN: f64 = 4.0;

/// Expected difference in log likelihood below which records, in hand or to come, do not part two explanations: odds of 150 : 1.
pub const SEPARABLE: f64 = 5.0;

/// Realised difference in log likelihood within which explanations are held against the best one: what is further off is refuted,
/// whatever was to be expected.
pub const NEAR: f64 = 60.0;

/// So many of them at most, for each is a fit to whole records.
pub const COMPARED: usize = 8;

/// Least share of the squared held-out gap that an effect beside a larger one must close to be named: a tenth in
/// amplitude. What closes less is part of the many small errors that every simulation has.
pub const LEAST_SHARE: f64 = 0.01;

/// Evidence (twice the log likelihood) that an effect which no free run shows needs: with a few dozen places to look at, noise alone reaches 12.
pub const EVIDENCE: f64 = 40.0;
