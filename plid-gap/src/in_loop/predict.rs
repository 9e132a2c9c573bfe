//! Predictions by a simulator with the effects that a diagnosis found.

use std::fs;
use std::path::Path;

use plid_simulator::{Checked, Description, Parameter, Simulator};

use crate::answer::predict::{self, Prediction, require_finite};
use crate::answer::range::{Beyond, difference, expected_gap, peak, require_sizes};
use crate::answer::schema::WrittenEffect;
use crate::case::record::{Excitation, Record};
use crate::effects::{Action, Effect, Library, Place, Setting};
use crate::error::GapError;
use crate::fit::problem::Placed;
use crate::in_loop::answer::{SimulatorWithEffects, WrittenPort};
use crate::in_loop::coupling::Response;
use crate::in_loop::parameter::SimulatorParameter;
use crate::in_loop::runs::Runs;
use crate::in_loop::survey;

/// The `format` of a sim-with-effect.json that belongs to a simulator in the loop.
pub const FORMAT: &str = "simulator-with-effects";

/// A prediction's effects, read from sim-with-effect.json. The simulator itself is given for each prediction.
pub struct LoopPredictor<'l> {
    /// The contents of the file.
    pub written: SimulatorWithEffects,
    setting: Setting,
    responses: Vec<Response>,
    /// The effects around the simulator and at its ports.
    effects: Vec<Placed<'l>>,
    /// Values of the simulator's parameters.
    values: Vec<f64>,
}

impl<'l> LoopPredictor<'l> {
    /// Reads a sim-with-effect.json whose effects are in this library.
    ///
    /// # Errors
    /// [`GapError::Io`]; [`GapError::Malformed`] with the reason.
    pub fn read(path: &Path, library: &'l Library) -> Result<Self, GapError> {
        let file = path.to_path_buf();
        let text = fs::read(path).map_err(|source| GapError::Io { file: file.clone(), source })?;
        let written: SimulatorWithEffects = serde_json::from_slice(&text)
            .map_err(|error| GapError::Malformed { file: file.clone(), message: error.to_string() })?;
        Self::new(written, library).map_err(|message| GapError::Malformed { file, message })
    }

    /// Creates a predictor from the contents of a sim-with-effect.json.
    ///
    /// # Errors
    /// Returns a sentence that states the fault of the contents.
    pub fn new(written: SimulatorWithEffects, library: &'l Library) -> Result<Self, String> {
        require_sound(&written)?;
        let description = &written.simulator;
        let step = 1.0 / (description.rate_hz * description.steps_per_sample.max(1) as f64);
        let response = |port: &WrittenPort| Response { mobility: port.mobility, weight: port.weight, step };
        let responses: Vec<Response> = written.ports.iter().map(response).collect();
        let setting = survey::bare(description, &responses).map_err(|error| error.to_string())?;
        let effects = placed(&written, library, &setting)?;
        let value = |given: &Parameter| {
            let name = &given.name;
            let value = *written.parameters.get(name).ok_or_else(|| format!("`parameters` has no `{name}`"))?;
            require_finite(&format!("parameters.{name}"), value)?;
            Ok(value)
        };
        let values = description.parameters.iter().map(value).collect::<Result<_, String>>()?;
        Ok(Self { setting, responses, effects, values, written })
    }

    /// Predicts the outputs (p channels) for inputs (m channels), from rest at time `t0`. An input or a motion beyond
    /// the fitted range takes a second run without the effects, because the expected gap depends on the correction by
    /// the effects. So does a file that does not state this range, because that run then shows which outputs are
    /// possible.
    ///
    /// # Errors
    /// [`GapError::Simulator`] if the simulator fails; [`GapError::Failed`] if it is a different simulator;
    /// [`GapError::Diverged`] with the first sample that is out of bounds.
    pub fn predict(&self, simulator: &mut dyn Simulator, u: &[Vec<f64>], t0: f64) -> Result<Prediction, GapError> {
        self.predicted(simulator, u, t0, false)
    }

    /// Predicts the outputs as [`LoopPredictor::predict`] does, with the change from the simulator as given: that by
    /// the effects and that by the refit of the parameters. This always takes the second run.
    ///
    /// # Errors
    /// The errors of [`LoopPredictor::predict`].
    pub fn predict_change(
        &self,
        simulator: &mut dyn Simulator,
        u: &[Vec<f64>],
        t0: f64,
    ) -> Result<Prediction, GapError> {
        self.predicted(simulator, u, t0, true)
    }

