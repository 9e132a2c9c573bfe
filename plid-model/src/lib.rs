//! Linear state-space models: the file `model.json`, simulation, prediction, and the quantities derived from a model.
//!
//! A model is x_{k+1} = A x_k + B u_k, y_k = C x_k + D u_k with n states, m inputs and p outputs. Records are arrays of
//! samples x channels, frequencies are in Hz, and decibels are 20 log10 of a magnitude.
mod advance;
mod compare;
mod eigen;
mod error;
mod feedback;
mod file;
mod frequency_response;
mod hessenberg;
mod hold;
mod initial_state;
mod json;
mod kalman;
mod modes;
mod peak;
mod predict;
mod riccati;
pub mod scalar_bayes;
mod scaling;
#[cfg(feature = "signal")]
pub mod signal;
mod simulate;
mod stability;
mod state_space;
mod uncertainty;

#[cfg(test)]
mod testing;

pub use advance::{advanced_state, undo_advance};
pub use compare::{CompareOptions, Comparison, NamedModel, OutputScore, Record, Run, Start, Trial, compare};
pub use eigen::eigenvalues;
pub use error::{KeyProblem, ModelError};
pub use feedback::{Wiring, close_loop};
pub use frequency_response::{FrequencyResponse, frequency_response};
pub use hold::{exponential, held};
pub use initial_state::{InitialState, estimate_initial_state, estimate_predictor_state};
pub use kalman::{Filtered, NoiseCovariances, kalman_filter};
pub use modes::{Mode, ModeKind, modes};
pub use peak::{Peak, find_peak};
pub use plid_file::{NotFinite, require_finite, to_json};
pub use predict::{Prediction, one_step_prediction, predictor};
pub use riccati::{SteadyState, steady_state_gain};
pub use scaling::{ChannelScaling, undo_scaling};
pub use simulate::{DIVERGENCE_FACTOR, Simulation, simulate};
pub use stability::{Stability, UnstableModel, stability};
pub use state_space::{Continuous, Model, Noise, OutputKind, Port};
pub use uncertainty::{ModeDeviation, ResponseVariance, mode_deviations, response_variance};
