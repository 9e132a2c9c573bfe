//! Forces inside the structure, integrated in continuous time from the matrices and ports of model.json; and changed
//! modes, compared with a structure that is built with them.

use std::cell::{Cell, RefCell};
use std::f64::consts::TAU;

use nalgebra::{DMatrix, DVector, dmatrix};
use plid_gap::effects::{Effect, Library, Place, Setting};
use plid_gap::research::{Fineness, Plant, simulate};
use plid_model::signal::rms;
use plid_model::{Model, held};

use super::{Check, MODES, Rig, T0};
use crate::truss::{RATE, Sensor, Truss};
use crate::truth::{self, Channels, Equations, Joint, Motion};

/// In plid-gap, forces are linear in time over an eighth of a sample: an error of second order in that step, which
/// `half_the_step_is_a_quarter_of_the_error` measures. A corner or a jump inside a step costs more.
pub const CHECKS: &[Check] = &[
    Check { effect: "cubic-stiffness", limit: 2.5e-3, measure: |effect| CUBIC.disagreement(effect) },
    Check { effect: "quadratic-stiffness", limit: 2.5e-3, measure: |effect| QUADRATIC.disagreement(effect) },
    Check { effect: "coulomb-friction", limit: 2.5e-3, measure: |effect| COULOMB.disagreement(effect) },
    Check { effect: "clearance", limit: 2.5e-3, measure: |effect| CLEARANCE.disagreement(effect) },
    Check { effect: "backlash", limit: 2.5e-3, measure: |effect| BACKLASH.disagreement(effect) },
    Check { effect: "joint-hysteresis", limit: 2.5e-3, measure: |effect| HYSTERESIS.disagreement(effect) },
    Check { effect: "joint-hysteresis", limit: 2.5e-3, measure: |effect| STIFFENING_JOINT.disagreement(effect) },
    Check { effect: "joint-hysteresis", limit: 2.5e-3, measure: |effect| HELD_JOINT.disagreement(effect) },
    // Sliders for a continuous density: their sum is right to 0.05 % of the largest force.
    Check { effect: "iwan-joint", limit: 2.5e-3, measure: |effect| slips_little_by_little(effect, [0.0, 1.0]) },
    Check { effect: "quadratic-damping", limit: 2.5e-3, measure: |effect| DRAG.disagreement(effect) },
    Check { effect: "modal-frequency", limit: 1e-5, measure: |effect| moved(effect, 0.02, 1.02, 1.0) },
    Check { effect: "modal-damping", limit: 1e-5, measure: |effect| moved(effect, 1.6, 1.0, 1.6) },
    Check { effect: "missing-mode", limit: 1e-5, measure: missing_mode },
    Check { effect: "end-stop", limit: 1e-2, measure: |effect| STOPS.disagreement(effect).max(bounces(effect, false)) },
    Check {
        effect: "one-sided-stop",
        limit: 1e-2,
        measure: |effect| STOP.disagreement(effect).max(bounces(effect, true)),
    },
    // The instants at which it switches are located within the step.
    Check { effect: "stick-friction", limit: 1e-7, measure: sticks },
    Check { effect: "gravity-sine", limit: 2.5e-3, measure: swings },
    Check { effect: "added-stiffness", limit: 1e-5, measure: |effect| loaded(effect, |[_, _, k]| [0.0, 0.0, 0.2 * k]) },
    Check { effect: "added-damping", limit: 1e-5, measure: |effect| loaded(effect, |[_, c, _]| [0.0, c, 0.0]) },
    Check { effect: "added-mass", limit: 1e-5, measure: |effect| loaded(effect, |[m, _, _]| [3.0 * m, 0.0, 0.0]) },
];

/// A force law of the table.
pub struct Law {
    effect: &'static str,
    /// Parameters for RMS displacement and velocity of the port in the linear simulation.
    parameters: fn(f64, f64) -> Vec<f64>,
    /// f(parameters, d, v, z).
    force: fn(&[f64], f64, f64, f64) -> f64,
    /// dz/dt of parameters, v, z.
    slip: fn(&[f64], f64, f64) -> f64,
}

