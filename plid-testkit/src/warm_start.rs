//! A run that starts from another run's estimate and full covariance continues exactly like that run.

use plid_core::kernels::Kernels;
use plid_core::{InitialCovariance, NoiseModel, ObservableForm, Settings};

use crate::run::Variant;

/// Returns three outputs and three inputs of sample `k`.
fn sample(k: usize) -> ([f64; 3], [f64; 3]) {
    let wave = |rate: f64| (rate * k as f64).sin();
    ([wave(0.31), wave(0.47), wave(0.83)], [wave(1.7), wave(2.3), wave(2.9)])
}

pub fn goes_on<S: Kernels>(variant: &Variant<S>) {
    // The form is large enough for kernels that process columns and rows in packs.
    let form = ObservableForm::new(&[7, 7, 6], 3).unwrap();
    let noise = NoiseModel::diagonal(&[1e-2; 3], &[1e-3; 3], &[1e-4; 20]);
    let settings = Settings::new(&form, 1.0, 1.0);
    let mut first = variant.begin(form.clone(), &noise, &settings).unwrap();
    for k in 0..20 {
        let (z, u) = sample(k);
        first.step(&z, &u).unwrap();
    }
    let settings = Settings {
        initial_covariance: InitialCovariance::Full(first.covariance().own_dense().cast()),
        initial_estimate: first.estimate().iter().map(|x| x.to_f64()).collect(),
        ..settings
    };
    let mut second = variant.begin(form, &noise, &settings).unwrap();
    for k in 20..30 {
        let (z, u) = sample(k);
        first.step(&z, &u).unwrap();
        second.step(&z, &u).unwrap();
    }
    for (a, b) in first.estimate().iter().zip(second.estimate()) {
        let (a, b) = (a.to_f64(), b.to_f64());
        assert!((a - b).abs() < 1e-9, "{a} {b}");
    }
}
