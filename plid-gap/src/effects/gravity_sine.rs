use super::{Action, Effect, Flexible, Force, Parameter, Place, Range, Setting, Side};

/// Gravity on an axis that swings. A linear simulation contains the stiffness k of small angles, whereas the torque
/// on the real axis is k sin(d). The displacement d of the port is an angle in radians, so the law contains no length
/// scale.
pub struct GravitySine;

/// Shares of the port's stiffness from which fits start: a small one, to which the trace in the outputs is
/// proportional, and the whole stiffness, as in a pendulum without another spring. The resonance of such a pendulum
/// may move too far to be extrapolated.
const SHARES: [f64; 2] = [0.1, 1.0];

/// Range of k over the static stiffness of the port in the simulation. Gravity is a part of the true stiffness, which
/// may exceed that of the simulation by half. On an inverted pendulum, k is negative. If a loop or a spring exceeds
/// gravity by a third, a third of the size of k is left as stiffness. Beyond this range, the law only adds curvature
/// to another spring.
const HELD: std::ops::Range<f64> = -3.0..1.5;

/// The largest RMS angle in the linear simulation. Above it, the axis turns over, or the displacement is not an
/// angle.
const TURNS_OVER: f64 = std::f64::consts::PI;

impl Effect for GravitySine {
    fn name(&self) -> &'static str {
        "gravity-sine"
    }

    fn side(&self) -> Side {
        Side::Structure
    }

    fn equation(&self) -> &'static str {
        "f = k (d - sin(d)), d in rad; k is gravity's own stiffness"
    }

    fn parameters(&self, _setting: &Setting) -> Vec<Parameter> {
        vec![Parameter::new("k", "force/displacement", Range::Signed)]
    }

    fn places(&self, setting: &Setting) -> Vec<Place> {
        setting.loads().into_iter().filter(|place| setting.sees_displacement(place)).collect()
    }

    fn starts(&self, setting: &Setting, place: &Place) -> Vec<Vec<f64>> {
        let port = setting.port(place);
        let stiffness = setting.stiffness[port];
        if !(stiffness > 0.0 && setting.d_rms[port] < TURNS_OVER) {
            return Vec::new();
        }
        SHARES.map(|share| vec![share * stiffness]).to_vec()
    }

    fn starts_from(&self, _setting: &Setting, _place: &Place, found: (&str, &[f64])) -> Vec<Vec<f64>> {
        // d - sin(d) is d^3 / 6 at small angles.
        match found {
            ("cubic-stiffness", [k]) => vec![vec![-6.0 * k]],
            _ => Vec::new(),
        }
    }

    fn amplitude(&self) -> Option<(usize, f64)> {
        Some((0, 0.0))
    }

    fn free_shape(&self) -> Option<&'static Flexible> {
        Some(&Flexible::Stiffness)
    }

    fn sound(&self, setting: &Setting, place: &Place, parameters: &[f64]) -> bool {
        HELD.contains(&(parameters[0] / setting.stiffness[setting.port(place)]))
    }

    fn act(&self, setting: &Setting, place: &Place, parameters: &[f64]) -> Vec<Action> {
        let law = Sine { k: parameters[0] };
        vec![Action::Force(setting.port(place), Box::new(law))]
    }
}

/// The excess force of the simulation's spring: k d - k sin(d).
struct Sine {
    k: f64,
}

impl Force for Sine {
    fn force(&self, d: f64, _v: f64, _state: &[f64]) -> f64 {
        self.k * (d - d.sin())
    }
}
