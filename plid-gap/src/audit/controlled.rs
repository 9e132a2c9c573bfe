//! The effects that a case in closed loop cannot have.

use plid_model::Model;

use crate::case::CaseConfig;
use crate::effects::{Effect, Library, Place, Setting, Side};
use crate::error::GapError;
use crate::plant::Plant;

/// Effects on a command or on a measurement. In closed loop they act between the plant and its controller, at each
/// sample, whereas a simulation applies them to a whole record before or behind it.
pub struct Outside {
    /// Names of the effects.
    pub names: Vec<String>,
}

impl Outside {
    /// States what was left out, and what can be done about it.
    pub fn finding(&self) -> Option<String> {
        (!self.names.is_empty()).then(|| {
            format!(
                "Left out, because a controller is declared and they act inside its loop: {}. To find them, diagnose \
                with your own simulator of the loop under `[simulator]`, or, if the simulation is stable, with the \
                recorded commands as inputs and without `[controller]`.",
                self.names.join(", ")
            )
        })
    }
}

/// Returns the effects of the library that act on commands or measurements and change a free run.
///
/// # Errors
/// [`GapError::Model`].
pub fn outside(model: &Model, library: &Library, without: &[String], config: &CaseConfig) -> Result<Outside, GapError> {
    let setting = Setting::bare(&Plant::with_settings(model, &config.settings.plant)?, model);
    let is_channel = |place: &Place| matches!(place, Place::Input(_) | Place::AllInputs | Place::Output(_));
    let acts_outside = |effect: &dyn Effect| match effect.side() {
        Side::Actuator | Side::Sensor => true,
        Side::Time => effect.places(&setting).iter().any(is_channel),
        Side::Structure | Side::Disturbance => false,
    };
    let left_out = |effect: &&dyn Effect| {
        !effect.is_stochastic() && acts_outside(*effect) && !without.iter().any(|name| name == effect.name())
    };
    Ok(Outside { names: library.effects().filter(left_out).map(|effect| effect.name().to_string()).collect() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::truss;

    #[test]
    fn what_acts_on_a_channel_is_outside() {
        let config = CaseConfig::new(1.0, Vec::new(), Vec::new());
        let found = outside(&truss(1), &Library::standard(), &[], &config).unwrap();
        let has = |name: &str| found.names.iter().any(|other| other == name);
        for name in
            ["actuator-lag", "actuator-gain-drift", "actuator-crosstalk", "sensor-delay", "sensor-drift", "mains-hum"]
        {
            assert!(has(name), "{name}");
        }
        for name in ["stick-friction", "added-mass", "modal-frequency", "stiffness-drift", "narrowband-disturbance"] {
            assert!(!has(name), "{name}");
        }
        assert!(!has("sensor-noise") && found.finding().unwrap().contains("[simulator]"));
    }
}
