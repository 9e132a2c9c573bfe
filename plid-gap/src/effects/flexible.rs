//! Free shapes: effects on the same signal at the same location, with a free characteristic. A free shape is fitted
//! together with an effect whose own characteristic does not suffice, and is never named. It distinguishes "this
//! location, another shape" from "something else".

use super::tanh::tanh;
use super::{Action, Command, Drive, Effect, Force, Memory, Parameter, Place, Range, Sampling, Sensor, Setting, Side};

/// The characteristic that a free shape changes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Flexible {
    /// A force as a function of the displacement.
    Stiffness,
    /// A force as a function of the velocity.
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
    /// Preceding and following values of an output.
    SensorPath,
    /// All stiffnesses over time.
    StiffnessCourse,
    /// An actuator's gain over time.
    GainCourse,
    /// A sensor's offset over time.
    ZeroCourse,
}

/// Knots of static curves, in units of the RMS of their signal. The slope is linear between knots. The first knots
/// represent backlash and steps about zero, the last ones represent limits that only peaks reach.
const KNOTS: [f64; 8] = [0.0, 0.1, 0.3, 0.8, 1.4, 2.0, 2.8, 3.8];

/// Widths of smoothed steps at zero velocity, in units of the RMS of the velocity.
const STEPS: [f64; 4] = [0.03, 0.12, 0.4, 1.5];

/// Yield points, in units of the RMS of their signal.
const YIELDS: [f64; 4] = [0.2, 0.6, 1.5, 4.0];

/// Number of earlier values of a command, half a sample apart.
const TAPS: usize = 4;

/// Positions of the other values of an output, in samples before the current one. One of them is later, because a
/// delay by a fraction of a sample interpolates between values on both sides.
const AROUND: [isize; 4] = [-1, 1, 2, 3];

/// The same for an output that a controller reads: no value depends on a later one.
const BEFORE: [isize; 4] = [1, 2, 3, 4];

/// Times at which a course may change its slope, as shares of the records' duration.
const TURNS: [f64; 5] = [0.08, 0.2, 0.38, 0.6, 0.8];

/// All free shapes.
const ALL: [Flexible; 11] = [
    Flexible::Stiffness,
    Flexible::Damping,
    Flexible::Joint,
    Flexible::Command,
    Flexible::Hysteresis,
    Flexible::Path,
    Flexible::Sensor,
    Flexible::SensorPath,
    Flexible::StiffnessCourse,
    Flexible::GainCourse,
    Flexible::ZeroCourse,
];

