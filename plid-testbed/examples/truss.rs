//! Prints the figures of the simulated truss that docs/truss.md quotes.

use nalgebra::{Complex, DMatrix};
use ndarray::ArrayView2;
use plid_testbed::{InputConfig, ModeGroup, StateSpace, TrussConfig, simulate, truss};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let config = TrussConfig::default();
    let plant = truss(&config)?;
    println!("{} states, {} modes", plant.discrete.states(), plant.modes.len());

    let tubes = highest(&plant.discrete, config.sample_rate_hz, 50.0, 70.0);
    let dominant = highest(&plant.discrete, config.sample_rate_hz, 120.0, 260.0);
    println!(
        "highest dominant peak {dominant:.2} V/V, highest of the tubes {:.1} dB below",
        20.0 * (dominant / tubes).log10()
    );

    println!(
        "\n| mode, Hz | damping, % | group | gain at its frequency, dB, u1->y1 .. u3->y1, u1->y2 .. u3->y3 \
         |\n|---|---|---|---|"
    );
    for mode in plant.modes.iter().filter(|m| m.group != ModeGroup::StrutTube) {
        let h = response(&plant.discrete, mode.frequency_hz, config.sample_rate_hz);
        let gains: Vec<String> = h.transpose().iter().map(|g| format!("{:.1}", 20.0 * g.norm().log10())).collect();
        println!(
            "| {} | {:.2} | {:?} | {} |",
            mode.frequency_hz,
            100.0 * mode.damping_ratio,
            mode.group,
            gains.join(" ")
        );
    }

    let driven = simulate(&config)?;
    println!("\n1 V RMS of white noise on all inputs: noise-free outputs {}", rms(driven.noise_free.view()));
    for j in 0..3 {
        let mut one = config.clone();
        let mut level_rms_v = [0.0; 3];
        level_rms_v[j] = 1.0;
        one.input = InputConfig::WhiteNoise(plid_testbed::WhiteNoise { level_rms_v, ..Default::default() });
        println!("1 V RMS on input {} alone: noise-free outputs {}", j + 1, rms(simulate(&one)?.noise_free.view()));
    }
    let floor = &driven.outputs[0] - &driven.noise_free;
    println!("outputs less the noise-free ones {}", rms(floor.view()));
    let rest = simulate(&TrussConfig { input: InputConfig::Zero, ..config.clone() })?;
    println!("at rest {}", rms(rest.outputs[0].view()));
    Ok(())
}

fn response(model: &StateSpace, f_hz: f64, rate_hz: f64) -> DMatrix<Complex<f64>> {
    let z = Complex::from_polar(1.0, 2.0 * std::f64::consts::PI * f_hz / rate_hz);
    let complex = |m: &DMatrix<f64>| m.map(|v| Complex::new(v, 0.0));
    let n = model.states();
    let resolvent = DMatrix::from_diagonal_element(n, n, z) - complex(&model.a);
    complex(&model.c) * resolvent.lu().solve(&complex(&model.b)).expect("no pole on the unit circle")
}

/// The largest gain of any pair from `from` to `to` Hz.
fn highest(model: &StateSpace, rate_hz: f64, from: f64, to: f64) -> f64 {
    let lines = ((to - from) / 0.1) as usize;
    let gain = |i| response(model, from + 0.1 * i as f64, rate_hz).iter().map(|g| g.norm()).fold(0.0, f64::max);
    (0..=lines).map(gain).fold(0.0, f64::max)
}

fn rms(signal: ArrayView2<f64>) -> String {
    let each: Vec<f64> = signal.columns().into_iter().map(|c| c.mapv(|v| v * v).mean().unwrap_or(0.0)).collect();
    let total = (each.iter().sum::<f64>() / each.len() as f64).sqrt();
    let each: Vec<String> = each.iter().map(|v| format!("{:.4}", v.sqrt())).collect();
    format!("{} V RMS; together {total:.4} V RMS", each.join(", "))
}
