//! A run that is begun with another's estimate and whole covariance goes on as that one does.

use plid_backends::{Faer, Nalgebra, Plain};
use plid_core::{
    Backend, ConditionalExpectations, CovariancePropagation, Identifier, InitialCovariance, NoiseModel, ObservableForm,
    Settings,
};
use plid_variants::covariance::{ArraySqrt, BiermanUd, Direct, Joseph};
use plid_variants::expectations::MomentMatched;

/// Three outputs and inputs of sample `k`.
fn sample(k: usize) -> ([f64; 3], [f64; 3]) {
    let wave = |rate: f64| (rate * k as f64).sin();
    ([wave(0.31), wave(0.47), wave(0.83)], [wave(1.7), wave(2.3), wave(2.9)])
}

fn goes_on<C>()
where
    C: Inspect<Scalar = f64>,
    MomentMatched<f64>: ConditionalExpectations<Scalar = ScalarOf<C>>,
{
    // Large enough for kernels that take columns and rows in packs.
    let form = ObservableForm::new(&[7, 7, 6], 3).unwrap();
    let noise = NoiseModel::diagonal(&[1e-2; 3], &[1e-3; 3], &[1e-4; 20]);
    let settings = Settings::new(&form, 1.0, 1.0);
    let mut first = Identifier::<C, MomentMatched<f64>>::new(form.clone(), &noise, &settings).unwrap();
    for k in 0..20 {
        let (z, u) = sample(k);
        first.step(&z, &u).unwrap();
    }
    let settings = Settings {
        initial_covariance: InitialCovariance::Full(first.covariance().dense()),
        initial_estimate: first.estimate().to_vec(),
        ..settings
    };
    let mut second = Identifier::<C, MomentMatched<f64>>::new(form, &noise, &settings).unwrap();
    for k in 20..30 {
        let (z, u) = sample(k);
        first.step(&z, &u).unwrap();
        second.step(&z, &u).unwrap();
    }
    for (a, b) in first.estimate().iter().zip(second.estimate()) {
        assert!((a - b).abs() < 1e-9, "{a} {b}");
    }
}

#[test]
fn a_whole_initial_covariance_goes_on_as_the_run_it_is_from() {
    goes_on::<Direct<Plain<f64>>>();
    goes_on::<Direct<Nalgebra<f64>>>();
    goes_on::<Direct<Faer<f64>>>();
    goes_on::<Joseph<Plain<f64>>>();
    goes_on::<BiermanUd<Plain<f64>>>();
    goes_on::<ArraySqrt<Plain<f64>>>();
}
