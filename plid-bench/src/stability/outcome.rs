//! The results of a stability study and their files.

use std::path::Path;

use plid_catalogue::{CovarianceName, ExpectationName, ScalarName};
use plid_file::{NotFinite, to_value};
use serde::Serialize;

use super::classify::{Class, Judged, judge, rule};
use super::config::Config;
use super::group::Part;
use super::reference::ReferenceSummary;
use super::report;
use super::scenario::Scenario;
use super::study::Found;
use super::verdicts::{Cells, Claim, Recommended, claims, recommended};
use crate::study::{Machine, StudyError, to_toml, write, write_csv, write_json};

/// The results of a study.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// The config.
    pub config: Config,
    /// The machine.
    pub machine: Machine,
    /// The judged cells.
    pub cells: Vec<Judged>,
    /// The runs in double-double.
    pub references: Vec<ReferenceSummary>,
    /// The verdicts.
    pub claims: Vec<Claim>,
    /// The recommendations.
    pub recommended: Vec<Recommended>,
}

/// A row of stability.csv. It contains no times, so that the same study gives the same bytes.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    part: Part,
    label: String,
    states: usize,
    joint_states: usize,
    covariance: CovarianceName,
    scalar: ScalarName,
    expectations: ExpectationName,
    scenario: &'static str,
    parameter_noise: f64,
    initial_variance: f64,
    initial_variance_over_r: bool,
    forgetting: f64,
    steps_asked: usize,
    steps_done: usize,
    class: Class,
    lost_at: Option<usize>,
    why: String,
    reference_step: Option<usize>,
    estimate_error: Option<f64>,
    estimate_error_deviations: Option<f64>,
    covariance_error: Option<f64>,
    one_step_covariance_error: Option<f64>,
    symmetry_defect: f64,
    smallest_pivot: Option<f64>,
    condition_at_least: Option<f64>,
    free_run_error: Option<f64>,
    response_difference: Option<f64>,
    nees: Option<f64>,
}

impl Row {
    /// Returns the row of a cell.
    pub fn of(judged: &Judged) -> Self {
        let cell = &judged.cell;
        let group = &cell.group;
        let last = cell.errors.last();
        Self {
            part: group.part,
            label: group.label.clone(),
            states: group.states,
            joint_states: group.joint_states(),
            covariance: cell.form,
            scalar: cell.scalar,
            expectations: group.expectations,
            scenario: Scenario::name(group.scenario),
            parameter_noise: group.parameter_noise,
            initial_variance: group.initial_variance,
            initial_variance_over_r: group.start_over_sensor,
            forgetting: group.forgetting,
            steps_asked: group.steps_of(cell.scalar),
            steps_done: cell.done,
            class: judged.class,
            lost_at: judged.lost_at,
            why: judged.why.clone(),
            reference_step: last.map(|e| e.step),
            estimate_error: last.map(|e| e.estimate),
            estimate_error_deviations: last.map(|e| e.deviations),
            covariance_error: last.and_then(|e| e.covariance),
            one_step_covariance_error: cell.local.iter().filter_map(|l| l.covariance).reduce(f64::max),
            symmetry_defect: cell.symmetry_defect,
            smallest_pivot: cell.smallest_pivot,
            condition_at_least: cell.condition,
            free_run_error: cell.free_run,
            response_difference: judged.response,
            nees: cell.nees,
        }
    }
}

/// The content of stability.json.
#[derive(Serialize)]
struct Content<'a> {
    machine: &'a Machine,
    config: &'a Config,
    rule: String,
    claims: &'a [Claim],
    recommended: &'a [Recommended],
    references: &'a [ReferenceSummary],
    cells: Vec<Details<'a>>,
}

/// A cell in stability.json, with its row of the table and the figures that the table omits.
#[derive(Serialize)]
struct Details<'a> {
    #[serde(flatten)]
    row: Row,
    errors: &'a [super::ErrorAt],
    one_step: &'a [super::LocalAt],
    stop: &'a Option<super::Stop>,
    indefinite: &'a Option<super::Indefinite>,
    microseconds_per_step: f64,
}

impl Outcome {
    /// Judges the cells.
    ///
    /// # Errors
    /// Returns an error for a model whose frequency response cannot be computed.
    pub fn new(config: Config, machine: Machine, found: Found) -> Result<Self, StudyError> {
        let cells = judge(found.cells).map_err(StudyError::cell("frequency responses"))?;
        let asked = Cells(&cells);
        // The P0 / R of the centre.
        let sensor =
            plid_testbed::truss(&plid_testbed::TrussConfig::default()).map_err(StudyError::cell("the truss"))?;
        let claims = claims(&config, &asked);
        let recommended = recommended(&config, &asked, 1.0 / sensor.noise.sensor[(0, 0)]);
        Ok(Self { config, machine, references: found.references, claims, recommended, cells })
    }

    /// Writes the files and keeps the journal.
    ///
    /// # Errors
    /// Returns [`StudyError::NotFinite`] or [`StudyError::File`].
    pub fn write(&self, directory: &Path) -> Result<(), StudyError> {
        write(&directory.join("config.toml"), to_toml(&self.config))?;
        write_json(&directory.join("machine.json"), &self.machine)?;
        write_csv(&directory.join("stability.csv"), self.cells.iter().map(Row::of))?;
        write(&directory.join("report.html"), report::page(self).to_html())?;
        // This file is written last, so that its presence shows that the other files exist.
        let path = directory.join("stability.json");
        write_json(&path, &self.json().map_err(StudyError::not_finite(&path))?)
    }

    /// Returns the content of stability.json. Values that are not available have no key.
    ///
    /// # Errors
    /// Returns [`NotFinite`] for the first number that is not finite.
    pub fn json(&self) -> Result<serde_json::Value, NotFinite> {
        let details = self.cells.iter().map(|judged| Details {
            row: Row::of(judged),
            errors: &judged.cell.errors,
            one_step: &judged.cell.local,
            stop: &judged.cell.stop,
            indefinite: &judged.cell.indefinite,
            microseconds_per_step: judged.cell.microseconds_per_step,
        });
        to_value(&Content {
            machine: &self.machine,
            config: &self.config,
            rule: rule(),
            claims: &self.claims,
            recommended: &self.recommended,
            references: &self.references,
            cells: details.collect(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stability::cell::Cell;

    #[test]
    fn a_number_that_is_not_finite_is_refused_by_its_path() {
        let config = Config::default();
        let group = config.groups().remove(0);
        let cell = Cell::new(&group, CovarianceName::Direct, ScalarName::F64, [1.0, 100.0], 400.0);
        let found = Found { cells: vec![cell], references: Vec::new() };
        let mut outcome = Outcome::new(config, Machine::here(), found).unwrap();
        let cell = &outcome.json().unwrap()["cells"][0];
        assert!(cell["symmetry_defect"].is_number() && cell.get("nees").is_none(), "{cell}");

        outcome.cells[0].cell.symmetry_defect = f64::NAN;
        assert_eq!(outcome.json().unwrap_err().path, "cells[0].symmetry_defect");
        let directory = tempfile::tempdir().unwrap();
        let refused = outcome.write(directory.path()).unwrap_err();
        assert!(matches!(refused, StudyError::NotFinite { .. }), "{refused}");
        assert!(!directory.path().join("stability.json").exists());
    }
}
