//! sim-with-effect.json describes each effect, location and free shape completely: [`Predictor`] reads what was
//! written, and so does the example in Python.

use std::collections::BTreeMap;
use std::io::Write;
use std::path::Path;
use std::process::Command;
use std::sync::Arc;

use plid_gap::answer::predict::Predictor;
use plid_gap::answer::schema::{SimulationWithEffects, Value, WrittenEffect};
use plid_gap::case::{Controller, Intersample};
use plid_gap::effects::{Action, Effect, Flexible, Library, MissingModeStart, Place, Setting};
use plid_gap::research::{Fineness, Plant, Tone, changed_plant, simulate};
use plid_model::Model;
use plid_model::signal::rms;
use rayon::prelude::*;

use crate::forward::Rig;
use crate::truss::Truss;
use crate::truth::{self, Channels};

const SCRIPT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../examples/predict_with_effect.py");

/// Largest difference of an output, relative to its RMS, which is rounding. The script promises 1e-3.
const LIMIT: f64 = 1e-8;

/// Least change of the outputs by an effect, for a missing effect to be noticed.
const VISIBLE: f64 = 1e-3;

/// A record is long enough for courses over time to change their slope and for drifts to be visible.
const DURATION_S: f64 = 1.0;
const T0: f64 = 0.3;

/// Factor from the displacements of the truss, about 1e-5, to angles in radians.
const ANGLE: f64 = 1e5;

/// The interpreter of the script, which is not required to build this project: Python with NumPy.
fn python() -> bool {
    Command::new("python3").args(["-c", "import numpy"]).output().is_ok_and(|output| output.status.success())
}

/// A simulation with the properties that effects use.
struct Bench {
    model: Model,
    plant: Plant,
    setting: Setting,
    u: Channels,
}

