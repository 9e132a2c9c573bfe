//! Tests of the forces at a strut of a truss with one mode. Its free motion is known in closed form to first order:
//! in volts, d" + 2 zeta w d' + w^2 (d - f) = 0.

use std::f64::consts::PI;

use crate::config::{EffectsConfig, TrussConfig};
use crate::effects::chain::{Clock, dot};
use crate::effects::law::Plant;
use crate::effects::{self, Effect};
use crate::integrator::Integrator;
use crate::plant::assemble;
use crate::structure::{Mode, ModeGroup};
use crate::{ACTUATOR_POLE_HZ, INPUTS};

const HZ: f64 = 100.0;
const W: f64 = 2.0 * PI * HZ;
/// Samples per second: 40 per period.
const RATE: f64 = 4000.0;

/// Returns the displacement at the samples of an undamped mode with one effect, released at rest from `start` (V).
fn free(effect: &str, start: f64, samples: usize) -> Vec<f64> {
    #[derive(serde::Deserialize)]
    struct One {
        effect: Effect,
    }
    let one: One = toml::from_str(&format!("[effect]\nat = \"u1\"\n{effect}")).unwrap();
    let effects = EffectsConfig { list: vec![one.effect], steps_per_sample: 16, ..EffectsConfig::default() };
    let config = TrussConfig { sample_rate_hz: RATE, effects, ..TrussConfig::default() };
    let mode = Mode {
        frequency_hz: HZ,
        damping_ratio: 1e-12,
        input_shape: [0.3, 0.0, 0.0],
        output_shape: [0.2, 0.1, 0.0],
        group: ModeGroup::Dominant,
    };
    let mut truss = assemble(&config, Plant::of_modes(vec![mode], [ACTUATOR_POLE_HZ; INPUTS]));
    // The other two struts do not take part: the mode does not move them.
    truss.ports.truncate(1);
    let port = truss.ports[0].clone();
    let clock = Clock { record: 0, start: 0, sample_rate_hz: RATE };
    let mut chain = effects::chain(&config.effects, &truss, 1, clock);
    let mut integrator = Integrator::new(&truss, &mut chain, 16);
    let mut x = integrator.at_rest();
    let state = port.displacement.iter().position(|d| *d != 0.0).unwrap();
    x[state] = start / port.displacement[state];
    (0..samples)
        .map(|k| {
            let d = dot(&port.displacement, &x);
            integrator.advance(&mut x, [0.0; 3], clock.time_s(k));
            d
        })
        .collect()
}

/// Returns the frequency between the first and the last upward crossing of the mean, Hz.
fn frequency(d: &[f64]) -> f64 {
    let mean = (d.iter().fold(f64::MIN, |a, b| a.max(*b)) + d.iter().fold(f64::MAX, |a, b| a.min(*b))) / 2.0;
    let crossings: Vec<f64> = (1..d.len())
        .filter(|k| d[k - 1] < mean && d[*k] >= mean)
        .map(|k| (k - 1) as f64 + (mean - d[k - 1]) / (d[k] - d[k - 1]))
        .collect();
    RATE * (crossings.len() - 1) as f64 / (crossings[crossings.len() - 1] - crossings[0])
}

/// Returns the amplitude at the end of each period, from the displacement and its neighbours, because the samples may
/// miss the peak.
fn amplitudes(d: &[f64], frequency_hz: f64) -> Vec<f64> {
    let step = 2.0 * PI * frequency_hz / RATE;
    let period = (RATE / frequency_hz).round() as usize;
    (period..d.len() - 1).step_by(period).map(|k| d[k].hypot((d[k + 1] - d[k - 1]) / (2.0 * step.sin()))).collect()
}

#[test]
fn cubic_stiffness_shifts_the_frequency_by_three_eighths() {
    for (k, amplitude) in [(1e-3, 2.0), (-1e-3, 2.0), (1e-3, 4.0)] {
        let d = free(&format!("kind = \"cubic-stiffness\"\nstiffness_per_v2 = {k}"), amplitude, 4000);
        let shift = frequency(&d) / HZ - 1.0;
        let expected = 3.0 / 8.0 * k * amplitude * amplitude;
        assert!((shift / expected - 1.0).abs() < 0.02, "{shift}, to first order {expected}");
    }
}

