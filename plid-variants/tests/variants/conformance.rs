//! Every form on every backend and in every scalar conforms.

use plid_core::{CovariancePropagation, Form, InitialCovariance, ObservableForm, Scalar, ScalarOf};
use plid_testkit::case::{Options, random_case};
use plid_testkit::check_form;
use plid_testkit::run::{Variant, identified, with_every_expectation};
use plid_variants::covariance::*;

/// The check leaves out what a form says that it cannot do: plid's own forms can do all of it.
fn forgets_and_takes_parameter_noise<C: CovariancePropagation>() {
    let model = ObservableForm::new(&[2, 1], 1).unwrap();
    let mut form = C::new(&model, &InitialCovariance::Diagonal(vec![1.0; 12]), &C::Options::default()).unwrap();
    form.scale(ScalarOf::<C>::from_f64(1.01)).unwrap();
    form.add_parameter_noise(ScalarOf::<C>::from_f64(0.01), 0).unwrap();
}

/// The check allows for rounding where nothing is measured: plid's own forms keep the parameters' covariance to the
/// bit.
fn keeps_the_parameters_without_outputs<C: Form>() {
    let case = random_case(&[2, 1], 1, Options { steps: 20, ..Options::default() }, 4);
    for variant in with_every_expectation::<C>() {
        let mut run = variant.finish(&case);
        let before = identified(&run).covariance;
        run.step_with_missing(&[f64::NAN; 2], &[0.7]).unwrap();
        let after = identified(&run).covariance;
        for j in case.states()..before.columns() {
            for i in case.states()..before.rows() {
                assert_eq!(after.at(i, j), before.at(i, j), "{}", variant.label());
            }
        }
    }
}

/// One `#[test]` a form, over one backend and scalar.
macro_rules! test_forms {
    ($backend:ident [$scalar:ty] $($(#[$doc:meta])* $word:literal = $form:ident;)*) => {
        $(#[test]
        #[allow(non_snake_case)]
        fn $form() {
            type Form = super::$form<plid_backends::$backend<$scalar>>;
            check_form::<Form>();
            super::forgets_and_takes_parameter_noise::<Form>();
            super::keeps_the_parameters_without_outputs::<Form>();
        })*
    };
}

macro_rules! test_backends {
    ($($name:ident = $backend:ident [$scalar:ty];)*) => {
        $(mod $name {
            use super::check_form;
            plid_variants::every_form!(test_forms, $backend, [$scalar]);
        })*
    };
}

test_backends! {
    plain_f64 = Plain [f64];
    plain_f32 = Plain [f32];
    plain_double_double = Plain [qd::Quad];
    nalgebra_f64 = Nalgebra [f64];
    nalgebra_f32 = Nalgebra [f32];
    faer_f64 = Faer [f64];
    faer_f32 = Faer [f32];
}

/// A checkpoint of another structure, or of another form, is refused and changes nothing.
#[test]
fn checkpoints_of_others_are_refused() {
    use plid_backends::Plain;
    use plid_variants::expectations::MomentMatched;

    let case = random_case(&[2, 1], 1, Options { steps: 5, ..Options::default() }, 4);
    let larger = random_case(&[2, 2], 1, Options { steps: 5, ..Options::default() }, 4);
    let bierman = Variant::of::<BiermanUd<Plain<f64>>, MomentMatched<f64>>();
    let mut run = bierman.finish(&case);
    let before = run.checkpoint();
    assert!(run.restore(&bierman.finish(&larger).checkpoint()).is_err());
    assert!(run.restore(&bierman.with_form::<Direct<Plain<f64>>>().finish(&case).checkpoint()).is_err());
    assert_eq!(run.checkpoint(), before);
}
