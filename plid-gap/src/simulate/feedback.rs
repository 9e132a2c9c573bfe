//! A controller in the loop of a simulation. It reads the outputs at each sample and holds its commands until the next.

use nalgebra::DMatrix;

use super::between::Between;
use crate::case::Controller;
use crate::case::record::Channels;
use crate::plant::Plant;

/// The controller of several runs.
pub struct Feedback<'a, const R: usize> {
    controller: &'a Controller,
    /// (I - Dc D)^-1, with which the algebraic loop of both feedthroughs is solved (m x m).
    solved: DMatrix<f64>,
    /// Whether the controller responds to an output within its sample.
    direct: bool,
    /// The state of each run.
    states: [Vec<f64>; R],
    next: Vec<f64>,
    before: Vec<f64>,
    /// The effects between the controller and the plant in each run.
    between: [Between<'a>; R],
    /// The outputs that the controller reads at a sample, in each run.
    read: [Vec<f64>; R],
    /// Number of values of a command in a sample.
    parts: usize,
    /// The commands of a sample at the plant, with the feedback: m x `parts` values for each run.
    commanded: Vec<[f64; R]>,
}

impl<'a, const R: usize> Feedback<'a, R> {
    /// Returns the controller of a plant, at rest, with the effects of each run, for a number of values of a command in
    /// a sample; `None` if the plant has none.
    pub fn new(plant: &'a Plant, between: [Between<'a>; R], parts: usize) -> Option<Self> {
        let controller = plant.controller.as_deref()?;
        let (m, k) = (plant.m, controller.a.nrows());
        let matrix = DMatrix::identity(m, m) - plant.within_sample()?;
        // If an effect makes the algebraic loop unsolvable, or acts within it, the run is not finite.
        let acts_within = plant.loops_within_sample() && !between.iter().all(Between::is_empty);
        let solved = if acts_within { None } else { matrix.try_inverse() };
        let solved = solved.unwrap_or_else(|| DMatrix::from_element(m, m, f64::NAN));
        Some(Self {
            controller,
            solved,
            direct: controller.d.iter().any(|x| *x != 0.0),
            states: std::array::from_fn(|_| vec![0.0; k]),
            next: vec![0.0; k],
            before: vec![0.0; m],
            between,
            read: std::array::from_fn(|_| vec![0.0; plant.p]),
            parts,
            commanded: vec![[0.0; R]; m * parts],
        })
    }

    /// Returns one of the values of a command in the present sample, in each run.
    pub fn command(&self, input: usize, value: usize) -> [f64; R] {
        self.commanded[input * self.parts + value]
    }

    /// Returns the mean command of an input in the present sample, in a run.
    pub fn mean(&self, input: usize, run: usize) -> f64 {
        let values = &self.commanded[input * self.parts..][..self.parts];
        values.iter().map(|value| value[run]).sum::<f64>() / self.parts as f64
    }

    /// Sets the state of a run.
    pub fn start(&mut self, run: usize, state: &[f64]) {
        self.states[run].iter_mut().zip(state).for_each(|(to, from)| *to = *from);
    }

    /// Computes the commands at a sample from their part without feedback, v (of a run and an input), and from
    /// the outputs without direct feedthrough. `time` is that of the sample in each run.
    pub fn find(&mut self, v: impl Fn(usize, usize) -> f64, y: &[Channels; R], sample: usize, time: [f64; R]) {
        let Controller { c, d, .. } = self.controller;
        if self.direct {
            self.measure(y, sample, time, false);
        }
        for (r, state) in self.states.iter().enumerate() {
            for (i, before) in self.before.iter_mut().enumerate() {
                let by_state: f64 = state.iter().enumerate().map(|(j, x)| c[(i, j)] * x).sum();
                let by_output: f64 = (0..d.ncols()).map(|o| d[(i, o)] * self.read[r][o]).sum();
                *before = v(r, i) + by_state + by_output;
            }
            let (solved, before) = (&self.solved, &self.before);
            let command = |i: usize| before.iter().enumerate().map(|(j, w)| solved[(i, j)] * w).sum();
            let at_plant = self.between[r].command(time[r], self.parts, command);
            let values = at_plant.iter().flatten();
            self.commanded.iter_mut().zip(values).for_each(|(to, value)| to[r] = *value);
        }
    }

    /// Updates the controller's states from the outputs of a sample.
    pub fn read(&mut self, y: &[Channels; R], sample: usize, time: [f64; R]) {
        let Controller { a, b, .. } = self.controller;
        self.measure(y, sample, time, true);
        for (state, y) in self.states.iter_mut().zip(&self.read) {
            for (j, next) in self.next.iter_mut().enumerate() {
                let by_state: f64 = state.iter().enumerate().map(|(i, x)| a[(j, i)] * x).sum();
                let by_output: f64 = (0..b.ncols()).map(|o| b[(j, o)] * y[o]).sum();
                *next = by_state + by_output;
            }
            state.copy_from_slice(&self.next);
        }
    }

    /// Sets the outputs that the controller reads. They are the `last` ones of a sample if they include the direct
    /// feedthrough.
    fn measure(&mut self, y: &[Channels; R], sample: usize, time: [f64; R], last: bool) {
        for (((read, y), between), time) in self.read.iter_mut().zip(y).zip(&mut self.between).zip(time) {
            let measured = between.measure(time, |o| y[o][sample], last);
            read.iter_mut().zip(measured).for_each(|(to, y)| *to = y[0]);
        }
    }
}
