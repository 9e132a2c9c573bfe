use std::fs;

use plid_testbed::gap::{EffectSpec, Excitation, GapCase, GapError, GapSpec, draw};

const STRUCTURE: [&str; 11] = [
    "cubic-stiffness",
    "quadratic-stiffness",
    "coulomb-friction",
    "clearance",
    "joint-hysteresis",
    "quadratic-damping",
    "modal-frequency",
    "modal-damping",
    "missing-mode",
    "stiffness-drift",
    "iwan-joint",
];
const BESIDE_THE_STRUCTURE: [&str; 22] = [
    "actuator-saturation",
    "actuator-dead-zone",
    "actuator-hysteresis",
    "actuator-slew-limit",
    "actuator-lag",
    "actuator-gain",
    "actuator-delay",
    "actuator-crosstalk",
    "actuator-gain-drift",
    "sensor-saturation",
    "sensor-gain",
    "sensor-delay",
    "sensor-lag",
    "sensor-crosstalk",
    "sensor-offset",
    "sensor-drift",
    "mains-hum",
    "sensor-noise",
    "sensor-quantisation",
    "sensor-dropout",
    "narrowband-disturbance",
    "coloured-disturbance",
];
const OUTSIDERS: [&str; 16] = [
    "x-command-play",
    "x-delay-jitter",
    "x-sticking-valve",
    "x-sensor-rate-limit",
    "x-sensor-square",
    "x-channel-product",
    "x-parametric-stiffness",
    "x-varying-damping",
    "x-clock-skew",
    "x-force-factor",
    "x-foreshortening",
    "x-intermittent-contact",
    "x-proportional-noise",
    "x-resonant-crosstalk",
    "x-supply-sag",
    "x-thermal-gain",
];

fn spec(effects: &[(&str, f64)]) -> GapSpec {
    let effect = |(kind, gap): &(&str, f64)| EffectSpec { kind: (*kind).to_owned(), at: None, law: None, gap: *gap };
    GapSpec { effects: effects.iter().map(effect).collect(), ports: true, ..GapSpec::default() }
}

/// The label's gap against the one measured on the records: what the nominal simulation lacks in addition to the noise.
fn check_targets(first_seed: u64, kinds: &[&str]) {
    for (seed, kind) in (first_seed..).zip(kinds) {
        let target = if *kind == "x-varying-damping" { 0.05 } else { 0.1 };
        let case = draw(seed, &spec(&[(kind, target)])).unwrap();
        let label = &case.label;
        let effect = &label.effects[0];
        println!(
            "{kind}: {:?}, gap {:.4}, sim {:.4}, floor {:.4}",
            effect.par, effect.gap, label.gap_sim, label.gap_floor
        );
        // Dropouts come whole.
        let within = if *kind == "sensor-dropout" { 0.5 } else { 0.05 };
        assert!((effect.gap / target - 1.0).abs() < within, "{kind}: {}", effect.gap);
        assert_eq!(effect.effect, *kind);
        assert!(effect.own_equation);
        // Noise adds to the gap, by its square; and effect and noise are not quite independent.
        assert!(label.gap_sim > 0.8 * effect.gap && label.gap_sim < 1.3 * effect.gap, "{kind}: {}", label.gap_sim);
        if case.effects[0].foretold() && *kind != "sensor-quantisation" {
            assert!(label.gap_floor < 0.03, "{kind}: {}", label.gap_floor);
        }
    }
}

#[test]
fn effects_in_the_structure_meet_their_target_and_show_in_the_held_out_record() {
    check_targets(100, &STRUCTURE);
}

#[test]
fn effects_beside_the_structure_meet_their_target_and_show_in_the_held_out_record() {
    check_targets(110, &BESIDE_THE_STRUCTURE);
}

#[test]
fn outsiders_meet_their_target_and_show_in_the_held_out_record() {
    check_targets(132, &OUTSIDERS);
}

