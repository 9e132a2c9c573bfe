//! Diagnoses of plants without lightly damped modes. The true systems are integrated as in the blind cases.

use std::f64::consts::TAU;

use nalgebra::dmatrix;
use plid_model::{Continuous, Model, Port};

use crate::answer::schema::Diagnosis;
use crate::case::record::{Channels, rms};
use crate::case::{Case, PortConfig};
use crate::effects::{Action, Effect, Library};
use crate::judge::verdict::Verdict;
use crate::simulate::{Fineness, simulate};
use crate::testing::blind::integrate;
use crate::testing::{add_noise, case_of_axis, diagnosed, diagnosed_among, first_is, held, only, random_input};

pub(super) const RATE: f64 = 250.0;
const SAMPLES: usize = 2500;

/// Number of samples over which a command is held, which is long enough for the axis to move.
const HOLD: usize = 10;

/// A mass on a viscous damper `c` and a spring `k`, with a further force that depends on displacement and velocity.
#[derive(Clone, Copy)]
pub(crate) struct Axis {
    pub mass: f64,
    pub c: f64,
    pub k: f64,
    pub force: fn(f64, f64) -> f64,
    pub position: bool,
}

impl Axis {
    /// Returns the simulation, which lacks the further force.
    pub fn simulation(&self) -> Model {
        if !self.position && self.k == 0.0 {
            // The position is not a state of a motor if only its velocity is measured.
            let (a, b) = held(&dmatrix![-self.c / self.mass], &dmatrix![self.mass.recip()], 1.0 / RATE);
            return Model::new(RATE, a, b, dmatrix![1.0], dmatrix![0.0]).unwrap();
        }
        Model { continuous: None, ports: Vec::new(), ..self.truth() }
    }

    /// Returns the real axis with its displacement and velocity as states, and with a port for the further force.
    fn truth(&self) -> Model {
        let (a, b) = (dmatrix![0.0, 1.0; -self.k / self.mass, -self.c / self.mass], dmatrix![0.0; self.mass.recip()]);
        let (step, input) = held(&a, &b, 1.0 / RATE);
        let c = if self.position { dmatrix![1.0, 0.0] } else { dmatrix![0.0, 1.0] };
        let mut model = Model::new(RATE, step, input, c, dmatrix![0.0]).unwrap();
        model.continuous = Some(Continuous { a, b });
        model.ports = vec![Port {
            name: "axis".into(),
            input: None,
            force: vec![0.0, self.mass.recip()],
            displacement: vec![1.0, 0.0],
            velocity: vec![0.0, 1.0],
            output: None,
        }];
        model
    }

    /// Returns a case of a quiet record and three driven ones, with 0.5 % of noise.
    pub fn case(&self) -> Case {
        self.case_behind(|_| {})
    }

    /// Returns a case in which the sensor changes its signal before the noise is added.
    fn case_behind(&self, sensor: fn(&mut Vec<f64>)) -> Case {
        self.case_of(drawn, sensor)
    }

    /// Returns a case of records with these inputs.
    fn case_of(&self, input: fn(usize) -> Channels, sensor: fn(&mut Vec<f64>)) -> Case {
        let truth = self.truth();
        let run = |u: &Channels| {
            let mut y = integrate(&truth, u, Some(&self.force)).0;
            y.iter_mut().for_each(sensor);
            y
        };
        let mut case = case_of_axis(&self.simulation(), input, run);
        if !self.position {
            case.config.units.insert("y1".into(), "m/s".into());
        }
        case
    }

    fn diagnosed(&self) -> Diagnosis {
        diagnosed(&self.case())
    }

    /// Returns the case of this axis with the simulation of another one.
    fn case_for(&self, simulated: &Self) -> Case {
        let mut case = self.case();
        let noise = case.model.as_ref().unwrap().noise.clone();
        case.model = Some(Model { noise, ..simulated.simulation() });
        case
    }
}

/// Returns the input of a record.
fn drawn(record: usize) -> Channels {
    let drawn = &random_input(record as u64 + 1, SAMPLES, 1)[0];
    vec![(0..SAMPLES).map(|n| drawn[n / HOLD]).collect()]
}

fn friction(_d: f64, v: f64) -> f64 {
    -0.1 * (v / 0.01).tanh()
}