const NONE: fn(&[f64], f64, f64) -> f64 = |_, _, _| 0.0;

/// A force of 0.05 has a twentieth of the effect of a command of unit RMS.
pub const CUBIC: Law = Law {
    effect: "cubic-stiffness",
    parameters: |d, _| vec![0.03 / d.powi(3)],
    force: |p, d, _, _| -p[0] * d.powi(3),
    slip: NONE,
};

const QUADRATIC: Law = Law {
    effect: "quadratic-stiffness",
    parameters: |d, _| vec![-0.05 / d.powi(2)],
    force: |p, d, _, _| -p[0] * d.powi(2),
    slip: NONE,
};

const COULOMB: Law = Law {
    effect: "coulomb-friction",
    parameters: |_, v| vec![0.05, 0.1 * v],
    force: |p, _, v, _| -p[0] * (v / p[1]).tanh(),
    slip: NONE,
};

const CLEARANCE: Law = Law {
    effect: "clearance",
    parameters: |d, _| vec![0.2 / d, 0.8 * d],
    force: |p, d, _, _| {
        if d > p[1] {
            -p[0] * (d - p[1])
        } else if d < -p[1] {
            -p[0] * (d + p[1])
        } else {
            0.0
        }
    },
    slip: NONE,
};

const BACKLASH: Law = Law {
    effect: "backlash",
    parameters: |d, _| vec![0.2 / d, 0.8 * d],
    force: |p, d, _, _| p[0] * if d.abs() < p[1] { d } else { p[1] * d.signum() },
    slip: NONE,
};

const HYSTERESIS: Law = Law {
    effect: "joint-hysteresis",
    parameters: |d, _| vec![0.15 / d, 0.7 * d],
    force: |p, _, _, z| -p[0] * z,
    slip: |p, v, z| v - (v.abs() * z + v * z.abs()) / (2.0 * p[1]),
};

const STIFFENING_JOINT: Law = Law {
    effect: "joint-hysteresis",
    parameters: |d, _| vec![0.1 / d, 1.5 * d, -1.4],
    force: |p, _, _, z| -p[0] * z,
    slip: |p, v, z| v - (v.abs() * z + p[2] * v * z.abs()) / (2.0 * p[1]),
};

const HELD_JOINT: Law = Law {
    effect: "joint-hysteresis",
    parameters: |d, _| vec![0.15 / d, 0.9 * d, 0.3, 0.8],
    force: |p, d, _, z| p[0] * (p[3] * d - z),
    slip: |p, v, z| v - (v.abs() * z + p[2] * v * z.abs()) / (2.0 * p[1]),
};

const DRAG: Law = Law {
    effect: "quadratic-damping",
    parameters: |_, v| vec![0.05 / v.powi(2)],
    force: |p, _, v, _| -p[0] * v.abs() * v,
    slip: NONE,
};

/// A spring with a damper beyond a stop, which pushes and never pulls.
fn stop(p: &[f64], x: f64, rate: f64) -> f64 {
    if x > 0.0 { (p[0] * x + p[1] * rate).max(0.0) } else { 0.0 }
}

const STOPS: Law = Law {
    effect: "end-stop",
    parameters: |d, v| vec![0.5 / d, 0.05 / v, 0.8 * d],
    force: |p, d, v, _| stop(p, -d - p[2], -v) - stop(p, d - p[2], v),
    slip: NONE,
};

const STOP: Law = Law {
    effect: "one-sided-stop",
    parameters: |d, v| vec![0.5 / d, 0.05 / v, -0.6 * d],
    force: |p, d, v, _| stop(p, p[2] - d, -v),
    slip: NONE,
};

const LAWS: [&Law; 7] = [&CUBIC, &QUADRATIC, &COULOMB, &CLEARANCE, &HYSTERESIS, &STIFFENING_JOINT, &DRAG];

/// The port at which the forces act.
pub const STRUT: usize = 1;

