//! The groups of cells described by a config.

use plid_catalogue::{CovarianceName, ExpectationName, ScalarName};
use plid_testbed::{INPUTS, OUTPUTS};
use serde::{Deserialize, Serialize};

use super::config::Config;
use super::scenario::Scenario;

/// The part of the study to which a group belongs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Part {
    /// The centre of the study, for every number of states.
    Map,
    /// One setting that differs from the centre.
    Variation,
    /// A difficult start or record.
    Adversarial,
    /// The long run.
    Long,
}

/// Cells that share a problem and therefore a reference. They differ only in form and scalar.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Group {
    /// The part of the study.
    pub part: Part,
    /// The deviation from the centre in words.
    pub label: String,
    /// The source of the data.
    pub scenario: Scenario,
    /// Number of states n.
    pub states: usize,
    /// Requested number of steps.
    pub steps: usize,
    /// The conditional expectation.
    pub expectations: ExpectationName,
    /// Variance added to that of each parameter at each step.
    pub parameter_noise: f64,
    /// P0, relative to R if `start_over_sensor` is true.
    pub initial_variance: f64,
    /// Whether P0 is relative to R.
    pub start_over_sensor: bool,
    /// Exponential forgetting factor.
    pub forgetting: f64,
    /// Number of steps in double-double.
    pub reference_steps: usize,
    /// The step after which frequency responses are compared.
    pub compared_at: usize,
}

/// The step at which the long run is compared with double precision.
const COMPARED_AT: usize = 100_000;
/// The form with which others are compared.
pub const FACTORED_PEER: CovarianceName = CovarianceName::BiermanUd;
/// The form that stores P itself, with which such forms are compared if there is parameter noise.
pub const MATRIX_PEER: CovarianceName = CovarianceName::Direct;
/// The scalars that are judged.
pub const SCALARS: [ScalarName; 2] = [ScalarName::F32, ScalarName::F64];

impl Group {
    /// Returns the name in the journal, the CSV and messages.
    pub fn key(&self) -> String {
        let part = match self.part {
            Part::Map => "map",
            Part::Variation => "variation",
            Part::Adversarial => "adversarial",
            Part::Long => "long",
        };
        format!("{part}, {}, n = {}", self.label, self.states)
    }

    /// Returns the form in f64 with which a form is compared, which is usually a factored one. Parameter noise enters
    /// a matrix and a factor in different ways, so their filters differ. With parameter noise, a matrix form is
    /// compared with the direct form instead.
    pub fn peer_of(&self, form: CovarianceName) -> CovarianceName {
        if self.parameter_noise > 0.0 && !form.is_factored() { MATRIX_PEER } else { FACTORED_PEER }
    }

    /// Returns the forms with which cells are compared.
    pub fn peers(&self) -> Vec<CovarianceName> {
        let mut peers = vec![FACTORED_PEER];
        peers.extend((self.parameter_noise > 0.0).then_some(MATRIX_PEER));
        peers
    }

    /// Returns the forms whose references in double-double the group needs. Without parameter noise, one reference
    /// serves all forms; it is that of a matrix form, which is much faster in double-double.
    pub fn references(&self) -> Vec<CovarianceName> {
        let mut references = vec![MATRIX_PEER];
        references.extend((self.parameter_noise > 0.0).then_some(FACTORED_PEER));
        references
    }

    /// Returns the number of steps of a cell. In the long run, only single precision takes all steps; double
    /// precision is the reference.
    pub fn steps_of(&self, scalar: ScalarName) -> usize {
        if self.part == Part::Long && scalar == ScalarName::F64 { self.compared_at } else { self.steps }
    }

    /// Returns the joint number of states and parameters N.
    pub fn joint_states(&self) -> usize {
        self.states * (1 + INPUTS + OUTPUTS)
    }
}

/// Returns the steps 1, 3, 10, 30 ... up to `last`.
pub fn one_three(last: usize) -> Vec<usize> {
    let decades = (0..9).map(|k| 10_usize.pow(k));
    decades.flat_map(|decade| [decade, 3 * decade]).take_while(|&step| step <= last).collect()
}

impl Config {
    /// Returns form and scalar of each cell of a group.
    pub fn cells(&self, group: &Group) -> Vec<(CovarianceName, ScalarName)> {
        let both = |form: CovarianceName| SCALARS.map(|scalar| (form, scalar));
        if group.part == Part::Long {
            return both(FACTORED_PEER).to_vec();
        }
        let peers = group.peers().into_iter().filter(|peer| !self.covariance.contains(peer));
        let peers = peers.map(|peer| (peer, ScalarName::F64));
        self.covariance.iter().copied().flat_map(both).chain(peers).collect()
    }

    /// Returns the groups with the longest first, so that all threads finish at about the same time.
    pub fn groups(&self) -> Vec<Group> {
        let mut groups = self.groups_in_order();
        groups.sort_by_key(|group| std::cmp::Reverse(group.steps * group.states.pow(2) * self.cells(group).len()));
        groups
    }

