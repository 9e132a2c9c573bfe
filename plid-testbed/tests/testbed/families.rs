//! Families of laws: their ranges, what they are by default, and the limits in which they are the vocabulary's own
//! laws.

use std::fmt::Write as _;
use std::path::Path;

use plid_testbed::effects::{Kind, Shape, kinds};
use plid_testbed::{Effect, TrussConfig, simulate};

use crate::{ideal, largest};

fn built_in() -> impl Iterator<Item = Kind> {
    kinds().into_iter().filter(|kind| kind.family.is_built_in())
}

#[test]
fn the_halves_of_each_family_are_disjoint() {
    for (kind, shape) in built_in().flat_map(|kind| kind.shapes.iter().map(move |shape| (kind.name, shape))) {
        let (development, reported) = (shape.ranges.development, shape.ranges.reported);
        assert!(!development.is_empty() && !reported.is_empty(), "{kind}: {shape:?}");
        let mut all: Vec<[f64; 2]> = [development, reported].concat();
        all.sort_by(|a, b| a[0].total_cmp(&b[0]));
        assert!(all.iter().all(|[low, high]| low < high), "{kind}: {shape:?}");
        assert!(all.windows(2).all(|w| w[0][1] < w[1][0]), "{kind}: {shape:?} has intervals that meet");
        // What was there before there were families was there in development.
        assert!(development.iter().any(|[low, high]| (*low..=*high).contains(&shape.fixed)), "{kind}: {shape:?}");
    }
}

/// The constants of the laws before their shapes were drawn, by which a law without numbers is still read.
#[test]
fn a_law_without_numbers_is_what_it_was() {
    let before = [
        ("cubic-stiffness", "power", "exponent", 2.5),
        ("cubic-stiffness", "straightening", "bend", 1.0),
        ("quadratic-stiffness", "one-sided", "exponent", 2.0),
        ("quadratic-stiffness", "one-sided", "other_side", 0.0),
        ("coulomb-friction", "root", "knee", 1.0),
        ("coulomb-friction", "stribeck", "excess", 0.5),
        ("coulomb-friction", "stribeck", "speed", 5.0),
        ("clearance", "rounded", "sharpness", 3.0),
        ("clearance", "asymmetric", "lower", 0.5),
        ("iwan-joint", "kink", "share", 1.0 / 3.0),
        ("joint-hysteresis", "dahl", "unloading", 1.0),
        ("joint-hysteresis", "sharp", "exponent", 2.0),
        ("quadratic-damping", "power", "exponent", 1.7),
        ("quadratic-damping", "asymmetric", "other_way", 0.5),
        ("actuator-saturation", "clip", "rounding", 0.0),
        ("actuator-saturation", "arctangent", "knee", 1.0),
        ("actuator-slew-limit", "soft", "within_v", 0.1),
        ("sensor-saturation", "tanh", "knee", 1.0),
        ("sensor-quantisation", "truncate", "carry", 0.0),
        ("sensor-dropout", "half", "share", 0.5),
        ("sensor-delay", "interpolated", "all_pass", 0.0),
        ("sensor-lag", "two-poles", "ratio", 1.0),
        ("sensor-drift", "settling", "time_s", 10.0),
        ("sensor-noise", "laplace", "share", 1.0),
        ("narrowband-disturbance", "wandering", "rad_per_root_s", 1.0),
        ("stick-friction", "lorentzian", "exponent", 1.0),
    ];
    for (kind, law, number, fixed) in before {
        let kind = plid_testbed::effects::kind(kind).unwrap();
        let of_law = |shape: &&Shape| shape.law == law && shape.number == number;
        let found = kind.shapes.iter().find(of_law).unwrap_or_else(|| panic!("{}: {law}, {number}", kind.name));
        assert_eq!(found.fixed, fixed, "{}: {law}, {number}", kind.name);
    }
    // Each number is in the list, for one of the effects that share it.
    for shape in built_in().flat_map(|kind| kind.shapes) {
        assert!(before.iter().any(|(_, law, number, _)| (*law, *number) == (shape.law, shape.number)), "{shape:?}");
    }
}

