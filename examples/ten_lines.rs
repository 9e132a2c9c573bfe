//! From two arrays to a saved model, in ten lines.
//!
//!     cargo run --example ten_lines

use plid::model::{frequency_response, mode_deviations};
use plid::ndarray::Array2;
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let (u, y) = record();
    // ANCHOR: ten
    // One row per sample and one column per channel, at 50 samples a second.
    let model = plid::identify(u.view(), y.view(), 50.0)?.model;
    println!("A = {}B = {}C = {}", model.a, model.b, model.c);
    let response = &frequency_response(&model, &[5.0])?[0];
    println!("|H(5 Hz)| = {}", response.map(|h| h.norm()));
    for found in mode_deviations(&model)? {
        let std = found.hz_std.ok_or("a repeated pole has no deviation")?;
        println!("{:.3} Hz ± {std:.3}, damping ratio {:.4}", found.mode.hz, found.mode.damping);
    }
    model.write(&std::env::temp_dir().join("model.json"))?;
    // ANCHOR_END: ten
    Ok(())
}

/// Simulates a mass on a spring (4 Hz, a damping ratio of 3 %) whose position is measured with noise.
fn record() -> (Array2<f64>, Array2<f64>) {
    let mut random = rand_chacha::ChaCha12Rng::seed_from_u64(1);
    let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
    let u = Array2::from_shape_simple_fn((2000, 1), &mut normal);
    let mut y = Array2::zeros((2000, 1));
    let (radius, angle) = ((-0.03 * 0.5027_f64).exp(), 0.5027_f64);
    for k in 2..2000 {
        y[(k, 0)] = 2.0 * radius * angle.cos() * y[(k - 1, 0)] - radius * radius * y[(k - 2, 0)] + u[(k - 1, 0)];
    }
    y.mapv_inplace(|y| y + 0.1 * normal());
    (u, y)
}