impl Law {
    /// The parameters of a rig.
    pub fn chosen(&self, rig: &Rig) -> Vec<f64> {
        let still = self.run(rig, None, truth::TOLERANCE);
        (self.parameters)(rms(&still.d), rms(&still.v))
    }

    /// Returns the truth; without parameters the linear motion.
    fn run(&self, rig: &Rig, parameters: Option<&[f64]>, tolerance: f64) -> Motion {
        let time = rig.model.continuous.as_ref().unwrap();
        let joint = Joint {
            port: &rig.model.ports[STRUT],
            force: &|d, v, z| parameters.map_or(0.0, |p| (self.force)(p, d, v, z)),
            // Displacements are about 1e-6.
            unit: 1e-6,
            slip: &|_, v, z| parameters.map_or(0.0, |p| (self.slip)(p, v, z)),
        };
        let c = |_: f64| rig.model.c.clone();
        let equations = Equations { a: &time.a, b: &time.b, c: &c, stiffening: None, joint: Some(joint), push: None };
        equations.run(T0, rig.u[0].len(), |k| rig.u.iter().map(|u| u[k]).collect(), tolerance)
    }

    /// Returns the disagreement for a number of parts of a sample: the larger one of a structure with filters and one
    /// without, where a force acts on the outputs at once.
    fn disagreements<const N: usize>(&self, effect: &dyn Effect, parts: [usize; N]) -> [f64; N] {
        let of = |rig: &Rig| {
            let parameters = self.chosen(rig);
            let truth = self.run(rig, Some(&parameters), truth::TOLERANCE).y;
            parts.map(|force| {
                let fineness = Fineness { force, ..Fineness::FINE };
                let simulated = rig.simulated_at(effect, &Place::Input(STRUT), &parameters, T0, fineness);
                rig.disagreement(&simulated, &truth)
            })
        };
        let (filtered, open) = (of(&Rig::new(3)), of(&Rig::with(4, |truss| truss.filter_hz = None)));
        std::array::from_fn(|k| filtered[k].max(open[k]))
    }

    /// Returns the disagreement as finely as predictions are.
    fn disagreement(&self, effect: &dyn Effect) -> f64 {
        self.disagreements(effect, [Fineness::FINE.force])[0]
    }
}

/// Returns the largest disagreement over structures with each kind of sensor, with filters and without.
fn worst_of_sensors(seed: u64, disagreement: impl Fn(&Rig) -> f64) -> f64 {
    let mut worst = 0.0_f64;
    // Outputs of similar size lead to filter states of similar size.
    for (sensor, gain) in [(Sensor::Position, 1e6), (Sensor::Velocity, 1e3), (Sensor::Acceleration, 1.0)] {
        for filter_hz in [Some(600.0), None] {
            let rig = Rig::with(seed, |truss| {
                (truss.sensor, truss.filter_hz) = (sensor, filter_hz);
                truss.gamma *= gain;
            });
            worst = worst.max(disagreement(&rig));
        }
    }
    worst
}

/// The second mode is moved, in the simulation and in the structure.
fn moved(effect: &dyn Effect, parameter: f64, hz: f64, zeta: f64) -> f64 {
    worst_of_sensors(5, |rig| moved_in(rig, effect, parameter, hz, zeta))
}

fn moved_in(rig: &Rig, effect: &dyn Effect, parameter: f64, hz: f64, zeta: f64) -> f64 {
    let mut other = rig.truss.clone();
    let (old_hz, old_zeta) = other.modes[1];
    other.modes[1] = (old_hz * hz, old_zeta * zeta);
    let place = Place::Mode(rig.plant.mode_at(old_hz).unwrap());
    rig.disagreement(&rig.simulated(effect, &place, &[parameter], T0), &built(rig, &other))
}

/// Returns the response of a structure that is built so.
pub fn built(rig: &Rig, truss: &Truss) -> Channels {
    use rand::SeedableRng;
    // Its basis differs from that of the rig.
    let model: Model = truss.model(&mut rand_chacha::ChaCha8Rng::seed_from_u64(99));
    truth::linear(&model, &rig.u)
}

