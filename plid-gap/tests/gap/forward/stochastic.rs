//! Stochastic effects: no free run shows them, and their parameters are estimated from the records.
//!
//! A disagreement is that of the estimated parameter with the planted one, in records that are drawn.

use std::f64::consts::TAU;

use plid_gap::effects::{Action, Effect, Library};

use plid_gap::case::{Excitation, Record};
use plid_gap::research::{Fineness, Known, Prepared, prepare, simulate, stochastic_effects};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::{Check, Rig, T0, noise};
use crate::truss::RATE;
use crate::truth::{self, Channels, Equations, Push};

/// A variance of 4096 samples is known to 2.2 %, a standard deviation to 1.1 %: the limit is three of those, and as
/// much for the other sensor's. Some dropouts begin where the signal hardly moves. A band is found on a grid of centres
/// (6 %) and widths (5 and 20 %, while the planted one has 10 %), and half a second contains some fifty of its
/// correlation times.
pub const CHECKS: &[Check] = &[
    Check { effect: "sensor-noise", limit: 0.05, measure: sensor_noise },
    Check { effect: "sensor-quantisation", limit: 0.05, measure: quantisation },
    Check { effect: "sensor-dropout", limit: 0.1, measure: dropout },
    Check { effect: "coloured-disturbance", limit: 0.15, measure: coloured },
];

/// Number of samples of a record.
const LONG: usize = 4096;

/// Standard deviation of the declared noise over the outputs' RMS.
const DECLARED: f64 = 0.01;

/// The number of the record without input.
const QUIET: usize = 0;

/// The number of the record with input that is not held out.
const FITTED: usize = 1;

/// Records with and without input: `push` is added to the structure, and `raw` converts the noisy samples (record,
/// outputs, noise).
fn records(
    rig: &Rig,
    std: f64,
    push: Option<&dyn Fn(usize) -> f64>,
    raw: &mut dyn FnMut(usize, &mut Channels),
) -> Vec<Record> {
    let time = rig.model.continuous.as_ref().unwrap();
    let c = |_: f64| rig.model.c.clone();
    let levels: [(f64, Excitation); 3] =
        [(0.0, Excitation::Zero), (1.0, Excitation::Random), (0.5, Excitation::Random)];
    let mut records = Vec::new();
    for (index, (level, excitation)) in levels.into_iter().enumerate() {
        let mut u = noise(50 + index as u64, 2, LONG);
        u.iter_mut().flatten().for_each(|u| *u *= level);
        let mut y = match push {
            None => truth::linear(&rig.model, &u),
            Some(push) => {
                let force = |k: usize| push(index * LONG + k);
                let push = Push { port: &rig.model.ports[0], force: &force };
                let equations =
                    Equations { a: &time.a, b: &time.b, c: &c, stiffening: None, joint: None, push: Some(push) };
                equations.run(0.0, LONG, |k| u.iter().map(|u| u[k]).collect(), 1e-7).y
            }
        };
        let declared = noise(60 + index as u64, 2, LONG);
        y.iter_mut().zip(&declared).for_each(|(y, e)| y.iter_mut().zip(e).for_each(|(y, e)| *y += std * e));
        raw(index, &mut y);
        records.push(Record {
            name: format!("record-{index}"),
            excitation,
            from_rest: true,
            start_s: (index * LONG) as f64 / RATE,
            held_out: index > FITTED,
            u,
            y,
            simulated: None,
        });
    }
    records
}

/// A rig with declared noise, and its standard deviation.
fn declared(seed: u64) -> (Rig, f64) {
    let mut rig = Rig::new(seed);
    let std = DECLARED * truth::size(&rig.linear);
    rig.model.noise.sensor_std = Some(vec![std; 2]);
    rig.model.noise.actuator_std = Some(vec![0.0; 2]);
    (rig, std)
}

fn run(rig: &Rig, actions: &[Action]) -> Channels {
    simulate(&rig.plant, actions, &rig.u, T0, None, Fineness::FINE)
}

