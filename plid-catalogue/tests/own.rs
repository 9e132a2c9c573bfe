//! A form, an expectation and a backend from outside are named like those that are built in.
use std::marker::PhantomData;

use plid_backends::Plain;
use plid_catalogue::{
    BackendEntry, BackendName, CovarianceName, Entry, ExpectationEntry, ExpectationName, PairEntry, ScalarName,
    Variant, VariantError, forms,
};
use plid_core::kernels::{BadPivot, Kernels};
use plid_core::{
    Backend, Checkpointed, ConditionalExpectations, CovarianceBlocks, CovariancePropagation, Dense, Expectation, Form,
    FormFacts, IdentifierError, ImplicitModel, InitialCovariance, Inspect, NoiseModel, NoiseTerms, ObservableForm,
    Scalar, Settings, StepSize, StepView, Term, Transition, ViewMut,
};
use plid_variants::covariance::Direct;
use plid_variants::expectations::JointEkf;

#[path = "../../plid-cli/examples/own_form/form.rs"]
mod form;

use form::Own;

/// The joint EKF under another name, in f64.
struct OwnExpectation(JointEkf<f64>);

impl ConditionalExpectations for OwnExpectation {
    type Scalar = f64;
    type Options = ();

    fn new(model: &dyn ImplicitModel, _: &()) -> Self {
        Self(JointEkf::new(model, &()))
    }
    fn after(
        &mut self,
        step: &StepView<'_, f64>,
        covariance: &mut dyn CovarianceBlocks<f64>,
        transition: &mut Transition<f64>,
    ) {
        self.0.after(step, covariance, transition);
    }
}

impl Expectation for OwnExpectation {
    const FLOPS: fn(&StepSize, &FormFacts) -> Vec<Term> = JointEkf::<f64>::FLOPS;
}

/// Storage, and the default kernels, in any scalar.
#[derive(Clone, Copy, Debug)]
struct OwnBackend<S>(PhantomData<S>);

impl<S: Kernels> Backend for OwnBackend<S> {
    type Scalar = S;
    type Matrix = Dense<S>;
}

/// What config text says, on the structure and the start of all tests here.
fn run(variant: Variant, settings: impl Fn(&mut Settings)) -> Result<Vec<[f64; 2]>, VariantError> {
    let form = ObservableForm::new(&[2, 1], 1).unwrap();
    let noise = NoiseModel::diagonal(&[1e-2; 2], &[1e-3], &[1e-3; 3]);
    let mut start = Settings::new(&form, 1.0, 1.0);
    settings(&mut start);
    let mut recursion = variant.build(form, &noise, &start)?;
    for k in 0..20 {
        recursion.step(&[f64::from(k).sin(), f64::from(k).cos()], &[f64::from(k % 3)], false)?;
    }
    Ok(recursion.estimate())
}

