use ndarray::Array2;
use plid_testbed::{CubicJoint, EffectsConfig, InputConfig, TestbedError, TrussConfig, WhiteNoise, simulate};

use crate::physics::Physics;
use crate::{ideal, largest, rms};

fn with_effects(drift: f64, cubic: Option<f64>, steps_per_sample: usize) -> TrussConfig {
    let cubic_joint = cubic.map(|stiffness_per_v2| CubicJoint { input: 2, stiffness_per_v2 });
    let effects =
        EffectsConfig { stiffness_drift_per_s: drift, cubic_joint, steps_per_sample, ..EffectsConfig::default() };
    TrussConfig { duration_s: 0.4, effects, ..ideal() }
}

fn outputs(config: &TrussConfig) -> Array2<f64> {
    simulate(config).unwrap().noise_free
}

const DRIFT: f64 = 0.005;
const CUBIC: f64 = 1e-4;

/// Share of the linear response by which an effect changes it.
fn change(config: &TrussConfig) -> f64 {
    let linear = outputs(&with_effects(0.0, None, 8));
    rms((outputs(config) - &linear).iter().copied()) / rms(linear.iter().copied())
}

#[test]
fn both_effects_agree_with_a_fine_integration_of_the_physics() {
    for (drift, cubic) in [(DRIFT, None), (0.0, Some(CUBIC)), (DRIFT, Some(-CUBIC))] {
        let config = with_effects(drift, cubic, 8);
        let run = simulate(&config).unwrap();
        let mut physics = Physics::of(&run.truth.modes);
        physics.stiffness = Box::new(move |t| 1.0 + drift * t);
        if let Some(k) = cubic {
            physics.force = Some((1, Box::new(move |d, _v| -k * d * d * d)));
        }
        let expected = physics.run(run.commands.view(), 1600.0, 128);
        let error = largest((&run.noise_free - &expected).view());
        println!("drift {drift}, cubic {cubic:?}: change {:.3}, error {error:.1e} V", change(&config));
        assert!(change(&config) > 0.02, "the effect is too weak for the test");
        assert!(error < 5e-6, "{error} V with drift {drift} and cubic {cubic:?}");
    }
}

#[test]
fn halving_the_step_changes_nothing_visible() {
    for (drift, cubic) in [(DRIFT, None), (0.0, Some(CUBIC))] {
        let coarse = outputs(&with_effects(drift, cubic, 8));
        let fine = outputs(&with_effects(drift, cubic, 16));
        let finest = outputs(&with_effects(drift, cubic, 32));
        let (first, second) = (largest((&coarse - &fine).view()), largest((&fine - &finest).view()));
        println!("drift {drift}, cubic {cubic:?}: 8 to 16 steps {first:.1e} V, 16 to 32 steps {second:.1e} V");
        // A five-hundredth of a code of the ADC; and of fourth order: halving gains a factor of 16.
        assert!(first < 5e-6, "{first} V");
        assert!(first / second > 10.0, "{first} V, then {second} V");
    }
}

#[test]
fn effects_that_vanish_leave_the_exact_linear_response() {
    let linear = outputs(&with_effects(0.0, None, 8));
    for config in [with_effects(1e-13, None, 8), with_effects(0.0, Some(1e-15), 1)] {
        assert!(largest((outputs(&config) - &linear).view()) < 1e-11);
    }
}

#[test]
fn the_drifts_clock_runs_on_through_the_repeats() {
    let long = simulate(&TrussConfig { repeats: 5, ..with_effects(DRIFT, None, 8) }).unwrap();
    let linear = outputs(&with_effects(0.0, None, 8));
    let gap = |y: &Array2<f64>| rms((y - &linear).iter().copied());
    let gaps: Vec<f64> = long.outputs.iter().map(gap).collect();
    assert!(gaps.windows(2).take(2).all(|w| w[1] > 1.3 * w[0]), "{gaps:?}");
    assert_eq!(long.outputs[0], long.noise_free);
}

/// Odd: the response to the negative input is the negative response; and at half the level the cubic gap is an eighth.
#[test]
fn the_cubic_joint_is_odd_and_of_third_order() {
    let at = |level: f64, k: f64| {
        let input = InputConfig::WhiteNoise(WhiteNoise { level_rms_v: [level; 3], ..WhiteNoise::default() });
        outputs(&TrussConfig { input, ..with_effects(0.0, Some(k), 4) })
    };
    let gap = |level: f64| {
        let difference = at(level, 1e-7) - at(level, 1e-30);
        rms(difference.iter().copied())
    };
    let ratio = gap(1.0) / gap(0.5);
    assert!((ratio - 8.0).abs() < 0.05, "{ratio}");
    let run = simulate(&with_effects(0.0, Some(CUBIC), 8)).unwrap();
    let mirrored = plid_testbed::simulate_input(&with_effects(0.0, Some(CUBIC), 8), (-&run.commands).view()).unwrap();
    assert!(largest((&run.noise_free + &mirrored.noise_free).view()) < 1e-12);
}

#[test]
fn a_joint_that_softens_too_much_is_an_error() {
    let loud = InputConfig::WhiteNoise(WhiteNoise { level_rms_v: [2.0; 3], ..WhiteNoise::default() });
    let config = TrussConfig { input: loud, ..with_effects(0.0, Some(-0.01), 4) };
    assert!(matches!(simulate(&config), Err(TestbedError::Diverged { repeat: 0, .. })));
}
