//! The config of a speed study: the cells that it measures, and for how long.

use itertools::iproduct;
use plid_catalogue::{BackendName, CovarianceName, ExpectationName, ScalarName, Variant};
use serde::{Deserialize, Serialize};

use super::cell::Cell;
use crate::Noise;

/// The full study, as in experiments/bench/speed.toml.
pub const FULL: &str = include_str!("../../experiments/speed.toml");
/// The study of about two minutes, as in experiments/bench/speed-quick.toml.
pub const QUICK: &str = include_str!("../../experiments/speed-quick.toml");

/// A speed study.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Number of rounds over all cells, so that a drift of the machine affects all of them equally.
    pub rounds: usize,
    /// Smallest total time of the steps of a visit, in ms.
    pub visit_ms: f64,
    /// Smallest number of steps over all rounds, for the percentiles.
    pub steps: usize,
    /// Number of steps before the timed ones of each visit.
    pub warm_up: usize,
    /// The logical cores used, by the numbers of the system; by default the last ones. The first of them measures.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cores: Option<Vec<usize>>,
    /// Products of axes; a cell in several of them is measured once.
    pub cross: Vec<Cross>,
}

/// Every combination of the listed values is a cell.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Cross {
    /// Numbers of states n.
    pub states: Vec<usize>,
    /// Numbers of inputs m, with three outputs.
    #[serde(default = "three_inputs")]
    pub inputs: Vec<usize>,
    /// Covariance forms.
    pub covariance: Vec<CovarianceName>,
    /// Conditional expectations.
    pub expectations: Vec<ExpectationName>,
    /// Matrix libraries.
    #[serde(default = "plain")]
    pub backend: Vec<BackendName>,
    /// Number types.
    #[serde(default = "f64")]
    pub scalar: Vec<ScalarName>,
    /// Numbers of threads.
    #[serde(default = "one_thread")]
    pub threads: Vec<usize>,
    /// Shapes of the noise covariances: R and Q are diagonal, or all covariances are full.
    #[serde(default = "diagonal")]
    pub noise: Vec<Noise>,
}

fn three_inputs() -> Vec<usize> {
    vec![3]
}

fn plain() -> Vec<BackendName> {
    vec![BackendName::Plain]
}

fn f64() -> Vec<ScalarName> {
    vec![ScalarName::F64]
}

fn one_thread() -> Vec<usize> {
    vec![1]
}

fn diagonal() -> Vec<Noise> {
    vec![Noise::Diagonal]
}

impl Config {
    /// Returns the invalid values, each as key and reason.
    pub fn problems(&self) -> Vec<(&'static str, String)> {
        let mut problems = Vec::new();
        let at_least = |key: &'static str, value: usize, least: usize| {
            (value < least).then(|| (key, format!("{value} is less than {least}")))
        };
        problems.extend(at_least("rounds", self.rounds, 1));
        problems.extend(at_least("steps", self.steps, 1));
        // The first step differs from the others, because nothing is known yet.
        problems.extend(at_least("warm_up", self.warm_up, 1));
        if !(self.visit_ms >= 0.0 && self.visit_ms.is_finite()) {
            problems.push(("visit_ms", format!("{} is not 0 or above", self.visit_ms)));
        }
        if self.cores.as_ref().is_some_and(Vec::is_empty) {
            problems.push(("cores", "name at least one, or omit the key".into()));
        }
        for cross in &self.cross {
            problems.extend(cross.states.iter().find_map(|&n| at_least("states", n, super::cell::OUTPUTS)));
            if let Some(m) = cross.inputs.iter().find(|m| !(1..=3).contains(*m)) {
                problems.push(("inputs", format!("{m} is not 1, 2 or 3, the truss's")));
            }
            problems.extend(cross.threads.iter().find_map(|&t| at_least("threads", t, 1)));
            if let Some(cores) = &self.cores
                && let Some(threads) = cross.threads.iter().find(|&&t| t > cores.len())
            {
                problems.push(("threads", format!("{threads} threads, but {} of `cores`", cores.len())));
            }
            if let Some(threads) = cross.threads.iter().find(|&&t| t > 2) {
                problems.push(("threads", format!("{threads}; a step can use at most two")));
            }
            if cross.threads.iter().any(|&t| t > 1) && cross.backend != [BackendName::Plain] {
                problems.push(("threads", "two threads need backend = [\"plain\"]".into()));
            }
            if cross.backend.contains(&BackendName::TwoThreads) {
                problems.push(("backend", "two threads are asked for by `threads = [2]`".into()));
            }
            if cross.scalar.contains(&ScalarName::DoubleDouble) && cross.backend != [BackendName::Plain] {
                problems.push(("scalar", "double-double needs backend = [\"plain\"]".into()));
            }
        }
        if problems.is_empty() && self.cells().is_empty() {
            problems.push(("cross", "there is no cell to measure".into()));
        }
        problems
    }

    /// Returns all cells, each once, in the order of the config.
    pub fn cells(&self) -> Vec<Cell> {
        let mut cells = Vec::new();
        for cross in &self.cross {
            for cell in cross.cells() {
                if !cells.contains(&cell) {
                    cells.push(cell);
                }
            }
        }
        cells
    }

    /// Returns the largest number of threads of a cell.
    pub fn threads(&self) -> usize {
        self.cross.iter().flat_map(|cross| &cross.threads).copied().max().unwrap_or(1)
    }

    /// Returns the smallest number of steps of a visit.
    pub fn steps_a_visit(&self) -> usize {
        self.steps.div_ceil(self.rounds)
    }
}

