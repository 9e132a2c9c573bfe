//! The recommended form, at the edges of what was studied.
use plid_catalogue::{Conditions, CovarianceName, ScalarName, VariantChoice};

#[test]
fn the_direct_form_is_for_double_precision_within_what_was_studied() {
    let studied = Conditions { states: 30, scalar: ScalarName::F64, steps: 15_600, start_ratio: 1e5, forgets: false };
    assert_eq!(studied.recommended(), CovarianceName::Direct);
    for beyond in [
        Conditions { states: 65, ..studied },
        Conditions { steps: 100_001, ..studied },
        Conditions { start_ratio: 1e9, ..studied },
        Conditions { start_ratio: f64::INFINITY, ..studied },
        Conditions { start_ratio: f64::NAN, ..studied },
        Conditions { forgets: true, ..studied },
        Conditions { scalar: ScalarName::F32, ..studied },
    ] {
        assert_eq!(beyond.recommended(), CovarianceName::BiermanUd, "{beyond:?}");
    }
}

#[test]
fn what_the_config_names_is_taken() {
    let conditions = Conditions { states: 12, scalar: ScalarName::F32, steps: 10, start_ratio: 1.0, forgets: false };
    let named = VariantChoice { covariance: Some(CovarianceName::Joseph), ..VariantChoice::default() };
    assert_eq!(named.settle(&conditions).covariance, CovarianceName::Joseph);
    assert_eq!(VariantChoice::default().settle(&conditions).covariance, CovarianceName::BiermanUd);
}