#[derive(serde::Deserialize)]
struct List {
    effect: Vec<Effect>,
}

fn read(effect: &str) -> Result<Effect, String> {
    let list: Result<List, _> = toml::from_str(&format!("[[effect]]\n{effect}"));
    list.map(|mut list| list.effect.remove(0)).map_err(|e| e.to_string())
}

#[test]
fn a_law_is_written_by_its_name_or_with_its_numbers() {
    let friction = |law: &str| {
        read(&format!("kind = 'coulomb-friction'\nat = 'u1'\nfriction_v = 1.0\ntransition_v_per_s = 9.0\nlaw = {law}"))
    };
    let written = |law: &str| serde_json::to_value(friction(law).unwrap()).unwrap()["law"].clone();
    assert_eq!(written("'stribeck'"), "stribeck");
    assert_eq!(written("{ stribeck = { excess = 0.5 } }"), "stribeck");
    assert_eq!(friction("{ stribeck = { excess = 0.5, speed = 5.0 } }"), friction("'stribeck'"));
    let drawn = written("{ stribeck = { speed = 7.25 } }");
    assert_eq!(drawn, serde_json::json!({ "stribeck": { "excess": 0.5, "speed": 7.25 } }));
    assert_eq!(written("'tanh'"), "tanh");
    // As a config has it.
    let mut config = TrussConfig::default();
    config.effects.list = vec![friction("{ root = { knee = 0.6 } }").unwrap(), friction("'root'").unwrap()];
    let again: TrussConfig = toml::from_str(&toml::to_string(&config).unwrap()).unwrap();
    assert_eq!(again, config);
    for (law, said) in [
        ("'wet'", "unknown variant `wet`"),
        ("{ wet = { knee = 1.0 } }", "unknown variant `wet`"),
        ("{ root = { excess = 1.0 } }", "unknown field `excess`"),
        ("{ root = { knee = 'soft' } }", "invalid type"),
    ] {
        let error = friction(law).unwrap_err();
        assert!(error.contains(said), "{error}");
    }
    for (law, key) in
        [("{ root = { knee = 0.0 } }", "`law.knee`"), ("{ stribeck = { excess = -1.0 } }", "`law.excess`")]
    {
        config.effects.list = vec![friction(law).unwrap()];
        let error = simulate(&config).unwrap_err().to_string();
        assert!(error.contains(key), "{error}");
    }
}

/// The outputs without noise.
fn outputs(effect: &str) -> ndarray::Array2<f64> {
    let mut config = TrussConfig { duration_s: 0.3, ..ideal() };
    config.effects.list = vec![read(effect).unwrap_or_else(|e| panic!("{effect}: {e}"))];
    config.effects.steps_per_sample = 8;
    simulate(&config).unwrap_or_else(|e| panic!("{effect}: {e}")).noise_free
}

