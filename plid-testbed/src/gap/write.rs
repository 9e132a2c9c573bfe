//! The folders of a case: what a diagnosis may see, and the answer.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use nalgebra::DMatrix;
use ndarray::Array2;
use serde::Serialize;

use super::{Excitation, GapCase, GapError, NOISE_V, SAMPLE_RATE_HZ};
use crate::plant::Truss;
use crate::{INPUTS, OUTPUTS};

/// The nominal simulation as `sim.json` holds it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SimulationFile {
    format: &'static str,
    sample_rate_hz: f64,
    inputs: Vec<String>,
    outputs: Vec<String>,
    #[serde(rename = "A")]
    a: Rows,
    #[serde(rename = "B")]
    b: Rows,
    #[serde(rename = "C")]
    c: Rows,
    #[serde(rename = "D")]
    d: Rows,
    noise: NoiseFile,
    #[serde(skip_serializing_if = "Option::is_none")]
    continuous: Option<ContinuousFile>,
    #[serde(skip_serializing_if = "Option::is_none")]
    ports: Option<Vec<PortFile>>,
}

type Rows = Vec<Vec<f64>>;

#[derive(Clone, Debug, PartialEq, Serialize)]
struct NoiseFile {
    sensor_std: [f64; OUTPUTS],
    actuator_std: [f64; INPUTS],
}

#[derive(Clone, Debug, PartialEq, Serialize)]
struct ContinuousFile {
    #[serde(rename = "A")]
    a: Rows,
    #[serde(rename = "B")]
    b: Rows,
}

#[derive(Clone, Debug, PartialEq, Serialize)]
struct PortFile {
    name: String,
    input: String,
    force: Vec<f64>,
    displacement: Vec<f64>,
    velocity: Vec<f64>,
}

fn rows(m: &DMatrix<f64>) -> Rows {
    m.row_iter().map(|row| row.iter().copied().collect()).collect()
}

fn names(letter: char, count: usize) -> Vec<String> {
    (1..=count).map(|number| format!("{letter}{number}")).collect()
}

impl SimulationFile {
    /// A truss with the states x' = T x; with its ports, or without a word of them.
    pub(crate) fn of(truss: &Truss, t: DMatrix<f64>, ports: bool) -> Self {
        let back = t.clone().try_inverse().expect("a rotation with scales has an inverse");
        let turned = |a: &DMatrix<f64>| rows(&(&t * a * &back));
        let declared = truss.ports.iter().map(|port| {
            let row = |r: &[f64]| (DMatrix::from_row_slice(1, r.len(), r) * &back).as_slice().to_vec();
            PortFile {
                name: format!("strut{}", port.input + 1),
                input: format!("u{}", port.input + 1),
                force: (&t * DMatrix::from_column_slice(port.force.len(), 1, &port.force)).as_slice().to_vec(),
                displacement: row(&port.displacement),
                velocity: row(&port.velocity),
            }
        });
        Self {
            format: "state-space",
            sample_rate_hz: truss.sample_rate_hz,
            inputs: names('u', INPUTS),
            outputs: names('y', OUTPUTS),
            a: turned(&truss.discrete.a),
            b: rows(&(&t * &truss.discrete.b)),
            c: rows(&(&truss.discrete.c * &back)),
            d: rows(&truss.discrete.d),
            noise: NoiseFile { sensor_std: [NOISE_V; OUTPUTS], actuator_std: [NOISE_V; INPUTS] },
            continuous: ports
                .then(|| ContinuousFile { a: turned(&truss.continuous.a), b: rows(&(&t * &truss.continuous.b)) }),
            ports: ports.then(|| declared.collect()),
        }
    }
}

impl GapCase {
    /// Writes case.toml, sim.json and r1.csv to r6.csv into `case`, and label.json, test_u.csv and test_uy.csv into `label`. The
    /// folders are made where they are missing; case.toml and label.json are written last.
    ///
    /// # Errors
    /// If a file cannot be written.
    pub fn write(&self, case: &Path, label: &Path) -> Result<(), GapError> {
        for folder in [case, label] {
            fs::create_dir_all(folder).map_err(|e| file_error(folder, &e))?;
        }
        save(&case.join("sim.json"), &json(&self.simulation))?;
        for (i, record) in self.records.iter().enumerate() {
            save(&case.join(format!("r{}.csv", i + 1)), &csv(&record.commands, Some(&record.outputs)))?;
        }
        save(&case.join("case.toml"), &self.case_toml())?;
        save(&label.join("test_u.csv"), &csv(&self.held_out.commands, None))?;
        save(&label.join("test_uy.csv"), &csv(&self.held_out.commands, Some(&self.held_out.outputs)))?;
        save(&label.join("label.json"), &json(&self.label))
    }

    fn case_toml(&self) -> String {
        let quoted =
            |letter, count| names(letter, count).iter().map(|n| format!("{n:?}")).collect::<Vec<_>>().join(", ");
        let mut text = format!(
            "sim = \"sim.json\"\nsample_rate_hz = {SAMPLE_RATE_HZ:?}\ninputs = [{}]\noutputs = [{}]\n",
            quoted('u', INPUTS),
            quoted('y', OUTPUTS),
        );
        for (i, record) in self.records.iter().enumerate() {
            let excitation = match record.excitation {
                Excitation::Zero => "excitation = \"zero\"".to_owned(),
                Excitation::Random { .. } => "excitation = \"random\"".to_owned(),
                Excitation::Periodic { period } => format!("excitation = \"periodic\"\nperiod = {period}"),
            };
            // Writing into a text cannot fail.
            let _ = write!(text, "\n[[record]]\nfile = \"r{}.csv\"\n{excitation}\n", i + 1);
        }
        text
    }
}

fn json(value: &impl Serialize) -> String {
    serde_json::to_string(value).expect("plain numbers and names") + "\n"
}

fn csv(commands: &Array2<f64>, outputs: Option<&Array2<f64>>) -> String {
    let mut header = names('u', INPUTS);
    if outputs.is_some() {
        header.extend(names('y', OUTPUTS));
    }
    let mut text = header.join(",") + "\n";
    for k in 0..commands.nrows() {
        let row = commands.row(k);
        let values = row.iter().chain(outputs.iter().flat_map(|y| y.row(k).to_slice().expect("rows are contiguous")));
        // A code of minus nothing is nothing.
        let values: Vec<String> = values.map(|v| (v + 0.0).to_string()).collect();
        text.push_str(&values.join(","));
        text.push('\n');
    }
    text
}

fn file_error(path: &Path, error: &std::io::Error) -> GapError {
    GapError::File { path: path.display().to_string(), reason: error.to_string() }
}

/// Whole or not at all: beside the file first, then in its place.
fn save(path: &Path, text: &str) -> Result<(), GapError> {
    let beside = path.with_extension("part");
    fs::write(&beside, text).and_then(|()| fs::rename(&beside, path)).map_err(|e| file_error(path, &e))
}