    fn predicted(
        &self,
        simulator: &mut dyn Simulator,
        u: &[Vec<f64>],
        t0: f64,
        with_change: bool,
    ) -> Result<Prediction, GapError> {
        let checked = Checked::new(simulator)?;
        self.require_same(checked.description())?;
        let parameters = SimulatorParameter::all(&self.written.simulator.parameters);
        let effects = self.with_parameters(&parameters);
        let record = Record {
            name: "prediction".into(),
            excitation: Excitation::Random,
            from_rest: true,
            start_s: t0,
            held_out: false,
            u: u.to_vec(),
            y: Vec::new(),
            simulated: None,
        };
        let mut runs = Runs::new(checked, self.responses.clone());
        let (outputs, peaks) = runs.simulate_with_motion(&self.setting, &effects, &record)?;
        let known = &self.written.simulator;
        let (inputs, ports) = (known.inputs.iter().map(|i| &i.name), known.ports.iter().map(|port| &port.name));
        let beyond = self.written.fitted.as_ref().map(|fitted| fitted.beyond(inputs, u, ports, &peaks));
        let within = beyond.as_ref().is_some_and(|beyond| beyond.times <= 1.0);
        // Without the effects, all parameters have the values that the simulator was given.
        let given = if within && !with_change { outputs.clone() } else { runs.simulate(&self.setting, &[], &record)? };
        self.require_bounded(&outputs, &given, beyond.as_ref())?;
        let correction = difference(&outputs, &given);
        let change = with_change.then(|| correction.clone());
        Ok(Prediction { correction, change, outputs, beyond })
    }

    /// Checks that the outputs stay within bounds about those of the fitted records, in proportion to the excess over
    /// the fitted range; or about those without the effects, if the file does not state the range.
    fn require_bounded(
        &self,
        outputs: &[Vec<f64>],
        bare: &[Vec<f64>],
        beyond: Option<&Beyond>,
    ) -> Result<(), GapError> {
        let names: Vec<String> = self.written.simulator.outputs.iter().map(|output| output.name.clone()).collect();
        let expected: Vec<f64> = match self.written.fitted.as_ref().zip(beyond) {
            Some((fitted, beyond)) => fitted.output_peak.iter().map(|peak| beyond.times * peak).collect(),
            None => bare.iter().map(|y| peak(y)).collect(),
        };
        predict::require_bounded(&names, outputs, &expected)
    }

    /// Returns the relative gap that a prediction is expected to have, as
    /// [`Predictor::expected_gap`](crate::answer::predict::Predictor::expected_gap) does. A file of an earlier
    /// version does not state the fitted range, so its expected gap does not depend on the input.
    pub fn expected_gap(&self, prediction: &Prediction) -> Option<f64> {
        let SimulatorWithEffects { fitted, noise_rms, .. } = &self.written;
        match fitted {
            None => Some(self.written.expected_gap),
            Some(fitted) => expected_gap(Some(fitted), noise_rms, prediction, &prediction.outputs, false),
        }
    }

    /// Checks that a simulator has the channels and parameters of the diagnosed one.
    fn require_same(&self, description: &Description) -> Result<(), GapError> {
        let known = &self.written.simulator;
        let parts = [
            ("inputs", known.inputs == description.inputs),
            ("outputs", known.outputs == description.outputs),
            ("ports", known.ports == description.ports),
            ("parameters", known.parameters == description.parameters),
            ("rate", known.rate_hz == description.rate_hz),
            ("steps per sample", known.steps_per_sample == description.steps_per_sample),
        ];
        match parts.iter().find(|(_, same)| !same) {
            None => Ok(()),
            Some((what, _)) => Err(GapError::Failed(format!(
                "the simulator {:?} has other {what} than the diagnosed one, {:?}",
                description.name, known.name
            ))),
        }
    }

    /// Returns the effects, followed by the parameters whose values differ from those of the simulator.
    fn with_parameters<'p>(&'p self, parameters: &'p [SimulatorParameter]) -> Vec<Placed<'p>> {
        let given = self.written.simulator.parameters.iter().zip(&self.values);
        let changed =
            parameters.iter().zip(given).enumerate().filter(|(_, (_, (given, value)))| given.value != **value);
        let changed = changed.map(|(k, (effect, (_, &value)))| Placed {
            effect: effect as &dyn Effect,
            place: Place::Parameter(k),
            parameters: vec![value],
        });
        self.effects.iter().cloned().chain(changed).collect()
    }
}

