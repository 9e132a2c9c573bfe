//! sim-with-effect.json in another program: what the example in Python makes of each effect, place and free shape, against
//! [`Predictor`]. Both read the same file.

use std::collections::BTreeMap;
use std::io::Write;
use std::path::Path;
use std::process::Command;

use plid_gap::diagnosis::{SimulationWithEffects, Value, WrittenEffect};
use plid_gap::effects::{Action, Effect, Flexible, Library, MissingModeStart, Place, Setting};
use plid_gap::plant::Plant;
use plid_gap::predict::Predictor;
use plid_gap::simulate::{Fineness, simulate};
use plid_gap::tones::Tone;
use plid_model::Model;
use rayon::prelude::*;

use crate::forward::{Rig, structure::rms};
use crate::truth::{self, Channels};

const SCRIPT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../examples/predict_with_effect.py");

/// Largest difference of an output, relative to its RMS: what the script promises is 1e-3, and what is left once both do the same is
/// rounding.
const LIMIT: f64 = 1e-8;

/// What an effect must change of the outputs, so that one which is left out would show.
const VISIBLE: f64 = 1e-3;

/// A record is so long that courses turn and drifts move in it.
const DURATION_S: f64 = 1.0;
const T0: f64 = 0.3;

/// Where the script can run: Python with NumPy is no part of a build.
fn python() -> bool {
    Command::new("python3").args(["-c", "import numpy"]).output().is_ok_and(|output| output.status.success())
}

/// A simulation with what effects may know of it.
struct Bench {
    model: Model,
    plant: Plant,
    setting: Setting,
    u: Channels,
}

impl Bench {
    /// With a place on its second mode.
    fn new(rig: Rig, model: Model) -> Self {
        let mut plant = Plant::new(&model).unwrap();
        plant.add_modal_port(1);
        let mut setting = Setting::bare(&plant, &model);
        let written = plant.to_model(&model);
        let sees = |row: &[f64]| {
            let c = nalgebra::DMatrix::from_row_slice(1, row.len(), row);
            let d = nalgebra::DMatrix::zeros(1, model.m());
            let probe = Model::new(model.sample_rate_hz, written.a.clone(), written.b.clone(), c, d).unwrap();
            rms(&truth::linear(&probe, &rig.u)[0])
        };
        setting.d_rms = written.ports.iter().map(|port| sees(&port.displacement)).collect();
        setting.v_rms = written.ports.iter().map(|port| sees(&port.velocity)).collect();
        setting.force = setting.stiffness.iter().zip(&setting.d_rms).map(|(k, d)| k * d).collect();
        let linear = truth::linear(&model, &rig.u);
        setting.u_rms = rig.u.iter().map(|u| rms(u)).collect();
        setting.u_slope = setting.u_rms.iter().map(|u| u * model.sample_rate_hz).collect();
        setting.y_rms = linear.iter().map(|y| rms(y)).collect();
        setting.y_max = linear.iter().map(|y| y.iter().fold(0.0, |most: f64, y| most.max(y.abs()))).collect();
        setting.duration_s = DURATION_S;
        setting.tones = vec![Tone { hz: 133.0, prominence: 100.0 }];
        setting.missing = vec![MissingModeStart { hz: 186.0, damping: 0.01, b: vec![0.7, -0.4], c: vec![0.6, 0.8] }];
        Self { model, plant, setting, u: rig.u }
    }

    /// Sizes at which it shows: those from which a fit starts, a free shape of falling pieces of either sign.
    fn sizes(&self, effect: &dyn Effect, place: &Place) -> Vec<f64> {
        let start = effect.starts(&self.setting, place).remove(0);
        if Flexible::named(effect.name()).is_none() {
            return start;
        }
        (0..start.len()).map(|k| [0.05, 0.03, -0.02][k % 3] / (1.0 + k as f64 / 6.0)).collect()
    }

