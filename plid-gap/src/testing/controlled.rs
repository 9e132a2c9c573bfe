//! Plants in closed loop. The true systems are integrated here in small steps. The controller is also implemented here;
//! it acts at the samples and reads noisy signals.

use std::cell::{Cell, RefCell};
use std::collections::VecDeque;
use std::f64::consts::TAU;
use std::path::Path;
use std::rc::Rc;

use nalgebra::{DMatrix, dmatrix};
use plid_model::Model;
use tempfile::TempDir;

use crate::answer::schema::{Diagnosis, NamedEffect};
use crate::case::Case;
use crate::case::record::{Channels, rms};
use crate::effects::{
    Action, ActuatorDeadZone, ActuatorDelay, ActuatorGain, ActuatorLag, ActuatorSaturation, ActuatorSlewLimit,
    CoulombFriction, CubicStiffness, Effect, Library, Place, SensorDelay, SensorGain, SensorLag, SensorOffset,
    SensorSaturation, Setting,
};
use crate::error::GapError;
use crate::judge::verdict::Verdict;
use crate::plant::Plant;
use crate::simulate::{Fineness, simulate};
use crate::testing::axis::{Axis, RATE};
use crate::testing::{diagnosed, diagnosed_among, first_is, only, random_input};

const SAMPLES: usize = 2500;

/// A free slider, and an inverted pendulum that falls over within half a second.
const SLIDER: Axis = Axis { mass: 1.0, c: 4.0, k: 0.0, force: |_, _| 0.0, position: true };
const PENDULUM: Axis = Axis { c: 0.5, k: -20.0, ..SLIDER };

/// Gains of the controllers: proportional, derivative and integral.
const GENTLE: [f64; 3] = [60.0, 6.0, 0.0];
const FIRM: [f64; 3] = [120.0, 12.0, 30.0];

/// Returns a controller whose states are the y of the previous sample and the integral of r - y: u = p (r - y) - d (y -
/// previous y) / T + i times the integral.
fn controller([p, d, i]: [f64; 3]) -> Model {
    let t = 1.0 / RATE;
    let (a, b) = (dmatrix![0.0, 0.0; 0.0, 1.0], dmatrix![1.0, 0.0; -t, t]);
    let (c, through) = (dmatrix![d / t, i], dmatrix![-p - d / t, p]);
    let mut model = Model::new(RATE, a, b, c, through).unwrap();
    (model.inputs, model.outputs) = (vec!["y1".into(), "r".into()], vec!["u1".into()]);
    model
}

/// Returns a [`controller`] without a reference.
fn without_reference(gains: [f64; 3]) -> Model {
    let mut model = controller(gains);
    model.inputs.truncate(1);
    (model.b, model.d) = (model.b.column(0).into_owned().resize(2, 1, 0.0), dmatrix![model.d[(0, 0)]]);
    model
}

/// A function that advances displacement and velocity over one sample, in which the command is held.
type Advance<'a> = &'a dyn Fn([f64; 2], f64) -> [f64; 2];

/// Such a function of its own for each record.
type System<'a> = Box<dyn Fn([f64; 2], f64) -> [f64; 2] + 'a>;

/// Runs a loop from rest. Returns the measured displacements and the commands.
fn run(gains: [f64; 3], advance: Advance, r: &[f64], noise: &[f64]) -> [Vec<f64>; 2] {
    run_with_sensor(gains, advance, &|y| y, r, noise)
}

/// Runs a loop from rest whose sensor shows a function of the displacements.
fn run_with_sensor(
    gains: [f64; 3],
    advance: Advance,
    sensor: &dyn Fn(f64) -> f64,
    r: &[f64],
    noise: &[f64],
) -> [Vec<f64>; 2] {
    let [p, d, i] = gains;
    let (mut x, mut before, mut integral) = ([0.0; 2], 0.0, 0.0);
    let (mut measured, mut commands) = (Vec::new(), Vec::new());
    for (r, e) in r.iter().zip(noise) {
        let y = sensor(x[0]) + e;
        let u = p * (r - y) - d * (y - before) * RATE + i * integral;
        (before, integral) = (y, integral + (r - y) / RATE);
        measured.push(y);
        commands.push(u);
        x = advance(x, u);
    }
    [measured, commands]
}

/// Number of small steps in a sample.
const STEPS: usize = 200;

