//! Cases of other plants, channels, experiments and simulators than the usual.

use std::f64::consts::PI;
use std::fs;

use nalgebra::{DMatrix, Schur};
use ndarray::{Array2, s};
use plid_testbed::gap::{
    Channels, EffectSpec, Excitation, Experiment, GapCase, GapError, GapSpec, PlantKind, Simulator, draw,
};

const PLANTS: [PlantKind; 5] =
    [PlantKind::Truss, PlantKind::Beam, PlantKind::Chain, PlantKind::Drone, PlantKind::CloseModes];

/// Short records of a simulation with ports.
fn short() -> GapSpec {
    GapSpec { ports: true, length: 0.2, ..GapSpec::default() }
}

fn with(kind: &str, gap: f64, spec: GapSpec) -> GapSpec {
    GapSpec { effects: vec![EffectSpec { kind: kind.to_owned(), at: None, law: None, gap }], ..spec }
}

fn of(inputs: usize, outputs: usize) -> Channels {
    Channels { inputs, outputs }
}

pub fn matrix(sim: &serde_json::Value) -> DMatrix<f64> {
    let rows: Vec<Vec<f64>> = serde_json::from_value(sim.clone()).unwrap();
    DMatrix::from_fn(rows.len(), rows[0].len(), |i, j| rows[i][j])
}

/// Outputs of the written simulation, by loops of its own.
pub fn simulated(case: &GapCase, commands: &Array2<f64>) -> Array2<f64> {
    let sim = serde_json::to_value(&case.simulation).unwrap();
    let [a, b, c] = ["A", "B", "C"].map(|key| matrix(&sim[key]));
    let mut x = DMatrix::zeros(a.nrows(), 1);
    let mut y = Array2::zeros((commands.nrows(), c.nrows()));
    for k in 0..commands.nrows() {
        let now = &c * &x;
        (0..c.nrows()).for_each(|i| y[(k, i)] = now[(i, 0)]);
        x = &a * &x + &b * DMatrix::from_fn(b.ncols(), 1, |j, _| commands[(k, j)]);
    }
    y
}

fn gap(y: &Array2<f64>, other: &Array2<f64>) -> f64 {
    let squares = (0..y.ncols()).map(|i| {
        let error = (&y.column(i) - &other.column(i)).mapv(|e| e * e).sum();
        error / y.column(i).mapv(|y| y * y).sum()
    });
    (squares.sum::<f64>() / y.ncols() as f64).sqrt()
}

/// Frequencies (Hz) and damping ratios of the continuous model in sim.json, poles without oscillation first with
/// ratio 1.
fn poles(case: &GapCase) -> Vec<(f64, f64)> {
    let sim = serde_json::to_value(&case.simulation).unwrap();
    // With the default tolerance nalgebra's iteration may not end.
    let schur = Schur::try_new(matrix(&sim["continuous"]["A"]), 1e-11, 10_000).unwrap();
    let values = schur.complex_eigenvalues();
    let mut poles: Vec<(f64, f64)> =
        values.iter().filter(|p| p.im >= 0.0).map(|p| (p.norm() / (2.0 * PI), -p.re / p.norm())).collect();
    poles.sort_by(|a, b| a.0.total_cmp(&b.0));
    poles
}

#[test]
fn every_plant_is_explained_by_its_simulation_down_to_the_noise() {
    for (seed, plant) in (40..).zip(PLANTS) {
        let case = draw(seed, &GapSpec { plant, ..short() }).unwrap();
        let (given, floor) = (case.label.gap_sim, case.label.gap_floor);
        let own = gap(&case.held_out.outputs, &simulated(&case, &case.held_out.commands));
        println!("{plant:?}: {given:.4}, floor {floor:.4}");
        // The coordinates of the file cost some digits.
        assert!((own / given - 1.0).abs() < 1e-7, "{plant:?}: {own} for {given}");
        assert!(given < 0.03 && (given / floor - 1.0).abs() < 1e-9, "{plant:?}: {given}, {floor}");
        let level = case.records[1].outputs.iter().map(|y| y * y).sum::<f64>() / case.records[1].outputs.len() as f64;
        assert!((level.sqrt() / 0.45 - 1.0).abs() < 0.01, "{plant:?}: {level}");
        assert!(poles(&case).iter().all(|(_, damping)| *damping > 0.0), "{plant:?} is stable");
        let again = draw(seed, &GapSpec { plant, ..short() }).unwrap();
        assert_eq!(case.records, again.records);
        assert_ne!(
            case.records[1].outputs,
            draw(seed + 100, &GapSpec { plant, ..short() }).unwrap().records[1].outputs
        );
    }
}