    fn write(&self, effects: &[(&dyn Effect, Place)]) -> SimulationWithEffects {
        let mut changed = None;
        let mut written = Vec::new();
        for (effect, place) in effects {
            let sizes = self.sizes(*effect, place);
            for action in effect.act(&self.setting, place, &sizes) {
                if let Action::Plant(change) = action {
                    change(changed.get_or_insert_with(|| self.plant.clone()));
                }
            }
            let value = |value: f64| Value { value, ci95: None, unit: "1".into() };
            let given: BTreeMap<String, Value> = match (Flexible::named(effect.name()), place) {
                (Some(sibling), _) => {
                    let [unit, size] = sibling.units(&self.setting, place);
                    [("unit".into(), value(unit)), ("size".into(), value(size))].into()
                }
                (None, &Place::Input(i)) if effect.name() == "actuator-lag" => {
                    self.plant.chain.actuator_hz(i).map(|pole| ("pole".into(), value(pole))).into_iter().collect()
                }
                _ => BTreeMap::new(),
            };
            let port = match *place {
                Place::Frequency(_, port) => format!(" port:{}", self.setting.names.ports[port]),
                _ => String::new(),
            };
            let names = effect.parameters(&self.setting).into_iter().map(|parameter| parameter.name);
            written.push(WrittenEffect {
                effect: effect.name().into(),
                location: place.location(&self.setting.names) + &port,
                parameters: names.zip(sizes.into_iter().map(value)).collect(),
                given,
                equation: effect.equation().into(),
            });
        }
        SimulationWithEffects {
            format: "simulation-with-effects".into(),
            linear: self.plant.to_model(&self.model).to_json(),
            modes: self.plant.modes.len(),
            linear_with_modal_effects: changed.map(|plant| plant.to_model(&self.model).to_json()),
            refit: Vec::new(),
            effects: written,
            t0: T0,
            noise_rms: vec![0.0; self.plant.p],
        }
    }

    /// In words, what the effects change of the outputs, and by how much the script differs; both relative to each output's RMS, at
    /// worst.
    fn compare(&self, effects: &[(&dyn Effect, Place)], folder: &Path) -> (String, f64, f64) {
        let file = self.write(effects);
        let one = |effect: &WrittenEffect| format!("{} at {}", effect.effect, effect.location);
        let words = file.effects.iter().map(one).collect::<Vec<_>>().join(" + ");
        let at = tempfile::tempdir_in(folder).unwrap();
        let [json, input, output] = ["sim.json", "u.csv", "y.csv"].map(|name| at.path().join(name));
        std::fs::write(&json, serde_json::to_string(&file).unwrap()).unwrap();
        let rows = (0..self.u[0].len()).map(|k| format!("{:e},{:e}", self.u[0][k], self.u[1][k]));
        std::fs::write(&input, format!("u1,u2\n{}\n", rows.collect::<Vec<_>>().join("\n"))).unwrap();

        let predictor = Predictor::read(&json, &Library::standard()).unwrap();
        let predicted = predictor.run(&self.u, predictor.t0);
        let ran = Command::new("python3")
            .args([Path::new(SCRIPT), &json, &input, &output])
            .env("OPENBLAS_NUM_THREADS", "1")
            .output()
            .unwrap();
        assert!(ran.status.success(), "{words}: {}", String::from_utf8_lossy(&ran.stderr));
        let text = std::fs::read_to_string(&output).unwrap();
        let (header, rows) = text.split_once('\n').unwrap();
        assert_eq!(header.trim(), "y1,y2");
        let rows: Vec<Vec<f64>> =
            rows.lines().map(|row| row.split(',').map(|cell| cell.parse().unwrap()).collect()).collect();
        let carried: Channels = (0..2).map(|o| rows.iter().map(|row| row[o]).collect()).collect();
        assert_eq!(carried[0].len(), predicted[0].len(), "{words}");

        let linear = simulate(&self.plant, &[], &self.u, T0, None, Fineness::FINE);
        let worst = |other: &Channels| {
            let apart = |(a, b): (&f64, &f64)| (a - b).abs();
            let of = |(y, other): (&Vec<f64>, &Vec<f64>)| {
                y.iter().zip(other).map(apart).fold(0.0, |most: f64, x| if x <= most { most } else { x }) / rms(y)
            };
            predicted.iter().zip(other).map(of).fold(0.0, f64::max)
        };
        (words, worst(&linear), worst(&carried))
    }
}

/// A pure delay before the first input: the simulation has no continuous time then.
fn delayed(mut model: Model) -> Model {
    let n = model.n();
    let late = model.b.column(0).into_owned();
    model.a = model.a.clone().resize(n + 1, n + 1, 0.0);
    model.a.view_mut((0, n), (n, 1)).copy_from(&late);
    model.b = model.b.clone().resize_vertically(n + 1, 0.0);
    model.b.column_mut(0).fill(0.0);
    model.b[(n, 0)] = 1.0;
    model.c = model.c.clone().resize_horizontally(n + 1, 0.0);
    model.continuous = None;
    for port in &mut model.ports {
        for row in [&mut port.force, &mut port.displacement, &mut port.velocity] {
            row.push(0.0);
        }
    }
    model
}

