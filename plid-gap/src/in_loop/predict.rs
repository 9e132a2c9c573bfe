//! Predictions by a simulator with the effects that a diagnosis found.

use std::fs;
use std::path::Path;

use plid_simulator::{Checked, Description, Simulator};

use crate::answer::predict::{Prediction, place};
use crate::answer::range::{difference, expected_gap, require_sizes};
use crate::case::record::{Excitation, Record};
use crate::effects::{Effect, Library, Place, Setting};
use crate::error::GapError;
use crate::fit::problem::Placed;
use crate::in_loop::answer::SimulatorWithEffects;
use crate::in_loop::coupling::Response;
use crate::in_loop::parameter::SimulatorParameter;
use crate::in_loop::runs::Runs;
use crate::in_loop::survey;

/// The `format` of a sim-with-effect.json that belongs to a simulator in the loop.
pub const FORMAT: &str = "simulator-with-effects";

/// A prediction's effects, read from sim-with-effect.json. The simulator itself is given for each prediction.
pub struct LoopPredictor {
    /// The contents of the file.
    pub written: SimulatorWithEffects,
    setting: Setting,
    responses: Vec<Response>,
}

impl LoopPredictor {
    /// Reads a sim-with-effect.json.
    ///
    /// # Errors
    /// [`GapError::Io`]; [`GapError::Malformed`] with the reason.
    pub fn read(path: &Path) -> Result<Self, GapError> {
        let file = path.to_path_buf();
        let text = fs::read(path).map_err(|source| GapError::Io { file: file.clone(), source })?;
        let written: SimulatorWithEffects = serde_json::from_slice(&text)
            .map_err(|error| GapError::Malformed { file: file.clone(), message: error.to_string() })?;
        Self::new(written).map_err(|message| GapError::Malformed { file, message })
    }

    /// Creates a predictor from the contents of a sim-with-effect.json.
    ///
    /// # Errors
    /// Returns a sentence that states the fault of the contents.
    pub fn new(written: SimulatorWithEffects) -> Result<Self, String> {
        if written.format != FORMAT {
            return Err(format!("the format is {:?}, expected {FORMAT:?}", written.format));
        }
        let description = &written.simulator;
        description.check().map_err(|error| error.to_string())?;
        let step = 1.0 / (description.rate_hz * description.steps_per_sample.max(1) as f64);
        let names: Vec<&String> = description.ports.iter().map(|port| &port.name).collect();
        if !written.ports.iter().map(|port| &port.name).eq(names.iter().copied()) {
            return Err(format!("`ports` does not list the simulator's ports, {names:?}"));
        }
        let sound = |x: f64| x.is_finite() && x >= 0.0;
        if let Some(port) =
            written.ports.iter().find(|port| !(sound(port.mobility) && (0.0..=1.0).contains(&port.weight)))
        {
            return Err(format!("port {:?} has an impossible mobility or weight", port.name));
        }
        let (m, p) = (description.inputs.len(), description.outputs.len());
        require_sizes("noise_rms", &written.noise_rms, p)?;
        if let Some(fitted) = &written.fitted {
            fitted.require_sizes(m, description.ports.len(), p)?;
        }
        let response = |port: &super::WrittenPort| Response { mobility: port.mobility, weight: port.weight, step };
        let responses: Vec<Response> = written.ports.iter().map(response).collect();
        let setting = survey::bare(description, &responses).map_err(|error| error.to_string())?;
        Ok(Self { setting, responses, written })
    }

    /// Predicts the outputs (p channels) for inputs (m channels), from rest at time `t0`. An input or a motion beyond
    /// the fitted range takes a second run without the effects, because the expected gap depends on the correction by
    /// the effects.
    ///
    /// # Errors
    /// [`GapError::Simulator`] if the simulator fails; [`GapError::Failed`] if it is a different simulator or if the
    /// library lacks an effect.
    pub fn predict(
        &self,
        simulator: &mut dyn Simulator,
        library: &Library,
        u: &[Vec<f64>],
        t0: f64,
    ) -> Result<Prediction, GapError> {
        let checked = Checked::new(simulator)?;
        self.require_same(checked.description())?;
        let parameters = SimulatorParameter::all(&self.written.simulator.parameters);
        let effects = self.placed(library, &parameters).map_err(GapError::Failed)?;
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
        let exceeds = beyond.as_ref().is_some_and(|beyond| beyond.times > 1.0);
        let bare = if exceeds { runs.simulate(&self.setting, &[], &record)? } else { outputs.clone() };
        Ok(Prediction { correction: difference(&outputs, &bare), change: None, outputs, beyond })
    }

    /// Returns the relative gap that a prediction is expected to have, as
    /// [`Predictor::expected_gap`](crate::answer::predict::Predictor::expected_gap) does. A file of an earlier
    /// version does not state the fitted range, so its expected gap does not depend on the input.
    pub fn expected_gap(&self, prediction: &Prediction) -> Option<f64> {
        let SimulatorWithEffects { fitted, noise_rms, .. } = &self.written;
        match fitted {
            None => Some(self.written.expected_gap),
            Some(fitted) => expected_gap(Some(fitted), noise_rms, prediction, &prediction.outputs),
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

    fn placed<'a>(
        &self,
        library: &'a Library,
        parameters: &'a [SimulatorParameter],
    ) -> Result<Vec<Placed<'a>>, String> {
        let mut placed = Vec::new();
        for written in &self.written.effects {
            let name = &written.effect;
            let effect = library.get(name).ok_or_else(|| format!("there is no effect `{name}`"))?;
            let place = place(&written.location, effect, &self.setting)
                .ok_or_else(|| format!("{name}: `{}` is not a location of this effect", written.location))?;
            let value = |parameter: crate::effects::Parameter| {
                let value = written.parameters.get(&parameter.name).map(|value| value.value);
                value.filter(|value| value.is_finite()).ok_or_else(|| format!("{name} has no `{}`", parameter.name))
            };
            let is_written = |p: &crate::effects::Parameter| !p.optional || written.parameters.contains_key(&p.name);
            let all = effect.parameters(&self.setting).into_iter().take_while(is_written);
            let values = all.map(value).collect::<Result<_, _>>()?;
            placed.push(Placed { effect, place, parameters: values });
        }
        for (k, (effect, given)) in parameters.iter().zip(&self.written.simulator.parameters).enumerate() {
            let value = self.written.parameters.get(&given.name).copied();
            let value = value.filter(|value| value.is_finite());
            let value = value.ok_or_else(|| format!("`parameters` has no `{}`", given.name))?;
            if value != given.value {
                placed.push(Placed {
                    effect: effect as &dyn Effect,
                    place: Place::Parameter(k),
                    parameters: vec![value],
                });
            }
        }
        Ok(placed)
    }
}
