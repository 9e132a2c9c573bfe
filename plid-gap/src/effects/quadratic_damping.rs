use super::{Action, Effect, Flexible, Force, Parameter, Place, Range, Setting, Side};

/// Damping that grows with the velocity, such as that of air, or of oil through an orifice.
pub struct QuadraticDamping;

impl Effect for QuadraticDamping {
    fn name(&self) -> &'static str {
        "quadratic-damping"
    }

    fn side(&self) -> Side {
        Side::Structure
    }

    fn equation(&self) -> &'static str {
        "f = -c abs(v) v"
    }

    fn parameters(&self, _setting: &Setting) -> Vec<Parameter> {
        vec![Parameter::new("c", "force/velocity^2", Range::Positive)]
    }

    fn places(&self, setting: &Setting) -> Vec<Place> {
        setting.joints()
    }

    fn starts(&self, setting: &Setting, place: &Place) -> Vec<Vec<f64>> {
        let port = setting.port(place);
        let (force, v) = (setting.force[port], setting.v_rms[port]);
        vec![vec![0.01 * force / v.powi(2)]]
    }

    fn amplitude(&self) -> Option<(usize, f64)> {
        Some((0, 0.0))
    }

    fn free_shape(&self) -> Option<&'static Flexible> {
        Some(&Flexible::Damping)
    }

    fn act(&self, setting: &Setting, place: &Place, parameters: &[f64]) -> Vec<Action> {
        let law = Drag { c: parameters[0] };
        vec![Action::Force(setting.port(place), Box::new(law))]
    }
}

struct Drag {
    c: f64,
}

impl Force for Drag {
    fn force(&self, _d: f64, v: f64, _state: &[f64]) -> f64 {
        -self.c * v.abs() * v
    }
}
