//! The diagnosis on recorded cases of MuJoCo models: README.md beside this file says how they were made.
//!
//! `python/tests/test_drawn_cases.py` draws such cases anew where Python and MuJoCo are at hand.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use plid::gap::answer::schema::{Diagnosis, Verdict};
use plid::gap::case::Case;
use plid::gap::effects::Library;
use serde::Deserialize;

/// A cause: the names that are right, and the places. Of a simulation that is right, there is none of either.
#[derive(Deserialize)]
struct Label {
    effects: Vec<String>,
    places: Vec<String>,
}

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/mujoco")
}

/// The causes of these cases and rivals of each, on every side of the plant. The whole vocabulary takes several times
/// as long.
fn causes_and_rivals() -> Library {
    let few = [
        "actuator-dead-zone",
        "actuator-delay",
        "actuator-lag",
        "actuator-saturation",
        "added-damping",
        "added-mass",
        "added-stiffness",
        "coulomb-friction",
        "cubic-stiffness",
        "gravity-sine",
        "quadratic-damping",
        "sensor-delay",
        "sensor-gain",
        "sensor-lag",
    ];
    let library = Library::standard().only(&few);
    assert_eq!(library.effects().count(), few.len(), "a name of the list is not an effect");
    library
}

fn diagnosed(name: &str) -> (Label, Diagnosis) {
    let labels = std::fs::read_to_string(folder().join("labels.json")).unwrap();
    let mut labels: BTreeMap<String, Label> = serde_json::from_str(&labels).unwrap();
    let case = Case::read(&folder().join(name).join("case.toml")).unwrap();
    let diagnosis = plid::gap::diagnose(&case, &causes_and_rivals(), &mut |_| {}).unwrap().diagnosis;
    println!("{name}: {}", diagnosis.sentence);
    (labels.remove(name).unwrap(), diagnosis)
}

/// The main cause is right, it is at its place, and no other name is stated with confidence.
fn is_named(name: &str) {
    let (label, found) = diagnosed(name);
    assert_eq!(found.verdict, Verdict::Effects, "{}", found.sentence);
    let main = &found.effects[0];
    assert!(label.effects.contains(&main.effect), "{} for {:?}", found.sentence, label.effects);
    assert!(label.places.contains(&main.location), "{} for {:?}", found.sentence, label.places);
    let mut wrong = found.effects.iter().filter(|effect| !label.effects.contains(&effect.effect));
    assert!(wrong.all(|effect| effect.confidence < 0.9), "{}", found.sentence);
}

#[test]
fn dry_friction_of_a_slider() {
    is_named("slider-friction");
}

#[test]
fn a_lag_before_a_position_servo() {
    is_named("servo-lag");
}

#[test]
fn gravity_on_a_pendulum_that_swings_far() {
    is_named("pendulum-sine");
}

#[test]
fn a_payload_on_a_chain_of_masses() {
    is_named("chain-mass");
}

#[test]
fn a_motor_whose_simulation_is_right() {
    let (label, found) = diagnosed("motor-none");
    assert!(label.effects.is_empty());
    assert_eq!(found.verdict, Verdict::None, "{}", found.sentence);
    assert!(found.effects.is_empty());
}
