//! The stability of the simulation, in closed loop if there is a controller.

use plid_model::{Model, close_loop};

use crate::case::Case;
use crate::error::GapError;

/// Responses of poles within this distance of the unit circle count as neither growing nor decaying.
pub(crate) const ON_THE_CIRCLE: f64 = 1e-9;

/// Checks the stability of the simulation. Returns a finding if a pole lies on the unit circle.
///
/// # Errors
/// Returns [`GapError::Unstable`] for a pole outside the unit circle, and [`GapError::UnstableLoop`] for such a pole
/// of the closed loop.
pub fn check(case: &Case, model: &Model) -> Result<Option<String>, GapError> {
    let closed = case.controller.as_ref().map(|controller| close_loop(model, &controller.model)).transpose()?;
    let found = plid_model::stability(closed.as_ref().unwrap_or(model))?;
    let Some(&hz) = found.unstable_hz.first() else { return Ok(None) };
    let what = if closed.is_some() { "loop of simulation and controller" } else { "simulation" };
    if found.spectral_radius <= 1.0 + ON_THE_CIRCLE {
        return Ok(Some(format!(
            "The {what} has a pole on the unit circle ({hz:.2} Hz): its response to an impulse never decays."
        )));
    }
    let magnitude = found.spectral_radius;
    if let Some(controller) = &case.config.controller {
        return Err(GapError::UnstableLoop { file: controller.model.clone().into(), magnitude, hz });
    }
    let file = case.config.sim.as_deref().unwrap_or("the simulation").into();
    Err(GapError::Unstable { file, magnitude, hz })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{case, truss};

    #[test]
    fn a_growing_simulation_is_refused() {
        let mut model = truss(1);
        let sound = case(&truss(1), &model);
        assert_eq!(check(&sound, &model).unwrap(), None);
        let radius = plid_model::stability(&model).unwrap().spectral_radius;
        model.a *= 1.001 / radius;
        match check(&sound, &model).unwrap_err() {
            GapError::Unstable { magnitude, hz, .. } => {
                assert!((magnitude - 1.001).abs() < 1e-6);
                assert!(crate::testing::MODES.iter().any(|mode| (mode.0 - hz).abs() < 1.0), "{hz}");
            }
            other => panic!("{other}"),
        }
    }
}
