//! The conclusions from the fits: whether the explanation suffices, what the records can separate, how far the gap
//! shrinks, and which experiment would be most informative next.

pub(crate) mod calibration;
pub(crate) mod crossed;
mod experiments;
pub(crate) mod explained;
pub(crate) mod family;
pub(crate) mod gap;
mod growth;
pub(crate) mod held_out;
mod imagined;
pub(crate) mod judgement;
pub(crate) mod lacking_states;
pub(crate) mod locate;
pub(crate) mod next_experiment;
pub(crate) mod offsets;
pub(crate) mod predictability;
mod record_scatter;
mod residual_noise;
pub(crate) mod separability;
pub(crate) mod settle_all;
pub(crate) mod shares;
pub(crate) mod shrink;
pub(crate) mod side;
pub(crate) mod statement;
pub(crate) mod statistics;
pub(crate) mod stochastic_gap;
pub(crate) mod verdict;
pub(crate) mod written;
