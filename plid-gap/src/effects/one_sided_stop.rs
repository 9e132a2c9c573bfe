use super::stop::{self, OF_MEASURED, OF_SIMULATED, Sides, Stop};
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
        let port = setting.port(place);
        let positions: Vec<f64> = match setting.d_range[port] {
            Some(ends) => ends.iter().flat_map(|end| OF_MEASURED.map(|share| share * end)).collect(),
            None => OF_SIMULATED.iter().flat_map(|x| [x * setting.d_rms[port], -x * setting.d_rms[port]]).collect(),
        };
        stop::starts(setting, place, &positions)
    }

    fn sound(&self, setting: &Setting, place: &Place, parameters: &[f64]) -> bool {
        stop::sound(setting, place, parameters)
    }

    fn act(&self, setting: &Setting, place: &Place, parameters: &[f64]) -> Vec<Action> {
        let side = if parameters[2] >= 0.0 { Sides::Above } else { Sides::Below };
        let law = Stop { k: parameters[0], c: parameters[1], g: parameters[2].abs(), sides: side };
        vec![Action::Force(setting.port(place), Box::new(law))]
    }
}
