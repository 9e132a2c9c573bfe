//! Invalid values are errors that name step, channel and pivot.

use plid_backends::{Faer, Nalgebra, Plain};
use plid_core::kernels::Kernels;
use plid_core::{Dense, IdentifierError, InitialCovariance, NoiseError, NoiseModel, ObservableForm, Settings};
use plid_testkit::case::{Case, Options, random_case};
use plid_testkit::run::{Variant, take};
use plid_testkit::test_every_variant;
use plid_variants::covariance::{BiermanUd, Direct};
use plid_variants::expectations::Prior;

fn small() -> Case {
    random_case(&[2, 1], 2, Options { steps: 30, ..Options::default() }, 3)
}

fn data_that_are_not_finite_are_named<S: Kernels>(variant: &Variant<S>) {
    let case = small();
    let mut run = variant.on(&case);
    for k in 0..7 {
        take(&mut run, &case, k).unwrap();
    }
    let before = (run.estimate().to_vec(), run.covariance().state(), run.innovation().to_vec());
    let not_finite = |result: Result<(), IdentifierError>, name: &str| match result {
        Err(IdentifierError::NotFinite { step: 7, channel, value }) => {
            assert_eq!(channel, name);
            assert!(!value.is_finite());
        }
        other => panic!("{name}: {other:?}"),
    };
    not_finite(run.step(&[0.0, f64::NAN], &[0.0; 2]), "output 2");
    not_finite(run.step(&[f64::INFINITY, 0.0], &[0.0; 2]), "output 1");
    // An infinite output is not a missing one, and an input cannot be missing.
    not_finite(run.step_with_missing(&[0.0, f64::NEG_INFINITY], &[0.0; 2]), "output 2");
    not_finite(run.step_with_missing(&[0.0; 2], &[f64::NAN, 0.0]), "input 1");
    not_finite(run.step(&[0.0; 2], &[0.0, f64::INFINITY]), "input 2");
    for (z, u, name) in [(3, 2, "the outputs"), (0, 2, "the outputs"), (2, 1, "the inputs")] {
        match run.step(&vec![0.0; z], &vec![0.0; u]) {
            Err(IdentifierError::Length { name: found, expected: 2, .. }) => assert_eq!(found, name),
            other => panic!("{other:?}"),
        }
    }
    // A sample that is refused leaves the run as it was.
    assert_eq!(before, (run.estimate().to_vec(), run.covariance().state(), run.innovation().to_vec()));
    assert_eq!(run.steps(), 7);
    take(&mut run, &case, 7).unwrap();
}

test_every_variant!(data_that_are_not_finite_are_named:
    plain_f64 = Plain<f64>,
    nalgebra_f32 = Nalgebra<f32>,
);