/// Returns a function that integrates over one sample by the classical Runge-Kutta method in small steps.
fn smooth(axis: Axis, force: impl Fn(f64, f64) -> f64) -> impl Fn([f64; 2], f64) -> [f64; 2] {
    driven(axis, force, |_, u, _| u)
}

/// Returns the same function for an actuator: `drive` returns its force in a small step from the number of the step,
/// the command and the displacement.
fn driven(
    axis: Axis,
    force: impl Fn(f64, f64) -> f64,
    drive: impl Fn(usize, f64, f64) -> f64,
) -> impl Fn([f64; 2], f64) -> [f64; 2] {
    let h = 1.0 / (RATE * STEPS as f64);
    move |mut x, command| {
        let moved = |x: [f64; 2], k: [f64; 2], h: f64| [x[0] + h * k[0], x[1] + h * k[1]];
        for step in 0..STEPS {
            let u = drive(step, command, x[0]);
            let rate = |x: [f64; 2]| [x[1], (u - axis.c * x[1] - axis.k * x[0] + force(x[0], x[1])) / axis.mass];
            let k1 = rate(x);
            let k2 = rate(moved(x, k1, h / 2.0));
            let k3 = rate(moved(x, k2, h / 2.0));
            let k4 = rate(moved(x, k3, h));
            x = std::array::from_fn(|j| x[j] + h / 6.0 * (k1[j] + 2.0 * k2[j] + 2.0 * k3[j] + k4[j]));
        }
        x
    }
}

/// Returns a function that integrates over one sample with friction that holds up to 0.3 and slides at 0.2. It takes
/// small steps, and a step in which the velocity would change its sign ends at rest.
fn sticking(axis: Axis) -> impl Fn([f64; 2], f64) -> [f64; 2] {
    let h = 1.0 / (RATE * STEPS as f64);
    move |[mut d, mut v], u| {
        for _ in 0..STEPS {
            let other = u - axis.c * v - axis.k * d;
            if v == 0.0 && other.abs() <= 0.3 {
                continue;
            }
            let sign = if v == 0.0 { other.signum() } else { v.signum() };
            let next = v + h / axis.mass * (other - sign * (0.2 + 0.1 * (-(v / 0.02).powi(2)).exp()));
            let next = if v * next < 0.0 { 0.0 } else { next };
            d += h * 0.5 * (v + next);
            v = next;
        }
        [d, v]
    }
}

/// Returns a reference whose steps are held over 40 samples.
fn reference(seed: u64, level: f64) -> Vec<f64> {
    let drawn = &random_input(seed, SAMPLES, 1)[0];
    (0..SAMPLES).map(|k| level * drawn[k / 40]).collect()
}

/// The signals that are declared as the inputs of a case.
#[derive(Clone, Copy, PartialEq, Debug)]
enum Given {
    References,
    Commands,
}

/// Writes a case of a quiet record and three driven ones. `std` is the standard deviation of the noise.
fn written(sim: &Model, gains: [f64; 3], advance: Advance, std: f64, given: Given) -> TempDir {
    written_by(sim, gains, &|| Box::new(advance), std, given)
}

/// Writes such a case, with a new system for each record.
fn written_by<'a>(sim: &Model, gains: [f64; 3], system: &dyn Fn() -> System<'a>, std: f64, given: Given) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let put = |name: &str, text: String| std::fs::write(folder.path().join(name), text).unwrap();
    let mut sim = sim.clone();
    sim.noise.sensor_std = Some(vec![std]);
    sim.noise.actuator_std = Some(vec![0.0]);
    put("sim.json", sim.to_json().to_string());
    let law = if given == Given::References { controller(gains) } else { without_reference(gains) };
    put("controller.json", law.to_json().to_string());
    let input = if given == Given::References { "r" } else { "u1" };
    let mut case = format!(
        "sim = \"sim.json\"\nsample_rate_hz = {RATE:?}\ninputs = [\"{input}\"]\noutputs = [\"y1\"]\n\
        units = {{ u1 = \"N\", y1 = \"m\" }}\n[controller]\nmodel = \"controller.json\"\n"
    );
    for (k, level) in [0.0, 0.02, 0.01, 0.02].into_iter().enumerate() {
        let r = reference(k as u64 + 1, level);
        let noise: Vec<f64> = random_input(k as u64 + 50, SAMPLES, 1)[0].iter().map(|e| std * e).collect();
        let [y, u] = run(gains, &*system(), &r, &noise);
        let rows: String = (0..SAMPLES).map(|k| format!("{:?},{:?},{:?}\n", r[k], u[k], y[k])).collect();
        put(&format!("r{k}.csv"), format!("r,u1,y1\n{rows}"));
        let excitation = if k == 0 { "zero" } else { "random" };
        case += &format!("[[record]]\nfile = \"r{k}.csv\"\nexcitation = \"{excitation}\"\n");
    }
    put("case.toml", case);
    folder
}

