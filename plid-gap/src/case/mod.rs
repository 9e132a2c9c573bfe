//! A gap case: the simulation, the records, and the engineer's knowledge.

mod config;
mod controller;
mod intersample;
pub(crate) mod levels;
pub(crate) mod limits;
mod period;
pub(crate) mod record;
mod records;
mod simulator;
pub(crate) mod split;

use std::path::Path;
use std::sync::Arc;

use ndarray::Array2;
use plid_model::Model;

use crate::error::GapError;

pub(crate) use config::ON_A_MODE;
pub use config::{CaseConfig, ExcitationKind, PortConfig, RecordConfig, StartKind, Use};
pub use controller::{Controller, ControllerConfig};
pub use intersample::Intersample;
pub use limits::Limits;
pub use record::{Channels, Excitation, Record};
pub use records::excitations_of;
pub use simulator::{FmuSource, SimulatorConfig};

/// A case with its files read.
#[derive(Debug, Clone)]
pub struct Case {
    /// The contents of the case file. In closed loop, its inputs are those of the simulation.
    pub config: CaseConfig,
    /// The simulation, if one is given.
    pub model: Option<Model>,
    /// The controller that was active, if the case declares one. The inputs of the records are then the part of the
    /// command that does not come from feedback.
    pub controller: Option<Arc<Controller>>,
    /// The records in order.
    pub records: Vec<Record>,
    /// The records from which a missing simulation is identified. If there are none, the other records are used.
    pub for_simulation: Vec<Record>,
    /// Warnings from reading.
    pub warnings: Vec<String>,
}

impl Case {
    /// Reads a case and its files, which are in its folder.
    ///
    /// # Errors
    /// Returns a [`GapError`] with file, line, channel or key.
    pub fn read(path: &Path) -> Result<Self, GapError> {
        Self::read_with(path, path.parent().unwrap_or(Path::new(".")))
    }

    /// Reads a case whose record files are in the folder `data`.
    ///
    /// # Errors
    /// Returns a [`GapError`] with file, line, channel or key.
    pub fn read_with(path: &Path, data: &Path) -> Result<Self, GapError> {
        let mut config: CaseConfig = plid_data::config::read_checked(path, CaseConfig::problems)?;
        let folder = path.parent().unwrap_or(Path::new("."));
        let mut model = config.sim.as_ref().map(|sim| Model::read(&folder.join(sim))).transpose()?;
        let mut controller = None;
        if let Some(model) = &mut model {
            controller = controller::read(path, &config, folder, model)?;
            check_channels(path, &config, model)?;
            config.declare_kinds(model);
        }
        let (mut records, warnings) = records::read(path, &config, data)?;
        if let (Some(controller), Some(model)) = (&controller, &model) {
            for record in &mut records {
                controller::open(controller, &config.inputs, &config.outputs, record)?;
            }
            config.inputs.clone_from(&model.inputs);
            let first = config.channel_problems(&controller.references).into_iter().next();
            first
                .map_or(Ok(()), |(key, message)| Err(GapError::Key { file: path.into(), key: key.into(), message }))?;
        }
        let is_for_simulation = |k: usize| config.record[k].r#use == Some(Use::Sim);
        let (for_simulation, records): (Vec<_>, Vec<_>) =
            records.into_iter().enumerate().partition(|(k, _)| is_for_simulation(*k));
        let only = |numbered: Vec<(usize, Record)>| numbered.into_iter().map(|(_, record)| record).collect();
        let (records, for_simulation) = (only(records), only(for_simulation));
        Ok(Self { config, model, controller, records, for_simulation, warnings })
    }
}

/// Returns the columns of an array as channels.
pub fn columns(data: &Array2<f64>) -> Channels {
    data.columns().into_iter().map(|column| column.to_vec()).collect()
}

