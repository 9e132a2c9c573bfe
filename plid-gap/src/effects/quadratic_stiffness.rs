use super::{Action, Effect, Flexible, Force, Parameter, Place, Range, Setting, Side};

/// Stiffness that differs between the two directions.
pub struct QuadraticStiffness;

impl Effect for QuadraticStiffness {
    fn name(&self) -> &'static str {
        "quadratic-stiffness"
    }

    fn side(&self) -> Side {
        Side::Structure
    }

    fn equation(&self) -> &'static str {
        "f = -k d^2"
    }

    fn parameters(&self, _setting: &Setting) -> Vec<Parameter> {
        vec![Parameter::new("k", "force/displacement^2", Range::Signed)]
    }

    fn places(&self, setting: &Setting) -> Vec<Place> {
        setting.springs()
    }

    fn starts(&self, setting: &Setting, place: &Place) -> Vec<Vec<f64>> {
        let port = setting.port(place);
        let (force, d) = (setting.force[port], setting.d_rms[port]);
        vec![vec![0.01 * force / d.powi(2)]]
    }

    fn amplitude(&self) -> Option<(usize, f64)> {
        Some((0, 0.0))
    }

    fn free_shape(&self) -> Option<&'static Flexible> {
        Some(&Flexible::Stiffness)
    }

    fn act(&self, setting: &Setting, place: &Place, parameters: &[f64]) -> Vec<Action> {
        let law = Quadratic { k: parameters[0] };
        vec![Action::Force(setting.port(place), Box::new(law))]
    }
}

struct Quadratic {
    k: f64,
}

impl Force for Quadratic {
    fn force(&self, d: f64, _v: f64, _state: &[f64]) -> f64 {
        -self.k * d * d
    }
}
