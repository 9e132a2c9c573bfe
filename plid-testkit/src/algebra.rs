//! Measurement updates with severe cancellation whose result is known in closed form. Each form is tested to its own
//! order of magnitude.

use plid_core::{
    CovariancePropagation, Dense, InitialCovariance, Inspect, ObservableForm, Scalar, ScalarOf, ScalarUpdate,
};

/// Returns the largest error of the leading block of P after scalar updates, relative to its largest entry, or `None`
/// if an update failed.
fn error<C>(initial: [f64; 3], updates: &[([f64; 3], f64)], expected: &[&[f64]]) -> Option<f64>
where
    C: Inspect + ScalarUpdate + CovariancePropagation<Scalar = f64>,
{
    // One state, one output and one input give N = 3.
    let model = ObservableForm::new(&[1], 1).unwrap();
    let mut covariance =
        C::new(&model, &InitialCovariance::Diagonal(initial.to_vec()), &C::Options::default()).unwrap();
    let mut gain = [0.0; 3];
    for (h, r) in updates {
        covariance.scalar_update(h, *r, &mut gain).ok()?;
    }
    let p = covariance.dense();
    let (mut worst, mut largest) = (0.0_f64, 0.0_f64);
    for (i, row) in expected.iter().enumerate() {
        for (j, &entry) in row.iter().enumerate() {
            worst = worst.max((p.at(i, j) - entry).abs());
            largest = largest.max(entry.abs());
        }
    }
    Some(worst / largest)
}

/// The example of Dyer and McReynolds: P0 = I, R = d^2 I, H = [1 1 1; 1 1 1 + d].
pub fn dyer_mcreynolds<C>(d: f64) -> Option<f64>
where
    C: Inspect + ScalarUpdate + CovariancePropagation<Scalar = f64>,
{
    // This is the d that 1 + d represents in f64, so the data contain no rounding error.
    let d = (1.0 + d) - 1.0;
    let scale = 8.0 + 2.0 * d * (1.0 + d);
    let (own, far) = ((5.0 + 2.0 * d * (1.0 + d)) / scale, (-2.0 - d) / scale);
    let expected = [[own, -3.0 / scale, far], [-3.0 / scale, own, far], [far, far, (4.0 + d * d) / scale]];
    let updates = [([1.0, 1.0, 1.0], d * d), ([1.0, 1.0, 1.0 + d], d * d)];
    error::<C>([1.0; 3], &updates, &[&expected[0], &expected[1], &expected[2]])
}

/// The example of Bierman: P0 = I / e^2, R = 1, h = (1, e), then (1, 1).
pub fn bierman<C>(e: f64) -> Option<f64>
where
    C: Inspect + ScalarUpdate + CovariancePropagation<Scalar = f64>,
{
    let scale = 1.0 - 2.0 * e + 2.0 * e * e * (2.0 + e * e);
    let off = -(1.0 + e) / scale;
    let expected = [[(1.0 + 2.0 * e * e) / scale, off], [off, (2.0 + e * e) / scale]];
    let variance = 1.0 / (e * e);
    let updates = [([1.0, e, 0.0], 1.0), ([1.0, 1.0, 0.0], 1.0)];
    error::<C>([variance, variance, 1.0], &updates, &[&expected[0], &expected[1]])
}

/// Checks the measurement update by any row h against its definition, in which the gain is P h^T / (h P h^T + r).
///
/// # Panics
/// Panics if it does not conform.
pub fn check_scalar_update<C: Inspect + ScalarUpdate>() {
    let model = ObservableForm::new(&[1], 1).unwrap();
    let p0 = [[2.0, 0.3, -0.5], [0.3, 1.0, 0.2], [-0.5, 0.2, 1.5]];
    let initial = InitialCovariance::Full(Dense::from_fn(3, 3, |i, j| p0[i][j]));
    let (h, r) = ([0.7, -1.2, 0.4], 0.25);
    let number = ScalarOf::<C>::from_f64;
    let mut covariance = C::new(&model, &initial, &C::Options::default()).unwrap();
    let mut gain = [number(f64::NAN); 3];
    covariance.scalar_update(&h.map(number), number(r), &mut gain).unwrap();
    let cross: Vec<f64> = p0.iter().map(|row| row.iter().zip(&h).map(|(p, h)| p * h).sum()).collect();
    let variance = cross.iter().zip(&h).map(|(c, h)| c * h).sum::<f64>() + r;
    let p = covariance.dense_in::<f64>();
    let roundoff = ScalarOf::<C>::EPSILON.max(f64::EPSILON / 2.0);
    for i in 0..3 {
        assert!((gain[i].to_f64() - cross[i] / variance).abs() < 9.0 * roundoff);
        for j in 0..3 {
            assert!((p.at(i, j) - (p0[i][j] - cross[i] * cross[j] / variance)).abs() < 36.0 * roundoff);
        }
    }
}