fn beginnings_that_cannot_be_are_refused<S: Kernels>(variant: &Variant<S>) {
    let form = ObservableForm::new(&[2, 1], 2).unwrap();
    let good = Settings::new(&form, 1.0, 1.0);
    let noise = NoiseModel::paper_squared(2, 2, 3);
    let refused = |settings: &Settings| variant.begin(form.clone(), &noise, settings).map(|_| ()).unwrap_err();
    variant.begin(form.clone(), &noise, &good).unwrap();
    let size = good.initial_estimate.len();
    let name = variant.label();

    for forgetting in [0.0, -0.5, 1.0 + 1e-9, f64::NAN, f64::INFINITY] {
        let error = refused(&Settings { forgetting, ..good.clone() });
        assert!(matches!(error, IdentifierError::Range { name: "the forgetting factor", .. }), "{name} {error}");
    }
    for parameter_noise in [-1e-12, f64::NAN, f64::INFINITY] {
        let error = refused(&Settings { parameter_noise, ..good.clone() });
        assert!(matches!(error, IdentifierError::Range { name: "the parameter noise", .. }), "{name} {error}");
    }
    let mut short = good.clone();
    short.initial_estimate.pop();
    assert!(matches!(refused(&short), IdentifierError::Length { .. }));
    let mut lost = good.clone();
    lost.initial_estimate[4] = f64::NAN;
    assert!(matches!(refused(&lost), IdentifierError::Diverged { step: 0, index: 4 }));

    let diagonal = |i: usize, value: f64| {
        let mut d = vec![1.0; size];
        d[i] = value;
        refused(&Settings { initial_covariance: InitialCovariance::Diagonal(d), ..good.clone() })
    };
    for value in [-1e-12, f64::NAN, f64::INFINITY] {
        let error = diagonal(5, value);
        assert!(matches!(error, IdentifierError::InitialCovariance { index: 5, .. }), "{name} {error}");
    }
    let full = |change: &dyn Fn(&mut Dense<f64>)| {
        let mut p0 = Dense::from_fn(size, size, |i, j| if i == j { 1.0 } else { 0.0 });
        change(&mut p0);
        refused(&Settings { initial_covariance: InitialCovariance::Full(p0), ..good.clone() })
    };
    let both = |p: &mut Dense<f64>, i: usize, j: usize, value: f64| {
        *p.at_mut(i, j) = value;
        *p.at_mut(j, i) = value;
    };
    for error in [
        full(&|p| both(p, 2, 7, 1.01)),
        full(&|p| *p.at_mut(3, 3) = -1e-9),
        full(&|p| *p.at_mut(3, 3) = f64::NAN),
        // No negative pivot: [0 1; 1 0] in entries 2 and 7.
        full(&|p| {
            both(p, 2, 2, 0.0);
            both(p, 7, 7, 0.0);
            both(p, 2, 7, 1.0);
        }),
        full(&|p| both(p, 2, 7, f64::NAN)),
    ] {
        assert!(matches!(error, IdentifierError::InitialCovariance { .. }), "{name} {error}");
    }
    // The forms read different triangles of P0; they must not differ in silence.
    for (row, column) in [(2, 7), (7, 2)] {
        let error = full(&|p| *p.at_mut(row, column) = 0.1);
        assert!(matches!(error, IdentifierError::InitialNotSymmetric { row: 8, column: 3 }), "{name} {error}");
    }
    let p0 = InitialCovariance::Full(Dense::from_fn(size, size - 1, |_, _| 0.0));
    assert!(matches!(refused(&Settings { initial_covariance: p0, ..good.clone() }), IdentifierError::Length { .. }));
}

test_every_variant!(beginnings_that_cannot_be_are_refused:
    plain_f64 = Plain<f64>,
    plain_f32 = Plain<f32>,
    plain_double_double = Plain<qd::Quad>,
);

fn noise_models_that_cannot_be_are_refused<S: Kernels>(variant: &Variant<S>) {
    let form = ObservableForm::new(&[2, 1], 2).unwrap();
    let good = Settings::new(&form, 1.0, 1.0);
    let noise = NoiseModel::paper_squared(2, 2, 3);
    let mut indefinite = noise.clone();
    *indefinite.actuator_sensor.at_mut(1, 0) = 1.0;
    assert!(matches!(
        variant.begin(form.clone(), &indefinite, &good).map(|_| ()),
        Err(IdentifierError::Noise(NoiseError::Indefinite { .. }))
    ));
    // A model that is refused between steps leaves the former one in force.
    let case = small();
    let (mut run, mut other) = (variant.on(&case), variant.on(&case));
    assert!(run.set_noise(&NoiseModel::paper_literal(2, 2, 4)).is_err());
    for k in 0..5 {
        let mut negative = case.noise[0].clone();
        *negative.state.at_mut(0, 0) = -1.0;
        assert!(run.set_noise(&negative).is_err());
        take(&mut run, &case, k).unwrap();
        take(&mut other, &case, k).unwrap();
    }
    assert_eq!(run.covariance().state(), other.covariance().state());
}

test_every_variant!(noise_models_that_cannot_be_are_refused:
    plain_f64 = Plain<f64>,
    plain_f32 = Plain<f32>,
    plain_double_double = Plain<qd::Quad>,
);

