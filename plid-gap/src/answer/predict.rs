//! Predictions: the simulation with its effects for a new input.

use std::path::Path;
use std::sync::Arc;

use plid_model::Model;

use crate::answer::range::{Beyond, FittedRange, difference, displacement_peaks, expected_gap, peak, require_sizes};
use crate::answer::schema::{SimulationWithEffects, WrittenEffect};
use crate::case::record::Channels;
use crate::case::{Controller, Intersample};
use crate::effects::{Action, Effect, Flexible, Library, Parameter, Place, Range, Setting};
use crate::error::GapError;
use crate::fit::free_run::diverges;
use crate::fit::problem::Placed;
use crate::plant::Plant;
use crate::simulate::{Fineness, simulate};

/// Longest delay in samples that a file may contain, to bound memory.
const LONGEST_DELAY: f64 = 1e6;

/// A simulation with effects for predictions, read from a file.
pub struct Predictor {
    /// The linear model, with names and sample rate.
    pub model: Model,
    /// Names of the input channels of a prediction: the inputs of the model or, in closed loop, the channels that
    /// drive the loop ([`Controller::drivers`]).
    pub inputs: Vec<String>,
    /// End of the last record in s.
    pub t0: f64,
    /// RMS of the noise of each output.
    pub noise_rms: Vec<f64>,
    /// The range of the fitted records, if the file states it.
    pub fitted: Option<FittedRange>,
    intersample: Intersample,
    plant: Plant,
    as_given: Option<Plant>,
    actions: Vec<Action>,
    /// Whether one of the effects is a curve without a law.
    is_curve: bool,
}

/// A prediction and its reliability.
#[derive(Debug, Clone)]
pub struct Prediction {
    /// Outputs (p channels).
    pub outputs: Channels,
    /// Change of the outputs by the effects.
    pub correction: Channels,
    /// Change of the outputs of the simulation as given, by the effects and the refit; `None` if the file does not
    /// contain the simulation as given, or if it was not asked for with a simulator in the loop.
    pub change: Option<Channels>,
    /// The excess of the input over the fitted range; `None` if the file does not state the range.
    pub beyond: Option<Beyond>,
}

impl Predictor {
    /// Reads sim-with-effect.json.
    ///
    /// # Errors
    /// Returns a [`GapError`] with the file and the fault.
    pub fn read(path: &Path, library: &Library) -> Result<Self, GapError> {
        let text = std::fs::read_to_string(path).map_err(|source| GapError::Io { file: path.into(), source })?;
        let written: SimulationWithEffects = serde_json::from_str(&text)
            .map_err(|error| GapError::Malformed { file: path.into(), message: error.to_string() })?;
        Self::new(written, library, path)
    }

    /// Creates a predictor from the contents of such a file. `path` names the file in errors.
    ///
    /// # Errors
    /// Returns a [`GapError`] with the fault.
    pub fn new(written: SimulationWithEffects, library: &Library, path: &Path) -> Result<Self, GapError> {
        let malformed = |message: String| GapError::Malformed { file: path.into(), message };
        let model = Model::from_json(&written.linear, &path.display().to_string())?;
        let mut plant = Plant::in_modal_coordinates(&model, written.modes, &written.plant)?;
        // The range lists every port. The model after the refit may appear to have a further one.
        if written.fitted.as_ref().is_some_and(|fitted| fitted.displacement_peak.is_empty()) {
            plant.ports.clear();
        }
        if let Some(controller) = &written.controller {
            let place = format!("{}: controller", path.display());
            let controller = Controller::new(&model, Model::from_json(controller, &place)?)?;
            plant.close(Arc::new(controller));
        }
        let inputs = plant.controller.as_ref().map_or(model.inputs.clone(), |controller| controller.drivers());
        let setting = Setting::bare(&plant, &model);
        require_possible_sizes(&written, &plant).map_err(malformed)?;
        let (mut actions, mut is_curve) = (Vec::new(), false);
        for written in &written.effects {
            let sibling = Flexible::named(&written.effect);
            let effect = library
                .get(&written.effect)
                .or(sibling.map(|sibling| sibling as &dyn Effect))
                .ok_or_else(|| malformed(format!("there is no effect `{}`", written.effect)))?;
            is_curve |= Flexible::is_curve(effect);
            let Placed { place, parameters, .. } = placed(written, effect, library, &setting).map_err(malformed)?;
            let given = |name: &str| {
                let value = written.given.get(name).map(|given| given.value);
                value.ok_or_else(|| malformed(format!("{} lacks `{name}` under `given`", written.effect)))
            };
            actions.extend(match sibling {
                Some(sibling) => sibling.act_in(&setting, &place, [given("unit")?, given("size")?], &parameters),
                None => effect.act(&setting, &place, &parameters),
            });
        }
        if plant.loops_within_sample() && actions.iter().any(Action::is_between) {
            let why = "its effects act between a controller and a model that both respond within a sample";
            return Err(malformed(format!("{why}, which cannot be simulated")));
        }
        let as_given = written.as_given.as_ref().map(|given| -> Result<Plant, GapError> {
            let given = Model::from_json(given, &format!("{}: as_given", path.display()))?;
            if (&given.inputs, &given.outputs) != (&model.inputs, &model.outputs) {
                return Err(malformed("as_given: its channels are not those of `linear`".into()));
            }
            let mut given = Plant::with_settings(&given, &written.plant)?;
            plant.controller.iter().for_each(|controller| given.close(controller.clone()));
            Ok(given)
        });
        let as_given = as_given.transpose()?;
        let SimulationWithEffects { t0, noise_rms, fitted, intersample, .. } = written;
        Ok(Self { model, inputs, t0, noise_rms, fitted, intersample, plant, as_given, actions, is_curve })
    }