impl Bench {
    /// Adds a port on its second mode.
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
        setting.u_rms = rig.u.iter().map(rms).collect();
        setting.u_slope = setting.u_rms.iter().map(|u| u * model.sample_rate_hz).collect();
        setting.y_rms = linear.iter().map(rms).collect();
        setting.y_max = linear.iter().map(|y| y.iter().fold(0.0, |most: f64, y| most.max(y.abs()))).collect();
        for (k, port) in plant.ports.iter().enumerate() {
            let Some(input) = port.moved_by() else { continue };
            setting.d_rms[k] = setting.u_rms[input];
            let steps: Vec<f64> = rig.u[input].windows(3).map(|u| 0.5 * (u[2] - u[0])).collect();
            setting.v_rms[k] = rms(&steps) * model.sample_rate_hz;
            setting.force[k] = setting.y_rms[1];
        }
        setting.duration_s = DURATION_S;
        setting.tones = vec![Tone { hz: 133.0, prominence: 100.0 }];
        setting.missing = vec![MissingModeStart { hz: 186.0, damping: 0.01, b: vec![0.7, -0.4], c: vec![0.6, 0.8] }];
        Self { model, plant, setting, u: rig.u }
    }

    /// Closes a loop from the first output, which answers to the input at once, to the first input. Its controller has
    /// a state, a reference where `refers` says so, and an answer within the sample where `direct` says so.
    fn closed(mut self, refers: bool, direct: bool) -> Self {
        let gain = 0.02 * self.setting.u_rms[0] / self.setting.y_rms[0];
        let matrix =
            |rows: usize, columns: usize, entries: &[f64]| nalgebra::DMatrix::from_row_slice(rows, columns, entries);
        let (b, d) = (matrix(1, 2, &[-gain, 0.5]), matrix(1, 2, &[-gain, 0.7]));
        let mut law = Model::new(self.model.sample_rate_hz, matrix(1, 1, &[0.6]), b, matrix(1, 1, &[0.3]), d).unwrap();
        (law.inputs, law.outputs) = (vec!["y1".into(), "r".into()], vec!["u1".into()]);
        if !refers {
            law.inputs.truncate(1);
            (law.b, law.d) = (matrix(1, 1, &[-gain]), matrix(1, 1, &[-gain]));
        }
        if !direct {
            law.d[(0, 0)] = 0.0;
        }
        let loop_of_both = plid_model::close_loop(&self.model, &law).unwrap();
        assert!(plid_model::stability(&loop_of_both).unwrap().unstable.is_empty());
        self.plant.close(Arc::new(Controller::new(&self.model, law).unwrap()));
        self.setting.plant = self.plant.clone();
        let most = |y: &Vec<f64>| y.iter().fold(0.0, |most: f64, y| most.max(y.abs()));
        self.setting.y_max = self.simulated(&[], &[]).iter().map(most).collect();
        self
    }

    /// Returns sizes at which an effect is visible: those from which a fit starts, on a mode with the parameters that
    /// may be left out; for a free shape, decreasing coefficients of either sign.
    fn sizes(&self, effect: &dyn Effect, place: &Place) -> Vec<f64> {
        // An effect on the noise alone has no start.
        let any = || vec![1.0; effect.parameters(&self.setting).len()];
        let mut starts = effect.starts(&self.setting, place);
        if matches!(*place, Place::Port(port) if self.setting.is_on_a_mode(port)) {
            starts.sort_by_key(|start| std::cmp::Reverse(start.len()));
        }
        let start = starts.into_iter().next().unwrap_or_else(any);
        if Flexible::named(effect.name()).is_none() {
            return start;
        }
        (0..start.len()).map(|k| [0.05, 0.03, -0.02][k % 3] / (1.0 + k as f64 / 6.0)).collect()
    }

    fn write(&self, effects: &Effects) -> SimulationWithEffects {
        let act =
            |(effect, place): &(&dyn Effect, Place)| effect.act(&self.setting, place, &self.sizes(*effect, place));
        let changed = changed_plant(&self.plant, &effects.iter().flat_map(act).collect::<Vec<Action>>());
        let mut written = Vec::new();
        for (effect, place) in effects {
            let sizes = self.sizes(*effect, place);
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
            as_given: None,
            controller: self.plant.controller.as_ref().map(|controller| controller.model.to_json()),
            refit: Vec::new(),
            intersample: intersample(effects),
            effects: written,
            t0: T0,
            noise_rms: vec![0.0; self.plant.p],
            fitted: None,
            plant: Default::default(),
        }
    }

    /// Returns the outputs with the effects, and the prediction from a file in this folder.
    fn predicted(&self, effects: &Effects, folder: &Path) -> [Channels; 2] {
        let json = folder.join("sim-with-effect.json");
        std::fs::write(&json, serde_json::to_string(&self.write(effects)).unwrap()).unwrap();
        let predictor = Predictor::read(&json, &Library::standard()).unwrap();
        let of = |(effect, place): &(&dyn Effect, Place)| effect.act(&self.setting, place, &self.sizes(*effect, place));
        let actions: Vec<Action> = effects.iter().flat_map(of).collect();
        let written = self.simulated(effects, &actions);
        [written, predictor.run(&self.u, predictor.t0)]
    }

    /// Returns the outputs with some actions, and with the hold that these effects get.
    fn simulated(&self, effects: &Effects, actions: &[Action]) -> Channels {
        let held = intersample(effects).held(&self.u);
        let u = self.plant.controller.as_ref().map_or(held.clone(), |controller| controller.driven_by(&held));
        simulate(&self.plant, actions, &u, T0, None, Fineness::FINE)
    }

    /// Returns the prediction of the script from the file in this folder.
    fn carried(&self, folder: &Path) -> Channels {
        let [json, input, output] = ["sim-with-effect.json", "u.csv", "y.csv"].map(|name| folder.join(name));
        let rows: Vec<String> = self.u[0].iter().zip(&self.u[1]).map(|(a, b)| format!("{a:e},{b:e}")).collect();
        let drivers = self.plant.controller.as_ref().map(|controller| controller.drivers());
        let header = drivers.unwrap_or_else(|| self.model.inputs.clone()).join(",");
        std::fs::write(&input, format!("{header}\n{}\n", rows.join("\n"))).unwrap();
        let ran = Command::new("python3")
            .args([Path::new(SCRIPT), &json, &input, &output])
            .env("OPENBLAS_NUM_THREADS", "1")
            .output()
            .unwrap();
        assert!(ran.status.success(), "{}", String::from_utf8_lossy(&ran.stderr));
        let text = std::fs::read_to_string(&output).unwrap();
        let (header, rows) = text.split_once('\n').unwrap();
        assert_eq!(header.trim(), "y1,y2");
        let rows: Vec<Vec<f64>> =
            rows.lines().map(|row| row.split(',').map(|cell| cell.parse().unwrap()).collect()).collect();
        assert_eq!(rows.len(), self.u[0].len());
        (0..2).map(|o| rows.iter().map(|row| row[o]).collect()).collect()
    }

    /// Returns whether these effects change no free run.
    fn is_stochastic(&self, effects: &Effects) -> bool {
        effects.iter().all(|(effect, place)| {
            let actions = effect.act(&self.setting, place, &self.sizes(*effect, place));
            actions.iter().all(|action| matches!(action, Action::Noise))
        })
    }
}

