use super::{Action, Effect, Force, Parameter, Place, Range, Setting, Side};

/// A joint that slips: an elastic element in series with friction (Bouc-Wen with n = 1).
pub struct JointHysteresis;

impl Effect for JointHysteresis {
    fn name(&self) -> &'static str {
        "joint-hysteresis"
    }

    fn side(&self) -> Side {
        Side::Structure
    }

    fn equation(&self) -> &'static str {
        "f = -k z, dz/dt = v - (abs(v) z + v abs(z)) / (2 dy)"
    }

    fn parameters(&self, _setting: &Setting) -> Vec<Parameter> {
        vec![
            Parameter::new("k", "force/displacement", Range::Positive),
            Parameter::new("dy", "displacement", Range::Positive),
        ]
    }

    fn places(&self, setting: &Setting) -> Vec<Place> {
        setting.struts()
    }

    fn starts(&self, setting: &Setting, place: &Place) -> Vec<Vec<f64>> {
        let port = setting.port(place);
        let (force, d) = (setting.force[port], setting.d_rms[port]);
        [0.25, 0.8, 2.5].map(|share| vec![0.01 * force / d, share * d]).to_vec()
    }

    fn amplitude(&self) -> Option<(usize, f64)> {
        Some((0, 0.0))
    }

    fn sound(&self, setting: &Setting, place: &Place, parameters: &[f64]) -> bool {
        // Beyond, it never yields and is a spring; far below, it is Coulomb friction.
        (0.01..10.0).contains(&(parameters[1] / setting.d_rms[setting.port(place)]))
    }

    fn act(&self, setting: &Setting, place: &Place, parameters: &[f64]) -> Vec<Action> {
        let law = Joint { k: parameters[0], dy: parameters[1] };
        vec![Action::Force(setting.port(place), Box::new(law))]
    }
}

struct Joint {
    k: f64,
    dy: f64,
}

impl Force for Joint {
    fn force(&self, _d: f64, _v: f64, state: f64) -> f64 {
        -self.k * state
    }

    fn advance(&self, from: f64, to: f64, state: f64) -> f64 {
        super::slip::advance(state, to - from, 1.0, self.dy)
    }
}