#[test]
fn quadratic_stiffness_shifts_the_mean_against_its_sign() {
    let d = free("kind = \"quadratic-stiffness\"\nstiffness_per_v = 1e-3", 2.0, 4000);
    let mean = d.iter().sum::<f64>() / d.len() as f64;
    assert!((mean / (-1e-3 * 4.0 / 2.0) - 1.0).abs() < 0.02, "{mean}");
}

#[test]
fn coulomb_friction_takes_four_times_its_force_from_each_period() {
    let d = free("kind = \"coulomb-friction\"\nfriction_v = 0.01\ntransition_v_per_s = 0.5", 2.0, 40 * 30);
    let a = amplitudes(&d, HZ);
    for pair in a.windows(2) {
        let loss = pair[0] - pair[1];
        assert!((loss / 0.04 - 1.0).abs() < 0.05, "{loss} where 0.04 is expected");
    }
}

#[test]
fn quadratic_damping_takes_its_share_of_the_amplitude_squared() {
    let c = 1e-7;
    let d = free(&format!("kind = \"quadratic-damping\"\ndamping_s2_per_v = {c}"), 2.0, 40 * 20);
    let a = amplitudes(&d, HZ);
    for pair in a.windows(2) {
        let mean = (pair[0] + pair[1]) / 2.0;
        let expected = 8.0 / 3.0 * c * W * W * mean * mean;
        let loss = pair[0] - pair[1];
        assert!((loss / expected - 1.0).abs() < 0.05, "{loss}, {expected}");
    }
}

#[test]
fn a_gap_does_nothing_within_and_is_a_spring_far_beyond() {
    let within = free("kind = \"clearance\"\nstiffness = 0.1\ngap_v = 2.5", 2.0, 4000);
    assert!((frequency(&within) / HZ - 1.0).abs() < 1e-6);
    let beyond = free("kind = \"clearance\"\nstiffness = 0.1\ngap_v = 1e-4", 2.0, 4000);
    assert!((frequency(&beyond) / HZ / 1.1_f64.sqrt() - 1.0).abs() < 1e-3);
}

/// In a cycle of amplitude A, a joint dissipates 4 R A^(3 + chi) / ((2 + chi) (3 + chi)) (Segalman 2005), and a mode
/// loses w^2 times that. If the plant already contains the joint as a spring, the frequency does not change while the
/// joint slips little.
#[test]
fn an_iwan_joint_takes_a_power_of_the_amplitude_from_each_period() {
    let (k, slip, chi) = (0.002, 3.0_f64, -0.4);
    let joint = format!("kind = \"iwan-joint\"\nstiffness = {k}\nslip_v = {slip}\nexponent = {chi}");
    let d = free(&joint, 2.0, 40 * 20);
    let a = amplitudes(&d, frequency(&d));
    for pair in a.windows(2).skip(2) {
        let mean = (pair[0] + pair[1]) / 2.0;
        let density = k * (1.0 + chi) / slip.powf(1.0 + chi);
        let expected = 4.0 * density * mean.powf(2.0 + chi) / ((2.0 + chi) * (3.0 + chi));
        let loss = pair[0] - pair[1];
        assert!((loss / expected - 1.0).abs() < 0.05, "{loss}, {expected}");
    }
    let stiff = |held: &str, slip: f64| {
        let joint = format!("kind = \"iwan-joint\"\nstiffness = 0.1\nslip_v = {slip}\nexponent = 0.0\n{held}");
        frequency(&free(&joint, 2.0, 4000)) / HZ
    };
    assert!((stiff("", 1e4) / 1.1_f64.sqrt() - 1.0).abs() < 1e-3 && (stiff("held = 1.0", 1e4) - 1.0).abs() < 1e-3);
    assert!((stiff("held = 1.0", 1e-4) / 0.9_f64.sqrt() - 1.0).abs() < 1e-3);
}

