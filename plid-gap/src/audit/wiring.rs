//! The wiring: the channel of the simulation to which a measured channel belongs, with its factor, and a common delay.

use nalgebra::DMatrix;
use plid_model::Model;

use crate::case::record::Record;

/// A connection between a channel of the simulation and a measured channel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wire {
    /// The channel at the other end: an output of the simulation, or a measured input.
    pub channel: usize,
    /// A sign, or a factor between two units.
    pub gain: f64,
}

/// The wiring with which the simulation agrees best with the records.
#[derive(Debug, Clone, PartialEq)]
pub struct Wiring {
    /// Measured output o = gain times the simulation's output `channel`.
    pub outputs: Vec<Wire>,
    /// The simulation's input i is driven by gain times the measured input `channel`.
    pub inputs: Vec<Wire>,
    /// Samples by which the records lag behind the simulation; negative if they lead.
    pub delay: i64,
}

impl Wiring {
    /// Returns the wiring as given.
    pub fn plain(m: usize, p: usize) -> Self {
        Self { outputs: straight(p), inputs: straight(m), delay: 0 }
    }

    /// Returns the simulation with channels, signs and units as in the records.
    pub fn applied(&self, model: &Model) -> Model {
        let (n, m, p) = (model.n(), model.m(), model.p());
        // The column of a measured input is the column of the simulation's input that this measured input drives.
        let driven: Vec<usize> =
            (0..m).map(|j| self.inputs.iter().position(|wire| wire.channel == j).expect("a permutation")).collect();
        let columns = |b: &DMatrix<f64>| {
            DMatrix::from_fn(b.nrows(), m, |row, j| self.inputs[driven[j]].gain * b[(row, driven[j])])
        };
        let mut put = model.clone();
        put.b = columns(&model.b);
        put.c = DMatrix::from_fn(p, n, |o, j| self.outputs[o].gain * model.c[(self.outputs[o].channel, j)]);
        let d = columns(&model.d);
        put.d = DMatrix::from_fn(p, m, |o, j| self.outputs[o].gain * d[(self.outputs[o].channel, j)]);
        if let Some(continuous) = &mut put.continuous {
            continuous.b = columns(&continuous.b);
        }
        put.noise.sensor_std = model
            .noise
            .sensor_std
            .as_ref()
            .map(|std| self.outputs.iter().map(|wire| wire.gain.abs() * std[wire.channel]).collect());
        put.noise.actuator_std = model
            .noise
            .actuator_std
            .as_ref()
            .map(|std| driven.iter().map(|&i| std[i] / self.inputs[i].gain.abs()).collect());
        for port in &mut put.ports {
            if let Some(input) = &mut port.input
                && let Some(i) = model.inputs.iter().position(|name| name == input)
            {
                *input = model.inputs[self.inputs[i].channel].clone();
            }
            if let Some(output) = &mut port.output {
                *output = self.outputs.iter().map(|wire| wire.gain * output[wire.channel]).collect();
            }
        }
        // These quantities belong to the channels in their former order.
        put.predictor_gain = None;
        put.observability_indices = None;
        put.parameter_covariance = None;
        put
    }

    /// Shifts a record's inputs to the time at which they act. If they act earlier than recorded, the end of the
    /// record is lost.
    pub fn delay_inputs(&self, record: &mut Record) {
        let shift = (self.delay.unsigned_abs() as usize).min(record.samples());
        if self.delay >= 0 {
            for u in &mut record.u {
                u.truncate(u.len() - shift);
                u.splice(0..0, std::iter::repeat_n(0.0, shift));
            }
        } else {
            record.u.iter_mut().for_each(|u| drop(u.drain(..shift)));
            let samples = record.u[0].len();
            record.y.iter_mut().chain(record.simulated.iter_mut().flatten()).for_each(|y| y.truncate(samples));
        }
    }

    /// Returns all wirings with one change undone.
    pub fn simpler(&self) -> Vec<Self> {
        let mut all = Vec::new();
        let mut put = |wiring: Self| {
            if wiring != *self {
                all.push(wiring);
            }
        };
        put(Self { delay: 0, ..self.clone() });
        let in_order = |wires: &[Wire]| -> Vec<Wire> {
            wires.iter().enumerate().map(|(channel, wire)| Wire { channel, gain: wire.gain }).collect()
        };
        put(Self { outputs: in_order(&self.outputs), ..self.clone() });
        put(Self { inputs: in_order(&self.inputs), ..self.clone() });
        for gain in [f64::abs, f64::signum] {
            for o in 0..self.outputs.len() {
                let mut wiring = self.clone();
                wiring.outputs[o].gain = gain(wiring.outputs[o].gain);
                put(wiring);
            }
            for i in 0..self.inputs.len() {
                let mut wiring = self.clone();
                wiring.inputs[i].gain = gain(wiring.inputs[i].gain);
                put(wiring);
            }
        }
        all
    }

