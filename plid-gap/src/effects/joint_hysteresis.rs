use super::{Action, Effect, Flexible, Force, Parameter, Place, Range, Setting, Side};

/// A joint that slips: an elastic element in series with friction (Bouc-Wen with n = 1).
///
/// On a single mode it is a joint that the simulation takes for stuck, as a simulation that was identified at a low
/// level does: its spring k is part of the mode's stiffness and is removed there.
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
        setting.springs()
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
        // Above, it never yields and is a spring; far below, it is Coulomb friction.
        (0.01..10.0).contains(&(parameters[1] / setting.d_rms[setting.port(place)]))
    }

    fn free_shape(&self) -> Option<&'static Flexible> {
        Some(&Flexible::Joint)
    }

    fn act(&self, setting: &Setting, place: &Place, parameters: &[f64]) -> Vec<Action> {
        let (k, dy) = (parameters[0], parameters[1]);
        let port = setting.port(place);
        let mut actions: Vec<Action> = vec![Action::Force(port, Box::new(Joint { k, dy }))];
        if setting.is_on_a_mode(port) {
            actions.push(Action::Plant(Box::new(move |plant| plant.take_spring(port, k))));
        }
        actions
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
