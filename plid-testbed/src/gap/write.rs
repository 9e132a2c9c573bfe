//! The folders of a case: one with the files that a diagnosis may read, and one with the answer.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use nalgebra::DMatrix;
use ndarray::Array2;
use plid_file::{to_line, write_atomic};
use serde::Serialize;

use super::rig::Rig;
use super::spec::{Channels, GapSpec, Simulator};
use super::{Excitation, GapCase, GapError, GapRecord, plant};
use crate::INPUTS;
use crate::axes::Axes;
use crate::plant::{Truss, filter_state};

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
    /// Left out for accelerometers.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    output_kinds: BTreeMap<String, &'static str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    continuous: Option<ContinuousFile>,
    #[serde(skip_serializing_if = "Option::is_none")]
    ports: Option<Vec<PortFile>>,
}

type Rows = Vec<Vec<f64>>;

#[derive(Clone, Debug, PartialEq, Serialize)]
struct NoiseFile {
    sensor_std: Vec<f64>,
    actuator_std: Vec<f64>,
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
    /// Returns a plant as the case of a spec gives it: with the channels of the case, in arbitrary coordinates, and
    /// with its ports if the spec asks for them.
    pub(crate) fn of(seed: u64, truss: &Truss, spec: &GapSpec, rig: &Rig) -> Self {
        let Channels { inputs, outputs } = spec.channels;
        let kept = kept(truss, spec.channels);
        let t = plant::coordinates(seed, kept.len());
        let back = t.clone().try_inverse().expect("a rotation with scales has an inverse");
        let turned = |a: &DMatrix<f64>| rows(&(&t * a.select_rows(&kept).select_columns(&kept) * &back));
        let driven = |b: &DMatrix<f64>| rows(&(&t * b.select_rows(&kept).columns(0, inputs)));
        let declared = truss.ports[..inputs].iter().map(|port| {
            let of = |r: &[f64]| -> Vec<f64> { kept.iter().map(|&i| r[i]).collect() };
            let row = |r: &[f64]| (DMatrix::from_row_slice(1, kept.len(), &of(r)) * &back).as_slice().to_vec();
            let place = if truss.axes.is_some() { "axis" } else { "strut" };
            PortFile {
                name: format!("{place}{}", port.input + 1),
                input: format!("u{}", port.input + 1),
                force: (&t * DMatrix::from_column_slice(kept.len(), 1, &of(&port.force))).as_slice().to_vec(),
                displacement: row(&port.displacement),
                velocity: row(&port.velocity),
            }
        });
        let c = truss.discrete.c.rows(0, outputs).select_columns(&kept);
        let kinds = |axes: &Axes| names('y', outputs).into_iter().map(|name| (name, axes.shown.name())).collect();
        let [sensor_v, amplifier_v] =
            [rig.declared_sensor_v, rig.noise.amplifier_rms_v].map(|noise_v| noise_v / spec.noise_misjudged);
        Self {
            format: "state-space",
            sample_rate_hz: truss.sample_rate_hz,
            inputs: names('u', inputs),
            outputs: names('y', outputs),
            a: turned(&truss.discrete.a),
            b: driven(&truss.discrete.b),
            c: rows(&(c * &back)),
            d: rows(&truss.discrete.d.view((0, 0), (outputs, inputs)).into_owned()),
            noise: NoiseFile { sensor_std: vec![sensor_v; outputs], actuator_std: vec![amplifier_v; inputs] },
            output_kinds: truss.axes.as_ref().map(kinds).unwrap_or_default(),
            continuous: spec
                .ports
                .then(|| ContinuousFile { a: turned(&truss.continuous.a), b: driven(&truss.continuous.b) }),
            ports: spec.ports.then(|| declared.collect()),
        }
    }
}

/// Returns the states on which the outputs depend. These include neither actuators that nothing drives nor filters
/// that nobody reads.
fn kept(truss: &Truss, Channels { inputs, outputs }: Channels) -> Vec<usize> {
    match &truss.axes {
        Some(axes) => axes.needed_states(),
        None => (0..inputs).chain(INPUTS..filter_state(&truss.modes, 0) + 2 * outputs).collect(),
    }
}

