//! The truss's record, what the filters start from, and the file that tells Python of both.

use std::error::Error;
use std::path::Path;

use ndarray::{Array2, ArrayView1, ArrayView2};
use ndarray_npy::write_npy;
use plid_core::{ImplicitModel, NoiseModel, ObservableForm, Settings};
use plid_testbed::{INPUTS, OUTPUTS, TrussConfig, simulate};
use serde_json::json;

/// Inputs and outputs of the truss.
pub const CHANNELS: usize = 3;
const _: () = assert!(INPUTS == CHANNELS && OUTPUTS == CHANNELS);
/// Seconds of the record; 1600 samples each.
const DURATION_S: f64 = 2.0;
/// Sigma's diagonal.
const STATE_NOISE: f64 = 1e-6;

/// All that a filter has to know: s_0, P_0, the noise, and the record.
#[derive(Clone, Debug)]
pub struct Case {
    /// The canonical form.
    pub form: ObservableForm,
    /// The covariances below, as plid takes them.
    pub noise: NoiseModel,
    /// s_0 and P_0, as plid takes them.
    pub settings: Settings,
    /// n
    pub states: usize,
    /// N = (p + m + 1) n
    pub joint: usize,
    /// For each output the state that it reads.
    pub rows: Vec<usize>,
    /// For each state the one that J shifts into it.
    pub shift: Vec<Option<usize>>,
    /// R's diagonal: the truss's.
    pub sensor: Vec<f64>,
    /// Q's diagonal: the truss's.
    pub actuator: Vec<f64>,
    /// Sigma's diagonal.
    pub state: Vec<f64>,
    /// P_0, N x N.
    pub covariance: Vec<f64>,
    outputs: Vec<[f64; CHANNELS]>,
    inputs: Vec<[f64; CHANNELS]>,
}

impl Case {
    /// The default truss identified with `states` states, from s_0 = 0 and P_0 = I.
    pub fn truss(states: usize) -> Result<Self, Box<dyn Error>> {
        let simulation = simulate(&TrussConfig { duration_s: DURATION_S, ..TrussConfig::default() })?;
        let form = ObservableForm::balanced(states, CHANNELS, CHANNELS)?;
        let joint = form.joint_states();
        let sensor = simulation.truth.noise.sensor.diagonal().as_slice().to_vec();
        let actuator = simulation.truth.noise.actuator.diagonal().as_slice().to_vec();
        let state = vec![STATE_NOISE; states];
        let samples = |record: &Array2<f64>| {
            record.rows().into_iter().map(|row| std::array::from_fn(|channel| row[channel])).collect()
        };
        Ok(Self {
            noise: NoiseModel::diagonal(&sensor, &actuator, &state),
            settings: Settings::new(&form, 1.0, 1.0),
            states,
            joint,
            rows: form.output_states().to_vec(),
            shift: (0..states).map(|i| form.shift_source(i)).collect(),
            sensor,
            actuator,
            state,
            covariance: (0..joint * joint).map(|k| if k % joint == k / joint { 1.0 } else { 0.0 }).collect(),
            outputs: samples(&simulation.outputs[0]),
            inputs: samples(&simulation.commands),
            form,
        })
    }

    /// Sample `k`, counted on over the record's end: outputs and inputs.
    pub fn sample(&self, k: usize) -> (&[f64; CHANNELS], &[f64; CHANNELS]) {
        let k = k % self.inputs.len();
        (&self.outputs[k], &self.inputs[k])
    }

    /// Writes case.json and, next to it, the arrays.
    pub fn export(&self, directory: &Path) -> Result<(), Box<dyn Error>> {
        std::fs::create_dir_all(directory)?;
        let record =
            |samples: &[[f64; CHANNELS]]| Array2::from_shape_fn((samples.len(), CHANNELS), |(k, i)| samples[k][i]);
        let case = json!({
            "states": self.states,
            "joint_states": self.joint,
            "inputs": CHANNELS,
            "outputs": CHANNELS,
            "indices": self.form.indices(),
            "output_states": self.rows,
            "shift_source": self.shift,
            "sensor": self.sensor,
            "actuator": self.actuator,
            "state": self.state,
            "initial_estimate": self.settings.initial_estimate,
            "initial_variances": vec![1.0; self.joint],
        });
        std::fs::write(directory.join("case.json"), serde_json::to_string_pretty(&case)?)?;
        write_npy(directory.join("inputs.npy"), &record(&self.inputs))?;
        write_npy(directory.join("outputs.npy"), &record(&self.outputs))?;
        Ok(())
    }
}

/// Writes an estimate and its covariance (column-major, N x N) as NAME.s.npy and NAME.p.npy.
pub fn write_estimate(directory: &Path, name: &str, s: &[f64], p: &[f64]) -> Result<(), Box<dyn Error>> {
    write_npy(directory.join(format!("{name}.s.npy")), &ArrayView1::from(s))?;
    write_npy(directory.join(format!("{name}.p.npy")), &ArrayView2::from_shape((s.len(), s.len()), p)?.t())?;
    Ok(())
}
