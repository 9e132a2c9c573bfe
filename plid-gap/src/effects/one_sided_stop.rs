use super::stop::{self, Sides, Stop};
use super::{Action, Effect, Parameter, Place, Range, Setting, Side};

/// A stop on one side of an axis.
pub struct OneSidedStop;

impl Effect for OneSidedStop {
    fn name(&self) -> &'static str {
        "one-sided-stop"
    }

    fn side(&self) -> Side {
        Side::Structure
    }

    fn family(&self) -> Option<&'static str> {
        Some("a stop or a clearance")
    }

    fn equation(&self) -> &'static str {
        "x = sign(s) (d - s), f = -sign(s) max(k x + c dx/dt, 0) for x > 0, else 0"
    }

    fn parameters(&self, _setting: &Setting) -> Vec<Parameter> {
        stop::parameters(("s", Range::Signed))
    }

    fn places(&self, setting: &Setting) -> Vec<Place> {
        stop::places(setting)
    }

    fn starts(&self, setting: &Setting, place: &Place) -> Vec<Vec<f64>> {
        let ends = setting.d_range[setting.port(place)];
        stop::starts(setting, place, ends.as_ref().map(|ends| &ends[..]), &[1.0, -1.0])
    }

    fn starts_from(&self, setting: &Setting, place: &Place, found: (&str, &[f64])) -> Vec<Vec<f64>> {
        let start = stop::start_from(setting, place, found).into_iter();
        start.flat_map(|[k, c, at]| [vec![k, c, at], vec![k, c, -at]]).collect()
    }

    fn sound(&self, setting: &Setting, place: &Place, parameters: &[f64]) -> bool {
        stop::sound(setting, place, parameters, Sides::of(parameters[2]))
    }

    fn is_contact(&self) -> bool {
        true
    }

    fn act(&self, setting: &Setting, place: &Place, parameters: &[f64]) -> Vec<Action> {
        let [k, c, at] = [0, 1, 2].map(|j| parameters[j]);
        let law = Stop { k, c, g: at.abs(), sides: Sides::of(at) };
        vec![Action::Force(setting.port(place), Box::new(law))]
    }
}
