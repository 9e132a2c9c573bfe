//! Small blind cases from records to answer. The true system is integrated here by a Runge-Kutta method in the states
//! of the simulation, not by the code that the diagnosis fits.

use nalgebra::{DMatrix, DVector};
use plid_model::Model;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

use crate::answer::schema::Diagnosis;
use crate::case::Case;
use crate::case::record::{Channels, rms};
use crate::judge::verdict::Verdict;
use crate::testing::{self, diagnosed, diagnosed_among};

/// Number of Runge-Kutta steps per sample.
const STEPS: usize = 24;

/// A change of commands or outputs.
type Change = dyn Fn(&mut Channels);

/// The parts of the real system that the simulation lacks.
#[derive(Default)]
struct Truth {
    /// Force at the first port as a function of displacement and velocity.
    force: Option<Box<dyn Fn(f64, f64) -> f64>>,
    /// Change of the commands.
    command: Option<Box<Change>>,
    /// Change of the outputs, before noise.
    sensor: Option<Box<Change>>,
}

/// Integrates a model in continuous time by the classical Runge-Kutta method of fourth order. A force at its first port
/// depends on displacement and velocity. Returns the outputs (p channels) and the RMS of the port's displacement.
pub(super) fn integrate(model: &Model, u: &[Vec<f64>], force: Option<&dyn Fn(f64, f64) -> f64>) -> (Channels, f64) {
    let continuous = model.continuous.as_ref().unwrap();
    let port = &model.ports[0];
    let column = DVector::from_column_slice(&port.force);
    let (d, v) = (DVector::from_column_slice(&port.displacement), DVector::from_column_slice(&port.velocity));
    let h = 1.0 / (model.sample_rate_hz * STEPS as f64);
    let mut x = model.rest();
    let mut y = vec![Vec::new(); model.p()];
    let mut displacements = Vec::new();
    for k in 0..u[0].len() {
        let out = &model.c * &x;
        y.iter_mut().zip(out.iter()).for_each(|(y, o)| y.push(*o));
        displacements.push(d.dot(&x));
        let held = &continuous.b * DVector::from_iterator(u.len(), u.iter().map(|u| u[k]));
        let rate = |x: &DVector<f64>| {
            let mut rate = &continuous.a * x + &held;
            if let Some(force) = force {
                rate += &column * force(d.dot(x), v.dot(x));
            }
            rate
        };
        for _ in 0..STEPS {
            let k1 = rate(&x);
            let k2 = rate(&(&x + &k1 * (h / 2.0)));
            let k3 = rate(&(&x + &k2 * (h / 2.0)));
            let k4 = rate(&(&x + &k3 * h));
            x += (k1 + k2 * 2.0 + k3 * 2.0 + k4) * (h / 6.0);
        }
    }
    (y, rms(&displacements))
}

fn case(seed: u64, noise: f64, truth: &Truth) -> Case {
    case_of(seed, noise, truth, 1600)
}

/// Returns a case whose driven records have this number of samples.
fn case_of(seed: u64, noise: f64, truth: &Truth, samples: usize) -> Case {
    let model = testing::truss(seed);
    let mut rng = ChaCha8Rng::seed_from_u64(seed + 77);
    let input = |k: usize| {
        let samples = if k > 0 { samples } else { samples * 5 / 8 };
        testing::random_input(seed + 10 + k as u64, samples, model.m())
    };
    let measure = |_: usize, u: &Channels| {
        let mut sent = u.clone();
        truth.command.iter().for_each(|command| command(&mut sent));
        let (mut y, _) = integrate(&model, &sent, truth.force.as_deref());
        truth.sensor.iter().for_each(|sensor| sensor(&mut y));
        y.iter_mut().flatten().for_each(|y| *y += noise * rng.sample::<f64, _>(StandardNormal));
        y
    };
    testing::four_records(&model, &vec![noise; model.p()], [1.0, 0.4, 1.0], input, measure)
}

/// Returns a standard deviation of the noise of about one per cent of the outputs.
fn quiet(seed: u64) -> f64 {
    let model = testing::truss(seed);
    let (y, _) = integrate(&model, &testing::random_input(seed, 400, 2), None);
    0.01 * rms(y.iter().flatten())
}

fn cubic(seed: u64, strength: f64) -> (Truth, f64) {
    let (_, d) = integrate(&testing::truss(seed), &testing::random_input(seed, 1200, 2), None);
    let k = strength / d.powi(3);
    (Truth { force: Some(Box::new(move |d, _| -k * d * d * d)), ..Truth::default() }, k)
}

#[test]
fn nothing_is_found_where_nothing_is() {
    let found = diagnosed(&case(1, quiet(1), &Truth::default()));
    assert_eq!(found.verdict, Verdict::None, "{}", found.sentence);
    assert!(found.effects.is_empty());
}