#[test]
fn near_misses_meet_their_target_too() {
    for (seed, (kind, law)) in [
        ("cubic-stiffness", "power"),
        ("cubic-stiffness", "straightening"),
        ("quadratic-stiffness", "one-sided"),
        ("coulomb-friction", "stribeck"),
        ("coulomb-friction", "root"),
        ("clearance", "rounded"),
        ("clearance", "asymmetric"),
        ("joint-hysteresis", "dahl"),
        ("joint-hysteresis", "sharp"),
        ("quadratic-damping", "power"),
        ("quadratic-damping", "asymmetric"),
        ("actuator-saturation", "clip"),
        ("actuator-saturation", "arctangent"),
        ("actuator-dead-zone", "asymmetric"),
        ("actuator-dead-zone", "rounded"),
        ("actuator-hysteresis", "dahl"),
        ("actuator-slew-limit", "soft"),
        ("actuator-gain-drift", "settling"),
        ("sensor-saturation", "tanh"),
        ("sensor-delay", "interpolated"),
        ("sensor-lag", "two-poles"),
        ("sensor-drift", "settling"),
        ("stiffness-drift", "settling"),
        ("sensor-noise", "laplace"),
        ("sensor-quantisation", "truncate"),
        ("sensor-dropout", "half"),
        ("narrowband-disturbance", "wandering"),
        ("iwan-joint", "kink"),
    ]
    .into_iter()
    .enumerate()
    {
        let mut spec = spec(&[(kind, 0.05)]);
        spec.effects[0].law = Some(law.to_owned());
        let effect = draw(300 + seed as u64, &spec).unwrap().label.effects.remove(0);
        let within = if kind == "sensor-dropout" { 0.5 } else { 0.05 };
        assert!((effect.gap / 0.05 - 1.0).abs() < within, "{kind}, {law}: {}", effect.gap);
        assert!(!effect.own_equation, "{kind}, {law}");
    }
}

fn folders(case: &GapCase) -> Vec<(String, Vec<u8>)> {
    let at = tempfile::tempdir().unwrap();
    case.write(&at.path().join("case"), &at.path().join("label")).unwrap();
    let mut files = Vec::new();
    for folder in ["case", "label"] {
        for entry in fs::read_dir(at.path().join(folder)).unwrap() {
            let path = entry.unwrap().path();
            let name = format!("{folder}/{}", path.file_name().unwrap().to_str().unwrap());
            files.push((name, fs::read(path).unwrap()));
        }
    }
    files.sort();
    files
}

#[test]
fn the_same_seed_gives_the_same_files_and_another_seed_others() {
    let spec = GapSpec { perturbed: true, ..spec(&[("joint-hysteresis", 0.1), ("sensor-dropout", 0.05)]) };
    let (once, again) = (draw(7, &spec).unwrap(), draw(7, &spec).unwrap());
    assert_eq!(folders(&once), folders(&again));
    let names: Vec<String> = folders(&once).into_iter().map(|(name, _)| name).collect();
    let expected = [
        "case/case.toml",
        "case/r1.csv",
        "case/r2.csv",
        "case/r3.csv",
        "case/r4.csv",
        "case/r5.csv",
        "case/r6.csv",
        "case/sim.json",
        "label/label.json",
        "label/test_u.csv",
        "label/test_uy.csv",
    ];
    assert_eq!(names, expected);
    let other = draw(8, &spec).unwrap();
    assert!(folders(&once).iter().zip(folders(&other)).all(|(a, b)| a.0 == "case/case.toml" || a.1 != b.1));
}

