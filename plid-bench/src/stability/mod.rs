//! The study of stability.

mod adversarial;
mod cell;
mod classify;
mod config;
mod covariance;
mod plant;
mod problem;
mod record;
mod reference;
mod scenario;
mod study;

pub use classify::*; pub use config::*; pub use study::*; pub use cell::*;
