//! Cases of bodies on axes: motors, servos, sliders, a pendulum, arms and closed loops.

use nalgebra::DMatrix;
use ndarray::Array2;
use plid_testbed::gap::{
    Channels, EffectSpec, Excitation, Experiment, GapCase, GapError, GapRecord, GapSpec, PlantKind, Simulator, draw,
};

use crate::gap_kinds::{matrix, simulated};
use crate::rms;

fn axes() -> impl Iterator<Item = PlantKind> {
    PlantKind::ALL.into_iter().filter(|plant| plant.has_axes())
}

/// Short records of a plant with all its channels.
fn short(plant: PlantKind) -> GapSpec {
    GapSpec { plant, channels: plant.channels(), ports: true, length: 0.15, ..GapSpec::default() }
}

fn with(kind: &str, gap: f64, spec: GapSpec) -> GapSpec {
    GapSpec { effects: vec![EffectSpec { kind: kind.to_owned(), at: None, law: None, gap }], ..spec }
}

fn simulation(case: &GapCase) -> serde_json::Value {
    serde_json::to_value(&case.simulation).unwrap()
}

/// Without an effect the written simulation gives every record, down to the noise that it declares.
#[test]
fn the_simulation_gives_every_record_down_to_the_declared_noise() {
    for plant in axes() {
        for seed in 300..306 {
            let case = draw(seed, &short(plant)).unwrap();
            let sim = simulation(&case);
            let declared: Vec<f64> = serde_json::from_value(sim["noise"]["sensor_std"].clone()).unwrap();
            assert_eq!(sim["noise"]["actuator_std"], serde_json::json!(vec![0.0; plant.channels().inputs]));
            for record in case.records.iter().chain([&case.held_out]) {
                let own = simulated(&case, &record.commands);
                let size = 1.0 + rms(own.iter().copied());
                let off = (&own - &record.simulated).iter().fold(0.0_f64, |most, e| most.max(e.abs()));
                assert!(off < 1e-9 * size, "{plant:?}, seed {seed}: {off}");
                // At rest the error of an encoder's rounding is not uniform.
                if record.commands.iter().any(|u| *u != 0.0) {
                    for i in 0..declared.len() {
                        let noise = rms((&record.outputs - &own).column(i).iter().copied());
                        let ratio = noise / declared[i];
                        assert!((0.85..1.15).contains(&ratio), "{plant:?}, seed {seed}, y{}: {ratio}", i + 1);
                    }
                }
            }
            assert!(case.label.gap_sim < 0.1 && (case.label.gap_sim / case.label.gap_floor - 1.0).abs() < 1e-9);
        }
    }
}

#[test]
fn a_seed_is_a_plant_and_another_is_another() {
    for plant in axes() {
        let [case, again, other] = [310, 310, 311].map(|seed| draw(seed, &short(plant)).unwrap());
        assert_eq!((&case.records, &case.held_out), (&again.records, &again.held_out), "{plant:?}");
        assert_eq!((&case.simulation, &case.label), (&again.simulation, &again.label), "{plant:?}");
        assert_ne!(case.records, other.records, "{plant:?}");
        assert_ne!(simulation(&case)["A"], simulation(&other)["A"], "{plant:?}");
        let off = draw(310, &GapSpec { perturbed: true, ..short(plant) }).unwrap();
        assert_eq!(case.records[1].outputs, off.records[1].outputs);
        assert_ne!(case.simulation, off.simulation);
    }
}

/// Order, poles, what outputs show and where ports are, from the written file.
#[test]
fn each_plant_is_of_its_kind() {
    for (plant, states, kind) in [
        (PlantKind::Motor, 1, "velocity"),
        (PlantKind::Servo, 2, "position"),
        (PlantKind::Slider, 2, "position"),
        (PlantKind::FreeSlider, 1, "velocity"),
        (PlantKind::Pendulum, 2, "position"),
        (PlantKind::Arm, 4, "position"),
        (PlantKind::SliderLoop, 2, "position"),
        (PlantKind::ArmLoop, 4, "position"),
    ] {
        let sim = simulation(&draw(320, &short(plant)).unwrap());
        let rate = sim["sample_rate_hz"].as_f64().unwrap();
        assert!((200.0..=1000.0).contains(&rate));
        assert_eq!(sim["output_kinds"]["y1"], kind, "{plant:?}");
        let poles = matrix(&sim["continuous"]["A"]).complex_eigenvalues();
        assert_eq!(poles.len(), states, "{plant:?}");
        let ratios: Vec<f64> = poles.iter().map(|p| -p.re / p.norm()).collect();
        let free = poles.iter().filter(|p| p.norm() < 1e-6 * rate).count();
        let expected = usize::from([PlantKind::Slider, PlantKind::FreeSlider].contains(&plant));
        assert_eq!(free, expected, "{plant:?}: {poles}");
        assert!(poles.iter().all(|p| p.norm() < 0.6 * rate), "{plant:?}: {poles}");
        match plant {
            PlantKind::Servo | PlantKind::SliderLoop => assert!(ratios.iter().all(|z| *z > 0.39), "{ratios:?}"),
            PlantKind::Pendulum | PlantKind::Arm => assert!(ratios.iter().all(|z| *z < 0.25), "{ratios:?}"),
            _ => {}
        }
        // A force at the port moves its output as the input does, and a closed loop rests where its reference is.
        let ports = sim["ports"].as_array().unwrap();
        assert_eq!(ports.len(), plant.channels().inputs);
        let b = matrix(&sim["continuous"]["B"]);
        for (j, port) in ports.iter().enumerate() {
            let force: Vec<f64> = serde_json::from_value(port["force"].clone()).unwrap();
            let off = force.iter().zip(&b.column(j)).fold(0.0_f64, |most, (f, b)| most.max((f - b).abs()));
            assert!(off < 1e-9 * b.amax(), "{plant:?}: {port}");
        }
        if [PlantKind::Servo, PlantKind::SliderLoop, PlantKind::ArmLoop].contains(&plant) {
            let [a, b, c] = ["A", "B", "C"].map(|key| matrix(&sim[key]));
            let gain = c * (DMatrix::identity(states, states) - a).try_inverse().unwrap() * b;
            assert!((&gain - DMatrix::identity(gain.nrows(), gain.ncols())).amax() < 1e-8, "{plant:?}: {gain}");
        }
    }
}

