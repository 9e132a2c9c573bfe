//! The effects that are excluded from a case in closed loop if the plant and its controller both respond within a
//! sample: those on a command or on a measurement that are no change of the plant ([`Effect::acts_in_loop`]). The
//! command at a sample would then be the solution of an equation that contains the effect.

use plid_model::Model;

use crate::case::Case;
use crate::effects::{Action, Effect, Library, Place, Setting, Side};
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
    let Some(controller) = &case.controller else { return Ok(None) };
    let mut plant = Plant::with_settings(model, &case.config.settings.plant)?;
    plant.close(controller.clone());
    if !plant.loops_within_sample() {
        return Ok(None);
    }
    let names = outside(&Setting::bare(&plant, model), library, without);
    let finding = (!names.is_empty()).then(|| {
        format!(
            "Not considered, because the simulation and the controller both respond within a sample: {}. To find \
            them, diagnose with your own simulator of the loop under `[simulator]`, or, if the simulation is stable, \
            with the recorded commands as inputs and without `[controller]`.",
            names.join(", ")
        )
    });
    case.config.exclude.extend(names);
    Ok(finding)
}

/// Returns the effects of the library that act on commands or measurements, change a free run and cannot act in such a
/// loop.
fn outside(setting: &Setting, library: &Library, without: &[String]) -> Vec<String> {
    let is_channel = |place: &Place| matches!(place, Place::Input(_) | Place::AllInputs | Place::Output(_));
    let acts_between = |effect: &dyn Effect, place: &Place| {
        let starts = effect.starts(setting, place);
        starts.iter().any(|start| effect.act(setting, place, start).iter().any(Action::is_between))
    };
    let acts_outside = |effect: &dyn Effect| match effect.side() {
        Side::Actuator | Side::Sensor => true,
        Side::Time => effect.places(setting).iter().any(is_channel),
        Side::Structure | Side::Disturbance => effect.places(setting).iter().any(|place| acts_between(effect, place)),
    };
    let left_out = |effect: &&dyn Effect| {
        !effect.is_stochastic()
            && !effect.acts_in_loop()
            && acts_outside(*effect)
            && !without.iter().any(|name| name == effect.name())
    };
    library.effects().filter(left_out).map(|effect| effect.name().to_string()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::truss;

    #[test]
    fn what_acts_on_a_channel_is_outside() {
        let plant = Plant::new(&truss(1)).unwrap();
        let found = outside(&Setting::bare(&plant, &truss(1)), &Library::standard(), &[]);
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