#[test]
fn each_plant_is_of_its_kind() {
    let light = |plant, seed| -> Vec<(f64, f64)> {
        poles(&draw(seed, &GapSpec { plant, ..short() }).unwrap()).into_iter().filter(|p| p.1 < 0.1).collect()
    };
    let beam = light(PlantKind::Beam, 50);
    assert_eq!(beam.len(), 6);
    for (n, (hz, _)) in beam.iter().enumerate() {
        let square = ((n + 1) * (n + 1)) as f64;
        assert!((hz / beam[0].0 / square - 1.0).abs() < 1e-6, "mode {n}: {hz}");
    }
    assert_eq!(light(PlantKind::Chain, 51).len(), 7);
    // Below 100 Hz are the tubes' modes, which are as close as they may be.
    let close: Vec<(f64, f64)> = light(PlantKind::CloseModes, 52).into_iter().filter(|p| p.0 > 100.0).collect();
    let pairs = close.windows(2).filter(|w| w[1].0 - w[0].0 < 2.0 * w[0].1 * w[0].0).count();
    assert_eq!(pairs, 2, "{close:?}");
    // A drone's motors are the only poles without oscillation, and slower than all that rings.
    let drone = poles(&draw(53, &GapSpec { plant: PlantKind::Drone, ..short() }).unwrap());
    let motors: Vec<f64> = drone.iter().filter(|p| p.1 > 0.9999).map(|p| p.0).collect();
    assert!(motors.len() == 3 && motors.iter().all(|hz| (9.0..15.0).contains(hz)), "{motors:?}");
    assert!(light(PlantKind::Drone, 53).iter().all(|p| p.0 > 40.0));
}

/// Effects of each place meet their targets on every plant, and the label says where.
#[test]
fn effects_meet_their_targets_on_every_plant() {
    for (seed, plant) in (60..).zip(PLANTS) {
        for kind in [
            "cubic-stiffness",
            "modal-frequency",
            "missing-mode",
            "actuator-lag",
            "actuator-saturation",
            "sensor-lag",
            "stiffness-drift",
            "narrowband-disturbance",
            "x-parametric-stiffness",
            "x-force-factor",
            "x-foreshortening",
            "x-intermittent-contact",
            "x-resonant-crosstalk",
        ] {
            let case = draw(seed, &with(kind, 0.03, GapSpec { plant, ..short() })).unwrap();
            let effect = &case.label.effects[0];
            assert!((effect.gap / 0.03 - 1.0).abs() < 0.05, "{kind} on {plant:?}: {}", effect.gap);
            assert!(case.label.gap_sim > 0.024 && case.label.gap_sim < 0.06, "{kind}, {plant:?}: {:?}", case.label);
        }
    }
}

/// A drone's motor that becomes slower is slower than it was, not than a truss's actuator.
#[test]
fn a_lag_moves_the_pole_that_there_is() {
    let spec = GapSpec { plant: PlantKind::Drone, ..short() };
    let case = draw(66, &with("actuator-lag", 0.05, spec.clone())).unwrap();
    let motors: Vec<f64> = poles(&draw(66, &spec).unwrap()).iter().filter(|p| p.1 > 0.9999).map(|p| p.0).collect();
    let pole_hz = case.label.effects[0].par[0];
    assert!(motors.iter().any(|motor| pole_hz < *motor && pole_hz > 0.5 * motor), "{pole_hz} Hz of {motors:?}");
}

#[test]
fn fewer_channels_are_those_of_the_simulation_and_of_the_records() {
    for (inputs, outputs) in [(1, 1), (1, 3), (2, 1), (2, 2), (3, 2)] {
        let spec = GapSpec { channels: of(inputs, outputs), ..short() };
        let case = draw(70, &spec).unwrap();
        for record in case.records.iter().chain([&case.held_out]) {
            assert_eq!((record.commands.ncols(), record.outputs.ncols()), (inputs, outputs));
        }
        let sim = serde_json::to_value(&case.simulation).unwrap();
        assert_eq!((matrix(&sim["B"]).ncols(), matrix(&sim["C"]).nrows()), (inputs, outputs));
        assert_eq!(matrix(&sim["A"]).nrows(), inputs + 20 + 2 * outputs, "no actuator or filter that is not there");
        assert_eq!(sim["ports"].as_array().unwrap().len(), inputs);
        assert_eq!(
            (sim["inputs"].as_array().unwrap().len(), sim["outputs"].as_array().unwrap().len()),
            (inputs, outputs)
        );
        let own = gap(&case.held_out.outputs, &simulated(&case, &case.held_out.commands));
        // Nothing that the simulation lacks comes in by the channels that are not there.
        assert!(own < 0.03 && (own / case.label.gap_sim - 1.0).abs() < 1e-7, "{inputs} x {outputs}: {own}");
        let at = tempfile::tempdir().unwrap();
        case.write(at.path(), at.path()).unwrap();
        let header = fs::read_to_string(at.path().join("r1.csv")).unwrap();
        assert_eq!(header.lines().next().unwrap().split(',').count(), inputs + outputs);
    }
}

