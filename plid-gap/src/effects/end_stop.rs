use super::stop::{self, Sides, Stop};
use super::{Action, Effect, Parameter, Place, Range, Setting, Side};

/// Stops on both sides of an axis, at the same distance from rest.
pub struct EndStop;

impl Effect for EndStop {
    fn name(&self) -> &'static str {
        "end-stop"
    }

    fn side(&self) -> Side {
        Side::Structure
    }

    fn family(&self) -> Option<&'static str> {
        Some("a stop or a clearance")
    }

    fn equation(&self) -> &'static str {
        "x = abs(d) - g, f = -sign(d) max(k x + c dx/dt, 0) for x > 0, else 0"
    }

    fn parameters(&self, _setting: &Setting) -> Vec<Parameter> {
        stop::parameters(("g", Range::Positive))
    }

    fn places(&self, setting: &Setting) -> Vec<Place> {
        stop::places(setting)
    }

    fn starts(&self, setting: &Setting, place: &Place) -> Vec<Vec<f64>> {
        let farthest = setting.d_range[setting.port(place)].map(|[low, high]| [high.max(-low)]);
        stop::starts(setting, place, farthest.as_ref().map(|end| &end[..]), &[1.0])
    }

    fn starts_from(&self, setting: &Setting, place: &Place, found: (&str, &[f64])) -> Vec<Vec<f64>> {
        stop::start_from(setting, place, found).into_iter().map(|[k, c, at]| vec![k, c, at.abs()]).collect()
    }

    fn sound(&self, setting: &Setting, place: &Place, parameters: &[f64]) -> bool {
        stop::sound(setting, place, parameters, Sides::Both)
    }

    fn is_contact(&self) -> bool {
        true
    }

    fn act(&self, setting: &Setting, place: &Place, parameters: &[f64]) -> Vec<Action> {
        let law = Stop { k: parameters[0], c: parameters[1], g: parameters[2], sides: Sides::Both };
        vec![Action::Force(setting.port(place), Box::new(law))]
    }
}
