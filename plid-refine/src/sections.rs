//! The stable parametrisation: a block-diagonal A of second-order sections, with dense B, C and D.
//!
//! A section is
//!
//! ```text
//! A_s = | c     up |      down = d / up,    poles c +- sqrt(d)
//!       | down  c  |
//! ```
//!
//! where `up` is fixed and d may have either sign, so that a pair of poles passes continuously from complex to real and
//! back. At d = 0 the section is a Jordan block, which a rotation matrix cannot represent. Its denominator is
//! q(z) = (z - c)^2 - d = z^2 + a1 z + a2.
//!
//! The poles lie within the radius r if and only if (a1 / r, a2 / r^2) lies within the stability triangle |a2| < r^2,
//! |a1| / r < 1 + a2 / r^2. The two free coordinates of a section map the plane onto that triangle:
//!
//! ```text
//! a2 = r^2 tanh(eta2),    a1 = -r (1 + a2 / r^2) tanh(eta1)
//! ```
//!
//! Every parameter vector is therefore a stable model, whatever step an optimiser takes. Near the circle both
//! coordinates are logarithmic in the distance from it, which suits lightly damped modes.
//!
//! If the number of states is odd, the last section is of first order: its second state is not connected (up = down =
//! 0), and c = r tanh(eta1).

use faer::Mat;
use nalgebra::{Complex, DMatrix, DVector};
use plid_model::Model;

use crate::error::RefineError;

/// Largest coordinate. Its tanh differs from 1 by 8e-11; closer to the edge of the triangle the coordinates would be
/// lost to rounding.
const EDGE: f64 = 12.0;
/// A pole that is moved inside the limit decays faster than the slowest permissible pole by this factor; at the edge
/// its coordinates could not change.
const INSIDE: f64 = 1.25;
/// Smallest `up`, so that `down` = d / up remains moderate where two poles meet.
const SMALLEST_UP: f64 = 1e-3;

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Section {
    pub c: f64,
    pub d: f64,
    pub up: f64,
}

impl Section {
    pub fn is_pair(&self) -> bool {
        self.up != 0.0
    }

    pub fn down(&self) -> f64 {
        if self.is_pair() { self.d / self.up } else { 0.0 }
    }

    /// Returns the poles: two, or one for a first-order section.
    pub fn poles(&self) -> Vec<Complex<f64>> {
        let root = Complex::new(self.d, 0.0).sqrt();
        let c = Complex::from(self.c);
        if self.is_pair() { vec![c + root, c - root] } else { vec![c] }
    }

    pub fn coordinates(&self, radius: f64) -> [f64; 2] {
        let a2 = if self.is_pair() { (self.c * self.c - self.d) / (radius * radius) } else { 0.0 };
        let first = if self.is_pair() { 2.0 * self.c / radius / (1.0 + a2) } else { self.c / radius };
        // Rounding may move a pole across the edge, where atanh is undefined.
        [first, a2].map(|x| x.clamp(-1.0, 1.0).atanh().clamp(-EDGE, EDGE))
    }

    /// Sets the section to the given coordinates.
    pub fn place(&mut self, eta: [f64; 2], radius: f64) {
        let [eta1, eta2] = eta.map(|x| x.clamp(-EDGE, EDGE));
        if self.is_pair() {
            let a2 = eta2.tanh();
            self.c = radius * (1.0 + a2) * eta1.tanh() / 2.0;
            self.d = self.c * self.c - a2 * radius * radius;
        } else {
            self.c = radius * eta1.tanh();
        }
    }

    /// Returns d(c, d) / d(eta1, eta2), with rows c and d.
    pub fn slope(&self, radius: f64) -> [[f64; 2]; 2] {
        let [eta1, eta2] = self.coordinates(radius);
        // This is 1 - tanh^2 without cancellation near the edge.
        let slope = |eta: f64| 1.0 / eta.cosh().powi(2);
        if !self.is_pair() {
            return [[radius * slope(eta1), 0.0], [0.0, 0.0]];
        }
        let a2 = eta2.tanh();
        let of_c = [radius * (1.0 + a2) * slope(eta1) / 2.0, radius * eta1.tanh() * slope(eta2) / 2.0];
        let of_d = [2.0 * self.c * of_c[0], 2.0 * self.c * of_c[1] - radius * radius * slope(eta2)];
        [of_c, of_d]
    }
}

