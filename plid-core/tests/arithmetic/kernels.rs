//! Factorisations against what they factor, and the pivots that they report.

use plid_core::kernels::{BadPivot, cholesky, dot, pivoted_cholesky, semidefinite_ldl, solve_lower};
use plid_core::{Dense, Matrix};

/// W W^T of an n x r array: of rank r.
fn gram(n: usize, r: usize) -> Dense<f64> {
    let w = |i: usize, k: usize| ((1 + 7 * i + 31 * k).pow(2) as f64 * 0.129898).sin();
    Dense::from_fn(n, n, |i, j| (0..r).map(|k| w(i, k) * w(j, k)).sum())
}

#[test]
fn dot_takes_every_term() {
    for n in 0..11 {
        let x: Vec<f64> = (0..n).map(|i| 1.0 + i as f64).collect();
        let expected = (1..=n).map(|i| (i * i) as f64).sum::<f64>();
        assert_eq!(dot(&x, &x), expected);
    }
}

#[test]
fn cholesky_solves() {
    let a = gram(6, 8);
    let mut l = a.clone();
    cholesky(l.view_mut()).unwrap();
    for i in 0..6 {
        for j in 0..=i {
            let product: f64 = (0..=j).map(|k| l.at(i, k) * l.at(j, k)).sum();
            assert!((product - a.at(i, j)).abs() < 1e-14);
        }
    }
    let x = [1.0, -2.0, 3.0, -4.0, 5.0, -6.0];
    let mut b: Vec<f64> = (0..6).map(|i| (0..=i).map(|j| l.at(i, j) * x[j]).sum()).collect();
    solve_lower(l.view(), &mut b);
    for (found, expected) in b.iter().zip(x) {
        assert!((found - expected).abs() < 1e-12);
    }
}

#[test]
fn cholesky_names_the_pivot() {
    let mut a = Dense::from_diagonal(&[1.0, 4.0, -9.0, 1.0]);
    assert_eq!(cholesky(a.view_mut()), Err(BadPivot { index: 2, value: -9.0 }));
    let mut a = Dense::from_diagonal(&[1.0, f64::NAN]);
    assert_eq!(cholesky(a.view_mut()).unwrap_err().index, 1);
}

#[test]
fn semidefinite_factors_of_a_singular_matrix() {
    for rank in 1..=5 {
        let a = gram(5, rank);
        let (mut t, mut d) = (a.clone(), vec![0.0; 5]);
        semidefinite_ldl(t.view_mut(), &mut d, 1e-13, 1e-13).unwrap();
        assert_eq!(d.iter().filter(|&&x| x > 0.0).count(), rank);
        let unit = |i: usize, k: usize| if i == k { 1.0 } else { t.at(i, k) };
        for i in 0..5 {
            for j in 0..=i {
                let product: f64 = (0..=j).map(|k| unit(i, k) * d[k] * unit(j, k)).sum();
                assert!((product - a.at(i, j)).abs() < 1e-12, "rank {rank}");
            }
        }
        let (mut rest, mut l) = (a.clone(), Dense::zeros(5, 5));
        assert_eq!(pivoted_cholesky(rest.view_mut(), l.view_mut(), &mut [0.0; 5], 1e-13, 1e-13), Ok(rank));
        for i in 0..5 {
            for j in 0..=i {
                let product: f64 = (0..5).map(|k| l.at(i, k) * l.at(j, k)).sum();
                assert!((product - a.at(i, j)).abs() < 1e-12, "rank {rank}, pivoted");
            }
        }
    }
}

#[test]
fn indefinite_matrices_are_refused_also_behind_a_zero_pivot() {
    let mut d = vec![0.0; 2];
    let mut a = Dense::from_diagonal(&[2.0, -1.0]);
    assert_eq!(semidefinite_ldl(a.view_mut(), &mut d, 1e-13, 1e-13), Err(BadPivot { index: 1, value: -1.0 }));
    let mut a = Dense::from_fn(2, 2, |i, j| if i == j { 0.0 } else { 1.0 });
    assert_eq!(semidefinite_ldl(a.view_mut(), &mut d, 1e-13, 1e-13).unwrap_err().index, 0);
    let mut a = Dense::from_fn(2, 2, |i, j| if (i, j) == (0, 0) { 0.0 } else { 1.0 });
    assert_eq!(semidefinite_ldl(a.view_mut(), &mut d, 1e-13, 1e-13).unwrap_err().index, 0);
    let (mut a, mut l) = (Dense::from_diagonal(&[2.0, -1.0]), Dense::zeros(2, 2));
    assert_eq!(
        pivoted_cholesky(a.view_mut(), l.view_mut(), &mut [0.0; 5], 1e-13, 1e-13),
        Err(BadPivot { index: 1, value: -1.0 })
    );
}

/// Rows of different units: no row is dropped for being small.
#[test]
fn small_entries_beside_large_ones_are_kept() {
    let (mut a, mut l) = (Dense::from_diagonal(&[1e12, 1e-12, 1.0]), Dense::zeros(3, 3));
    assert_eq!(pivoted_cholesky(a.view_mut(), l.view_mut(), &mut [0.0; 3], 1e-13, 1e-13), Ok(3));
    for (i, expected) in [1e12, 1e-12, 1.0].into_iter().enumerate() {
        let square: f64 = (0..3).map(|k| l.at(i, k) * l.at(i, k)).sum();
        assert!((square / expected - 1.0).abs() < 1e-15);
    }
}