/// A fourth mode that the simulation lacks.
fn missing_mode(effect: &dyn Effect) -> f64 {
    worst_of_sensors(6, |rig| missing_mode_in(rig, effect))
}

fn missing_mode_in(rig: &Rig, effect: &dyn Effect) -> f64 {
    let (hz, zeta, b) = (186.0, 0.01, [0.7, -0.4]);
    // As large as the other modes' shapes.
    let c = [0.6, 0.8].map(|c| c * rig.truss.gamma.norm());
    let mut other = rig.truss.clone();
    other.modes.push((hz, zeta));
    other.beta = DMatrix::from_fn(4, 2, |k, i| if k < 3 { rig.truss.beta[(k, i)] } else { b[i] });
    other.gamma = DMatrix::from_fn(2, 4, |o, k| if k < 3 { rig.truss.gamma[(o, k)] } else { c[o] });
    // The c of the effect has norm one.
    let size = c[0].hypot(c[1]);
    let parameters = [hz, zeta, b[0] * size, b[1] * size, c[0], c[1]];
    rig.disagreement(&rig.simulated(effect, &Place::MissingMode(hz), &parameters, T0), &built(rig, &other))
}

/// A mass, a damper and a spring at a strut, with sensors of each kind: a structure that has them, from model.json's
/// matrices. `load` gives the three numbers of what the strut has itself: inertia, twice the damping of the second
/// mode, and static stiffness.
fn loaded(effect: &dyn Effect, load: fn([f64; 3]) -> [f64; 3]) -> f64 {
    worst_of_sensors(8, |rig| loaded_in(rig, effect, load))
}

fn loaded_in(rig: &Rig, effect: &dyn Effect, load: fn([f64; 3]) -> [f64; 3]) -> f64 {
    let (time, port) = (rig.model.continuous.as_ref().unwrap(), &rig.model.ports[STRUT]);
    let column = |x: &[f64]| DVector::from_column_slice(x);
    let (force, d, v) = (column(&port.force), column(&port.displacement), column(&port.velocity));
    let inertia = v.dot(&force).recip();
    let compliance = -d.dot(&time.a.clone().lu().solve(&force).unwrap());
    let [m, c, k] = load([inertia, 2.0 * inertia * TAU * MODES[1].0 * MODES[1].1, compliance.recip()]);
    // (1 + force m v') dx/dt = (A - force (k d + c v)') x + B u.
    let n = time.a.nrows();
    let carries = (DMatrix::identity(n, n) + &force * (&v * m).transpose()).lu();
    let row = (&d * k + &v * c).transpose();
    let (a, b) = (carries.solve(&(&time.a - &force * &row)).unwrap(), carries.solve(&time.b).unwrap());
    let (step, held) = held(&a, &b, 1.0 / RATE);
    let mut built = Model::new(RATE, step, held, rig.model.c.clone(), rig.model.d.clone()).unwrap();
    if let Some(output) = &port.output {
        let (output, mass) = (column(output), (&v * -m).transpose());
        built.c += &output * (&mass * &a - &row);
        built.d += &output * (&mass * &b);
    }
    let parameter = [m, c, k].into_iter().find(|x| *x != 0.0).expect("one of them");
    let simulated = rig.simulated(effect, &Place::Input(STRUT), &[parameter], T0);
    rig.disagreement(&simulated, &truth::linear(&built, &rig.u))
}

/// An axis of mass 2 on a damper of 3 and a spring, seen by its position, and commands that are held over forty
/// samples.
fn axis(spring: f64) -> (Model, Channels) {
    let (a, b) = held(&dmatrix![0.0, 1.0; -0.5 * spring, -1.5], &dmatrix![0.0; 0.5], 1.0 / RATE);
    let model = Model::new(RATE, a, b, dmatrix![1.0, 0.0], dmatrix![0.0]).unwrap();
    let drawn = &super::noise(17, 1, 32)[0];
    (model, vec![(0..32 * 40).map(|n| drawn[n / 40]).collect()])
}

