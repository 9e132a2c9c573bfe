//! Golden maps of the location of a gap, one case each for actuator, structure, sensor and time: output x band, time,
//! level slope and the part of the signal path that the residual shows, compared with the physics of each.
//! `PLID_BLESS=1` writes the files again.

use std::path::PathBuf;

use plid_gap::effects::Side;
use plid_gap::research::locate::{self, BANDS, Map, STRETCHES};

use plid_gap::case::{Excitation, Record};
use plid_gap::research::{Known, Prepared, prepare};
use serde_json::{Value, json};

use crate::forward::structure::{CUBIC, STRUT};
use crate::forward::{MODES, Rig, noise};
use crate::truss::RATE;
use crate::truth::{self, Channels, Equations, Joint};

/// Number of samples and level of each record; the last is held out from all fits and from the map.
const RECORDS: [(usize, f64); 5] = [(1200, 0.0), (2000, 1.0), (2000, 0.4), (2000, 1.0), (600, 1.0)];

/// Largest difference of shares, relative gaps and the slope from the golden ones, and largest relative difference of
/// larger numbers. Other machines round differently; nothing else is random.
const TOLERANCE: f64 = 1e-6;

/// Changes the commands of a record that starts at this time in s.
type Command<'a> = &'a dyn Fn(&mut Channels, f64);

/// A case: a change of commands (with the start of a record in s), a force at the second port as a function of
/// displacement, and a change of outputs.
#[derive(Default)]
struct Truth<'a> {
    command: Option<Command<'a>>,
    force: Option<&'a dyn Fn(f64) -> f64>,
    sensor: Option<&'a dyn Fn(&mut Channels)>,
}

/// Returns the map of plid-gap for records of this truth.
fn map(rig: &Rig, real: &Truth) -> (Map, Side) {
    let time = rig.model.continuous.as_ref().unwrap();
    let c = |_: f64| rig.model.c.clone();
    let std = 0.01 * truth::size(&rig.linear);
    let mut model = rig.model.clone();
    model.noise.sensor_std = Some(vec![std; 2]);
    model.noise.actuator_std = Some(vec![0.0; 2]);
    let (mut records, mut from) = (Vec::new(), 0);
    for (index, (samples, level)) in RECORDS.into_iter().enumerate() {
        let start_s = from as f64 / RATE;
        let mut u = noise(80 + index as u64, 2, samples);
        u.iter_mut().flatten().for_each(|u| *u *= level);
        let mut sent = u.clone();
        if let Some(command) = real.command {
            command(&mut sent, start_s);
        }
        let mut y = if let Some(force) = real.force {
            let port = &rig.model.ports[STRUT];
            let force = |d: f64, _: f64, _: f64| force(d);
            let still = |_: f64, _: f64, _: f64| 0.0;
            let equations = Equations {
                a: &time.a,
                b: &time.b,
                c: &c,
                stiffening: None,
                joint: Some(Joint { port, force: &force, unit: 1.0, slip: &still }),
                push: None,
            };
            equations.run(start_s, samples, |k| sent.iter().map(|u| u[k]).collect(), 1e-9).y
        } else {
            truth::linear(&rig.model, &sent)
        };
        if let Some(sensor) = real.sensor {
            sensor(&mut y);
        }
        let error = noise(90 + index as u64, 2, samples);
        y.iter_mut().zip(&error).for_each(|(y, e)| y.iter_mut().zip(e).for_each(|(y, e)| *y += std * e));
        let excitation = if level > 0.0 { Excitation::Random } else { Excitation::Zero };
        let (name, held_out) = (format!("record-{index}"), index + 1 == RECORDS.len());
        records.push(Record { name, excitation, from_rest: true, start_s, held_out, u, y, simulated: None });
        from += samples;
    }
    let ready = prepare(&model, &records, &Known::default()).unwrap();
    let errors = locate::errors(&ready, &vec![0.0; ready.problem.nuisance.len()]);
    let map = locate::map(&ready.problem.records, &errors, &ready.noise, RATE, &ready.problem.settings);
    (map, side(&ready))
}

/// The part of the signal path that the residual shows clearly.
fn side(ready: &Prepared) -> Side {
    let places = locate::places(ready, &Known::default(), 1.0);
    locate::side(&places, &ready.problem.settings.judge).unwrap_or_else(|| panic!("{places:#?}"))
}

/// Returns the share of an output, of a band by a frequency in it, or of a stretch.
fn of_output(map: &Map, o: usize) -> f64 {
    map.share.row(o).sum()
}

fn of_bands(map: &Map, hz: impl Fn(f64, f64) -> bool) -> f64 {
    (0..BANDS).filter(|&b| hz(map.edges[b], map.edges[b + 1])).map(|b| map.share.column(b).sum()).sum()
}

fn of_stretch(map: &Map, stretch: usize) -> f64 {
    map.time.row(stretch).sum()
}

