//! The keys of a stability study.

use itertools::Itertools;
use plid_catalogue::{CovarianceName, ExpectationName};
use plid_core::{ObservableForm, StructureError};
use plid_testbed::{INPUTS, OUTPUTS};
use serde::{Deserialize, Serialize};

use super::scenario::Scenario;

/// The full study, as in experiments/bench/stability.toml.
pub const FULL: &str = include_str!("../../experiments/stability.toml");
/// The study of about two minutes, as in experiments/bench/stability-quick.toml.
pub const QUICK: &str = include_str!("../../experiments/stability-quick.toml");

/// The study of `cargo bench -- stability`, as in experiments/bench/stability-bench.toml.
pub const BENCH: &str = include_str!("../../experiments/stability-bench.toml");

/// A stability study. The defaults are those of the full study.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// Numbers of states of the map.
    pub states: Vec<usize>,
    /// The covariance forms, by default all forms of the catalogue. The references for the others (Bierman UD and,
    /// with parameter noise, the direct form, in double precision) and the long run are always run.
    pub covariance: Vec<CovarianceName>,
    /// Number of steps of each cell of the map and of its variations.
    pub steps: usize,
    /// Limit on the number of entries of P multiplied by the steps of a run in double-double. The run ends at the
    /// last of the steps 1, 3, 10, 30 ... below this limit.
    pub reference_work: f64,
    /// The variations from the centre of the map, one at a time.
    pub variations: Variations,
    /// The long run of Bierman UD in single precision.
    pub long: Long,
    /// Difficult starts and difficult records.
    pub adversarial: Adversarial,
}

/// The variations from the centre, one at a time. The centre is the truss with the moment-matched expectation, P0 =
/// 1, the noise of the testbed and no parameter noise.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Variations {
    /// Numbers of states, which are multiples of 3 for the plant of the model's class.
    pub states: Vec<usize>,
    /// Conditional expectations.
    pub expectations: Vec<ExpectationName>,
    /// Variances added to the variance of each parameter at each step.
    pub parameter_noise: Vec<f64>,
    /// Sensor noise in V RMS. The outputs have 0.45 V RMS, and the sensor noise of the centre is 0.005 V.
    pub sensor_rms_v: Vec<f64>,
    /// P0, the initial variance of every entry of s.
    pub initial_variance: Vec<f64>,
    /// Whether a plant of the model's class is also identified, for NEES.
    pub in_class: bool,
}

/// One long run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Long {
    /// Number of states.
    pub states: usize,
    /// Number of steps; 0 for no such run.
    pub steps: usize,
}

/// Difficult starts and difficult records, from the same centre.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Adversarial {
    /// Number of states, a multiple of 3.
    pub states: usize,
    /// Number of steps of each cell; 0 for no cells.
    pub steps: usize,
    /// Values of P0 / R.
    pub start_ratios: Vec<f64>,
    /// Records, and plants that change.
    pub scenarios: Vec<Scenario>,
    /// Exponential forgetting factor for the wind-up and jump records. Its reciprocal must be short in binary, such
    /// as 1 + 2^-9, so that it is the same in all scalars.
    pub forgetting: f64,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            states: vec![12, 18, 24, 30, 36, 48, 64],
            covariance: CovarianceName::all(),
            steps: 100_000,
            reference_work: 6.1e8,
            variations: Variations::default(),
            long: Long::default(),
            adversarial: Adversarial::default(),
        }
    }
}

impl Default for Variations {
    fn default() -> Self {
        use ExpectationName as E;
        Self {
            states: vec![12, 24, 48],
            expectations: vec![E::Prior, E::Posterior, E::CertaintyEquivalent, E::JointEkf],
            parameter_noise: vec![1e-12, 1e-10, 1e-9, 1e-8, 1e-6],
            sensor_rms_v: vec![0.15],
            initial_variance: vec![1e-2, 1e4],
            in_class: true,
        }
    }
}

impl Default for Long {
    fn default() -> Self {
        Self { states: 24, steps: 1_000_000 }
    }
}

impl Default for Adversarial {
    fn default() -> Self {
        Self {
            states: 24,
            steps: 10_000,
            start_ratios: vec![1.0, 1e4, 1e8, 1e12, 1e16],
            scenarios: Scenario::HARD.to_vec(),
            forgetting: 1.0 / (1.0 + 1.0 / 512.0),
        }
    }
}

impl Config {
    /// Returns the invalid values, each as key and reason.
    pub fn problems(&self) -> Vec<(&'static str, String)> {
        let mut problems = Vec::new();
        let mut check = |key: &'static str, states: usize, equal: bool| {
            let form: Result<_, StructureError> = ObservableForm::balanced(states, OUTPUTS, INPUTS);
            match form {
                Err(error) => problems.push((key, error.to_string())),
                Ok(_) if equal && !states.is_multiple_of(OUTPUTS) => {
                    problems.push((key, format!("{states} is not a multiple of {OUTPUTS}")));
                }
                Ok(_) => {}
            }
        };
        self.states.iter().for_each(|&n| check("states", n, false));
        self.variations.states.iter().for_each(|&n| check("variations", n, self.variations.in_class));
        check("adversarial", self.adversarial.states, true);
        check("long", self.long.states, false);
        let mut positive = |key: &'static str, values: &[f64]| {
            let bad = values.iter().find(|&&x| !(x > 0.0 && x.is_finite()));
            problems.extend(bad.map(|x| (key, format!("{x} is not above 0"))));
        };
        positive("reference_work", &[self.reference_work]);
        positive("parameter_noise", &self.variations.parameter_noise);
        positive("sensor_rms_v", &self.variations.sensor_rms_v);
        positive("initial_variance", &self.variations.initial_variance);
        positive("start_ratios", &self.adversarial.start_ratios);
        if !(self.adversarial.forgetting > 0.0 && self.adversarial.forgetting <= 1.0) {
            problems.push(("forgetting", format!("{} is not above 0 and at most 1", self.adversarial.forgetting)));
        }
        if !self.covariance.iter().all_unique() {
            problems.push(("covariance", "an entry occurs twice".into()));
        }
        if self.steps == 0 {
            problems.push(("steps", "a cell needs at least one step".into()));
        }
        problems
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_configs_that_are_built_in_are_read() {
        let read = |text| crate::study::from_toml_checked::<Config>(text, "built in", Config::problems).unwrap();
        assert_eq!(read(FULL), Config::default());
        let quick = read(QUICK);
        assert_eq!((quick.steps, quick.states, quick.long), (10_000, Config::default().states, Long::default()));
    }

    #[test]
    fn impossible_values_are_named() {
        let mut config = Config::default();
        config.variations.states = vec![64];
        config.steps = 0;
        config.adversarial.start_ratios = vec![-1.0];
        let keys: Vec<&str> = config.problems().iter().map(|p| p.0).collect();
        assert_eq!(keys, ["variations", "start_ratios", "steps"]);
    }
}