fn read(folder: &Path) -> Result<Case, GapError> {
    Case::read(&folder.join("case.toml"))
}

fn diagnosed_in(folder: &TempDir) -> Diagnosis {
    diagnosed(&read(folder.path()).unwrap())
}

/// Returns the simulation in closed loop.
fn closed(axis: Axis, gains: [f64; 3]) -> (Plant, Setting) {
    let sim = axis.simulation();
    let mut plant = Plant::new(&sim).unwrap();
    plant.close(std::sync::Arc::new(crate::case::Controller::new(&sim, controller(gains)).unwrap()));
    let setting = Setting::bare(&plant, &sim);
    (plant, setting)
}

/// Returns the RMS difference between the simulation in closed loop and the integration in small steps, relative to the
/// change of the displacement that the force causes.
fn far(axis: Axis, gains: [f64; 3], effect: &dyn Effect, parameters: &[f64], law: fn(f64, f64) -> f64) -> f64 {
    let (plant, setting) = closed(axis, gains);
    let r = reference(7, 0.02);
    let actions: Vec<Action> = effect.act(&setting, &Place::Input(0), parameters);
    let v = plant.controller.as_ref().unwrap().driven_by(std::slice::from_ref(&r));
    let found = simulate(&plant, &actions, &v, 0.0, None, Fineness::FINE).remove(0);
    let [expected, _] = run(gains, &smooth(axis, law), &r, &vec![0.0; SAMPLES]);
    let [without, _] = run(gains, &smooth(axis, |_, _| 0.0), &r, &vec![0.0; SAMPLES]);
    let rms_of = |a: &[f64], b: &[f64]| rms(a.iter().zip(b).map(|(a, b)| a - b));
    assert!(rms_of(&expected, &without) > 0.03 * rms(&expected), "the force changes nothing");
    rms_of(&found, &expected) / rms_of(&expected, &without)
}

/// Between two samples, the command is held while the plant moves, and the controller acts only at the samples. This is
/// tested with friction and a cubic spring on a free slider and on an inverted pendulum.
#[test]
fn forces_within_a_loop_agree_with_small_steps() {
    fn friction(_: f64, v: f64) -> f64 {
        -0.2 * (v / 0.02).tanh()
    }
    fn cube(d: f64, _: f64) -> f64 {
        -3e4 * d.powi(3)
    }
    for (axis, gains) in [(SLIDER, GENTLE), (PENDULUM, FIRM)] {
        let by_friction = far(axis, gains, &CoulombFriction, &[0.2, 0.02], friction);
        assert!(by_friction < 1e-4, "k {}: {by_friction}", axis.k);
        let by_spring = far(axis, gains, &CubicStiffness, &[3e4], cube);
        assert!(by_spring < 1e-4, "k {}: {by_spring}", axis.k);
        println!("k {}: friction {by_friction:.1e}, cubic spring {by_spring:.1e}", axis.k);
    }
}

/// A gain inside the loop is a change of the plant. In the truth, the command is multiplied before the axis, or the
/// displacement is measured with a factor.
#[test]
fn gains_within_a_loop_agree_with_small_steps() {
    let r = reference(7, 0.02);
    for (axis, gains) in [(SLIDER, GENTLE), (PENDULUM, FIRM)] {
        let (plant, setting) = closed(axis, gains);
        let v = plant.controller.as_ref().unwrap().driven_by(std::slice::from_ref(&r));
        let exact = smooth(axis, |_, _| 0.0);
        let weak = |x: [f64; 2], u: f64| exact(x, 0.8 * u);
        let large = |x: [f64; 2], u: f64| exact(x.map(|x| x / 1.2), u).map(|x| 1.2 * x);
        let cases: [(&dyn Effect, Place, f64, Advance); 2] =
            [(&ActuatorGain, Place::Input(0), 0.8, &weak), (&SensorGain, Place::Output(0), 1.2, &large)];
        for (effect, place, gain, advance) in cases {
            let found = simulate(&plant, &effect.act(&setting, &place, &[gain]), &v, 0.0, None, Fineness::FINE);
            let [expected, _] = run(gains, advance, &r, &vec![0.0; SAMPLES]);
            let far = rms(found[0].iter().zip(&expected).map(|(a, b)| a - b)) / rms(&expected);
            assert!(far < 1e-7, "{} k {}: {far}", effect.name(), axis.k);
        }
    }
}

