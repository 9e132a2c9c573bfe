/// The failure of a simulator, with its name or the number of the call.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SimulatorError {
    /// The description of the simulator is inconsistent.
    #[error("simulator {name:?}: {message}")]
    Description {
        /// Name of the simulator.
        name: String,
        /// The fault.
        message: String,
    },
    /// A step was requested from a simulator that only has whole runs.
    #[error("simulator {name:?} cannot advance step by step")]
    NoSteps {
        /// Name of the simulator.
        name: String,
    },
    /// A state was requested from a simulator that cannot store its state.
    #[error("simulator {name:?} cannot store its state")]
    NoStates {
        /// Name of the simulator.
        name: String,
    },
    /// The simulator reported a failure, ended, or did not answer in time.
    #[error("the simulator failed: {message}")]
    Failed {
        /// The message of the simulator or a description of the failure, and the end of its log, if it has one.
        message: String,
    },
    /// A call failed.
    #[error("{call}: {source}")]
    Call {
        /// The call: its number and kind, and the sample for a step.
        call: String,
        /// The failure.
        source: Box<SimulatorError>,
    },
    /// The outputs have the wrong number of channels or samples.
    #[error("the simulator returned {found}, expected {expected}")]
    Shape {
        /// The expected numbers.
        expected: String,
        /// The numbers that were returned.
        found: String,
    },
    /// A returned number is NaN or infinite.
    #[error("the simulator returned {value} for {what} at sample {sample}")]
    NotFinite {
        /// The output, or the motion at a port.
        what: String,
        /// The sample, from 0.
        sample: usize,
        /// The number.
        value: f64,
    },
}

impl SimulatorError {
    /// Creates a failure with the simulator's own message.
    pub fn failed(message: impl Into<String>) -> Self {
        Self::Failed { message: message.into() }
    }

    /// Creates the failure of a slot that holds no state.
    pub fn empty(slot: usize) -> Self {
        Self::failed(format!("slot {slot} holds no state"))
    }
}
