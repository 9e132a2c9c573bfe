//! The course of a slow change in time.

use serde::{Deserialize, Serialize};

use crate::config::positive;
use crate::effects::family::{Halves, Shape};
use crate::effects::written::Laws;
use crate::error::TestbedError;

/// The course of a slow change in time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum Course {
    /// Proportional to t.
    #[default]
    Linear,
    /// Proportional to T (1 - exp(-t / T)), which has the same slope at first and then settles.
    Settling {
        /// T, s; positive.
        time_s: f64,
    },
}

impl Laws for Course {
    /// Small parts warm up in seconds, a structure in minutes. Six full records of a structure take 26 s. With the
    /// shortest times, the change has almost settled before half of these records; with the longest, it still
    /// continues at the end.
    const SHAPES: &'static [Shape] = &[Shape {
        law: "settling",
        number: "time_s",
        fixed: 10.0,
        ranges: Halves { development: &[[7.0, 14.0]], reported: &[[3.0, 5.5], [18.0, 30.0]] },
    }];
}

impl Course {
    pub(crate) fn at(self, t_s: f64) -> f64 {
        match self {
            Self::Linear => t_s,
            Self::Settling { time_s } => time_s * (1.0 - (-t_s / time_s).exp()),
        }
    }

    pub(crate) fn check(self) -> Result<(), TestbedError> {
        match self {
            Self::Linear => Ok(()),
            Self::Settling { time_s } => positive("law.time_s", time_s),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_change_that_settles_late_is_linear_and_one_that_settles_early_is_a_step() {
        for t in [0.0, 0.4, 26.0] {
            assert!((Course::Settling { time_s: 1e8 }.at(t) - t).abs() < 1e-5, "{t}");
        }
        assert!((Course::Settling { time_s: 0.01 }.at(3.0) - 0.01).abs() < 1e-12);
    }
}