/// Asserts that the first effect is one of a pair that makes the same records, and that the answer says so. Returns the
/// effect.
fn first_is_of<'d>(found: &'d Diagnosis, pair: [[&str; 2]; 2]) -> &'d NamedEffect {
    let first = &found.effects[0];
    let named = |[effect, location]: [&str; 2]| first.effect == effect && first.location == location;
    assert!(pair.into_iter().any(named), "{}", found.sentence);
    let same = |[effect, _]: [&str; 2]| found.not_separable.iter().flatten().any(|words| words.contains(effect));
    assert!(pair.into_iter().all(same), "{}", found.sentence);
    first
}

/// A weak actuator makes a slider respond like one with more mass and more damping. It is the simpler explanation. With
/// one input and one output, a sensor with the same factor makes the same records.
#[test]
fn a_weak_actuator_is_named_under_control() {
    let exact = smooth(SLIDER, |_, _| 0.0);
    let weak = |x: [f64; 2], u: f64| exact(x, 0.8 * u);
    for given in [Given::References, Given::Commands] {
        let found = diagnosed_in(&written(&SLIDER.simulation(), GENTLE, &weak, 2e-5, given));
        assert_eq!(found.verdict, Verdict::Effects, "{given:?}: {}", found.sentence);
        let first = first_is_of(&found, [["actuator-gain", "input:u1"], ["sensor-gain", "output:y1"]]);
        assert_eq!(found.effects.len(), 1, "{given:?}: {}", found.sentence);
        let value = first.parameters["g"].value;
        assert!((value / 0.8 - 1.0).abs() < 0.02, "{given:?}: {value}: {}", found.sentence);
    }
}

/// A true system: an actuator and a sensor.
struct Truth {
    effect: &'static dyn Effect,
    place: Place,
    parameters: Vec<f64>,
    /// The force in a small step of a sample, from the number of the step, the command and the displacement.
    drive: Box<dyn Fn(usize, f64, f64) -> f64>,
    sensor: Box<dyn Fn(f64) -> f64>,
}

/// Returns an actuator.
fn actuator(effect: &'static dyn Effect, parameters: &[f64], drive: impl Fn(usize, f64) -> f64 + 'static) -> Truth {
    let (parameters, sensor) = (parameters.to_vec(), Box::new(|y| y));
    Truth { effect, place: Place::Input(0), parameters, drive: Box::new(move |step, u, _| drive(step, u)), sensor }
}

/// Returns a sensor.
fn sensor(effect: &'static dyn Effect, parameters: &[f64], sensor: impl Fn(f64) -> f64 + 'static) -> Truth {
    let (parameters, drive) = (parameters.to_vec(), Box::new(|_: usize, u: f64, _: f64| u));
    Truth { effect, place: Place::Output(0), parameters, drive, sensor: Box::new(sensor) }
}

/// Returns an actuator with a pole at a frequency in Hz: the mean of its force over each small step.
fn lagging(hz: f64) -> Truth {
    let (force, x) = (Cell::new(0.0), TAU * hz / (RATE * STEPS as f64));
    actuator(&ActuatorLag, &[hz], move |_, u| {
        let before = force.get() - u;
        force.set(u + before * (-x).exp());
        u - before * (-x).exp_m1() / x
    })
}

/// Returns an actuator that is late by a number of samples.
fn late(samples: f64) -> Truth {
    let (steps, past) = ((samples * STEPS as f64).round() as usize, RefCell::new(VecDeque::new()));
    past.borrow_mut().resize(steps, 0.0);
    actuator(&ActuatorDelay, &[samples], move |_, u| {
        past.borrow_mut().push_back(u);
        past.borrow_mut().pop_front().unwrap()
    })
}