/// Every effect that makes sense on a plant can be drawn there within a few seeds, meets its gap, and is labelled.
#[test]
fn effects_meet_their_targets_on_every_plant_that_takes_them() {
    let kinds = [
        "stick-friction",
        "coulomb-friction",
        "quadratic-damping",
        "end-stop",
        "one-sided-stop",
        "gravity-sine",
        "backlash",
        "clearance",
        "cubic-stiffness",
        "joint-hysteresis",
        "added-mass",
        "added-damping",
        "added-stiffness",
        "actuator-lag",
        "actuator-gain",
        "actuator-delay",
        "actuator-saturation",
        "actuator-slew-limit",
        "actuator-crosstalk",
        "sensor-lag",
        "sensor-offset",
        "sensor-quantisation",
        "x-proportional-noise",
        "x-sticking-valve",
        "x-thermal-gain",
        "x-sensor-square",
    ];
    for plant in axes() {
        for kind in kinds.into_iter().filter(|kind| plant.takes(kind)) {
            let case = (330..336).find_map(|seed| draw(seed, &with(kind, 0.06, short(plant))).ok());
            let case = case.unwrap_or_else(|| panic!("{kind} on {plant:?}"));
            let effect = &case.label.effects[0];
            assert_eq!((effect.effect.as_str(), effect.config.as_ref().unwrap().kind()), (kind, kind));
            assert!((effect.gap / 0.06 - 1.0).abs() < 0.06, "{kind} on {plant:?}: {}", effect.gap);
            assert!(case.label.gap_sim > 0.05, "{kind} on {plant:?}: {}", case.label.gap_sim);
            if !kind.starts_with("x-") {
                let names = effect.parameter_names().len();
                assert!(names > 0 && names <= effect.par.len(), "{kind}: {:?}", effect.par);
            }
        }
    }
}

/// A stop that no record of a case reaches cannot be found in them, so such a case is not drawn.
#[test]
fn a_record_of_the_case_shows_its_effect() {
    let mut unseen = 0;
    for seed in 400..440 {
        match draw(seed, &with("end-stop", 0.07, short(PlantKind::Slider))) {
            Ok(case) => {
                let size = |y: &Array2<f64>| rms(y.iter().copied());
                let off = |record: &GapRecord| size(&(&record.outputs - &record.simulated)) / size(&record.outputs);
                let most = case.records.iter().filter(|r| r.excitation != Excitation::Zero).map(off);
                assert!(most.fold(0.0, f64::max) > 0.012, "seed {seed}");
            }
            Err(GapError::Unseen { kind, most }) => {
                assert!(kind == "end-stop" && most < 0.014, "seed {seed}: {kind} {most}");
                unseen += 1;
            }
            Err(GapError::Unreachable { .. }) => {}
            Err(error) => panic!("seed {seed}: {error}"),
        }
    }
    assert!(unseen > 0);
}

#[test]
fn what_makes_no_sense_is_refused_by_name() {
    let said = |spec: GapSpec| draw(340, &spec).unwrap_err().to_string();
    let all = GapSpec { plant: PlantKind::Motor, ..GapSpec::default() };
    assert_eq!(said(all), "`channels.inputs` must be from 1 to 1, not 3");
    let imperfect = GapSpec { imperfections: 0.03, ..short(PlantKind::Arm) };
    assert!(matches!(draw(340, &imperfect), Err(GapError::Apart { key: "imperfections", .. })));
    for (kind, plant) in [
        ("missing-mode", PlantKind::Servo),
        ("end-stop", PlantKind::Motor),
        ("gravity-sine", PlantKind::Arm),
        ("added-mass", PlantKind::Truss),
        ("actuator-crosstalk", PlantKind::Slider),
    ] {
        let error = said(with(kind, 0.05, short(plant)));
        assert!(error.contains(kind) && error.contains("it makes no sense on this kind of plant"), "{error}");
    }
}

/// An arm of which only the base is driven, a passive experiment, and a simulator that is given by its outputs.
#[test]
fn other_channels_experiments_and_simulators_are_drawn_as_on_structures() {
    let spec = GapSpec {
        channels: Channels { inputs: 1, outputs: 2 },
        experiment: Experiment::Passive,
        simulator: Simulator::Outputs,
        ports: false,
        ..short(PlantKind::Arm)
    };
    let case = draw(350, &spec).unwrap();
    assert_eq!((case.records.len(), case.held_out.commands.ncols(), case.held_out.outputs.ncols()), (1, 1, 2));
    let at = tempfile::tempdir().unwrap();
    case.write(&at.path().join("case"), &at.path().join("label")).unwrap();
    let text = std::fs::read_to_string(at.path().join("case/case.toml")).unwrap();
    let kinds = "output_kinds = { y1 = \"position\", y2 = \"position\" }";
    assert!(text.lines().any(|line| line == kinds) && !text.contains("sim.json"), "{text}");
    let label = std::fs::read_to_string(at.path().join("label/label.json")).unwrap();
    assert!(label.contains("\"plant\":\"arm\",\"inputs\":1,\"outputs\":2"), "{label}");
}