#[test]
fn a_cubic_spring_is_named_with_place_and_size() {
    let (truth, k) = cubic(2, 0.06);
    let found = diagnosed(&case(2, quiet(2), &truth));
    assert_eq!(found.verdict, Verdict::Effects, "{}", found.sentence);
    assert_eq!((found.effects[0].effect.as_str(), found.effects[0].location.as_str()), ("cubic-stiffness", "input:u1"));
    let value = &found.effects[0].parameters["k"];
    assert!((value.value / k - 1.0).abs() < 0.05, "{} for {k}", value.value);
    assert!(found.gap.shrink > 0.9, "{:?}", found.gap);
    let class = found.not_separable.iter().flatten();
    assert!(class.clone().all(|text| !text.contains("clearance")), "{:?}", found.not_separable);
}

/// Linear causes that resemble each other if the records show few modes.
const LINEAR: [&str; 7] =
    ["modal-damping", "modal-frequency", "missing-mode", "actuator-lag", "sensor-lag", "sensor-delay", "sensor-gain"];

/// A damping ratio with an error of 20 %, where 5 % is stated, is named, whatever the sensors measure.
#[test]
fn a_damping_ratio_is_named_whatever_the_sensors_are() {
    use crate::testing::Sensor;
    // Each kind of sensor shows a different mode best.
    for (sensor, mode) in [(Sensor::Position, 0), (Sensor::Velocity, 1), (Sensor::Acceleration, 2)] {
        let of = |damping: f64| testing::truss_sensed(3, sensor, |modes| modes[mode].1 *= damping);
        let mut case = testing::case(&of(1.0), &of(1.2));
        case.config.nuisance.damping = 0.05;
        let found = diagnosed_among(case, &LINEAR);
        assert_eq!(found.verdict, Verdict::Effects, "{sensor:?}: {}", found.sentence);
        let named: Vec<&str> = found.effects.iter().map(|effect| effect.effect.as_str()).collect();
        assert_eq!(named, ["modal-damping"], "{sensor:?}: {}", found.sentence);
        let rho = found.effects[0].parameters["rho"].value;
        assert!((rho / 1.2 - 1.0).abs() < 0.01, "{sensor:?}: {rho}");
    }
}

/// No derivative at the frequency of the simulation leads to the true frequency. A mode that appears at the new
/// frequency and is missing at the old one does.
#[test]
fn a_mode_that_is_far_off_is_one_change_and_not_two_missing_modes() {
    let real = testing::truss_with(2, |modes, _, _| modes[1].0 *= 0.85);
    let found = diagnosed(&testing::case(&testing::truss(2), &real));
    assert_eq!(found.effects.len(), 1, "{}", found.sentence);
    assert_eq!(found.effects[0].effect, "modal-frequency");
    let delta = found.effects[0].parameters["delta"].value;
    assert!((delta + 0.15).abs() < 1e-3, "{delta}");
    // The named effect is that of the first explanation. It may act together with something else.
    assert_eq!(found.candidates[0].effects[0].location, found.effects[0].location);
    assert!(found.effects[0].confidence >= found.candidates[0].probability, "{:?}", found.candidates);
}

/// A gap of a tenth of the noise shows that a spring stiffens, but not by which law. The spring is named only if so
/// small a gap matters.
#[test]
fn a_spring_that_hardly_stiffens_may_be_a_clearance() {
    let (truth, _) = cubic(2, 0.001);
    let mut case = case(2, quiet(2), &truth);
    let found = diagnosed(&case);
    assert_eq!((found.verdict, found.effects.len()), (Verdict::None, 0), "{}", found.sentence);
    assert!(found.sentence.starts_with("Nothing material is missing"), "{}", found.sentence);
    assert!(found.sentence.contains("With cubic-stiffness at input:u1 it would be"), "{}", found.sentence);
    case.config.material = 0.0;
    let found = diagnosed(&case);
    assert_eq!(found.not_separable, [["cubic-stiffness@input:u1", "clearance@input:u1"]]);
    let other = "clearance at input:u1";
    assert!(
        found.sentence.contains(&format!("cannot distinguish cubic-stiffness at input:u1 from {other}")),
        "{}",
        found.sentence
    );
    let next = found.next_experiment.expect("something is open");
    assert!(next.contains(&format!("from {other}")), "{next}");
    // The first row is the best explanation; the others compare with it.
    assert_eq!(found.separability[0].explanation, "cubic-stiffness@input:u1");
    let compared =
        found.separability.iter().find(|row| row.explanation == "clearance@input:u1").expect("it was fitted");
    assert!(compared.cosine.is_some_and(|cosine| cosine > 0.8) && compared.expected.is_some(), "{compared:?}");
}

