use std::f64::consts::PI;

use ndarray::{Array2, s};
use plid_testbed::{
    Chirp, InputConfig, Multisine, TestbedError, TrussConfig, Warning, WhiteNoise, simulate, simulate_input,
};

use crate::{ideal, largest, rms};

fn short() -> TrussConfig {
    TrussConfig { duration_s: 0.5, ..TrussConfig::default() }
}

#[test]
fn one_volt_in_gives_half_a_volt_out() {
    let mut squares = 0.0;
    for seed in 1..=8 {
        let run = simulate(&TrussConfig { seed, ..TrussConfig::default() }).unwrap();
        for j in 0..3 {
            assert!((rms(run.commands.column(j).to_vec()) - 1.0).abs() < 1e-3);
        }
        squares += rms(run.outputs[0].iter().copied()).powi(2) / 8.0;
    }
    let level = squares.sqrt();
    println!("1 V RMS in, {level:.3} V RMS out");
    assert!((level - 0.5).abs() < 0.04, "{level}");
}

#[test]
fn commands_and_outputs_are_codes_within_the_range() {
    let loud = WhiteNoise { level_rms_v: [3.0, 1.0, 0.0], ..WhiteNoise::default() };
    let run = simulate(&TrussConfig { input: InputConfig::WhiteNoise(loud), ..TrussConfig::default() }).unwrap();
    for v in run.commands.iter().chain(&run.outputs[0]) {
        let code = v / 0.0025;
        assert!((code - code.round()).abs() < 1e-9 && v.abs() <= 5.0, "{v}");
    }
    assert!(run.commands.column(2).iter().all(|v| *v == 0.0));
    assert_eq!(largest(run.commands.view()), 5.0);
    let clipped = run.commands.column(0).iter().filter(|v| v.abs() == 5.0).count();
    let warned = run.warnings.iter().find_map(|w| match w {
        Warning::CommandClipped { channel: 0, samples } => Some(*samples),
        _ => None,
    });
    assert!(warned.is_some_and(|samples| samples > 0 && samples <= clipped), "{warned:?} of {clipped}");
}

#[test]
fn an_output_beyond_the_range_is_clipped_and_warned_of() {
    let mut config = short();
    config.converters.range_v = 0.5;
    let run = simulate(&config).unwrap();
    assert_eq!(largest(run.outputs[0].view()), 0.5);
    assert!(run.warnings.iter().any(|w| matches!(w, Warning::OutputClipped { repeat: 0, .. })));
}

#[test]
fn the_same_seed_gives_the_same_bytes_and_another_seed_others() {
    let bits = |y: &Array2<f64>| y.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
    let (a, b) = (simulate(&short()).unwrap(), simulate(&short()).unwrap());
    assert_eq!(bits(&a.commands), bits(&b.commands));
    assert_eq!(bits(&a.outputs[0]), bits(&b.outputs[0]));
    assert_eq!(bits(&a.noise_free), bits(&b.noise_free));
    let other = simulate(&TrussConfig { seed: 2, ..short() }).unwrap();
    assert_ne!(bits(&a.commands), bits(&other.commands));
    assert_ne!(bits(&a.outputs[0]), bits(&other.outputs[0]));
}

#[test]
fn repeats_share_the_input_and_average_their_noise_away() {
    let run = simulate(&TrussConfig { repeats: 16, ..short() }).unwrap();
    assert_eq!(run.outputs.len(), 16);
    let once = simulate(&short()).unwrap();
    assert_eq!(run.commands, once.commands);
    assert_eq!(run.outputs[0], once.outputs[0]);
    assert_ne!(run.outputs[0], run.outputs[1]);
    let error = |y: &Array2<f64>| rms((y - &run.noise_free).iter().copied());
    let one = (run.outputs.iter().map(|y| error(y).powi(2)).sum::<f64>() / 16.0).sqrt();
    let mean = run.outputs.iter().fold(Array2::zeros(once.commands.dim()), |sum, y| sum + y) / 16.0;
    let ratio = one / error(&mean);
    assert!((3.0..5.3).contains(&ratio), "{ratio} where 4 is expected");
}

#[test]
fn noise_free_outputs_are_the_true_models_free_run() {
    let run = simulate(&short()).unwrap();
    let free = run.truth.discrete.simulate(run.commands.view());
    assert!(largest((&free - &run.noise_free).view()) < 1e-12);
    let residual = rms((&run.outputs[0] - &free).iter().copied());
    assert!((0.012..0.022).contains(&residual), "{residual}");
}

/// Power at a frequency by a plain Fourier sum.
fn power(signal: &[f64], cycles: f64) -> f64 {
    let n = signal.len() as f64;
    let (mut re, mut im) = (0.0, 0.0);
    for (k, v) in signal.iter().enumerate() {
        let phase = 2.0 * PI * cycles * k as f64 / n;
        re += v * phase.cos();
        im += v * phase.sin();
    }
    2.0 * (re * re + im * im) / (n * n)
}

