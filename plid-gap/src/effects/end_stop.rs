use super::stop::{self, OF_MEASURED, OF_SIMULATED, Sides, Stop};
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
        let port = setting.port(place);
        let positions: Vec<f64> = match setting.d_range[port] {
            Some([low, high]) => OF_MEASURED.map(|share| share * high.max(-low)).to_vec(),
            None => OF_SIMULATED.map(|share| share * setting.d_rms[port]).to_vec(),
        };
        stop::starts(setting, place, &positions)
    }

    fn sound(&self, setting: &Setting, place: &Place, parameters: &[f64]) -> bool {
        stop::sound(setting, place, parameters)
    }

    fn act(&self, setting: &Setting, place: &Place, parameters: &[f64]) -> Vec<Action> {
        let law = Stop { k: parameters[0], c: parameters[1], g: parameters[2], sides: Sides::Both };
        vec![Action::Force(setting.port(place), Box::new(law))]
    }
}
