//! Properties of P, computed in double-double from the exact numbers that a form stores, so that the inspection adds no
//! rounding.

use num_traits::{One, Zero};
use plid_core::kernels::{BadPivot, cholesky, semidefinite_ldl, solve_lower};
use plid_core::{Dense, Matrix, Scalar};
use qd::Quad;

/// Returns the first pivot of the correlation matrix of P that is not positive, if there is one. With the correlation
/// matrix, entries of s with different units have equal weight. If a Cholesky factorisation in f64 succeeds, there is
/// none; if it fails, it is repeated in double-double.
pub fn bad_pivot(p: &Dense<Quad>) -> Option<BadPivot> {
    let correlation = match correlation(p) {
        Ok(correlation) => correlation,
        Err(bad) => return Some(bad),
    };
    if cholesky(correlation.cast::<f64>().view_mut()).is_ok() {
        return None;
    }
    let mut correlation = correlation;
    cholesky(correlation.view_mut()).err()
}

/// Returns the ratio of the largest to the smallest pivot of the correlation matrix, which is a lower bound of its
/// condition number, or `None` if the matrix is not positive definite.
pub fn condition(p: &Dense<Quad>) -> Option<f64> {
    let mut correlation = correlation(p).ok()?;
    let mut pivots = vec![Quad::zero(); correlation.rows()];
    semidefinite_ldl(correlation.view_mut(), &mut pivots, 0.0, 0.0).ok()?;
    let pivots = pivots.iter().map(|d| d.to_f64());
    let (low, high) = pivots.fold((f64::INFINITY, 0.0_f64), |(low, high), d| (low.min(d), high.max(d)));
    (low > 0.0).then(|| high / low)
}

/// Returns P_ij / sqrt(P_ii P_jj), or the first variance that is not positive.
fn correlation(p: &Dense<Quad>) -> Result<Dense<Quad>, BadPivot> {
    let deviations = deviations(p)?;
    Ok(Dense::from_fn(p.rows(), p.rows(), |i, j| p.at(i, j) / (deviations[i] * deviations[j])))
}

/// Returns sqrt(P_ii), or the first variance that is not positive.
pub fn deviations(p: &Dense<Quad>) -> Result<Vec<Quad>, BadPivot> {
    (0..p.rows())
        .map(|index| {
            let variance = p.at(index, index);
            let good = variance > Quad::zero() && Scalar::is_finite(variance);
            if good { Ok(Scalar::sqrt(variance)) } else { Err(BadPivot { index, value: variance.to_f64() }) }
        })
        .collect()
}

/// Returns the largest |P_ij - Q_ij| / sqrt(Q_ii Q_jj), which is infinite if P has an entry that is not finite.
pub fn scaled_difference(p: &Dense<Quad>, reference: &Dense<Quad>, deviations: &[Quad]) -> f64 {
    let mut largest = 0.0_f64;
    for j in 0..p.rows() {
        for i in j..p.rows() {
            let difference = ((p.at(i, j) - reference.at(i, j)) / (deviations[i] * deviations[j])).to_f64().abs();
            largest = if difference.is_nan() { f64::INFINITY } else { largest.max(difference) };
        }
    }
    largest
}

/// Returns |s - r| / |r| in the Euclidean norm, and the largest |s_i - r_i| in standard deviations of the reference.
pub fn estimate_errors(s: &[Quad], reference: &[Quad], deviations: &[Quad]) -> (f64, f64) {
    let (mut error, mut size, mut largest) = (0.0, 0.0, 0.0_f64);
    for ((&s, &r), &deviation) in s.iter().zip(reference).zip(deviations) {
        let difference = s - r;
        error += difference.to_f64().powi(2);
        size += r.to_f64().powi(2);
        largest = largest.max((difference / deviation).to_f64().abs());
    }
    let relative = if error == 0.0 { 0.0 } else { (error / size).sqrt() };
    (relative, largest)
}

/// Returns the normalised estimation error squared of the entries of s from `first` on, per degree of freedom: e^T
/// P^-1 e / count. Returns `None` if that part of P is not positive definite.
pub fn nees(p: &Dense<Quad>, estimate: &[Quad], truth: &[f64], first: usize) -> Option<f64> {
    let count = p.rows() - first;
    let mut block = Dense::from_fn(count, count, |i, j| p.at(first + i, first + j));
    cholesky(block.view_mut()).ok()?;
    let mut error: Vec<Quad> = estimate[first..].iter().zip(truth).map(|(&s, &t)| s - Quad::from_f64(t)).collect();
    solve_lower(block.view(), &mut error);
    let sum = error.iter().fold(Quad::zero(), |sum, &e| sum + e * e);
    Some((sum / (Quad::from_f64(count as f64) * Quad::one())).to_f64())
}

