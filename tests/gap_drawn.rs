//! The diagnosis on cases that the testbed draws: its effects are integrated by other code than what the diagnosis
//! fits.
//!
//! One case of each family, each with the next seed in the order of this file. They are short, of few modes and
//! channels: trials say how often the diagnosis is right, these only that it still is.

use std::time::Instant;

use plid::gap::answer::schema::{Diagnosis, Verdict};
use plid::gap::case::Case;
use plid::gap::effects::Library;
use plid::gap::{Groundwork, Outcome};
use plid::testbed::gap::{Channels, EffectSpec, GapCase, GapSpec, PlantKind, Simulator, draw};

/// A beam with two channels each way and records of a fifth of the usual length.
fn spec(kinds: &[&str]) -> GapSpec {
    let effect = |kind: &&str| EffectSpec { kind: (*kind).to_owned(), at: None, law: None, gap: 0.1 };
    GapSpec {
        effects: kinds.iter().map(effect).collect(),
        perturbed: true,
        ports: true,
        plant: PlantKind::Beam,
        channels: Channels { inputs: 2, outputs: 2 },
        length: 0.2,
        ..GapSpec::default()
    }
}

fn diagnosed(seed: u64, spec: &GapSpec) -> (GapCase, Diagnosis) {
    let drawn = draw(seed, spec).unwrap();
    let folder = tempfile::tempdir().unwrap();
    drawn.write(&folder.path().join("case"), &folder.path().join("label")).unwrap();
    let case = Case::read(&folder.path().join("case/case.toml")).unwrap();
    let diagnosis = plid::gap::diagnose(&case, &Library::standard(), &mut |_| {}).unwrap().diagnosis;
    println!("{:?}: {}", drawn.label.effects[0], diagnosis.sentence);
    (drawn, diagnosis)
}

/// The effect and nothing else is named, at its location, and most of the gap is closed.
fn is_named(seed: u64, spec: &GapSpec) {
    let (drawn, found) = diagnosed(seed, spec);
    let truth = &drawn.label.effects[0];
    let named: Vec<&str> = found.effects.iter().map(|e| e.effect.as_str()).collect();
    assert_eq!((found.verdict, named), (Verdict::Effects, vec![truth.effect.as_str()]), "{}", found.sentence);
    assert!(truth.is_at(&found.effects[0].location), "{}: {truth:?}", found.sentence);
    assert!(found.gap.shrink > 0.5, "{:?}", found.gap);
}

#[test]
fn structure_nonlinear() {
    is_named(1, &spec(&["cubic-stiffness"]));
}

#[test]
fn structure_linear() {
    is_named(2, &spec(&["modal-frequency"]));
}

#[test]
fn actuator_nonlinear() {
    is_named(3, &spec(&["actuator-dead-zone"]));
}

#[test]
fn actuator_linear() {
    is_named(4, &spec(&["actuator-crosstalk"]));
}

#[test]
fn sensor_nonlinear() {
    is_named(5, &spec(&["sensor-saturation"]));
}

#[test]
fn sensor_linear() {
    is_named(6, &spec(&["sensor-lag"]));
}

#[test]
fn sensor_additive() {
    is_named(7, &spec(&["mains-hum"]));
}

#[test]
fn time() {
    is_named(8, &spec(&["stiffness-drift"]));
}

#[test]
fn disturbance() {
    is_named(9, &spec(&["narrowband-disturbance"]));
}

#[test]
fn nothing_is_named_where_nothing_is() {
    let (_, found) = diagnosed(10, &spec(&[]));
    assert_eq!(found.verdict, Verdict::None, "{}", found.sentence);
    assert!(found.effects.is_empty());
}

#[test]
fn what_the_vocabulary_lacks_is_kept_open() {
    // The second is, to the letter, a hysteresis of alpha = 1: it is fitted well, and doubted.
    for kind in ["x-sensor-square", "x-command-play"] {
        let (_, found) = diagnosed(11, &spec(&[kind]));
        let open: f64 = found.candidates.iter().filter(|c| c.unknown).map(|c| c.probability).sum();
        assert!(found.verdict == Verdict::Unknown || open >= 0.2, "{open}: {}", found.sentence);
    }
}