/// Whether a free run shows nothing of an effect.
fn is_unseen(bench: &Bench, effect: &dyn Effect, place: &Place) -> bool {
    let sizes = bench.sizes(effect, place);
    effect.act(&bench.setting, place, &sizes).iter().all(|action| matches!(action, Action::Noise))
}

#[test]
fn the_script_repeats_every_prediction() {
    if !python() {
        // Past the harness, which keeps what a passing test prints.
        writeln!(std::io::stderr(), "SKIPPED the_script_repeats_every_prediction: no python3 with numpy").unwrap();
        return;
    }
    let library = Library::standard();
    let get = |name: &str| library.get(name).unwrap();
    let free = |name: &str| Flexible::named(name).unwrap() as &dyn Effect;
    let folder = tempfile::tempdir().unwrap();
    let declared = {
        let rig = Rig::new(11);
        let mut model = rig.model.clone();
        // The second strut without an input: `port:strut2`.
        model.ports[1].input = None;
        Bench::new(rig, model)
    };
    let open = {
        let rig = Rig::with(12, |truss| truss.filter_hz = None);
        let model = rig.model.clone();
        Bench::new(rig, model)
    };
    let inferred = {
        let rig = Rig::new(13);
        let mut model = rig.model.clone();
        model.ports.clear();
        Bench::new(rig, model)
    };
    let discrete = {
        let rig = Rig::new(14);
        let model = delayed(rig.model.clone());
        Bench::new(rig, model)
    };
    assert!(discrete.plant.rest.continuous.is_none());
    let on_mode = Place::Port(2);

    // Every effect, wherever it may act but for further channels; and its free shape at the same places.
    let mut cases: Vec<(&Bench, Vec<(&dyn Effect, Place)>)> = Vec::new();
    let mut shapes = Vec::new();
    for effect in library.effects() {
        let mut kinds = Vec::new();
        for place in effect.places(&declared.setting) {
            let kind = match place {
                Place::Port(k) => 100 + k,
                Place::Input(_) => 0,
                Place::AllInputs => 1,
                _ => 2,
            };
            if kinds.contains(&kind) {
                continue;
            }
            kinds.push(kind);
            cases.push((&declared, vec![(effect, place.clone())]));
            if let Some(sibling) = Flexible::of(effect.name())
                && !shapes.contains(&(sibling.name(), kind))
            {
                shapes.push((sibling.name(), kind));
                cases.push((&declared, vec![(sibling, place)]));
            }
        }
    }
    let joint = || (get("joint-hysteresis"), on_mode.clone());
    for bench in [&open, &inferred, &discrete] {
        cases.push((bench, vec![joint(), (free("free-joint"), on_mode.clone())]));
        cases.push((bench, vec![(free("free-stiffness"), Place::Input(0)), (free("free-damping"), on_mode.clone())]));
    }
    cases.push((&declared, vec![(get("narrowband-disturbance"), Place::Frequency(133.0, 2))]));
    cases.push((&declared, vec![(get("missing-mode"), Place::MissingMode(186.0)), joint()]));
    cases.push((&open, vec![(free("free-stiffness-course"), Place::Structure), joint()]));
    cases.push((
        &open,
        vec![
            (get("actuator-lag"), Place::Input(0)),
            (free("free-command-path"), Place::AllInputs),
            (free("free-joint"), Place::Input(1)),
            (free("free-sensor"), Place::Output(1)),
            (free("free-sensor-path"), Place::Output(1)),
        ],
    ));

    let found: Vec<(String, f64, f64, bool)> = cases
        .par_iter()
        .map(|(bench, effects)| {
            let (words, changed, apart) = bench.compare(effects, folder.path());
            let unseen = effects.iter().all(|(effect, place)| is_unseen(bench, *effect, place));
            (words, changed, apart, unseen)
        })
        .collect();
    let mut wrong = Vec::new();
    for (words, changed, apart, unseen) in found {
        println!("{words:100} changes {changed:7.1e}, differs by {apart:7.1e}");
        if !(apart < LIMIT) || (changed > VISIBLE) == unseen {
            wrong.push(format!("{words}: changes {changed:.1e}, differs by {apart:.1e}"));
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}
