//! Describing functions: near a resonance, a force that depends on the motion acts as a stiffness or a damper that
//! depends on the amplitude alone.
//!
//! With d = A sin(w t) the fundamental of f is -k_eq d - c_eq v: k_eq = 3/4 k A^2 of a cubic spring, c_eq = 8 c V / (3
//! pi) of a drag, 4 F / (pi V) of dry friction (V = w A), and k (1 - 2/pi (asin(g/A) + (g/A) sqrt(1 - (g/A)^2))) of a
//! clearance. The amplitude is found by iteration in the frequency domain, from model.json's matrices; no differential
//! equation is solved.

use std::f64::consts::{PI, TAU};

use nalgebra::{Complex, DMatrix, DVector};
use plid_gap::effects::{Library, Place};
use plid_gap::research::{Fineness, simulate};
use plid_model::held;

use super::Rig;
use crate::truss::RATE;

type C = Complex<f64>;

/// Number of samples of the analysis period, which contains whole numbers of cycles of all tones.
const PERIOD: usize = 1600;

/// Number of periods before it: thirty time constants of the slowest mode here.
const WAIT: usize = 3;

struct Describing {
    effect: &'static str,
    /// Parameters for amplitude A and speed V of the linear motion.
    parameters: fn(f64, f64) -> Vec<f64>,
    /// k_eq and c_eq for parameters, A and V.
    equivalent: fn(&[f64], f64, f64) -> (f64, f64),
}

/// Largest disagreement. Forces are about one per cent of the command. The neglected part, the effect of the harmonics
/// on the fundamental, is of second order in them: half a per cent of the effect or less.
const ALL: [Describing; 4] = [
    Describing {
        effect: "cubic-stiffness",
        parameters: |a, _| vec![0.01 / a.powi(3)],
        equivalent: |p, a, _| (0.75 * p[0] * a * a, 0.0),
    },
    Describing {
        effect: "quadratic-damping",
        parameters: |_, v| vec![0.01 / v.powi(2)],
        equivalent: |p, _, v| (0.0, 8.0 / (3.0 * PI) * p[0] * v),
    },
    Describing {
        effect: "coulomb-friction",
        // v0 is so small that the force is a step for all but 1 / 300 of the time.
        parameters: |_, v| vec![0.01, 0.003 * v],
        equivalent: |p, _, v| (0.0, 4.0 * p[0] / (PI * v)),
    },
    Describing {
        effect: "clearance",
        parameters: |a, _| vec![0.02 / a, 0.4 * a],
        equivalent: |p, a, _| {
            let s = p[1] / a;
            (p[0] * (1.0 - 2.0 / PI * (s.asin() + s * (1.0 - s * s).sqrt())), 0.0)
        },
    },
];

/// Returns complex amplitudes of (d, outputs) for a unit command held over samples, with a spring and a damper at the
/// port.
fn response(rig: &Rig, input: usize, hz: f64, k: f64, c: f64) -> (C, Vec<C>) {
    let time = rig.model.continuous.as_ref().unwrap();
    let port = &rig.model.ports[input];
    let n = time.a.nrows();
    let (force, d, v) = (
        DVector::from_column_slice(&port.force),
        DVector::from_column_slice(&port.displacement),
        DVector::from_column_slice(&port.velocity),
    );
    let a = &time.a - &force * (d.transpose() * k + v.transpose() * c);
    let s = C::new(0.0, TAU * hz);
    // The fundamental of the staircase.
    let half = PI * hz / RATE;
    let hold = C::cis(-half) * (half.sin() / half);
    let shifted = DMatrix::from_diagonal_element(n, n, s) - a.map(C::from);
    let x = shifted.lu().solve(&time.b.column(input).map(|b| hold * b)).unwrap();
    // At the samples the images of the staircase count too.
    let (step, add) = held(&a, &time.b, 1.0 / RATE);
    let shifted = DMatrix::from_diagonal_element(n, n, C::cis(TAU * hz / RATE)) - step.map(C::from);
    let sampled = shifted.lu().solve(&add.column(input).map(C::from)).unwrap();
    let y = rig.model.c.map(C::from) * sampled;
    (d.map(C::from).dot(&x), y.iter().copied().collect())
}

/// Returns the complex amplitude of the last period at a frequency.
fn fundamental(y: &[f64], hz: f64) -> C {
    let from = y.len() - PERIOD;
    let sum: C = (from..y.len()).map(|k| C::cis(-TAU * hz * k as f64 / RATE) * y[k]).sum();
    sum * (2.0 / PERIOD as f64)
}

#[test]
fn near_resonance_forces_are_their_describing_functions() {
    let library = Library::standard();
    let rig = Rig::with(7, |truss| truss.modes.iter_mut().for_each(|mode| mode.1 = 0.03));
    let (input, hz) = (1, 137.0);
    for describing in ALL {
        let (d, linear) = response(&rig, input, hz, 0.0, 0.0);
        let parameters = (describing.parameters)(d.norm(), TAU * hz * d.norm());
        let (mut amplitude, mut expected) = (d.norm(), linear.clone());
        for _ in 0..200 {
            let (k, c) = (describing.equivalent)(&parameters, amplitude, TAU * hz * amplitude);
            let (d, y) = response(&rig, input, hz, k, c);
            (amplitude, expected) = (0.5 * (amplitude + d.norm()), y);
        }
        let samples = (WAIT + 1) * PERIOD;
        let mut u = vec![vec![0.0; samples]; 2];
        u[input] = (0..samples).map(|k| (TAU * hz * k as f64 / RATE).cos()).collect();
        let effect = library.get(describing.effect).unwrap();
        let actions = effect.act(&rig.setting, &Place::Input(input), &parameters);
        let y = simulate(&rig.plant, &actions, &u, 0.0, None, Fineness::FINE);
        let (mut far, mut changed) = (0.0, 0.0);
        for o in 0..2 {
            far += (fundamental(&y[o], hz) - expected[o]).norm_sqr();
            changed += (expected[o] - linear[o]).norm_sqr();
        }
        let far = (far / changed).sqrt();
        println!("{:20} {far:.1e}", describing.effect);
        assert!(far < 5e-3, "{}: {far:.2e}", describing.effect);
    }
}