#[test]
fn multisine_is_periodic_flat_in_its_band_and_empty_elsewhere() {
    let multisine = Multisine { level_rms_v: [0.8, 0.4, 0.0], period_samples: 400, band_hz: [40.0, 120.0] };
    let run = simulate(&TrussConfig { input: InputConfig::Multisine(multisine), ..ideal() }).unwrap();
    let u = &run.commands;
    assert_eq!(u.slice(s![0..400, ..]), u.slice(s![400..800, ..]));
    assert!(u.column(2).iter().all(|v| *v == 0.0));
    for (j, level) in [(0, 0.8), (1, 0.4)] {
        let period = u.slice(s![0..400, j]).to_vec();
        assert!((rms(period.clone()) - level).abs() < 1e-12);
        // Lines every 4 Hz: 10 to 30 are in the band, both ends included.
        for line in 1..200 {
            let expected = if (10..=30).contains(&line) { level * level / 21.0 } else { 0.0 };
            assert!((power(&period, f64::from(line)) - expected).abs() < 1e-12, "line {line}");
        }
    }
    // Independent phases.
    assert!((0..400).any(|k| (u[(k, 0)] - 2.0 * u[(k, 1)]).abs() > 0.1));
}

#[test]
fn chirp_moves_from_one_frequency_to_the_other() {
    let chirp = Chirp { level_rms_v: [0.5, 0.0, 0.0], start_hz: 20.0, end_hz: 220.0 };
    let run = simulate(&TrussConfig { input: InputConfig::Chirp(chirp), duration_s: 10.0, ..ideal() }).unwrap();
    let u = run.commands.column(0).to_vec();
    assert!((rms(u.clone()) - 0.5).abs() < 1e-12);
    // Upward zero crossings within a second count its mean frequency.
    for second in 0..10 {
        let part = &u[second * 1600..(second + 1) * 1600];
        let crossings = part.windows(2).filter(|w| w[0] <= 0.0 && w[1] > 0.0).count() as f64;
        let expected = 20.0 + 20.0 * (second as f64 + 0.5);
        assert!((crossings - expected).abs() <= 1.5, "second {second}: {crossings} Hz");
    }
}

#[test]
fn white_noise_keeps_to_its_band_and_inputs_are_independent() {
    let run = simulate(&TrussConfig { seed: 5, ..ideal() }).unwrap();
    let u = run.commands.column(0).to_vec();
    let band = |from: usize, to: usize| {
        let lines: Vec<f64> = (from..to).map(|f| power(&u, f as f64 * 13.0)).collect();
        lines.iter().sum::<f64>() / lines.len() as f64
    };
    let fall = 10.0 * (band(50, 150) / band(300, 320)).log10();
    // The filter's own fall is 21.7 dB at 300 Hz with the sampling allowed for, growing to 320 Hz.
    assert!((21.0..30.0).contains(&fall), "{fall} dB");
    let v = run.commands.column(1).to_vec();
    let correlation = u.iter().zip(&v).map(|(a, b)| a * b).sum::<f64>() / u.len() as f64;
    assert!(correlation.abs() < 0.05, "{correlation}");
    // Turning one input off leaves the other as it was.
    let only = WhiteNoise { level_rms_v: [0.0, 1.0, 0.0], ..WhiteNoise::default() };
    let one = simulate(&TrussConfig { seed: 5, input: InputConfig::WhiteNoise(only), ..ideal() }).unwrap();
    assert_eq!(one.commands.column(1), run.commands.column(1));
}

#[test]
fn a_given_input_repeats_the_experiment_it_came_from() {
    let run = simulate(&short()).unwrap();
    let again = simulate_input(&TrussConfig { input: InputConfig::Zero, ..short() }, run.commands.view()).unwrap();
    assert_eq!(again.commands, run.commands);
    assert_eq!(again.outputs, run.outputs);
}

#[test]
fn a_bad_given_input_is_named() {
    let error = |u: Array2<f64>| simulate_input(&short(), u.view()).unwrap_err();
    assert_eq!(error(Array2::zeros((0, 3))), TestbedError::InputShape { rows: 0, columns: 3 });
    assert_eq!(error(Array2::zeros((5, 2))), TestbedError::InputShape { rows: 5, columns: 2 });
    let mut u = Array2::zeros((5, 3));
    u[(4, 1)] = f64::INFINITY;
    let infinite = error(u);
    assert!(matches!(infinite, TestbedError::InputNotFinite { sample: 4, channel: 1, .. }));
    assert!(infinite.to_string().contains("sample 4, channel u2"));
    let silent = simulate_input(&ideal(), Array2::zeros((5, 3)).view()).unwrap();
    assert_eq!(largest(silent.outputs[0].view()), 0.0);
}
