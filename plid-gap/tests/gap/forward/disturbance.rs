//! Forces that no command causes and that change a free run.

use std::f64::consts::TAU;

use plid_gap::effects::{Effect, Place};

use super::{Check, Rig, T0};
use crate::truss::RATE;
use crate::truth::{self, Equations, Push};

/// A held force is exact on both sides, so the disagreement is rounding.
pub const CHECKS: &[Check] = &[Check { effect: "narrowband-disturbance", limit: 1e-6, measure: narrowband }];

/// a sin(2 pi f t + phi), held over a sample, at a port, in addition to the command.
fn narrowband(effect: &dyn Effect) -> f64 {
    let one = |rig: &Rig| {
        let (a, f, phi) = (0.1, 132.6, 0.7);
        let time = rig.model.continuous.as_ref().unwrap();
        let c = |_: f64| rig.model.c.clone();
        let force = |k: usize| a * (TAU * f * (T0 + k as f64 / RATE) + phi).sin();
        let push = Push { port: &rig.model.ports[1], force: &force };
        let equations = Equations { a: &time.a, b: &time.b, c: &c, stiffening: None, joint: None, push: Some(push) };
        let drive = |k: usize| rig.u.iter().map(|u| u[k]).collect();
        let truth = equations.run(T0, rig.u[0].len(), drive, truth::TOLERANCE).y;
        rig.disagreement(&rig.simulated(effect, &Place::Frequency(f, 1), &[a, f, phi], T0), &truth)
    };
    let all = [one(&Rig::new(41)), one(&Rig::with(42, |truss| truss.filter_hz = None))];
    all.into_iter().fold(0.0, f64::max)
}