#[test]
fn what_a_program_adds_is_named_run_counted_and_listed() {
    let unknown = serde_json::from_str::<CovarianceName>("\"own\"").unwrap_err().to_string();
    assert!(unknown.contains("unknown variant `own`") && unknown.contains("`bierman-ud`"), "{unknown}");
    forms! { "own" = form::Own; }.add();
    ExpectationEntry::only::<OwnExpectation>("own-expectation").add();
    BackendEntry::of::<OwnBackend<f64>>("own-backend").and::<OwnBackend<f32>>().add();

    let own: Variant = serde_json::from_str(r#"{"covariance": "own"}"#).unwrap();
    let built_in = Variant { covariance: CovarianceName::Direct, ..Variant::default() };
    assert_eq!(run(own, |_| ()).unwrap(), run(built_in, |_| ()).unwrap());
    assert_eq!(serde_json::to_value(own).unwrap()["covariance"], "own");
    assert!(CovarianceName::all().contains(&own.covariance) && !own.covariance.is_factored());
    for backend in [BackendName::Plain, BackendName::TwoThreads, BackendName::Nalgebra, BackendName::Faer] {
        assert!(run(Variant { backend, ..own }, |_| ()).is_ok());
    }
    assert!(run(Variant { scalar: ScalarName::DoubleDouble, ..own }, |_| ()).is_ok());

    let expectations: ExpectationName = serde_json::from_str("\"own-expectation\"").unwrap();
    let found = run(Variant { expectations, ..built_in }, |_| ()).unwrap();
    assert_eq!(found, run(Variant { expectations: ExpectationName::JointEkf, ..built_in }, |_| ()).unwrap());
    let absent = run(Variant { expectations, scalar: ScalarName::F32, ..built_in }, |_| ()).unwrap_err();
    assert_eq!(absent.to_string(), "there is no direct with own-expectation on plain in f32");

    let backend: BackendName = serde_json::from_str("\"own-backend\"").unwrap();
    for scalar in [ScalarName::F64, ScalarName::F32] {
        let plain = Variant { scalar, ..built_in };
        assert_eq!(run(Variant { backend, ..plain }, |_| ()).unwrap(), run(plain, |_| ()).unwrap());
    }
    let absent = run(Variant { backend, scalar: ScalarName::DoubleDouble, ..built_in }, |_| ()).unwrap_err();
    assert!(absent.to_string().contains("on own-backend in double-double"), "{absent}");

    // Their pair goes by both names once it is added.
    let pair = Variant { backend, ..own };
    let absent = run(pair, |_| ()).unwrap_err();
    let in_f32 = "there is no own with moment-matched on own-backend in f32";
    assert_eq!(absent.to_string(), "there is no own with moment-matched on own-backend in f64");
    let add = || PairEntry::of::<Own<OwnBackend<f64>>>("own", "own-backend").add();
    add();
    assert_eq!(run(pair, |_| ()).unwrap(), run(built_in, |_| ()).unwrap());
    assert!(run(Variant { scalar: ScalarName::F32, ..pair }, |_| ()).is_err());
    assert!(std::panic::catch_unwind(add).is_err(), "a pair is taken twice");
    let unknown = || PairEntry::of::<Own<OwnBackend<f64>>>("own", "nobody's").add();
    assert!(std::panic::catch_unwind(unknown).is_err(), "a pair of an unknown backend");

    // What the form does not offer is a typed error, and no wrong number.
    let unsupported = run(own, |settings| settings.forgetting = 0.99).unwrap_err();
    assert!(matches!(unsupported, VariantError::Identifier(IdentifierError::Unsupported(_))), "{unsupported}");
    let unsupported = run(own, |settings| settings.parameter_noise = 1e-6).unwrap_err();
    assert!(unsupported.to_string().contains("parameter noise"), "{unsupported}");
    // A config that asks for it is refused where it is read.
    assert_eq!(own.check(1.0, 1e-6).unwrap_err().to_string(), unsupported.to_string());
    assert_eq!(pair.check(1.0, 0.0), Ok(()));
    assert_eq!(Variant { scalar: ScalarName::F32, ..pair }.check(1.0, 0.0).unwrap_err().to_string(), in_f32);

    let size = StepSize { n: 12.0, p: 3.0, m: 3.0, full_noise: false };
    assert_eq!(own.flops(&size), Variant { covariance: CovarianceName::Direct, ..own }.flops(&size));
    let form = ObservableForm::new(&[2, 1], 1).unwrap();
    let noise = NoiseModel::diagonal(&[1e-2; 2], &[1e-3], &[1e-3; 3]);
    assert!(own.build_counted(form.clone(), &noise, &Settings::new(&form, 1.0, 1.0)).is_ok());
    // A type that the recursion is built of directly has no name, and needs none.
    let _: Own<Plain<f32>> = Own::new(&form, &InitialCovariance::Diagonal(vec![1.0; 12]), &()).unwrap();
}
