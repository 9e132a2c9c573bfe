use std::f64::consts::TAU;

use nalgebra::{Complex, DMatrix, DVector};

use super::eigen::eigen;
use super::error::ModelError;
use super::state_space::Model;

/// A mode whose eigenvalue has a condition number above this cannot be separated from its neighbours, so its strength
/// is undefined.
const PARTED: f64 = 1e10;

/// The kind of pole that a mode has.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum ModeKind {
    /// A complex-conjugate pair of poles.
    Oscillatory,
    /// A single real pole.
    Real,
}

/// A mode of a model: a complex-conjugate pair of poles or a real pole.
#[derive(Debug, Clone, PartialEq)]
pub struct Mode {
    /// The pole; of a pair, the one with the positive imaginary part.
    pub pole: Complex<f64>,
    /// Whether the mode is a pair of poles or a real pole.
    pub kind: ModeKind,
    /// Natural frequency |s| / 2 pi in Hz, where s = rate ln(pole). It is infinite for a pole at zero.
    pub hz: f64,
    /// Damping ratio -Re s / |s|. It is one for a pole at zero and zero for a pole at one.
    pub damping: f64,
    /// Whether |pole| < 1.
    pub stable: bool,
    /// Contribution 20 log10 |H_mode| of the mode to the response from each input to each output (p x m), evaluated on
    /// the unit circle at the angle of the pole. `None` if the mode cannot be separated from its neighbours (a repeated
    /// pole).
    pub strength_db: Option<DMatrix<f64>>,
    /// Right eigenvector (n).
    pub(super) right: DVector<Complex<f64>>,
    /// Left eigenvector (n), normalised so that l . r = 1; `None` for a repeated pole.
    pub(super) left: Option<DVector<Complex<f64>>>,
}

impl Mode {
    /// Returns the largest strength over all pairs of channels in dB, or minus infinity if no strength is defined.
    pub fn strongest_db(&self) -> f64 {
        let all = self.strength_db.as_ref();
        all.map_or(f64::NEG_INFINITY, |s| s.max())
    }

    /// Returns s = rate ln(pole) in 1/s.
    pub(super) fn continuous(&self, rate: f64) -> Complex<f64> {
        self.pole.ln() * rate
    }
}

/// Returns the modes of a model in order of frequency. [`Mode::strongest_db`] ranks them by strength.
///
/// # Errors
/// Returns [`ModelError::Eigenvalues`] if the eigenvalue iteration does not converge.
pub fn modes(model: &Model) -> Result<Vec<Mode>, ModelError> {
    let found = eigen(&model.a)?;
    let mut modes: Vec<Mode> = (0..model.n())
        .filter(|&k| found.values[k].im >= 0.0)
        .map(|k| {
            let right = found.right.column(k).into_owned();
            let left = found.left.as_ref().map(|l| l.row(k).transpose());
            // The product of the norms is the condition number of the pole, because l . r = 1.
            let left = left.filter(|l| l.norm() * right.norm() < PARTED);
            mode(model, found.values[k], right, left)
        })
        .collect();
    modes.sort_by(|x, y| x.hz.total_cmp(&y.hz));
    Ok(modes)
}

fn mode(model: &Model, pole: Complex<f64>, right: DVector<Complex<f64>>, left: Option<DVector<Complex<f64>>>) -> Mode {
    let kind = if pole.im == 0.0 { ModeKind::Real } else { ModeKind::Oscillatory };
    let (hz, damping) = frequency_and_damping(pole, model.sample_rate_hz);
    let strength_db = left.as_ref().map(|left| strength(model, pole, kind, &right, left));
    Mode { pole, kind, hz, damping, stable: pole.norm() < 1.0, strength_db, right, left }
}

fn frequency_and_damping(pole: Complex<f64>, rate: f64) -> (f64, f64) {
    if pole == Complex::ZERO {
        return (f64::INFINITY, 1.0);
    }
    let s = pole.ln() * rate;
    if s == Complex::ZERO {
        return (0.0, 0.0);
    }
    (s.norm() / TAU, -s.re / s.norm())
}

fn strength(
    model: &Model,
    pole: Complex<f64>,
    kind: ModeKind,
    right: &DVector<Complex<f64>>,
    left: &DVector<Complex<f64>>,
) -> DMatrix<f64> {
    let output = model.c.map(Complex::from) * right;
    let input = left.transpose() * model.b.map(Complex::from);
    let residue = output * input;
    let z = Complex::cis(pole.arg());
    residue.map(|r| {
        let one = r / (z - pole);
        let sum = match kind {
            ModeKind::Real => one,
            ModeKind::Oscillatory => one + r.conj() / (z - pole.conj()),
        };
        20.0 * sum.norm().log10()
    })
}