impl Cross {
    fn cells(&self) -> impl Iterator<Item = Cell> {
        iproduct!(
            &self.states,
            &self.inputs,
            &self.covariance,
            &self.expectations,
            &self.backend,
            &self.scalar,
            &self.threads,
            &self.noise
        )
        .map(|(&states, &inputs, &covariance, &expectations, &backend, &scalar, &threads, &noise)| {
            let variant = Variant { covariance, expectations, backend, scalar };
            Cell { states, inputs, noise, threads, variant }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::{ConfigError, from_toml_checked};

    fn read(text: &str) -> Result<Config, ConfigError> {
        from_toml_checked(text, "speed.toml", Config::problems)
    }

    const HEAD: &str = "rounds = 2\nvisit_ms = 1.0\nsteps = 10\nwarm_up = 1\n";
    const CROSS: &str = "[[cross]]\nstates = [12, 18]\ncovariance = [\"direct\"]\nexpectations = [\"prior\"]\n";

    #[test]
    fn cells_of_several_products_are_measured_once() {
        let config = read(&format!("{HEAD}{CROSS}{CROSS}scalar = [\"f64\", \"f32\"]\nthreads = [1, 2]\n")).unwrap();
        assert_eq!(config.cells().len(), 8);
        assert_eq!(config.threads(), 2);
    }

    #[test]
    fn the_built_in_studies_are_sound_and_the_quick_one_is_part_of_the_full_one() {
        let (full, quick) = (read(FULL).unwrap().cells(), read(QUICK).unwrap().cells());
        assert!(quick.len() < full.len() && quick.iter().all(|cell| full.contains(cell)));
    }

    #[test]
    fn what_is_wrong_is_named_with_its_line() {
        for (text, said) in [
            (format!("{HEAD}{CROSS}treads = [1]\n"), "line 9: unknown field `treads`"),
            (format!("{HEAD}{CROSS}threads = [0]\n"), "line 9: threads: 0 is less than 1"),
            (format!("{HEAD}cores = [1]\n{CROSS}threads = [2]\n"), "line 10: threads: 2 threads"),
            (format!("{HEAD}{CROSS}inputs = [4]\n"), "line 9: inputs: 4"),
            (format!("{HEAD}{CROSS}threads = [3]\n"), "line 9: threads: 3; a step can use at most two"),
            (format!("{HEAD}{CROSS}backend = [\"two-threads\"]\n"), "line 9: backend: two threads"),
            (format!("{HEAD}{CROSS}backend = [\"faer\"]\nscalar = [\"double-double\"]\n"), "line 10: scalar"),
            (format!("{HEAD}{CROSS}").replace("12", "2"), "line 6: states: 2 is less than 3"),
            (format!("{HEAD}{CROSS}").replace("warm_up = 1", "warm_up = 0"), "line 4: warm_up"),
            (format!("{HEAD}{CROSS}").replace("12, 18", ""), "cross: there is no cell"),
        ] {
            let message = read(&text).unwrap_err().to_string();
            assert!(message.contains(said), "{message}");
        }
    }
}
