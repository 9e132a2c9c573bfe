//! The methods that a study of expectations compares, and the number of runs.

use itertools::Itertools;
use plid_catalogue::CovarianceName;
use plid_core::{ImplicitModel, ObservableForm};
use plid_testbed::OUTPUTS;
use serde::{Deserialize, Serialize};

/// The full study, as in experiments/bench/expectations.toml.
pub const FULL: &str = include_str!("../../experiments/expectations.toml");
/// The study of at most five minutes, as in experiments/bench/expectations-quick.toml.
pub const QUICK: &str = include_str!("../../experiments/expectations-quick.toml");

/// A study of expectations. A cell is a plant, a signal-to-noise ratio and an assumed Sigma. All methods of a cell
/// process the same runs, and run k of a plant has the same random numbers in every cell.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Seed of the first run. Each further run increases it by one.
    pub seed: u64,
    /// RMS of the response to the input over RMS of all noise in the outputs.
    pub signal_to_noise: Vec<f64>,
    /// The share of the noise power that is due to state noise, for the scalar and the in-class plants. Sensors cause
    /// the rest.
    pub state_noise_share: f64,
    /// The covariance form.
    pub covariance: CovarianceName,
    /// The scalar plant.
    #[serde(default)]
    pub scalar: Vec<Scalar>,
    /// Plants of moderate order within the model class.
    #[serde(default)]
    pub in_class: Vec<InClass>,
    /// The truss, which has more states than any model in the study.
    #[serde(default)]
    pub truss: Vec<Truss>,
}

/// The scalar plant with parameters from the prior.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scalar {
    /// Number of plants and records.
    pub runs: usize,
    /// Number of samples of a record.
    pub steps: usize,
    /// Ratios of the assumed Sigma to the true one.
    pub told_sigma: Vec<f64>,
    /// Number of points of a grid for exact Bayes, and for the search for the largest likelihood.
    pub grid_points: usize,
}

/// Random plants of lightly damped modes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct InClass {
    /// Number of states n, a multiple of p, because the form with equal indices is unique.
    pub states: usize,
    /// Number of outputs p.
    pub outputs: usize,
    /// Number of inputs m.
    pub inputs: usize,
    /// Number of plants and records.
    pub runs: usize,
    /// Number of samples of a record.
    pub steps: usize,
    /// Ratios of the assumed Sigma to the true one.
    pub told_sigma: Vec<f64>,
    /// Standard deviation of the initial estimate of each parameter.
    pub initial_std: f64,
}

/// The truss identified with fewer states than it has. The correct Sigma is unknown, so several are tried.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Truss {
    /// Number of states n of the model, a multiple of three.
    pub states: usize,
    /// Number of records, each with another input and other noise.
    pub runs: usize,
    /// Length of a record in s.
    pub duration_s: f64,
    /// Length of the record used for scoring in s.
    pub held_out_s: f64,
    /// Ratios of the assumed Sigma to R.
    pub sigma_over_r: Vec<f64>,
    /// The ratio at which batch estimates are also computed; none by default.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub batch_at: Option<f64>,
}

