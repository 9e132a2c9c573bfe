//! Every effect of the list against its equation, written down once more and worked out in another way.

use std::f64::consts::PI;

use ndarray::{Array2, Axis};
use plid_testbed::{
    Effect, InputConfig, Mode, StateSpace, TestbedError, TrussConfig, simulate, simulate_input, truss,
    truss_without_mode,
};

use crate::physics::Physics;
use crate::{ideal, largest, rms};

const RATE: f64 = 1600.0;

/// Without noise, with the effects of a list in TOML.
fn with(list: &str) -> TrussConfig {
    #[derive(serde::Deserialize)]
    struct List {
        effect: Vec<Effect>,
    }
    let list: List = toml::from_str(list).unwrap();
    let mut config = TrussConfig { duration_s: 0.4, ..ideal() };
    config.effects.list = list.effect;
    // As the draw of gap cases has it.
    config.effects.steps_per_sample = 8;
    config
}

fn linear() -> TrussConfig {
    TrussConfig { duration_s: 0.4, ..ideal() }
}

/// Commands, outputs with the effects, and the model without them.
fn run(list: &str) -> (Array2<f64>, Array2<f64>, StateSpace) {
    let run = simulate(&with(list)).unwrap();
    (run.commands, run.noise_free, run.truth.discrete)
}

/// Checks an effect on the voltages against a law that gives those that reach the actuator's pole, sample by sample.
fn check_commands(list: &str, mut law: impl FnMut(usize, [f64; 3]) -> [f64; 3]) {
    let (u, y, model) = run(list);
    let mut changed = u.clone();
    for (k, mut row) in changed.axis_iter_mut(Axis(0)).enumerate() {
        let voltages = law(k, [row[0], row[1], row[2]]);
        (0..3).for_each(|j| row[j] = voltages[j]);
    }
    assert!(largest((&changed - &u).view()) > 0.01, "{list} changes nothing");
    let error = largest((&y - &model.simulate(changed.view())).view());
    assert!(error < 1e-11, "{list}: {error}");
}

/// Checks an effect on the samples against a law of the samples without it.
fn check_samples(list: &str, mut law: impl FnMut(usize, [f64; 3]) -> [f64; 3]) {
    let (u, y, model) = run(list);
    let clean = model.simulate(u.view());
    let mut change: f64 = 0.0;
    for k in 0..y.nrows() {
        let before = [clean[(k, 0)], clean[(k, 1)], clean[(k, 2)]];
        let after = law(k, before);
        for i in 0..3 {
            assert!((y[(k, i)] - after[i]).abs() < 1e-11, "{list}: {} and {} at {k}", y[(k, i)], after[i]);
            change = change.max((after[i] - before[i]).abs());
        }
    }
    assert!(change > 1e-3, "{list} changes nothing");
}

fn one(kind: &str, at: &str, rest: &str) -> String {
    format!("[[effect]]\nkind = \"{kind}\"\nat = \"{at}\"\n{rest}\n")
}

fn at(j: usize, mut u: [f64; 3], law: impl Fn(f64) -> f64) -> [f64; 3] {
    u[j] = law(u[j]);
    u
}

#[test]
fn memoryless_actuators() {
    let saturation = |law: &str| one("actuator-saturation", "u2", &format!("limit_v = 1.5\n{law}"));
    check_commands(&saturation(""), |_, u| at(1, u, |u| 1.5 * (u / 1.5).tanh()));
    check_commands(&saturation("law = 'clip'"), |_, u| at(1, u, |u| u.clamp(-1.5, 1.5)));
    check_commands(&saturation("law = 'arctangent'"), |_, u| at(1, u, |u| 3.0 / PI * (u * PI / 3.0).atan()));
    let dead = |law: &str| one("actuator-dead-zone", "u1", &format!("width_v = 0.3\n{law}"));
    check_commands(&dead(""), |_, u| at(0, u, |u| u.signum() * (u.abs() - 0.3).max(0.0)));
    check_commands(&dead("law = 'asymmetric'"), |_, u| {
        at(0, u, |u| {
            if u > 0.3 {
                u - 0.3
            } else if u < -0.15 {
                u + 0.15
            } else {
                0.0
            }
        })
    });
    check_commands(&dead("law = { asymmetric = { lower = 2.0 } }"), |_, u| {
        at(0, u, |u| (u - 0.3).max(0.0) + (u + 0.6).min(0.0))
    });
    check_commands(&saturation("law = { clip = { rounding = 0.25 } }"), |_, u| {
        at(1, u, |u| u / (1.0 + (u / 1.5).powi(4)).sqrt().sqrt())
    });
    check_commands(&saturation("law = { arctangent = { knee = 2.0 } }"), |_, u| {
        at(1, u, |u| 1.5 * u.signum() * (2.0 / PI * (PI / 2.0 * (u / 1.5).powi(2)).atan()).sqrt())
    });
    check_commands(&one("actuator-gain", "u3", "gain = 0.8"), |_, u| at(2, u, |u| 0.8 * u));
    check_commands(&one("actuator-crosstalk", "u1->u3", "share = -0.2"), |_, u| [u[0], u[1], u[2] - 0.2 * u[0]]);
    check_commands(&one("actuator-gain-drift", "u2", "rate_per_s = 0.5"), |k, u| {
        at(1, u, |u| u * (1.0 + 0.5 * (k as f64 + 0.5) / RATE))
    });
}

