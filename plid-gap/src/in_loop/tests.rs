//! Diagnoses of a nonlinear arm. Their truths have the effect inside the equations of motion.

use super::*;
use crate::case::record::Channels;
use crate::testing::arm::{Arm, Extra, NOMINAL, Numbers, case, nothing};

fn same(u: &[f64]) -> Vec<f64> {
    u.to_vec()
}

fn as_it_is(_: &mut Channels) {}

fn diagnosed(case: &Case) -> LoopOutcome {
    let mut say = |text: String| {
        if std::env::var_os("SAY").is_some() {
            eprintln!("{text}");
        }
    };
    let outcome = diagnose(case, &mut Arm::new(), &Library::standard(), &mut say).unwrap();
    eprintln!("{}", outcome.diagnosis.text());
    outcome
}

/// What the first effect of a diagnosis is, with its place.
fn first(outcome: &LoopOutcome) -> (&str, &str) {
    outcome.diagnosis.effects.first().map_or(("", ""), |effect| (effect.effect.as_str(), effect.location.as_str()))
}

fn inside(extra: Extra) -> LoopOutcome {
    diagnosed(&case(&NOMINAL, extra, same, as_it_is))
}

#[test]
fn forces_inside_are_named_at_their_port() {
    let friction = inside(|x, _, _| [-0.1 * (x[2] / 0.1).tanh(), 0.0, 0.0]);
    assert_eq!(first(&friction), ("coulomb-friction", "input:torque"));
    let stiffening = inside(|x, _, _| [0.0, -6.0 * x[1].powi(3), 0.0]);
    assert_eq!(first(&stiffening), ("cubic-stiffness", "port:link"));
    let stop = inside(|x, _, _| {
        let beyond: f64 = x[1].abs() - 0.3;
        [
            0.0,
            if beyond > 0.0 { -(400.0 * beyond + 1.0 * x[3] * x[1].signum()).max(0.0) * x[1].signum() } else { 0.0 },
            0.0,
        ]
    });
    assert_eq!(first(&stop), ("end-stop", "port:link"));
}

#[test]
fn what_wraps_around_the_simulator_is_named() {
    let saturated =
        diagnosed(&case(&NOMINAL, nothing, |u| u.iter().map(|u| 1.2 * (u / 1.2).tanh()).collect(), as_it_is));
    assert_eq!(first(&saturated), ("actuator-saturation", "input:torque"));
    let late = diagnosed(&case(&NOMINAL, nothing, same, |y| {
        y[1].rotate_right(2);
        y[1][..2].fill(0.0);
    }));
    assert_eq!(first(&late), ("sensor-delay", "output:link"));
    let lag = diagnosed(&case(
        &NOMINAL,
        nothing,
        |u| {
            let mut slow = 0.0;
            let one = |u: &f64| {
                slow += (1.0 - (-std::f64::consts::TAU * 6.0 / 200.0_f64).exp()) * (u - slow);
                slow
            };
            u.iter().map(one).collect()
        },
        as_it_is,
    ));
    assert!(["actuator-lag", "actuator-delay"].contains(&first(&lag).0), "{}", lag.diagnosis.sentence);
}

#[test]
fn a_parameter_of_the_simulator_is_named_with_its_value() {
    let numbers = Numbers { damper: 1.4 * NOMINAL.damper, ..NOMINAL };
    let outcome = diagnosed(&case(&numbers, nothing, same, as_it_is));
    assert_eq!(first(&outcome), ("simulator-parameter", "parameter:motor damper"));
    let change = outcome.diagnosis.effects[0].change.as_ref().unwrap();
    let [low, high] = change.to.ci95.unwrap();
    assert!(low < numbers.damper && numbers.damper < high, "{change}");
}

#[test]
fn nothing_is_named_where_nothing_is_missing() {
    let outcome = diagnosed(&case(&NOMINAL, nothing, same, as_it_is));
    assert_eq!(outcome.diagnosis.verdict, Verdict::None, "{}", outcome.diagnosis.sentence);
}

#[test]
fn what_the_vocabulary_lacks_is_kept_open() {
    // A spring between motor and link that is lost in one direction of the motor's motion.
    let outcome = inside(|x, _, _| {
        let lost = if x[2] > 0.0 { 20.0 * (x[0] - x[1]) } else { 0.0 };
        [lost, -lost, 0.0]
    });
    assert_ne!(outcome.diagnosis.verdict, Verdict::None);
    assert!(outcome.diagnosis.effects.iter().all(|effect| effect.confidence < 0.9), "{}", outcome.diagnosis.sentence);
}
