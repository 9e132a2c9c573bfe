//! The cells of the study, whose steps are timed.

use plid_catalogue::{BackendName, CovarianceName, ExpectationName, ScalarName, Variant};
use plid_core::StepSize;
use serde::{Deserialize, Serialize};

use crate::Noise;

/// The number of outputs of every cell, which is that of the truss.
pub const OUTPUTS: usize = plid_testbed::OUTPUTS;

/// A recursion whose steps are timed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Cell {
    /// The number of states n.
    pub states: usize,
    /// The number of inputs m.
    pub inputs: usize,
    /// The shape of the noise covariances.
    pub noise: Noise,
    /// The number of threads.
    pub threads: usize,
    /// The recursion's types.
    #[serde(flatten)]
    pub variant: Variant,
}

impl Cell {
    /// Returns the cell with three inputs and three outputs, f64, plain loops, one thread and diagonal noise.
    pub fn plain(states: usize, covariance: CovarianceName, expectations: ExpectationName) -> Self {
        let variant = Variant { covariance, expectations, ..Variant::default() };
        Self { states, inputs: 3, noise: Noise::Diagonal, threads: 1, variant }
    }

    /// Whether the cell is in f64 on plain loops and one thread.
    pub fn is_plain(&self) -> bool {
        let Variant { backend, scalar, .. } = self.variant;
        (backend, scalar, self.threads) == (BackendName::Plain, ScalarName::F64, 1)
    }

    /// Returns the recursion's types, with the backend for this number of threads.
    pub fn threaded(&self) -> Variant {
        let backend = if self.threads > 1 { BackendName::TwoThreads } else { self.variant.backend };
        Variant { backend, ..self.variant }
    }

    /// Returns N = (p + m + 1) n.
    pub fn joint_states(&self) -> usize {
        (OUTPUTS + self.inputs + 1) * self.states
    }

    /// Returns the sizes on which its operations depend.
    pub fn size(&self) -> StepSize {
        let (n, p, m) = (self.states as f64, OUTPUTS as f64, self.inputs as f64);
        StepSize { n, p, m, full_noise: self.noise == Noise::Full }
    }

    /// Returns the name of its operations, which do not depend on the library, the scalar or the threads.
    pub fn operations_key(&self) -> String {
        let Variant { covariance, expectations, .. } = self.variant;
        let (form, expectation, noise) = (word(&covariance), word(&expectations), word(&self.noise));
        format!("operations n={} {}x{OUTPUTS} {form} {expectation} noise={noise}", self.states, self.inputs)
    }

    /// Returns the name by which cells of different runs are compared.
    pub fn key(&self) -> String {
        let Variant { covariance, expectations, backend, scalar, .. } = self.variant;
        format!(
            "n={} {}x{OUTPUTS} {} {} {} {} threads={} noise={}",
            self.states,
            self.inputs,
            word(&covariance),
            word(&expectations),
            word(&backend),
            word(&scalar),
            self.threads,
            word(&self.noise)
        )
    }
}

/// Returns the size of a scalar in bytes.
pub fn scalar_bytes(scalar: ScalarName) -> usize {
    match scalar {
        ScalarName::F32 => 4,
        ScalarName::F64 => 8,
        ScalarName::DoubleDouble => 16,
    }
}

/// Returns all conditional expectations in the order of the operations that they need.
pub fn expectations() -> Vec<ExpectationName> {
    let flops = |expectations: ExpectationName| -> f64 {
        let cell = Cell::plain(24, CovarianceName::default(), expectations);
        cell.variant.flops(&cell.size()).iter().map(|term| term.flops).sum()
    };
    let mut all = ExpectationName::all();
    all.sort_by(|&x, &y| flops(x).total_cmp(&flops(y)));
    all
}

/// Returns the name of a value in a config.
pub fn word(name: &impl Serialize) -> String {
    match serde_json::to_value(name) {
        Ok(serde_json::Value::String(word)) => word,
        other => unreachable!("names are words, not {other:?}"),
    }
}
