//! Identifies a plant with two modes, two inputs, two outputs and sensor noise of known size from arrays.
//!
//!     cargo run --example identify_in_memory

use nalgebra::{DMatrix, DVector};
use plid::backends::Plain;
use plid::covariance::BiermanUd;
use plid::expectations::MomentMatched;
use plid::{IdentifiedModel, Identifier, NoiseModel, ObservableForm, Settings};
use rand::SeedableRng;
use rand_chacha::ChaCha12Rng;
use rand_distr::{Distribution, StandardNormal};

const SAMPLES: usize = 3000;
const TRAINING: usize = 2000;
/// RMS of the sensor noise.
const NOISE: f64 = 0.01;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let plant = plant();
    let mut random = ChaCha12Rng::seed_from_u64(1);
    let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
    let inputs: Vec<[f64; 2]> = (0..SAMPLES).map(|_| [normal(), normal()]).collect();
    let clean = simulate(&plant, &[0.0; 4], &inputs);
    let outputs: Vec<[f64; 2]> = clean.iter().map(|y| y.map(|y| y + NOISE * normal())).collect();

    // Four states, two for each output. R is known here; Sigma is small, since nothing disturbs the states.
    let form = ObservableForm::balanced(4, 2, 2)?;
    let noise = NoiseModel::diagonal(&[NOISE * NOISE; 2], &[0.0; 2], &[1e-8; 4]);
    let settings = Settings::new(&form, 1.0, 1.0);
    let mut identifier = Identifier::<BiermanUd<Plain<f64>>, MomentMatched<f64>>::new(form, &noise, &settings)?;
    for (z, u) in outputs.iter().zip(&inputs).take(TRAINING) {
        identifier.step(z, u)?;
    }
    let IdentifiedModel { a, b, c, state, .. } = identifier.identified();

    // The rest of the record was not used for identification. It is simulated from the last estimate of the state.
    let model = [&a, &b, &c].map(DMatrix::from);
    let free_run = simulate(&model, &state, &inputs[TRAINING..]);
    for i in 0..2 {
        let error = rms(free_run.iter().zip(&outputs[TRAINING..]).map(|(y, z)| z[i] - y[i]));
        let level = rms(outputs[TRAINING..].iter().map(|z| z[i]));
        println!("output {}: {level:.3} RMS, free-run error {error:.5} RMS, sensor noise {NOISE:.5}", i + 1);
        assert!(error < 1.05 * NOISE, "the model explains all but the noise");
    }
    for (found, truth) in poles(&model[0]).into_iter().zip(poles(&plant[0])) {
        println!("mode of radius {:.5} at {:.5} rad (true: {:.5}, {:.5})", found.0, found.1, truth.0, truth.1);
        assert!((found.0 - truth.0).abs() < 1e-3 && (found.1 - truth.1).abs() < 1e-3);
    }
    Ok(())
}

/// Returns A, B and C of two modes in modal form, which differs from the form that is identified.
fn plant() -> [DMatrix<f64>; 3] {
    let mut a = DMatrix::zeros(4, 4);
    for (at, (radius, angle)) in [(0, (0.97_f64, 0.6_f64)), (2, (0.95, 1.3))] {
        let (sin, cos) = angle.sin_cos();
        a.view_mut((at, at), (2, 2)).copy_from_slice(&[radius * cos, radius * sin, -radius * sin, radius * cos]);
    }
    let b = DMatrix::from_row_slice(4, 2, &[0.3, 0.0, 0.1, -0.4, 0.2, 0.5, 0.0, 0.3]);
    let c = DMatrix::from_row_slice(2, 4, &[1.0, 0.2, 0.5, -0.3, -0.4, 1.0, 0.8, 0.1]);
    [a, b, c]
}

fn simulate([a, b, c]: &[DMatrix<f64>; 3], start: &[f64], inputs: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let mut x = DVector::from_column_slice(start);
    let step = |u: &[f64; 2]| {
        let y = c * &x;
        x = a * &x + b * DVector::from_column_slice(u);
        [y[0], y[1]]
    };
    inputs.iter().map(step).collect()
}

/// Returns radius and angle of the poles above the real axis, sorted by angle.
fn poles(a: &DMatrix<f64>) -> Vec<(f64, f64)> {
    let poles = a.complex_eigenvalues();
    let mut upper: Vec<_> = poles.iter().filter(|p| p.im > 0.0).map(|p| p.to_polar()).collect();
    upper.sort_by(|p, q| p.1.total_cmp(&q.1));
    upper
}

fn rms(values: impl ExactSizeIterator<Item = f64>) -> f64 {
    let count = values.len() as f64;
    (values.map(|v| v * v).sum::<f64>() / count).sqrt()
}
