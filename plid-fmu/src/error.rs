use std::path::PathBuf;

use plid_simulator::SimulatorError;

/// The reasons why an FMU cannot be used. Each names the file.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FmuError {
    /// The file cannot be read or unpacked.
    #[error("{}: {source}", file.display())]
    Io {
        /// The FMU.
        file: PathBuf,
        /// The reason.
        source: std::io::Error,
    },
    /// The file is not a ZIP archive, or it is damaged.
    #[error("{}: it is not a valid ZIP archive: {message}", file.display())]
    Archive {
        /// The FMU.
        file: PathBuf,
        /// The fault.
        message: String,
    },
    /// modelDescription.xml is missing or wrong.
    #[error("{}: modelDescription.xml: {message}", file.display())]
    Description {
        /// The FMU.
        file: PathBuf,
        /// The fault.
        message: String,
    },
    /// The FMU follows a version of FMI other than 2 and 3.
    #[error("{}: it follows FMI {version:?}, and only FMI 2.0 and 3.0 are supported", file.display())]
    Version {
        /// The FMU.
        file: PathBuf,
        /// The version.
        version: String,
    },
    /// The FMU does not support co-simulation.
    #[error("{}: it is for {has} only; export it for co-simulation, with its solver", file.display())]
    Kind {
        /// The FMU.
        file: PathBuf,
        /// The kinds of simulation that it supports.
        has: String,
    },
    /// The FMU has no binary for this machine.
    #[error("{}: it has no {wanted}; it has {found}", file.display())]
    Platform {
        /// The FMU.
        file: PathBuf,
        /// The expected location of the binary.
        wanted: String,
        /// The folders of binaries that exist.
        found: String,
    },
    /// The binary cannot be loaded.
    #[error("{}: its binary cannot be loaded: {message}", file.display())]
    Binary {
        /// The FMU.
        file: PathBuf,
        /// The message of the operating system.
        message: String,
    },
    /// A requested variable does not exist, or it cannot be used in this way.
    #[error("{}: variable {variable:?}: {message}", file.display())]
    Variable {
        /// The FMU.
        file: PathBuf,
        /// The variable.
        variable: String,
        /// The fault, and the variables that exist.
        message: String,
    },
    /// A rate or a number of steps cannot be used.
    #[error("{}: {message}", file.display())]
    Setting {
        /// The FMU.
        file: PathBuf,
        /// The fault.
        message: String,
    },
    /// A function of the FMU failed.
    #[error("{}: {function} returned {found}{at}{log}", file.display())]
    Call {
        /// The FMU.
        file: PathBuf,
        /// The function.
        function: &'static str,
        /// The value that it returned.
        found: String,
        /// The time of the simulation, for a step.
        at: String,
        /// The FMU's own last messages.
        log: String,
    },
    /// A variable is NaN or infinite.
    #[error("{}: variable {variable:?} is {value} at {time} s{log}", file.display())]
    NotFinite {
        /// The FMU.
        file: PathBuf,
        /// The variable.
        variable: String,
        /// Its value.
        value: f64,
        /// The time of the simulation.
        time: f64,
        /// The FMU's own last messages.
        log: String,
    },
}

impl From<FmuError> for SimulatorError {
    fn from(error: FmuError) -> Self {
        Self::failed(error.to_string())
    }
}