fn none(_d: f64, _v: f64) -> f64 {
    0.0
}

fn is_friction(found: &Diagnosis) {
    assert_eq!(found.verdict, Verdict::Effects, "{}", found.sentence);
    let first = first_is(found, "coulomb-friction", "input:u1");
    let size = first.parameters["F"].value;
    assert!((size / 0.1 - 1.0).abs() < 0.05, "{size}: {}", found.sentence);
    // The units are those of the channels, whether position or velocity is measured.
    assert_eq!(["F", "v0"].map(|name| first.parameters[name].unit.as_str()), ["N", "m/s"]);
    assert!(found.text().contains(" N ("), "{}", found.text());
}

#[test]
fn friction_in_a_motor_seen_by_its_velocity() {
    is_friction(&Axis { mass: 1.0, c: 4.0, k: 0.0, force: friction, position: false }.diagnosed());
}

#[test]
fn friction_on_a_slider_without_a_spring() {
    is_friction(&Axis { mass: 1.0, c: 4.0, k: 0.0, force: friction, position: true }.diagnosed());
}

#[test]
fn friction_in_a_well_damped_servo() {
    let w = TAU * 1.5;
    is_friction(&Axis { mass: 1.0, c: 1.4 * w, k: w * w, force: friction, position: true }.diagnosed());
}

/// A short delay with a slow lag looks like a delay of all channels by many samples, which the audit finds first. The
/// remainder after this correction shows that the cause is another one.
#[test]
fn a_delay_with_a_lag_is_no_delay_of_all_channels() {
    let behind = |y: &mut Vec<f64>| {
        let turn = (-1.0 / (0.1 * RATE)).exp();
        let mut state = 0.0;
        y.splice(0..0, [0.0; 8]);
        y.truncate(SAMPLES);
        for y in y {
            state = turn * state + (1.0 - turn) * *y;
            *y = state;
        }
    };
    let motor = Axis { mass: 1.0, c: 2.0, k: 0.0, force: none, position: false };
    let found = diagnosed(&motor.case_behind(behind));
    let apparent = found.warnings.iter().any(|warning| warning.contains("look delayed"));
    assert!(apparent && found.sentence.contains("taken as they were recorded"), "{}", found.sentence);
    assert!(found.effects.iter().any(|effect| effect.effect.ends_with("-lag")), "{}", found.sentence);
    assert!(found.candidates.iter().any(|candidate| candidate.wiring.is_some()));
}

#[test]
fn nothing_is_missing_from_a_sound_motor() {
    let found = Axis { mass: 1.0, c: 4.0, k: 0.0, force: none, position: false }.diagnosed();
    assert_eq!(found.verdict, Verdict::None, "{}", found.sentence);
}

/// A viscous damper that is 5 % off is within the stated limits (two standard deviations are 10 %) and is not friction.
#[test]
fn a_pole_within_its_limits_is_no_effect() {
    let real = Axis { mass: 1.0, c: 4.2, k: 0.0, force: none, position: false };
    let found = diagnosed(&real.case_for(&Axis { c: 4.0, ..real }));
    assert_eq!(found.verdict, Verdict::None, "{}", found.sentence);
}

/// The spring stiffens so much that a free run of the linear simulation leaves more than half of the output
/// unexplained. The search in short windows finds the spring, alone and with its own shape.
#[test]
fn a_spring_that_moves_the_resonance_far_is_found() {
    fn stiff(d: f64, _v: f64) -> f64 {
        -2e5 * d.powi(3)
    }
    let found = Axis { mass: 1.0, c: 0.6, k: 400.0, force: stiff, position: true }.diagnosed();
    assert!(found.gap.as_given > 0.5, "{}", found.sentence);
    assert_eq!(found.verdict, Verdict::Effects, "{}", found.sentence);
    let [spring] = found.effects.as_slice() else { panic!("{}", found.sentence) };
    assert_eq!((spring.effect.as_str(), spring.location.as_str()), ("cubic-stiffness", "input:u1"));
    assert!(!spring.shape_differs && found.gap.with_effect < 1.2 * found.gap.noise_floor, "{}", found.sentence);
}