/// Returns an actuator whose force changes at a limited rate.
fn slow(per_second: f64) -> Truth {
    let (force, most) = (Cell::new(0.0_f64), per_second / (RATE * STEPS as f64));
    actuator(&ActuatorSlewLimit, &[per_second], move |_, u| {
        force.set(force.get() + (u - force.get()).clamp(-most, most));
        force.get()
    })
}

/// Returns a sensor that is late by a number of samples. It sees the displacements of all small steps.
fn late_sensor(samples: f64) -> Truth {
    let steps = (samples * STEPS as f64).round() as usize;
    let seen = Rc::new(RefCell::new(vec![0.0; steps]));
    let there = seen.clone();
    let drive = move |_: usize, u: f64, d: f64| {
        there.borrow_mut().push(d);
        u
    };
    // At a sample, the displacements of all earlier small steps have been seen.
    let sensor = move |_: f64| {
        let seen = seen.borrow();
        seen[seen.len() - steps]
    };
    let (effect, place) = (&SensorDelay, Place::Output(0));
    Truth { effect, place, parameters: vec![samples], drive: Box::new(drive), sensor: Box::new(sensor) }
}

fn truths() -> Vec<Truth> {
    let (lagged, al) = (Cell::new(0.0), (-TAU * 15.0 / RATE).exp());
    vec![
        lagging(8.0),
        late(1.5),
        slow(8.0),
        actuator(&ActuatorSaturation, &[0.5, 0.0], |_, u| u.clamp(-0.5, 0.5)),
        actuator(&ActuatorDeadZone, &[0.05], |_, u| u.signum() * (u.abs() - 0.05).max(0.0)),
        sensor(&SensorLag, &[15.0], move |y| {
            lagged.set(al * lagged.get() + (1.0 - al) * y);
            lagged.get()
        }),
        late_sensor(0.5),
        late_sensor(1.5),
        late_sensor(4.0),
        sensor(&SensorSaturation, &[0.015, 0.0], |y| y.clamp(-0.015, 0.015)),
        sensor(&SensorOffset, &[0.002], |y| y + 0.002),
    ]
}

/// Effects on commands and measurements act inside the loop, sample by sample.
#[test]
fn actuators_and_sensors_within_a_loop_agree_with_small_steps() {
    let (r, still) = (reference(7, 0.02), vec![0.0; SAMPLES]);
    for (axis, gains) in [(SLIDER, GENTLE), (PENDULUM, FIRM)] {
        let (plant, setting) = closed(axis, gains);
        let v = plant.controller.as_ref().unwrap().driven_by(std::slice::from_ref(&r));
        let [without, _] = run(gains, &smooth(axis, |_, _| 0.0), &r, &still);
        for Truth { effect, place, parameters, drive, sensor } in truths() {
            let found = simulate(&plant, &effect.act(&setting, &place, &parameters), &v, 0.0, None, Fineness::FINE);
            let [expected, _] = run_with_sensor(gains, &driven(axis, |_, _| 0.0, drive), &*sensor, &r, &still);
            let apart = |a: &[f64], b: &[f64]| rms(a.iter().zip(b).map(|(a, b)| a - b));
            let changed = apart(&expected, &without);
            assert!(changed > 0.01 * rms(&without), "{} k {}: {changed}", effect.name(), axis.k);
            let far = apart(&found[0], &expected) / changed;
            println!("{} k {}: {far:.1e}", effect.name(), axis.k);
            assert!(far < 1e-2, "{} k {}: {far}", effect.name(), axis.k);
        }
    }
}

