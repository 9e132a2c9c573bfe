use crate::{Channels, Description, Simulator, SimulatorError};

/// A simulator that is a function from parameters and inputs (m channels) to outputs (p channels).
pub struct Function<F> {
    description: Description,
    function: F,
}

impl<F: FnMut(&[f64], &[Vec<f64>]) -> Result<Channels, SimulatorError>> Function<F> {
    /// Creates the simulator.
    pub fn new(description: Description, function: F) -> Self {
        Self { description, function }
    }
}

impl<F: FnMut(&[f64], &[Vec<f64>]) -> Result<Channels, SimulatorError>> Simulator for Function<F> {
    fn description(&self) -> &Description {
        &self.description
    }

    fn run(&mut self, parameters: &[f64], u: &[Vec<f64>]) -> Result<Channels, SimulatorError> {
        (self.function)(parameters, u)
    }
}