impl Flexible {
    /// Returns the free shape of this name.
    pub fn named(name: &str) -> Option<&'static Self> {
        ALL.iter().find(|sibling| sibling.name() == name)
    }

    /// Returns whether the free shape can replace the effect. After an effect that clips peaks, no curve restores them.
    pub(crate) fn stands_alone(self) -> bool {
        matches!(self, Self::Command | Self::Sensor)
    }

    /// Returns whether an effect is a free shape that depends on the size of its signal. Nothing is known of such a
    /// curve beyond the sizes that were fitted. Weights of earlier values and courses over time hold at any level.
    pub(crate) fn is_curve(effect: &dyn Effect) -> bool {
        let curves = [Self::Stiffness, Self::Damping, Self::Joint, Self::Command, Self::Hysteresis, Self::Sensor];
        Self::named(effect.name()).is_some_and(|shape| curves.contains(shape))
    }

    fn count(self) -> usize {
        match self {
            Self::Stiffness | Self::Sensor | Self::Command => 2 * KNOTS.len(),
            Self::Damping => STEPS.len() + 2,
            Self::Joint | Self::Hysteresis => YIELDS.len(),
            Self::Path => TAPS,
            Self::SensorPath => AROUND.len(),
            Self::StiffnessCourse | Self::GainCourse | Self::ZeroCourse => TURNS.len(),
        }
    }

    /// Returns the unit of its signal and the size of its curve. The size is 1 if the curve needs none.
    pub fn units(self, setting: &Setting, place: &Place) -> [f64; 2] {
        match (self, place) {
            (Self::Stiffness | Self::Joint, _) => {
                let port = setting.port(place);
                [setting.d_rms[port], setting.force[port]]
            }
            (Self::Damping, _) => {
                let port = setting.port(place);
                [setting.v_rms[port], setting.force[port]]
            }
            (Self::Command | Self::Hysteresis, &Place::Input(i)) => [setting.u_rms[i], 1.0],
            (Self::Sensor, &Place::Output(o)) => [setting.y_rms[o], 1.0],
            (Self::StiffnessCourse | Self::GainCourse, _) => [setting.duration_s, 1.0],
            (Self::ZeroCourse, &Place::Output(o)) => [setting.duration_s, setting.y_rms[o]],
            _ => [1.0, 1.0],
        }
    }

    /// Returns the actions of a free shape with this unit and this size.
    pub fn act_in(self, setting: &Setting, place: &Place, [unit, size]: [f64; 2], shape: &[f64]) -> Vec<Action> {
        let shape = shape.to_vec();
        match (self, place) {
            (Self::Stiffness, _) => {
                vec![Action::Force(setting.port(place), Box::new(Curve { unit, size, shape }))]
            }
            (Self::Damping, _) => vec![Action::Force(setting.port(place), Box::new(Rate { unit, size, shape }))],
            (Self::Joint, _) => {
                let port = setting.port(place);
                let one = |(c, share): (&f64, &f64)| {
                    let joint = Element { k: c * size / unit, dy: share * unit };
                    Action::Force(port, Box::new(joint))
                };
                shape.iter().zip(&YIELDS).map(one).collect()
            }
            (Self::Command, &Place::Input(i)) => vec![Action::Command(Box::new(CommandCurve { i, unit, shape }))],
            (Self::Hysteresis, &Place::Input(i)) => vec![Action::Command(Box::new(Elements { i, unit, shape }))],
            (Self::Path, _) => vec![Action::Command(Box::new(CommandTaps { place: place.clone(), shape }))],
            (Self::Sensor, &Place::Output(o)) => vec![Action::Sensor(Box::new(OutputCurve { o, unit, shape }))],
            (Self::SensorPath, &Place::Output(o)) => {
                let back = if setting.plant.controller.is_some() { BEFORE } else { AROUND };
                vec![Action::Sensor(Box::new(OutputTaps { o, shape, back }))]
            }
            (Self::StiffnessCourse, _) => {
                vec![Action::Stiffness(Box::new(move |t| 1.0 + course(t / unit, &shape)))]
            }
            (Self::GainCourse, &Place::Input(i)) => vec![Action::Command(Box::new(GainOverTime { i, unit, shape }))],
            (Self::ZeroCourse, &Place::Output(o)) => {
                vec![Action::Sensor(Box::new(ZeroOverTime { o, unit, size, shape }))]
            }
            _ => Vec::new(),
        }
    }
}

