//! Every combination that has a name can be built and run.
use plid_catalogue::{BackendName, CovarianceName, ScalarName, Variant};
use plid_core::{NoiseModel, ObservableForm, Settings};

#[test]
fn every_named_combination_runs_and_double_double_needs_plain_loops() {
    let form = ObservableForm::new(&[2, 1], 1).unwrap();
    let noise = NoiseModel::diagonal(&[1e-2; 2], &[1e-3], &[1e-3; 3]);
    let settings = Settings::new(&form, 1.0, 1.0);
    for covariance in CovarianceName::BUILT_IN {
        for backend in BackendName::BUILT_IN {
            for scalar in [ScalarName::F32, ScalarName::F64, ScalarName::DoubleDouble] {
                let variant = Variant { covariance, backend, scalar, ..Variant::default() };
                match variant.build(form.clone(), &noise, &settings) {
                    Ok(mut recursion) => {
                        recursion.step(&[1.0, 2.0], &[0.5], false).unwrap();
                        assert_eq!(recursion.innovation(), [1.0, 2.0]);
                    }
                    Err(error) => {
                        let library = matches!(backend, BackendName::Nalgebra | BackendName::Faer);
                        assert!(library && scalar == ScalarName::DoubleDouble, "{error}");
                    }
                }
            }
        }
    }
}
