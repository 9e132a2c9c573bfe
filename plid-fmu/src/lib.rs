//! An FMU as a simulator: co-simulation by FMI 2.0 and 3.0.
//!
//! [`Fmu`] implements [`plid_simulator::Simulator`]. Its inputs and outputs are the real inputs and outputs of the FMU,
//! or those that [`Options`] names. Parameters and ports are chosen by name.
//!
//! ```no_run
//! use plid_fmu::{ChosenParameter, Fmu, Options};
//! use plid_simulator::Simulator;
//!
//! let options = Options {
//!     rate_hz: Some(200.0),
//!     parameters: vec![ChosenParameter::new("mass")],
//!     ports: vec!["joint=force,position,velocity".parse()?],
//!     ..Options::default()
//! };
//! let mut fmu = Fmu::open("model.fmu".as_ref(), &options)?;
//! let y = fmu.run(&[2.0], &[vec![1.0; 100]])?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! An FMU is foreign native code, which may crash the process or never return. The program `plid` therefore runs it in
//! a child process (`plid gap serve-fmu`).
//!
//! Outputs are read after the inputs of a step are set and before the step. All unsafe code is in one module,
//! `native`.

mod description;
mod error;
mod fmu;
mod native;
mod options;
mod package;
mod unit;
mod wiring;

pub use error::FmuError;
pub use fmu::Fmu;
pub use options::{ChosenParameter, Options};
