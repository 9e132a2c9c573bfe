//! Spectra, frequency responses, residual tests and error measures of sampled records.
//!
//! Records are `samples x channels`. A missing sample is NaN; each function documents how it treats one. Time is in
//! seconds, frequency in Hz, and spectral densities are one-sided, in (unit of the channel)^2 / Hz.

mod convergence;
mod correlation;
mod cross_correlation;
mod error;
mod error_measures;
mod frf;
mod periodic;
mod spectra;
mod statistics;
#[cfg(test)]
mod test_noise;
mod whiteness;

pub use convergence::{Convergence, ConvergenceBin, convergence};
pub use correlation::{Correlation, CorrelationTest};
pub use cross_correlation::{CrossCorrelationOptions, cross_correlation};
pub use error::SignalError;
pub use error_measures::{ErrorMeasures, ErrorSums, error_measures};
pub use frf::{WelchFrf, welch_frf};
pub use periodic::{PeriodicFrf, PeriodicRecord, period_noise_rms, periodic_frf};
pub use spectra::{Spectra, WelchOptions, welch_spectra};
pub use statistics::{mean, median, rms};
pub use whiteness::{WhitenessOptions, whiteness};
