use super::eigen::eigenvalues;
use super::error::ModelError;
use super::frequency_response::{FrequencyResponse, expect_frequencies};
use super::state_space::Model;

/// Points of the uniform grid that is searched for the largest magnitude; the frequencies of the poles are added to it.
const GRID: usize = 200;
/// The golden-section search ends at an interval of this width, relative to the frequency.
const WIDTH: f64 = 1e-9;

/// A peak of |H| for one pair of input and output.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Peak {
    /// Frequency of the peak in Hz.
    pub hz: f64,
    /// Magnitude of the peak, 20 log10 |H|.
    pub db: f64,
    /// False if the largest value is at an end of the range, in which case it may not be a peak.
    pub interior: bool,
}

/// Finds the largest |H| of one pair of channels within `near_hz` +- `half_width_hz`, limited to 0 to half the sample
/// rate. The best point of a grid, which includes the frequencies of the poles in the range so that no sharp peak is
/// missed, is refined by a golden-section search.
///
/// # Errors
/// Returns [`ModelError::Frequency`] if `near_hz` is out of range, [`ModelError::Eigenvalues`], or
/// [`ModelError::Shape`] if the pair does not exist.
pub fn find_peak(
    model: &Model,
    output: usize,
    input: usize,
    near_hz: f64,
    half_width_hz: f64,
) -> Result<Peak, ModelError> {
    if output >= model.p() || input >= model.m() {
        let (expected, found) = ((model.p(), model.m()), (output + 1, input + 1));
        let what = "the frequency response including the requested pair";
        return Err(ModelError::Shape { what, expected, found });
    }
    expect_frequencies(model, &[near_hz])?;
    let nyquist = model.sample_rate_hz / 2.0;
    let low = (near_hz - half_width_hz.abs()).max(0.0);
    let high = (near_hz + half_width_hz.abs()).min(nyquist);
    let mut grid: Vec<f64> = (0..=GRID).map(|i| low + (high - low) * i as f64 / GRID as f64).collect();
    let poles = eigenvalues(&model.a)?;
    let of_poles = poles.iter().map(|z| z.arg() * nyquist / std::f64::consts::PI);
    grid.extend(of_poles.filter(|hz| (low..=high).contains(hz)));
    grid.sort_by(f64::total_cmp);
    grid.dedup();

    let response = FrequencyResponse::of(model);
    let size = |hz: f64| response.magnitude(output, input, hz);
    let sizes: Vec<f64> = grid.iter().map(|&hz| size(hz)).collect();
    let best = (0..grid.len()).fold(0, |b, i| if sizes[i] > sizes[b] { i } else { b });
    let (left, right) = (best.saturating_sub(1), (best + 1).min(grid.len() - 1));
    let refined = golden_section(grid[left], grid[right], size);
    let hz = if size(refined) > sizes[best] { refined } else { grid[best] };
    let from_end = WIDTH * nyquist;
    Ok(Peak { hz, db: 20.0 * size(hz).log10(), interior: hz - low > from_end && high - hz > from_end })
}

/// Returns the maximiser of a unimodal function between `low` and `high`.
fn golden_section(mut low: f64, mut high: f64, f: impl Fn(f64) -> f64) -> f64 {
    let ratio = (5_f64.sqrt() - 1.0) / 2.0;
    let (mut x1, mut x2) = (high - ratio * (high - low), low + ratio * (high - low));
    let (mut f1, mut f2) = (f(x1), f(x2));
    while high - low > WIDTH * high.abs() {
        if f1 > f2 {
            (high, x2, f2) = (x2, x1, f1);
            x1 = high - ratio * (high - low);
            f1 = f(x1);
        } else {
            (low, x1, f1) = (x1, x2, f2);
            x2 = low + ratio * (high - low);
            f2 = f(x2);
        }
        // Rounding prevents the interval from shrinking further.
        if x1 <= low || x2 >= high {
            break;
        }
    }
    (low + high) / 2.0
}

#[cfg(test)]
mod tests {
    use super::super::testing::{pole, two_modes};
    use super::*;
    use approx::assert_relative_eq;
    use nalgebra::{DMatrix, dmatrix};

    /// One resonance 1 / (z^2 - 2 r cos(t) z + r^2): |H| is largest at cos(w) = cos(t) (1 + r^2) / (2 r), and its
    /// maximum is 1 / ((1 - r^2) sin(t)).
    #[test]
    fn a_resonance_has_its_closed_form() {
        for damping in [1e-1, 1e-3, 1e-6] {
            let (r, t) = pole(212.0, damping, 1600.0);
            let a = dmatrix![2.0 * r * t.cos(), -r * r; 1.0, 0.0];
            let model = Model::new(1600.0, a, dmatrix![1.0; 0.0], dmatrix![0.0, 1.0], DMatrix::zeros(1, 1)).unwrap();
            let peak = find_peak(&model, 0, 0, 205.0, 40.0).unwrap();
            let angle = (t.cos() * (1.0 + r * r) / (2.0 * r)).acos();
            let closed = angle * 1600.0 / std::f64::consts::TAU;
            let db = -20.0 * ((1.0 - r * r) * t.sin()).log10();
            assert_relative_eq!(peak.hz, closed, max_relative = 1e-7);
            assert_relative_eq!(peak.db, db, epsilon = 1e-6);
            assert!(peak.interior);
        }
    }

    #[test]
    fn a_slope_is_no_peak_and_bad_questions_are_refused() {
        let model = two_modes();
        let slope = find_peak(&model, 0, 0, 10.0, 1.0).unwrap();
        assert!(!slope.interior && slope.hz == 11.0);
        assert!(matches!(find_peak(&model, 0, 0, 80.0, 1.0), Err(ModelError::Frequency { .. })));
        assert!(matches!(find_peak(&model, 2, 0, 8.0, 1.0), Err(ModelError::Shape { .. })));
    }
}