/// The same spring differs between its two directions, and no explanation contains a further small part of the force. A
/// stop on one side imitates both parts of the spring better than each of them alone, but not better than both
/// together.
#[test]
fn two_parts_of_a_strong_spring_are_found_behind_what_imitates_them() {
    fn stiff(d: f64, v: f64) -> f64 {
        -2e5 * d.powi(3) - 4e3 * d.powi(2) - 0.01 * (40.0 * v).sin()
    }
    // Shorter records also show this.
    let short = |record| vec![drawn(record)[0][..SAMPLES / 2].to_vec()];
    let case = Axis { mass: 1.0, c: 0.6, k: 400.0, force: stiff, position: true }.case_of(short, |_| {});
    let rivals = ["cubic-stiffness", "quadratic-stiffness", "one-sided-stop", "end-stop", "coulomb-friction"];
    let found = diagnosed_among(case, &rivals);
    assert!(found.gap.as_given > 0.4, "{}", found.sentence);
    assert_eq!(found.effects[0].effect, "cubic-stiffness", "{}", found.sentence);
    assert!(found.gap.with_effect < 0.1 * found.gap.as_given, "{}", found.sentence);
}

/// Coefficients of gravity on two pendulums of 1.5 Hz, for a torque of unit RMS. The light pendulum swings far.
const LIGHT: f64 = 0.35;
const HEAVY: f64 = 1.2;

fn pendulum(k: f64, force: fn(f64, f64) -> f64) -> Axis {
    let w = TAU * 1.5;
    Axis { mass: k / (w * w), c: 1.4 * k / w, k, force, position: true }
}

/// The sine of gravity is distinguished from a cubic spring if a pendulum swings far. Otherwise, the two are
/// equivalent.
#[test]
fn the_sine_of_gravity_is_told_from_a_cube_on_large_angles() {
    fn light(d: f64, _v: f64) -> f64 {
        LIGHT * (d - d.sin())
    }
    fn heavy(d: f64, _v: f64) -> f64 {
        HEAVY * (d - d.sin())
    }
    let springs = ["gravity-sine", "cubic-stiffness", "quadratic-stiffness", "clearance", "added-stiffness"];
    let rivals = [&springs[..], &["coulomb-friction", "actuator-saturation", "sensor-saturation"]].concat();
    let found = |k: f64, force: fn(f64, f64) -> f64| diagnosed_among(pendulum(k, force).case(), &rivals);
    let light = found(LIGHT, light);
    let [gravity] = light.effects.as_slice() else { panic!("{}", light.sentence) };
    assert_eq!(
        (gravity.effect.as_str(), gravity.location.as_str()),
        ("gravity-sine", "input:u1"),
        "{}",
        light.sentence
    );
    let k = gravity.parameters["k"].value;
    assert!((k / LIGHT - 1.0).abs() < 0.01, "{k}: {}", light.sentence);
    assert!(light.not_separable.is_empty() && !gravity.shape_differs, "{}", light.sentence);
    let found = found(HEAVY, heavy);
    assert_eq!(found.verdict, Verdict::Effects, "{}", found.sentence);
    for name in ["gravity-sine@input:u1", "cubic-stiffness@input:u1"] {
        assert!(found.not_separable.iter().flatten().any(|one| one == name), "{name}: {:?}", found.not_separable);
    }
}

/// The parameters of an axis, and the effects that resemble errors of these parameters.
const NUMBERS: [&str; 9] = [
    "added-mass",
    "added-damping",
    "added-stiffness",
    "modal-frequency",
    "modal-damping",
    "actuator-gain",
    "actuator-lag",
    "sensor-lag",
    "coulomb-friction",
];