/// A model in sections. The states are padded to two per section; if `states` is odd, the last one is not connected.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Sections {
    pub states: usize,
    pub poles: Vec<Section>,
    /// Largest magnitude of a pole.
    pub radius: f64,
    /// Input matrix, (2 sections) x m.
    pub b: DMatrix<f64>,
    /// Output matrix, p x (2 sections).
    pub c: DMatrix<f64>,
    /// Feedthrough matrix, p x m.
    pub d: DMatrix<f64>,
    /// Whether D is estimated; otherwise it is zero.
    pub feedthrough: bool,
}

impl Sections {
    /// Converts the poles and the output matrix of (A, C) to sections, with B and D zero, to be fitted afterwards. A
    /// pole outside the unit circle is mirrored into it, and one slower than `radius` is made faster.
    pub fn of_poles(
        a: &DMatrix<f64>,
        c: &DMatrix<f64>,
        inputs: usize,
        radius: f64,
        feedthrough: bool,
    ) -> Result<Self, RefineError> {
        let (n, p) = (a.nrows(), c.nrows());
        let found = Mat::from_fn(n, n, |i, j| a[(i, j)])
            .eigen()
            .map_err(|_| RefineError::Decomposition { what: "the eigenvalue decomposition" })?;
        let values: Vec<Complex<f64>> = found.S().column_vector().iter().copied().collect();
        let vector = |k: usize| DVector::from_fn(n, |i, _| found.U()[(i, k)]);
        let seen = |k: usize| c.map(Complex::from) * vector(k);
        let mut sections = Vec::new();
        let mut columns: Vec<DVector<f64>> = Vec::new();
        for (k, value) in values.iter().enumerate().filter(|(_, z)| z.im > 0.0) {
            let pole = mended(*value, radius);
            let up = pole.im.max(SMALLEST_UP);
            let seen = seen(k);
            columns.push(seen.map(|z| z.re));
            columns.push(seen.map(|z| z.im) * (up / pole.im));
            sections.push(Section { c: pole.re, d: -pole.im * pole.im, up });
        }
        let mut real: Vec<usize> = (0..n).filter(|&k| values[k].im == 0.0).collect();
        real.sort_by(|&i, &j| values[j].re.total_cmp(&values[i].re));
        for pair in real.chunks(2) {
            let first = mended(values[pair[0]], radius).re;
            let of_first = seen(pair[0]).map(|z| z.re);
            let Some(&other) = pair.get(1) else {
                columns.extend([of_first, DVector::zeros(p)]);
                sections.push(Section { c: first, d: 0.0, up: 0.0 });
                continue;
            };
            let (second, of_second) = (mended(values[other], radius).re, seen(other).map(|z| z.re));
            let half = (first - second) / 2.0;
            let up = half.abs().max(SMALLEST_UP);
            let stretch = if half == 0.0 { 0.0 } else { up / half };
            columns.push((&of_first + &of_second) / 2.0);
            columns.push((&of_first - &of_second) * (stretch / 2.0));
            sections.push(Section { c: (first + second) / 2.0, d: half * half, up });
        }
        // Coordinates at the edge of the triangle were limited, so the poles are set to match them.
        for section in &mut sections {
            section.place(section.coordinates(radius), radius);
        }
        let c = DMatrix::from_columns(&columns);
        let b = DMatrix::zeros(columns.len(), inputs);
        Ok(Self { states: n, poles: sections, radius, b, c, d: DMatrix::zeros(p, inputs), feedthrough })
    }

    pub fn m(&self) -> usize {
        self.b.ncols()
    }

    pub fn p(&self) -> usize {
        self.c.nrows()
    }

    /// Returns the number of states of section s: 2, or 1 for the last section of an odd number of states.
    pub fn order(&self, s: usize) -> usize {
        if self.poles[s].is_pair() { 2 } else { 1 }
    }

    /// Returns the number of poles whose decay rate is within a tenth of the slowest permissible.
    pub fn at_limit(&self) -> usize {
        let near = self.radius.powf(1.1);
        self.poles.iter().flat_map(Section::poles).filter(|z| z.norm() > near).count()
    }

    /// Adapts the model to inputs that were divided by `scales` (power 1) or multiplied by them (power -1).
    pub fn scale_inputs(&mut self, scales: &[f64], power: i32) {
        for (j, scale) in scales.iter().enumerate() {
            self.b.column_mut(j).scale_mut(scale.powi(power));
            self.d.column_mut(j).scale_mut(scale.powi(power));
        }
    }

