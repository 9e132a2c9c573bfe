use super::{Action, Effect, Force, Parameter, Place, Range, Setting, Side};

/// Free play inside a transmission: the spring of the joint, which the simulation has, does not act within a gap.
///
/// A clearance, in contrast, is a spring that the simulation lacks and that acts only beyond a gap.
pub struct Backlash;

/// Gaps from which fits start, over the RMS of the displacement in the linear simulation.
const GAPS: [f64; 4] = [0.05, 0.2, 0.5, 1.2];

/// Range of the gap in the same unit. A wider gap is never crossed, and a narrower one is not visible.
const SEEN: std::ops::Range<f64> = 1e-3..5.0;

/// Range of the stiffness that is lost, over the static stiffness of the port in the simulation.
const LOST: std::ops::Range<f64> = 0.5..1.5;

impl Effect for Backlash {
    fn name(&self) -> &'static str {
        "backlash"
    }

    fn side(&self) -> Side {
        Side::Structure
    }

    fn equation(&self) -> &'static str {
        "f = k d for abs(d) < g, k g sign(d) beyond; k is the joint's own stiffness"
    }

    fn parameters(&self, _setting: &Setting) -> Vec<Parameter> {
        vec![
            Parameter::new("k", "force/displacement", Range::Positive),
            Parameter::new("g", "displacement", Range::Positive),
        ]
    }

    fn places(&self, setting: &Setting) -> Vec<Place> {
        let held = |place: &Place| {
            let stiffness = setting.stiffness[setting.port(place)];
            setting.sees_displacement(place) && stiffness.is_finite() && stiffness > 0.0
        };
        setting.transmissions().into_iter().filter(held).collect()
    }

    fn starts(&self, setting: &Setting, place: &Place) -> Vec<Vec<f64>> {
        let port = setting.port(place);
        GAPS.map(|share| vec![setting.stiffness[port], share * setting.d_rms[port]]).to_vec()
    }

    fn starts_from(&self, setting: &Setting, place: &Place, found: (&str, &[f64])) -> Vec<Vec<f64>> {
        match found {
            // A clearance may be a lost spring whose linear part the refit has absorbed. The force that is lost
            // beyond the gap, k g, is kept.
            ("clearance", &[k, g]) if k > 0.0 => {
                let own = setting.stiffness[setting.port(place)];
                vec![vec![own, k * g / own]]
            }
            _ => Vec::new(),
        }
    }

    fn sound(&self, setting: &Setting, place: &Place, parameters: &[f64]) -> bool {
        let port = setting.port(place);
        SEEN.contains(&(parameters[1] / setting.d_rms[port]))
            && LOST.contains(&(parameters[0] / setting.stiffness[port]))
    }

    fn act(&self, setting: &Setting, place: &Place, parameters: &[f64]) -> Vec<Action> {
        let law = Play { k: parameters[0], g: parameters[1] };
        vec![Action::Force(setting.port(place), Box::new(law))]
    }
}

struct Play {
    k: f64,
    g: f64,
}

impl Force for Play {
    fn force(&self, d: f64, _v: f64, _state: &[f64]) -> f64 {
        self.k * d.clamp(-self.g, self.g)
    }

    fn steepest(&self) -> [f64; 2] {
        [self.k, 0.0]
    }
}