/// Returns the disagreement on an axis with this spring between an effect and the truth, of which `step` takes position
/// and velocity over a sample with its command, of `loud` times the size.
fn on_an_axis(
    effect: &dyn Effect,
    parameters: &[f64],
    [spring, loud]: [f64; 2],
    step: impl Fn(f64, &mut [f64; 2]),
) -> f64 {
    let (model, mut u) = axis(spring);
    u[0].iter_mut().for_each(|u| *u *= loud);
    let plant = Plant::new(&model).unwrap();
    let setting = Setting::bare(&plant, &model);
    let actions = effect.act(&setting, &Place::Input(0), parameters);
    let simulated = simulate(&plant, &actions, &u, T0, None, Fineness::FINE);
    let mut x = [0.0; 2];
    let truth = u[0].iter().map(|u| {
        let now = x[0];
        step(*u, &mut x);
        now
    });
    let truth = vec![truth.collect::<Vec<f64>>()];
    let changed = truth::size(&truth::minus(&truth, &truth::linear(&model, &u)));
    assert!(changed > 1e-3 * truth::size(&truth), "an effect too small to judge: {changed:.1e}");
    truth::size(&truth::minus(&simulated, &truth)) / changed
}

/// The slider has no spring.
const SLIDER: [f64; 2] = [0.0, 1.0];

/// A pendulum swings out to more than a right angle: its own equation has no spring but gravity.
fn swings(effect: &dyn Effect) -> f64 {
    const GRAVITY: f64 = 60.0;
    on_an_axis(effect, &[GRAVITY], [GRAVITY, 60.0], |u, x| {
        truth::advance(x, 0.0, 1.0 / RATE, truth::TOLERANCE, |_, x, rate| {
            (rate[0], rate[1]) = (x[1], (u - 3.0 * x[1] - GRAVITY * x[0].sin()) / 2.0);
        });
    })
}

/// The slider bounces on hard stops, at about 50 Hz.
fn bounces(effect: &dyn Effect, one_sided: bool) -> f64 {
    let parameters = [2e5, 300.0, 0.002];
    on_an_axis(effect, &parameters, SLIDER, |u, x| {
        truth::advance(x, 0.0, 1.0 / RATE, truth::TOLERANCE, |_, x, rate| {
            let below = if one_sided { 0.0 } else { stop(&parameters, -x[0] - parameters[2], -x[1]) };
            let force = below - stop(&parameters, x[0] - parameters[2], x[1]);
            (rate[0], rate[1]) = (x[1], (u - 3.0 * x[1] + force) / 2.0);
        });
    })
}

/// The mass is on a joint of Iwan's, of which the simulation has this share of its stiffness. The joint's force follows
/// the curve of its first loading, and after each turn of the motion the same curve at twice its size (Masing), until a
/// loop closes: no slider is simulated.
fn slips_little_by_little(effect: &dyn Effect, shares: [f64; 2]) -> f64 {
    const PIECES: usize = 50;
    let (spring, [k, dm, chi]) = (60.0, [25.0, 0.05, -0.4]);
    let curve = |d: f64| {
        let x = (d.abs() / dm).min(1.0);
        d.signum() * k * dm * (x - x.powf(2.0 + chi) / (2.0 + chi))
    };
    let off = shares.map(|s| {
        // The turns of the motion with the force at each, and the displacement up to which they are known.
        let (turns, known) = (RefCell::new(Vec::<(f64, f64)>::new()), Cell::new(0.0));
        let branch = |d: f64| match turns.borrow().last() {
            Some((at, force)) => force + 2.0 * curve((d - at) / 2.0),
            None => curve(d),
        };
        on_an_axis(effect, &[k, dm, chi, s], [spring, 1.0], |u, x| {
            for _ in 0..PIECES {
                truth::advance(x, 0.0, 1.0 / (RATE * PIECES as f64), truth::TOLERANCE, |_, x, rate| {
                    let joint = s * k * x[0] - branch(x[0]);
                    (rate[0], rate[1]) = (x[1], (u - 3.0 * x[1] - spring * x[0] + joint) / 2.0);
                });
                let (to, from) = (x[0], known.replace(x[0]));
                let before = turns.borrow().last().map_or(0.0, |turn| turn.0);
                if (from - before) * (to - from) < 0.0 {
                    let turn = (from, branch(from));
                    turns.borrow_mut().push(turn);
                }
                close(&mut turns.borrow_mut(), to);
            }
        })
    });
    off[0].max(off[1])
}