impl GapCase {
    /// Writes case.toml, sim.json and r1.csv to r6.csv (as many as there are records) into `case`, and label.json,
    /// test_u.csv and test_uy.csv into `label`. If the simulation is given only by its outputs, r1_sim.csv to
    /// r6_sim.csv replace sim.json, and `label` also contains test_sim.csv. Missing folders are created; case.toml
    /// and label.json are written last.
    ///
    /// # Errors
    /// Returns [`GapError::NotFinite`] if a number is not finite, or [`GapError::File`] if a file cannot be written.
    pub fn write(&self, case: &Path, label: &Path) -> Result<(), GapError> {
        for folder in [case, label] {
            fs::create_dir_all(folder).map_err(|e| file_error(folder, &e))?;
        }
        if self.simulator == Simulator::Model {
            save_json(&case.join("sim.json"), &self.simulation)?;
        }
        for (i, record) in self.records.iter().enumerate() {
            save(&case.join(format!("r{}.csv", i + 1)), &measured(record))?;
            if self.simulator == Simulator::Outputs {
                save(&case.join(format!("r{}_sim.csv", i + 1)), &csv(&[('y', &record.simulated)]))?;
            }
        }
        save(&case.join("case.toml"), &self.case_toml())?;
        save(&label.join("test_u.csv"), &csv(&[('u', &self.held_out.commands)]))?;
        save(&label.join("test_uy.csv"), &measured(&self.held_out))?;
        if self.simulator == Simulator::Outputs {
            save(&label.join("test_sim.csv"), &csv(&[('y', &self.held_out.simulated)]))?;
        }
        save_json(&label.join("label.json"), &self.label)
    }

    fn case_toml(&self) -> String {
        let quoted =
            |letter, count| names(letter, count).iter().map(|n| format!("{n:?}")).collect::<Vec<_>>().join(", ");
        let (simulation, by_outputs) = match self.simulator {
            Simulator::Model => ("sim = \"sim.json\"\n", false),
            Simulator::Outputs => ("", true),
        };
        let mut text = format!(
            "{simulation}sample_rate_hz = {:?}\ninputs = [{}]\noutputs = [{}]\n",
            self.simulation.sample_rate_hz,
            quoted('u', self.held_out.commands.ncols()),
            quoted('y', self.held_out.outputs.ncols()),
        );
        if by_outputs && !self.simulation.output_kinds.is_empty() {
            let kinds: Vec<_> =
                self.simulation.output_kinds.iter().map(|(y, kind)| format!("{y} = {kind:?}")).collect();
            let _ = writeln!(text, "output_kinds = {{ {} }}", kinds.join(", "));
        }
        for (i, record) in self.records.iter().enumerate() {
            let excitation = match record.excitation {
                Excitation::Zero => "excitation = \"zero\"".to_owned(),
                Excitation::Random { .. } => "excitation = \"random\"".to_owned(),
                Excitation::Periodic { period } => format!("excitation = \"periodic\"\nperiod = {period}"),
            };
            // Writing to a string cannot fail.
            let _ = write!(text, "\n[[record]]\nfile = \"r{}.csv\"\n{excitation}\n", i + 1);
            if by_outputs {
                let _ = writeln!(text, "simulated = \"r{}_sim.csv\"", i + 1);
            }
        }
        text
    }
}

fn save_json(path: &Path, value: &impl Serialize) -> Result<(), GapError> {
    let text = to_line(value).map_err(|source| GapError::NotFinite { path: path.display().to_string(), source })?;
    save(path, &text)
}

fn measured(record: &GapRecord) -> String {
    csv(&[('u', &record.commands), ('y', &record.outputs)])
}

/// Returns signals side by side as text, each with the letter of its channels.
fn csv(signals: &[(char, &Array2<f64>)]) -> String {
    let header: Vec<String> = signals.iter().flat_map(|(letter, signal)| names(*letter, signal.ncols())).collect();
    let mut text = header.join(",") + "\n";
    for k in 0..signals[0].1.nrows() {
        let values = signals.iter().flat_map(|(_, signal)| signal.row(k).to_vec());
        // The sum turns a code of -0 into 0.
        let values: Vec<String> = values.map(|v| (v + 0.0).to_string()).collect();
        text.push_str(&values.join(","));
        text.push('\n');
    }
    text
}

fn file_error(path: &Path, error: &std::io::Error) -> GapError {
    GapError::File { path: path.display().to_string(), reason: error.to_string() }
}

fn save(path: &Path, text: &str) -> Result<(), GapError> {
    write_atomic(path, text.as_bytes()).map_err(|e| file_error(path, &e))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_that_is_not_finite_is_not_written() {
        let spec = GapSpec { length: 0.1, ..GapSpec::default() };
        let mut case = super::super::draw(1, &spec).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let [open, sealed] = ["case", "label"].map(|name| folder.path().join(name));
        case.label.gap_sim = f64::NAN;
        let refused = case.write(&open, &sealed).unwrap_err().to_string();
        assert!(refused.contains("label.json: `gap_sim` is NaN"), "{refused}");
        assert!(!sealed.join("label.json").exists());
        case.simulation.a[0][1] = f64::INFINITY;
        let refused = case.write(&open, &sealed).unwrap_err().to_string();
        assert!(refused.contains("sim.json: `A[0][1]` is inf"), "{refused}");
    }
}
