//! Every threshold of the diagnosis, with its reason.

/// Entries of the screen that are fitted at each stage. The truth was among the first six of the screen in all labelled cases;
/// the rest is for near misses.
pub const FITTED: usize = 12;

/// Of these, the ones that are fitted to whole records.
pub const POLISHED: usize = 4;

/// Samples of each record that the search looks at. A third of a record ranks as a whole one does: effects of a few per cent stand
/// out by thousands in twice the log likelihood.
pub const HEAD: usize = 2000;

/// Effects together, at most.
pub const MOST_EFFECTS: usize = 3;

/// Twice the log likelihood that an effect must gain beyond its parameters' and the library's price: odds of 1 : 150.
pub const ACCEPT: f64 = 10.0;

/// Share of what a fit leaves above the noise that a further effect must explain. A true second effect explains nearly all of it;
/// a wrong one nibbles at what the first left.
pub const FURTHER_SHARE: f64 = 0.4;

/// Uncertainty of the noise level (relative variance): a quiet record of 3200 samples and three sensors fixes it to 1.4 %.
pub const NOISE_LEVEL: f64 = 0.018;

/// Excess over the noise, in that uncertainty, at which "something else" is as likely as not.
pub const EXCESS: f64 = 5.0;

/// Confidence is spread over fits that differ by less than this in twice the log likelihood: twice the textbook's two, for the
/// noise model is estimated.
pub const TEMPERATURE: f64 = 4.0;

/// And by less than this share of what the best leaves above the noise: where a model is inadequate, differences between
/// inadequate models mean little.
pub const MISFIT_TEMPERATURE: f64 = 0.05;
