use super::{Action, Command, Drive, Effect, Flexible, Memory, Parameter, Place, Range, Setting, Side};
use std::f64::consts::TAU;

/// An actuator that is slower or faster than in the simulation.
pub struct ActuatorLag;

impl Effect for ActuatorLag {
    fn name(&self) -> &'static str {
        "actuator-lag"
    }

    fn side(&self) -> Side {
        Side::Actuator
    }

    fn family(&self) -> Option<&'static str> {
        Some("a delayed command")
    }

    fn equation(&self) -> &'static str {
        "the actuator's pole moves to fp (gain at zero frequency 1); inside a loop, its force lags with the pole fp"
    }

    fn is_linear(&self) -> bool {
        true
    }

    fn parameters(&self, _setting: &Setting) -> Vec<Parameter> {
        vec![Parameter::new("fp", "Hz", Range::Positive)]
    }

    fn places(&self, setting: &Setting) -> Vec<Place> {
        setting.inputs().into_iter().chain(setting.loops()).collect()
    }

    fn starts(&self, setting: &Setting, place: &Place) -> Vec<Vec<f64>> {
        match present(setting, place) {
            Some(hz) => [0.5, 0.75, 0.9, 1.12, 1.4, 2.2].map(|share| vec![share * hz]).to_vec(),
            // The mildest lag comes first, because a slow drive makes its loop unstable.
            None => [0.5, 0.25, 0.1, 0.02].map(|share| vec![share * setting.plant.rate]).to_vec(),
        }
    }

    fn free_shape(&self) -> Option<&'static Flexible> {
        Some(&Flexible::Path)
    }

    fn given(&self, setting: &Setting, place: &Place) -> Vec<(&'static str, f64, &'static str)> {
        present(setting, place).map(|pole| ("pole", pole, "Hz")).into_iter().collect()
    }

    fn act(&self, setting: &Setting, place: &Place, parameters: &[f64]) -> Vec<Action> {
        let (from, to) = (present(setting, place).map(|hz| hz * TAU), parameters[0] * TAU);
        match *place {
            Place::Input(i) => vec![Action::Command(Box::new(Lag { i, from, to }))],
            Place::Loop(_) => vec![Action::Lag(setting.port(place), to)],
            _ => Vec::new(),
        }
    }
}

/// Returns the pole in Hz that the actuator has in the simulation, if it has one. A loop has none of its own.
fn present(setting: &Setting, place: &Place) -> Option<f64> {
    if let Place::Input(i) = *place { setting.plant.chain.actuator_hz(i) } else { None }
}

/// Number of parts of a sample. Within a part, the mean of the lagged command is used.
const PARTS: usize = 8;

/// The transfer function (1 + s / from) / (1 + s / to); without `from`, an additional pole.
struct Lag {
    i: usize,
    from: Option<f64>,
    to: f64,
}

impl Command for Lag {
    fn apply(&self, drive: &mut Drive, memory: &mut Memory) {
        drive.refine(PARTS);
        let x = self.to * drive.step();
        let (decay, mean) = ((-x).exp(), -(-x).exp_m1() / x);
        let direct = self.from.map_or(0.0, |from| self.to / from);
        let [lagged] = memory.values([0.0]);
        for u in &mut drive.u[self.i] {
            let smooth = *u + (*lagged - *u) * mean;
            *lagged = *u + (*lagged - *u) * decay;
            *u = direct * *u + (1.0 - direct) * smooth;
        }
    }
}
