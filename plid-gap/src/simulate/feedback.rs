//! A controller in the loop of a simulation. It reads the outputs at each sample and holds its commands until the next.

use nalgebra::DMatrix;

use crate::case::Controller;
use crate::case::record::Channels;
use crate::plant::Plant;

/// The controller of several runs.
pub struct Feedback<'a, const R: usize> {
    controller: &'a Controller,
    /// (I - Dc D)^-1, with which the algebraic loop of both feedthroughs is solved (m x m).
    solved: DMatrix<f64>,
    /// The state of each run.
    states: [Vec<f64>; R],
    next: Vec<f64>,
    /// The part of the command of each input that is feedback, in each run.
    pub fed: Vec<[f64; R]>,
    before: Vec<f64>,
}

impl<'a, const R: usize> Feedback<'a, R> {
    /// Returns the controller of a plant, at rest; `None` if the plant has none.
    pub fn new(plant: &'a Plant) -> Option<Self> {
        let controller = plant.controller.as_deref()?;
        let (m, k) = (plant.m, controller.a.nrows());
        let read = controller.d.ncols();
        let matrix = DMatrix::identity(m, m) - &controller.d * plant.d.rows(0, read);
        // If an effect makes the algebraic loop unsolvable, the run is not finite.
        let solved = matrix.try_inverse().unwrap_or_else(|| DMatrix::from_element(m, m, f64::NAN));
        let states = std::array::from_fn(|_| vec![0.0; k]);
        Some(Self { controller, solved, states, next: vec![0.0; k], fed: vec![[0.0; R]; m], before: vec![0.0; m] })
    }

    /// Sets the state of a run.
    pub fn start(&mut self, run: usize, state: &[f64]) {
        self.states[run].iter_mut().zip(state).for_each(|(to, from)| *to = *from);
    }

    /// Computes the feedback at a sample from the other part of the command and from the outputs without direct
    /// feedthrough.
    pub fn find(&mut self, v: &[[f64; R]], y: &[Channels; R], sample: usize) {
        let Controller { c, d, .. } = self.controller;
        for (r, (state, y)) in self.states.iter().zip(y).enumerate() {
            for (i, before) in self.before.iter_mut().enumerate() {
                let by_state: f64 = state.iter().enumerate().map(|(j, x)| c[(i, j)] * x).sum();
                let by_output: f64 = (0..d.ncols()).map(|o| d[(i, o)] * y[o][sample]).sum();
                *before = v[i][r] + by_state + by_output;
            }
            for (i, fed) in self.fed.iter_mut().enumerate() {
                let command: f64 = self.before.iter().enumerate().map(|(j, w)| self.solved[(i, j)] * w).sum();
                fed[r] = command - v[i][r];
            }
        }
    }

    /// Updates the controller's states from the outputs of a sample.
    pub fn read(&mut self, y: &[Channels; R], sample: usize) {
        let Controller { a, b, .. } = self.controller;
        for (state, y) in self.states.iter_mut().zip(y) {
            for (j, next) in self.next.iter_mut().enumerate() {
                let by_state: f64 = state.iter().enumerate().map(|(i, x)| a[(j, i)] * x).sum();
                let by_output: f64 = (0..b.ncols()).map(|o| b[(j, o)] * y[o][sample]).sum();
                *next = by_state + by_output;
            }
            state.copy_from_slice(&self.next);
        }
    }
}
