//! Simulators of any kind behind one trait.
//!
//! A [`Simulator`] describes itself ([`Description`]): inputs, outputs, parameters that may be wrong ([`Parameter`]),
//! and places at which a force can act ([`Port`]). [`Simulator::run`] maps inputs to outputs from rest. A simulator
//! that can also advance by one step at a time returns the motion at its ports and takes forces there
//! ([`Simulator::step`]). It may store states ([`Simulator::save`]), and it may have independent instances that run
//! side by side ([`Simulator::another`]).
//!
//! | implementation | simulator |
//! |---|---|
//! | [`Function`] | a Rust function from inputs to outputs |
//! | [`Command`] | another program, over its standard input and output |
//! | [`Linear`] | a linear model with ports, such as a model.json |
//!
//! [`Checked`] wraps any of them: it checks all answers, names the call that failed, counts runs and their time, and
//! runs instances side by side.
//! [`check()`] reports which rules a simulator violates. [`serve()`] offers a simulator to another program.
//!
//! ```
//! use plid_simulator::{Checked, Description, Function, Input, Output};
//!
//! // A gain of 0.5 with a parameter, at 100 Hz.
//! let mut description = Description::new("gain", 100.0, vec![Input::new("u")], vec![Output::new("y")]);
//! description.parameters.push(plid_simulator::Parameter::new("gain", 0.5));
//! let mut simulator = Function::new(description, |parameters, u| {
//!     Ok(vec![u[0].iter().map(|u| parameters[0] * u).collect()])
//! });
//! let mut checked = Checked::new(&mut simulator)?;
//! assert_eq!(checked.run(&[0.5], &[vec![1.0, 2.0]])?, [[0.5, 1.0]]);
//! assert_eq!(checked.calls().runs, 1);
//! # Ok::<(), plid_simulator::SimulatorError>(())
//! ```

mod check;
mod checked;
mod command;
mod description;
mod error;
mod function;
mod instance;
mod linear;
mod port_variables;

pub use check::{Finding, check};
pub use checked::{Calls, Checked};
pub use command::{Command, own_output, refuse, serve};
pub use description::{Description, Input, Output, Parameter, Port};
pub use error::SimulatorError;
pub use function::Function;
pub use instance::{Failure, Instance};
pub use linear::Linear;
pub use plid_model::OutputKind;
pub use port_variables::PortVariables;

/// Channels, each with the values of all samples.
pub type Channels = Vec<Vec<f64>>;

/// Displacement and velocity at a port, in its units.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Motion {
    /// Displacement.
    pub displacement: f64,
    /// Velocity: displacement per second.
    pub velocity: f64,
}

/// A simulator of a plant.
///
/// One of [`Simulator::run`] and [`Simulator::step`] is required. Equal calls must give equal numbers, so a
/// simulator with random numbers must begin each run with the same seed.
pub trait Simulator: Send {
    /// Returns the description of the simulator.
    fn description(&self) -> &Description;

    /// Simulates from rest with these parameters (in the order of the description) and held inputs (m channels), and
    /// returns the outputs (p channels) at the same samples.
    ///
    /// # Errors
    /// Returns a [`SimulatorError`] with the simulator's own message.
    fn run(&mut self, parameters: &[f64], u: &[Vec<f64>]) -> Result<Channels, SimulatorError> {
        run_by_steps(self, parameters, u)
    }

    /// Goes to rest with these parameters, and returns the motion at each port there.
    ///
    /// # Errors
    /// Returns a [`SimulatorError`] with the simulator's own message, or [`SimulatorError::NoSteps`] if it only has
    /// whole runs.
    fn start(&mut self, _parameters: &[f64]) -> Result<Vec<Motion>, SimulatorError> {
        Err(SimulatorError::NoSteps { name: self.description().name.clone() })
    }