/// Forgets the turns whose loops a motion to `d` has closed.
fn close(turns: &mut Vec<(f64, f64)>, d: f64) {
    while let [.., (outer, _), (inner, _)] = turns[..]
        && (d - outer) * (outer - inner) >= 0.0
    {
        turns.truncate(turns.len() - 2);
    }
    if let [(only, _)] = turns[..]
        && d.abs() >= only.abs()
    {
        turns.clear();
    }
}

/// The slider sticks and slips: between the times at which its velocity passes zero, which are found by bisection, the
/// friction has one sign. Where it stands, it stays until a command exceeds the holding force.
fn sticks(effect: &dyn Effect) -> f64 {
    const PIECES: usize = 50;
    let [slides, holds, vs] = [0.3, 0.5, 0.02];
    on_an_axis(effect, &[slides, holds, vs], SLIDER, |u, x| {
        let over = |x: &[f64; 2], sign: f64, time: f64| {
            let mut to = *x;
            truth::advance(&mut to, 0.0, time, truth::TOLERANCE, |_, x, rate| {
                let friction = sign * (slides + (holds - slides) * (-(x[1] / vs).powi(2)).exp());
                (rate[0], rate[1]) = (x[1], (u - 3.0 * x[1] - friction) / 2.0);
            });
            to
        };
        let mut left = 1.0 / RATE;
        while left > 0.0 {
            if x[1] == 0.0 && u.abs() <= holds {
                return;
            }
            let sign = if x[1] == 0.0 { u.signum() } else { x[1].signum() };
            let piece = left.min(1.0 / (RATE * PIECES as f64));
            let next = over(x, sign, piece);
            if next[1] * sign > 0.0 {
                (*x, left) = (next, left - piece);
                continue;
            }
            let (mut low, mut high) = (0.0, piece);
            for _ in 0..60 {
                let middle = 0.5 * (low + high);
                if over(x, sign, middle)[1] * sign > 0.0 { low = middle } else { high = middle }
            }
            (*x, left) = ([over(x, sign, low)[0], 0.0], left - high);
        }
    })
}

/// The step is fine enough: halved, it changes no effect by more than 1 / 400, and the error decreases by a factor of
/// four, as the order of the method predicts (by three at least, because of corners).
#[test]
fn half_the_step_is_a_quarter_of_the_error() {
    let library = Library::standard();
    for law in LAWS {
        let effect = library.get(law.effect).unwrap();
        let [four, eight, sixteen] = law.disagreements(effect, [4, 8, 16]);
        println!("{:20} {four:.1e} {eight:.1e} {sixteen:.1e}", law.effect);
        assert!(eight < 0.33 * four && sixteen < 0.33 * eight, "{}: {four:.1e} {eight:.1e} {sixteen:.1e}", law.effect);
        assert!(eight < 2.5e-3, "{}: {eight:.1e}", law.effect);
    }
}

/// The independent solution itself is fine enough.
#[test]
fn a_finer_integration_changes_nothing() {
    let rig = Rig::new(3);
    let linear = CUBIC.run(&rig, None, truth::TOLERANCE).y;
    let far = truth::size(&truth::minus(&linear, &rig.linear)) / truth::size(&rig.linear);
    assert!(far < 1e-8, "{far:.1e}");
    for law in LAWS {
        let parameters = law.chosen(&rig);
        let run = |tolerance: f64| law.run(&rig, Some(&parameters), tolerance).y;
        let (coarse, fine) = (run(truth::TOLERANCE), run(0.01 * truth::TOLERANCE));
        let far = truth::size(&truth::minus(&coarse, &fine)) / truth::size(&rig.linear);
        assert!(far < 2e-8, "{}: {far:.1e}", law.effect);
    }
}