/// Without a command a channel that is not there changes nothing for those that are: the same commands, and the same
/// noise.
#[test]
fn a_channel_that_is_not_measured_changes_only_the_scale() {
    let all = draw(71, &short()).unwrap();
    let one = draw(71, &GapSpec { channels: of(3, 1), ..short() }).unwrap();
    assert_eq!(all.records[1].commands, one.records[1].commands);
    let scale = one.records[1].simulated[(500, 0)] / all.records[1].simulated[(500, 0)];
    for (a, b) in all.records[1].simulated.column(0).iter().zip(one.records[1].simulated.column(0)) {
        assert!((scale * a - b).abs() < 1e-9);
    }
    let two = draw(71, &GapSpec { channels: of(2, 3), ..short() }).unwrap();
    assert_eq!(all.records[4].commands.slice(s![.., ..2]), two.records[4].commands);
}

#[test]
fn effects_are_drawn_at_channels_that_there_are() {
    let few = |seed, kind: &str, inputs, outputs| {
        draw(seed, &with(kind, 0.05, GapSpec { channels: of(inputs, outputs), ..short() }))
    };
    let mut places = [0; 2];
    for seed in 80..90 {
        places[few(seed, "actuator-saturation", 2, 1).unwrap().label.effects[0].loc] += 1;
        assert_eq!(few(seed, "sensor-gain", 2, 1).unwrap().label.effects[0].loc, 0);
    }
    assert!(places[0] > 0 && places[1] > 0, "{places:?}");
    let crosstalk = few(80, "actuator-crosstalk", 2, 2).unwrap();
    let loc = crosstalk.label.effects[0].loc;
    assert_eq!(crosstalk.label.effects[0].par[1], (1 - loc) as f64);
    assert_eq!(few(80, "actuator-delay", 1, 1).unwrap().label.effects[0].loc, 0);
}

#[test]
fn what_needs_more_channels_says_so() {
    let says = |kind: &str, at: Option<&str>, inputs, outputs| {
        let mut spec = with(kind, 0.05, GapSpec { channels: of(inputs, outputs), ..short() });
        spec.effects[0].at = at.map(str::to_owned);
        let error = draw(1, &spec).unwrap_err();
        assert!(matches!(&error, GapError::Spec { number: 1, .. }), "{error}");
        error.to_string()
    };
    assert!(says("actuator-crosstalk", None, 1, 3).contains("needs two inputs"));
    assert!(says("sensor-crosstalk", None, 3, 1).contains("needs two outputs"));
    assert!(says("x-supply-sag", None, 1, 3).contains("needs two inputs"));
    assert!(says("x-channel-product", None, 3, 2).contains("needs three outputs"));
    let place = says("cubic-stiffness", Some("u3"), 2, 3);
    assert!(place.contains("a case of 2 inputs and 3 outputs has no `u3`"), "{place}");
    assert!(says("sensor-crosstalk", Some("y1->y3"), 3, 2).contains("y1->y3"));
}

#[test]
fn a_wrong_number_or_pair_of_keys_is_named() {
    let says = |spec: GapSpec| draw(1, &spec).unwrap_err().to_string();
    assert!(says(GapSpec { channels: of(0, 3), ..short() }).contains("`channels.inputs` must be from 1 to 3, not 0"));
    assert!(says(GapSpec { channels: of(3, 4), ..short() }).contains("channels.outputs"));
    assert!(says(GapSpec { length: 0.05, ..short() }).contains("`length` must be from 0.1 to 1"));
    assert!(says(GapSpec { noise_misjudged: 1.6, ..short() }).contains("noise_misjudged"));
    assert!(says(GapSpec { noise_misjudged: f64::NAN, ..short() }).contains("noise_misjudged"));
    let apart = says(GapSpec { simulator: Simulator::Outputs, ..short() });
    assert!(apart.contains("`ports` cannot be combined with"), "{apart}");
    let apart = says(GapSpec { simulator: Simulator::Outputs, ports: false, noise_misjudged: 1.2, ..short() });
    assert!(apart.contains("`noise_misjudged` cannot"), "{apart}");
    let read: GapSpec = toml::from_str("plant = \"close-modes\"\nchannels = { inputs = 1, outputs = 2 }").unwrap();
    assert_eq!(read, GapSpec { plant: PlantKind::CloseModes, channels: of(1, 2), ..GapSpec::default() });
    assert!(toml::from_str::<GapSpec>("plant = \"bridge\"").is_err());
}