    /// Advances by one step. It takes the inputs (m) and the force at each port, both held over the step. It writes the
    /// outputs (p) at the start of the step to `y`, and the motion at each port at its end to `motions`. A sample has
    /// [`Description::steps_per_sample`] steps.
    ///
    /// # Errors
    /// Returns the errors of [`Simulator::start`].
    fn step(
        &mut self,
        _u: &[f64],
        _forces: &[f64],
        _y: &mut [f64],
        _motions: &mut [Motion],
    ) -> Result<(), SimulatorError> {
        Err(SimulatorError::NoSteps { name: self.description().name.clone() })
    }

    /// Stores the present state, between two steps, in a slot, and replaces the state that the slot held. The next
    /// start deletes all states.
    ///
    /// # Errors
    /// Returns [`SimulatorError::NoStates`] if it cannot store its state ([`Description::states`]), and the errors of
    /// [`Simulator::start`].
    fn save(&mut self, _slot: usize) -> Result<(), SimulatorError> {
        Err(SimulatorError::NoStates { name: self.description().name.clone() })
    }

    /// Returns to the state in a slot, which remains stored, and returns the motion at each port there.
    ///
    /// # Errors
    /// Returns the errors of [`Simulator::save`], and [`SimulatorError::Failed`] if the slot is empty.
    fn restore(&mut self, _slot: usize) -> Result<Vec<Motion>, SimulatorError> {
        Err(SimulatorError::NoStates { name: self.description().name.clone() })
    }

    /// Returns an independent instance of this simulator, which may run at the same time in another thread and gives
    /// the same numbers. Returns `None` if there can be only one instance.
    ///
    /// # Errors
    /// Returns a [`SimulatorError`] if an instance cannot be created.
    fn another(&self) -> Result<Option<Box<dyn Simulator>>, SimulatorError> {
        Ok(None)
    }
}

impl<S: Simulator + ?Sized> Simulator for &mut S {
    fn description(&self) -> &Description {
        (**self).description()
    }

    fn run(&mut self, parameters: &[f64], u: &[Vec<f64>]) -> Result<Channels, SimulatorError> {
        (**self).run(parameters, u)
    }

    fn start(&mut self, parameters: &[f64]) -> Result<Vec<Motion>, SimulatorError> {
        (**self).start(parameters)
    }

    fn step(&mut self, u: &[f64], forces: &[f64], y: &mut [f64], motions: &mut [Motion]) -> Result<(), SimulatorError> {
        (**self).step(u, forces, y, motions)
    }

    fn save(&mut self, slot: usize) -> Result<(), SimulatorError> {
        (**self).save(slot)
    }

    fn restore(&mut self, slot: usize) -> Result<Vec<Motion>, SimulatorError> {
        (**self).restore(slot)
    }

    fn another(&self) -> Result<Option<Box<dyn Simulator>>, SimulatorError> {
        (**self).another()
    }
}

/// Runs a simulator step by step without forces.
fn run_by_steps<S: Simulator + ?Sized>(
    simulator: &mut S,
    parameters: &[f64],
    u: &[Vec<f64>],
) -> Result<Channels, SimulatorError> {
    let Description { outputs, ports, steps_per_sample, .. } = simulator.description();
    let (p, steps) = (outputs.len(), *steps_per_sample);
    let (forces, mut motions) = (vec![0.0; ports.len()], vec![Motion::default(); ports.len()]);
    let samples = u.first().map_or(0, Vec::len);
    let mut y = vec![vec![0.0; samples]; p];
    let (mut held, mut now) = (vec![0.0; u.len()], vec![0.0; p]);
    simulator.start(parameters)?;
    for k in 0..samples {
        held.iter_mut().zip(u).for_each(|(held, u)| *held = u[k]);
        for step in 0..steps {
            simulator.step(&held, &forces, &mut now, &mut motions)?;
            if step == 0 {
                y.iter_mut().zip(&now).for_each(|(y, now)| y[k] = *now);
            }
        }
    }
    Ok(y)
}