    /// Returns the number of changes to the simulation as given. A change of all channels alike counts as one; factors
    /// are alike if they differ by less than `same_factor`.
    pub fn changes(&self, same_factor: f64) -> usize {
        let sides = [&self.outputs, &self.inputs].map(|side| side_changes(side, same_factor));
        usize::from(self.delay != 0) + sides.iter().sum::<usize>()
    }
}

fn straight(count: usize) -> Vec<Wire> {
    (0..count).map(|channel| Wire { channel, gain: 1.0 }).collect()
}

fn side_changes(wires: &[Wire], same_factor: f64) -> usize {
    let moved = wires.iter().enumerate().filter(|(k, wire)| *k != wire.channel).count();
    let alike = |differs: &dyn Fn(f64) -> bool, same: bool| match wires.iter().filter(|w| differs(w.gain)).count() {
        count if count == wires.len() && same => 1,
        count => count,
    };
    let first = wires.first().map_or(1.0, |wire| wire.gain.abs());
    let same_size = wires.iter().all(|wire| (wire.gain.abs() / first - 1.0).abs() < same_factor);
    moved.saturating_sub(1) + alike(&|gain| gain < 0.0, true) + alike(&|gain| gain.abs() != 1.0, same_size)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{random_input, run, truss};

    #[test]
    fn a_rewired_model_gives_the_rewired_outputs() {
        let model = truss(3);
        let wiring = Wiring {
            outputs: vec![Wire { channel: 1, gain: -2.0 }, Wire { channel: 0, gain: 1000.0 }],
            inputs: vec![Wire { channel: 1, gain: -1.0 }, Wire { channel: 0, gain: 0.5 }],
            delay: 0,
        };
        let u = random_input(4, 300, 2);
        let given: Vec<Vec<f64>> =
            wiring.inputs.iter().map(|w| u[w.channel].iter().map(|x| w.gain * x).collect()).collect();
        let (plain, rewired) = (run(&model, &given), run(&wiring.applied(&model), &u));
        for (o, wire) in wiring.outputs.iter().enumerate() {
            for (a, b) in rewired[o].iter().zip(&plain[wire.channel]) {
                assert!((a - wire.gain * b).abs() < 1e-9 * wire.gain.abs());
            }
        }
        let applied = wiring.applied(&model);
        assert_eq!(applied.ports[0].input.as_deref(), Some("u2"));
        assert_eq!(applied.noise.sensor_std, Some(vec![0.01, 5.0]));
        assert_eq!(applied.noise.actuator_std, Some(vec![0.01, 0.005]));
        // On each side an exchange and a sign; two factors among the outputs, one among the inputs.
        assert_eq!(wiring.changes(0.05), 7);
    }

    #[test]
    fn what_is_alike_for_all_is_one_change() {
        let mut wiring = Wiring::plain(3, 3);
        assert_eq!(wiring.changes(0.05), 0);
        wiring.outputs.iter_mut().for_each(|wire| wire.gain = -1000.0);
        assert_eq!(wiring.changes(0.05), 2);
        wiring.outputs[1].gain = -1.0;
        assert_eq!(wiring.changes(0.05), 3);
    }

    #[test]
    fn inputs_are_delayed_either_way() {
        let mut record = crate::testing::case(&truss(1), &truss(1)).records.remove(1);
        let (u, samples) = (record.u[0].clone(), record.samples());
        let later = Wiring { delay: 32, ..Wiring::plain(2, 2) };
        later.delay_inputs(&mut record);
        assert_eq!((record.u[0].len(), record.samples()), (samples, samples));
        assert!(record.u[0][..32].iter().all(|u| *u == 0.0) && record.u[0][32..] == u[..samples - 32]);
        let earlier = Wiring { delay: -32, ..Wiring::plain(2, 2) };
        earlier.delay_inputs(&mut record);
        assert_eq!((record.u[0].len(), record.samples()), (samples - 32, samples - 32));
        assert!(record.u[0] == u[..samples - 32]);
    }
}
