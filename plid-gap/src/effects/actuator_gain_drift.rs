use super::{Action, Command, Drive, Effect, Flexible, Memory, Parameter, Place, Range, Setting, Side};

/// An actuator whose gain changes with time.
pub struct ActuatorGainDrift;

impl Effect for ActuatorGainDrift {
    fn name(&self) -> &'static str {
        "actuator-gain-drift"
    }

    fn side(&self) -> Side {
        Side::Time
    }

    fn equation(&self) -> &'static str {
        "u' = u (1 + r t)"
    }

    fn parameters(&self, _setting: &Setting) -> Vec<Parameter> {
        vec![Parameter::new("r", "1/s", Range::Signed)]
    }

    fn places(&self, setting: &Setting) -> Vec<Place> {
        setting.inputs()
    }

    fn starts(&self, setting: &Setting, _place: &Place) -> Vec<Vec<f64>> {
        vec![vec![0.02 / setting.duration_s]]
    }

    fn amplitude(&self) -> Option<(usize, f64)> {
        Some((0, 0.0))
    }

    fn free_shape(&self) -> Option<&'static Flexible> {
        Some(&Flexible::GainCourse)
    }

    fn act(&self, _setting: &Setting, place: &Place, parameters: &[f64]) -> Vec<Action> {
        let Place::Input(i) = *place else { return Vec::new() };
        vec![Action::Command(Box::new(Drift { i, r: parameters[0] }))]
    }
}

struct Drift {
    i: usize,
    r: f64,
}

impl Command for Drift {
    fn apply(&self, drive: &mut Drive, _memory: &mut Memory) {
        let (t0, rate, parts) = (drive.t0, drive.rate, drive.parts);
        for (k, u) in drive.u[self.i].iter_mut().enumerate() {
            let t = t0 + (k / parts) as f64 / rate;
            *u *= 1.0 + self.r * t;
        }
    }
}