/// The estimate of one effect: parameters of the first, which must be at the first output or port.
fn found(rig: &Rig, effect: &dyn Effect, records: &[Record]) -> (Vec<f64>, Prepared) {
    let mut ready = prepare(&rig.model, records, &Known::default()).unwrap();
    let library = Library::standard();
    let eta = vec![0.0; ready.problem.nuisance.len()];
    let given = |k: usize| ready.problem.outputs(&ready.problem.plant, &eta, &[], k, Fineness::FINE);
    let simulated: Vec<Channels> = (0..ready.problem.records.len()).map(given).collect();
    ready.renew_band(&simulated);
    let all = stochastic_effects(&ready, &library);
    let locations: Vec<(String, String)> = all
        .iter()
        .map(|found| (found.placed.effect.name().to_string(), found.placed.place.location(&rig.setting.names)))
        .collect();
    assert_eq!(all.len(), 1, "{locations:?}");
    let one = &all[0].placed;
    assert_eq!(one.effect.name(), effect.name());
    let place = if effect.name() == "coloured-disturbance" { "freq:" } else { "output:y1" };
    assert!(locations[0].1.starts_with(place), "{locations:?}");
    let free_run = run(rig, &effect.act(&rig.setting, &one.place, &one.parameters));
    let mut expected = run(rig, &[]);
    if let ("sensor-quantisation", &[q, cut]) = (effect.name(), one.parameters.as_slice()) {
        // Truncation reduces larger values by this much on average.
        expected[0].iter_mut().for_each(|y| *y = y.signum() * (y.abs() - cut * q).max(0.0));
    }
    let same = free_run.iter().flatten().zip(expected.iter().flatten()).all(|(a, b)| (a - b).abs() < 1e-12);
    assert!(same, "a free run shows something else");
    (one.parameters.clone(), ready)
}

/// White noise of twice the declared standard deviation in addition to it: variances add.
fn sensor_noise(effect: &dyn Effect) -> f64 {
    let (rig, std) = declared(51);
    let more = noise(70, 3, LONG);
    let records = records(&rig, std, None, &mut |index, y| {
        y[0].iter_mut().zip(&more[index]).for_each(|(y, e)| *y += 2.0 * std * e);
    });
    let (parameters, ready) = found(&rig, effect, &records);
    let variance = ready.noise.sensors()[0] / (std * std * (1.0 + 4.0)) - 1.0;
    (parameters[0] / (2.0 * std) - 1.0).abs().max(variance.abs())
}

/// Rounding and truncation to a step. The step is found to rounding, and so is the kind. The noise model's q^2 / 12 is
/// that of a signal of many steps, once half a step has been added to truncated values.
fn quantisation(effect: &dyn Effect) -> f64 {
    let off = |cut: f64, law: fn(f64) -> f64| {
        let (rig, std) = declared(52);
        let q = 8.0 * std;
        let mut lost = Vec::new();
        let records = records(&rig, std, None, &mut |index, y| {
            for y in &mut y[0] {
                let code = q * law(*y / q);
                if index != QUIET {
                    lost.push(code + cut * q * y.signum() - *y);
                }
                *y = code;
            }
        });
        let (parameters, ready) = found(&rig, effect, &records);
        assert!((parameters[0] / q - 1.0).abs() < 1e-9, "{}", parameters[0] / q);
        assert_eq!(parameters[1], cut);
        let drawn = lost.iter().map(|e| e * e).sum::<f64>() / lost.len() as f64;
        let claimed = ready.noise.sensors()[0] - std * std;
        (claimed / drawn - 1.0).abs()
    };
    off(0.0, f64::round).max(off(0.5, f64::trunc))
}

/// Dropouts at random instants, three samples long.
fn dropout(effect: &dyn Effect) -> f64 {
    let (rig, std) = declared(53);
    let mut rng = ChaCha8Rng::seed_from_u64(71);
    let (rate, mut onsets) = (0.01, 0);
    let records = records(&rig, std, None, &mut |index, y| {
        let mut k = 1;
        while k + 3 < LONG {
            if rng.random::<f64>() < rate {
                onsets += i32::from(index == FITTED);
                let last = y[0][k - 1];
                y[0][k..k + 3].fill(last);
                k += 4;
            }
            k += 1;
        }
    });
    let (parameters, _) = found(&rig, effect, &records);
    let planted = f64::from(onsets) / LONG as f64;
    (parameters[0] / planted - 1.0).abs()
}

/// The response of a resonator to white noise, a tenth of its frequency wide, scaled to its standard deviation.
fn coloured(effect: &dyn Effect) -> f64 {
    let (rig, std) = declared(54);
    let (f, a) = (95.0, 0.2);
    let white = noise(72, 1, 3 * LONG + 2000).remove(0);
    let (r, turn) = ((-0.5 * 0.1 * TAU * f / RATE).exp(), (TAU * f / RATE).cos());
    let mut band = vec![0.0; white.len()];
    for k in 2..white.len() {
        band[k] = 2.0 * r * turn * band[k - 1] - r * r * band[k - 2] + white[k] - white[k - 2];
    }
    let band = &band[2000..];
    let scale = a / (band.iter().map(|x| x * x).sum::<f64>() / band.len() as f64).sqrt();
    let records = records(&rig, std, Some(&|k| scale * band[k]), &mut |_, _| {});
    let (parameters, _) = found(&rig, effect, &records);
    (parameters[0] / a - 1.0).abs().max((parameters[1] / f - 1.0).abs())
}