/// Both holds of the inputs are tried: the first order where several effects act.
fn intersample(effects: &Effects) -> Intersample {
    if effects.len() > 1 { Intersample::Foh } else { Intersample::Zoh }
}

/// Returns the largest difference of an output, relative to its RMS; infinite for a value that is not a number.
fn worst(y: &Channels, other: &Channels) -> f64 {
    let of = |(y, other): (&Vec<f64>, &Vec<f64>)| {
        assert_eq!(y.len(), other.len());
        let apart = y.iter().zip(other).map(|(a, b)| (a - b).abs());
        apart.fold(0.0, |most: f64, x| if x.is_finite() { most.max(x) } else { f64::INFINITY }) / rms(y)
    };
    y.iter().zip(other).map(of).fold(0.0, f64::max)
}

/// Adds a pure delay before the first input; the simulation then has no continuous form.
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

/// Damps a structure well: the lag of a drive takes damping away.
fn damped(truss: &mut Truss) {
    truss.filter_hz = None;
    truss.modes.iter_mut().for_each(|(_, damping)| *damping = 0.25);
}

/// Effects with their locations.
type Effects<'a> = [(&'a dyn Effect, Place)];

/// A simulation with the effects that are tested on it.
type Case<'a> = (&'a Bench, Vec<(&'a dyn Effect, Place)>);

/// The simulations on which effects are tested.
struct Benches {
    /// A truss whose second port has no input: `port:strut2`.
    declared: Bench,
    /// Accelerations without filters, which respond to a force at once.
    open: Bench,
    inferred: Bench,
    /// A simulation without a continuous form.
    discrete: Bench,
    /// A truss and, next to it, a device that the second input moves and whose force is in the second output.
    tested: Bench,
    /// A well damped structure whose first input commands the position of its own port.
    servo: Bench,
    /// Accelerations without filters under control, by a reference and by what is added to the command.
    led: Bench,
    held: Bench,
    /// The same under a controller that answers after a sample, and with filters; effects act on their channels.
    late: Bench,
    filtered: Bench,
}

/// Returns every effect on commands or measurements at the first channel, and its free shape there.
fn of_channels<'a>(library: &'a Library, setting: &Setting) -> Vec<(&'a dyn Effect, Place)> {
    let mut of_channels: Vec<(&'a dyn Effect, Place)> = Vec::new();
    for effect in library.effects() {
        let places = effect.places(setting);
        let place = [Place::Input(0), Place::Output(0)].into_iter().find(|place| places.contains(place));
        let Some(place) = place.filter(|_| is_on_a_channel(effect, setting)) else { continue };
        let shape = effect.free_shape().map(|shape| shape as &dyn Effect);
        for effect in [Some(effect), shape].into_iter().flatten() {
            if of_channels.iter().all(|(other, _)| other.name() != effect.name()) {
                of_channels.push((effect, place.clone()));
            }
        }
    }
    of_channels
}

/// Returns whether an effect changes commands or measurements of free runs.
fn is_on_a_channel(effect: &dyn Effect, setting: &Setting) -> bool {
    let is_channel = |action: &Action| matches!(action, Action::Command(_) | Action::Sensor(_));
    [Place::Input(0), Place::Output(0)].iter().filter(|place| effect.places(setting).contains(place)).any(|place| {
        effect
            .starts(setting, place)
            .first()
            .is_some_and(|start| effect.act(setting, place, start).iter().all(is_channel))
    })
}

impl Benches {
    fn new() -> Self {
        let bench = |rig: Rig, change: &dyn Fn(Model) -> Model| {
            let model = change(rig.model.clone());
            Bench::new(rig, model)
        };
        // A displacement of the size of an angle, so that gravity-sine is visible. No other effect has a scale.
        let unnamed = |mut model: Model| {
            model.ports[1].input = None;
            for port in &mut model.ports {
                port.force.iter_mut().for_each(|x| *x /= ANGLE);
                port.output.iter_mut().flatten().for_each(|x| *x /= ANGLE);
                port.displacement.iter_mut().chain(&mut port.velocity).for_each(|x| *x *= ANGLE);
            }
            model
        };
        let without_ports = |mut model: Model| {
            model.ports.clear();
            model
        };
        Self {
            declared: bench(Rig::new(11), &unnamed),
            open: bench(Rig::with(12, |truss| truss.filter_hz = None), &|model| model),
            inferred: bench(Rig::new(13), &without_ports),
            discrete: bench(Rig::new(14), &delayed),
            tested: bench(Rig::new(15), &|mut model: Model| {
                let port = &mut model.ports[1];
                port.force.fill(0.0);
                port.displacement.fill(0.0);
                port.velocity.fill(0.0);
                port.output = Some(vec![0.0, -1.0]);
                model
            }),
            servo: bench(Rig::with(18, damped), &|mut model: Model| {
                let (a, b) = model.continuous.as_ref().map(|of| (of.a.clone(), of.b.column(0).into_owned())).unwrap();
                let row = nalgebra::DVector::from_column_slice(&model.ports[0].displacement);
                let there = -row.dot(&a.lu().solve(&b).unwrap());
                model.continuous.as_mut().unwrap().b.column_mut(0).unscale_mut(there);
                model.b.column_mut(0).unscale_mut(there);
                model.d.column_mut(0).unscale_mut(there);
                model
            }),
            led: bench(Rig::with(16, |truss| truss.filter_hz = None), &|model| model).closed(true, true),
            held: bench(Rig::with(17, |truss| truss.filter_hz = None), &|model| model).closed(false, true),
            late: bench(Rig::with(19, |truss| truss.filter_hz = None), &|model| model).closed(true, false),
            filtered: bench(Rig::new(20), &|model| model).closed(false, true),
        }
    }

    /// Every effect at a location of each kind at which it may act, and its free shape there; then several together.
    fn cases<'a>(&'a self, library: &'a Library) -> Vec<Case<'a>> {
        let Self { declared, open, inferred, discrete, tested, servo, .. } = self;
        let get = |name: &str| library.get(name).unwrap();
        let free = |name: &str| Flexible::named(name).unwrap() as &dyn Effect;
        let mut cases: Vec<Case> = Vec::new();
        let mut tried = Vec::new();
        for effect in library.effects() {
            for place in effect.places(&declared.setting) {
                let kind = match place {
                    Place::Port(k) => format!("port {k}"),
                    Place::AllInputs => "all".into(),
                    _ => "one".into(),
                };
                let sibling = effect.free_shape().map(|sibling| sibling as &dyn Effect);
                for effect in [Some(effect), sibling].into_iter().flatten() {
                    let this = (effect.name(), kind.clone());
                    if !tried.contains(&this) {
                        tried.push(this);
                        cases.push((declared, vec![(effect, place.clone())]));
                    }
                }
            }
        }
        // Its locations are found in noise.
        cases.push((declared, vec![(get("coloured-disturbance"), Place::Frequency(133.0, 0))]));
        let on_mode = || Place::Port(declared.setting.names.ports.len() - 1);
        let joint = || (get("joint-hysteresis"), on_mode());
        for bench in [open, inferred, discrete] {
            cases.push((bench, vec![joint(), (free("free-joint"), on_mode())]));
            cases.push((bench, vec![(free("free-stiffness"), Place::Input(0)), (free("free-damping"), on_mode())]));
        }
        let Place::Port(port) = on_mode() else { unreachable!("a port was asked for") };
        cases.push((declared, vec![(get("narrowband-disturbance"), Place::Frequency(133.0, port))]));
        cases.push((declared, vec![(get("missing-mode"), Place::MissingMode(186.0)), joint()]));
        cases.push((open, vec![(free("free-stiffness-course"), Place::Structure), joint()]));
        let springs = ["cubic-stiffness", "clearance", "joint-hysteresis", "iwan-joint"];
        let laws = springs.into_iter().chain(["coulomb-friction", "quadratic-damping"]).map(get);
        let shapes = ["free-stiffness", "free-damping", "free-joint"].map(free);
        cases.extend(laws.chain(shapes).map(|law| (tested, vec![(law, Place::Input(1))])));
        cases.extend(self.controlled_cases(library));
        let many = vec![
            (get("actuator-lag"), Place::Input(0)),
            (free("free-command-path"), Place::AllInputs),
            (free("free-joint"), Place::Input(1)),
            (free("free-sensor"), Place::Output(1)),
            (free("free-sensor-path"), Place::Output(1)),
        ];
        cases.push((open, many));
        cases.push((servo, vec![(get("actuator-lag"), Place::Loop(0))]));
        cases.push((servo, vec![(get("added-mass"), Place::Input(1)), (get("actuator-lag"), Place::Loop(0)), joint()]));
        cases
    }

    /// Effects in closed loop: forces and changes of the plant, then effects on commands and measurements.
    fn controlled_cases<'a>(&'a self, library: &'a Library) -> Vec<Case<'a>> {
        let Self { led, held, late, filtered, .. } = self;
        let get = |name: &str| library.get(name).unwrap();
        let mut cases: Vec<Case> = Vec::new();
        for bench in [led, held] {
            let force = |law: &str| (get(law), Place::Input(0));
            cases.push((bench, vec![force("stick-friction")]));
            cases.push((bench, vec![force("cubic-stiffness"), (get("modal-frequency"), Place::Mode(1))]));
            cases.push((bench, vec![force("added-damping"), force("coulomb-friction")]));
            cases.push((bench, vec![(&Flexible::StiffnessCourse as &dyn Effect, Place::Structure)]));
            cases.push((bench, vec![(get("narrowband-disturbance"), Place::Frequency(133.0, 1))]));
            cases.push((bench, vec![(get("actuator-gain"), Place::Input(0)), (get("sensor-gain"), Place::Output(0))]));
            let sent = (get("actuator-crosstalk"), Place::InputToInput(0, 1));
            let read = (get("sensor-crosstalk"), Place::OutputToOutput(1, 0));
            cases.push((bench, vec![sent, read, force("cubic-stiffness")]));
        }
        let of_channels = of_channels(library, &late.setting);
        for bench in [late, filtered] {
            cases.extend(of_channels.iter().map(|one| (bench, vec![one.clone()])));
            let [sent, late, slow] =
                ["lag", "delay", "slew-limit"].map(|kind| (get(&format!("actuator-{kind}")), Place::Input(0)));
            let force = |law: &str| (get(law), Place::Input(0));
            cases.push((bench, vec![sent, (get("sensor-delay"), Place::Output(0)), force("stick-friction")]));
            cases.push((bench, vec![late, force("cubic-stiffness")]));
            cases.push((bench, vec![slow, force("end-stop")]));
            cases.push((bench, vec![(get("sensor-quantisation"), Place::Output(0)), force("cubic-stiffness")]));
        }
        cases
    }
}

/// Compares, for each case, the change of the outputs by its effects with the result of `of`.
fn judge(of: impl Fn(&Bench, &Effects, &Path) -> [Channels; 2] + Sync) {
    let (library, benches) = (Library::standard(), Benches::new());
    assert!(benches.discrete.plant.rest.continuous.is_none());
    let cases = benches.cases(&library);
    for effect in library.effects() {
        let tried = cases.iter().flat_map(|(_, effects)| effects).any(|(tried, _)| tried.name() == effect.name());
        assert!(tried, "{} is not tried", effect.name());
    }
    let found: Vec<(String, f64, f64, bool)> = cases
        .par_iter()
        .map(|(bench, effects)| {
            let folder = tempfile::tempdir().unwrap();
            let written = bench.write(effects).effects;
            let words: Vec<String> = written.iter().map(|e| format!("{} at {}", e.effect, e.location)).collect();
            let [right, found] = of(bench, effects, folder.path());
            let linear = bench.simulated(effects, &[]);
            (words.join(" + "), worst(&right, &linear), worst(&right, &found), bench.is_stochastic(effects))
        })
        .collect();
    let mut wrong = Vec::new();
    for (words, changed, apart, stochastic) in found {
        let line = format!("{words}: changes {changed:.1e}, differs by {apart:.1e}");
        println!("{line}");
        if !(apart < LIMIT) || (changed > VISIBLE) == stochastic {
            wrong.push(line);
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn what_is_written_is_read_back() {
    judge(|bench, effects, folder| bench.predicted(effects, folder));
}

#[test]
fn the_script_repeats_every_prediction() {
    if !python() {
        // Writes past the test harness, which suppresses the output of a passing test.
        writeln!(std::io::stderr(), "SKIPPED the_script_repeats_every_prediction: no python3 with numpy").unwrap();
        return;
    }
    judge(|bench, effects, folder| {
        let [_, predicted] = bench.predicted(effects, folder);
        [predicted, bench.carried(folder)]
    });
}
