//! Noise models: those that can be are taken, those that cannot are refused by name.

use plid_core::{Dense, NoiseError, NoiseModel, NoiseTerms};

fn good() -> NoiseModel {
    NoiseModel::diagonal(&[0.5, 1.0], &[2.0], &[0.1, 0.2, 0.3])
}

fn check(noise: &NoiseModel) -> Result<(), NoiseError> {
    noise.check(2, 1, 3)
}

fn place_of(noise: &NoiseModel) -> String {
    match check(noise) {
        Err(NoiseError::Indefinite { place, .. }) => place,
        other => panic!("{other:?}"),
    }
}

#[test]
fn diagonal_zero_and_fully_correlated_models_are_taken() {
    assert_eq!(check(&good()), Ok(()));
    assert_eq!(check(&NoiseModel::diagonal(&[0.0; 2], &[0.0], &[0.0; 3])), Ok(()));
    // v = 2 w_1, xi_3 = -w_1 + w_2: singular, and a covariance all the same.
    let mut noise = good();
    noise.actuator_sensor = Dense::from_fn(1, 2, |_, j| if j == 0 { 1.0 } else { 0.0 });
    *noise.state.at_mut(2, 2) = 1.5;
    *noise.sensor_state.at_mut(0, 2) = -0.5;
    *noise.sensor_state.at_mut(1, 2) = 1.0;
    *noise.actuator_state.at_mut(0, 2) = -1.0;
    assert_eq!(check(&noise), Ok(()));
}

#[test]
fn every_wrong_shape_is_named() {
    for (which, name) in ["R", "Q", "Sigma", "S^{vw}", "S^{w xi}", "S^{v xi}"].into_iter().enumerate() {
        let mut noise = good();
        let wrong = Dense::from_fn(4, 4, |_, _| 0.0);
        match which {
            0 => noise.sensor = wrong,
            1 => noise.actuator = wrong,
            2 => noise.state = wrong,
            3 => noise.actuator_sensor = wrong,
            4 => noise.sensor_state = wrong,
            _ => noise.actuator_state = wrong,
        }
        match check(&noise) {
            Err(NoiseError::Shape { name: found, rows: 4, columns: 4, .. }) => {
                assert!(found.starts_with(&format!("{name} ")), "{found}");
            }
            other => panic!("{name}: {other:?}"),
        }
    }
}

#[test]
fn entries_that_are_not_finite_are_placed() {
    for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let mut noise = good();
        *noise.sensor_state.at_mut(1, 2) = value;
        let name = "S^{w xi} (sensor-state)";
        assert_eq!(check(&noise), Err(NoiseError::NotFinite { name, row: 2, column: 3 }));
        let mut noise = good();
        *noise.state.at_mut(0, 2) = value;
        assert!(check(&noise).is_err());
    }
}

#[test]
fn an_unsymmetric_covariance_is_placed() {
    let mut noise = good();
    *noise.state.at_mut(2, 1) = 0.01;
    assert_eq!(check(&noise), Err(NoiseError::NotSymmetric { name: "Sigma (state)", row: 3, column: 2 }));
}

#[test]
fn negative_variances_are_placed() {
    let mut noise = good();
    *noise.sensor.at_mut(1, 1) = -1e-12;
    assert_eq!(place_of(&noise), "output 2");
    let mut noise = good();
    *noise.actuator.at_mut(0, 0) = -1.0;
    assert_eq!(place_of(&noise), "input 1");
    let mut noise = good();
    *noise.state.at_mut(2, 2) = -1.0;
    assert_eq!(place_of(&noise), "state 3");
}

#[test]
fn correlations_without_variance_or_above_one_are_refused() {
    // [0 1; 1 0] has no negative entry on its diagonal.
    let mut noise = good();
    noise.sensor = Dense::from_fn(2, 2, |i, j| if i == j { 0.0 } else { 1.0 });
    assert_eq!(place_of(&noise), "output 1");
    let mut noise = good();
    noise.sensor = Dense::from_fn(2, 2, |i, j| if i == j { 1.0 } else { 1.001 });
    place_of(&noise);
    // Each block is a covariance, the whole is none: v would correlate with w_1 by 1.1.
    let mut noise = good();
    *noise.actuator_sensor.at_mut(0, 0) = 1.1;
    place_of(&noise);
    // Three by three: every pair is possible, the three together are not.
    let mut noise = good();
    noise.state = Dense::from_fn(3, 3, |i, j| {
        if i == j {
            1.0
        } else if i + j == 1 {
            -0.9
        } else {
            0.9
        }
    });
    place_of(&noise);
}

/// All correlations are one but one: its Schur complement is [0 -d; -d 0], with no negative pivot and a negative
/// eigenvalue.
#[test]
fn an_indefinite_remainder_without_a_pivot_is_refused() {
    for d in [1e-2, 1e-5, 1e-7] {
        let mut noise = good();
        noise.state = Dense::from_fn(3, 3, |i, j| if i + j == 3 && i != j { 1.0 - d } else { 1.0 });
        place_of(&noise);
    }
}

/// What the check lets pass as rounding must not stop the terms.
#[test]
fn rounding_that_the_check_lets_pass_is_harmless() {
    let mut noise = good();
    noise.sensor = Dense::from_fn(2, 2, |i, j| if i == j { 1.0 } else { 1.0 + 1e-11 });
    assert_eq!(check(&noise), Ok(()));
    let terms = NoiseTerms::<f64>::new(&noise);
    assert_eq!(terms.sensor_pivots(), [1.0, 0.0]);
    assert_eq!(NoiseTerms::<f32>::new(&noise).sensor_pivots(), [1.0, 0.0]);
}

/// L = S^{vw} R^-1, M = (S^{w xi})^T R^-1 and the conditional covariances, by hand for R = diag(.5, 1).
#[test]
fn conditional_terms_by_hand() {
    let mut noise = good();
    noise.actuator_sensor = Dense::from_fn(1, 2, |_, j| [0.2, 0.3][j]);
    *noise.sensor_state.at_mut(1, 2) = 0.1;
    *noise.actuator_state.at_mut(0, 2) = 0.05;
    assert_eq!(check(&noise), Ok(()));
    let mut terms = NoiseTerms::<f64>::new(&noise);
    let close = |a: f64, b: f64| assert!((a - b).abs() < 1e-15, "{a} {b}");
    close(terms.l().at(0, 0), 0.4);
    close(terms.l().at(0, 1), 0.3);
    close(terms.m().at(2, 1), 0.1);
    close(terms.actuator_given().at(0, 0), 2.0 - 0.4 * 0.2 - 0.3 * 0.3);
    close(terms.state_given().at(2, 2), 0.3 - 0.1 * 0.1);
    close(terms.actuator_state_given().at(0, 2), 0.05 - 0.3 * 0.1);
    // Output 1 missing: output 2 is what is left to condition on, and comes back in its own place.
    terms.set_available([false, true].into_iter());
    assert_eq!(terms.available(), [1]);
    close(terms.l().at(0, 0), 0.3);
    close(terms.actuator_given().at(0, 0), 2.0 - 0.3 * 0.3);
    terms.set_available([false, false].into_iter());
    assert_eq!(terms.available(), [] as [usize; 0]);
    close(terms.actuator_given().at(0, 0), 2.0);
    terms.set_available([true, true].into_iter());
    close(terms.l().at(0, 0), 0.4);
    close(terms.l().at(0, 1), 0.3);
}
