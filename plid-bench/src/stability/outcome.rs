//! The results of a stability study and their files.

use std::path::Path;

use plid_catalogue::{CovarianceName, ExpectationName, ScalarName};
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
    /// The cells, judged.
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

/// stability.json: a line of the table and what it leaves out.
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
    /// A model whose frequency response cannot be formed.
    pub fn new(config: Config, machine: Machine, found: Found) -> Result<Self, StudyError> {
        let cells = judge(found.cells).map_err(StudyError::cell("frequency responses"))?;
        let asked = Cells(&cells);
        // P0 / R of the centre.
        let sensor =
            plid_testbed::truss(&plid_testbed::TrussConfig::default()).map_err(StudyError::cell("the truss"))?;
        let claims = claims(&config, &asked);
        let recommended = recommended(&config, &asked, 1.0 / sensor.noise.sensor[(0, 0)]);
        Ok(Self { config, machine, references: found.references, claims, recommended, cells })
    }

    /// Writes the files and keeps the journal.
    ///
    /// # Errors
    /// [`StudyError::File`]
    pub fn write(&self, directory: &Path) -> Result<(), StudyError> {
        write(&directory.join("config.toml"), to_toml(&self.config))?;
        write_json(&directory.join("machine.json"), &self.machine)?;
        write_csv(&directory.join("stability.csv"), self.cells.iter().map(Row::of))?;
        write(&directory.join("report.html"), report::page(self).to_html())?;
        // Last, so that its presence says that the others are there.
        write_json(&directory.join("stability.json"), &self.json())
    }

    /// stability.json.
    pub fn json(&self) -> serde_json::Value {
        let details = self.cells.iter().map(|judged| Details {
            row: Row::of(judged),
            errors: &judged.cell.errors,
            one_step: &judged.cell.local,
            stop: &judged.cell.stop,
            indefinite: &judged.cell.indefinite,
            microseconds_per_step: judged.cell.microseconds_per_step,
        });
        present(serde_json::json!({
            "machine": self.machine,
            "config": self.config,
            "rule": rule(),
            "claims": self.claims,
            "recommended": self.recommended,
            "references": self.references,
            "cells": details.collect::<Vec<_>>(),
        }))
    }
}

/// A value without the keys that have none: what is not available is absent.
fn present(mut value: serde_json::Value) -> serde_json::Value {
    match &mut value {
        serde_json::Value::Object(keys) => {
            keys.retain(|_, value| !value.is_null());
            keys.values_mut().for_each(|value| *value = present(value.take()));
        }
        serde_json::Value::Array(values) => values.iter_mut().for_each(|value| *value = present(value.take())),
        _ => {}
    }
    value
}
