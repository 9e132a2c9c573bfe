use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use plid_simulator::{Description, Motion, Simulator, SimulatorError};

use crate::native::{Failed, Instance};
use crate::package::{Package, unpack};
use crate::wiring::Wiring;
use crate::{FmuError, Options};

/// An FMU for co-simulation, FMI 2.0 or 3.0, as a simulator.
///
/// Each run begins with the state after initialisation. The FMU is reset, or created again if a reset does not
/// restore that state. Displacements at ports are relative to this state.
pub struct Fmu {
    /// The instance, which is dropped before the binary.
    instance: Option<Instance>,
    package: Arc<Package>,
    wiring: Wiring,
    resets: Resets,
    /// Number of steps since the start.
    steps: u64,
    /// The number of steps before each stored state, by slot.
    kept: BTreeMap<usize, u64>,
    /// The values that are set in a step.
    values: Vec<f64>,
    /// Displacement and velocity of each port.
    motions: Vec<f64>,
    /// The displacement and velocity of each port at rest.
    rest: Vec<f64>,
}

/// Whether a reset of the FMU restores its initial state.
enum Resets {
    /// No run has begun.
    New,
    /// One run has begun. The values are its parameters, and all variables at its start.
    Begun(Vec<f64>, Vec<f64>),
    Work,
    Fail,
}

impl Fmu {
    /// Opens an FMU.
    ///
    /// # Errors
    /// Returns an [`FmuError`] if the file is not an FMU, is for another machine or another kind of simulation, or
    /// lacks a variable.
    pub fn open(file: &Path, options: &Options) -> Result<Self, FmuError> {
        let unpacked = unpack(file)?;
        // A wrong name is thus found before any foreign code runs.
        let wiring = Wiring::new(file, &unpacked.description, options)?;
        Self::of(Arc::new(Package::load(file, unpacked)?), wiring)
    }

    /// Creates an instance.
    fn of(package: Arc<Package>, wiring: Wiring) -> Result<Self, FmuError> {
        let (driven, motions) = (wiring.driven.len(), wiring.motions.len());
        let mut fmu = Self {
            instance: None,
            package,
            wiring,
            resets: Resets::New,
            steps: 0,
            kept: BTreeMap::new(),
            values: vec![0.0; driven],
            motions: vec![0.0; motions],
            rest: vec![0.0; motions],
        };
        fmu.instance = Some(fmu.create()?);
        Ok(fmu)
    }

    fn create(&self) -> Result<Instance, FmuError> {
        let Package { binary, birth, description, file, .. } = &*self.package;
        Instance::new(binary, birth).map_err(|said| {
            let (found, at) = ("nothing".into(), description.tool().into());
            FmuError::Call { file: file.clone(), function: "instantiation", found, at, log: log(said) }
        })
    }

    /// Returns the error of a call, with the last messages of the FMU.
    fn failed(&self, failed: Failed, at: String) -> FmuError {
        let said = self.instance.as_ref().map(Instance::said).unwrap_or_default();
        let Failed { function, found, .. } = failed;
        FmuError::Call { file: self.package.file.clone(), function, found, at, log: log(said) }
    }

    fn not_started(&self) -> FmuError {
        FmuError::Setting { file: self.package.file.clone(), message: "no run has been started".into() }
    }

    fn time(&self) -> f64 {
        self.package.description.start_time + self.steps as f64 * self.wiring.step
    }

    /// Calls the instance.
    fn call<T>(&mut self, work: impl FnOnce(&mut Instance) -> Result<T, Failed>) -> Result<T, FmuError> {
        if self.instance.is_none() {
            self.instance = Some(self.create()?);
        }
        match self.instance.as_mut().map(work) {
            Some(Ok(value)) => Ok(value),
            Some(Err(failed)) => Err(self.failed(failed, String::new())),
            None => Err(self.not_started()),
        }
    }

    fn initialise(&mut self, parameters: &[f64]) -> Result<(), FmuError> {
        let time = self.package.description.start_time;
        let references = self.wiring.parameters.clone();
        self.call(|instance| instance.initialise(time, &references, parameters))
    }

    /// Returns all variables, for comparison.
    fn all(&mut self) -> Result<Vec<f64>, FmuError> {
        let references = self.wiring.all.clone();
        let mut values = vec![0.0; references.len()];
        self.call(|instance| instance.get(&references, &mut values))?;
        Ok(values)
    }

    /// Brings the instance into its initial state, or creates a new one.
    fn renew(&mut self) -> Result<(), FmuError> {
        let sound = self.instance.as_ref().is_some_and(Instance::is_sound);
        self.resets = match std::mem::replace(&mut self.resets, Resets::Fail) {
            Resets::New => Resets::New,
            Resets::Begun(parameters, all) if sound => {
                if self.restores(&parameters, &all) {
                    Resets::Work
                } else {
                    Resets::Fail
                }
            }
            other => other,
        };
        let is_new = match self.resets {
            Resets::New => sound,
            Resets::Work => sound && self.call(Instance::reset).is_ok(),
            Resets::Begun(..) | Resets::Fail => false,
        };
        if !is_new {
            // The old instance is removed first, because some FMUs allow only one at a time.
            self.instance = None;
            self.instance = Some(self.create()?);
        }
        Ok(())
    }

    /// Returns whether a reset restores the start of the first run.
    fn restores(&mut self, parameters: &[f64], all: &[f64]) -> bool {
        let mut again = || {
            self.call(Instance::reset)?;
            self.initialise(parameters)?;
            self.all()
        };
        let bits = |values: &[f64]| values.iter().map(|value| value.to_bits()).collect::<Vec<u64>>();
        again().is_ok_and(|again| bits(&again) == bits(all))
    }

