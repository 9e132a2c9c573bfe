//! Flexible siblings: the same signal at the same place, with a free shape. They are fitted beside an effect whose own shape does not
//! suffice, and never named: they tell "this place, another shape" from "something else".

use super::{Action, Command, Drive, Effect, Force, Parameter, Place, Range, Sensor, Setting, Side};

/// What a flexible sibling bends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Flexible {
    /// A force of the displacement.
    Stiffness,
    /// A force of the velocity.
    Damping,
    /// Several joints that slip at different displacements.
    Joint,
    /// A static curve of a command.
    Command,
    /// Several hysteretic elements of a command.
    Hysteresis,
    /// Earlier values of a command.
    Path,
    /// A static curve of an output.
    Sensor,
    /// Earlier values of an output.
    SensorPath,
}

/// Knots of static curves in RMS of their signal.
const KNOTS: [f64; 4] = [0.3, 0.9, 1.7, 2.7];

/// Widths of smoothed steps of the velocity in RMS.
const STEPS: [f64; 4] = [0.03, 0.12, 0.4, 1.5];

/// Yield points in RMS.
const YIELDS: [f64; 4] = [0.2, 0.6, 1.5, 4.0];

/// Earlier values: in half samples.
const TAPS: usize = 4;

impl Flexible {
    /// The sibling of an effect, by its name; none for effects that have no shape.
    pub fn of(effect: &str) -> Option<&'static Self> {
        Some(match effect {
            "cubic-stiffness" | "quadratic-stiffness" | "clearance" => &Self::Stiffness,
            "coulomb-friction" | "quadratic-damping" => &Self::Damping,
            "joint-hysteresis" => &Self::Joint,
            "actuator-saturation" | "actuator-dead-zone" => &Self::Command,
            "actuator-hysteresis" => &Self::Hysteresis,
            "actuator-delay" | "actuator-lag" | "actuator-slew-limit" => &Self::Path,
            "sensor-saturation" => &Self::Sensor,
            "sensor-delay" | "sensor-lag" => &Self::SensorPath,
            _ => return None,
        })
    }

    fn count(self) -> usize {
        match self {
            Self::Stiffness | Self::Sensor => 2 * KNOTS.len(),
            Self::Damping => STEPS.len() + 1,
            Self::Joint | Self::Hysteresis => YIELDS.len(),
            Self::Command => 2 * KNOTS.len(),
            Self::Path | Self::SensorPath => TAPS,
        }
    }
}

impl Effect for Flexible {
    fn name(&self) -> &'static str {
        "flexible"
    }

    fn side(&self) -> Side {
        match self {
            Self::Stiffness | Self::Damping | Self::Joint => Side::Structure,
            Self::Command | Self::Hysteresis | Self::Path => Side::Actuator,
            Self::Sensor | Self::SensorPath => Side::Sensor,
        }
    }

    fn equation(&self) -> &'static str {
        "a free shape of the same signal"
    }

    fn parameters(&self, _setting: &Setting) -> Vec<Parameter> {
        (1..=self.count()).map(|k| Parameter::new(format!("s{k}"), "1", Range::Signed)).collect()
    }

    fn places(&self, _setting: &Setting) -> Vec<Place> {
        Vec::new()
    }

    fn starts(&self, _setting: &Setting, _place: &Place) -> Vec<Vec<f64>> {
        vec![vec![0.0; self.count()]]
    }

    fn act(&self, setting: &Setting, place: &Place, shape: &[f64]) -> Vec<Action> {
        let shape = shape.to_vec();
        match *self {
            Self::Stiffness | Self::Damping => {
                let port = setting.port(place);
                let size = setting.force[port];
                let curve: Box<dyn Force> = if *self == Self::Stiffness {
                    Box::new(Curve { unit: setting.d_rms[port], size, shape })
                } else {
                    Box::new(Rate { unit: setting.v_rms[port], size, shape })
                };
                vec![Action::Force(port, curve)]
            }
            Self::Joint => {
                let port = setting.port(place);
                let (size, d) = (setting.force[port], setting.d_rms[port]);
                let one = |(c, share): (&f64, &f64)| {
                    let joint = Element { k: c * size / d, dy: share * d };
                    Action::Force(port, Box::new(joint))
                };
                shape.iter().zip(&YIELDS).map(one).collect()
            }
            Self::Command => {
                let Place::Input(i) = *place else { return Vec::new() };
                vec![Action::Command(Box::new(Bent { i, unit: setting.u_rms[i], shape }))]
            }
            Self::Hysteresis => {
                let Place::Input(i) = *place else { return Vec::new() };
                vec![Action::Command(Box::new(Elements { i, unit: setting.u_rms[i], shape }))]
            }
            Self::Path => vec![Action::Command(Box::new(Taps { place: place.clone(), shape }))],
            Self::Sensor => {
                let Place::Output(o) = *place else { return Vec::new() };
                vec![Action::Sensor(Box::new(BentOutput { o, unit: setting.y_rms[o], shape }))]
            }
            Self::SensorPath => {
                let Place::Output(o) = *place else { return Vec::new() };
                vec![Action::Sensor(Box::new(OutputTaps { o, shape }))]
            }
        }
    }
}