#[test]
fn effects_of_a_list_act_in_its_order() {
    let list = one("actuator-gain", "u1", "gain = 0.5") + &one("actuator-saturation", "u1", "limit_v = 1.0");
    check_commands(&list, |_, u| at(0, u, |u| (0.5 * u).tanh()));
    let both = one("actuator-gain", "u1", "gain = 0.5") + &one("sensor-gain", "y1", "gain = 2.0");
    let (u, y, model) = run(&both);
    let mut halved = u.clone();
    halved.column_mut(0).mapv_inplace(|u| u / 2.0);
    let mut expected = model.simulate(halved.view());
    expected.column_mut(0).mapv_inplace(|y| 2.0 * y);
    assert!(largest((&y - &expected).view()) < 1e-11);
}

/// Bouc and Wen's law in the original form, integrated in ten thousand steps from command to command.
#[test]
fn actuator_hysteresis_follows_each_step_of_the_command() {
    let (mut z, mut before) = (0.0_f64, 0.0);
    let mut short = with(&one("actuator-hysteresis", "u2", "share = 0.4\nyield_v = 0.7"));
    short.duration_s = 0.05;
    let run = simulate(&short).unwrap();
    let mut changed = run.commands.clone();
    for u in changed.column_mut(1) {
        let du = (*u - before) / 10_000.0;
        before = *u;
        for _ in 0..10_000 {
            let rate = |z: f64| 0.4 * du - (du.abs() * z + du * z.abs()) / 1.4;
            z += rate(z + rate(z) / 2.0);
        }
        *u -= z;
    }
    let error = largest((&run.noise_free - &run.truth.discrete.simulate(changed.view())).view());
    assert!(error < 1e-7, "{error}");
}

/// Outputs of the plant for voltages that change `fine` times a sample.
fn fine_response(voltages: &Array2<f64>, fine: usize) -> Array2<f64> {
    let config = TrussConfig { sample_rate_hz: RATE * fine as f64, input: InputConfig::Zero, ..ideal() };
    let y = truss(&config).unwrap().discrete.simulate(voltages.view());
    y.slice(ndarray::s![..;fine as isize, ..]).to_owned()
}

#[test]
fn a_delay_shifts_the_held_command_by_fractions_of_a_sample_too() {
    for (delay, place, shift) in [(2.0, "u1", 20), (0.3, "u1", 3), (1.7, "all", 17)] {
        let (u, y, _) = run(&one("actuator-delay", place, &format!("delay_samples = {delay}")));
        let fine = Array2::from_shape_fn((u.nrows() * 10, 3), |(k, j)| {
            let late = if place == "all" || j == 0 { shift } else { 0 };
            if k < late { 0.0 } else { u[((k - late) / 10, j)] }
        });
        let error = largest((&y - &fine_response(&fine, 10)).view());
        assert!(error < 1e-9, "{delay} samples, {place}: {error}");
    }
}

#[test]
fn a_slewing_amplifier_moves_in_straight_lines_between_samples_too() {
    let (u, y, _) = run(&one("actuator-slew-limit", "u3", "rate_v_per_s = 500.0"));
    let fine = 256;
    let most = 500.0 / (RATE * fine as f64);
    let mut voltage = 0.0;
    let mut fast = 0;
    let ramps = Array2::from_shape_fn((u.nrows() * fine, 3), |(k, j)| {
        let command: f64 = u[(k / fine, j)];
        if j < 2 {
            return command;
        }
        let before: f64 = voltage;
        voltage += (command - voltage).clamp(-most, most);
        fast += usize::from((voltage - before).abs() >= most);
        (before + voltage) / 2.0
    });
    assert!(fast > 1000, "it hardly slews");
    let error = largest((&y - &fine_response(&ramps, fine)).view());
    println!("slew limit: {error:.1e} V");
    // A fifth of a code of the ADC: in eighths of a sample a ramp is a staircase.
    assert!(error < 5e-4, "{error}");
}

