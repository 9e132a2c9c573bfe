use super::{Action, Effect, Flexible, Force, Parameter, Place, Range, Setting, Side};

/// Stiffness that grows (k > 0) or falls with the square of the displacement.
pub struct CubicStiffness;

impl Effect for CubicStiffness {
    fn name(&self) -> &'static str {
        "cubic-stiffness"
    }

    fn side(&self) -> Side {
        Side::Structure
    }

    fn equation(&self) -> &'static str {
        "f = -k d^3"
    }

    fn parameters(&self, _setting: &Setting) -> Vec<Parameter> {
        vec![Parameter::new("k", "force/displacement^3", Range::Signed)]
    }

    fn places(&self, setting: &Setting) -> Vec<Place> {
        setting.springs()
    }

    fn starts(&self, setting: &Setting, place: &Place) -> Vec<Vec<f64>> {
        let port = setting.port(place);
        let (force, d) = (setting.force[port], setting.d_rms[port]);
        vec![vec![0.01 * force / d.powi(3)]]
    }

    fn starts_from(&self, _setting: &Setting, _place: &Place, found: (&str, &[f64])) -> Vec<Vec<f64>> {
        match found {
            ("gravity-sine", [k]) => vec![vec![-k / 6.0]],
            _ => Vec::new(),
        }
    }

    fn amplitude(&self) -> Option<(usize, f64)> {
        Some((0, 0.0))
    }

    fn free_shape(&self) -> Option<&'static Flexible> {
        Some(&Flexible::Stiffness)
    }

    fn act(&self, setting: &Setting, place: &Place, parameters: &[f64]) -> Vec<Action> {
        let law = Cubic { k: parameters[0] };
        vec![Action::Force(setting.port(place), Box::new(law))]
    }
}

struct Cubic {
    k: f64,
}

impl Force for Cubic {
    fn force(&self, d: f64, _v: f64, _state: &[f64]) -> f64 {
        -self.k * d * d * d
    }
}