/// In a limit, or at a value of the number, each family has the vocabulary's own law; where it has none, this is not
/// listed.
#[test]
fn families_contain_the_vocabulary_s_own_laws() {
    let cases = [
        ("cubic-stiffness", "u2", "stiffness_per_v2 = 1e-4", "power = { exponent = 3.0 }"),
        ("cubic-stiffness", "u2", "stiffness_per_v2 = 1e-4", "straightening = { bend = 1e6 }"),
        ("quadratic-stiffness", "u2", "stiffness_per_v = 1e-3", "one-sided = { other_side = 1.0 }"),
        ("coulomb-friction", "u2", "friction_v = 0.05\ntransition_v_per_s = 500.0", "stribeck = { excess = 0.0 }"),
        ("clearance", "u2", "stiffness = 0.05\ngap_v = 3.0", "rounded = { sharpness = 1e7 }"),
        ("clearance", "u2", "stiffness = 0.05\ngap_v = 3.0", "asymmetric = { lower = 1.0 }"),
        ("iwan-joint", "u2", "stiffness = 0.05\nslip_v = 9.0\nexponent = -0.5", "kink = { share = 0.0 }"),
        ("joint-hysteresis", "u2", "stiffness = 0.05\nyield_v = 3.0", "dahl = { unloading = 0.0 }"),
        ("joint-hysteresis", "u2", "stiffness = 0.05\nyield_v = 3.0", "sharp = { exponent = 1.0 }"),
        ("quadratic-damping", "u2", "damping_s2_per_v = 1e-8", "power = { exponent = 2.0 }"),
        ("quadratic-damping", "u2", "damping_s2_per_v = 1e-8", "asymmetric = { other_way = 1.0 }"),
        ("actuator-dead-zone", "u2", "width_v = 0.3", "rounded = { sharpness = 1e7 }"),
        ("actuator-hysteresis", "u2", "share = 0.4\nyield_v = 0.7", "dahl = { unloading = 0.0 }"),
        ("actuator-hysteresis", "u2", "share = 0.4\nyield_v = 0.7", "sharp = { exponent = 1.0 }"),
        ("actuator-slew-limit", "u2", "rate_v_per_s = 500.0", "soft = { within_v = 1e-6 }"),
        ("actuator-gain-drift", "u2", "rate_per_s = 0.5", "settling = { time_s = 1e9 }"),
        ("sensor-saturation", "y2", "limit_v = 0.5", "tanh = { knee = 250.0 }"),
        ("sensor-quantisation", "y2", "step_v = 0.05", "truncate = { carry = 0.5 }"),
        ("sensor-dropout", "y2", "onsets_per_sample = 0.05", "half = { share = 1.0 }"),
        ("sensor-lag", "y2", "corner_hz = 300.0", "two-poles = { ratio = 1e9 }"),
        ("sensor-drift", "y2", "rate_v_per_s = 0.5", "settling = { time_s = 1e9 }"),
        (
            "narrowband-disturbance",
            "u2",
            "amplitude_v = 0.5\nfrequency_hz = 150.0",
            "wandering = { rad_per_root_s = 0.0 }",
        ),
    ];
    let linear = outputs("kind = 'actuator-gain'\nat = 'u1'\ngain = 1.0");
    for (kind, at, parameters, law) in cases {
        let with = |law: &str| outputs(&format!("kind = '{kind}'\nat = '{at}'\n{parameters}\n{law}"));
        let (own, limit) = (with(""), with(&format!("law = {{ {law} }}")));
        let fixed = with(&format!("law = '{}'", law.split(' ').next().unwrap()));
        let size = largest((&own - &linear).view());
        let [error, change] = [&limit, &fixed].map(|y| largest((y - &own).view()));
        assert!(size > 1e-3 && error < 5e-3 * size, "{kind}, {law}: {error} of {size}");
        assert!(change > 2.0 * error, "{kind}, {law}: its fixed shape differs by {change}, this limit by {error}");
    }
}

fn intervals(intervals: &[[f64; 2]]) -> String {
    let words: Vec<String> = intervals.iter().map(|[low, high]| format!("{low} to {high}")).collect();
    words.join(", ")
}

/// The table of the book has every family with its ranges.
#[test]
fn the_book_has_every_range() {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let book = here.ancestors().map(|folder| folder.join("docs/truss.md")).find(|chapter| chapter.exists());
    let book = std::fs::read_to_string(book.expect("the book")).unwrap();
    let mut families: Vec<(&Shape, Vec<String>)> = Vec::new();
    for (kind, shape) in built_in().flat_map(|kind| kind.shapes.iter().map(move |shape| (kind, shape))) {
        if kind.near_misses.contains(&shape.law) {
            let name = format!("`{}`", kind.name);
            match families.iter_mut().find(|(of, _)| *of == shape) {
                Some((_, kinds)) => kinds.push(name),
                None => families.push((shape, vec![name])),
            }
        }
    }
    let mut missing = String::new();
    for (Shape { law, number, fixed, ranges }, kinds) in families {
        let (development, reported) = (intervals(ranges.development), intervals(ranges.reported));
        let fixed = (100.0 * fixed).round() / 100.0;
        let row = format!("| {} | `{law}`: `{number}` | {fixed} | {development} | {reported} |", kinds.join(", "));
        if !book.lines().any(|line| line == row) {
            let _ = writeln!(missing, "{row}");
        }
    }
    assert!(missing.is_empty(), "docs/truss.md lacks\n{missing}");
}