/// The actuator of a slider under control lags, is late, or has a limit. The controller responds to the result. With
/// one input and one output, a late sensor makes the same records as a late actuator.
#[test]
fn an_actuator_under_control_is_named() {
    let clipped = || actuator(&ActuatorSaturation, &[0.5, 0.0], |_, u| u.clamp(-0.5, 0.5));
    let truths: [(&str, &str, &dyn Fn() -> Truth); 3] = [
        ("actuator-lag", "fp", &|| lagging(8.0)),
        ("actuator-delay", "tau", &|| late(1.5)),
        ("actuator-saturation", "a", &clipped),
    ];
    for (name, parameter, truth) in truths {
        let size = truth().parameters[0];
        for given in [Given::References, Given::Commands] {
            let folder = written_by(
                &SLIDER.simulation(),
                GENTLE,
                &|| Box::new(driven(SLIDER, |_, _| 0.0, truth().drive)),
                1e-5,
                given,
            );
            let found = diagnosed_among(read(folder.path()).unwrap(), &RIVALS);
            assert_eq!(found.verdict, Verdict::Effects, "{given:?}: {}", found.sentence);
            let first = match name {
                "actuator-delay" => first_is_of(&found, [[name, "input:u1"], ["sensor-delay", "output:y1"]]),
                _ => first_is(&found, name, "input:u1"),
            };
            let value = first.parameters[parameter].value;
            assert!((value / size - 1.0).abs() < 0.05, "{given:?}: {parameter} {value}: {}", found.sentence);
        }
    }
}

/// Friction that sticks, other forces at its location, and effects of the actuator and the sensor.
const RIVALS: [&str; 13] = [
    "stick-friction",
    "coulomb-friction",
    "quadratic-damping",
    "added-damping",
    "cubic-stiffness",
    "backlash",
    "actuator-dead-zone",
    "actuator-delay",
    "actuator-lag",
    "actuator-saturation",
    "actuator-slew-limit",
    "sensor-delay",
    "sensor-lag",
];

#[test]
fn friction_that_sticks_is_named_on_a_slider_under_control() {
    for given in [Given::References, Given::Commands] {
        let mut case = read(written(&SLIDER.simulation(), GENTLE, &sticking(SLIDER), 1e-5, given).path()).unwrap();
        if given == Given::Commands {
            // The whole vocabulary is searched in the case with references.
            only(&mut case, &RIVALS);
        }
        let found = diagnosed(&case);
        assert_eq!(found.verdict, Verdict::Effects, "{given:?}: {}", found.sentence);
        let first = first_is(&found, "stick-friction", "input:u1");
        for (name, size) in [("Fc", 0.2), ("Fs", 0.3)] {
            let value = first.parameters[name].value;
            assert!((value / size - 1.0).abs() < 0.1, "{given:?}: {name} {value}: {}", found.sentence);
        }
        assert_eq!(first.parameters["Fc"].unit, "N");
        assert!(!found.place.side_is_clear);
    }
}

/// If the plant also responds within a sample, effects on the command are not tried, apart from gains and cross-talk.
/// The answer says so by name.
#[test]
fn effects_on_the_command_are_said_not_to_be_tried_in_an_algebraic_loop() {
    let exact = smooth(SLIDER, |_, _| 0.0);
    let sim = SLIDER.simulation();
    let read_case = |d: f64| {
        let sim = Model { d: dmatrix![d], ..sim.clone() };
        read(written(&sim, GENTLE, &exact, 1e-5, Given::References).path()).unwrap()
    };
    let audited = |case: &Case| crate::audit::audit(case, &Library::standard(), &[], &mut |_| {}).unwrap();
    let without = audited(&read_case(0.0));
    assert!(!without.case.warnings.iter().any(|words| words.starts_with("Not considered")));
    let audit = audited(&read_case(1e-6));
    let said = audit.case.warnings.iter().find(|words| words.starts_with("Not considered")).unwrap();
    for kind in ["lag", "delay", "saturation", "dead-zone", "gain-drift"] {
        let name = format!("actuator-{kind}");
        assert!(said.contains(&name) && audit.case.config.exclude.contains(&name), "{name}: {said}");
    }
}

#[test]
fn a_cubic_spring_is_named_on_an_unstable_pendulum() {
    let cube = smooth(PENDULUM, |d, _| -3e4 * d.powi(3));
    for given in [Given::References, Given::Commands] {
        let case = read(written(&PENDULUM.simulation(), FIRM, &cube, 5e-5, given).path()).unwrap();
        let found = diagnosed_among(case, &RIVALS);
        assert_eq!(found.verdict, Verdict::Effects, "{given:?}: {}", found.sentence);
        let first = first_is(&found, "cubic-stiffness", "input:u1");
        let value = first.parameters["k"].value;
        assert!((value / 3e4 - 1.0).abs() < 0.05, "{given:?}: {value}: {}", found.sentence);
    }
}

