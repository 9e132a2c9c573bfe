//! Measurement updates whose answer is known in closed form and which cancel badly: each form to its own order of
//! magnitude.

use plid_backends::Plain;
use plid_testkit::{bierman, check_scalar_update, dyer_mcreynolds};
use plid_variants::covariance::{ArraySqrt, BiermanUd, Direct, Joseph};

/// Published in double, d = 3.7e-8: conventional 3e-2, Joseph 8e-3, Bierman 2e-10; d = 3.7e-10: conventional
/// fails, Joseph .20, Bierman 5e-8. (Bierman's own figures hold the rounding of 1 + d, which is kept out here.)
#[test]
fn dyer_mcreynolds_by_form() {
    let between = |low: f64, high: f64| move |error: Option<f64>| error.is_some_and(|e| low < e && e < high);
    let lost = |error: Option<f64>| error.is_none_or(|e| e > 0.1);
    for (d, conventional, joseph, bierman, root) in
        [(3.7e-8, (3e-3, 0.3), (8e-4, 8e-2), 2e-9, 2e-8), (3.7e-10, (0.1, f64::INFINITY), (0.02, 2.0), 5e-8, 2e-6)]
    {
        let found = dyer_mcreynolds::<Direct<Plain<f64>>>(d);
        println!("d = {d}: direct {found:?}");
        assert!(
            between(conventional.0, conventional.1)(found) || (d < 1e-9 && lost(found)),
            "d = {d}: direct {found:?}"
        );
        let found = dyer_mcreynolds::<Joseph<Plain<f64>>>(d);
        println!("d = {d}: Joseph {found:?}");
        assert!(between(joseph.0, joseph.1)(found), "d = {d}: Joseph {found:?}");
        let found = dyer_mcreynolds::<BiermanUd<Plain<f64>>>(d);
        println!("d = {d}: Bierman UD {found:?}");
        assert!(between(-1.0, bierman)(found), "d = {d}: Bierman UD {found:?}");
        let found = dyer_mcreynolds::<ArraySqrt<Plain<f64>>>(d);
        println!("d = {d}: array square root {found:?}");
        assert!(between(-1.0, root)(found), "d = {d}: array square root {found:?}");
    }
}

/// With e^2 below roundoff the conventional update gives a matrix that is not a covariance, or gives up; the others are
/// right.
#[test]
fn bierman_two_by_two_by_form() {
    for e in [1e-8, 1e-9] {
        let direct = bierman::<Direct<Plain<f64>>>(e);
        assert!(direct.is_none_or(|error| error > 0.1), "e = {e}: direct {direct:?}");
        let joseph = bierman::<Joseph<Plain<f64>>>(e);
        assert!(joseph.is_some_and(|error| error < 1e-7), "e = {e}: Joseph {joseph:?}");
        let factored = [bierman::<BiermanUd<Plain<f64>>>(e), bierman::<ArraySqrt<Plain<f64>>>(e)];
        assert!(factored.iter().all(|error| error.is_some_and(|e| e < 1e-14)), "e = {e}: {factored:?}");
        println!("e = {e}: direct {direct:?}, Joseph {joseph:?}, UD and square root {factored:?}");
    }
}

#[test]
fn scalar_update_of_any_row() {
    check_scalar_update::<Direct<Plain<f64>>>();
    check_scalar_update::<Joseph<Plain<f64>>>();
    check_scalar_update::<BiermanUd<Plain<f64>>>();
    check_scalar_update::<ArraySqrt<Plain<f64>>>();
}
