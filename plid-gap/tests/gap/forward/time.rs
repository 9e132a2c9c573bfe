//! Effects that change during the records.

use plid_gap::effects::{Action, CubicStiffness, Effect, Place, StiffnessDrift};
use plid_gap::research::{Fineness, simulate};

use super::{Check, Rig, T0, structure};
use crate::truss::{RATE, Truss};
use crate::truth::{self, Channels, Equations, Joint};

/// A changed gain of a command is exact up to rounding. A drift leaves actuators and filters as at the former pole: a
/// phase of some w / (pole) of the shift, compared with the resonance's own w / (half width), which is one per cent.
pub const CHECKS: &[Check] = &[
    Check { effect: "actuator-gain-drift", limit: 1e-6, measure: gain_drift },
    Check { effect: "stiffness-drift", limit: 2e-2, measure: stiffness_drift },
];

/// u' = u (1 + r t) of the held command, t at the start of the hold.
fn gain_drift(effect: &dyn Effect) -> f64 {
    let rig = Rig::new(31);
    let r = -0.002;
    let mut u = rig.u.clone();
    u[0].iter_mut().enumerate().for_each(|(k, u)| *u *= 1.0 + r * (T0 + k as f64 / RATE));
    let truth = truth::linear(&rig.model, &u);
    rig.disagreement(&rig.simulated(effect, &Place::Input(0), &[r], T0), &truth)
}

/// Time at which a drift is examined, and its rate: the stiffness is off by one per cent.
const LATE: f64 = 25.0;
const RATE_OF_DRIFT: f64 = 4e-4;

/// w^2 (1 + r t) in every mode's own equation. The force 2 zeta w q' stays, because only the stiffness changes.
fn drifting(rig: &Rig, r: f64, t0: f64, cubic: Option<f64>) -> Channels {
    let now = rig.truss.equations();
    // Twice the stiffness and the same damping force.
    let twice = Truss {
        modes: rig.truss.modes.iter().map(|(hz, zeta)| (hz * 2_f64.sqrt(), zeta / 2_f64.sqrt())).collect(),
        ..rig.truss.clone()
    };
    let twice = twice.equations();
    let (more, more_c) = (&twice.a - &now.a, &twice.c - &now.c);
    let factor = |t: f64| 1.0 + r * t;
    let c = |factor: f64| &now.c + &more_c * (factor - 1.0);
    let k = cubic.unwrap_or(0.0);
    let force = |d: f64, _: f64, _: f64| -k * d.powi(3);
    let still = |_: f64, _: f64, _: f64| 0.0;
    let joint = cubic.map(|_| Joint { port: &now.ports[structure::STRUT], force: &force, unit: 1.0, slip: &still });
    let equations = Equations { a: &now.a, b: &now.b, c: &c, stiffening: Some((&more, &factor)), joint, push: None };
    equations.run(t0, rig.u[0].len(), |k| rig.u.iter().map(|u| u[k]).collect(), truth::TOLERANCE).y
}

/// Drifts of either sign, with filters and without, where the accelerations of a stiffer mode are larger at once.
fn stiffness_drift(effect: &dyn Effect) -> f64 {
    let one = |rig: &Rig, r: f64| {
        let truth = drifting(rig, r, LATE, None);
        rig.disagreement(&rig.simulated(effect, &Place::Structure, &[r], LATE), &truth)
    };
    let rig = Rig::new(32);
    let open = Rig::with(33, |truss| truss.filter_hz = None);
    let all = [one(&rig, RATE_OF_DRIFT), one(&rig, -RATE_OF_DRIFT), one(&open, RATE_OF_DRIFT)];
    all.into_iter().fold(0.0, f64::max)
}

/// A force as a function of displacement in a structure that has stiffened: d is that of the moved modes. The
/// disagreement is relative to the change by the force.
#[test]
fn a_force_sees_the_displacement_of_the_stiffened_structure() {
    let rig = Rig::new(34);
    let k = structure::CUBIC.chosen(&rig)[0];
    // Eight per cent, for a visible difference.
    let r = 0.08 / LATE;
    let without = drifting(&rig, r, LATE, None);
    let truth = drifting(&rig, r, LATE, Some(k));
    let run = |forced: bool| {
        let mut actions: Vec<Action> = StiffnessDrift.act(&rig.setting, &Place::Structure, &[r]);
        if forced {
            actions.extend(CubicStiffness.act(&rig.setting, &Place::Input(structure::STRUT), &[k]));
        }
        simulate(&rig.plant, &actions, &rig.u, LATE, None, Fineness::FINE)
    };
    let changed = truth::minus(&truth, &without);
    let simulated = truth::minus(&run(true), &run(false));
    let far = truth::size(&truth::minus(&simulated, &changed)) / truth::size(&changed);
    println!("force on drift {far:.2e}");
    // With the former displacement it is four per cent too large, and its cube twelve.
    assert!(far < 0.03, "{far:.2e}");
}
