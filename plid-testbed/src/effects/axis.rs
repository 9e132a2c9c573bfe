//! Tests of the forces on an axis whose motion is known in closed form.

use std::f64::consts::{PI, TAU};

use crate::axes::{Axes, Shown};
use crate::config::{EffectsConfig, TrussConfig};
use crate::effects::chain::Clock;
use crate::effects::law::Plant;
use crate::effects::{self, Effect};
use crate::integrator::Integrator;
use crate::plant::{Truss, altered, assemble};
use crate::structure::{Mode, ModeGroup};
use crate::{ACTUATOR_POLE_HZ, INPUTS};

/// Samples per second.
const RATE: f64 = 500.0;
const STEPS: usize = 32;

fn config(effect: &str) -> TrussConfig {
    #[derive(serde::Deserialize)]
    struct One {
        effect: Effect,
    }
    let one: One = toml::from_str(&format!("[effect]\nat = \"u1\"\n{effect}")).unwrap();
    let effects = EffectsConfig { list: vec![one.effect], steps_per_sample: STEPS, ..EffectsConfig::default() };
    TrussConfig { sample_rate_hz: RATE, effects, ..TrussConfig::default() }
}

/// Returns position and velocity at the samples, from an initial state, of an axis with an effect and a command.
fn run(axes: Axes, effect: &str, start: [f64; 2], samples: usize, command: impl Fn(usize) -> f64) -> Vec<[f64; 2]> {
    let config = config(effect);
    let truss = altered(&config, &assemble(&config, Plant::of_axes(axes)));
    let clock = Clock { record: 0, start: 0, sample_rate_hz: RATE };
    let mut chain = effects::chain(&config.effects, &truss, 1, clock);
    let mut integrator = Integrator::new(&truss, &mut chain, STEPS);
    let mut x = integrator.at_rest();
    x[..2].copy_from_slice(&start);
    (0..samples)
        .map(|k| {
            let now = [x[0], x[1]];
            integrator.advance(&mut x, [command(k), 0.0, 0.0], clock.time_s(k));
            now
        })
        .collect()
}

fn slider() -> Axes {
    Axes::single(0.0, 0.0, Shown::Position)
}

const STICKS: &str = "kind = \"stick-friction\"\nslides_v = 0.8\nholds_v = 1.1\ntransition_v_per_s = 0.02";

/// Below the holding force the axis does not move at all; above it, the axis breaks away.
#[test]
fn friction_holds_up_to_its_limit() {
    // 1.1 V in 1100 samples.
    let moved = run(slider(), STICKS, [0.0; 2], 1300, |k| k as f64 / 1100.0 * 1.1);
    assert!(moved[..1100].iter().all(|[d, v]| d.abs() < 1e-15 && v.abs() < 1e-15));
    // Without the fall of the friction, the velocity after 0.2 s would be 0.5 V/s t^2 / 2 = 0.01 V/s.
    assert!(moved[1200][1] > 0.01, "{:?}", moved[1200]);
}

/// The friction Fc brakes a sliding axis, which stops after v^2 / (2 Fc), up to the length of a step, and stays
/// there.
#[test]
fn friction_stops_what_slides() {
    let law = "kind = \"stick-friction\"\nslides_v = 0.8\nholds_v = 0.8\ntransition_v_per_s = 0.02";
    let moved = run(slider(), law, [0.0, 1.0], 1000, |_| 0.0);
    let [d, v] = moved[999];
    assert_eq!(v, 0.0);
    assert!((d / (1.0 / 1.6) - 1.0).abs() < 1e-3, "{d}");
    assert!((moved[300][1] - (1.0 - 0.8 * 300.0 / RATE)).abs() < 1e-4, "{:?}", moved[300]);
}

/// A hard stop without a damper returns the speed, after half a period of the bounce.
#[test]
fn a_stop_gives_the_speed_back() {
    let w: f64 = TAU * 20.0;
    let law = format!("kind = \"end-stop\"\nstiffness = {}\ndamping_s = 0.0\ngap_v = 0.1", w * w);
    let moved = run(slider(), &law, [0.0, 1.0], 200, |_| 0.0);
    let deepest = moved[..80].iter().fold(0.0_f64, |most, [d, _]| most.max(*d));
    assert!((deepest - (0.1 + 1.0 / w)).abs() < 1e-4, "{deepest}");
    assert!((moved[100][1] + 1.0).abs() < 1e-3, "{:?}", moved[100]);
    // 0.1 s to the stop, pi / w on it, and then back.
    let expected = 0.1 - (100.0 / RATE - 0.1 - PI / w);
    assert!((moved[100][0] - expected).abs() < 1e-3, "{:?}, not {expected}", moved[100]);
    // There is another stop on the other side, or none if the stop is one-sided.
    assert!(moved.iter().all(|[d, _]| *d > -0.12) && moved.iter().any(|[d, _]| *d < -0.1), "{moved:?}");
    let one = law.replace("end-stop", "one-sided-stop");
    assert!(run(slider(), &one, [0.0, 1.0], 200, |_| 0.0).iter().any(|[d, _]| *d < -0.09));
    let below = one.replace("gap_v = 0.1", "gap_v = -0.1");
    assert!((run(slider(), &below, [0.0, 1.0], 200, |_| 0.0)[199][1] - 1.0).abs() < 1e-9);
}