/// The files of the nominal simulation against the records, by a simulation of their own.
#[test]
fn without_effects_the_written_simulation_explains_the_records_down_to_the_noise() {
    for perturbed in [false, true] {
        let case = draw(11, &GapSpec { perturbed, ..spec(&[]) }).unwrap();
        assert_eq!(case.label.effects[0].effect, "none");
        let at = tempfile::tempdir().unwrap();
        case.write(at.path(), at.path()).unwrap();
        let sim: serde_json::Value = serde_json::from_slice(&fs::read(at.path().join("sim.json")).unwrap()).unwrap();
        let matrix = |key: &str| -> Vec<Vec<f64>> { serde_json::from_value(sim[key].clone()).unwrap() };
        let (a, b, c) = (matrix("A"), matrix("B"), matrix("C"));
        let times = |m: &[Vec<f64>], x: &[f64]| -> Vec<f64> {
            m.iter().map(|row| row.iter().zip(x).map(|(m, x)| m * x).sum()).collect()
        };
        let text = fs::read_to_string(at.path().join("r2.csv")).unwrap();
        assert_eq!(text.lines().next().unwrap(), "u1,u2,u3,y1,y2,y3");
        let mut x = vec![0.0; a.len()];
        let (mut error, mut size, mut level) = (0.0, 0.0, 0.0);
        for line in text.lines().skip(1) {
            let row: Vec<f64> = line.split(',').map(|v| v.parse().unwrap()).collect();
            let y = times(&c, &x);
            error += (0..3).map(|i| (row[3 + i] - y[i]).powi(2)).sum::<f64>();
            size += row[3..].iter().map(|y| y * y).sum::<f64>();
            level += row[..3].iter().map(|u| u * u).sum::<f64>();
            x = times(&a, &x).iter().zip(times(&b, &row[..3])).map(|(a, b)| a + b).collect();
        }
        let gap = (error / size).sqrt();
        println!("perturbed {perturbed}: {gap:.4}, level {}", (level / 6400.0 / 3.0).sqrt());
        assert!((gap < 0.02) != perturbed && gap < 0.15, "{gap}");
        assert!(((level / 6400.0 / 3.0).sqrt() - 1.0).abs() < 0.01);
    }
}

#[test]
fn the_declared_port_is_consistent_with_the_declared_model() {
    let case = draw(12, &spec(&[])).unwrap();
    let sim = serde_json::to_value(&case.simulation).unwrap();
    let a: Vec<Vec<f64>> = serde_json::from_value(sim["continuous"]["A"].clone()).unwrap();
    for port in sim["ports"].as_array().unwrap() {
        let row = |key: &str| -> Vec<f64> { serde_json::from_value(port[key].clone()).unwrap() };
        let (d, v, f) = (row("displacement"), row("velocity"), row("force"));
        let largest = v.iter().fold(0.0_f64, |most, v| most.max(v.abs()));
        for j in 0..d.len() {
            let rate: f64 = (0..d.len()).map(|i| d[i] * a[i][j]).sum();
            assert!((rate - v[j]).abs() < 1e-9 * largest, "the velocity is the displacement's rate");
        }
        let seen = |row: &[f64]| row.iter().zip(&f).map(|(r, f)| r * f).sum::<f64>();
        assert!(seen(&d).abs() < 1e-9 * seen(&v).abs(), "a force moves nothing at once");
        assert!(seen(&v) > 0.0);
    }
    let silent = serde_json::to_value(draw(12, &GapSpec { ports: false, ..spec(&[]) }).unwrap().simulation).unwrap();
    assert!(silent.get("ports").is_none() && silent.get("continuous").is_none());
}

#[test]
fn the_multisine_has_odd_lines_only_and_leaves_some_of_them_out() {
    let case = draw(13, &spec(&[])).unwrap();
    let Excitation::Periodic { period } = case.records[3].excitation else { panic!("the fourth is periodic") };
    let u = case.records[3].commands.column(0).to_vec();
    let line = |n: usize| {
        let (mut re, mut im) = (0.0, 0.0);
        for (k, u) in u[..period].iter().enumerate() {
            let (sin, cos) = (2.0 * std::f64::consts::PI * ((k * n) % period) as f64 / period as f64).sin_cos();
            (re, im) = (re + u * cos, im + u * sin);
        }
        f64::hypot(re, im)
    };
    let present = |n: &usize| line(*n) > 50.0;
    assert!(!(0..1000).step_by(2).any(|n| present(&n)));
    let odd: Vec<usize> = (3..=495).step_by(2).collect();
    let found = odd.iter().filter(|n| present(n)).count();
    assert!((190..=200).contains(&found), "{found} of {}", odd.len());
    assert_eq!(u[..period], u[period..2 * period]);
}