/// One parameter of the simulation is wrong: the mass, the damper or the spring of a motor, a slider or a servo, whose
/// position or velocity is measured. This parameter is named with its value, although a refit distributes the error
/// over poles and gains.
#[test]
fn one_number_of_an_axis_is_named() {
    let w = TAU * 1.5;
    let motor = Axis { mass: 1.0, c: 4.0, k: 0.0, force: none, position: false };
    let slider = Axis { position: true, ..motor };
    let servo = Axis { c: 1.4 * w, k: w * w, ..slider };
    for simulated in [motor, slider, servo, Axis { position: false, ..servo }] {
        let Axis { mass, c, k, position, .. } = simulated;
        // If the position is measured, the mass and the damper in the simulation are too small; if the velocity is
        // measured, they are too large.
        let (heavier, damped) = if position { (1.2, 1.5) } else { (0.8, 0.5) };
        for (effect, real) in [
            ("added-mass", Axis { mass: heavier * mass, ..simulated }),
            ("added-damping", Axis { c: damped * c, ..simulated }),
            ("added-stiffness", Axis { k: 1.3 * k, ..simulated }),
        ] {
            if effect == "added-stiffness" && k == 0.0 {
                continue;
            }
            let found = diagnosed_among(real.case_for(&simulated), &NUMBERS);
            let what = format!("{effect}, c {c}, k {k}, position {position}: {}", found.sentence);
            assert_eq!(found.verdict, Verdict::Effects, "{what}");
            let first = &found.effects[0];
            assert_eq!((first.effect.as_str(), first.location.as_str()), (effect, "input:u1"), "{what}");
            let change = first.change.as_ref().expect("a number of the simulation");
            let (from, to) = match effect {
                "added-mass" => (mass, real.mass),
                "added-damping" => (c, real.c),
                _ => (k, real.k),
            };
            assert!((change.from / from - 1.0).abs() < 1e-4, "{what}: from {}", change.from);
            assert!((change.to.value / to - 1.0).abs() < 0.01, "{what}: to {}", change.to.value);
        }
    }
}

/// A damper that is slightly beyond its limits is named if the simulation has few parameters. Among many, one would
/// exceed its limits by chance. A damper within its limits is not named.
#[test]
fn a_number_beyond_its_limits_is_named_among_few() {
    let w = TAU * 1.5;
    let simulated = Axis { mass: 1.0, c: 1.4 * w, k: w * w, force: none, position: true };
    let found = |share: f64, released_of: f64| {
        let mut case = Axis { c: share * simulated.c, ..simulated }.case_for(&simulated);
        case.config.settings.search.released_of = released_of;
        diagnosed(&case)
    };
    let few = found(1.2, 80.0);
    let named: Vec<&str> = few.effects.iter().map(|effect| effect.effect.as_str()).collect();
    assert_eq!(named, ["added-damping"], "{}", few.sentence);
    let many = found(1.2, 1.0);
    assert!(many.effects.is_empty(), "{}", many.sentence);
    let within = found(1.1, 80.0);
    assert_eq!(within.verdict, Verdict::None, "{}", within.sentence);
}

/// An actuator that is weaker than in the simulation is diagnosed as such, or as a sensor with another gain, which is
/// equivalent.
#[test]
fn a_weak_actuator_is_no_mass() {
    let simulated = Axis { mass: 1.0, c: 4.0, k: 0.0, force: none, position: true };
    let mut case = simulated.case();
    for y in case.records.iter_mut().flat_map(|record| &mut record.y).flatten() {
        *y *= 0.8;
    }
    let found = diagnosed(&case);
    assert!(found.effects[0].effect.ends_with("-gain"), "{}", found.sentence);
    assert_eq!(found.effects.len(), 1, "{}", found.sentence);
}

/// A reference effect may diverge on held-out records, as a wrong spring does on a slider that is free to move. The
/// effect is then omitted, because a file holds only finite numbers. With the smaller dead zone, it does not diverge.
#[test]
fn a_reference_effect_that_runs_away_is_left_out() {
    let slider = Axis { mass: 1.0, c: 4.0, k: 0.0, force: none, position: true };
    for (width, compared) in [(0.2, 3), (0.4, 2)] {
        let run = |u: &Channels| {
            let sent = u[0].iter().map(|u: &f64| u - u.clamp(-width, width)).collect();
            integrate(&slider.truth(), &[sent], None).0
        };
        let case = case_of_axis(&slider.simulation(), |k| drawn(k + 10), run);
        let found = diagnosed_among(case, &["actuator-dead-zone", "quadratic-stiffness", "cubic-stiffness"]);
        first_is(&found, "actuator-dead-zone", "input:u1");
        assert_eq!(found.gap.shrink_over.len(), compared, "{width}: {:?}", found.gap.shrink_over);
        assert!(found.gap.shrink_over.iter().all(|over| over.gap.is_finite()) && found.gap.placebo_shrink.is_finite());
    }
}