/// The simulation of an unstable plant is exact, with noise in the loop. The loop suppresses the noise at low
/// frequencies, but not at its crossover.
#[test]
fn nothing_is_missing_from_an_exact_unstable_simulation() {
    for given in [Given::References, Given::Commands] {
        let exact = smooth(PENDULUM, |_, _| 0.0);
        let found = diagnosed_in(&written(&PENDULUM.simulation(), FIRM, &exact, 1e-4, given));
        assert_eq!(found.verdict, Verdict::None, "{given:?}: {}", found.sentence);
        assert!(found.effects.is_empty() && found.gap.as_given < 1.1 * found.gap.noise_floor, "{:?}", found.gap);
    }
}

/// A part of a record begins in motion. The initial states of the controller are then fitted together with those of the
/// plant.
#[test]
fn a_part_of_a_record_begins_with_an_unknown_state_of_the_controller() {
    let exact = smooth(PENDULUM, |_, _| 0.0);
    for given in [Given::References, Given::Commands] {
        let folder = written(&PENDULUM.simulation(), FIRM, &exact, 1e-9, given);
        let case = read(folder.path()).unwrap();
        let part = case.records[1].part(1000..1600, RATE);
        let (plant, _) = closed(PENDULUM, FIRM);
        let y = crate::fit::free_run::run(&plant, &[], &part);
        let left = rms(part.error(&y).iter().flatten()) / rms(part.y.iter().flatten());
        assert!(left < 5e-3, "{given:?}: {left}");
        let resting = simulate(&plant, &[], &part.u, part.start_s, None, Fineness::FINE);
        assert!(rms(part.error(&resting).iter().flatten()) > 0.1 * rms(part.y.iter().flatten()));
    }
}

/// The noise in a loop, once whitened, has a variance of one on average over all frequencies. It also does at the
/// lowest frequencies, where the controller suppresses the noise and the ends of the record leak.
#[test]
fn noise_in_a_loop_is_whitened() {
    use crate::noise::NoiseModel;
    use crate::noise::whiten::Whitener;
    const RUNS: u64 = 100;
    let (plant, _) = closed(SLIDER, GENTLE);
    let noise = NoiseModel::declared(&plant, &[1e-3], &[0.0]);
    let mut powers = vec![0.0; SAMPLES];
    for seed in 0..RUNS {
        let e: Vec<f64> = random_input(seed + 900, SAMPLES, 1)[0].iter().map(|e| 1e-3 * e).collect();
        let [y, _] = run(GENTLE, &smooth(SLIDER, |_, _| 0.0), &vec![0.0; SAMPLES], &e);
        let record = super::record(vec![vec![0.0; SAMPLES]], vec![y]);
        let whitener = Whitener::new(&record, &noise, RATE, vec![Vec::new()]);
        let mut white = vec![0.0; whitener.rows()];
        whitener.apply(&record.y, &mut white);
        powers.iter_mut().zip(&white).for_each(|(sum, white)| *sum += white * white / RUNS as f64);
    }
    let mean = |powers: &[f64]| powers.iter().sum::<f64>() / powers.len() as f64;
    assert!((mean(&powers) - 1.0).abs() < 0.02, "{}", mean(&powers));
    assert!((mean(&powers[..20]) - 1.0).abs() < 0.15, "{:?}", &powers[..20]);
}

/// A prediction from the file of a diagnosis is driven by the references, or by the signals that are added to the
/// commands.
#[test]
fn a_prediction_closes_the_loop() {
    use crate::answer::predict::Predictor;
    let cube = smooth(PENDULUM, |d, _| -3e4 * d.powi(3));
    let r = reference(99, 0.02);
    let [y, u] = run(FIRM, &cube, &r, &vec![0.0; SAMPLES]);
    for given in [Given::References, Given::Commands] {
        let folder = written(&PENDULUM.simulation(), FIRM, &cube, 5e-5, given);
        let case = read(folder.path()).unwrap();
        let simulation = crate::diagnose(&case, &Library::standard(), &mut |_| {}).unwrap().simulation;
        let predictor = Predictor::new(simulation, &Library::standard(), Path::new("here")).unwrap();
        let (name, input): (&str, Channels) = match given {
            Given::References => ("r", vec![r.clone()]),
            Given::Commands => {
                ("u1", predictor.without_feedback(std::slice::from_ref(&u), std::slice::from_ref(&y)).unwrap())
            }
        };
        assert_eq!(predictor.inputs, [name]);
        let predicted = predictor.predict(&input, predictor.t0).unwrap().outputs.remove(0);
        let error: Vec<f64> = predicted.iter().zip(&y).map(|(a, b)| a - b).collect();
        assert!(rms(&error) < 0.01 * rms(&y), "{given:?}: {}", rms(&error) / rms(&y));
    }
}