/// Compares with the file, or writes it.
fn golden(name: &str, map: &Map, side: Side) {
    let rows = |m: &nalgebra::DMatrix<f64>| -> Vec<Vec<f64>> {
        m.row_iter().map(|row| row.iter().copied().collect()).collect()
    };
    let found = json!({
        "edges_hz": map.edges,
        "output_x_band": rows(&map.share),
        "time_x_band": rows(&map.time),
        "outputs": map.outputs,
        "level_and_gap": map.levels,
        "level_slope": map.slope,
        "side": side,
    });
    let file = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join(format!("tests/golden/where-{name}.json"));
    if std::env::var_os("PLID_BLESS").is_some() {
        std::fs::write(&file, serde_json::to_string_pretty(&found).unwrap() + "\n").unwrap();
        return;
    }
    let text = std::fs::read_to_string(&file).unwrap();
    let mut far = Vec::new();
    compare(&serde_json::from_str(&text).unwrap(), &found, name, &mut far);
    assert!(far.is_empty(), "not as in {}:\n{}", file.display(), far.join("\n"));
}

/// Returns every number that differs.
fn compare(golden: &Value, found: &Value, at: &str, far: &mut Vec<String>) {
    match (golden, found) {
        (Value::Array(a), Value::Array(b)) if a.len() == b.len() => {
            a.iter().zip(b).enumerate().for_each(|(k, (a, b))| compare(a, b, &format!("{at}[{k}]"), far));
        }
        (Value::Object(a), Value::Object(b)) if a.len() == b.len() && a.keys().all(|key| b.contains_key(key)) => {
            a.iter().for_each(|(key, a)| compare(a, &b[key], &format!("{at}.{key}"), far));
        }
        (Value::Number(a), Value::Number(b)) => {
            let (a, b) = (a.as_f64().unwrap(), b.as_f64().unwrap());
            if !((a - b).abs() <= TOLERANCE * a.abs().max(1.0)) {
                far.push(format!("{at}: {b} for {a}"));
            }
        }
        _ if golden == found => {}
        _ => far.push(format!("{at}: {found} for {golden}")),
    }
}

/// A saturated actuator: at every output, nothing without a command, and more at a high level (2 for a cube; saturation
/// reduces the slope).
#[test]
fn actuator() {
    let rig = Rig::new(101);
    let saturate = |u: &mut Channels, _: f64| u[0].iter_mut().for_each(|u| *u = 1.8 * (*u / 1.8).tanh());
    let (map, side) = map(&rig, &Truth { command: Some(&saturate), ..Truth::default() });
    golden("actuator-saturation", &map, side);
    assert_eq!(side, Side::Actuator);
    assert!(of_output(&map, 0) > 0.1 && of_output(&map, 1) > 0.1, "{} {}", of_output(&map, 0), of_output(&map, 1));
    assert!(of_stretch(&map, 0) < 0.01, "{}", of_stretch(&map, 0));
    let slope = map.slope.unwrap().value;
    assert!((1.2..2.1).contains(&slope), "{slope}");
}

/// A port that stiffens: at the resonances, and with the square of the level.
#[test]
fn structure() {
    let rig = Rig::new(102);
    // Strong enough to exceed the noise at the lower level.
    let k = 2.0 * CUBIC.chosen(&rig)[0];
    let force = |d: f64| -k * d.powi(3);
    let (map, side) = map(&rig, &Truth { force: Some(&force), ..Truth::default() });
    golden("cubic-stiffness", &map, side);
    assert_eq!(side, Side::Structure);
    let near = of_bands(&map, |low, high| MODES.iter().any(|(hz, _)| low - 20.0 < *hz && *hz < high + 20.0));
    assert!(near > 0.8, "{near}");
    let slope = map.slope.unwrap().value;
    assert!((1.4..2.4).contains(&slope), "{slope}");
}

/// A sensor with a wrong gain: in its own output alone, equally at every level.
#[test]
fn sensor() {
    let rig = Rig::new(103);
    let gain = |y: &mut Channels| y[1].iter_mut().for_each(|y| *y *= 0.9);
    let (map, side) = map(&rig, &Truth { sensor: Some(&gain), ..Truth::default() });
    golden("sensor-gain", &map, side);
    assert_eq!(side, Side::Sensor);
    assert!(of_output(&map, 1) > 0.98, "{}", of_output(&map, 1));
    let slope = map.slope.unwrap();
    assert!(slope.value.abs() < 0.1 && slope.ci95[0] < 0.0 && slope.ci95[1] > 0.0, "{slope:?}");
}

/// An actuator whose gain drifts: at the same level three times as much after three times the time.
#[test]
fn time() {
    let rig = Rig::new(104);
    let drift = |u: &mut Channels, start_s: f64| {
        u[1].iter_mut().enumerate().for_each(|(k, u)| *u *= 1.0 + 0.05 * (start_s + k as f64 / RATE));
    };
    let (map, side) = map(&rig, &Truth { command: Some(&drift), ..Truth::default() });
    golden("actuator-gain-drift", &map, side);
    assert_eq!(side, Side::Time);
    // The middles of the records at level one.
    let (first, last) = (2200.0, 6200.0);
    let grown = map.levels[2].gap.value / map.levels[0].gap.value;
    assert!((grown / (last / first) - 1.0).abs() < 0.15, "{grown}");
    assert!(of_stretch(&map, STRETCHES - 1) > 2.0 * of_stretch(&map, 2));
}
