//! Effects on a command: the changed command through model.json or, if it changes between samples, piece by piece
//! through its continuous form.

use nalgebra::{DMatrix, DVector};
use plid_gap::effects::{Effect, Place};

use super::{Check, Rig, T0, structure};
use crate::truss::RATE;
use crate::truth::{self, Channels};

/// Static curves are the same arithmetic on both sides, so the disagreement is rounding. The hysteresis has a corner
/// where z changes its sign, which costs the integration some digits. Between samples plid-gap divides a sample: a lag
/// and a ramp are replaced by their means over an eighth (second order: up to the square of w T / 8 over 12), and a
/// delayed step is exact to the sixth order of a quarter.
pub const CHECKS: &[Check] = &[
    Check {
        effect: "actuator-saturation",
        limit: 1e-6,
        measure: |effect| fixed(effect, &[1.3], |p, u| p[0] * (u / p[0]).tanh()),
    },
    Check {
        effect: "actuator-dead-zone",
        limit: 1e-6,
        measure: |effect| {
            fixed(effect, &[0.2], |p, u| {
                if u > p[0] {
                    u - p[0]
                } else if u < -p[0] {
                    u + p[0]
                } else {
                    0.0
                }
            })
        },
    },
    Check { effect: "actuator-gain", limit: 1e-6, measure: |effect| fixed(effect, &[1.07], |p, u| p[0] * u) },
    Check { effect: "actuator-hysteresis", limit: 1e-5, measure: hysteresis },
    Check { effect: "actuator-crosstalk", limit: 1e-6, measure: crosstalk },
    Check { effect: "actuator-lag", limit: 5e-3, measure: lag },
    Check { effect: "actuator-delay", limit: 3e-3, measure: delay },
    Check { effect: "actuator-slew-limit", limit: 5e-3, measure: slew },
];

/// The input whose command changes.
const INPUT: usize = 1;

/// A static curve of one input.
fn fixed(effect: &dyn Effect, parameters: &[f64], curve: fn(&[f64], f64) -> f64) -> f64 {
    let rig = Rig::new(11);
    let mut u = rig.u.clone();
    u[INPUT].iter_mut().for_each(|u| *u = curve(parameters, *u));
    let truth = truth::linear(&rig.model, &u);
    rig.disagreement(&rig.simulated(effect, &Place::Input(INPUT), parameters, T0), &truth)
}

/// dz = alpha du - (|du| z + du |z|) / (2 uy) along each step of the command.
fn hysteresis(effect: &dyn Effect) -> f64 {
    let rig = Rig::new(12);
    let (alpha, uy) = (0.3, 0.8);
    let mut u = rig.u.clone();
    let (mut z, mut before) = ([0.0], 0.0);
    for u in &mut u[INPUT] {
        let du = *u - before;
        truth::advance(&mut z, 0.0, 1.0, truth::TOLERANCE, |_, z, rate| {
            rate[0] = alpha * du - (du.abs() * z[0] + du * z[0].abs()) / (2.0 * uy);
        });
        before = *u;
        *u -= z[0];
    }
    let truth = truth::linear(&rig.model, &u);
    rig.disagreement(&rig.simulated(effect, &Place::Input(INPUT), &[alpha, uy], T0), &truth)
}

/// From the first input into the second; the first is unchanged.
fn crosstalk(effect: &dyn Effect) -> f64 {
    let rig = Rig::new(13);
    let mut u = rig.u.clone();
    let from = u[0].clone();
    u[1].iter_mut().zip(from).for_each(|(u, from)| *u += -0.06 * from);
    let truth = truth::linear(&rig.model, &u);
    rig.disagreement(&rig.simulated(effect, &Place::InputToInput(0, 1), &[-0.06], T0), &truth)
}

/// A structure whose actuator has another pole: slower, faster, much faster, and without filters.
fn lag(effect: &dyn Effect) -> f64 {
    let (filtered, open) = (Rig::new(14), Rig::with(17, |truss| truss.filter_hz = None));
    let one = |rig: &Rig, hz: f64| {
        let mut other = rig.truss.clone();
        other.actuators_hz[INPUT] = hz;
        rig.disagreement(&rig.simulated(effect, &Place::Input(INPUT), &[hz], T0), &structure::built(rig, &other))
    };
    [150.0, 300.0, 520.0].into_iter().map(|hz| one(&filtered, hz)).fold(one(&open, 200.0), f64::max)
}