#[test]
fn a_simulator_that_gives_only_its_outputs() {
    is_named(12, &GapSpec { simulator: Simulator::Outputs, ports: false, ..spec(&["actuator-saturation"]) });
}

/// A vocabulary that is quickly searched.
fn few_effects() -> Library {
    let few = [
        "actuator-dead-zone",
        "actuator-saturation",
        "actuator-hysteresis",
        "actuator-gain",
        "actuator-lag",
        "sensor-offset",
        "sensor-lag",
        "cubic-stiffness",
        "modal-frequency",
    ];
    Library::standard().only(&few)
}

/// An effect that is at work, and another that was fitted as well: removing either from a finished diagnosis gives the
/// bytes of a diagnosis that never knew it.
#[test]
fn what_is_left_out_is_as_if_it_had_never_been_known() {
    let spec = GapSpec { channels: Channels { inputs: 1, outputs: 1 }, length: 0.1, ..spec(&["actuator-dead-zone"]) };
    let drawn = draw(3, &spec).unwrap();
    let folder = tempfile::tempdir().unwrap();
    drawn.write(&folder.path().join("case"), &folder.path().join("label")).unwrap();
    let case = Case::read(&folder.path().join("case/case.toml")).unwrap();
    let bytes = |outcome: &Outcome| {
        let seen = (&outcome.shown.stages, &outcome.shown.stochastic);
        serde_json::to_string(&(&outcome.diagnosis, &outcome.simulation, seen)).unwrap()
    };
    let library = few_effects();
    let (whole, ground) = Groundwork::whole(&case, &library, &[], &mut |_| {}).unwrap();
    // An entry of the first stage that is not at work: without it others move up.
    let mut first = whole.shown.stages[0].iter().map(|(name, ..)| name.as_str());
    let other = first.find(|name| *name != "actuator-dead-zone").unwrap();
    for name in ["actuator-dead-zone", other] {
        let without = [name.to_owned()];
        let clock = Instant::now();
        let left_out = ground.leave_out(&without, &mut |_| {}).unwrap();
        let again = clock.elapsed().as_secs_f64();
        let never = plid::gap::diagnose(&case, &few_effects().without(&without), &mut |_| {}).unwrap();
        println!("{name}: {again:.2} s left out, {:.2} s from scratch", clock.elapsed().as_secs_f64() - again);
        assert_eq!(bytes(&left_out), bytes(&never), "{name}");
        assert!(left_out.diagnosis.effects.iter().all(|effect| effect.effect != name));
    }
}

/// The eigenvalue iteration converges for every kind of structure, up to 29 states with close modes. With another
/// library's iteration it did not at the accuracy of the arithmetic.
#[test]
fn the_modes_of_every_drawn_structure_are_found() {
    let plants = [PlantKind::Truss, PlantKind::Beam, PlantKind::Chain, PlantKind::Drone, PlantKind::CloseModes];
    let mut largest = 0;
    for (seed, plant) in (60..).zip(plants.iter().cycle().take(20)) {
        let spec = GapSpec { plant: *plant, ports: true, perturbed: true, length: 0.1, ..GapSpec::default() };
        let folder = tempfile::tempdir().unwrap();
        draw(seed, &spec).unwrap().write(&folder.path().join("case"), &folder.path().join("label")).unwrap();
        let model = plid::model::Model::read(&folder.path().join("case/sim.json")).unwrap();
        let modes = plid::model::modes(&model).unwrap();
        // A mode is one real pole or two complex ones, and the sum of all poles is the trace.
        let poles = |mode: &plid::model::Mode| if mode.pole.im == 0.0 { 1 } else { 2 };
        let sum: f64 = modes.iter().map(|mode| poles(mode) as f64 * mode.pole.re).sum();
        let trace = model.a.trace();
        assert_eq!(modes.iter().map(poles).sum::<usize>(), model.n(), "{plant:?}, seed {seed}");
        assert!((sum - trace).abs() < 1e-8 * model.n() as f64, "{plant:?}, seed {seed}: {sum} for {trace}");
        largest = largest.max(model.n());
    }
    assert!(largest >= 29, "{largest}");
}
