//! The simulation with its effects on a new input.

use std::path::Path;

use plid_model::Model;

use crate::answer::schema::SimulationWithEffects;
use crate::case::record::Channels;
use crate::effects::{Action, Effect, Flexible, Library, Place, Setting};
use crate::error::GapError;
use crate::plant::Plant;
use crate::simulate::{Fineness, simulate};

/// What a prediction needs, read back.
pub struct Predictor {
    /// Names, rate.
    pub model: Model,
    /// End of the last record.
    pub t0: f64,
    /// RMS of the noise of each output.
    pub noise_rms: Vec<f64>,
    plant: Plant,
    actions: Vec<Action>,
}

impl Predictor {
    /// Reads sim-with-effect.json.
    ///
    /// # Errors
    /// [`GapError`] with the file and what is wrong.
    pub fn read(path: &Path, library: &Library) -> Result<Self, GapError> {
        let malformed = |message: String| GapError::Malformed { file: path.into(), message };
        let text = std::fs::read_to_string(path).map_err(|source| GapError::Io { file: path.into(), source })?;
        let written: SimulationWithEffects = serde_json::from_str(&text).map_err(|e| malformed(e.to_string()))?;
        let model = Model::from_json(&written.linear, &path.display().to_string())?;
        let plant = Plant::new(&model)?;
        let setting = Setting::bare(&plant, &model);
        let mut actions = Vec::new();
        for written in &written.effects {
            let sibling = Flexible::named(&written.effect);
            let effect = library
                .get(&written.effect)
                .or(sibling.map(|sibling| sibling as &dyn Effect))
                .ok_or_else(|| malformed(format!("there is no effect `{}`", written.effect)))?;
            let place = place(&written.location, effect, &setting)
                .ok_or_else(|| malformed(format!("`{}` is no place of this simulation", written.location)))?;
            let mut parameters = Vec::new();
            for parameter in effect.parameters(&setting) {
                let value = written
                    .parameters
                    .get(&parameter.name)
                    .ok_or_else(|| malformed(format!("{} has no parameter `{}`", written.effect, parameter.name)))?;
                parameters.push(value.value);
            }
            let given = |name: &str| {
                let value = written.given.get(name).map(|given| given.value);
                value.ok_or_else(|| malformed(format!("{} lacks `{name}` among what is given", written.effect)))
            };
            actions.extend(match sibling {
                Some(sibling) => sibling.act_in(&setting, &place, [given("unit")?, given("size")?], &parameters),
                None => effect.act(&setting, &place, &parameters),
            });
        }
        Ok(Self { model, t0: written.t0, noise_rms: written.noise_rms, plant, actions })
    }

    /// Outputs (p channels) for inputs (m channels), from rest, from time `t0` on.
    pub fn run(&self, u: &[Vec<f64>], t0: f64) -> Channels {
        simulate(&self.plant, &self.actions, u, t0, None, Fineness::FINE)
    }

    /// The relative gap that noise alone makes beside such outputs.
    pub fn noise_gap(&self, y: &[Vec<f64>]) -> f64 {
        crate::judge::gap::floor(&self.noise_rms, y)
    }

    /// What the effects add to the linear simulation.
    pub fn correction(&self, u: &[Vec<f64>], t0: f64) -> Channels {
        let with = self.run(u, t0);
        let without = simulate(&self.plant, &[], u, t0, None, Fineness::FINE);
        with.iter().zip(&without).map(|(a, b)| a.iter().zip(b).map(|(a, b)| a - b).collect()).collect()
    }
}

/// A place as [`Place::location`] writes it.
fn place(location: &str, effect: &dyn Effect, setting: &Setting) -> Option<Place> {
    let names = &setting.names;
    let of = |list: &[String], name: &str| list.iter().position(|x| x == name);
    if location == "structure" {
        return Some(Place::Structure);
    }
    // Before the modes themselves: a port on one mode has the mode's own name.
    let has_strut =
        |k: usize| effect.places(setting).contains(&Place::Port(k)) || Flexible::named(effect.name()).is_some();
    if let Some(k) = of(&names.ports, location).filter(|&k| has_strut(k)) {
        return Some(Place::Port(k));
    }
    let (kind, at) = location.split_once(':')?;
    match kind {
        "input" if at == "all" => Some(Place::AllInputs),
        "input" => match at.split_once("->") {
            Some((i, j)) => Some(Place::InputToInput(of(&names.inputs, i)?, of(&names.inputs, j)?)),
            None => Some(Place::Input(of(&names.inputs, at)?)),
        },
        "output" => match at.split_once("->") {
            Some((i, j)) => Some(Place::OutputToOutput(of(&names.outputs, i)?, of(&names.outputs, j)?)),
            None => Some(Place::Output(of(&names.outputs, at)?)),
        },
        "port" => Some(Place::Port(of(&names.ports, at)?)),
        "mode" if effect.name() == "missing-mode" => Some(Place::MissingMode(at.parse().ok()?)),
        "mode" => Some(Place::Mode(setting.plant.mode_at(at.parse().ok()?)?)),
        "freq" => {
            let (hz, port) = at.split_once(" port:")?;
            Some(Place::Frequency(hz.parse().ok()?, of(&names.ports, port)?))
        }
        _ => None,
    }
}