    /// Returns the groups in the order of the config.
    pub fn groups_in_order(&self) -> Vec<Group> {
        let mut groups: Vec<Group> = self.states.iter().map(|&n| self.centre(n)).collect();
        for &n in &self.variations.states {
            groups.extend(self.varied(n));
        }
        groups.extend(self.hard());
        if self.long.steps > 0 {
            let steps = self.long.steps;
            let label = format!("{steps} steps");
            let compared_at = steps.min(COMPARED_AT);
            groups.push(Group { part: Part::Long, label, steps, compared_at, ..self.centre(self.long.states) });
        }
        groups
    }

    fn centre(&self, states: usize) -> Group {
        let mut group = Group {
            part: Part::Map,
            label: "centre".into(),
            scenario: Scenario::Truss,
            states,
            steps: self.steps,
            expectations: ExpectationName::MomentMatched,
            parameter_noise: 0.0,
            initial_variance: 1.0,
            start_over_sensor: false,
            forgetting: 1.0,
            reference_steps: 0,
            compared_at: self.steps,
        };
        let most = self.reference_work / (group.joint_states() as f64).powi(2);
        group.reference_steps = one_three(self.steps.min(most as usize)).last().copied().unwrap_or(0);
        group
    }

    fn varied(&self, states: usize) -> Vec<Group> {
        let vary = &self.variations;
        let centre = Group { part: Part::Variation, ..self.centre(states) };
        let mut groups = Vec::new();
        for &expectations in &vary.expectations {
            groups.push(Group { label: word(&expectations), expectations, ..centre.clone() });
        }
        for &parameter_noise in &vary.parameter_noise {
            let label = format!("parameter noise {parameter_noise:e}");
            groups.push(Group { label, parameter_noise, ..centre.clone() });
        }
        for &sensor_rms_v in &vary.sensor_rms_v {
            let scenario = Scenario::TrussWithSensorNoise(sensor_rms_v);
            groups.push(Group { label: format!("sensor noise {sensor_rms_v} V"), scenario, ..centre.clone() });
        }
        for &initial_variance in &vary.initial_variance {
            groups.push(Group { label: format!("P0 = {initial_variance:e}"), initial_variance, ..centre.clone() });
        }
        if vary.in_class {
            groups.push(Group { label: "plant in class".into(), scenario: Scenario::InClass, ..centre });
        }
        groups
    }

    fn hard(&self) -> Vec<Group> {
        let hard = &self.adversarial;
        if hard.steps == 0 {
            return Vec::new();
        }
        let mut centre = self.centre(hard.states);
        centre = Group {
            part: Part::Adversarial,
            steps: hard.steps,
            compared_at: hard.steps,
            reference_steps: centre.reference_steps.min(hard.steps),
            ..centre
        };
        let starts = hard.start_ratios.iter().map(|&initial_variance| Group {
            label: format!("P0/R = {initial_variance:e}"),
            initial_variance,
            start_over_sensor: true,
            ..centre.clone()
        });
        let records = hard.scenarios.iter().map(|&scenario| Group {
            label: scenario.name().into(),
            scenario,
            forgetting: if scenario.needs_forgetting() { hard.forgetting } else { 1.0 },
            ..centre.clone()
        });
        starts.chain(records).collect()
    }
}

/// Returns the name of a value in a config.
pub fn word<T: Serialize>(value: &T) -> String {
    match serde_json::to_value(value) {
        Ok(serde_json::Value::String(word)) => word,
        _ => String::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn the_full_study_has_every_form_scalar_and_size_and_no_key_twice() {
        let config = Config::default();
        let groups = config.groups();
        let keys: BTreeSet<String> = groups.iter().map(Group::key).collect();
        assert_eq!(keys.len(), groups.len());
        let map: Vec<&Group> = groups.iter().filter(|g| g.part == Part::Map).collect();
        assert_eq!(map.len(), 7);
        assert!(map.iter().all(|g| config.cells(g).len() == 8 && g.steps == 100_000));
        let long = groups.iter().find(|g| g.part == Part::Long).unwrap();
        assert_eq!((long.states, long.steps, config.cells(long).len()), (24, 1_000_000, 2));
        assert_eq!(SCALARS.map(|scalar| long.steps_of(scalar)), [1_000_000, 100_000]);
        assert!(config.problems().is_empty());
    }

    #[test]
    fn what_a_cell_is_judged_against_is_run_in_any_case() {
        use CovarianceName as Form;
        use ScalarName::{F32, F64};
        let config = Config { covariance: vec![Form::Joseph], ..Config::default() };
        let centre = config.centre(12);
        assert_eq!(config.cells(&centre), [(Form::Joseph, F32), (Form::Joseph, F64), (Form::BiermanUd, F64)]);
        let noisy = Group { parameter_noise: 1e-8, ..centre };
        assert_eq!(config.cells(&noisy)[2..], [(Form::BiermanUd, F64), (Form::Direct, F64)]);
    }

    #[test]
    fn the_reference_is_as_long_as_its_work_allows() {
        assert_eq!(one_three(999), [1, 3, 10, 30, 100, 300]);
        let config = Config::default();
        assert_eq!(config.centre(12).reference_steps, 30_000);
        assert_eq!(config.centre(64).reference_steps, 3000);
        let short = Config { steps: 50, ..config };
        assert_eq!(short.centre(12).reference_steps, 30);
    }
}