#[test]
fn a_label_knows_its_place_and_the_names_of_its_parameters() {
    for (kind, at, right, wrong) in [
        ("cubic-stiffness", "u2", "input:u2", "input:u1"),
        ("cubic-stiffness", "u2", "port:strut2", "output:y2"),
        ("actuator-gain", "u3", "input:u3", "input:u2"),
        ("actuator-delay", "all", "input:all", "input:u1"),
        ("actuator-crosstalk", "u3->u1", "input:u3->u1", "input:u1->u3"),
        ("sensor-crosstalk", "y1->y2", "output:y1->y2", "input:u1->u2"),
        ("mains-hum", "y3", "output:y3", "output:y1"),
    ] {
        let mut spec = GapSpec { length: 0.1, ..spec(&[(kind, 0.05)]) };
        spec.effects[0].at = Some(at.to_owned());
        let effect = draw(3, &spec).unwrap().label.effects.remove(0);
        assert!(effect.is_at(right) && !effect.is_at(wrong), "{kind} at {at}");
        assert_eq!(effect.parameter_names().len() + usize::from(kind.contains("crosstalk")), effect.par.len());
    }
    let short = |kind| {
        let case = draw(3, &GapSpec { length: 0.1, ..spec(&[(kind, 0.05)]) });
        case.unwrap().label.effects.remove(0)
    };
    let mode = short("modal-damping");
    assert!(mode.is_at(&format!("mode:{:.1}", mode.hz)) && !mode.is_at(&format!("mode:{:.1}", 1.1 * mode.hz)));
    let hum = short("narrowband-disturbance");
    assert!(hum.is_at(&format!("freq:{:.1} port:strut1", hum.par[1])) && !hum.is_at("freq:12.0"));
    for kind in STRUCTURE.iter().chain(&BESIDE_THE_STRUCTURE) {
        let effect = short(kind);
        let other_channel = usize::from(kind.contains("crosstalk"));
        assert_eq!(effect.parameter_names().len() + other_channel, effect.par.len(), "{kind}");
    }
}

/// A damping that is off by more than twice the limits, of which the simulation's own error takes some back, is not
/// clear of them.
#[test]
fn what_a_nuisance_takes_back_does_not_count() {
    let drawn = |seed, perturbed| {
        let case = draw(seed, &GapSpec { length: 0.1, perturbed, ..spec(&[("modal-damping", 0.1)]) });
        case.unwrap().label.effects.remove(0)
    };
    let (mut taken_back, mut both) = (0, 0);
    for seed in 1..40 {
        let (alone, perturbed) = (drawn(seed, false), drawn(seed, true));
        assert_eq!(alone.par, perturbed.par, "seed {seed}");
        assert_eq!(alone.clear_of_nuisance, alone.par[0].ln().abs() > 0.2, "seed {seed}");
        assert!(alone.clear_of_nuisance || !perturbed.clear_of_nuisance, "seed {seed}");
        taken_back += usize::from(alone.clear_of_nuisance && !perturbed.clear_of_nuisance);
        both += usize::from(perturbed.clear_of_nuisance);
    }
    assert!(taken_back > 0 && both > taken_back, "{taken_back} taken back, {both} clear");
}

#[test]
fn a_wrong_spec_is_named() {
    let kind = draw(1, &spec(&[("sensor-gain", 0.1), ("cubic-stifness", 0.1)])).unwrap_err();
    assert!(matches!(&kind, GapError::Spec { number: 2, .. }), "{kind}");
    let mut place = spec(&[("cubic-stiffness", 0.1)]);
    place.effects[0].at = Some("u4".to_owned());
    assert!(draw(1, &place).unwrap_err().to_string().contains("u4"));
    let mut law = spec(&[("coulomb-friction", 0.1)]);
    law.effects[0].law = Some("sticky".to_owned());
    assert!(draw(1, &law).unwrap_err().to_string().contains("sticky"));
    assert!(draw(1, &spec(&[("sensor-gain", 0.0)])).unwrap_err().to_string().contains("positive"));
    // A delay that jitters by a sample at most cannot make any gap.
    assert!(matches!(draw(1, &spec(&[("x-delay-jitter", 0.9)])), Err(GapError::Unreachable { .. })));
}