    /// Returns the part of commands (m channels) that does not come from feedback, as the input of a prediction.
    /// `measured` are the outputs that were measured with these commands (p channels). `None` if a prediction takes
    /// the commands themselves or references as its input.
    pub fn without_feedback(&self, commands: &[Vec<f64>], measured: &[Vec<f64>]) -> Option<Channels> {
        let controller = self.plant.controller.as_ref().filter(|controller| controller.references.is_empty())?;
        Some(controller.without_feedback(commands, measured))
    }

    /// Predicts the outputs for the channels of [`Predictor::inputs`], starting from rest at time `t0`.
    ///
    /// # Errors
    /// Returns [`GapError::Diverged`] with the first sample that is not finite or is out of bounds.
    pub fn predict(&self, u: &[Vec<f64>], t0: f64) -> Result<Prediction, GapError> {
        let u = &self.driven(u);
        let outputs = self.free_run(u, t0);
        let linear = simulate(&self.plant, &[], u, t0, None, Fineness::FINE);
        self.require_bounded(&outputs, &linear)?;
        let correction = difference(&outputs, &linear);
        let beyond = self.fitted.as_ref().map(|fitted| {
            let ports = self.plant.ports.iter().map(|port| &port.name);
            fitted.beyond(&self.model.inputs, u, ports, &displacement_peaks(&self.plant, u))
        });
        let given = self.as_given.as_ref().map(|given| simulate(given, &[], u, t0, None, Fineness::FINE));
        let change = given.map(|given| difference(&outputs, &given));
        Ok(Prediction { outputs, correction, change, beyond })
    }

    fn require_bounded(&self, outputs: &[Vec<f64>], linear: &[Vec<f64>]) -> Result<(), GapError> {
        let fitted = |o: usize| self.fitted.as_ref().map_or(0.0, |fitted| fitted.output_peak[o]);
        let peaks: Vec<f64> = linear.iter().enumerate().map(|(o, y)| peak(y).max(fitted(o))).collect();
        require_bounded(&self.model.outputs, outputs, &peaks)
    }

    /// Returns the relative gap that a prediction is expected to have. The squares of three parts add up: the noise;
    /// the gap that the fitted records left beyond the noise, multiplied by the excess of the input over them
    /// ([`Beyond::times`]); and the share 1 - 1 / times of the effects' correction. If one of the effects is a curve
    /// without a law, the whole correction counts where the excess is clear. `None` if an output is zero, because no
    /// gap can be relative to it.
    pub fn expected_gap(&self, prediction: &Prediction, outputs: &[Vec<f64>]) -> Option<f64> {
        expected_gap(self.fitted.as_ref(), &self.noise_rms, prediction, outputs, self.is_curve)
    }

    /// Simulates the outputs (p channels) for the channels of [`Predictor::inputs`], starting from rest at time `t0`,
    /// without a check for divergence.
    pub fn run(&self, u: &[Vec<f64>], t0: f64) -> Channels {
        self.free_run(&self.driven(u), t0)
    }

