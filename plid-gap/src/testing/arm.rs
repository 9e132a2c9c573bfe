//! A nonlinear arm as an external simulator: a motor drives a link through a spring, and gravity acts on the link.
//!
//! The true systems are integrated in forty Runge-Kutta steps per sample with the effect inside the equations. The
//! simulator takes four steps per sample and holds a force over each of them.

use plid_simulator::{Description, Input, Motion, Output, OutputKind, Parameter, Port, Simulator, SimulatorError};

use crate::case::record::{Channels, Excitation, Record};
use crate::case::{Case, CaseConfig};
use crate::testing::{random_input, record};

pub const RATE: f64 = 200.0;
const STEPS: usize = 4;

/// Parameters of the arm: the inertias of motor and link, the spring between them, the damper of the motor, and the
/// gravity on the link.
#[derive(Debug, Clone, Copy)]
pub struct Numbers {
    pub motor: f64,
    pub link: f64,
    pub spring: f64,
    pub damper: f64,
    pub gravity: f64,
}

pub const NOMINAL: Numbers = Numbers { motor: 0.02, link: 0.05, spring: 60.0, damper: 0.15, gravity: 2.0 };

/// Angles of motor and link, their velocities, and one state of an effect.
type State = [f64; 5];

/// Torques on motor and link, and the time derivative of the effect's state, as functions of the state and the
/// command.
pub type Extra = fn(&State, f64, f64) -> [f64; 3];

pub fn nothing(_: &State, _: f64, _: f64) -> [f64; 3] {
    [0.0; 3]
}

fn rates(numbers: &Numbers, x: &State, torque: [f64; 2]) -> State {
    let [motor, link, motor_rate, link_rate, _] = *x;
    let twist = numbers.spring * (motor - link) + 0.02 * (motor_rate - link_rate);
    let pull = numbers.gravity * link.sin();
    let on_motor = torque[0] - twist - numbers.damper * motor_rate;
    let on_link = torque[1] + twist - pull;
    [motor_rate, link_rate, on_motor / numbers.motor, on_link / numbers.link, 0.0]
}

/// Carries out one step of the Runge-Kutta method.
fn step(x: &mut State, h: f64, of: impl Fn(&State) -> State) {
    let moved = |x: &State, k: &State, h: f64| -> State { std::array::from_fn(|i| x[i] + h * k[i]) };
    let a = of(x);
    let b = of(&moved(x, &a, 0.5 * h));
    let c = of(&moved(x, &b, 0.5 * h));
    let d = of(&moved(x, &c, h));
    *x = std::array::from_fn(|i| x[i] + h / 6.0 * (a[i] + 2.0 * b[i] + 2.0 * c[i] + d[i]));
}

/// Returns the outputs, which are the angles of the motor and of the link.
fn seen(x: &State) -> [f64; 2] {
    [x[0], x[1]]
}

/// The arm as its engineer simulates it.
pub struct Arm {
    description: Description,
    numbers: Numbers,
    state: State,
    /// Number of runs.
    pub runs: usize,
}

impl Arm {
    pub fn new() -> Self {
        let output =
            |name: &str| Output { kind: Some(OutputKind::Position), unit: Some("rad".into()), ..Output::new(name) };
        let mut description =
            Description::new("arm", RATE, vec![Input::new("torque")], vec![output("motor"), output("link")]);
        description.steps_per_sample = STEPS;
        description.ports = vec![Port { input: Some("torque".into()), ..Port::new("motor") }, Port::new("link")];
        let parameter = |name: &str, value: f64| Parameter { lower: Some(0.0), ..Parameter::new(name, value) };
        description.parameters = vec![
            parameter("link inertia", NOMINAL.link),
            parameter("spring", NOMINAL.spring),
            parameter("motor damper", NOMINAL.damper),
        ];
        Self { description, numbers: NOMINAL, state: [0.0; 5], runs: 0 }
    }
}

impl Simulator for Arm {
    fn description(&self) -> &Description {
        &self.description
    }

    fn start(&mut self, parameters: &[f64]) -> Result<Vec<Motion>, SimulatorError> {
        self.runs += 1;
        self.numbers = Numbers { link: parameters[0], spring: parameters[1], damper: parameters[2], ..NOMINAL };
        self.state = [0.0; 5];
        Ok(vec![Motion::default(); 2])
    }

    fn step(&mut self, u: &[f64], forces: &[f64], y: &mut [f64], motions: &mut [Motion]) -> Result<(), SimulatorError> {
        y.copy_from_slice(&seen(&self.state));
        let numbers = self.numbers;
        step(&mut self.state, 1.0 / (RATE * STEPS as f64), |x| rates(&numbers, x, [u[0] + forces[0], forces[1]]));
        let [motor, link, motor_rate, link_rate, _] = self.state;
        motions[0] = Motion { displacement: motor, velocity: motor_rate };
        motions[1] = Motion { displacement: link, velocity: link_rate };
        Ok(())
    }

    fn another(&self) -> Result<Option<Box<dyn Simulator>>, SimulatorError> {
        Ok(Some(Box::new(Self::new())))
    }
}

/// Returns the measured outputs of the real arm without noise.
fn measured(numbers: &Numbers, extra: Extra, u: &[f64]) -> Channels {
    let fine = 40;
    let h = 1.0 / (RATE * f64::from(fine));
    let mut state = [0.0; 5];
    let mut y = vec![Vec::new(), Vec::new()];
    for (k, &u) in u.iter().enumerate() {
        let now = seen(&state);
        (0..2).for_each(|o| y[o].push(now[o]));
        for part in 0..fine {
            let t = (k as f64 + f64::from(part) / f64::from(fine)) / RATE;
            step(&mut state, h, |x| {
                let [motor, link, own] = extra(x, u, t);
                let mut rates = rates(numbers, x, [u + motor, link]);
                rates[4] = own;
                rates
            });
        }
    }
    y
}

/// Returns a command that moves the arm: smoothed random steps, each of which is held for some samples.
fn command(seed: u64, samples: usize, level: f64) -> Vec<f64> {
    let random = random_input(seed, samples / 12 + 2, 1).remove(0);
    let mut smooth = 0.0;
    (0..samples)
        .map(|k| {
            smooth += 0.25 * (level * random[k / 12] - smooth);
            smooth
        })
        .collect()
}

/// Returns a case of three driven records at two levels and a quiet one, with noise of 0.5 %. `sense` changes the
/// outputs of the arm, and `drive` changes the command before it reaches the arm.
pub fn case(numbers: &Numbers, extra: Extra, drive: fn(&[f64]) -> Vec<f64>, sense: fn(&mut Channels)) -> Case {
    let mut config = CaseConfig::new(RATE, vec!["torque".into()], vec!["motor".into(), "link".into()]);
    let mut records: Vec<Record> = Vec::new();
    for (k, level) in [0.4, 0.8, 0.8, 0.0].into_iter().enumerate() {
        let u = command(7 + k as u64, 2000, level);
        let mut y = measured(numbers, extra, &drive(&u));
        sense(&mut y);
        let noise = random_input(70 + k as u64, 2000, 2);
        y.iter_mut().zip(&noise).for_each(|(y, noise)| y.iter_mut().zip(noise).for_each(|(y, e)| *y += 2e-3 * e));
        let mut one: Record = record(vec![u], y);
        one.name = format!("r{k}");
        one.start_s = 10.0 * k as f64;
        if level == 0.0 {
            one.excitation = Excitation::Zero;
        }
        records.push(one);
    }
    config.record = Vec::new();
    Case { config, model: None, controller: None, records, for_simulation: Vec::new(), warnings: Vec::new() }
}
