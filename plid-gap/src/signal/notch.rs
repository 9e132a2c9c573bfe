//! Removal of a line whose phase wanders: everything that a slowly modulated sine can contribute to a record is removed
//! from it.

use std::f64::consts::TAU;

use nalgebra::{DMatrix, DVector};

use crate::case::record::Channels;
use crate::plant::{Mode, Plant};
use plid_fourier::C;

/// Distance in s between the nodes of the modulation, which is linear between them. If the phase of a line wanders by
/// one radian in a second, a hundredth of the line's power remains.
const SPACING_S: f64 = 0.1;

/// Distance in Hz from the line within which nothing remains. Fits to such a residual leave these frequencies out.
pub const HOLE_HZ: f64 = 0.6 / SPACING_S;

/// Returns the cosine and the sine at a frequency, each modulated by adjacent hat functions: samples x columns.
pub fn modulated(samples: usize, rate: f64, hz: f64) -> DMatrix<f64> {
    let duration = (samples.max(2) - 1) as f64 / rate;
    let pieces = (duration / SPACING_S).ceil().max(1.0);
    let spacing = duration / pieces;
    DMatrix::from_fn(samples, 2 * (pieces as usize + 1), |k, j| piece(j, spacing, hz, k as f64 / rate))
}

/// Returns the cosine (even j) or the sine (odd j) at a frequency under hat function j / 2.
fn piece(j: usize, spacing: f64, hz: f64, t: f64) -> f64 {
    let hat = (1.0 - (t / spacing - (j / 2) as f64).abs()).max(0.0);
    let phase = TAU * hz * t;
    hat * if j.is_multiple_of(2) { phase.cos() } else { phase.sin() }
}

/// Returns the free decays of all modes, as cosine and sine: p channels each. There are none in closed loop, where no
/// mode decays by itself.
pub fn decays(plant: &Plant, samples: usize) -> Vec<Channels> {
    let decay = |mode: &Mode, phase: C| -> Channels {
        let turn = (mode.pole / plant.rate).exp();
        let of = |c: &C| (0..samples).scan(c * phase, |z, _| Some(std::mem::replace(z, *z * turn).re)).collect();
        mode.c.iter().map(of).collect()
    };
    let modes = if plant.controller.is_some() { &[][..] } else { &plant.modes };
    modes.iter().flat_map(|mode| [decay(mode, C::ONE), decay(mode, C::I)]).collect()
}

/// Returns the channels without a modulated line at this frequency and without free decays.
pub fn without_both(y: &[Vec<f64>], plant: &Plant, hz: f64) -> Vec<Vec<f64>> {
    let left = without(y, plant.rate, hz);
    let samples = y.first().map_or(0, Vec::len);
    let decays = decays(plant, samples);
    let columns: Vec<f64> = decays.iter().flat_map(|y| without(y, plant.rate, hz).concat()).collect();
    let basis = DMatrix::from_vec(samples * y.len(), decays.len(), columns).qr().q();
    let left = DVector::from_vec(left.concat());
    let left = &left - &basis * basis.tr_mul(&left);
    left.as_slice().chunks(samples.max(1)).map(<[f64]>::to_vec).collect()
}

/// Returns the channels without a modulated line at this frequency, which is fitted by least squares.
pub fn without(y: &[Vec<f64>], rate: f64, hz: f64) -> Vec<Vec<f64>> {
    let Some(first) = y.first() else { return Vec::new() };
    let basis = modulated(first.len(), rate, hz);
    let Some(factor) = basis.tr_mul(&basis).cholesky() else { return y.to_vec() };
    let left = |y: &Vec<f64>| {
        let y = DVector::from_column_slice(y);
        let fitted = &basis * factor.solve(&basis.tr_mul(&y));
        (y - fitted).as_slice().to_vec()
    };
    y.iter().map(left).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::random_input;

    /// If the phase of a line wanders by one radian in a second, less than a hundredth of the line's power remains.
    /// Nearly all of the noise remains.
    #[test]
    fn a_line_that_walks_is_taken_out() {
        let (rate, hz, samples) = (1600.0, 97.3, 4800);
        let steps = random_input(5, samples, 1).remove(0);
        let mut phase = 0.0;
        let mut line = Vec::new();
        for (k, step) in steps.iter().enumerate() {
            phase += step / f64::sqrt(rate);
            line.push((TAU * hz * k as f64 / rate + phase).sin());
        }
        let power = |y: &[f64]| y.iter().map(|y| y * y).sum::<f64>() / samples as f64;
        let noise = random_input(6, samples, 1).remove(0);
        let left = without(&[line, noise], rate, hz);
        assert!(power(&left[0]) < 0.01, "{}", power(&left[0]));
        assert!(power(&left[1]) > 0.97, "{}", power(&left[1]));
    }
}