/// Changes a file of a case.
fn change(folder: &TempDir, name: &str, change: impl FnOnce(String) -> String) {
    let path = folder.path().join(name);
    std::fs::write(&path, change(std::fs::read_to_string(&path).unwrap())).unwrap();
}

/// Writes a case whose simulation is exact.
fn exact(given: Given) -> TempDir {
    written(&PENDULUM.simulation(), FIRM, &smooth(PENDULUM, |_, _| 0.0), 1e-4, given)
}

/// Writes another controller into a case.
fn put(folder: &TempDir, law: &Model) {
    std::fs::write(folder.path().join("controller.json"), law.to_json().to_string()).unwrap();
}

/// Returns the error that arises when a case is read or audited.
fn says(folder: &TempDir) -> String {
    let case = match read(folder.path()) {
        Ok(case) => case,
        Err(error) => return format!("{:?}", miette::Report::new(error)),
    };
    crate::audit::audit(&case, &Library::standard(), &[], &mut |_| {}).unwrap_err().to_string()
}

#[test]
fn channels_that_make_no_loop_are_refused() {
    let law = controller(FIRM);
    let cases: [(Given, Model, &str); 6] = [
        (Given::References, Model { outputs: vec!["w".into()], ..law.clone() }, "`w`, which is not an input"),
        (Given::References, Model { inputs: vec!["a".into(), "r".into()], ..law.clone() }, "one output of the plant"),
        (Given::References, Model { inputs: vec!["y1".into(), "s".into()], ..law.clone() }, "inputs: r here"),
        (Given::Commands, law.clone(), "inputs: u1 here"),
        (Given::References, without_reference(FIRM), "has no reference, so they are u1"),
        (Given::References, Model { sample_rate_hz: 100.0, ..law.clone() }, "sampled at 100 Hz"),
    ];
    for (given, law, words) in cases {
        let folder = exact(given);
        put(&folder, &law);
        let said = says(&folder);
        assert!(said.contains(words) && said.contains("controller.json"), "{words}: {said}");
    }
}

#[test]
fn what_does_not_fit_a_loop_is_refused() {
    let folder = exact(Given::References);
    put(&folder, &controller([-120.0, 12.0, 0.0]));
    assert!(says(&folder).contains("controller.json: the loop that it closes around the simulation is unstable"));
    let straight = exact(Given::References);
    change(&straight, "sim.json", |_| {
        let sim = PENDULUM.simulation();
        // u = v - (p + d / T) y with y = ... - u / (p + d / T) has no solution.
        let d = DMatrix::from_element(1, 1, -1.0 / (FIRM[0] + FIRM[1] * RATE));
        Model { d, ..sim }.to_json().to_string()
    });
    assert!(says(&straight).contains("algebraic loop"), "{}", says(&straight));
    let gap = exact(Given::Commands);
    change(&gap, "r1.csv", |text| text.replacen(&text.lines().nth(9).unwrap().to_string(), "0,0,nan", 1));
    let said = says(&gap);
    assert!(said.contains("r1.csv") && said.contains("`y1` lacks sample 8"), "{said}");
    let decimated = exact(Given::References);
    change(&decimated, "case.toml", |text| format!("decimate_to_hz = 125.0\n{text}"));
    assert!(says(&decimated).contains("acts at every sample"), "{}", says(&decimated));
    let unit = exact(Given::References);
    change(&unit, "case.toml", |text| text.replace("u1 = \"N\"", "r = \"m\", u9 = \"N\""));
    assert!(says(&unit).contains("`u9` is not one of the channels"), "{}", says(&unit));
    let alone = exact(Given::Commands);
    change(&alone, "case.toml", |text| text.replace("[controller]\nmodel = \"controller.json\"\n", ""));
    let error = crate::audit::audit(&read(alone.path()).unwrap(), &Library::standard(), &[], &mut |_| {}).unwrap_err();
    assert!(matches!(error, GapError::Unstable { .. }), "{error}");
    assert!(format!("{:?}", miette::Report::new(error)).contains("[controller]"));
}