impl Effect for Flexible {
    fn name(&self) -> &'static str {
        match self {
            Self::Stiffness => "free-stiffness",
            Self::Damping => "free-damping",
            Self::Joint => "free-joint",
            Self::Command => "free-command",
            Self::Hysteresis => "free-hysteresis",
            Self::Path => "free-command-path",
            Self::Sensor => "free-sensor",
            Self::SensorPath => "free-sensor-path",
            Self::StiffnessCourse => "free-stiffness-course",
            Self::GainCourse => "free-gain-course",
            Self::ZeroCourse => "free-zero-course",
        }
    }

    fn side(&self) -> Side {
        match self {
            Self::Stiffness | Self::Damping | Self::Joint => Side::Structure,
            Self::Command | Self::Hysteresis | Self::Path => Side::Actuator,
            Self::Sensor | Self::SensorPath | Self::ZeroCourse => Side::Sensor,
            Self::StiffnessCourse | Self::GainCourse => Side::Time,
        }
    }

    fn equation(&self) -> &'static str {
        match self {
            Self::Stiffness => {
                "f = -size B(d/unit); B(x) = sign(x) (s_1 abs(x) + sum_k s_k R_k(abs(x))), k = 2..8, where R_k' rises \
                from 0 to 1 between the knots K = 0, 0.1, 0.3, 0.8, 1.4, 2, 2.8, 3.8; s_9..s_16 where x < 0"
            }
            Self::Damping => {
                "x = v/unit; f = -size (sum_k s_k tanh(x/W_k) + s_5 x abs(x) + s_6 x^2), W = 0.03, 0.12, 0.4, 1.5"
            }
            Self::Joint => {
                "f = -(size/unit) sum_k s_k z_k; dz_k/dt = v - (abs(v) z_k + v abs(z_k)) / (2 Y_k unit), Y = 0.2, 0.6, \
                1.5, 4"
            }
            Self::Command => {
                "u' = u + unit B(u/unit); B(x) = sign(x) (s_1 abs(x) + sum_k s_k R_k(abs(x))), k = 2..8, where R_k' \
                rises from 0 to 1 between the knots K = 0, 0.1, 0.3, 0.8, 1.4, 2, 2.8, 3.8; s_9..s_16 where x < 0"
            }
            Self::Hysteresis => {
                "u' = u - sum_k s_k z_k; dz_k = du - (abs(du) z_k + du abs(z_k)) / (2 Y_k unit), Y = 0.2, 0.6, 1.5, 4"
            }
            Self::Path => "u'(t) = u(t) + sum_k s_k (u(t - k/2 samples) - u(t)), k = 1..4",
            Self::Sensor => {
                "y' = y + unit B(y/unit); B(x) = sign(x) (s_1 abs(x) + sum_k s_k R_k(abs(x))), k = 2..8, where R_k' \
                rises from 0 to 1 between the knots K = 0, 0.1, 0.3, 0.8, 1.4, 2, 2.8, 3.8; s_9..s_16 where x < 0"
            }
            Self::SensorPath => {
                "y'(k) = y(k) + sum_j s_j (y(k - j) - y(k)), j = -1, 1, 2, 3; in closed loop, j = 1, 2, 3, 4"
            }
            Self::StiffnessCourse => {
                "w_m^2 -> w_m^2 (1 + sum_k s_k max(t/unit - T_k, 0)), every mode, T = 0.08, 0.2, 0.38, 0.6, 0.8"
            }
            Self::GainCourse => "u' = u (1 + sum_k s_k max(t/unit - T_k, 0)), T = 0.08, 0.2, 0.38, 0.6, 0.8",
            Self::ZeroCourse => "y' = y + size sum_k s_k max(t/unit - T_k, 0), T = 0.08, 0.2, 0.38, 0.6, 0.8",
        }
    }

    fn parameters(&self, _setting: &Setting) -> Vec<Parameter> {
        (1..=self.count()).map(|k| Parameter::new(format!("s_{k}"), "1", Range::Signed)).collect()
    }

    fn places(&self, _setting: &Setting) -> Vec<Place> {
        Vec::new()
    }

    fn starts(&self, _setting: &Setting, _place: &Place) -> Vec<Vec<f64>> {
        vec![vec![0.0; self.count()]]
    }

    fn given(&self, setting: &Setting, place: &Place) -> Vec<(&'static str, f64, &'static str)> {
        let [unit, size] = self.units(setting, place);
        vec![("unit", unit, "as in the equation"), ("size", size, "as in the equation")]
    }

    fn act(&self, setting: &Setting, place: &Place, shape: &[f64]) -> Vec<Action> {
        self.act_in(setting, place, self.units(setting, place), shape)
    }
}

/// Returns a piecewise linear course over time: each piece begins at a change of slope and continues to the end.
fn course(share: f64, shape: &[f64]) -> f64 {
    shape.iter().zip(TURNS).map(|(c, turn)| c * (share - turn).max(0.0)).sum()
}

struct GainOverTime {
    i: usize,
    unit: f64,
    shape: Vec<f64>,
}

impl Command for GainOverTime {
    fn apply(&self, drive: &mut Drive, _memory: &mut Memory) {
        let (t0, rate, parts) = (drive.t0, drive.rate, drive.parts);
        for (k, u) in drive.u[self.i].iter_mut().enumerate() {
            let t = t0 + (k / parts) as f64 / rate;
            *u *= 1.0 + course(t / self.unit, &self.shape);
        }
    }
}

struct ZeroOverTime {
    o: usize,
    unit: f64,
    size: f64,
    shape: Vec<f64>,
}

impl Sensor for ZeroOverTime {
    fn apply(&self, y: &mut [Vec<f64>], sampling: Sampling, _memory: &mut Memory) {
        for (k, y) in y[self.o].iter_mut().enumerate() {
            *y += self.size * course(sampling.time(k) / self.unit, &self.shape);
        }
    }
}

/// Returns a curve whose slope is continuous on either side of zero: a straight line and, between each pair of
/// adjacent knots, a change of its slope.
fn characteristic(x: f64, shape: &[f64]) -> f64 {
    let side = if x >= 0.0 { &shape[..KNOTS.len()] } else { &shape[KNOTS.len()..] };
    let (sign, x) = (x.signum(), x.abs());
    let changed: f64 = side[1..].iter().zip(KNOTS.windows(2)).map(|(c, knots)| c * ramp(x, knots[0], knots[1])).sum();
    sign * (side[0] * x + changed)
}

