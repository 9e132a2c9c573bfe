use super::{Action, Effect, Force, Parameter, Place, Range, Setting, Side};

/// Dry friction that sticks: while a port is at rest, it is held up to a force that is larger than the force of
/// sliding (Stribeck).
pub struct StickFriction;

/// Sliding forces from which fits start, over the force that moves the port as the inputs do.
const FORCES: [f64; 2] = [0.05, 0.25];

/// Holding force over sliding force from which fits start.
const HELD: f64 = 1.3;

/// Velocity of the transition from which fits start, over the RMS velocity of the linear simulation.
const TRANSITION: f64 = 0.2;

/// The largest such velocity. Above it, the force falls with the velocity nearly everywhere, like that of a viscous
/// damper that is removed.
const FASTEST: f64 = 1.0;

/// The largest holding force over the sliding force. Above it, the law only adds curvature to another one.
const MOST_HELD: f64 = 3.0;

impl Effect for StickFriction {
    fn name(&self) -> &'static str {
        "stick-friction"
    }

    fn side(&self) -> Side {
        Side::Structure
    }

    fn family(&self) -> Option<&'static str> {
        Some("dry friction")
    }

    fn equation(&self) -> &'static str {
        "f = -(Fc + (Fs - Fc) exp(-(v/vs)^2)) sign(v); at v = 0 the force that keeps v = 0, of at most Fs"
    }

    fn parameters(&self, _setting: &Setting) -> Vec<Parameter> {
        vec![
            Parameter::new("Fc", "force", Range::Positive),
            Parameter::new("Fs", "force", Range::Positive),
            Parameter::new("vs", "velocity", Range::Positive),
        ]
    }

    fn places(&self, setting: &Setting) -> Vec<Place> {
        setting.inertias()
    }

    fn starts(&self, setting: &Setting, place: &Place) -> Vec<Vec<f64>> {
        let port = setting.port(place);
        let (force, v) = (setting.force[port], setting.v_rms[port]);
        FORCES.map(|share| vec![share * force, HELD * share * force, TRANSITION * v]).to_vec()
    }

    fn sound(&self, setting: &Setting, place: &Place, parameters: &[f64]) -> bool {
        let held = parameters[1] / parameters[0];
        (1.0..MOST_HELD).contains(&held) && parameters[2] < FASTEST * setting.v_rms[setting.port(place)]
    }

    fn act(&self, setting: &Setting, place: &Place, parameters: &[f64]) -> Vec<Action> {
        let law = Stribeck { slides: parameters[0], holds: parameters[1], vs: parameters[2] };
        vec![Action::Force(setting.port(place), Box::new(law))]
    }
}

struct Stribeck {
    slides: f64,
    holds: f64,
    vs: f64,
}

impl Force for Stribeck {
    fn force(&self, _d: f64, v: f64, _state: &[f64]) -> f64 {
        if v == 0.0 {
            return 0.0;
        }
        -(self.slides + (self.holds - self.slides) * (-(v / self.vs).powi(2)).exp()) * v.signum()
    }

    fn holds(&self) -> Option<f64> {
        Some(self.holds)
    }
}