/// The payload is located at the port that the case declares on a lightly damped axis, where a strut would otherwise be
/// inferred.
#[test]
fn a_declared_port_has_a_payload() {
    let simulated = Axis { mass: 1.0, c: 0.8, k: 160.0, force: none, position: true };
    let mut case = Axis { mass: 1.2, ..simulated }.case_for(&simulated);
    case.config.port = vec![PortConfig { name: "table".into(), input: "u1".into(), output: "y1".into() }];
    let found = diagnosed(&case);
    let named: Vec<&str> = found.effects.iter().map(|effect| effect.effect.as_str()).collect();
    assert_eq!(named, ["added-mass"], "{}", found.sentence);
    let mass = found.effects[0].parameters["m"].value;
    assert!((mass / 0.2 - 1.0).abs() < 0.02, "{mass}");
}

/// Returns the force of a hard stop, on which the axis bounces at 20 Hz.
fn stop(d: f64, v: f64, at: f64) -> f64 {
    let (x, w) = (d - at, TAU * 20.0);
    if x > 0.0 { -(w * w * x + 0.4 * w * v).max(0.0) } else { 0.0 }
}

/// The free motion of the servo has an RMS of about 0.0035.
#[test]
fn hard_stops_of_a_servo_are_named() {
    fn both(d: f64, v: f64) -> f64 {
        stop(d, v, 0.0028) - stop(-d, -v, 0.0028)
    }
    fn above(d: f64, v: f64) -> f64 {
        stop(d, v, 0.0028)
    }
    let w = TAU * 1.5;
    for (effect, force, position) in [("end-stop", both as fn(f64, f64) -> f64, "g"), ("one-sided-stop", above, "s")] {
        let found = Axis { mass: 1.0, c: 1.4 * w, k: w * w, force, position: true }.diagnosed();
        assert_eq!(found.verdict, Verdict::Effects, "{effect}: {}", found.sentence);
        let first = first_is(&found, effect, "input:u1");
        let at = first.parameters[position].value;
        // A softer stop that is slightly nearer is almost as good an explanation.
        assert!((at / 0.0028 - 1.0).abs() < 0.1, "{effect}: {at}");
    }
}

/// Only the last record, which is held out, reaches the stops, and only late. Its beginning is fitted and reaches the
/// upper stop. The remainder shows that there is also a lower stop.
#[test]
fn stops_that_one_record_reaches_are_named() {
    fn both(d: f64, v: f64) -> f64 {
        stop(d, v, 0.0145) - stop(-d, -v, 0.0145)
    }
    fn pushed(record: usize) -> Channels {
        let mut u = drawn(record);
        if record == 3 {
            u[0].iter_mut().for_each(|u| *u *= 0.8);
            for (at, push) in [(900, 4.4), (1200, 4.4), (1700, -4.4), (2000, -4.4)] {
                u[0][at..at + 20].fill(push);
            }
        }
        u
    }
    let axis = Axis { mass: 1.0, c: 8.0, k: 160.0, force: both, position: true };
    let mut case = axis.case_of(pushed, |_| {});
    only(&mut case, &["end-stop", "one-sided-stop", "clearance", "cubic-stiffness", "sensor-saturation"]);
    let reach = |k: usize| case.records[k].y[0].iter().map(|y| y.abs()).fold(0.0, f64::max);
    assert!(reach(1).max(reach(2)) < 0.014 && reach(3) > 0.0147, "{:?}", [1, 2, 3].map(reach));
    let found = diagnosed(&case);
    assert_eq!(found.verdict, Verdict::Effects, "{}", found.sentence);
    let first = first_is(&found, "end-stop", "input:u1");
    assert!((first.parameters["g"].value / 0.0145 - 1.0).abs() < 0.02, "{}", found.sentence);
    let [of] = found.gap.measured_on.as_slice() else { panic!("{:?}", found.gap.measured_on) };
    assert!(of.starts_with("the last ") && of.ends_with(" of random-3"), "{of}");
}

/// Returns the case with an output that is declared to measure a velocity.
fn seen_by_its_speed(mut case: Case) -> Case {
    case.model.as_mut().unwrap().output_kinds = vec![Some(plid_model::OutputKind::Velocity)];
    case
}