/// The damper of a stop does not pull back an axis that leaves the stop.
#[test]
fn a_stop_never_pulls() {
    let law = "kind = \"end-stop\"\nstiffness = 1000.0\ndamping_s = 200.0\ngap_v = 0.1";
    let moved = run(slider(), law, [0.0, 1.0], 2000, |_| 0.0);
    assert!(moved.windows(2).skip(150).all(|w| w[1][1] <= w[0][1] + 1e-12), "it is held back");
}

/// Within the gap, the joint is free. Beyond it, the original spring acts from the edge of the gap.
#[test]
fn backlash_frees_the_joint() {
    let w: f64 = TAU * 10.0;
    let joint = Axes::single(0.0, w * w, Shown::Position);
    let law = format!("kind = \"backlash\"\nstiffness = {}\ngap_v = 0.1", w * w);
    let moved = run(joint, &law, [0.0, 1.0], 200, |_| 0.0);
    assert!((moved[40][0] - 40.0 / RATE).abs() < 1e-9 && (moved[40][1] - 1.0).abs() < 1e-9, "{:?}", moved[40]);
    let largest = moved.iter().fold(0.0_f64, |most, [d, _]| most.max(*d));
    assert!((largest - (0.1 + 1.0 / w)).abs() < 1e-4, "{largest}");
}

/// A pendulum that swings by a has T / T0 = 1 + a^2 / 16 + 11 a^4 / 3072 + 173 a^6 / 737280.
#[test]
fn a_pendulum_swings_more_slowly_the_farther_it_swings() {
    let w: f64 = TAU;
    for a in [0.2_f64, 0.6, 1.0] {
        let law = format!("kind = \"gravity-sine\"\nstiffness = {0}\nwhole = {0}", w * w);
        let moved = run(Axes::single(0.0, w * w, Shown::Position), &law, [a, 0.0], 6000, |_| 0.0);
        let upward: Vec<f64> = (1..moved.len())
            .filter(|k| moved[k - 1][0] < 0.0 && moved[*k][0] >= 0.0)
            .map(|k| k as f64 - moved[k][0] / (moved[k][0] - moved[k - 1][0]))
            .collect();
        let period_s = (upward[upward.len() - 1] - upward[0]) / (upward.len() - 1) as f64 / RATE;
        let expected = 1.0 + a * a / 16.0 + 11.0 / 3072.0 * a.powi(4) + 173.0 / 737_280.0 * a.powi(6);
        assert!((period_s / expected - 1.0).abs() < 1e-4, "{a}: {period_s}, not {expected}");
    }
}

fn poles(truss: &Truss) -> Vec<f64> {
    let mut sizes: Vec<f64> = truss.continuous.a.complex_eigenvalues().iter().map(|pole| pole.norm()).collect();
    sizes.sort_by(f64::total_cmp);
    sizes
}

/// A mass, a damper or a spring at a port has the same effect as one that belongs to the axis.
#[test]
fn a_load_is_the_axis_with_more_of_it() {
    let axis = |m: f64, c: f64, k: f64| {
        let mut axes = Axes::single(c, k, Shown::Position);
        axes.inertia[(0, 0)] = m;
        axes.drive = vec![2.0];
        axes
    };
    // Forces are in V, and each volt pushes with a force of 2.
    for (effect, heavier) in [
        ("kind = \"added-mass\"\nmass_s2 = 0.25", axis(1.5, 3.0, 90.0)),
        ("kind = \"added-damping\"\ndamping_s = 0.5", axis(1.0, 4.0, 90.0)),
        ("kind = \"added-stiffness\"\nstiffness = 5.0", axis(1.0, 3.0, 100.0)),
    ] {
        let config = config(effect);
        let loaded = altered(&config, &assemble(&config, Plant::of_axes(axis(1.0, 3.0, 90.0))));
        let expected = assemble(&config, Plant::of_axes(heavier));
        for (found, expected) in [
            (&loaded.continuous.a, &expected.continuous.a),
            (&loaded.continuous.b, &expected.continuous.b),
            (&loaded.discrete.a, &expected.discrete.a),
        ] {
            assert!((found - expected).amax() < 1e-12 * expected.amax(), "{effect}: {found}{expected}");
        }
        for (a, b) in loaded.ports[0].force.iter().zip(&expected.ports[0].force) {
            assert!((a - b).abs() < 1e-12, "{effect}");
        }
    }
}

/// A mass at the strut of a truss with one mode, whose unit modal mass appears there as a mass of 1 / b^2.
#[test]
fn a_mass_lowers_the_frequency_of_a_mode() {
    let mode = Mode {
        frequency_hz: 40.0,
        damping_ratio: 0.01,
        input_shape: [0.3, 0.0, 0.0],
        output_shape: [0.2, 0.1, 0.0],
        group: ModeGroup::Dominant,
    };
    // A displacement of 1 V is b^2 / w^2 in the mode's units, so the inertia in V is 1 / w^2.
    let w = mode.angular_frequency();
    let config = config(&format!("kind = \"added-mass\"\nmass_s2 = {}", 0.44 / (w * w)));
    let truss = assemble(&config, Plant::of_modes(vec![mode], [ACTUATOR_POLE_HZ; INPUTS]));
    let (before, after) = (poles(&truss), poles(&altered(&config, &truss)));
    assert!((before[0] / w - 1.0).abs() < 1e-9 && (after[0] * 1.2 / w - 1.0).abs() < 1e-9, "{before:?}, {after:?}");
    // The poles of the actuators and the filters do not change.
    assert!(before[2..].iter().zip(&after[2..]).all(|(a, b)| (a / b - 1.0).abs() < 1e-9));
}
