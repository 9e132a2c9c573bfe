use super::{Action, Effect, Flexible, Parameter, Place, Range, Setting, Side};

/// A structure that softens or stiffens with time, for example because of heat.
pub struct StiffnessDrift;

impl Effect for StiffnessDrift {
    fn name(&self) -> &'static str {
        "stiffness-drift"
    }

    fn side(&self) -> Side {
        Side::Time
    }

    fn equation(&self) -> &'static str {
        "w_m^2 -> w_m^2 (1 + r t), every mode"
    }

    fn parameters(&self, _setting: &Setting) -> Vec<Parameter> {
        vec![Parameter::new("r", "1/s", Range::Signed)]
    }

    fn places(&self, _setting: &Setting) -> Vec<Place> {
        vec![Place::Structure]
    }

    fn starts(&self, setting: &Setting, _place: &Place) -> Vec<Vec<f64>> {
        [0.001, 0.004, 0.012].iter().flat_map(|&all| [all, -all]).map(|all| vec![all / setting.duration_s]).collect()
    }

    fn free_shape(&self) -> Option<&'static Flexible> {
        Some(&Flexible::StiffnessCourse)
    }

    fn act(&self, _setting: &Setting, _place: &Place, parameters: &[f64]) -> Vec<Action> {
        let r = parameters[0];
        vec![Action::Stiffness(Box::new(move |t| 1.0 + r * t))]
    }
}