    /// Returns the inputs of the model (m channels): in closed loop, the part of the command without feedback.
    fn driven(&self, u: &[Vec<f64>]) -> Channels {
        let held = self.intersample.held(u);
        self.plant.controller.as_ref().map_or(held.clone(), |controller| controller.driven_by(&held))
    }

    fn free_run(&self, held: &[Vec<f64>], t0: f64) -> Channels {
        simulate(&self.plant, &self.actions, held, t0, None, Fineness::FINE)
    }
}

/// Checks that no output exceeds its expected peak by so much that the run has diverged. Both lists have an entry for
/// each of the outputs with these names.
///
/// # Errors
/// [`GapError::Diverged`] with the first sample that is not finite or is out of bounds.
pub(crate) fn require_bounded(names: &[String], outputs: &[Vec<f64>], peaks: &[f64]) -> Result<(), GapError> {
    let first = |(o, y): (usize, &Vec<f64>)| Some((y.iter().position(|&y| diverges(y, peaks[o]))?, o));
    match outputs.iter().enumerate().filter_map(first).min() {
        None => Ok(()),
        Some((sample, o)) => {
            let (value, expected) = (outputs[o][sample], peaks[o]);
            Err(GapError::Diverged { output: names[o].clone(), sample, value, expected })
        }
    }
}

/// Checks that every list has an entry for each channel and that every number is possible.
fn require_possible_sizes(written: &SimulationWithEffects, plant: &Plant) -> Result<(), String> {
    require_finite("t0", written.t0)?;
    require_sizes("noise_rms", &written.noise_rms, plant.p)?;
    written.fitted.as_ref().map_or(Ok(()), |fitted| fitted.require_sizes(plant.m, plant.ports.len(), plant.p))
}

/// Checks that a number from a file is finite.
///
/// # Errors
/// Returns a sentence that names the key.
pub(crate) fn require_finite(key: &str, value: f64) -> Result<(), String> {
    if value.is_finite() { Ok(()) } else { Err(format!("`{key}` is {value}")) }
}

/// Returns an effect of a file at its location, with its parameters. No run with it can hang or panic.
///
/// # Errors
/// Returns a sentence that names the effect, and its location or the parameter that is impossible.
pub(crate) fn placed<'e>(
    written: &WrittenEffect,
    effect: &'e dyn Effect,
    library: &Library,
    setting: &Setting,
) -> Result<Placed<'e>, String> {
    let name = &written.effect;
    let place = place(&written.location, effect, setting)
        .filter(|place| acts_at(place, effect, library, setting))
        .ok_or_else(|| format!("{name}: it cannot act at `{}`", written.location))?;
    let value = |parameter: Parameter| {
        let value = written.parameters.get(&parameter.name).map(|value| value.value);
        let value = value.ok_or_else(|| format!("{name} has no parameter `{}`", parameter.name))?;
        require_possible(&parameter, value, setting.plant.rate)
            .map_err(|reason| format!("{name}: `{}` {reason}", parameter.name))?;
        Ok(value)
    };
    let is_written = |p: &Parameter| !p.optional || written.parameters.contains_key(&p.name);
    let all = effect.parameters(setting).into_iter().take_while(is_written);
    Ok(Placed { effect, place, parameters: all.map(value).collect::<Result<_, String>>()? })
}

/// Checks that a parameter can have this value.
fn require_possible(parameter: &Parameter, value: f64, rate: f64) -> Result<(), String> {
    if !value.is_finite() {
        return Err(format!("is {value}"));
    }
    match parameter.range {
        Range::Positive if value <= 0.0 => Err(format!("must be positive, but is {value}")),
        Range::Hz if !(value > 0.0 && value < rate) => Err(format!("must lie between 0 and {rate} Hz, but is {value}")),
        _ if parameter.unit == "samples" && value.abs() > LONGEST_DELAY => {
            Err(format!("is {value:e} samples, but at most {LONGEST_DELAY:e} are possible"))
        }
        _ => Ok(()),
    }
}