    /// Returns the model in matrix form.
    pub fn to_model(&self, sample_rate_hz: f64) -> Result<Model, RefineError> {
        let n = self.states;
        let mut a = DMatrix::zeros(n, n);
        for (s, section) in self.poles.iter().enumerate() {
            let at = 2 * s;
            a[(at, at)] = section.c;
            if section.is_pair() {
                a[(at, at + 1)] = section.up;
                a[(at + 1, at)] = section.down();
                a[(at + 1, at + 1)] = section.c;
            }
        }
        let (b, c) = (self.b.rows(0, n).into_owned(), self.c.columns(0, n).into_owned());
        Ok(Model::new(sample_rate_hz, a, b, c, self.d.clone())?)
    }
}

/// Returns the pole, mirrored into the unit circle if it lies outside, and moved inside the circle of `radius`, at a
/// distance from its edge, if it is too slow.
fn mended(pole: Complex<f64>, radius: f64) -> Complex<f64> {
    let size = pole.norm();
    let inside = if size > 1.0 { 1.0 / size } else { size };
    let wanted = inside.min(radius.powf(INSIDE));
    if size > 0.0 { pole * (wanted / size) } else { pole }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn every_parameter_is_a_stable_section(
            eta1 in -40.0..40.0_f64, eta2 in -40.0..40.0_f64, radius in 0.5..0.99999_f64, pair in any::<bool>(),
        ) {
            let mut section = Section { c: 0.0, d: 0.0, up: if pair { 0.3 } else { 0.0 } };
            section.place([eta1, eta2], radius);
            for pole in section.poles() {
                // The square root of a difference of nearly equal numbers has half the digits.
                prop_assert!(pole.norm() <= radius + 2e-8, "{pole}");
            }
        }

        #[test]
        fn coordinates_lead_back(c in -0.9..0.9_f64, d in -0.9..0.9_f64) {
            let radius = 0.999;
            let section = Section { c, d, up: 0.5 };
            prop_assume!(section.poles().iter().all(|z| z.norm() < 0.99 * radius));
            let mut again = section;
            again.place(section.coordinates(radius), radius);
            prop_assert!((again.c - c).abs() < 1e-12 && (again.d - d).abs() < 1e-12);
            // Compares the slope with finite differences.
            let eta = section.coordinates(radius);
            let slope = section.slope(radius);
            for axis in 0..2 {
                let step = 1e-6;
                let mut ends = [section, section];
                for (end, sign) in ends.iter_mut().zip([1.0, -1.0]) {
                    let mut moved = eta;
                    moved[axis] += sign * step;
                    end.place(moved, radius);
                }
                let of = |f: fn(&Section) -> f64| (f(&ends[0]) - f(&ends[1])) / (2.0 * step);
                prop_assert!((of(|s| s.c) - slope[0][axis]).abs() < 1e-8);
                prop_assert!((of(|s| s.d) - slope[1][axis]).abs() < 1e-8);
            }
        }
    }

    #[test]
    fn poles_and_their_shapes_survive() {
        // A complex pair and three real poles. An unstable and a slow pole follow below and are corrected.
        let radius = 0.99;
        let a = DMatrix::from_diagonal(&DVector::from_vec(vec![0.5, -0.3, 0.1, 0.0, 0.0]));
        let mut a = a;
        a[(3, 3)] = 0.6;
        a[(3, 4)] = 0.7;
        a[(4, 3)] = -0.7;
        a[(4, 4)] = 0.6;
        let c = DMatrix::from_fn(2, 5, |i, j| (i + 2 * j) as f64 + 1.0);
        let sections = Sections::of_poles(&a, &c, 1, radius, false).unwrap();
        assert_eq!((sections.poles.len(), sections.states), (3, 5));
        let model = sections.to_model(1.0).unwrap();
        // The poles are compared by their magnitudes.
        let poles: Vec<f64> = model.a.complex_eigenvalues().iter().map(|z| z.norm()).collect();
        for wanted in [0.5, 0.3, 0.1, 0.85_f64.sqrt()] {
            assert!(poles.iter().any(|r| (r - wanted).abs() < 1e-12), "{wanted} in {poles:?}");
        }
        for outside in [1.25, 0.9999] {
            let a = DMatrix::from_element(1, 1, outside);
            let c = DMatrix::from_element(1, 1, 1.0);
            let pole = Sections::of_poles(&a, &c, 1, radius, false).unwrap().poles[0].c;
            let wanted = if outside > 1.0 { 1.0 / outside } else { radius.powf(INSIDE) };
            assert!((pole - wanted).abs() < 1e-12, "{pole}");
        }
    }
}