#[test]
fn a_dead_zone_and_a_clipping_sensor_are_found_together() {
    let truth = Truth {
        command: Some(Box::new(|u| u[1].iter_mut().for_each(|u| *u = u.signum() * (u.abs() - 0.2).max(0.0)))),
        sensor: Some(Box::new(|y| y[0].iter_mut().for_each(|y| *y = y.clamp(-CLIP, CLIP)))),
        ..Truth::default()
    };
    let found = diagnosed(&case(3, quiet(3), &truth));
    let mut named: Vec<String> = found.effects.iter().map(|e| format!("{}@{}", e.effect, e.location)).collect();
    named.sort();
    assert_eq!(named, ["actuator-dead-zone@input:u2", "sensor-saturation@output:y1"], "{}", found.sentence);
}

/// A voltage that the outputs for seed 3 sometimes exceed.
const CLIP: f64 = 0.25;

/// The gain of a sensor depends on the square of its signal, which the vocabulary lacks.
#[test]
fn what_the_vocabulary_lacks_is_kept_open() {
    let truth =
        Truth { sensor: Some(Box::new(|y| y[1].iter_mut().for_each(|y| *y += 0.6 * *y * *y))), ..Truth::default() };
    let found = diagnosed(&case(4, quiet(4), &truth));
    let open = found.candidates.iter().filter(|c| c.unknown).map(|c| c.probability).sum::<f64>();
    assert!(found.verdict == Verdict::Unknown || open >= 0.2, "{}", found.sentence);
}

/// The cause of [`cubic`], a law that resembles it, and one effect of each of the other kinds.
const RIVALS: [&str; 5] =
    ["cubic-stiffness", "quadratic-stiffness", "actuator-gain", "sensor-delay", "modal-frequency"];

/// The units of the outputs, their order and the basis of the states are the engineer's choice and do not affect the
/// diagnosis.
#[test]
fn units_order_and_basis_change_nothing() {
    let (truth, _) = cubic(5, 0.06);
    let mut plain = case(5, quiet(5), &truth);
    testing::only(&mut plain, &RIVALS);
    let first = diagnosed(&plain);
    let mut other = plain.clone();
    let model = other.model.as_mut().unwrap();
    // The outputs are exchanged and are given in millivolts.
    for record in &mut other.records {
        record.y.swap(0, 1);
        record.y.iter_mut().flatten().for_each(|y| *y *= 1000.0);
    }
    model.c.swap_rows(0, 1);
    model.c *= 1000.0;
    model.outputs.swap(0, 1);
    other.config.outputs.swap(0, 1);
    model.noise.sensor_std.as_mut().unwrap().iter_mut().for_each(|s| *s *= 1000.0);
    // The states have another basis.
    let n = model.n();
    let basis = DMatrix::from_fn(n, n, |i, j| if i == j { 1.0 } else { 0.1 / (1.0 + i as f64 + 2.0 * j as f64) });
    let inverse = basis.clone().try_inverse().unwrap();
    model.a = &basis * &model.a * &inverse;
    model.b = &basis * &model.b;
    model.c = &model.c * &inverse;
    let continuous = model.continuous.as_mut().unwrap();
    continuous.a = &basis * &continuous.a * &inverse;
    continuous.b = &basis * &continuous.b;
    for port in &mut model.ports {
        let row = |values: &[f64]| (DMatrix::from_row_slice(1, n, values) * &inverse).as_slice().to_vec();
        port.force = (&basis * DVector::from_column_slice(&port.force)).as_slice().to_vec();
        port.displacement = row(&port.displacement);
        port.velocity = row(&port.velocity);
    }
    let second = diagnosed(&other);
    assert_eq!(first.verdict, second.verdict);
    let named = |d: &Diagnosis| d.effects.iter().map(|e| (e.effect.clone(), e.location.clone())).collect::<Vec<_>>();
    assert_eq!(named(&first), named(&second));
    let (a, b) = (&first.effects[0].parameters["k"], &second.effects[0].parameters["k"]);
    assert!((a.value / b.value - 1.0).abs() < 1e-3, "{} {}", a.value, b.value);
    let (a, b) = (first.gap.with_effect, second.gap.with_effect);
    assert!((a / b - 1.0).abs() < 0.01, "{a} {b}");
}

#[test]
fn more_noise_does_not_raise_confidence() {
    let (truth, _) = cubic(6, 0.06);
    let confidence = |noise: f64| {
        // With 1600 samples, the confidence rises from 0.85 to 0.94.
        let found = diagnosed_among(case_of(6, noise, &truth, 2400), &RIVALS);
        found.effects.iter().find(|e| e.effect == "cubic-stiffness").map_or(0.0, |e| e.confidence)
    };
    let (clear, noisy) = (confidence(quiet(6)), confidence(30.0 * quiet(6)));
    assert!(clear > 0.6 && noisy <= clear + 0.02, "{clear} {noisy}");
}
