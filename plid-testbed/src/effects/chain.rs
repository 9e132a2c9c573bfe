//! The places in the signal chain at which effects act, in their order in a record.

use ndarray::Array2;
use rand_chacha::ChaCha12Rng;

use crate::INPUTS;
use crate::plant::{StrutPort, Truss};

/// A force inside the structure, integrated in continuous time together with it.
pub(crate) trait StructureEffect {
    /// Adds its contribution to dx/dt at time `t_s` (since the first record began). In `x` and `rate`, the states of
    /// the effects follow those of the truss.
    fn add_rate(&self, t_s: f64, x: &[f64], rate: &mut [f64]);

    /// Adds the change of the state over the last `_h_s` seconds by a force that is not a function of the state, such
    /// as one that holds a body still. On entry, `_x` is the state at the end of these seconds without this force.
    fn settle(&self, _h_s: f64, _x: &mut [f64]) {}

    /// Records the state at the end of a step of `_h_s` seconds, if the force depends on the history of the motion or
    /// on chance.
    fn end_step(&mut self, _h_s: f64, _x: &[f64]) {}
}

/// A change of the voltages between amplifier and actuator pole.
pub(crate) trait ActuatorEffect {
    /// Changes `u`, the voltages of one sample: constant over each piece of the sample, or the mean if a voltage is
    /// not constant.
    fn apply(&mut self, span: &Span, u: &mut [[f64; INPUTS]]);
}

/// A change of the samples (K x p), before the sensor noise or after the ADC.
pub(crate) trait SensorEffect {
    fn apply(&mut self, clock: Clock, y: &mut Array2<f64>);
}

/// A force that is held over a sample and does not depend on the state.
pub(crate) trait Disturbance {
    fn force(&mut self, t_s: f64) -> f64;
}

/// Time of a record.
#[derive(Clone, Copy)]
pub(crate) struct Clock {
    /// The number of the record, from 0.
    pub record: usize,
    /// Samples since the first record began.
    pub start: usize,
    pub sample_rate_hz: f64,
}

impl Clock {
    pub(crate) fn time_s(self, sample: usize) -> f64 {
        (self.start + sample) as f64 / self.sample_rate_hz
    }
}

/// A sample and its pieces.
pub(crate) struct Span<'a> {
    /// Start of the sample, s since the first record began.
    pub start_s: f64,
    pub sample_s: f64,
    /// Where the pieces begin and end, as shares of the sample: 0, ..., 1.
    pub edges: &'a [f64],
}

impl Span<'_> {
    /// Returns the length of each piece, s.
    pub(crate) fn lengths_s(&self) -> impl Iterator<Item = f64> + '_ {
        self.edges.windows(2).map(|w| (w[1] - w[0]) * self.sample_s)
    }
}

/// The information that an effect needs when a record begins.
pub(crate) struct Site<'a> {
    pub truss: &'a Truss,
    pub clock: Clock,
    /// The random numbers of this effect.
    pub rng: ChaCha12Rng,
}

/// All effects of one record, each with its internal state at zero.
#[derive(Default)]
pub(crate) struct Chain {
    pub structure: Vec<Box<dyn StructureEffect>>,
    /// Number of states that effects add to those of the truss.
    pub own_states: usize,
    pub actuator: Vec<Box<dyn ActuatorEffect>>,
    /// The fractions of a sample at which a voltage jumps.
    pub jumps: Vec<f64>,
    /// Whether a voltage changes within the sample.
    pub moves_within: bool,
    pub sensor: Vec<Box<dyn SensorEffect>>,
    /// Number of samples after the last one that a sensor effect needs.
    pub look_ahead: usize,
    /// Effects after the ADC.
    pub codes: Vec<Box<dyn SensorEffect>>,
    /// Forces, each with the input along whose strut it acts.
    pub forces: Vec<(usize, Box<dyn Disturbance>)>,
}

impl Chain {
    /// Adds a force that depends on a port's displacement and velocity.
    pub(crate) fn force_at(&mut self, port: &StrutPort, force: impl Fn(f64, f64) -> f64 + 'static) {
        self.structure.push(Box::new(PortForce { port: port.clone(), force }));
    }

    /// Adds a change of some inputs' voltages that depends only on the voltage.
    pub(crate) fn change_inputs(&mut self, inputs: Vec<usize>, law: impl Fn(f64) -> f64 + 'static) {
        self.actuator.push(Box::new(StaticVoltage { inputs, law }));
    }

    /// Adds a change of one output's samples that depends on the sample and its time (s).
    pub(crate) fn change_output(&mut self, output: usize, law: impl FnMut(f64, f64) -> f64 + 'static) {
        self.sensor.push(Box::new(Samples { output, law }));
    }
}

struct PortForce<F> {
    port: StrutPort,
    force: F,
}

impl<F: Fn(f64, f64) -> f64> StructureEffect for PortForce<F> {
    fn add_rate(&self, _t_s: f64, x: &[f64], rate: &mut [f64]) {
        let force = (self.force)(dot(&self.port.displacement, x), dot(&self.port.velocity, x));
        add_scaled(rate, &self.port.force, force);
    }
}

struct StaticVoltage<F> {
    inputs: Vec<usize>,
    law: F,
}

impl<F: Fn(f64) -> f64> ActuatorEffect for StaticVoltage<F> {
    fn apply(&mut self, _span: &Span, u: &mut [[f64; INPUTS]]) {
        for piece in u {
            for &j in &self.inputs {
                piece[j] = (self.law)(piece[j]);
            }
        }
    }
}

struct Samples<F> {
    output: usize,
    law: F,
}

impl<F: FnMut(f64, f64) -> f64> SensorEffect for Samples<F> {
    fn apply(&mut self, clock: Clock, y: &mut Array2<f64>) {
        for (k, value) in y.column_mut(self.output).iter_mut().enumerate() {
            *value = (self.law)(*value, clock.time_s(k));
        }
    }
}

/// Multiplies a row over the states of the truss by a state vector, which may be longer.
pub(crate) fn dot(row: &[f64], x: &[f64]) -> f64 {
    row.iter().zip(x).map(|(row, x)| row * x).sum()
}

pub(crate) fn add_scaled(rate: &mut [f64], entry: &[f64], force: f64) {
    for (r, share) in rate.iter_mut().zip(entry) {
        *r += share * force;
    }
}