/// Restores exact numbers from their parts.
pub fn quads(parts: &[[f64; 2]]) -> Vec<Quad> {
    parts.iter().map(|&x| Quad::from_parts(x)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use plid_backends::Plain;
    use plid_catalogue::{CovarianceName, ScalarName, Variant};
    use plid_core::{InitialCovariance, Inspect, NoiseModel, ObservableForm, ScalarOf, ScalarUpdate, Settings};
    use plid_variants::covariance::{BiermanUd, Direct};

    /// P in double-double agrees with that of the recursion itself, to the roundoff of the recursion.
    #[test]
    fn the_matrix_is_that_of_the_recursion() {
        let form = ObservableForm::new(&[2, 1], 1).unwrap();
        let noise = NoiseModel::diagonal(&[1e-2; 2], &[1e-3], &[1e-3; 3]);
        let settings = Settings::new(&form, 1.0, 0.5);
        for covariance in CovarianceName::BUILT_IN {
            let variant = Variant { covariance, scalar: ScalarName::F64, ..Variant::default() };
            let mut recursion = variant.build(form.clone(), &noise, &settings).unwrap();
            for k in 0..20 {
                recursion.step(&[f64::from(k).sin(), f64::from(k).cos()], &[f64::from(k % 3)], false).unwrap();
            }
            let p = recursion.exact_covariance();
            let expected = recursion.identified().covariance;
            for j in 0..12 {
                for i in 0..12 {
                    let (found, expected) = (p.at(i, j).to_f64(), expected.at(i, j));
                    assert!((found - expected).abs() < 1e-15, "{covariance:?} ({i}, {j}): {found} {expected}");
                }
            }
            assert_eq!(bad_pivot(&p), None);
        }
    }

    /// Returns P after the two measurements of the example of Dyer and McReynolds, in the scalar of a form.
    fn dyer_mcreynolds<C: Inspect + ScalarUpdate>(d: f64) -> Dense<Quad> {
        let model = ObservableForm::new(&[1], 1).unwrap();
        let mut p = C::new(&model, &InitialCovariance::Diagonal(vec![1.0; 3]), &C::Options::default()).unwrap();
        let number = ScalarOf::<C>::from_f64;
        let mut gain = [number(0.0); 3];
        // If an innovation variance is not positive, a form keeps its last P.
        let _ = p.scalar_update(&[number(1.0); 3], number(d * d), &mut gain);
        let _ = p.scalar_update(&[number(1.0), number(1.0), number(1.0) + number(d)], number(d * d), &mut gain);
        p.dense_in()
    }

    /// Where the answer is known in closed form, the distance from double-double is the true error.
    #[test]
    fn the_distance_from_double_double_is_the_true_error_of_dyer_and_mcreynolds() {
        let d = 2.0_f64.powi(-25);
        let exact = {
            let d = Quad::from_f64(d);
            let number = Quad::from_f64;
            let (two, five) = (number(2.0), number(5.0));
            let (a, c) = (five + two * d * (number(1.0) + d), -two - d);
            let scale = number(8.0) + two * d * (number(1.0) + d);
            let rows = [[a, number(-3.0), c], [number(-3.0), a, c], [c, c, number(4.0) + d * d]];
            Dense::from_fn(3, 3, |i, j| rows[i][j] / scale)
        };
        let reference = dyer_mcreynolds::<Direct<Plain<Quad>>>(d);
        let deviations = deviations(&exact).unwrap();
        assert!(scaled_difference(&reference, &exact, &deviations) < 1e-14);
        let conventional = dyer_mcreynolds::<Direct<Plain<f64>>>(d);
        let factored = dyer_mcreynolds::<BiermanUd<Plain<f64>>>(d);
        let error = |p: &Dense<Quad>, from: &Dense<Quad>| scaled_difference(p, from, &deviations);
        for p in [&conventional, &factored] {
            let (found, true_error) = (error(p, &reference), error(p, &exact));
            assert!((found - true_error).abs() < 1e-13, "{found} {true_error}");
        }
        assert!(error(&conventional, &exact) > 1e-4 && error(&factored, &exact) < 1e-7);
    }

    #[test]
    fn an_indefinite_matrix_is_found_however_small_its_defect() {
        // Pivots 1 and 1 - c^2.
        let matrix = |c: Quad| Dense::from_fn(2, 2, |i, j| if i == j { Quad::one() } else { c });
        let one = Quad::one();
        let (inside, outside) = (one - Quad::from_f64(1e-20), one + Quad::from_f64(1e-20));
        assert_eq!(bad_pivot(&matrix(inside)), None);
        assert_eq!(bad_pivot(&matrix(outside)).unwrap().index, 1);
        let condition = condition(&matrix(inside)).unwrap();
        assert!((condition / 5e19 - 1.0).abs() < 1e-6, "{condition}");
    }

    #[test]
    fn nees_is_the_quadratic_form() {
        // P = [2 1; 1 2], e = (1, 1): e^T P^-1 e = 2/3.
        let p = Dense::from_fn(3, 3, |i, j| Quad::from_f64([[9.0, 0.0, 0.0], [0.0, 2.0, 1.0], [0.0, 1.0, 2.0]][i][j]));
        let s: Vec<Quad> = [5.0, 3.0, 4.0].map(Quad::from_f64).to_vec();
        let found = nees(&p, &s, &[2.0, 3.0], 1).unwrap();
        assert!((found - 1.0 / 3.0).abs() < 1e-15);
    }

    #[test]
    fn differences_are_scaled_by_the_reference() {
        let p = Dense::from_fn(2, 2, |i, j| Quad::from_f64(if i == j { 4.0 } else { 1.0 }));
        let mut q = p.clone();
        *q.at_mut(1, 0) += Quad::from_f64(0.4);
        let deviations = deviations(&p).unwrap();
        assert!((scaled_difference(&q, &p, &deviations) - 0.1).abs() < 1e-15);
        let (relative, sigmas) = estimate_errors(
            &[Quad::from_f64(3.0), Quad::from_f64(5.0)],
            &[Quad::from_f64(3.0), Quad::from_f64(4.0)],
            &deviations,
        );
        assert!((relative - 0.2).abs() < 1e-15 && (sigmas - 0.5).abs() < 1e-15);
    }
}
