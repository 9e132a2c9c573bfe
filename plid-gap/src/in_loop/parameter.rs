//! A wrong parameter of the engineer's own simulator as a cause of the gap.

use plid_simulator::Parameter as Given;

use crate::effects::{Action, Change, Effect, Parameter, Place, Range, Setting, Side};

/// Name of the effect in an answer.
pub(super) const NAME: &str = "simulator-parameter";

/// Factors on the value of a parameter from which fits start. A fit that starts at three times the value also finds
/// ten times the value.
const FACTORS: [f64; 3] = [0.6, 1.5, 3.0];

/// Starting values for a parameter that is zero, relative to its upper bound, or to one if it has no upper bound.
const FROM_ZERO: [f64; 3] = [0.003, 0.03, 0.3];

/// The effect of a parameter whose value differs from the one that the simulator states.
pub(super) struct SimulatorParameter {
    number: usize,
    given: Given,
}

impl SimulatorParameter {
    /// Returns one effect for each parameter.
    pub fn all(parameters: &[Given]) -> Vec<Self> {
        parameters.iter().enumerate().map(|(number, given)| Self { number, given: given.clone() }).collect()
    }

    /// Returns whether the value is positive. Fits then take steps in its logarithm, and it cannot become negative.
    fn is_positive(&self) -> bool {
        self.given.value > 0.0
    }

    fn unit(&self) -> String {
        self.given.unit.clone().unwrap_or_else(|| "1".into())
    }
}

impl Effect for SimulatorParameter {
    fn name(&self) -> &'static str {
        NAME
    }

    fn side(&self) -> Side {
        Side::Structure
    }

    fn equation(&self) -> &'static str {
        "the parameter has this value"
    }

    fn parameters(&self, _setting: &Setting) -> Vec<Parameter> {
        let range = if self.is_positive() { Range::Positive } else { Range::Signed };
        vec![Parameter::new("value", self.unit(), range)]
    }

    fn places(&self, _setting: &Setting) -> Vec<Place> {
        vec![Place::Parameter(self.number)]
    }

    fn starts(&self, _setting: &Setting, _place: &Place) -> Vec<Vec<f64>> {
        let value = self.given.value;
        let most = self.given.upper.filter(|upper| upper.is_finite()).map_or(1.0, f64::abs);
        let all = if value == 0.0 { FROM_ZERO.map(|share| share * most) } else { FACTORS.map(|factor| factor * value) };
        let inside = all.map(|start| self.given.bounded(start));
        inside.into_iter().filter(|start| *start != value).map(|start| vec![start]).collect()
    }

    fn amplitude(&self) -> Option<(usize, f64)> {
        Some((0, self.given.value))
    }

    fn is_number(&self) -> bool {
        true
    }

    fn change(&self, _setting: &Setting, _place: &Place, parameters: &[f64]) -> Option<Change> {
        let number = format!("parameter {}", self.given.name);
        Some(Change { number, from: self.given.value, to: self.given.bounded(parameters[0]), unit: self.unit() })
    }

    fn act(&self, _setting: &Setting, _place: &Place, parameters: &[f64]) -> Vec<Action> {
        vec![Action::Parameter(self.number, self.given.bounded(parameters[0]))]
    }
}
