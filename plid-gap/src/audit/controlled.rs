//! The effects that are excluded from a case in closed loop: those on a command or on a measurement that cannot act
//! between the plant and its controller ([`Effect::acts_in_loop`]). A simulation applies them to a whole record before
//! or after the plant.

use plid_model::Model;

use crate::case::{Case, CaseConfig};
use crate::effects::{Effect, Library, Place, Setting, Side};
use crate::error::GapError;
use crate::plant::Plant;

/// Excludes these effects from a case in closed loop. Returns the excluded effects in words, with advice on how to find
/// them.
///
/// # Errors
/// Returns [`GapError::Model`] if the eigenvalues of the simulation cannot be computed.
pub fn leave_out(
    case: &mut Case,
    model: &Model,
    library: &Library,
    without: &[String],
) -> Result<Option<String>, GapError> {
    if case.controller.is_none() {
        return Ok(None);
    }
    let names = outside(model, library, without, &case.config)?;
    let finding = (!names.is_empty()).then(|| {
        format!(
            "Not considered, because they act inside the controller's loop: {}. To find them, diagnose with \
            your own simulator of the loop under `[simulator]`, or, if the simulation is stable, with the recorded \
            commands as inputs and without `[controller]`.",
            names.join(", ")
        )
    });
    case.config.exclude.extend(names);
    Ok(finding)
}

/// Returns the effects of the library that act on commands or measurements, change a free run and cannot act in a loop.
fn outside(model: &Model, library: &Library, without: &[String], config: &CaseConfig) -> Result<Vec<String>, GapError> {
    let setting = Setting::bare(&Plant::with_settings(model, &config.settings.plant)?, model);
    let is_channel = |place: &Place| matches!(place, Place::Input(_) | Place::AllInputs | Place::Output(_));
    let acts_outside = |effect: &dyn Effect| match effect.side() {
        Side::Actuator | Side::Sensor => true,
        Side::Time => effect.places(&setting).iter().any(is_channel),
        Side::Structure | Side::Disturbance => false,
    };
    let left_out = |effect: &&dyn Effect| {
        !effect.is_stochastic()
            && !effect.acts_in_loop()
            && acts_outside(*effect)
            && !without.iter().any(|name| name == effect.name())
    };
    Ok(library.effects().filter(left_out).map(|effect| effect.name().to_string()).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::truss;

    #[test]
    fn what_acts_on_a_channel_is_outside() {
        let config = CaseConfig::new(1.0, Vec::new(), Vec::new());
        let found = outside(&truss(1), &Library::standard(), &[], &config).unwrap();
        let has = |name: &str| found.iter().any(|other| other == name);
        for name in ["actuator-lag", "actuator-gain-drift", "sensor-delay", "sensor-drift", "mains-hum"] {
            assert!(has(name), "{name}");
        }
        for name in ["stick-friction", "added-mass", "modal-frequency", "stiffness-drift", "narrowband-disturbance"] {
            assert!(!has(name), "{name}");
        }
        for name in ["actuator-gain", "actuator-crosstalk", "sensor-gain", "sensor-crosstalk"] {
            assert!(!has(name), "{name}");
        }
        assert!(!has("sensor-noise"));
    }
}