/// Checks everything in a file but its effects and parameters.
fn require_sound(written: &SimulatorWithEffects) -> Result<(), String> {
    if written.format != FORMAT {
        return Err(format!("the format is {:?}, expected {FORMAT:?}", written.format));
    }
    let description = &written.simulator;
    description.check().map_err(|error| error.to_string())?;
    let names: Vec<&String> = description.ports.iter().map(|port| &port.name).collect();
    if !written.ports.iter().map(|port| &port.name).eq(names.iter().copied()) {
        return Err(format!("`ports` does not list the simulator's ports, {names:?}"));
    }
    let sound = |x: f64| x.is_finite() && x >= 0.0;
    if let Some(port) = written.ports.iter().find(|port| !(sound(port.mobility) && (0.0..=1.0).contains(&port.weight)))
    {
        return Err(format!("port {:?} has an impossible mobility or weight", port.name));
    }
    let (m, p) = (description.inputs.len(), description.outputs.len());
    require_finite("t0", written.t0)?;
    require_sizes("noise_rms", &written.noise_rms, p)?;
    written.fitted.as_ref().map_or(Ok(()), |fitted| fitted.require_sizes(m, description.ports.len(), p))
}

/// Returns the effects of a file.
fn placed<'l>(
    written: &SimulatorWithEffects,
    library: &'l Library,
    setting: &Setting,
) -> Result<Vec<Placed<'l>>, String> {
    let one = |written: &WrittenEffect| {
        let name = &written.effect;
        let effect = library.get(name).ok_or_else(|| format!("there is no effect `{name}`"))?;
        let placed = predict::placed(written, effect, library, setting)?;
        let actions = effect.act(setting, &placed.place, &placed.parameters);
        if actions.iter().all(Action::suits_any_simulator) {
            return Ok(placed);
        }
        Err(format!("{name}: it changes modes, which a simulator in the loop does not show"))
    };
    written.effects.iter().map(one).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::case::record::Channels;
    use crate::testing::arm::Arm;
    use crate::testing::random_input;

    /// Returns the contents of a file with a delay and a limit at the sensors, friction at the motor and play at the
    /// link.
    fn file() -> serde_json::Value {
        let value = |value: f64| serde_json::json!({ "value": value, "ci95": null, "unit": "" });
        serde_json::json!({
            "format": FORMAT, "simulator": Arm::new().description(), "t0": 1.0, "noise_rms": [0.01, 0.01],
            "parameters": { "link inertia": 0.05, "spring": 60.0, "motor damper": 0.2 },
            "ports": [{ "name": "motor", "mobility": 0.0625, "weight": 0.5 },
                      { "name": "link", "mobility": 0.025, "weight": 0.5 }],
            "effects": [
                { "effect": "sensor-delay", "location": "output:motor", "equation": "",
                  "parameters": { "tau": value(0.5) } },
                { "effect": "sensor-saturation", "location": "output:link", "equation": "",
                  "parameters": { "a": value(0.5) } },
                { "effect": "coulomb-friction", "location": "input:torque", "equation": "",
                  "parameters": { "F": value(0.1), "v0": value(0.1) } },
                { "effect": "backlash", "location": "port:link", "equation": "",
                  "parameters": { "k": value(1.0), "g": value(0.01) } },
            ],
            "expected_gap": 0.05,
            "fitted": { "input_rms": [1.0], "displacement_peak": [1.0, 1.0], "output_peak": [1.0, 1.0],
                        "unexplained": 0.01 }
        })
    }

    fn input() -> Channels {
        vec![random_input(3, 200, 1).remove(0).iter().map(|u| 0.5 * u).collect()]
    }

    /// A file that was edited by hand gives an error with the key, and neither a panic nor an endless loop.
    #[test]
    fn a_file_that_was_tampered_with_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("sim-with-effect.json");
        let library = Library::standard();
        let read = |value: &serde_json::Value| {
            std::fs::write(&path, value.to_string()).unwrap();
            LoopPredictor::read(&path, &library)
        };
        let good = read(&file()).unwrap().predict(&mut Arm::new(), &input(), 0.0).unwrap();
        assert!(good.outputs.iter().flatten().any(|y| *y != 0.0));
        for (at, value, said) in [
            ("/effects/0/parameters/tau/value", serde_json::json!(1e18), "`tau`"),
            ("/effects/1/parameters/a/value", serde_json::json!(-0.5), "`a` must be positive"),
            ("/effects/2/parameters", serde_json::json!({}), "has no parameter `F`"),
            ("/effects/2/location", serde_json::json!("output:motor"), "cannot act at"),
            // The input has no port any more.
            ("/simulator/ports/0/input", serde_json::json!(null), "cannot act at `input:torque`"),
            ("/effects/3/effect", serde_json::json!("play"), "there is no effect `play`"),
            ("/parameters", serde_json::json!({ "spring": 60.0 }), "has no `link inertia`"),
            ("/noise_rms", serde_json::json!([0.1]), "noise_rms"),
        ] {
            let mut bad = file();
            *bad.pointer_mut(at).unwrap() = value;
            let error = read(&bad).err().unwrap().to_string();
            assert!(error.contains(said) && error.contains("sim-with-effect.json"), "{at}: {error}");
        }
    }

    /// No effect panics at a location at which it cannot act, or in a simulator whose modes are not known.
    #[test]
    fn every_effect_is_read_or_refused_at_every_place() {
        let library = Library::standard();
        let places = ["structure", "input:torque", "loop:torque", "output:link", "output:motor->link", "mode:9"];
        let places: Vec<&str> = places.into_iter().chain(["port:link", "port:motor", "freq:3 port:link"]).collect();
        let (mut read, mut refused) = (Vec::new(), Vec::new());
        for effect in library.effects() {
            let bare = file();
            let own = LoopPredictor::new(serde_json::from_value(bare.clone()).unwrap(), &library).unwrap();
            let parameters: serde_json::Map<String, serde_json::Value> = effect
                .parameters(&own.setting)
                .iter()
                .map(|p| (p.name.clone(), serde_json::json!({ "value": 0.5, "ci95": null, "unit": "" })))
                .collect();
            for place in &places {
                let mut file = bare.clone();
                file["effects"] = serde_json::json!([
                    { "effect": effect.name(), "location": place, "parameters": parameters, "equation": "" }
                ]);
                match LoopPredictor::new(serde_json::from_value(file).unwrap(), &library) {
                    Err(_) => refused.push((effect.name(), *place)),
                    Ok(predictor) => {
                        read.push((effect.name(), *place));
                        let _ = predictor.predict(&mut Arm::new(), &[vec![1.0; 20]], 0.0);
                    }
                }
            }
        }
        assert!(read.len() > 30 && refused.len() > 200, "{} {}", read.len(), refused.len());
        assert!(read.contains(&("backlash", "port:link")) && refused.contains(&("missing-mode", "mode:9")));
        assert!(refused.contains(&("stiffness-drift", "structure")));
    }

    /// The change is that from the simulator as given: it contains the change of a parameter by the refit, even if
    /// there is no effect.
    #[test]
    fn a_change_contains_the_refit_of_the_parameters() {
        let library = Library::standard();
        let mut file = file();
        file["parameters"]["motor damper"] = serde_json::json!(0.5);
        let predictor = |file: &serde_json::Value| {
            LoopPredictor::new(serde_json::from_value(file.clone()).unwrap(), &library).unwrap()
        };
        let mut given = file.clone();
        given["effects"] = serde_json::json!([]);
        let refit = given.clone();
        let description = Arm::new().description().clone();
        for parameter in &description.parameters {
            given["parameters"][&parameter.name] = serde_json::json!(parameter.value);
        }
        let outputs =
            |file: &serde_json::Value| predictor(file).predict(&mut Arm::new(), &input(), 0.0).unwrap().outputs;
        let given = outputs(&given);
        for file in [&refit, &file] {
            let prediction = predictor(file).predict_change(&mut Arm::new(), &input(), 0.0).unwrap();
            let change = prediction.change.unwrap();
            let size = peak(&change.concat());
            assert!(size > 1e-3 && prediction.outputs == outputs(file), "{size}");
            for ((outputs, change), given) in prediction.outputs.iter().zip(&change).zip(&given) {
                let same = |((y, change), given): ((&f64, &f64), &f64)| (y - change - given).abs() < 1e-12;
                assert!(outputs.iter().zip(change).zip(given).all(same));
            }
            assert!(predictor(file).predict(&mut Arm::new(), &input(), 0.0).unwrap().change.is_none());
        }
    }

    /// An output that is finite but out of all proportion is refused, whether or not the file states the range of the
    /// fitted records.
    #[test]
    fn a_prediction_that_diverges_names_sample_and_output() {
        let library = Library::standard();
        let predicted = |gain: f64, fitted: bool, level: f64| {
            let mut file = file();
            file["effects"] = serde_json::json!([{
                "effect": "sensor-gain", "location": "output:link", "equation": "",
                "parameters": { "g": { "value": gain, "ci95": null, "unit": "" } }
            }]);
            if !fitted {
                file.as_object_mut().unwrap().remove("fitted");
            }
            let predictor = LoopPredictor::new(serde_json::from_value(file).unwrap(), &library).unwrap();
            let u: Channels = input().iter().map(|u| u.iter().map(|u| level * u).collect()).collect();
            predictor.predict(&mut Arm::new(), &u, 0.0)
        };
        for fitted in [true, false] {
            assert!(predicted(1.1, fitted, 1.0).is_ok());
            match predicted(1e250, fitted, 1.0) {
                Err(GapError::Diverged { output, sample, value, .. }) => {
                    assert!(output == "link" && (1..200).contains(&sample) && value.abs() > 1e200, "{sample}: {value}");
                }
                _ => panic!("a diverging prediction was handed over"),
            }
        }
        // An input far beyond the fitted range is no divergence.
        let loud = predicted(1.1, true, 1e4).unwrap();
        assert!(loud.beyond.unwrap().times > 100.0);
    }
}