    /// Begins a run.
    fn begin(&mut self, parameters: &[f64]) -> Result<(), FmuError> {
        self.steps = 0;
        self.kept.clear();
        self.renew()?;
        self.initialise(parameters)?;
        if matches!(self.resets, Resets::New) {
            match self.all() {
                Ok(all) => self.resets = Resets::Begun(parameters.to_vec(), all),
                Err(_) => {
                    // Not all variables can be read, so a complete reset cannot be confirmed.
                    self.resets = Resets::Fail;
                    self.renew()?;
                    self.initialise(parameters)?;
                }
            }
        }
        self.read_motions()?;
        self.rest.copy_from_slice(&self.motions);
        Ok(())
    }

    /// Returns to a stored state, and returns whether there is one.
    fn go_back(&mut self, slot: usize) -> Result<bool, FmuError> {
        let Some(steps) = self.kept.get(&slot).copied() else { return Ok(false) };
        if !self.call(|instance| instance.restore(slot))? {
            return Ok(false);
        }
        self.steps = steps;
        self.read_motions()?;
        Ok(true)
    }

    fn motions(&self) -> Vec<Motion> {
        (0..self.wiring.description.ports.len()).map(|port| self.motion(port)).collect()
    }

    fn require_states(&self) -> Result<(), SimulatorError> {
        let Description { states, name, .. } = &self.wiring.description;
        states.then_some(()).ok_or_else(|| SimulatorError::NoStates { name: name.clone() })
    }

    /// Reads the motion at the ports.
    fn read_motions(&mut self) -> Result<(), FmuError> {
        let Self { instance, wiring, motions, .. } = self;
        let read = instance.as_mut().map_or(Ok(()), |instance| instance.get(&wiring.motions, motions));
        read.map_err(|failed| self.failed(failed, format!(" at {} s", self.time())))?;
        match self.motions.iter().position(|value| !value.is_finite()) {
            Some(k) => Err(self.not_finite(&self.wiring.motion_names[k], self.motions[k])),
            None => Ok(()),
        }
    }

    fn not_finite(&self, variable: &str, value: f64) -> FmuError {
        let said = self.instance.as_ref().map(Instance::said).unwrap_or_default();
        let (file, variable) = (self.package.file.clone(), variable.to_string());
        FmuError::NotFinite { file, variable, value, time: self.time(), log: log(said) }
    }

    fn motion(&self, port: usize) -> Motion {
        let displacement = self.motions[2 * port] - self.rest[2 * port];
        Motion { displacement, velocity: self.motions[2 * port + 1] }
    }

    /// Sets inputs and forces, reads the outputs, and takes a step.
    fn advance(&mut self, u: &[f64], forces: &[f64], y: &mut [f64]) -> Result<(), FmuError> {
        let time = self.time();
        let Self { instance, wiring, values, .. } = self;
        let Some(instance) = instance else { return Err(self.not_started()) };
        values.copy_from_slice(&wiring.base);
        values.iter_mut().zip(u).for_each(|(to, u)| *to = *u);
        wiring.forces.iter().zip(forces).for_each(|(&at, force)| values[at] += force);
        let done = instance
            .set(&wiring.driven, values)
            .and_then(|()| instance.get(&wiring.outputs, y))
            .and_then(|()| instance.advance(time, wiring.step));
        done.map_err(|failed| self.failed(failed, format!(" at {time} s{}", self.hint())))?;
        if let Some(o) = y.iter().position(|y| !y.is_finite()) {
            return Err(self.not_finite(&self.wiring.description.outputs[o].name, y[o]));
        }
        self.steps += 1;
        self.read_motions()
    }

    /// Returns a possible reason for the failure of a step.
    fn hint(&self) -> String {
        let model = &self.package.description;
        match model.step_size.filter(|own| model.fixed_step && (own / self.wiring.step - 1.0).abs() > 1e-9) {
            Some(own) => {
                format!(" (its steps are fixed at {own} s, but {} s were requested)", self.wiring.step)
            }
            None => String::new(),
        }
    }
}

/// Returns the last messages of the FMU as the end of a message.
fn log(said: String) -> String {
    if said.is_empty() { said } else { format!("; its last messages:\n{said}") }
}

impl Simulator for Fmu {
    fn description(&self) -> &Description {
        &self.wiring.description
    }

    fn start(&mut self, parameters: &[f64]) -> Result<Vec<Motion>, SimulatorError> {
        self.begin(parameters)?;
        Ok(self.motions())
    }

    fn step(&mut self, u: &[f64], forces: &[f64], y: &mut [f64], motions: &mut [Motion]) -> Result<(), SimulatorError> {
        self.advance(u, forces, y)?;
        motions.iter_mut().enumerate().for_each(|(port, motion)| *motion = self.motion(port));
        Ok(())
    }

    fn save(&mut self, slot: usize) -> Result<(), SimulatorError> {
        self.require_states()?;
        if !self.call(|instance| instance.save(slot))? {
            return Err(SimulatorError::failed("its library lacks the functions that store a state"));
        }
        self.kept.insert(slot, self.steps);
        Ok(())
    }

    fn restore(&mut self, slot: usize) -> Result<Vec<Motion>, SimulatorError> {
        self.require_states()?;
        if self.go_back(slot)? { Ok(self.motions()) } else { Err(SimulatorError::empty(slot)) }
    }

    fn another(&self) -> Result<Option<Box<dyn Simulator>>, SimulatorError> {
        if self.package.description.one_instance {
            return Ok(None);
        }
        Ok(Some(Box::new(Self::of(Arc::clone(&self.package), self.wiring.clone())?)))
    }
}