/// A joint covariance that is only just one: v follows w_1 and xi_3 follows w_2.
fn singular_noise_is_no_error<S: Kernels>(variant: &Variant<S>) {
    let mut case = random_case(&[2, 1], 1, Options { steps: 20, ..Options::default() }, 17);
    let form = ObservableForm::new(&case.indices, case.inputs).unwrap();
    let root = |a: f64, b: f64| (a * b).sqrt();
    // What is left of Q and Sigma given w is zero but for rounding, of either sign.
    for i in 1..30 {
        let (q, sigma) = (0.1 * f64::from(i), 0.03 * f64::from(i));
        let mut noise = NoiseModel::diagonal(&[0.1, 0.3], &[q], &[0.0, 0.0, sigma]);
        *noise.actuator_sensor.at_mut(0, 0) = root(q, 0.1);
        *noise.sensor_state.at_mut(1, 2) = -root(0.3, sigma);
        case.noise = vec![noise];
        let mut run = variant.begin(form.clone(), &case.noise[0], &case.settings).unwrap();
        for k in 0..case.z.len() {
            if let Err(error) = take(&mut run, &case, k) {
                panic!("{}, q = {q}: {error}", variant.label());
            }
        }
    }
}

test_every_variant!(singular_noise_is_no_error:
    plain_f64 = Plain<f64>,
    nalgebra_f64 = Nalgebra<f64>,
    faer_f64 = Faer<f64>,
    plain_double_double = Plain<qd::Quad>,
);

/// P0 / R = 4e5 at n = 24 is too much for a covariance carried as a matrix in f32, and not for its factors.
#[test]
fn a_covariance_that_is_lost_is_a_typed_error() {
    let mut case = random_case(&[8, 8, 8], 3, Options { steps: 400, noise_scale: 1e-3, ..Options::default() }, 24);
    let form = ObservableForm::new(&case.indices, case.inputs).unwrap();
    case.noise = vec![NoiseModel::diagonal(&[2.5e-6; 3], &[0.0; 3], &[1e-9; 24])];
    case.settings = Settings::new(&form, 1.0, 1.0);
    let mut direct = Variant::of::<Direct<Plain<f32>>, Prior<f32>>().on(&case);
    let error = (0..case.z.len()).find_map(|k| take(&mut direct, &case, k).err().map(|error| (k, error)));
    match error {
        Some((k, IdentifierError::Indefinite { step, phase, index, value })) => {
            println!("direct f32: step {step}, {phase}, pivot {value:.3e} at {index}");
            assert_eq!(step, k as u64);
            assert!(index < 24 * 7 && !(value > 0.0));
        }
        other => panic!("{other:?}"),
    }
    let survivor = Variant::of::<BiermanUd<Plain<f32>>, Prior<f32>>().finish(&case);
    let health = survivor.covariance().own_health();
    println!("{health:?}");
    assert!(health.smallest_pivot > 0.0 && health.condition.is_finite());
}

/// A number that f32 cannot represent is an error, not a panic or a NaN that propagates.
fn overflow_is_a_typed_error<S: Kernels>(variant: &Variant<S>) {
    let mut case = small();
    let mut run = variant.on(&case);
    let error = run.step(&[1e300, 0.0], &[0.0, 0.0]).unwrap_err();
    assert!(matches!(error, IdentifierError::Diverged { step: 0, .. } | IdentifierError::Indefinite { step: 0, .. }));
    *case.noise[0].sensor.at_mut(0, 0) = 1e300;
    let mut run = variant.on(&case);
    let error = run.step(&[0.0, 0.0], &[0.0, 0.0]).unwrap_err();
    assert!(
        matches!(error, IdentifierError::Diverged { step: 0, .. } | IdentifierError::Indefinite { step: 0, .. }),
        "{} {error}",
        variant.label()
    );
}

test_every_variant!(overflow_is_a_typed_error:
    plain_f32 = Plain<f32>,
    faer_f32 = Faer<f32>,
);
