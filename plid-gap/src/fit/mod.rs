//! Least squares in the whitened residuals: fits of the linear parameters and of effects.

pub(crate) mod added;
pub(crate) mod candidate;
mod covariance;
pub(crate) mod derivatives;
pub(crate) mod descent;
pub(crate) mod free_run;
pub(crate) mod jacobian;
pub(crate) mod linear_model;
pub(crate) mod nuisance;
pub(crate) mod problem;
pub(crate) mod refit;
mod robust;
mod scale;
mod signals;
mod single;