/// Straight pieces that begin at the knots, on either side of zero: 2 for each knot.
fn bend(x: f64, shape: &[f64]) -> f64 {
    let side = if x >= 0.0 { &shape[..KNOTS.len()] } else { &shape[KNOTS.len()..] };
    let sum: f64 = side.iter().zip(KNOTS).map(|(c, knot)| c * (x.abs() - knot).max(0.0)).sum();
    sum * x.signum()
}

struct Curve {
    unit: f64,
    size: f64,
    shape: Vec<f64>,
}

impl Force for Curve {
    fn force(&self, d: f64, _v: f64, _state: f64) -> f64 {
        -self.size * bend(d / self.unit, &self.shape)
    }
}

struct Rate {
    unit: f64,
    size: f64,
    shape: Vec<f64>,
}

impl Force for Rate {
    fn force(&self, _d: f64, v: f64, _state: f64) -> f64 {
        let x = v / self.unit;
        let steps: f64 = self.shape.iter().zip(STEPS).map(|(c, width)| c * (x / width).tanh()).sum();
        -self.size * (steps + self.shape[STEPS.len()] * x * x.abs())
    }
}

struct Element {
    k: f64,
    dy: f64,
}

impl Force for Element {
    fn force(&self, _d: f64, _v: f64, state: f64) -> f64 {
        -self.k * state
    }

    fn advance(&self, from: f64, to: f64, state: f64) -> f64 {
        super::slip::advance(state, to - from, 1.0, self.dy)
    }
}

struct Bent {
    i: usize,
    unit: f64,
    shape: Vec<f64>,
}

impl Command for Bent {
    fn apply(&self, drive: &mut Drive) {
        for u in &mut drive.u[self.i] {
            *u += self.unit * bend(*u / self.unit, &self.shape);
        }
    }
}

struct Elements {
    i: usize,
    unit: f64,
    shape: Vec<f64>,
}

impl Command for Elements {
    fn apply(&self, drive: &mut Drive) {
        let mut z = [0.0; YIELDS.len()];
        let mut before = 0.0;
        for u in &mut drive.u[self.i] {
            for (z, share) in z.iter_mut().zip(YIELDS) {
                *z = super::slip::advance(*z, *u - before, 1.0, share * self.unit);
            }
            before = *u;
            *u -= self.shape.iter().zip(z).map(|(c, z)| c * z).sum::<f64>();
        }
    }
}

/// u + sum of c_k (u, k half samples earlier, - u).
struct Taps {
    place: Place,
    shape: Vec<f64>,
}

impl Command for Taps {
    fn apply(&self, drive: &mut Drive) {
        drive.refine(2);
        let each = drive.parts / 2;
        for (i, channel) in drive.u.iter_mut().enumerate() {
            if self.place != Place::AllInputs && self.place != Place::Input(i) {
                continue;
            }
            let at = |k: usize, back: usize| if k >= back { channel[k - back] } else { 0.0 };
            let changed = |k: usize| {
                let u = channel[k];
                let more = self.shape.iter().enumerate().map(|(j, c)| c * (at(k, (j + 1) * each) - u));
                u + more.sum::<f64>()
            };
            *channel = (0..channel.len()).map(changed).collect();
        }
    }
}

struct BentOutput {
    o: usize,
    unit: f64,
    shape: Vec<f64>,
}

impl Sensor for BentOutput {
    fn apply(&self, y: &mut [Vec<f64>], _t0: f64, _rate: f64) {
        for y in &mut y[self.o] {
            *y += self.unit * bend(*y / self.unit, &self.shape);
        }
    }
}

struct OutputTaps {
    o: usize,
    shape: Vec<f64>,
}

impl Sensor for OutputTaps {
    fn apply(&self, y: &mut [Vec<f64>], _t0: f64, _rate: f64) {
        let from = y[self.o].clone();
        let at = |k: usize, back: usize| if k >= back { from[k - back] } else { 0.0 };
        for (k, y) in y[self.o].iter_mut().enumerate() {
            let more = self.shape.iter().enumerate().map(|(j, c)| c * (at(k, j + 1) - from[k]));
            *y += more.sum::<f64>();
        }
    }
}
