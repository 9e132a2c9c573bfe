use crate::{Channels, Description, Simulator, SimulatorError};

/// A simulator that is a function from parameters and inputs (m channels) to outputs (p channels).
pub struct Function<F> {
    description: Description,
    function: F,
    copy: Option<Copy<F>>,
}

/// Creates an independent instance.
type Copy<F> = fn(&Function<F>) -> Box<dyn Simulator>;

impl<F: FnMut(&[f64], &[Vec<f64>]) -> Result<Channels, SimulatorError> + Send> Function<F> {
    /// Creates the simulator.
    pub fn new(description: Description, function: F) -> Self {
        Self { description, function, copy: None }
    }

    /// Allows runs side by side. Clones of the function must not share mutable state.
    pub fn side_by_side(self) -> Self
    where
        F: Clone + 'static,
    {
        let copy = |of: &Self| -> Box<dyn Simulator> {
            let (description, function) = (of.description.clone(), of.function.clone());
            Box::new(Self { description, function, copy: of.copy })
        };
        Self { copy: Some(copy), ..self }
    }
}

impl<F: FnMut(&[f64], &[Vec<f64>]) -> Result<Channels, SimulatorError> + Send> Simulator for Function<F> {
    fn description(&self) -> &Description {
        &self.description
    }

    fn run(&mut self, parameters: &[f64], u: &[Vec<f64>]) -> Result<Channels, SimulatorError> {
        (self.function)(parameters, u)
    }

    fn another(&self) -> Result<Option<Box<dyn Simulator>>, SimulatorError> {
        Ok(self.copy.map(|copy| copy(self)))
    }
}
