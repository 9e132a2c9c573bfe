use super::tanh::tanh;
use super::{Action, Effect, Flexible, Force, Parameter, Place, Range, Setting, Side};

/// Dry friction, smoothed at low velocity.
pub struct CoulombFriction;

impl Effect for CoulombFriction {
    fn name(&self) -> &'static str {
        "coulomb-friction"
    }

    fn side(&self) -> Side {
        Side::Structure
    }

    fn family(&self) -> Option<&'static str> {
        Some("dry friction")
    }

    fn equation(&self) -> &'static str {
        "f = -F tanh(v/v0)"
    }

    fn parameters(&self, _setting: &Setting) -> Vec<Parameter> {
        vec![Parameter::new("F", "force", Range::Positive), Parameter::new("v0", "velocity", Range::Positive)]
    }

    fn places(&self, setting: &Setting) -> Vec<Place> {
        setting.joints()
    }

    fn starts(&self, setting: &Setting, place: &Place) -> Vec<Vec<f64>> {
        let port = setting.port(place);
        let (force, v) = (setting.force[port], setting.v_rms[port]);
        [0.03, 0.15, 0.6].map(|share| vec![0.01 * force, share * v]).to_vec()
    }

    fn amplitude(&self) -> Option<(usize, f64)> {
        Some((0, 0.0))
    }

    fn sound(&self, setting: &Setting, place: &Place, parameters: &[f64]) -> bool {
        // Above this limit, the law is a linear damper.
        parameters[1] < 4.0 * setting.v_rms[setting.port(place)]
    }

    fn free_shape(&self) -> Option<&'static Flexible> {
        Some(&Flexible::Damping)
    }

    fn act(&self, setting: &Setting, place: &Place, parameters: &[f64]) -> Vec<Action> {
        let law = Coulomb { size: parameters[0], v0: parameters[1] };
        vec![Action::Force(setting.port(place), Box::new(law))]
    }
}

struct Coulomb {
    size: f64,
    v0: f64,
}

impl Force for Coulomb {
    fn force(&self, _d: f64, v: f64, _state: &[f64]) -> f64 {
        -self.size * tanh(v / self.v0)
    }
}
