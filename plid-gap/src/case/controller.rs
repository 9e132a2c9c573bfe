//! A controller that was active while the records were taken.
//!
//! The command of the plant is u = v + K y: v is the part that does not come from feedback. The part v drives the
//! closed loop and follows from the records: v = K r from the references r, or v = u - K y from recorded commands and
//! outputs. The loop of the simulation is then closed through its own outputs. With v = u - K y, the command of the
//! simulation is the recorded command corrected by the controller's response to the error of the simulation, u + K
//! (simulated - recorded outputs), for any initial state of the real controller.

use std::path::Path;
use std::sync::Arc;

use nalgebra::{DMatrix, DVector};
use plid_model::{Model, ModelError, Wiring, close_loop};
use serde::{Deserialize, Serialize};

use super::{CaseConfig, Channels, Record};
use crate::error::GapError;

/// The controller of a case, `[controller]`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ControllerConfig {
    /// The controller's file, a model.json relative to the case. The controller's outputs are inputs of the
    /// simulation; its inputs are outputs of the simulation and, optionally, references.
    pub model: String,
}

/// A controller of a plant with m inputs and p outputs, with k states and q references.
#[derive(Debug, Clone, PartialEq)]
pub struct Controller {
    /// The controller as it was given.
    pub model: Model,
    /// Names of the references (q).
    pub references: Vec<String>,
    /// State matrix (k x k).
    pub a: DMatrix<f64>,
    /// Matrix from the plant's outputs to the states (k x p).
    pub b: DMatrix<f64>,
    /// Matrix from the states to the plant's inputs (m x k).
    pub c: DMatrix<f64>,
    /// Matrix from the plant's outputs to its inputs (m x p).
    pub d: DMatrix<f64>,
    /// Matrix from the references to the states (k x q).
    b_references: DMatrix<f64>,
    /// Matrix from the references to the plant's inputs (m x q).
    d_references: DMatrix<f64>,
    /// Names of the plant's inputs (m), and whether the controller drives them.
    inputs: Vec<(String, bool)>,
}

impl Controller {
    /// Connects a controller to a plant by the names of their channels.
    ///
    /// # Errors
    /// Returns the errors of [`plid_model::close_loop`] for channels or a rate that do not match, and for an algebraic
    /// loop.
    pub fn new(plant: &Model, model: Model) -> Result<Self, ModelError> {
        close_loop(plant, &model)?;
        let wiring = Wiring::new(plant, &model)?;
        let (m, p, refers) = (plant.m(), plant.p(), wiring.references());
        let drives = DMatrix::from_fn(m, model.p(), |i, l| f64::from(wiring.drives[l] == i));
        let reads = DMatrix::from_fn(model.m(), p, |j, o| f64::from(wiring.reads[j] == Some(o)));
        let refer = DMatrix::from_fn(model.m(), refers.len(), |j, r| f64::from(refers[r] == j));
        let is_driven = |i: usize| wiring.drives.contains(&i);
        Ok(Self {
            references: refers.iter().map(|&j| model.inputs[j].clone()).collect(),
            a: model.a.clone(),
            b: &model.b * &reads,
            c: &drives * &model.c,
            d: &drives * &model.d * &reads,
            b_references: &model.b * &refer,
            d_references: &drives * &model.d * &refer,
            inputs: plant.inputs.iter().enumerate().map(|(i, name)| (name.clone(), is_driven(i))).collect(),
            model,
        })
    }

    /// Returns the names of the signals that drive the closed loop: the references and the inputs of the plant that
    /// the controller does not drive. Without references, they are the inputs of the plant, which then carry the part
    /// that is added to the controller's command.
    pub fn drivers(&self) -> Vec<String> {
        let refers = !self.references.is_empty();
        let of_plant = self.inputs.iter().filter(|(_, driven)| !(refers && *driven)).map(|(name, _)| name.clone());
        self.references.iter().cloned().chain(of_plant).collect()
    }

    /// Returns the part of the command that does not come from feedback (m channels) from the channels of
    /// [`Controller::drivers`].
    pub fn driven_by(&self, given: &[Vec<f64>]) -> Channels {
        let (references, others) = given.split_at(self.references.len());
        if references.is_empty() {
            return others.to_vec();
        }
        let mut v = self.answer(&self.b_references, &self.d_references, references);
        let undriven = self.inputs.iter().enumerate().filter(|(_, (_, driven))| !driven);
        undriven.zip(others).for_each(|((i, _), other)| v[i].clone_from(other));
        v
    }

    /// Returns the part of the command that does not come from feedback (m channels) from the plant's inputs u (m) and
    /// outputs y (p): v = u - K y.
    pub fn without_feedback(&self, u: &[Vec<f64>], y: &[Vec<f64>]) -> Channels {
        combined(u, &self.answer(&self.b, &self.d, y), -1.0)
    }

    /// Returns the plant's inputs (m) from the part without feedback, v (m), and the outputs y (p): u = v + K y.
    pub fn commands(&self, v: &[Vec<f64>], y: &[Vec<f64>]) -> Channels {
        combined(v, &self.answer(&self.b, &self.d, y), 1.0)
    }