fn check_channels(path: &Path, config: &CaseConfig, model: &Model) -> Result<(), GapError> {
    let wrong = |key: &str, message: String| GapError::Key { file: path.into(), key: key.into(), message };
    // In closed loop, the inputs are the signals that drive the loop, and are checked with the controller.
    let checked = [("inputs", &config.inputs, &model.inputs), ("outputs", &config.outputs, &model.outputs)];
    for (key, of_case, of_model) in checked.into_iter().skip(usize::from(config.controller.is_some())) {
        if of_case != of_model {
            return Err(wrong(
                key,
                format!("{} here, but {} in the simulation", of_case.join(", "), of_model.join(", ")),
            ));
        }
    }
    if (config.rate() / model.sample_rate_hz - 1.0).abs() > 1e-6 {
        let key = if config.decimate_to_hz.is_some() { "decimate_to_hz" } else { "sample_rate_hz" };
        return Err(wrong(key, format!("{} here, but {} in the simulation", config.rate(), model.sample_rate_hz)));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{RATE, truss};

    fn read(inputs: &str, rate: f64, samples: &str) -> Result<Case, GapError> {
        read_with("", inputs, rate, samples)
    }

    /// Reads a case from files, with one record of these samples and one more sample.
    fn read_with(keys: &str, inputs: &str, rate: f64, samples: &str) -> Result<Case, GapError> {
        let folder = tempfile::tempdir().unwrap();
        let put = |name: &str, text: String| std::fs::write(folder.path().join(name), text).unwrap();
        put("sim.json", truss(1).to_json().to_string());
        put("r1.csv", format!("u1,u2,y1,y2\n{samples}\n0,1,2,3\n"));
        put(
            "case.toml",
            format!(
                "sim = \"sim.json\"\nsample_rate_hz = {rate:?}\ninputs = [{inputs}]\noutputs = [\"y1\", \
                \"y2\"]\n{keys}\n[[record]]\nfile = \"r1.csv\"\n"
            ),
        );
        Case::read(&folder.path().join("case.toml"))
    }

    const INPUTS: &str = "\"u1\", \"u2\"";

    #[test]
    fn units_belong_to_channels() {
        let read = |unit: &str| read_with(&format!("[units]\n{unit}\n"), INPUTS, RATE, "1,2,3,4");
        let case = read("u2 = \"N\"").unwrap();
        assert_eq!(case.config.units_of(&case.config.inputs), [None, Some("N".to_string())]);
        let said = read("u3 = \"N\"").unwrap_err().to_string();
        assert!(said.contains("units: `u3` is not one of the channels"), "{said}");
        let said = read("y1 = \" \"").unwrap_err().to_string();
        assert!(said.contains("the unit of `y1` is empty"), "{said}");
    }

    #[test]
    fn missing_outputs_are_kept_and_named() {
        let case = read(INPUTS, RATE, "1,2,nan,4").unwrap();
        assert!(case.records[0].y[0][0].is_nan() && case.records[0].y[0][1] == 2.0);
        assert!(case.warnings[0].contains("`y1` lacks 1 of 2 samples"), "{:?}", case.warnings);
    }

    #[test]
    fn what_does_not_fit_the_simulation_is_refused() {
        let says = |inputs: &str, rate: f64, samples: &str| read(inputs, rate, samples).unwrap_err().to_string();
        let order = says("\"u2\", \"u1\"", RATE, "1,2,3,4");
        assert!(order.contains("inputs: u2, u1 here, but u1, u2 in the simulation"), "{order}");
        let rate = says(INPUTS, 800.0, "1,2,3,4");
        assert!(rate.contains("sample_rate_hz: 800 here, but 1600"), "{rate}");
        let input = says(INPUTS, RATE, "nan,2,3,4");
        assert!(input.contains("channel `u1` is NaN"), "{input}");
        let output = says(INPUTS, RATE, "1,2,3,inf");
        assert!(output.contains("channel `y2` is inf"), "{output}");
        let channel = says(INPUTS, RATE, "1,2,3,4,5");
        assert!(channel.contains("5 cells where 4 are expected"), "{channel}");
    }

    #[test]
    fn thresholds_are_set_and_checked() {
        let with = |settings: &str| {
            let text =
                format!("sample_rate_hz = 1.0\ninputs = []\noutputs = []\n{settings}\n[[record]]\nfile = \"r1.csv\"\n");
            plid_data::config::from_toml_checked(&text, "case.toml", CaseConfig::problems)
        };
        let set = with("[settings.judge]\nmost_unknown = 0.5").unwrap();
        assert_eq!((set.settings.judge.most_unknown, set.settings.judge.least_unknown), (0.5, 0.02));
        let said = |settings: &str| format!("{:?}", miette::Report::new(with(settings).unwrap_err()));
        let unknown = said("[settings.judge]\nmost_unknwon = 0.5");
        assert!(unknown.contains("most_unknwon") && unknown.contains("did you mean `most_unknown`"), "{unknown}");
        let range = said("[settings.judge]\nmost_unknown = 1.5");
        assert!(range.contains("line 5") && range.contains("1.5 is not within 0 to 1"), "{range}");
    }

    #[test]
    fn ports_are_channels_of_the_case() {
        let with = |ports: &str| {
            let text = format!(
                "sample_rate_hz = 1.0\ninputs = [\"torque\"]\noutputs = [\"encoder\"]\n[[record]]\nfile = \
                \"r1.csv\"\n{ports}"
            );
            plid_data::config::from_toml_checked(&text, "case.toml", CaseConfig::problems)
        };
        let port = |name: &str, input: &str, output: &str| {
            format!("[[port]]\nname = \"{name}\"\ninput = \"{input}\"\noutput = \"{output}\"\n")
        };
        let read = with(&port("axis", "torque", "encoder")).unwrap();
        let expected = PortConfig { name: "axis".into(), input: "torque".into(), output: "encoder".into() };
        assert_eq!(read.port, [expected]);
        // Whether messages are wrapped in a frame depends on the other crates that use miette.
        let said = |ports: &str| {
            let text = format!("{:?}", miette::Report::new(with(ports).unwrap_err()));
            text.split_whitespace().filter(|word| *word != "│").collect::<Vec<_>>().join(" ")
        };
        let input = said(&port("axis", "torqe", "encoder"));
        assert!(input.contains("`torqe` is not one of the inputs; did you mean `torque`?"), "{input}");
        let output = said(&port("axis", "torque", "encodr"));
        assert!(output.contains("`encodr` is not one of the outputs; did you mean `encoder`?"), "{output}");
        let twice = said(&port("axis", "torque", "encoder").repeat(2));
        assert!(twice.contains("two ports are called `axis`"), "{twice}");
        let mode = said(&port("mode:3", "torque", "encoder"));
        assert!(mode.contains("is not the name of a port"), "{mode}");
        let key = said(&(port("axis", "torque", "encoder") + "place = 1\n"));
        assert!(key.contains("place"), "{key}");
    }

    #[test]
    fn a_mean_is_learnt_from_what_is_fitted_alone() {
        // The last two of eight samples are held out, and y1 differs greatly in the first of them.
        let case = read_with("trend = \"mean\"", INPUTS, RATE, &format!("{}0,0,99,7", "1,0,5,7\n".repeat(6))).unwrap();
        assert_eq!(case.records[0].y[0][..6], [0.0; 6]);
        assert_eq!(case.records[0].y[0][6], 94.0);
    }
}
