//! Forces inside the structure, integrated in continuous time from the matrices and ports of model.json; and changed
//! modes, compared with a structure that is built with them.

use nalgebra::DMatrix;
use plid_gap::effects::{Effect, Library, Place};
use plid_gap::research::Fineness;
use plid_model::Model;

use super::{Check, Rig, T0};
use crate::truss::{Sensor, Truss};
use crate::truth::{self, Channels, Equations, Joint, Motion};

/// In plid-gap, forces are linear in time over an eighth of a sample: an error of second order in that step, which
/// `half_the_step_is_a_quarter_of_the_error` measures. A corner or a jump inside a step costs more.
pub const CHECKS: &[Check] = &[
    Check { effect: "cubic-stiffness", limit: 2.5e-3, measure: |effect| CUBIC.disagreement(effect) },
    Check { effect: "quadratic-stiffness", limit: 2.5e-3, measure: |effect| QUADRATIC.disagreement(effect) },
    Check { effect: "coulomb-friction", limit: 2.5e-3, measure: |effect| COULOMB.disagreement(effect) },
    Check { effect: "clearance", limit: 2.5e-3, measure: |effect| CLEARANCE.disagreement(effect) },
    Check { effect: "joint-hysteresis", limit: 2.5e-3, measure: |effect| HYSTERESIS.disagreement(effect) },
    Check { effect: "quadratic-damping", limit: 2.5e-3, measure: |effect| DRAG.disagreement(effect) },
    Check { effect: "modal-frequency", limit: 1e-5, measure: |effect| moved(effect, 0.02, 1.02, 1.0) },
    Check { effect: "modal-damping", limit: 1e-5, measure: |effect| moved(effect, 1.6, 1.0, 1.6) },
    Check { effect: "missing-mode", limit: 1e-5, measure: missing_mode },
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

const HYSTERESIS: Law = Law {
    effect: "joint-hysteresis",
    parameters: |d, _| vec![0.15 / d, 0.7 * d],
    force: |p, _, _, z| -p[0] * z,
    slip: |p, v, z| v - (v.abs() * z + v * z.abs()) / (2.0 * p[1]),
};

const DRAG: Law = Law {
    effect: "quadratic-damping",
    parameters: |_, v| vec![0.05 / v.powi(2)],
    force: |p, _, v, _| -p[0] * v.abs() * v,
    slip: NONE,
};

const LAWS: [&Law; 6] = [&CUBIC, &QUADRATIC, &COULOMB, &CLEARANCE, &HYSTERESIS, &DRAG];

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

pub fn rms(x: &[f64]) -> f64 {
    (x.iter().map(|x| x * x).sum::<f64>() / x.len() as f64).sqrt()
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
