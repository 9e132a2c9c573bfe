//! The truss's record, what the filters start from, and the file that tells Python of both.

use std::error::Error;
use std::path::Path;

use ndarray::{Array2, ArrayView1, ArrayView2};
use ndarray_npy::write_npy;
use plid_bench::Workload;
use plid_core::{ImplicitModel, InitialCovariance};
use serde_json::json;

/// Inputs and outputs of the truss.
pub const CHANNELS: usize = 3;
/// Seconds of the record; 1600 samples each.
const DURATION_S: f64 = 2.0;

/// All that a filter has to know: s_0, P_0, the noise, and the record.
#[derive(Clone, Debug)]
pub struct Case {
    /// What plid is given.
    pub workload: Workload,
    /// n
    pub states: usize,
    /// N = (p + m + 1) n
    pub joint: usize,
    /// For each output the state that it reads.
    pub rows: Vec<usize>,
    /// For each state the one that J shifts into it.
    pub shift: Vec<Option<usize>>,
    /// R's diagonal.
    pub sensor: Vec<f64>,
    /// Q's diagonal.
    pub actuator: Vec<f64>,
    /// Sigma's diagonal.
    pub state: Vec<f64>,
    /// P_0's diagonal.
    pub variances: Vec<f64>,
}

impl Case {
    /// The truss identified with `states` states.
    pub fn truss(states: usize) -> Result<Self, Box<dyn Error>> {
        let workload = Workload::truss(states, DURATION_S)?;
        let diagonal = |matrix: &plid_core::Dense<f64>| (0..matrix.rows()).map(|i| matrix.at(i, i)).collect();
        let InitialCovariance::Diagonal(variances) = workload.settings.initial_covariance.clone() else {
            return Err("the peers are fed a diagonal P0".into());
        };
        Ok(Self {
            states,
            joint: workload.form.joint_states(),
            rows: workload.form.output_states().to_vec(),
            shift: (0..states).map(|i| workload.form.shift_source(i)).collect(),
            sensor: diagonal(&workload.noise.sensor),
            actuator: diagonal(&workload.noise.actuator),
            state: diagonal(&workload.noise.state),
            variances,
            workload,
        })
    }

    /// Sample `k`, counted on over the record's end: outputs and inputs.
    pub fn sample(&self, k: usize) -> (&[f64; CHANNELS], &[f64; CHANNELS]) {
        let k = k % self.workload.inputs.len();
        (&self.workload.outputs[k], &self.workload.inputs[k])
    }

    /// Writes case.json and the arrays beside it.
    pub fn export(&self, directory: &Path) -> Result<(), Box<dyn Error>> {
        std::fs::create_dir_all(directory)?;
        let record =
            |samples: &[[f64; CHANNELS]]| Array2::from_shape_fn((samples.len(), CHANNELS), |(k, i)| samples[k][i]);
        let case = json!({
            "states": self.states,
            "joint_states": self.joint,
            "inputs": CHANNELS,
            "outputs": CHANNELS,
            "indices": self.workload.form.indices(),
            "output_states": self.rows,
            "shift_source": self.shift,
            "sensor": self.sensor,
            "actuator": self.actuator,
            "state": self.state,
            "initial_estimate": self.workload.settings.initial_estimate,
            "initial_variances": self.variances,
        });
        std::fs::write(directory.join("case.json"), serde_json::to_string_pretty(&case)?)?;
        write_npy(directory.join("inputs.npy"), &record(&self.workload.inputs))?;
        write_npy(directory.join("outputs.npy"), &record(&self.workload.outputs))?;
        Ok(())
    }
}

/// Writes an estimate and its covariance (column-major, N x N) as NAME.s.npy and NAME.p.npy.
pub fn write_estimate(directory: &Path, name: &str, s: &[f64], p: &[f64]) -> Result<(), Box<dyn Error>> {
    write_npy(directory.join(format!("{name}.s.npy")), &ArrayView1::from(s))?;
    write_npy(directory.join(format!("{name}.p.npy")), &ArrayView2::from_shape((s.len(), s.len()), p)?.t())?;
    Ok(())
}