#[test]
fn sensors_sample_by_sample() {
    check_samples(&one("sensor-gain", "y2", "gain = 1.1"), |_, y| at(1, y, |y| 1.1 * y));
    check_samples(&one("sensor-offset", "y1", "offset_v = -0.02"), |_, y| at(0, y, |y| y - 0.02));
    check_samples(&one("sensor-drift", "y3", "rate_v_per_s = 0.1"), |k, y| at(2, y, |y| y + 0.1 * k as f64 / RATE));
    check_samples(&one("sensor-crosstalk", "y1->y2", "share = 0.05"), |_, y| [y[0], y[1] + 0.05 * y[0], y[2]]);
    check_samples(&one("sensor-saturation", "y1", "limit_v = 0.5"), |_, y| at(0, y, |y| y.clamp(-0.5, 0.5)));
    check_samples(&one("sensor-quantisation", "y2", "step_v = 0.05"), |_, y| at(1, y, |y| (y / 0.05).round() * 0.05));
    check_samples(&one("x-sensor-square", "y3", "square_per_v = 0.3"), |_, y| at(2, y, |y| y + 0.3 * y * y));
    check_samples(&one("x-channel-product", "y1", "product_per_v = 0.3"), |_, y| {
        [y[0] + 0.3 * y[1] * y[2], y[1], y[2]]
    });
    let hum = one(
        "mains-hum",
        "y1",
        "amplitude_v = 0.1\nfrequency_hz = 50.0\nphase_rad = 0.3\nharmonics = \
         [{ multiple = 3, amplitude_v = 0.02, phase_rad = 1.0 }]",
    );
    check_samples(&hum, |k, y| {
        let angle = 2.0 * PI * 50.0 * k as f64 / RATE;
        at(0, y, |y| y + 0.1 * (angle + 0.3).sin() + 0.02 * (3.0 * angle + 1.0).sin())
    });
    let mut state = 0.0;
    let al = (-2.0 * PI * 400.0 / RATE).exp();
    check_samples(&one("sensor-lag", "y1", "corner_hz = 400.0"), |_, y| {
        state = al * state + (1.0 - al) * y[0];
        [state, y[1], y[2]]
    });
    let [mut first, mut second] = [0.0; 2];
    let [slow, fast] = [1.25, 5.0].map(|pole: f64| (-2.0 * PI * pole * 400.0 / RATE).exp());
    check_samples(&one("sensor-lag", "y1", "corner_hz = 400.0\nlaw = { two-poles = { ratio = 4.0 } }"), |_, y| {
        first = slow * first + (1.0 - slow) * y[0];
        second = fast * second + (1.0 - fast) * first;
        [second, y[1], y[2]]
    });
    let settling = one("sensor-drift", "y3", "rate_v_per_s = 0.5\nlaw = { settling = { time_s = 0.2 } }");
    check_samples(&settling, |k, y| at(2, y, |y| y + 0.1 * (1.0 - (-(k as f64) / RATE / 0.2).exp())));
    let cut = one("sensor-quantisation", "y2", "step_v = 0.05\nlaw = { truncate = { carry = -0.2 } }");
    check_samples(&cut, |_, y| at(1, y, |y| 0.05 * y.signum() * ((y / 0.05).abs() - 0.2).max(0.0).floor()));
    let tanh = one("sensor-saturation", "y1", "limit_v = 0.5\nlaw = { tanh = { knee = 2.0 } }");
    check_samples(&tanh, |_, y| at(0, y, |y| 0.5 * y.signum() * (y * y / 0.25).tanh().sqrt()));
    let mut last = 0.0_f64;
    check_samples(&one("x-sensor-rate-limit", "y2", "rate_v_per_s = 200.0"), |_, y| {
        last += (y[1] - last).signum() * (y[1] - last).abs().min(200.0 / RATE);
        [y[0], last, y[2]]
    });
}

/// The delayed channel against the plant at ten times the rate; what a record ends with has its own future.
#[test]
fn a_sensor_that_is_late_reads_the_motion_of_then() {
    let (u, y, _) = run(&one("sensor-delay", "y1", "delay_samples = 0.3"));
    let fine = Array2::from_shape_fn((u.nrows() * 10, 3), |(k, j)| u[(k / 10, j)]);
    let config = TrussConfig { sample_rate_hz: RATE * 10.0, input: InputConfig::Zero, ..ideal() };
    let motion = truss(&config).unwrap().discrete.simulate(fine.view());
    let late = (100..u.nrows()).map(|k| y[(k, 0)] - motion[(10 * k - 3, 0)]);
    let error = rms(late) / rms(motion.column(0).to_vec());
    println!("sensor delay: {error:.1e} of the signal");
    // The held command's jumps reach beyond half the sample rate: that share has no linear phase.
    assert!(error < 0.01, "{error}");
}

#[test]
fn clocks_run_on_and_states_do_not() {
    let list = one("sensor-drift", "y1", "rate_v_per_s = 0.1") + &one("sensor-lag", "y2", "corner_hz = 300.0");
    let config = TrussConfig { repeats: 2, ..with(&list) };
    let run = simulate(&config).unwrap();
    let difference = &run.outputs[1] - &run.outputs[0];
    assert!(difference.column(0).iter().all(|d| (d - 0.1 * 0.4).abs() < 1e-12));
    assert!(difference.column(1).iter().all(|d| *d == 0.0));
}

