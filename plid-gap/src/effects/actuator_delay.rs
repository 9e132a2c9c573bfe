use super::{Action, Command, Drive, Effect, Flexible, Parameter, Place, Range, Setting, Side};

/// A delay of the command, at one input or at all inputs.
pub struct ActuatorDelay;

impl Effect for ActuatorDelay {
    fn name(&self) -> &'static str {
        "actuator-delay"
    }

    fn side(&self) -> Side {
        Side::Actuator
    }

    fn family(&self) -> Option<&'static str> {
        Some("a delayed command")
    }

    fn equation(&self) -> &'static str {
        "u'(t) = u(t - tau)"
    }

    fn is_linear(&self) -> bool {
        true
    }

    fn parameters(&self, _setting: &Setting) -> Vec<Parameter> {
        vec![Parameter::new("tau", "samples", Range::Positive)]
    }

    fn places(&self, setting: &Setting) -> Vec<Place> {
        setting.inputs().into_iter().chain((setting.plant.m > 1).then_some(Place::AllInputs)).collect()
    }

    fn starts(&self, _setting: &Setting, _place: &Place) -> Vec<Vec<f64>> {
        [0.1, 0.5, 1.5, 4.0, 10.0].map(|samples| vec![samples]).to_vec()
    }

    fn free_shape(&self) -> Option<&'static Flexible> {
        Some(&Flexible::Path)
    }

    fn act(&self, _setting: &Setting, place: &Place, parameters: &[f64]) -> Vec<Action> {
        vec![Action::Command(Box::new(Delay { place: place.clone(), tau: parameters[0] }))]
    }
}

/// Number of parts of a sample.
const PARTS: usize = 4;

/// Number of consecutive edges of parts over which a step between two edges is distributed.
const EDGES: usize = 6;

struct Delay {
    place: Place,
    tau: f64,
}

impl Command for Delay {
    fn apply(&self, drive: &mut Drive) {
        drive.refine(PARTS);
        let (first, weights) = spread(self.tau * drive.parts as f64);
        for (i, channel) in drive.u.iter_mut().enumerate() {
            if self.place != Place::AllInputs && self.place != Place::Input(i) {
                continue;
            }
            let mut delayed = vec![0.0; channel.len()];
            for (weight, back) in weights.iter().zip(first..) {
                delayed.iter_mut().skip(back).zip(&*channel).for_each(|(to, from)| *to += weight * from);
            }
            *channel = delayed;
        }
    }
}

/// Returns the first of the edges over which a step after this number of parts is distributed, and the weights. These
/// are the weights of Lagrange interpolation, whose moments are exact up to the fifth. With two edges, a delay of a
/// tenth of a sample was wrong by 6 %, and with three edges, every delay was up to 1 % too short.
fn spread(parts: f64) -> (usize, [f64; EDGES]) {
    let first = (parts.floor() as usize).saturating_sub(EDGES / 2 - 1);
    let at = parts - first as f64;
    let weight = |j: usize| {
        let others = (0..EDGES).filter(|i| *i != j).map(|i| i as f64);
        others.map(|i| (at - i) / (j as f64 - i)).product()
    };
    (first, std::array::from_fn(weight))
}

#[cfg(test)]
mod tests {
    use super::{EDGES, spread};

    #[test]
    fn moments_of_a_spread_step_are_those_of_a_sharp_one() {
        for parts in [0.0, 0.3, 1.0, 1.9, 2.0, 2.7, 40.25] {
            let (first, weights) = spread(parts);
            for power in 0..EDGES as i32 {
                let moment: f64 =
                    weights.iter().enumerate().map(|(j, w)| w * ((first + j) as f64 - parts).powi(power)).sum();
                let expected = if power == 0 { 1.0 } else { 0.0 };
                assert!((moment - expected).abs() < 1e-10, "{parts} {power} {moment}");
            }
        }
    }
}
