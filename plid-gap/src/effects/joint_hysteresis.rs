use super::slip::{advance, advance_skewed};
use super::{Action, Effect, Flexible, Force, Parameter, Place, Range, Setting, Side};

/// Magnitude of h above which a loop is almost a single curve.
const MOST_SKEWED: f64 = 3.0;

/// Yield displacements from which fits start if the simulation contains the stiffness of the joint, over the RMS
/// displacement of the linear simulation.
const HELD_YIELDS: [f64; 2] = [0.4, 1.2];

/// A joint that slips: an elastic element in series with friction (Bouc-Wen with n = 1).
///
/// With two parameters, the joint yields on loading and is elastic on unloading (h = 1). With three, h sets the
/// difference between loading and unloading: h = 0 is the model of Dahl, and with h below -1, the loops stiffen
/// (Y.-K. Wen, J. Eng. Mech. Div. ASCE 102, 1976).
///
/// On a single mode, the simulation treats the joint as stuck, as it does if it was identified at a low level: the
/// joint's spring k is part of the mode's stiffness and is removed there. For a structure of a single mode, the same
/// holds if h is given and s is omitted. At other ports, s is the share of k that the simulation contains.
pub struct JointHysteresis;

impl Effect for JointHysteresis {
    fn name(&self) -> &'static str {
        "joint-hysteresis"
    }

    fn side(&self) -> Side {
        Side::Structure
    }

    fn family(&self) -> Option<&'static str> {
        Some("dry friction")
    }

    fn equation(&self) -> &'static str {
        "f = k (s d - z), dz/dt = v - (abs(v) z + h v abs(z)) / (2 dy); without h it is 1, without s it is 0"
    }

    fn parameters(&self, _setting: &Setting) -> Vec<Parameter> {
        vec![
            Parameter::new("k", "force/displacement", Range::Positive),
            Parameter::new("dy", "displacement", Range::Positive),
            Parameter::new("h", "1", Range::Signed).or_left_out(),
            Parameter::new("s", "1", Range::Signed).or_left_out(),
        ]
    }

    fn places(&self, setting: &Setting) -> Vec<Place> {
        setting.springs()
    }

    fn starts(&self, setting: &Setting, place: &Place) -> Vec<Vec<f64>> {
        let port = setting.port(place);
        let (force, d) = (setting.force[port], setting.d_rms[port]);
        // A prescribed motion may be far beyond the yield displacement, because only the testing machine limits it.
        let far: &[f64] = if setting.plant.ports[port].moved_by().is_some() { &[0.003, 0.01, 0.03, 0.1] } else { &[] };
        let plain = [0.25, 0.8, 2.5].iter().chain(far).map(|share| vec![0.01 * force / d, share * d]);
        let skewed = [0.0, -1.0].into_iter().flat_map(|h| [0.4, 1.2].map(|share| vec![0.01 * force / d, share * d, h]));
        let held = HELD_YIELDS.iter().filter(|_| setting.may_contain_joints(port));
        plain.into_iter().chain(skewed).chain(held.map(|share| vec![0.01 * force / d, share * d, 1.0, 1.0])).collect()
    }

    fn amplitude(&self) -> Option<(usize, f64)> {
        Some((0, 0.0))
    }

    fn sound(&self, setting: &Setting, place: &Place, parameters: &[f64]) -> bool {
        // Above this range, the joint never yields and is a spring; far below it, the joint is Coulomb friction. With
        // a large h, it is a nonlinear spring, whose curve is the same up and down.
        let skew = parameters.get(2).copied().unwrap_or(1.0).abs();
        let port = setting.port(place);
        let least = if setting.plant.ports[port].moved_by().is_some() { 1e-3 } else { 0.01 };
        (least..10.0).contains(&(parameters[1] / setting.d_rms[port]))
            && skew < MOST_SKEWED
            && parameters.get(3).is_none_or(|s| setting.may_contain(port, *s, parameters[0]))
    }

    fn free_shape(&self) -> Option<&'static Flexible> {
        Some(&Flexible::Joint)
    }

    fn act(&self, setting: &Setting, place: &Place, parameters: &[f64]) -> Vec<Action> {
        let (k, dy) = (parameters[0], parameters[1]);
        let port = setting.port(place);
        let s = parameters.get(3).copied();
        let force: Box<dyn Force> = match parameters.get(2) {
            Some(h) => {
                let (rise, fall) = ((1.0 + h) / (2.0 * dy), (1.0 - h) / (2.0 * dy));
                Box::new(Skewed { k, s: s.unwrap_or(0.0), rise, fall })
            }
            None => Box::new(Joint { k, dy }),
        };
        let mut actions: Vec<Action> = vec![Action::Force(port, force)];
        if setting.is_on_a_mode(port) || s.is_none() && parameters.len() > 2 && setting.contains_joints(port) {
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
    fn force(&self, _d: f64, _v: f64, state: &[f64]) -> f64 {
        -self.k * state[0]
    }

    fn states(&self) -> usize {
        1
    }

    fn advance(&self, from: f64, to: f64, state: &mut [f64]) {
        state[0] = advance(state[0], to - from, 1.0, self.dy);
    }
}

/// A joint that yields, over the displacement, at different rates on loading and on unloading.
struct Skewed {
    k: f64,
    /// The share of k that the simulation contains.
    s: f64,
    rise: f64,
    fall: f64,
}

impl Force for Skewed {
    fn force(&self, d: f64, _v: f64, state: &[f64]) -> f64 {
        self.k * (self.s * d - state[0])
    }

    fn states(&self) -> usize {
        1
    }

    fn advance(&self, from: f64, to: f64, state: &mut [f64]) {
        state[0] = advance_skewed(state[0], to - from, self.rise, self.fall);
    }
}