/// Returns an input that drives a motor back and forth between two places, with a random part that does not let it
/// wander.
fn back_and_forth(record: usize) -> Channels {
    let mut u = drawn(record);
    let before: Vec<f64> = u[0].clone();
    for (n, u) in u[0].iter_mut().enumerate() {
        *u -= if n < HOLD { 0.0 } else { before[n - HOLD] };
        let (push, since) = (n.saturating_sub(200) / 250, n.saturating_sub(200) % 250);
        if n >= 200 && since < if push == 0 { 50 } else { 100 } {
            *u += if push % 2 == 0 { 2.0 } else { -2.0 };
        }
    }
    u
}

/// Returns the force of soft stops on both sides, on which a unit mass bounces at 5 Hz.
fn buffers(d: f64, v: f64) -> f64 {
    let (x, w) = (d.abs() - 0.08, TAU * 5.0);
    if x > 0.0 { -d.signum() * (w * w * x + 0.4 * w * d.signum() * v).max(0.0) } else { 0.0 }
}

/// A law of the integrated displacement moves the speed as it does where the displacement is a state.
#[test]
fn stops_act_on_the_integral_of_a_speed() {
    use crate::effects::{EndStop, Place, Setting};
    let motor = Axis { mass: 1.0, c: 4.0, k: 0.0, force: buffers, position: false };
    let case = seen_by_its_speed(motor.case());
    let model = case.model.as_ref().unwrap();
    let plant = crate::plant::Plant::new(model).unwrap();
    let w = TAU * 5.0;
    let actions = EndStop.act(&Setting::bare(&plant, model), &Place::Input(0), &[w * w, 0.4 * w, 0.08]);
    for record in [0, 1].map(back_and_forth) {
        let run = |actions: &[Action]| simulate(&plant, actions, &record, 0.0, None, Fineness::FINE).swap_remove(0);
        let right = integrate(&motor.truth(), &record, Some(&motor.force)).0.swap_remove(0);
        let far = |y: Vec<f64>| rms(y.iter().zip(&right).map(|(a, b)| a - b)) / rms(&right);
        let [with, without] = [far(run(&actions)), far(run(&[]))];
        assert!(with < 0.01 * without && without > 0.1, "{with} {without}");
    }
}

/// The spring of a motor is found although only its speed is measured, and the evidence says where its displacement
/// comes from.
#[test]
fn what_holds_a_motor_is_found_in_its_speed() {
    let motor = Axis { mass: 1.0, c: 4.0, k: 0.0, force: none, position: false };
    let mut case = Axis { k: 4.0, ..motor }.case_of(back_and_forth, |_| {});
    let noise = case.model.as_ref().unwrap().noise.clone();
    case.model = Some(Model { noise, ..motor.simulation() });
    only(&mut case, &["added-stiffness", "cubic-stiffness", "coulomb-friction", "added-damping"]);
    let plant = crate::plant::Plant::new(case.model.as_ref().unwrap()).unwrap();
    assert!(!plant.ports[0].sees_displacement());
    let found = diagnosed(&seen_by_its_speed(case));
    assert_eq!(found.verdict, Verdict::Effects, "{}", found.sentence);
    let k = first_is(&found, "added-stiffness", "input:u1").parameters["k"].value;
    assert!((k / 4.0 - 1.0).abs() < 0.1, "{k}");
    assert!(found.evidence.iter().any(|words| words.contains("at u1 is the integral of the velocity")));
}

/// A sound motor has no spring, although one could act on its integrated speed.
#[test]
fn nothing_is_missing_from_a_sound_motor_seen_by_its_speed() {
    let motor = Axis { mass: 1.0, c: 4.0, k: 0.0, force: none, position: false };
    let found = diagnosed(&seen_by_its_speed(motor.case()));
    assert_eq!(found.verdict, Verdict::None, "{}", found.sentence);
}

