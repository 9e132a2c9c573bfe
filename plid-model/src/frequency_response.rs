use std::f64::consts::TAU;

use nalgebra::{Complex, DMatrix};

use super::error::ModelError;
use super::hessenberg::HessenbergModel;
use super::state_space::Model;

/// A model prepared for the evaluation of its response at many frequencies. The reduction to Hessenberg form is done
/// once, after which each frequency costs O(n^2 (m + 1)).
pub struct FrequencyResponse {
    reduced: HessenbergModel,
    through: DMatrix<Complex<f64>>,
    rate: f64,
}

impl FrequencyResponse {
    /// Prepares a model.
    pub fn of(model: &Model) -> Self {
        Self { reduced: HessenbergModel::of(model), through: model.d.map(Complex::from), rate: model.sample_rate_hz }
    }

    /// Returns H = C (z I - A)^{-1} B + D (p x m) at z = exp(2 pi i hz / rate).
    pub fn at(&self, hz: f64) -> DMatrix<Complex<f64>> {
        self.reduced.transfer(on_circle(hz, self.rate)) + &self.through
    }

    /// Returns |H| for one pair of output and input.
    pub fn magnitude(&self, output: usize, input: usize, hz: f64) -> f64 {
        self.at(hz)[(output, input)].norm()
    }
}

/// Computes H(f) = C (z I - A)^{-1} B + D, one p x m matrix per frequency in Hz.
///
/// # Errors
/// Returns [`ModelError::Frequency`] for a frequency outside 0 to half the sample rate.
pub fn frequency_response(model: &Model, hz: &[f64]) -> Result<Vec<DMatrix<Complex<f64>>>, ModelError> {
    expect_frequencies(model, hz)?;
    let response = FrequencyResponse::of(model);
    Ok(hz.iter().map(|&f| response.at(f)).collect())
}

/// Returns the point on the unit circle that corresponds to a frequency.
pub(super) fn on_circle(hz: f64, rate: f64) -> Complex<f64> {
    Complex::cis(TAU * hz / rate)
}

/// Returns an error unless every frequency is within 0 to half the sample rate.
pub(super) fn expect_frequencies(model: &Model, hz: &[f64]) -> Result<(), ModelError> {
    let nyquist = model.sample_rate_hz / 2.0;
    // The tolerance keeps rounding from turning the last frequency of a grid into an error.
    let bad = hz.iter().find(|&&f| !(0.0..=nyquist * (1.0 + 1e-9)).contains(&f));
    bad.map_or(Ok(()), |&hz| Err(ModelError::Frequency { hz, nyquist }))
}

#[cfg(test)]
mod tests {
    use super::super::simulate::simulate;
    use super::super::testing::{canonical, in_other_states, random};
    use super::*;
    use approx::assert_relative_eq;
    use ndarray::Array2;
    use proptest::prelude::*;

    #[test]
    fn a_lag_has_its_closed_form() {
        let one = |x| DMatrix::from_element(1, 1, x);
        let model = Model::new(10.0, one(0.8), one(2.0), one(3.0), one(0.5)).unwrap();
        for (hz, h) in [0.0, 1.3, 5.0].into_iter().zip(frequency_response(&model, &[0.0, 1.3, 5.0]).unwrap()) {
            let z = Complex::cis(TAU * hz / 10.0);
            let closed = 6.0 / (z - 0.8) + 0.5;
            assert_relative_eq!(h[(0, 0)].re, closed.re, max_relative = 1e-13);
            assert_relative_eq!(h[(0, 0)].im, closed.im, epsilon = 1e-13);
        }
        for bad in [-1.0, 5.1, f64::NAN] {
            assert!(matches!(frequency_response(&model, &[bad]), Err(ModelError::Frequency { .. })));
        }
    }

    #[test]
    fn it_is_the_transform_of_the_impulse_response() {
        let mut model = canonical(8, &[3, 2], 2);
        model.d = random(3, 2, 2);
        let mut impulse = Array2::zeros((1500, 2));
        impulse[(0, 1)] = 1.0;
        let run = simulate(&model, impulse.view(), &model.rest()).unwrap();
        for hz in [0.0, 7.0, 33.3, 50.0] {
            let h = &frequency_response(&model, &[hz]).unwrap()[0];
            for i in 0..2 {
                let sum: Complex<f64> =
                    (0..1500).map(|k| Complex::cis(-TAU * hz / 100.0 * k as f64) * run.outputs[(k, i)]).sum();
                assert!((sum - h[(i, 1)]).norm() < 1e-10);
            }
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        #[test]
        fn a_change_of_state_leaves_it(
            seed in 0_u64..1 << 40,
            indices in prop::collection::vec(1_usize..5, 1..4),
            m in 1_usize..4,
            hz in 0.0..50.0,
        ) {
            let model = canonical(seed, &indices, m);
            let (other, _) = in_other_states(&model, seed + 9);
            let one = &frequency_response(&model, &[hz]).unwrap()[0];
            let two = &frequency_response(&other, &[hz]).unwrap()[0];
            prop_assert!((one - two).norm() < 1e-10 * (1.0 + one.norm()));
        }
    }
}