#[test]
fn dropouts_repeat_the_last_good_value_and_come_at_their_rate() {
    let mut config = with(&one("sensor-dropout", "y2", "onsets_per_sample = 0.01"));
    config.duration_s = 12.5;
    let run = simulate(&config).unwrap();
    let clean = run.truth.discrete.simulate(run.commands.view());
    let (y, clean) = (run.noise_free.column(1), clean.column(1));
    let (mut onsets, mut length, mut good) = (0, 0, 0.0);
    for k in 1..y.len() {
        if (y[k] - clean[k]).abs() < 1e-12 {
            (length, good) = (0, y[k]);
        } else {
            onsets += usize::from(length == 0);
            length += 1;
            assert!((y[k] - good).abs() < 1e-12 && length <= 16, "neither the last good value nor a new one at {k}");
        }
    }
    // 20 000 samples of which one in a hundred begins a run; a few begin within another.
    assert!((150..=220).contains(&onsets), "{onsets}");
}

#[test]
fn added_noise_has_its_standard_deviation_and_is_white() {
    // The fourth moment of independent parts is 3, and 3 more for each squared share that is Laplace's.
    for (law, fourth_moment) in [
        ("'gaussian'", 3.0),
        ("'laplace'", 6.0),
        ("{ laplace = { share = 0.5 } }", 3.75),
        ("{ laplace = { share = 0.0 } }", 3.0),
    ] {
        let mut config = with(&one("sensor-noise", "y3", &format!("rms_v = 0.1\nlaw = {law}")));
        config.duration_s = 12.5;
        let run = simulate(&config).unwrap();
        let noise = &run.noise_free - &run.truth.discrete.simulate(run.commands.view());
        let e = noise.column(2);
        let product = e.iter().zip(e.iter().skip(1)).map(|(a, b)| a * b).sum::<f64>() / e.len() as f64;
        assert!((rms(e.to_vec()) / 0.1 - 1.0).abs() < 0.03 && (product / 0.01).abs() < 0.03, "{law}");
        let fourth = e.iter().map(|e| (e / 0.1).powi(4)).sum::<f64>() / e.len() as f64;
        assert!((fourth / fourth_moment - 1.0).abs() < 0.2, "{law}: kurtosis {fourth}");
        assert!(largest(noise.slice(ndarray::s![.., ..2])) < 1e-11);
    }
}

