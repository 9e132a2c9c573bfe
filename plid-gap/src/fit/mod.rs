//! Least squares in the whitened residuals: the linear parameters, and with them the parameters of effects.

pub(crate) mod candidate;
pub(crate) mod free_run;
pub(crate) mod nuisance;
pub(crate) mod problem;
pub(crate) mod refit;
pub(crate) mod robust;