#[cfg(test)]
mod tests {
    use super::super::frequency_response::frequency_response;
    use super::super::testing::{canonical, random, two_modes};
    use super::*;
    use approx::assert_relative_eq;
    use nalgebra::dmatrix;

    #[test]
    fn frequency_and_damping_are_those_it_was_built_from() {
        let model = two_modes();
        let modes = modes(&model).unwrap();
        assert_eq!(modes.len(), 2);
        for (mode, (hz, damping)) in modes.iter().zip([(12.0, 0.01), (31.0, 0.004)]) {
            assert_relative_eq!(mode.hz, hz, max_relative = 1e-12);
            assert_relative_eq!(mode.damping, damping, max_relative = 1e-9);
            assert!(mode.stable && mode.kind == ModeKind::Oscillatory);
        }
    }

    #[test]
    fn contributions_add_up_to_the_response() {
        let model = canonical(3, &[3, 2], 2);
        let hz = 17.0;
        let z = Complex::cis(TAU * hz / 100.0);
        let mut sum = DMatrix::zeros(2, 2);
        for mode in modes(&model).unwrap() {
            let left = mode.left.unwrap();
            let residue = model.c.map(Complex::from) * &mode.right * (left.transpose() * model.b.map(Complex::from));
            sum += residue.map(|r| r / (z - mode.pole));
            if mode.kind == ModeKind::Oscillatory {
                sum += residue.map(|r| r.conj() / (z - mode.pole.conj()));
            }
        }
        let whole = &frequency_response(&model, &[hz]).unwrap()[0];
        assert!((sum - whole).norm() < 1e-11);
    }

    #[test]
    fn strength_is_the_peak_where_modes_are_far_apart() {
        let mut model = two_modes();
        model.a.view_mut((2, 2), (2, 2)).scale_mut(0.0);
        model.b.rows_mut(2, 2).fill(0.0);
        let found = modes(&model).unwrap();
        let mode = found.iter().find(|m| (m.hz - 12.0).abs() < 0.1).unwrap();
        let hz = mode.pole.arg() / TAU * 100.0;
        let h = &frequency_response(&model, &[hz]).unwrap()[0];
        let strength = mode.strength_db.as_ref().unwrap();
        for (a, b) in strength.iter().zip(h.iter()) {
            assert_relative_eq!(*a, 20.0 * b.norm().log10(), epsilon = 1e-9);
        }
    }

    #[test]
    fn real_poles_and_the_edges() {
        let a = DMatrix::from_diagonal(&DVector::from_vec(vec![0.5, -0.9, 1.0, 1.2]));
        let model = Model::new(10.0, a, random(1, 4, 1), random(2, 1, 4), DMatrix::zeros(1, 1));
        let found = modes(&model.unwrap()).unwrap();
        let at = |pole: f64| found.iter().find(|m| m.pole.re == pole).unwrap();
        assert!(found.iter().all(|m| m.kind == ModeKind::Real));
        let half = at(0.5);
        assert_relative_eq!(half.hz, 10.0 * 2_f64.ln() / TAU, max_relative = 1e-12);
        assert_relative_eq!(half.damping, 1.0, max_relative = 1e-12);
        // The strength of a real pole is its share of the response at zero frequency.
        let part = random(2, 1, 4)[0] * random(1, 4, 1)[0] / 0.5;
        let db = 20.0 * part.abs().log10();
        assert_relative_eq!(half.strongest_db(), db, epsilon = 1e-9);
        assert!(at(-0.9).hz > 5.0 && at(-0.9).stable);
        assert_eq!((at(1.0).hz, at(1.0).damping, at(1.0).stable), (0.0, 0.0, false));
        assert!(!at(1.2).stable && at(1.2).damping < 0.0);
    }

    #[test]
    fn a_repeated_pole_has_no_strength_of_its_own() {
        let a = dmatrix![0.0, 0.0, 0.0; 1.0, 0.0, 0.0; 0.0, 1.0, 0.0];
        let model = Model::new(10.0, a, random(1, 3, 1), random(2, 1, 3), DMatrix::zeros(1, 1)).unwrap();
        for mode in modes(&model).unwrap() {
            assert!(mode.strength_db.is_none() && mode.strongest_db() == f64::NEG_INFINITY);
        }
    }
}