/// The command of one input or of all is delayed: each hold is split where the delayed value arrives.
fn delay(effect: &dyn Effect) -> f64 {
    let rig = Rig::new(15);
    let one = |place: Place, tau: f64| {
        let late = |i: usize| place == Place::AllInputs || place == Place::Input(i);
        let (whole, share) = (tau.floor() as usize, tau.fract());
        let at = |i: usize, k: usize, back: usize| if k >= back { rig.u[i][k - back] } else { 0.0 };
        let values =
            |k: usize, back: usize| -> Vec<f64> { (0..2).map(|i| at(i, k, if late(i) { back } else { 0 })).collect() };
        let truth = pieces(&rig, |k| {
            let (old, new) = (values(k, whole + 1), values(k, whole));
            vec![Piece { share, from: old.clone(), to: old }, Piece { share: 1.0 - share, from: new.clone(), to: new }]
        });
        rig.disagreement(&rig.simulated(effect, &place, &[tau], T0), &truth)
    };
    [(Place::Input(INPUT), 0.13), (Place::Input(INPUT), 0.37), (Place::AllInputs, 1.6), (Place::AllInputs, 2.0)]
        .into_iter()
        .map(|(place, tau)| one(place, tau))
        .fold(0.0, f64::max)
}

/// u' approaches u at the rate R and then stays.
fn slew(effect: &dyn Effect) -> f64 {
    let rig = Rig::new(16);
    let one = |limit: f64| {
        let mut ramps = Vec::new();
        let mut now = 0.0;
        for &u in &rig.u[INPUT] {
            let share = ((u - now).abs() * RATE / limit).min(1.0);
            let reached = if share < 1.0 { u } else { now + limit / RATE * (u - now).signum() };
            ramps.push((share, now, reached));
            now = reached;
        }
        let truth = pieces(&rig, |k| {
            let (share, from, to) = ramps[k];
            let with = |value: f64| {
                let mut u: Vec<f64> = rig.u.iter().map(|u| u[k]).collect();
                u[INPUT] = value;
                u
            };
            vec![
                Piece { share, from: with(from), to: with(to) },
                Piece { share: 1.0 - share, from: with(to), to: with(to) },
            ]
        });
        rig.disagreement(&rig.simulated(effect, &Place::Input(INPUT), &[limit], T0), &truth)
    };
    [1200.0, 3000.0].into_iter().map(one).fold(0.0, f64::max)
}

/// The command during a share of a sample: a straight line from one set of values to another.
struct Piece {
    share: f64,
    from: Vec<f64>,
    to: Vec<f64>,
}

/// Runs the linear structure piece by piece, exactly: (x, u, its change) over a piece is one matrix exponential.
fn pieces(rig: &Rig, drive: impl Fn(usize) -> Vec<Piece>) -> Channels {
    let time = rig.model.continuous.as_ref().unwrap();
    let (n, m) = time.b.shape();
    let mut x = DVector::zeros(n);
    let mut y = vec![Vec::new(); rig.model.c.nrows()];
    for k in 0..rig.u[0].len() {
        y.iter_mut().zip((&rig.model.c * &x).iter()).for_each(|(y, out)| y.push(*out));
        for piece in drive(k) {
            let length = piece.share / RATE;
            let mut matrix = DMatrix::zeros(n + 2 * m, n + 2 * m);
            matrix.view_mut((0, 0), (n, n)).copy_from(&(&time.a * length));
            matrix.view_mut((0, n), (n, m)).copy_from(&(&time.b * length));
            matrix.view_mut((n, n + m), (m, m)).fill_with_identity();
            let change = piece.to.iter().zip(&piece.from).map(|(to, from)| to - from);
            let from = x.iter().chain(&piece.from).copied().chain(change);
            let all = matrix.exp() * DVector::from_iterator(n + 2 * m, from);
            x = all.rows(0, n).into_owned();
        }
    }
    y
}
