//! Effects on a sensor: the table's equations on the samples of the linear simulation.

use std::f64::consts::TAU;

use plid_gap::effects::{Action, Effect, Memory, Place, Sampling};

use super::{Check, Rig, T0};
use crate::truss::RATE;
use crate::truth;

/// Both sides use the same arithmetic. The disagreement is the rounding of the modal form, relative to a small effect.
pub const CHECKS: &[Check] = &[
    Check { effect: "sensor-saturation", limit: 1e-6, measure: saturation },
    Check { effect: "sensor-gain", limit: 1e-6, measure: |effect| fixed(effect, &[0.94], |p, y, _| p[0] * y) },
    Check { effect: "sensor-offset", limit: 1e-6, measure: |effect| fixed(effect, &[-0.03], |p, y, _| y + p[0]) },
    Check { effect: "sensor-drift", limit: 1e-6, measure: |effect| fixed(effect, &[0.004], |p, y, t| y + p[0] * t) },
    Check {
        effect: "mains-hum",
        limit: 1e-6,
        measure: |effect| {
            fixed(effect, &[0.03, 50.02, 0.7, 0.004, 2.0, 0.01, -1.1, 0.006, 0.3], |p, y, t| {
                let line = |h: f64, a: f64, phase: f64| a * (TAU * h * p[1] * t + phase).sin();
                y + line(1.0, p[0], p[2]) + line(2.0, p[3], p[4]) + line(3.0, p[5], p[6]) + line(5.0, p[7], p[8])
            })
        },
    },
    Check { effect: "sensor-lag", limit: 1e-6, measure: lag },
    Check { effect: "sensor-crosstalk", limit: 1e-6, measure: crosstalk },
    // The bursts are band-limited and at rest at both ends. The delay is exact except for the tails, which are below
    // 1e-10 of the peak.
    Check { effect: "sensor-delay", limit: 1e-8, measure: delay },
];

/// The output that changes.
const OUTPUT: usize = 1;

/// A curve as a function of one output and of time.
fn fixed(effect: &dyn Effect, parameters: &[f64], curve: fn(&[f64], f64, f64) -> f64) -> f64 {
    let rig = Rig::new(21);
    let mut y = rig.linear.clone();
    y[OUTPUT].iter_mut().enumerate().for_each(|(k, y)| *y = curve(parameters, *y, T0 + k as f64 / RATE));
    rig.disagreement(&rig.simulated(effect, &Place::Output(OUTPUT), parameters, T0), &y)
}

/// At 1.5 times the output's RMS.
fn saturation(effect: &dyn Effect) -> f64 {
    let rig = Rig::new(22);
    let a = 1.5 * truth::size(&rig.linear[OUTPUT..=OUTPUT]);
    let mut y = rig.linear.clone();
    for y in &mut y[OUTPUT] {
        if *y > a {
            *y = a;
        } else if *y < -a {
            *y = -a;
        }
    }
    rig.disagreement(&rig.simulated(effect, &Place::Output(OUTPUT), &[a], T0), &y)
}

/// The recursion written as a sum: y'_k = (1 - al) sum of al^j y_{k-j}.
fn lag(effect: &dyn Effect) -> f64 {
    let rig = Rig::new(23);
    let fc = 300.0;
    let al = (-TAU * fc / RATE).exp();
    let mut y = rig.linear.clone();
    y[OUTPUT] = (0..rig.linear[OUTPUT].len())
        .map(|k| (0..=k).map(|j| (1.0 - al) * al.powi(j as i32) * rig.linear[OUTPUT][k - j]).sum())
        .collect();
    rig.disagreement(&rig.simulated(effect, &Place::Output(OUTPUT), &[fc], T0), &y)
}

/// From the second output into the first; the second is unchanged.
fn crosstalk(effect: &dyn Effect) -> f64 {
    let rig = Rig::new(24);
    let mut y = rig.linear.clone();
    y[0].iter_mut().zip(&rig.linear[1]).for_each(|(y, from)| *y += 0.05 * from);
    rig.disagreement(&rig.simulated(effect, &Place::OutputToOutput(1, 0), &[0.05], T0), &y)
}

/// Bursts of tones up to 700 Hz, whose values between the samples are known: y(t_k - tau) is y' at t_k for any tau.
fn delay(effect: &dyn Effect) -> f64 {
    let rig = Rig::new(25);
    let samples = 1500;
    let burst = |at: f64| {
        // At 700 Hz the burst's spectrum, 13 Hz wide (one sigma), ends seven sigma before half the sample rate.
        let away = (at - 750.0) / (0.012 * RATE);
        let tones = [(31.0, 1.0), (137.0, 0.7), (402.0, 0.5), (700.0, 0.3)];
        tones.iter().map(|(hz, a)| a * (TAU * hz * at / RATE + hz).sin()).sum::<f64>() * (-0.5 * away * away).exp()
    };
    let record: Vec<f64> = (0..samples).map(|k| burst(k as f64)).collect();
    let one = |tau: f64| {
        let truth: Vec<f64> = (0..samples).map(|k| burst(k as f64 - tau)).collect();
        let mut y = vec![record.clone(); 2];
        for action in effect.act(&rig.setting, &Place::Output(OUTPUT), &[tau]) {
            let Action::Sensor(sensor) = action else { panic!("a delay acts on the samples") };
            sensor.apply(&mut y, Sampling { t0: T0, rate: RATE, at_rest: true }, &mut Memory::default());
        }
        assert_eq!(y[0], record, "the other output is unchanged");
        let changed = truth::size(&truth::minus(std::slice::from_ref(&truth), std::slice::from_ref(&record)));
        truth::size(&truth::minus(&y[OUTPUT..=OUTPUT], &[truth])) / changed
    };
    [0.13, 0.5, 1.6, 3.0].into_iter().map(one).fold(0.0, f64::max)
}
