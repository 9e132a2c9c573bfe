/// The failure of a simulator. Each names the simulator or the call.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SimulatorError {
    /// What the simulator says of itself is inconsistent.
    #[error("simulator {name:?}: {message}")]
    Description {
        /// Name of the simulator.
        name: String,
        /// The fault.
        message: String,
    },
    /// A step was asked of a simulator that only runs as a whole.
    #[error("simulator {name:?} cannot advance step by step")]
    NoSteps {
        /// Name of the simulator.
        name: String,
    },
    /// A state was asked of a simulator that keeps none.
    #[error("simulator {name:?} cannot keep its state")]
    NoStates {
        /// Name of the simulator.
        name: String,
    },
    /// The simulator failed by its own account, stopped, or did not answer in time.
    #[error("the simulator failed: {message}")]
    Failed {
        /// Its words, or what it did; the end of its log, if it has one.
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
        /// What was expected.
        expected: String,
        /// What came back.
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
    /// A failure in the simulator's own words.
    pub fn failed(message: impl Into<String>) -> Self {
        Self::Failed { message: message.into() }
    }

    /// The failure of a slot that holds no state.
    pub fn empty(slot: usize) -> Self {
        Self::failed(format!("no state is kept in slot {slot}"))
    }
}