/// If an effect has no location, the evidence states what must be declared: a displacement, or any motion at all. A
/// declared accelerometer is sufficient for friction.
#[test]
fn what_has_no_place_is_said() {
    let motor = Axis { mass: 1.0, c: 4.0, k: 0.0, force: friction, position: false };
    let says = |found: &Diagnosis, what: &str| found.evidence.iter().any(|words| words.contains(what));
    let mut case = motor.case();
    let found = diagnosed(&case);
    assert!(says(&found, "were not considered at u1, where only the velocity is known"), "{:?}", found.evidence);
    assert!(says(&found, "Declare that the output measures a velocity (`output_kinds`)"), "{:?}", found.evidence);
    // The acceleration takes the place of the velocity.
    for record in &mut case.records {
        record.y[0].iter_mut().zip(&record.u[0]).for_each(|(y, u)| *y = u - 4.0 * *y);
    }
    let model = case.model.as_mut().unwrap();
    (model.c, model.d) = (dmatrix![-4.0], dmatrix![1.0]);
    let found = diagnosed(&case);
    assert!(says(&found, "no output shows the motion") && says(&found, "[[port]]"), "{:?}", found.evidence);
    let model = case.model.as_mut().unwrap();
    model.output_kinds = vec![Some(plid_model::OutputKind::Acceleration)];
    let plant = crate::plant::Plant::new(model).unwrap();
    assert_eq!((plant.ports.len(), plant.ports[0].output.as_slice()), (1, &[1.0][..]));
    assert!((plant.mobility(0) - 1.0).abs() < 1e-6, "{}", plant.mobility(0));
}

/// Returns the velocity of a unit mass on a damper of 4 with friction that holds up to 0.3 and slides at 0.2. The
/// velocity is integrated in small steps. A step in which it would change its sign ends at rest.
fn sticking(u: &[f64]) -> Vec<f64> {
    const STEPS: usize = 100;
    let (h, mut v) = (1.0 / (RATE * STEPS as f64), 0.0_f64);
    let mut seen = Vec::new();
    for u in u {
        seen.push(v);
        for _ in 0..STEPS {
            let other = u - 4.0 * v;
            if v == 0.0 && other.abs() <= 0.3 {
                continue;
            }
            let sign = if v == 0.0 { other.signum() } else { v.signum() };
            let next = v + h * (other - sign * (0.2 + 0.1 * (-(v / 0.02).powi(2)).exp()));
            v = if v * next < 0.0 { 0.0 } else { next };
        }
    }
    seen
}

#[test]
fn friction_that_sticks_is_told_from_a_smooth_curve() {
    let motor = Axis { mass: 1.0, c: 4.0, k: 0.0, force: none, position: false };
    let mut case = motor.case();
    let std = case.model.as_ref().unwrap().noise.sensor_std.clone().unwrap();
    for (k, record) in case.records.iter_mut().enumerate() {
        record.y = vec![sticking(&record.u[0])];
        add_noise(&mut record.y, k as u64 + 50, &std);
    }
    let found = diagnosed(&case);
    let [friction] = found.effects.as_slice() else { panic!("{}", found.sentence) };
    assert_eq!((friction.effect.as_str(), friction.location.as_str()), ("stick-friction", "input:u1"));
    for (name, size) in [("Fc", 0.2), ("Fs", 0.3)] {
        let value = friction.parameters[name].value;
        assert!((value / size - 1.0).abs() < 0.05, "{name} {value}: {}", found.sentence);
    }
}

/// Without a simulation, the linear model of the records is identified again with the force of the spring that was
/// found, and the gap with the effect is then no larger than the noise.
#[test]
fn a_model_of_the_records_is_identified_with_the_law() {
    let axis = Axis { mass: 1.0, c: 3.0, k: 4000.0, force: |d, _| -4.0e7 * d.powi(3), position: true };
    let mut case = axis.case();
    (case.model, case.config.sim, case.config.states) = (None, None, Some(2));
    only(&mut case, &["cubic-stiffness", "clearance", "coulomb-friction"]);
    let mut repeated = 0;
    let mut say = |step: String| repeated += usize::from(step.starts_with("repeated with a model"));
    let found = crate::diagnose(&case, &Library::standard(), &mut say).unwrap().diagnosis;
    assert_eq!(repeated, 1);
    first_is(&found, "cubic-stiffness", "input:u1");
    let words = "It was identified with the force of cubic-stiffness at input:u1 as a further input.";
    assert!(found.warnings[0].contains(words), "{:?}", found.warnings);
    let gap = &found.gap;
    assert!(gap.with_effect < 1.05 * gap.noise_floor, "{gap:?}");
    // The gap without effects is that of the best linear model, which a refit does not change.
    assert_eq!([gap.refit, gap.free_refit, gap.within_limits], [gap.as_given; 3]);
    assert!((0.1..0.13).contains(&gap.as_given), "{gap:?}");
}
