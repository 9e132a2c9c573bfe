use super::{Action, Command, Drive, Effect, Flexible, Memory, Parameter, Place, Range, Setting, Side};

/// An amplifier whose output cannot follow fast commands.
pub struct ActuatorSlewLimit;

impl Effect for ActuatorSlewLimit {
    fn name(&self) -> &'static str {
        "actuator-slew-limit"
    }

    fn side(&self) -> Side {
        Side::Actuator
    }

    fn equation(&self) -> &'static str {
        "u' follows u with abs(du'/dt) <= R"
    }

    fn parameters(&self, _setting: &Setting) -> Vec<Parameter> {
        vec![Parameter::new("R", "V/s", Range::Positive)]
    }

    fn places(&self, setting: &Setting) -> Vec<Place> {
        setting.inputs()
    }

    fn starts(&self, setting: &Setting, place: &Place) -> Vec<Vec<f64>> {
        let Place::Input(i) = *place else { return Vec::new() };
        [0.4, 0.8, 1.3, 2.0, 3.0, 8.0].map(|share| vec![share * setting.u_slope[i]]).to_vec()
    }

    fn sound(&self, setting: &Setting, place: &Place, parameters: &[f64]) -> bool {
        let Place::Input(i) = *place else { return false };
        // At this limit, an RMS step of the command takes a fiftieth of a sample; a higher limit has hardly any
        // effect.
        parameters[0] < 50.0 * setting.u_slope[i]
    }

    fn free_shape(&self) -> Option<&'static Flexible> {
        Some(&Flexible::Path)
    }

    fn act(&self, _setting: &Setting, place: &Place, parameters: &[f64]) -> Vec<Action> {
        let Place::Input(i) = *place else { return Vec::new() };
        vec![Action::Command(Box::new(Slew { i, limit: parameters[0] }))]
    }
}

/// Number of parts of a sample. Within a part, the mean of the ramp is used.
const PARTS: usize = 8;

struct Slew {
    i: usize,
    limit: f64,
}

impl Command for Slew {
    fn apply(&self, drive: &mut Drive, memory: &mut Memory) {
        drive.refine(PARTS);
        let most = self.limit * drive.step();
        let [now] = memory.values([0.0]);
        for u in &mut drive.u[self.i] {
            let (from, far) = (*now, *u - *now);
            if far.abs() <= most {
                *now = *u;
                // The ramp lasts for a share of the part, and the command is held for the remainder.
                *u = *now - 0.5 * far * far.abs() / most;
            } else {
                *now += most * far.signum();
                *u = 0.5 * (from + *now);
            }
        }
    }
}