#[test]
fn a_passive_case_has_one_random_record_and_another_held_out() {
    let case = draw(90, &with("sensor-offset", 0.1, GapSpec { experiment: Experiment::Passive, ..short() })).unwrap();
    assert_eq!(case.records.len(), 1);
    assert_eq!(case.records[0].excitation, Excitation::Random { level_v: 1.0 });
    assert_eq!((case.records[0].commands.nrows(), case.held_out.commands.nrows()), (2560, 1280));
    assert_ne!(case.records[0].commands.slice(s![..1280, ..]), case.held_out.commands);
    let at = tempfile::tempdir().unwrap();
    case.write(at.path(), at.path()).unwrap();
    let text = fs::read_to_string(at.path().join("case.toml")).unwrap();
    assert_eq!(text.matches("[[record]]").count(), 1);
}

#[test]
fn misjudged_noise_changes_the_declaration_and_nothing_else() {
    let plain = draw(91, &short()).unwrap();
    let loud = draw(91, &GapSpec { noise_misjudged: 1.25, ..short() }).unwrap();
    assert_eq!(plain.records, loud.records);
    let declared = |case: &GapCase| serde_json::to_value(&case.simulation).unwrap()["noise"].clone();
    assert_eq!(declared(&plain)["sensor_std"], serde_json::json!([0.005, 0.005, 0.005]));
    assert_eq!(declared(&loud)["sensor_std"], serde_json::json!([0.004, 0.004, 0.004]));
    assert_eq!(declared(&loud)["actuator_std"], serde_json::json!([0.004, 0.004, 0.004]));
}

#[test]
fn a_simulator_of_outputs_gives_what_its_model_would() {
    let spec = GapSpec { ports: false, perturbed: true, channels: of(2, 2), ..short() };
    let model = draw(92, &spec).unwrap();
    let outputs = draw(92, &GapSpec { simulator: Simulator::Outputs, ..spec }).unwrap();
    assert_eq!(model.records, outputs.records);
    for record in outputs.records.iter().chain([&outputs.held_out]) {
        let own = simulated(&model, &record.commands);
        assert!((&own - &record.simulated).iter().all(|e| e.abs() < 1e-9));
    }
    let at = tempfile::tempdir().unwrap();
    outputs.write(&at.path().join("case"), &at.path().join("label")).unwrap();
    assert!(!at.path().join("case/sim.json").exists());
    let text = fs::read_to_string(at.path().join("case/case.toml")).unwrap();
    let case: toml::Table = toml::from_str(&text).unwrap();
    assert!(!case.contains_key("sim"));
    for (i, record) in case["record"].as_array().unwrap().iter().enumerate() {
        let file = fs::read_to_string(at.path().join("case").join(record["simulated"].as_str().unwrap())).unwrap();
        assert_eq!(file.lines().next(), Some("y1,y2"));
        assert_eq!(file.lines().count(), 1 + outputs.records[i].outputs.nrows());
        let last: Vec<f64> = file.lines().last().unwrap().split(',').map(|v| v.parse().unwrap()).collect();
        assert_eq!(last, outputs.records[i].simulated.rows().into_iter().next_back().unwrap().to_vec());
    }
    assert!(at.path().join("label/test_sim.csv").exists());
}

#[test]
fn short_records_keep_their_levels_and_six_periods_of_odd_lines() {
    let (full, short) = (draw(93, &GapSpec { length: 1.0, ..short() }).unwrap(), draw(93, &short()).unwrap());
    let rows = |case: &GapCase| -> Vec<usize> { case.records.iter().map(|r| r.commands.nrows()).collect() };
    assert_eq!(rows(&full), [3200, 6400, 6400, 6 * 2003, 6400, 6400]);
    // 401 is a prime; 0.2 of 2003 is 400.6.
    assert_eq!(rows(&short), [640, 1280, 1280, 6 * 401, 1280, 1280]);
    for (k, level) in [(1, 1.0), (2, 0.3), (3, 1.0), (4, 0.6)] {
        let u = short.records[k].commands.column(0);
        let rms = (u.iter().map(|u| u * u).sum::<f64>() / u.len() as f64).sqrt();
        assert!((rms / level - 1.0).abs() < 0.01, "record {k}: {rms}");
    }
    let u = short.records[3].commands.column(1).to_vec();
    assert_eq!(u[..401], u[401..802]);
    let size = |line: usize| {
        let (mut re, mut im) = (0.0, 0.0);
        for (k, u) in u[..401].iter().enumerate() {
            let (sin, cos) = (2.0 * PI * ((k * line) % 401) as f64 / 401.0).sin_cos();
            (re, im) = (re + u * cos, im + u * sin);
        }
        f64::hypot(re, im)
    };
    // Up to 395 Hz, four of five odd lines.
    let present: Vec<usize> = (1..200).filter(|line| size(*line) > 20.0).collect();
    assert!(present.iter().all(|line| line % 2 == 1 && *line <= 99) && present.len() == 40, "{present:?}");
}