    /// Returns the RMS of each state (k) of a controller that reads these outputs; missing samples are taken as zero.
    pub fn state_sizes(&self, outputs: &[&Channels]) -> Vec<f64> {
        let mut sums = DVector::zeros(self.a.nrows());
        let mut count = 0.0;
        for y in outputs {
            self.run(&self.b, y, |x, _| {
                sums += x.component_mul(x);
                count += 1.0;
            });
        }
        sums.iter().map(|sum| (sum / f64::max(count, 1.0)).sqrt()).collect()
    }

    /// Returns the response at the plant's inputs (m), from rest, to a signal that enters through `b` and `d`.
    fn answer(&self, b: &DMatrix<f64>, d: &DMatrix<f64>, signal: &[Vec<f64>]) -> Channels {
        let mut commands = vec![Vec::new(); self.c.nrows()];
        self.run(b, signal, |x, now| {
            let command = &self.c * x + d * now;
            commands.iter_mut().zip(&command).for_each(|(to, u)| to.push(*u));
        });
        commands
    }

    /// Runs the controller from rest and calls `see` with the state and the signal at each sample.
    fn run(&self, b: &DMatrix<f64>, signal: &[Vec<f64>], mut see: impl FnMut(&DVector<f64>, &DVector<f64>)) {
        let mut x = DVector::zeros(self.a.nrows());
        for n in 0..signal.first().map_or(0, Vec::len) {
            let there = |x: f64| if x.is_nan() { 0.0 } else { x };
            let now = DVector::from_iterator(signal.len(), signal.iter().map(|s| there(s[n])));
            see(&x, &now);
            x = &self.a * x + b * now;
        }
    }
}

/// Returns a + factor b.
fn combined(a: &[Vec<f64>], b: &[Vec<f64>], factor: f64) -> Channels {
    a.iter().zip(b).map(|(a, b)| a.iter().zip(b).map(|(a, b)| a + factor * b).collect()).collect()
}

/// Reads the controller of a case for its simulation.
///
/// # Errors
/// Returns [`GapError::Model`] for an invalid file, and [`GapError::Key`] if the controller does not fit the
/// simulation or the case's `inputs`.
pub(super) fn read(
    path: &Path,
    config: &CaseConfig,
    folder: &Path,
    plant: &Model,
) -> Result<Option<Arc<Controller>>, GapError> {
    let Some(ControllerConfig { model }) = &config.controller else { return Ok(None) };
    let wrong = |key: &str, message: String| GapError::Key { file: path.into(), key: key.into(), message };
    let controller = Controller::new(plant, Model::read(&folder.join(model))?)
        .map_err(|error| wrong("controller", format!("{model}: {error}")))?;
    let mut expected = controller.drivers();
    let mut given = config.inputs.clone();
    if controller.references.is_empty() {
        // The order of the inputs is checked, as without a controller.
        (expected == given).then_some(()).ok_or_else(|| {
            let (given, expected) = (given.join(", "), expected.join(", "));
            wrong("inputs", format!("{given} here, but {model} has no reference, so they are {expected}"))
        })?;
        return Ok(Some(Arc::new(controller)));
    }
    expected.sort();
    given.sort();
    if given != expected {
        let (given, expected) = (config.inputs.join(", "), controller.drivers().join(", "));
        let message = format!(
            "{given} here, but the references of {model} and the inputs that it does not drive are {expected}. To use \
            recorded commands instead, give a controller that reads outputs of the simulation alone"
        );
        return Err(wrong("inputs", message));
    }
    Ok(Some(Arc::new(controller)))
}

/// Replaces the inputs of a record, which are `inputs` of the case, by the part of the command that does not come from
/// feedback.
///
/// # Errors
/// Returns [`GapError::Record`] if an output that the controller read is missing and the commands were recorded.
pub(super) fn open(
    controller: &Controller,
    inputs: &[String],
    outputs: &[String],
    record: &mut Record,
) -> Result<(), GapError> {
    if !controller.references.is_empty() {
        let at = |name: &String| inputs.iter().position(|other| other == name).unwrap_or_default();
        let given: Channels = controller.drivers().iter().map(|name| record.u[at(name)].clone()).collect();
        record.u = controller.driven_by(&given);
        return Ok(());
    }
    let reads = |o: usize| controller.b.column(o).iter().chain(&controller.d.column(o)).any(|x| *x != 0.0);
    for (o, y) in record.y.iter().enumerate().filter(|(o, _)| reads(*o)) {
        if let Some(sample) = y.iter().position(|y| !y.is_finite()) {
            let message = format!(
                "output `{}` lacks sample {sample}, which the controller read: without it, its part of the recorded \
                command is not known. Choose other `samples`, or declare the references as inputs",
                outputs[o]
            );
            return Err(GapError::Record { record: record.name.clone(), message });
        }
    }
    record.u = controller.without_feedback(&record.u, &record.y);
    Ok(())
}
