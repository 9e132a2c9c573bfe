use super::{Action, Effect, Flexible, Force, Parameter, Place, Range, Setting, Side};

/// Stiffness that begins (k > 0) or is lost (k < 0) beyond a gap.
pub struct Clearance;

impl Effect for Clearance {
    fn name(&self) -> &'static str {
        "clearance"
    }

    fn side(&self) -> Side {
        Side::Structure
    }

    fn family(&self) -> Option<&'static str> {
        Some("a stop or a clearance")
    }

    fn equation(&self) -> &'static str {
        "f = -k (d - g) for d > g, -k (d + g) for d < -g, else 0"
    }

    fn parameters(&self, _setting: &Setting) -> Vec<Parameter> {
        vec![
            Parameter::new("k", "force/displacement", Range::Signed),
            Parameter::new("g", "displacement", Range::Positive),
        ]
    }

    fn places(&self, setting: &Setting) -> Vec<Place> {
        setting.springs()
    }

    fn starts(&self, setting: &Setting, place: &Place) -> Vec<Vec<f64>> {
        let port = setting.port(place);
        let (force, d) = (setting.force[port], setting.d_rms[port]);
        [0.3, 0.8, 1.6].map(|share| vec![0.01 * force / d, share * d]).to_vec()
    }

    fn amplitude(&self) -> Option<(usize, f64)> {
        Some((0, 0.0))
    }

    fn sound(&self, setting: &Setting, place: &Place, parameters: &[f64]) -> bool {
        // Below this range, the clearance is a spring; above it, the gap is hardly ever closed.
        (0.02..5.0).contains(&(parameters[1] / setting.d_rms[setting.port(place)]))
    }

    fn free_shape(&self) -> Option<&'static Flexible> {
        Some(&Flexible::Stiffness)
    }

    fn act(&self, setting: &Setting, place: &Place, parameters: &[f64]) -> Vec<Action> {
        let law = Gap { k: parameters[0], g: parameters[1] };
        vec![Action::Force(setting.port(place), Box::new(law))]
    }
}

struct Gap {
    k: f64,
    g: f64,
}

impl Force for Gap {
    fn force(&self, d: f64, _v: f64, _state: &[f64]) -> f64 {
        -self.k * (d.abs() - self.g).max(0.0) * d.signum()
    }
}