/// The area of the steady loop of z over the displacement is known in closed form: z unloads linearly from -Z to 0
/// over Z, then follows dy (1 - exp(-x / dy)) over the remaining length L of the stroke 2 A. A mode loses w^2 k times
/// this area in a period.
#[test]
fn joint_hysteresis_takes_the_area_of_its_loop_from_each_period() {
    let (k, dy, stroke) = (0.002, 0.5, 2.0);
    let d = free(&format!("kind = \"joint-hysteresis\"\nstiffness = {k}\nyield_v = {dy}"), stroke, 40 * 12);
    let a = amplitudes(&d, frequency(&d));
    for pair in a.windows(2).skip(2) {
        let mean = (pair[0] + pair[1]) / 2.0;
        let mut z: f64 = 0.0;
        for _ in 0..100 {
            z = dy * (1.0 - (-(2.0 * mean - z) / dy).exp());
        }
        let left = 2.0 * mean - z;
        let area = 2.0 * (dy * (left - dy * (1.0 - (-left / dy).exp())) - z * z / 2.0);
        let expected = k * area / mean;
        let loss = pair[0] - pair[1];
        assert!((loss / expected - 1.0).abs() < 0.05, "{loss}, {expected}");
    }
    // Long before it yields, the joint is a spring, which the plant may already contain.
    let small = free(&format!("kind = \"joint-hysteresis\"\nstiffness = 0.1\nyield_v = {}", 1e4), 2.0, 4000);
    assert!((frequency(&small) / HZ / 1.1_f64.sqrt() - 1.0).abs() < 1e-3);
    let held = free(&format!("kind = \"joint-hysteresis\"\nstiffness = 0.1\nheld = 1.0\nyield_v = {}", 1e4), 2.0, 4000);
    assert!((frequency(&held) / HZ - 1.0).abs() < 1e-3);
}

/// The mode on a joint of which the plant contains a share as a spring.
struct OnJoint {
    k: f64,
    dy: f64,
    held: f64,
}

impl ode_solvers::System<f64, ode_solvers::Vector3<f64>> for OnJoint {
    fn system(&self, _t: f64, x: &ode_solvers::Vector3<f64>, rate: &mut ode_solvers::Vector3<f64>) {
        let (d, v, z) = (x[0], x[1], x[2]);
        rate[0] = v;
        rate[1] = W * W * (self.k * (self.held * d - z) - d);
        rate[2] = v - (v.abs() * z + v * z.abs()) / (2.0 * self.dy);
    }
}

/// The motion is that of another library's integrator, whatever share of the joint's stiffness the plant contains.
#[test]
fn a_joint_moves_the_mode_as_another_integrator_says() {
    const SAMPLES: usize = 400;
    let (k, dy, start) = (0.2, 0.8, 2.0);
    for held in [0.0, 0.6, 1.0] {
        let joint = format!("kind = \"joint-hysteresis\"\nstiffness = {k}\nyield_v = {dy}\nheld = {held}");
        let found = free(&joint, start, SAMPLES);
        let (end, step) = ((SAMPLES - 1) as f64 / RATE, 1.0 / RATE);
        let state = ode_solvers::Vector3::new(start, 0.0, 0.0);
        let mut truth = ode_solvers::Dop853::new(OnJoint { k, dy, held }, 0.0, end, step, state, 1e-10, 1e-10);
        truth.integrate().unwrap();
        let mut changed = 0.0_f64;
        for (t, x) in truth.x_out().iter().zip(truth.y_out()) {
            let d = found[(t * RATE).round() as usize];
            assert!((d - x[0]).abs() < 1e-3, "{held} at {t}: {d} and {}", x[0]);
            changed = changed.max((d - start * (W * t).cos()).abs());
        }
        assert!(changed > 0.5, "{held}: the joint changes the motion by {changed} only");
    }
}