/// Returns whether an effect can act at a location. A frequency need not be among the effect's locations. A free shape
/// acts where the effects that it replaces do.
fn acts_at(place: &Place, effect: &dyn Effect, library: &Library, setting: &Setting) -> bool {
    if matches!(place, Place::MissingMode(_) | Place::Frequency(..)) {
        return true;
    }
    let Some(shape) = Flexible::named(effect.name()) else { return effect.places(setting).contains(place) };
    let is_sibling = |effect: &&dyn Effect| effect.free_shape().is_some_and(|of| of.name() == shape.name());
    library.effects().filter(is_sibling).any(|effect| effect.places(setting).contains(place))
}

/// Returns the place of a location that [`Place::location`] wrote.
fn place(location: &str, effect: &dyn Effect, setting: &Setting) -> Option<Place> {
    let names = &setting.names;
    let of = |list: &[String], name: &str| list.iter().position(|x| x == name);
    if location == "structure" {
        return Some(Place::Structure);
    }
    // Ports come before modes, because a port on a single mode has the mode's name.
    let has_port =
        |k: usize| effect.places(setting).contains(&Place::Port(k)) || Flexible::named(effect.name()).is_some();
    if let Some(k) = of(&names.ports, location).filter(|&k| has_port(k)) {
        return Some(Place::Port(k));
    }
    let hz = |text: &str| text.parse().ok().filter(|hz: &f64| hz.is_finite() && *hz > 0.0);
    let (kind, at) = location.split_once(':')?;
    match kind {
        "input" if at == "all" => Some(Place::AllInputs),
        "input" => match at.split_once("->") {
            Some((i, j)) => Some(Place::InputToInput(of(&names.inputs, i)?, of(&names.inputs, j)?)),
            None => Some(Place::Input(of(&names.inputs, at)?)),
        },
        "loop" => Some(Place::Loop(of(&names.inputs, at)?)),
        "output" => match at.split_once("->") {
            Some((i, j)) => Some(Place::OutputToOutput(of(&names.outputs, i)?, of(&names.outputs, j)?)),
            None => Some(Place::Output(of(&names.outputs, at)?)),
        },
        "parameter" => Some(Place::Parameter(of(&names.parameters, at)?)),
        "port" => Some(Place::Port(of(&names.ports, at)?)),
        "mode" if effect.adds_mode() => Some(Place::MissingMode(hz(at)?)),
        "mode" => Some(Place::Mode(setting.plant.mode_at(hz(at)?)?)),
        "freq" => {
            let (tone, port) = at.split_once(" port:")?;
            Some(Place::Frequency(hz(tone)?, of(&names.ports, port)?))
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::case::record::rms;
    use crate::effects::CubicStiffness;
    use crate::testing::{random_input, record, run, truss, truss_with};
    use plid_fourier::C;

    /// Returns a predictor with a softening spring at the first port, fitted at a hundredth of the level at which the
    /// spring loses its stiffness, and an input at ten times that level.
    fn softening() -> (Predictor, Channels) {
        let model = truss(1);
        let plant = Plant::new(&model).unwrap();
        let mut setting = Setting::bare(&plant, &model);
        let u = random_input(3, 2000, 2);
        let loud = record(u.clone(), vec![vec![0.0; 2000]; 2]);
        crate::prepare::of_ports(&mut setting, std::slice::from_ref(&loud));
        // The spring's stiffness vanishes at a tenth of the motion of this record.
        let k = -100.0 * setting.stiffness[0] / setting.d_rms[0].powi(2);
        let actions = CubicStiffness.act(&setting, &Place::Port(0), &[k]);
        let quiet = scaled(&u, 1e-3);
        let y = simulate(&plant, &[], &quiet, 0.0, None, Fineness::FINE);
        let peaks = displacement_peaks(&plant, &quiet);
        let fitted = FittedRange::of(&[record(quiet, y)], &[peaks], 0.01, 0.005);
        let (intersample, inputs) = (Intersample::Zoh, model.inputs.clone());
        (
            Predictor {
                model,
                inputs,
                t0: 0.0,
                noise_rms: vec![0.0; 2],
                fitted: Some(fitted),
                intersample,
                plant,
                as_given: None,
                actions,
                is_curve: false,
            },
            u,
        )
    }

    fn scaled(u: &[Vec<f64>], by: f64) -> Channels {
        u.iter().map(|u| u.iter().map(|u| by * u).collect()).collect()
    }

    #[test]
    fn a_prediction_that_diverges_names_sample_and_output() {
        let (predictor, u) = softening();
        assert!(predictor.predict(&scaled(&u, 1e-3), 0.0).is_ok());
        let wild = predictor.run(&u, 0.0);
        assert!(wild.iter().flatten().any(|y| !y.is_finite() || y.abs() > 1e6), "it does not diverge");
        match predictor.predict(&u, 0.0) {
            Err(GapError::Diverged { output, sample, .. }) => {
                assert!(predictor.model.outputs.contains(&output) && sample < 2000, "{output} {sample}");
            }
            _ => panic!("a diverging prediction was handed over"),
        }
    }

    #[test]
    fn the_expected_gap_grows_beyond_what_was_fitted() {
        let (predictor, u) = softening();
        let mut before = 0.0;
        for (level, times) in [(5e-4, 1.0), (1e-3, 1.0), (3e-3, 3.0), (1e-2, 10.0)] {
            let prediction = predictor.predict(&scaled(&u, level), 0.0).unwrap();
            let beyond = prediction.beyond.clone().unwrap();
            assert!((beyond.times / times - 1.0).abs() < 1e-6, "{beyond:?}");
            assert_eq!(beyond.what.is_empty(), times == 1.0, "{beyond:?}");
            let gap = predictor.expected_gap(&prediction, &prediction.outputs).unwrap();
            assert!(
                if times > 1.0 { gap > 2.0 * before } else { (gap - 0.00866).abs() < 1e-4 },
                "{gap} after {before}"
            );
            before = gap;
        }
        let nothing = predictor.predict(&scaled(&u, 0.0), 0.0).unwrap();
        assert_eq!(predictor.expected_gap(&nothing, &nothing.outputs), None);
    }

    /// Clearly beyond the fitted range, the whole correction by a curve without a law is uncertain. Within the range,
    /// and with a law, nothing changes.
    #[test]
    fn a_curve_without_a_law_is_not_extrapolated() {
        let (mut predictor, u) = softening();
        for (level, beyond) in [(5e-4, false), (1e-3, false), (1.1e-3, false), (3e-3, true), (1e-2, true)] {
            let prediction = predictor.predict(&scaled(&u, level), 0.0).unwrap();
            let [law, curve] = [false, true].map(|is_curve| {
                predictor.is_curve = is_curve;
                predictor.expected_gap(&prediction, &prediction.outputs).unwrap()
            });
            let ratios = prediction.correction.iter().zip(&prediction.outputs).map(|(c, y)| (rms(c) / rms(y)).powi(2));
            let correction = (ratios.sum::<f64>() / 2.0).sqrt();
            if beyond {
                let known = 1.0 - 1.0 / prediction.beyond.unwrap().times;
                let more = correction * correction * (1.0 - known * known);
                assert!(curve > law && curve > correction, "{level}: {curve} {law} {correction}");
                assert!((curve * curve - law * law - more).abs() < 1e-9 * curve * curve, "{level}: {curve} {law}");
            } else {
                assert_eq!(curve.to_bits(), law.to_bits(), "{level}");
            }
        }
    }

    /// A file shows whether one of its effects is a curve without a law. The weights of a free path hold at any level.
    #[test]
    fn a_file_shows_whether_an_effect_is_a_curve() {
        let model = truss(1);
        let read = |effect: &str, count: usize| {
            let value = serde_json::json!({ "value": 0.01, "unit": "1" });
            let parameters: serde_json::Map<_, _> = (1..=count).map(|k| (format!("s_{k}"), value.clone())).collect();
            let file = serde_json::json!({
                "format": "simulation-with-effects",
                "linear": Plant::new(&model).unwrap().to_model(&model).to_json(),
                "modes": 4, "refit": [], "t0": 1.0, "noise_rms": [0.1, 0.1],
                "effects": [{ "effect": effect, "location": "output:y2", "equation": "", "parameters": parameters,
                              "given": { "unit": value, "size": value } }],
            });
            let file = serde_json::from_value(file).unwrap();
            Predictor::new(file, &Library::standard(), Path::new("sim.json")).unwrap().is_curve
        };
        assert!(read("free-sensor", 16));
        assert!(!read("free-sensor-path", 4));
    }

    /// The outputs of the simulation as given and the change by refit and effects add up to the prediction, even where
    /// the refit changed the linear model.
    #[test]
    fn the_change_of_the_simulation_as_given_contains_the_refit() {
        let given = truss(1);
        let refitted = truss_with(1, |modes, shapes, _| {
            modes[0].0 *= 1.01;
            shapes.column_mut(0).scale_mut(1.2);
        });
        let path = Path::new("sim-with-effect.json");
        let read = |as_given: &Model| {
            let file = serde_json::json!({
                "format": "simulation-with-effects",
                "linear": Plant::new(&refitted).unwrap().to_model(&refitted).to_json(),
                "modes": 4, "refit": [], "t0": 1.0, "noise_rms": [0.1, 0.1], "as_given": as_given.to_json(),
                "effects": [
                    { "effect": "sensor-saturation", "location": "output:y2", "equation": "",
                      "parameters": { "a": { "value": 0.5, "ci95": null, "unit": "V" } } },
                ]
            });
            Predictor::new(serde_json::from_value(file).unwrap(), &Library::standard(), path)
        };
        let u = random_input(7, 600, 2);
        let prediction = read(&given).unwrap().predict(&u, 0.0).unwrap();
        let sizes = prediction.outputs.iter().map(rms);
        let change = prediction.change.as_ref().unwrap();
        for (((own, change), y), size) in run(&given, &u).iter().zip(change).zip(&prediction.outputs).zip(sizes) {
            let off = own.iter().zip(change).zip(y).map(|((own, change), y)| (own + change - y).abs());
            assert!(off.fold(0.0, f64::max) < 1e-9 * size);
        }
        let further = |correction: &Channels| rms(&correction[0]);
        assert!(further(change) > 10.0 * further(&prediction.correction));
        let other = Model { outputs: vec!["y2".into(), "y1".into()], ..given.clone() };
        let said = read(&other).map(|_| ()).unwrap_err().to_string();
        assert!(said.contains("as_given: its channels"), "{said}");
    }

    /// A simulation without a port may appear to have one after its refit, because of the slope of its response. The
    /// file states that there was none.
    #[test]
    fn ports_are_not_inferred_again() {
        use nalgebra::dmatrix;
        let model = Model::new(100.0, dmatrix![0.9], dmatrix![1.0], dmatrix![0.1], dmatrix![0.0]).unwrap();
        assert_eq!(Plant::new(&model).unwrap().ports.len(), 1);
        let read = |peaks: &[f64]| {
            let file = serde_json::json!({
                "format": "simulation-with-effects", "linear": model.to_json(), "modes": 0, "refit": [], "t0": 1.0,
                "noise_rms": [0.1], "effects": [],
                "fitted": { "input_rms": [1.0], "displacement_peak": peaks, "output_peak": [1.0], "unexplained": 0.1 }
            });
            Predictor::new(serde_json::from_value(file).unwrap(), &Library::standard(), Path::new("sim.json"))
        };
        let predictor = read(&[]).unwrap();
        assert!(predictor.plant.ports.is_empty());
        assert_eq!(predictor.predict(&[vec![1.0; 50]], 0.0).unwrap().outputs, run(&model, &[vec![1.0; 50]]));
        assert!(read(&[1.0]).is_ok() && read(&[1.0, 1.0]).is_err());
    }

    /// A file that was edited by hand gives an error with the key, and neither a panic nor an endless loop.
    #[test]
    fn a_file_that_was_tampered_with_is_refused() {
        let model = truss(1);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("sim-with-effect.json");
        let good = serde_json::json!({
            "format": "simulation-with-effects",
            "linear": Plant::new(&model).unwrap().to_model(&model).to_json(),
            "modes": 4, "refit": [], "t0": 1.0, "noise_rms": [0.1, 0.1],
            "effects": [
                { "effect": "sensor-delay", "location": "output:y1", "equation": "",
                  "parameters": { "tau": { "value": 0.5, "ci95": null, "unit": "samples" } } },
                { "effect": "sensor-saturation", "location": "output:y2", "equation": "",
                  "parameters": { "a": { "value": 0.5, "ci95": null, "unit": "V" } } },
                // A converter that rounds does not truncate.
                { "effect": "sensor-quantisation", "location": "output:y2", "equation": "",
                  "parameters": { "q": { "value": 0.01, "ci95": null, "unit": "V" },
                                  "cut": { "value": 0.0, "ci95": null, "unit": "steps" } } },
            ]
        });
        let read = |value: &serde_json::Value| {
            std::fs::write(&path, value.to_string()).unwrap();
            Predictor::read(&path, &Library::standard()).map(|_| ())
        };
        read(&good).unwrap();
        for (at, value, said) in [
            ("/effects/0/parameters/tau/value", serde_json::json!(1e18), "tau"),
            ("/effects/1/parameters/a/value", serde_json::json!(-0.5), "positive"),
            ("/effects/0/location", serde_json::json!("output:none"), "cannot act at"),
            ("/noise_rms", serde_json::json!([0.1]), "noise_rms"),
            ("/noise_rms", serde_json::json!([0.1, -1.0]), "noise_rms"),
        ] {
            let mut bad = good.clone();
            *bad.pointer_mut(at).unwrap() = value;
            let error = read(&bad).unwrap_err().to_string();
            assert!(error.contains(said) && error.contains("sim-with-effect.json"), "{at}: {error}");
        }
    }

    /// No effect panics at a location at which it cannot act: an input may have no port, and an output never has one.
    #[test]
    fn every_effect_is_read_or_refused_at_every_place() {
        let model = truss(1);
        let plant = Plant::new(&model).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("sim-with-effect.json");
        let bare = {
            let mut bare = plant.to_model(&model);
            bare.ports.clear();
            bare
        };
        let library = Library::standard();
        let (mut read, mut refused) = (0, 0);
        for model in [&plant.to_model(&model), &bare] {
            let setting = Setting::bare(&Plant::new(model).unwrap(), model);
            let port = setting.names.ports.first().map_or("none", String::as_str);
            let places = ["structure", "input:u1", "input:all", "input:u1->u2", "output:y2", "output:y1->y2", "mode:9"];
            let places = places.into_iter().map(str::to_string).chain([format!("port:{port}"), port.to_string()]);
            let places: Vec<String> = places.chain([format!("freq:3 port:{port}"), "mode:nan".into()]).collect();
            let siblings = library.effects().filter_map(|e| Some(e.free_shape()? as &dyn Effect));
            for effect in library.effects().chain(siblings) {
                let parameters: serde_json::Map<String, serde_json::Value> = effect
                    .parameters(&setting)
                    .iter()
                    .map(|p| (p.name.to_string(), serde_json::json!({ "value": 0.5, "unit": p.unit })))
                    .collect();
                let given = serde_json::json!({ "value": 1.0, "unit": "" });
                for place in &places {
                    let file = serde_json::json!({
                        "format": "simulation-with-effects", "linear": model.to_json(), "modes": 4, "refit": [],
                        "t0": 1.0, "noise_rms": [0.1, 0.1],
                        "effects": [{ "effect": effect.name(), "location": place, "parameters": parameters,
                                      "given": { "unit": given, "size": given }, "equation": "" }],
                    });
                    std::fs::write(&path, file.to_string()).unwrap();
                    match Predictor::read(&path, &library) {
                        Ok(_) => read += 1,
                        Err(_) => refused += 1,
                    }
                }
            }
        }
        assert!(read > 50 && refused > 50, "{read} {refused}");
    }

    /// A refit may move a damping ratio past the threshold of a structural mode. The file states how many modes there
    /// are.
    #[test]
    fn modes_are_not_chosen_again() {
        let given = truss_with(1, |modes, _, _| modes[3].1 = 0.28);
        let mut plant = Plant::new(&given).unwrap();
        let w = plant.modes[3].pole.norm();
        plant.move_pole(3, C::new(-0.32 * w, w * (1.0 - 0.32_f64.powi(2)).sqrt()));
        let linear = plant.to_model(&given);
        assert_eq!((plant.modes.len(), Plant::new(&linear).unwrap().modes.len()), (4, 3));
        let file = serde_json::json!({
            "format": "simulation-with-effects", "linear": linear.to_json(), "modes": 4, "refit": [], "t0": 1.0,
            "noise_rms": [0.1, 0.1],
            "effects": [{ "effect": "modal-damping", "location": "mode:243.0", "equation": "",
                          "parameters": { "rho": { "value": 1.2, "unit": "1" } } }],
        });
        let file = serde_json::from_value(file).unwrap();
        let read = Predictor::new(file, &Library::standard(), Path::new("sim.json")).unwrap().plant;
        assert_eq!(read.modes.len(), 4);
        assert!((read.modes[3].damping() - 0.32).abs() < 1e-9, "{}", read.modes[3].damping());
    }
}