/// Returns zero up to the first knot. From there, the slope rises linearly to one at the second knot.
fn ramp(x: f64, from: f64, to: f64) -> f64 {
    let (width, past) = (to - from, (x - from).max(0.0));
    if past < width { past * past / (2.0 * width) } else { past - width / 2.0 }
}

struct Curve {
    unit: f64,
    size: f64,
    shape: Vec<f64>,
}

impl Force for Curve {
    fn force(&self, d: f64, _v: f64, _state: &[f64]) -> f64 {
        -self.size * characteristic(d / self.unit, &self.shape)
    }
}

struct Rate {
    unit: f64,
    size: f64,
    shape: Vec<f64>,
}

impl Force for Rate {
    fn force(&self, _d: f64, v: f64, _state: &[f64]) -> f64 {
        let x = v / self.unit;
        let steps: f64 = self.shape.iter().zip(STEPS).map(|(c, width)| c * tanh(x / width)).sum();
        let [odd, even] = [self.shape[STEPS.len()], self.shape[STEPS.len() + 1]];
        -self.size * (steps + odd * x * x.abs() + even * x * x)
    }
}

struct Element {
    k: f64,
    dy: f64,
}

impl Force for Element {
    fn force(&self, _d: f64, _v: f64, state: &[f64]) -> f64 {
        -self.k * state[0]
    }

    fn states(&self) -> usize {
        1
    }

    fn advance(&self, from: f64, to: f64, state: &mut [f64]) {
        state[0] = super::slip::advance(state[0], to - from, 1.0, self.dy);
    }
}

struct CommandCurve {
    i: usize,
    unit: f64,
    shape: Vec<f64>,
}

impl Command for CommandCurve {
    fn apply(&self, drive: &mut Drive, _memory: &mut Memory) {
        for u in &mut drive.u[self.i] {
            *u += self.unit * characteristic(*u / self.unit, &self.shape);
        }
    }
}

struct Elements {
    i: usize,
    unit: f64,
    shape: Vec<f64>,
}

impl Command for Elements {
    fn apply(&self, drive: &mut Drive, memory: &mut Memory) {
        let [before, z @ ..] = memory.values([0.0; YIELDS.len() + 1]);
        for u in &mut drive.u[self.i] {
            for (z, share) in z.iter_mut().zip(YIELDS) {
                *z = super::slip::advance(*z, *u - *before, 1.0, share * self.unit);
            }
            *before = *u;
            *u -= self.shape.iter().zip(z.iter()).map(|(c, z)| c * z).sum::<f64>();
        }
    }
}

/// The command u(t) + sum of c_k (u(t - k/2 samples) - u(t)).
struct CommandTaps {
    place: Place,
    shape: Vec<f64>,
}

impl Command for CommandTaps {
    fn apply(&self, drive: &mut Drive, memory: &mut Memory) {
        drive.refine(2);
        let each = drive.parts / 2;
        for (i, channel) in drive.u.iter_mut().enumerate() {
            if self.place != Place::AllInputs && self.place != Place::Input(i) {
                continue;
            }
            let whole = memory.followed_by(i, channel, self.shape.len() * each);
            for (k, u) in channel.iter_mut().enumerate() {
                let then = |j: usize| whole.back(k, ((j + 1) * each) as isize).unwrap_or(0.0);
                *u += self.shape.iter().enumerate().map(|(j, c)| c * (then(j) - *u)).sum::<f64>();
            }
        }
    }
}

struct OutputCurve {
    o: usize,
    unit: f64,
    shape: Vec<f64>,
}

impl Sensor for OutputCurve {
    fn apply(&self, y: &mut [Vec<f64>], _sampling: Sampling, _memory: &mut Memory) {
        for y in &mut y[self.o] {
            *y += self.unit * characteristic(*y / self.unit, &self.shape);
        }
    }
}

struct OutputTaps {
    o: usize,
    shape: Vec<f64>,
    /// Positions of the other values, in samples before the current one.
    back: [isize; 4],
}

impl Sensor for OutputTaps {
    fn apply(&self, y: &mut [Vec<f64>], _sampling: Sampling, memory: &mut Memory) {
        let reach = self.back[self.back.len() - 1].unsigned_abs();
        let whole = memory.followed_by(self.o, &y[self.o], reach);
        for (k, y) in y[self.o].iter_mut().enumerate() {
            // Before the record, the value is zero. After it, the last value is held.
            let at = |back: isize| whole.back(k, back).unwrap_or(0.0);
            *y += self.shape.iter().zip(self.back).map(|(c, back)| c * (at(back) - at(0))).sum::<f64>();
        }
    }
}