/// Checks an effect inside the structure against a fine integration of the physics.
fn check_physics(list: &str, bound: f64, change: impl FnOnce(&mut Vec<Mode>, &mut Physics<'static>)) {
    let config = TrussConfig { duration_s: 0.15, ..with(list) };
    let run = simulate(&config).unwrap();
    let unchanged = run.truth.discrete.simulate(run.commands.view());
    let mut modes = run.truth.modes.clone();
    let mut physics = Physics::of(&[]);
    change(&mut modes, &mut physics);
    let physics = Physics { modes: &modes, ..physics };
    let expected = physics.run(run.commands.view(), RATE, 64);
    let (error, effect) =
        (largest((&run.noise_free - &expected).view()), largest((&run.noise_free - &unchanged).view()));
    println!("{list}changes {effect:.1e} V, error {error:.1e} V");
    assert!(effect > 1e-3, "{list} changes too little");
    assert!(error < bound * effect, "{list}: {error} of {effect}");
}

type Inner = fn(f64, f64) -> f64;

/// Shapes of families, at other numbers than the fixed ones.
const DRAWN_FORCES: [(&str, &str, Inner); 9] = [
    ("cubic-stiffness", "stiffness_per_v2 = 1e-3\nscale_v = 4.0\nlaw = { straightening = { bend = 0.5 } }", |d, _| {
        -1e-3 * d * d * d / (1.0 + d * d / 4.0)
    }),
    ("cubic-stiffness", "stiffness_per_v2 = 1e-3\nscale_v = 4.0\nlaw = { power = { exponent = 1.5 } }", |d, _| {
        -64e-3 * d.signum() * (d / 4.0).abs().powf(1.5)
    }),
    (
        "quadratic-stiffness",
        "stiffness_per_v = 2e-3\nlaw = { one-sided = { exponent = 1.5, other_side = 0.3 } }",
        |d, _| if d > 0.0 { -2e-3 * d.powf(1.5) } else { -0.6e-3 * (-d).powf(1.5) },
    ),
    ("coulomb-friction", "friction_v = 0.05\ntransition_v_per_s = 500.0\nlaw = { root = { knee = 0.6 } }", |_, v| {
        -0.05 * v / (v.abs().powf(1.2) + 500.0_f64.powf(1.2)).powf(1.0 / 1.2)
    }),
    (
        "coulomb-friction",
        "friction_v = 0.05\ntransition_v_per_s = 500.0\nlaw = { stribeck = { excess = 1.2, speed = 2.0 } }",
        |_, v| -(0.05 + 0.06 * (-v * v / 1e6).exp()) * (v / 500.0).tanh(),
    ),
    ("clearance", "stiffness = 0.05\ngap_v = 2.0\nlaw = { asymmetric = { lower = 1.5 } }", |d, _| {
        if d > 2.0 {
            -0.05 * (d - 2.0)
        } else if d < -3.0 {
            -0.05 * (d + 3.0)
        } else {
            0.0
        }
    }),
    ("clearance", "stiffness = 0.05\ngap_v = 3.0\nlaw = { rounded = { sharpness = 1.5 } }", |d, _| {
        -0.025 * (2.0 * d + ((d - 3.0).powi(2) + 4.0).sqrt() - ((d + 3.0).powi(2) + 4.0).sqrt())
    }),
    ("quadratic-damping", "damping_s2_per_v = 1e-8\nlaw = { asymmetric = { other_way = 2.0 } }", |_, v| {
        if v > 0.0 { -1e-8 * v * v } else { 2e-8 * v * v }
    }),
    (
        "quadratic-damping",
        "damping_s2_per_v = 1e-8\nscale_v_per_s = 2000.0\nlaw = { power = { exponent = 1.2 } }",
        |_, v| -0.04 * v.signum() * (v / 2000.0).abs().powf(1.2),
    ),
];

#[test]
fn forces_at_a_strut() {
    let cases: [(&str, &str, Inner); 13] =
        [
            ("cubic-stiffness", "stiffness_per_v2 = 1e-4", |d, _| -1e-4 * d * d * d),
            ("cubic-stiffness", "stiffness_per_v2 = 1e-3\nscale_v = 4.0\nlaw = 'straightening'", |d, _| {
                -1e-3 * d * d * d / (1.0 + d * d / 16.0)
            }),
            ("cubic-stiffness", "stiffness_per_v2 = 1e-4\nscale_v = 4.0\nlaw = 'power'", |d, _| {
                -64e-4 * d.signum() * (d / 4.0).abs().powf(2.5)
            }),
            ("quadratic-stiffness", "stiffness_per_v = 1e-3", |d, _| -1e-3 * d * d),
            ("quadratic-stiffness", "stiffness_per_v = -2e-3\nlaw = 'one-sided'", |d, _| {
                if d > 0.0 { 2e-3 * d * d } else { 0.0 }
            }),
            ("coulomb-friction", "friction_v = 0.05\ntransition_v_per_s = 500.0", |_, v| -0.05 * (v / 500.0).tanh()),
            ("coulomb-friction", "friction_v = 0.05\ntransition_v_per_s = 500.0\nlaw = 'root'", |_, v| {
                -0.05 * v / (v * v + 25e4).sqrt()
            }),
            ("coulomb-friction", "friction_v = 0.05\ntransition_v_per_s = 500.0\nlaw = 'stribeck'", |_, v| {
                -(0.05 + 0.025 * (-v * v / 625e4).exp()) * (v / 500.0).tanh()
            }),
            ("clearance", "stiffness = 0.05\ngap_v = 3.0", |d, _| -0.05 * d.signum() * (d.abs() - 3.0).max(0.0)),
            ("clearance", "stiffness = -0.05\ngap_v = 3.0\nlaw = 'asymmetric'", |d, _| {
                0.05 * if d > 3.0 {
                    d - 3.0
                } else if d < -1.5 {
                    d + 1.5
                } else {
                    0.0
                }
            }),
            ("clearance", "stiffness = 0.05\ngap_v = 3.0\nlaw = 'rounded'", |d, _| {
                -0.025 * (2.0 * d + ((d - 3.0).powi(2) + 1.0).sqrt() - ((d + 3.0).powi(2) + 1.0).sqrt())
            }),
            ("quadratic-damping", "damping_s2_per_v = 1e-8", |_, v| -1e-8 * v.abs() * v),
            ("quadratic-damping", "damping_s2_per_v = 1e-8\nscale_v_per_s = 2000.0\nlaw = 'power'", |_, v| {
                -0.04 * v.signum() * (v / 2000.0).abs().powf(1.7)
            }),
        ];
    for (kind, parameters, force) in cases.into_iter().chain(DRAWN_FORCES) {
        check_physics(&one(kind, "u2", parameters), 2e-3, |_, physics| physics.force = Some((1, Box::new(force))));
    }
}

#[test]
fn linear_changes_of_the_plant() {
    check_physics(&one("modal-frequency", "m13", "change = 0.01"), 1e-6, |modes, _| modes[12].frequency_hz *= 1.01);
    check_physics(&one("modal-damping", "m14", "factor = 1.5"), 1e-6, |modes, _| modes[13].damping_ratio *= 1.5);
    check_physics(&one("actuator-lag", "u2", "pole_hz = 180.0"), 1e-6, |_, physics| physics.poles_hz[1] = 180.0);
    let missing = "[[effect]]\nkind = \"missing-mode\"\nfrequency_hz = 200.0\ndamping_ratio = 0.01\n\
                   input_shape = [0.1, 0.05, -0.1]\noutput_shape = [0.1, -0.1, 0.05]\n";
    check_physics(missing, 1e-6, |modes, _| {
        let mut more = modes[12].clone();
        (more.frequency_hz, more.damping_ratio) = (200.0, 0.01);
        (more.input_shape, more.output_shape) = ([0.1, 0.05, -0.1], [0.1, -0.1, 0.05]);
        modes.push(more);
    });
    let drift = "[[effect]]\nkind = \"stiffness-drift\"\nrate_per_s = 0.1\n";
    check_physics(drift, 1e-4, |_, physics| physics.stiffness = Box::new(|t| 1.0 + 0.1 * t));
    let pumped = "[[effect]]\nkind = \"x-parametric-stiffness\"\nshare = 0.01\nfrequency_hz = 272.0\n";
    check_physics(pumped, 1e-4, |_, physics| {
        physics.stiffness = Box::new(|t| 1.0 + 0.01 * (2.0 * PI * 272.0 * t).sin());
    });
    let breathing = "[[effect]]\nkind = \"x-varying-damping\"\nshare = 0.9\nfrequency_hz = 5.0\n";
    check_physics(breathing, 1e-4, |_, physics| {
        physics.damping = Box::new(|t| 1.0 + 0.9 * (2.0 * PI * 5.0 * t).sin());
    });
    let shaking = one("narrowband-disturbance", "u3", "amplitude_v = 0.5\nfrequency_hz = 150.0\nphase_rad = 0.7");
    check_physics(&shaking, 1e-6, |_, physics| {
        physics.disturbance = Some((2, Box::new(|t| 0.5 * (2.0 * PI * 150.0 * t + 0.7).sin())));
    });
}

/// A nominal model that lacks a mode, and that mode as an effect of its own, are the truss again.
#[test]
fn a_model_without_a_mode_lacks_that_mode_and_nothing_else() {
    let plant = truss(&linear()).unwrap();
    let nominal = truss_without_mode(&linear(), 14).unwrap();
    assert_eq!(nominal.modes.len(), plant.modes.len() - 1);
    assert!(nominal.modes.iter().all(|m| *m != plant.modes[14]) && nominal.modes[14] == plant.modes[15]);
    let u = simulate(&linear()).unwrap().commands;
    let whole = plant.discrete.simulate(u.view());
    let mut only = plant.modes.clone();
    only.retain(|m| *m == plant.modes[14]);
    let alone = Physics::of(&only).run(u.slice(ndarray::s![..240, ..]), RATE, 64);
    let rest = nominal.discrete.simulate(u.slice(ndarray::s![..240, ..]));
    let error = largest((&whole.slice(ndarray::s![..240, ..]) - &alone - &rest).view());
    assert!(error < 1e-8 && largest(alone.view()) > 0.1, "{error}");
    assert!(matches!(truss_without_mode(&linear(), 99), Err(TestbedError::OutOfRange { key: "mode", .. })));
}

#[test]
fn a_band_of_noise_shakes_the_structure_at_its_centre() {
    let mut config = with(&one("coloured-disturbance", "u1", "rms_v = 0.3\nfrequency_hz = 120.0"));
    config.duration_s = 5.0;
    let quiet = simulate_input(&config, Array2::zeros((8000, 3)).view()).unwrap();
    let y = quiet.noise_free.column(0);
    let power = |f: f64| {
        let (mut re, mut im) = (0.0, 0.0);
        for (k, y) in y.iter().enumerate() {
            let (sin, cos) = (2.0 * PI * f * k as f64 / RATE).sin_cos();
            (re, im) = (re + y * cos, im + y * sin);
        }
        re * re + im * im
    };
    let band = |low: usize, high: usize| (low * 5..high * 5).map(|i| power(i as f64 / 5.0)).sum::<f64>();
    assert!(band(110, 140) > 20.0 * (band(20, 50) + band(260, 290)));
}

#[test]
fn outsiders_of_the_commands() {
    let (mut voltage, mut stuck) = (0.0_f64, 0.0_f64);
    check_commands(&one("x-command-play", "u1", "play_v = 0.2"), |_, u| {
        if u[0] > voltage + 0.2 {
            voltage = u[0] - 0.2;
        } else if u[0] < voltage - 0.2 {
            voltage = u[0] + 0.2;
        }
        [voltage, u[1], u[2]]
    });
    check_commands(&one("x-sticking-valve", "u2", "stick_v = 0.3"), |_, u| {
        if (u[1] - stuck).abs() > 0.3 {
            stuck = u[1];
        }
        [u[0], stuck, u[2]]
    });
    // A delay that jitters from 0 to tau lies, on the mean, near a steady one of half of it.
    let (_, jittering, _) = run(&one("x-delay-jitter", "u3", "most_samples = 0.8"));
    let (_, steady, _) = run(&one("actuator-delay", "u3", "delay_samples = 0.4"));
    let (u, prompt, model) = run(&one("actuator-gain", "u3", "gain = 1.0"));
    assert!(largest((&prompt - &model.simulate(u.view())).view()) < 1e-12);
    let far = |a: &Array2<f64>, b: &Array2<f64>| rms((a - b).iter().copied());
    let (from_steady, from_prompt) = (far(&jittering, &steady), far(&jittering, &prompt));
    assert!(from_steady < 0.6 * from_prompt && from_steady > 0.01 * from_prompt, "{from_steady}, {from_prompt}");
}

/// The heat is a sum over all past commands, and its mean over a sample that by Gauss's rule of three points.
#[test]
fn an_actuator_that_warms_up() {
    let (u, ..) = run(&one("actuator-gain", "u2", "gain = 1.0"));
    let squares: Vec<f64> = u.column(1).iter().map(|u| u * u).collect();
    let (h, tau) = (1.0 / RATE, 0.05);
    let left_after = |samples: f64| (-samples * h / tau).exp();
    check_commands(&one("x-thermal-gain", "u2", "loss_per_v2 = 0.4\ntime_s = 0.05"), |k, u| {
        let past = |j: usize| squares[j] * (left_after((k - j - 1) as f64) - left_after((k - j) as f64));
        let start: f64 = (0..k).map(past).sum();
        let at = |share: f64| start * left_after(share) + squares[k] * (1.0 - left_after(share));
        let side = 0.15_f64.sqrt();
        let mean = (5.0 * at(0.5 - side) + 8.0 * at(0.5) + 5.0 * at(0.5 + side)) / 18.0;
        [u[0], u[1] / (1.0 + 0.4 * mean), u[2]]
    });
}

#[test]
fn a_supply_sags_under_the_sum_of_all_commands() {
    check_commands("[[effect]]\nkind = \"x-supply-sag\"\nsag_per_v = 0.1\n", |_, u| {
        let sum = u[0].abs() + u[1].abs() + u[2].abs();
        u.map(|u| u / (1.0 + 0.1 * sum))
    });
}

/// What the resonance adds is a sum of its responses to the steps of the held samples.
#[test]
fn a_sensor_s_mount_rings_with_another_axis() {
    let (u, _, model) = run(&one("actuator-gain", "u2", "gain = 1.0"));
    let driven = model.simulate(u.view()).column(2).to_vec();
    let (w, z): (f64, f64) = (2.0 * PI * 210.0, 0.03);
    let (decay, ringing) = (z * w, w * (1.0 - z * z).sqrt());
    let step = |t: f64| 1.0 - (-decay * t).exp() * ((ringing * t).cos() + decay / ringing * (ringing * t).sin());
    let law = one("x-resonant-crosstalk", "y3->y1", "share = -0.2\nfrequency_hz = 210.0\ndamping_ratio = 0.03");
    check_samples(&law, |k, y| {
        let from = |j: usize| driven[j] * (step((k - j) as f64 / RATE) - step((k - j - 1) as f64 / RATE));
        [y[0] - 0.2 * (0..k).map(from).sum::<f64>(), y[1], y[2]]
    });
}

#[test]
fn noise_in_proportion_to_the_signal() {
    let mut config = with(&one("x-proportional-noise", "y2", "share = 0.2"));
    config.duration_s = 12.5;
    let run = simulate(&config).unwrap();
    let clean = run.truth.discrete.simulate(run.commands.view());
    let shares = |i: usize| -> Vec<f64> {
        let both = run.noise_free.column(i).to_vec().into_iter().zip(clean.column(i).to_vec());
        both.filter(|(_, clean)| clean.abs() > 1e-6).map(|(noisy, clean)| noisy / clean - 1.0).collect()
    };
    assert!(largest((&run.noise_free - &clean).slice(ndarray::s![..;1, ..1])) < 1e-11);
    let n = shares(1);
    // Alike where the signal is small and where it is large.
    let large = rms(clean.column(1).to_vec());
    let of_large: Vec<f64> = clean
        .column(1)
        .iter()
        .zip(run.noise_free.column(1))
        .filter(|(c, _)| c.abs() > large)
        .map(|(c, y)| y / c - 1.0)
        .collect();
    assert!((rms(n.clone()) / 0.2 - 1.0).abs() < 0.03 && (rms(of_large) / 0.2 - 1.0).abs() < 0.05);
    let product = n.iter().zip(n.iter().skip(1)).map(|(a, b)| a * b).sum::<f64>() / n.len() as f64;
    assert!((product / 0.04).abs() < 0.03, "{product}");
}

#[test]
fn forces_that_join_struts_and_actuators() {
    check_physics(&one("x-force-factor", "u2", "half_v = 6.0"), 2e-3, |_, physics| {
        physics.forces = Some(Box::new(|a, d| [0.0, a[1] / (1.0 + (d[1] / 6.0).powi(2)) - a[1], 0.0]));
    });
    // The slopes of k (d_3 + d_1^2 / (2 L))^2 / 2 - k d_3^2 / 2, by differences.
    check_physics(&one("x-foreshortening", "u1->u3", "length_v = 40.0\nstiffness = 0.4"), 2e-3, |_, physics| {
        let energy = |a: f64, b: f64| 0.2 * (b + a * a / 80.0).powi(2) - 0.2 * b * b;
        physics.forces = Some(Box::new(move |_, [a, _, b]| {
            let slope = |plus: f64, minus: f64| (minus - plus) / 2e-4;
            let along_a = slope(energy(a + 1e-4, b), energy(a - 1e-4, b));
            [along_a, 0.0, slope(energy(a, b + 1e-4), energy(a, b - 1e-4))]
        }));
    });
}

/// Contact that hardly ever changes is a linear spring, or none, over a short record.
#[test]
fn a_contact_that_lasts_is_a_spring() {
    let law = one("x-intermittent-contact", "u2", "stiffness = 0.05\nmean_s = 1e6");
    let touching = |seed: u64| TrussConfig { seed, duration_s: 0.15, ..with(&law) };
    let outputs = |seed: u64| {
        let run = simulate(&touching(seed)).unwrap();
        let unchanged = run.truth.discrete.simulate(run.commands.view());
        let modes = run.truth.modes;
        let mut physics = Physics::of(&modes);
        physics.force = Some((1, Box::new(|d, _| -0.05 * d)));
        let spring = physics.run(run.commands.view(), RATE, 64);
        let [from_none, from_spring] =
            [unchanged, spring].map(|expected| largest((&run.noise_free - &expected).view()));
        (from_none < 1e-8, from_spring < 1e-5)
    };
    let found: Vec<(bool, bool)> = (1..13).map(outputs).collect();
    assert!(found.iter().all(|(none, spring)| none != spring), "{found:?}");
    assert!(found.contains(&(true, false)) && found.contains(&(false, true)), "{found:?}");
}

#[test]
fn values_and_places_are_checked_by_name() {
    let wrong = |list: &str| simulate(&with(list)).expect_err(list).to_string();
    for (list, key) in [
        (one("cubic-stiffness", "u1", "stiffness_per_v2 = nan"), "`stiffness_per_v2`"),
        (one("coulomb-friction", "u1", "friction_v = -1.0\ntransition_v_per_s = 1.0"), "`friction_v`"),
        (one("clearance", "u1", "stiffness = 1.0\ngap_v = 0.0"), "`gap_v`"),
        (one("actuator-delay", "u1", "delay_samples = 0.0"), "`delay_samples`"),
        (one("modal-damping", "m99", "factor = 1.0"), "number of the mode"),
        (one("modal-damping", "m4", "factor = 1e300"), "`factor` must be at most"),
        (one("sensor-dropout", "y1", "onsets_per_sample = 2.0"), "onsets_per_sample"),
        (one("x-clock-skew", "y1", "fast_share = 0.2"), "0.1 - fast_share"),
        (one("x-foreshortening", "u1->u2", "length_v = 1.0\nstiffness = 2.0"), "1 - stiffness"),
        (
            one("x-resonant-crosstalk", "y1->y2", "share = 1.0\nfrequency_hz = 900.0\ndamping_ratio = 0.1"),
            "frequency_hz",
        ),
        (one("coloured-disturbance", "u1", "rms_v = 1.0\nfrequency_hz = 900.0"), "`frequency_hz`"),
        ("[[effect]]\nkind = 'stiffness-drift'\nrate_per_s = -5.0\n".to_owned(), "stiffness drift"),
    ] {
        let text = wrong(&list);
        assert!(text.contains(key) && text.contains("`effects.list`, number 1"), "{text}");
    }
    let parse = |list: &str| {
        let text = list.replace("[[effect]]", "[[effects.list]]");
        toml::from_str::<TrussConfig>(&text).expect_err(list).to_string()
    };
    for (list, word) in [
        (one("cubic-stiffness", "u4", "stiffness_per_v2 = 1.0"), "u4"),
        (one("sensor-gain", "u1", "gain = 1.0"), "u1"),
        (one("sensor-crosstalk", "y1->y1", "share = 1.0"), "y1->y1"),
        (one("sensor-gain", "y1", "gain = 1.0\nfactor = 2.0"), "factor"),
        (one("coulomb-friction", "u1", "friction_v = 1.0\ntransition_v_per_s = 1.0\nlaw = 'wet'"), "wet"),
        (one("cubic-stifness", "u1", "stiffness_per_v2 = 1.0"), "cubic-stifness"),
    ] {
        let text = parse(&list);
        assert!(text.contains(word), "{text}");
    }
}

#[test]
fn a_list_in_toml_comes_back_as_it_was() {
    let list = one("cubic-stiffness", "u2", "stiffness_per_v2 = 1e-4")
        + &one("actuator-crosstalk", "u1->u3", "share = 0.1")
        + &one("actuator-delay", "all", "delay_samples = 1")
        + &one("x-sensor-square", "y2", "square_per_v = 0.1");
    let config: TrussConfig = toml::from_str(&list.replace("[[effect]]", "[[effects.list]]")).unwrap();
    let kinds: Vec<&str> = config.effects.list.iter().map(Effect::kind).collect();
    assert_eq!(kinds, ["cubic-stiffness", "actuator-crosstalk", "actuator-delay", "x-sensor-square"]);
    let again: TrussConfig = toml::from_str(&toml::to_string(&config).unwrap()).unwrap();
    assert_eq!(again, config);
}
