//! What is timed.

use plid_lab::variant::{CovarianceName, ScalarName, Variant};
use serde::{Deserialize, Serialize};

/// The number of outputs of every cell, the truss's.
pub const OUTPUTS: usize = plid_testbed::OUTPUTS;

/// The shape of the noise covariances.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Noise {
    /// R, Q and Sigma diagonal, no covariances between them.
    Diagonal,
    /// None of the six has a zero.
    Full,
}

/// A recursion of which steps are timed.
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
    /// N = (p + m + 1) n.
    pub fn joint_states(&self) -> usize {
        (OUTPUTS + self.inputs + 1) * self.states
    }

    /// The scalar's size in bytes.
    pub fn scalar_bytes(&self) -> usize {
        match self.variant.scalar {
            ScalarName::F32 => 4,
            ScalarName::F64 => 8,
            ScalarName::DoubleDouble => 16,
        }
    }

    /// The name by which cells of different runs are compared.
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

/// All covariance forms, in the order of the report.
pub const FORMS: [CovarianceName; 4] =
    [CovarianceName::Direct, CovarianceName::Joseph, CovarianceName::BiermanUd, CovarianceName::ArraySqrt];

/// The word by which a config names a value.
pub fn word(name: &impl Serialize) -> String {
    match serde_json::to_value(name) {
        Ok(serde_json::Value::String(word)) => word,
        other => unreachable!("names are words, not {other:?}"),
    }
}