type Problem = (&'static str, String);

fn positive(key: &'static str, values: &[f64]) -> Option<Problem> {
    let wrong = values.iter().find(|v| !(**v > 0.0 && v.is_finite()))?;
    Some((key, format!("{wrong} is not above zero")))
}

fn at_least(key: &'static str, value: usize, least: usize) -> Option<Problem> {
    (value < least).then(|| (key, format!("{value} is below {least}")))
}

fn not_empty<T>(key: &'static str, list: &[T]) -> Option<Problem> {
    list.is_empty().then(|| (key, "the list is empty".into()))
}

impl Config {
    /// Returns the invalid values, each as key and reason.
    pub fn problems(&self) -> Vec<Problem> {
        let mut all = vec![
            not_empty("signal_to_noise", &self.signal_to_noise),
            positive("signal_to_noise", &self.signal_to_noise),
        ];
        let share = self.state_noise_share;
        all.push((!(0.0..=1.0).contains(&share)).then(|| ("state_noise_share", format!("{share} is not from 0 to 1"))));
        // The names of plants are keys of cells, so they must be unique.
        let names: Vec<String> = self.plants().map(|plant| plant.name()).collect();
        all.push(names.iter().duplicates().next().map(|name| {
            (if name.starts_with("truss") { "truss" } else { "in_class" }, format!("{name} is listed twice"))
        }));
        for plant in &self.scalar {
            all.extend([
                at_least("runs", plant.runs, 2),
                at_least("steps", plant.steps, 3),
                not_empty("told_sigma", &plant.told_sigma),
                positive("told_sigma", &plant.told_sigma),
                at_least("grid_points", plant.grid_points, 20),
            ]);
        }
        for plant in &self.in_class {
            all.extend([
                at_least("runs", plant.runs, 2),
                at_least("steps", plant.steps, 3),
                not_empty("told_sigma", &plant.told_sigma),
                positive("told_sigma", &plant.told_sigma),
                positive("initial_std", &[plant.initial_std]),
                form("states", plant.states, plant.outputs, plant.inputs),
            ]);
        }
        for plant in &self.truss {
            all.extend([
                at_least("runs", plant.runs, 2),
                positive("duration_s", &[plant.duration_s]),
                positive("held_out_s", &[plant.held_out_s]),
                not_empty("sigma_over_r", &plant.sigma_over_r),
                positive("sigma_over_r", &plant.sigma_over_r),
                form("states", plant.states, OUTPUTS, OUTPUTS),
                plant
                    .batch_at
                    .filter(|at| !plant.sigma_over_r.contains(at))
                    .map(|at| ("batch_at", format!("{at} is not in sigma_over_r"))),
            ]);
        }
        all.into_iter().flatten().collect()
    }

    /// Returns all plants in the order in which they are studied.
    pub fn plants(&self) -> impl Iterator<Item = Plant<'_>> {
        let scalar = self.scalar.iter().map(Plant::Scalar);
        scalar.chain(self.in_class.iter().map(Plant::InClass)).chain(self.truss.iter().map(Plant::Truss))
    }
}

fn form(key: &'static str, states: usize, outputs: usize, inputs: usize) -> Option<Problem> {
    match ObservableForm::balanced(states, outputs, inputs) {
        Err(error) => Some((key, error.to_string())),
        Ok(form) if form.states() % outputs != 0 => {
            Some((key, format!("{states} is not a multiple of {outputs} outputs")))
        }
        Ok(_) => None,
    }
}

/// A plant of one of the three kinds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Plant<'a> {
    /// The scalar plant x+ = a x + b u.
    Scalar(&'a Scalar),
    /// A plant of moderate order in the model class.
    InClass(&'a InClass),
    /// The truss, which is not in the model class.
    Truss(&'a Truss),
}

impl Plant<'_> {
    /// Returns its name in files and reports.
    pub fn name(self) -> String {
        match self {
            Self::Scalar(_) => "scalar".into(),
            Self::InClass(InClass { states, outputs, inputs, initial_std, .. }) => {
                format!("in-class {states} ({outputs} x {inputs}, start {initial_std})")
            }
            Self::Truss(plant) => format!("truss {}", plant.states),
        }
    }

    /// Returns the settings of Sigma of its cells, as assumed over true values, or as Sigma / R for the truss.
    pub fn sigmas(self) -> Vec<f64> {
        match self {
            Self::Scalar(plant) => plant.told_sigma.clone(),
            Self::InClass(plant) => plant.told_sigma.clone(),
            Self::Truss(plant) => plant.sigma_over_r.clone(),
        }
    }

    /// Returns the number of runs of a cell.
    pub fn runs(self) -> usize {
        match self {
            Self::Scalar(plant) => plant.runs,
            Self::InClass(plant) => plant.runs,
            Self::Truss(plant) => plant.runs,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::from_toml_checked;

    #[test]
    fn the_built_in_configs_are_sound() {
        for text in [FULL, QUICK] {
            from_toml_checked(text, "built in", Config::problems).unwrap();
        }
    }

    #[test]
    fn what_is_wrong_is_named() {
        for (from, to, said) in [
            ("state_noise_share = 0.2", "state_noise_share = 1.2", "state_noise_share"),
            ("signal_to_noise = [", "signal_to_noise = [-1.0, ", "-1 is not above zero"),
            ("outputs = 2", "outputs = 3", "multiple"),
            ("grid_points = ", "grid_point = ", "grid_points"),
            ("batch_at = 0.001", "batch_at = 0.3", "not in sigma_over_r"),
        ] {
            assert!(QUICK.contains(from), "{from}");
            let error =
                from_toml_checked::<Config>(&QUICK.replacen(from, to, 1), "c.toml", Config::problems).unwrap_err();
            let whole = format!("{error} {error:?}");
            assert!(whole.contains(said) && error.to_string().starts_with("c.toml, line "), "{whole}");
        }
    }
}
