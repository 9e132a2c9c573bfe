//! The motion that an output measures, as rows of the states: displacement and velocity.

use nalgebra::{DMatrix, DVector};

use super::Plant;
use plid_fourier::C;

/// Number of frequencies at which an integral is compared with its integrand, and the lowest and highest of these
/// frequencies relative to the sample rate.
const FREQUENCIES: usize = 40;
const BETWEEN: [f64; 2] = [1e-3, 0.4];

/// Singular values of the equations of an integral below this share of the largest are rounding errors.
pub(super) const ROUNDING: f64 = 1e-8;

/// A row of the states: 2 Re(modes . z) + rest . x.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Row {
    pub modes: Vec<C>,
    pub rest: DVector<f64>,
}

/// Displacement, if it is known, and velocity.
pub(super) struct Motion {
    pub displacement: Option<Row>,
    pub velocity: Row,
}

impl Row {
    /// Returns the row whose entries are all zero.
    pub fn none(plant: &Plant) -> Self {
        Self { modes: vec![C::ZERO; plant.modes.len()], rest: DVector::zeros(plant.rest.a.nrows()) }
    }
}

impl Plant {
    /// Returns the motion that an output measures before its filters; `None` if it measures no motion, if no
    /// combination of the states is its velocity, or if the continuous form of the rest is not known.
    pub(super) fn motion(&self, output: usize) -> Option<Motion> {
        let (a, _) = self.rest.continuous.as_ref()?;
        let mut shown = self.before_filters(output, a);
        let mut direct = self.d.row(output).transpose();
        let mut order = self.sensed[output].order()?;
        while order > 1 {
            shown = self.integral(&shown, &direct)?;
            direct.fill(0.0);
            order -= 1;
        }
        Some(match order {
            0 => Motion { velocity: self.slope(&shown, a), displacement: Some(shown) },
            _ => Motion { displacement: self.integral(&shown, &direct), velocity: shown },
        })
    }

    /// Returns the row of an output without its filters. In a plant without modes, no pole can be attributed to a
    /// filter.
    fn before_filters(&self, output: usize, a: &DMatrix<f64>) -> Row {
        let modes = self.modes.iter().map(|mode| mode.c[output] / self.chain.behind(output, mode.pole)).collect();
        let mut rest: DVector<f64> = self.rest.c.row(output).transpose();
        if !self.modes.is_empty() {
            for filter in &self.chain.filter[output] {
                let pole = filter.pole;
                let once = a.tr_mul(&rest);
                // The factor is (1 - A / pole), and for a pair also the one of the conjugate.
                rest = if pole.im == 0.0 {
                    rest - once / pole.re
                } else {
                    let twice = a.tr_mul(&once) / pole.norm_sqr();
                    rest - once * (2.0 * pole.re / pole.norm_sqr()) + twice
                };
            }
        }
        Row { modes, rest }
    }

    /// Returns the row that gives the derivative of a row.
    fn slope(&self, row: &Row, a: &DMatrix<f64>) -> Row {
        Row {
            modes: row.modes.iter().zip(&self.modes).map(|(row, mode)| row * mode.pole).collect(),
            rest: a.tr_mul(&row.rest),
        }
    }

    /// Returns the row e whose derivative is a row c of the states and `direct` of the inputs: e A = c and e B =
    /// direct. `None` if there is no such row: for example, the position of a motor is not a combination of its speed
    /// and its current.
    fn integral(&self, row: &Row, direct: &DVector<f64>) -> Option<Row> {
        let (a, b) = self.rest.continuous.as_ref()?;
        let modes: Vec<C> = row.modes.iter().zip(&self.modes).map(|(row, mode)| row / mode.pole).collect();
        let (r, m) = b.shape();
        let rest = if r == 0 {
            DVector::zeros(0)
        } else {
            // Both kinds of equations get the same weight.
            let weight = if b.norm() > 0.0 { a.norm() / b.norm() } else { 1.0 };
            let of_modes =
                |i: usize| -> f64 { modes.iter().zip(&self.modes).map(|(row, mode)| 2.0 * (row * mode.b[i]).re).sum() };
            let mut equations = DMatrix::zeros(r + m, r);
            equations.view_mut((0, 0), (r, r)).copy_from(&a.transpose());
            equations.view_mut((r, 0), (m, r)).copy_from(&(b.transpose() * weight));
            let mut wanted = DVector::zeros(r + m);
            wanted.rows_mut(0, r).copy_from(&row.rest);
            (0..m).for_each(|i| wanted[r + i] = weight * (direct[i] - of_modes(i)));
            let svd = equations.svd(true, true);
            svd.solve(&wanted, ROUNDING * svd.singular_values.max()).ok()?
        };
        let found = Row { modes, rest };
        (self.apart(row, direct, &found) < self.settings.port_distance).then_some(found)
    }

    /// Returns whether a row is the integral of another row that has no direct feedthrough from the inputs.
    pub(super) fn is_integral(&self, row: &Row, integral: &Row) -> bool {
        self.apart(row, &DVector::zeros(self.m), integral) < self.settings.port_distance
    }

    /// Returns the mean of |G - s H|^2 / (|G|^2 + |s H|^2) over inputs and logarithmic frequencies, where G is the
    /// response of a row with `direct` and H that of its integral.
    fn apart(&self, row: &Row, direct: &DVector<f64>, integral: &Row) -> f64 {
        let [from, to] = BETWEEN;
        let mut sum = 0.0;
        for step in 0..FREQUENCIES {
            let share = from * (to / from).powf(step as f64 / (FREQUENCIES - 1) as f64);
            let s = C::new(0.0, std::f64::consts::TAU * share * self.rate);
            let Some(states) = self.rest_response(s) else { return f64::INFINITY };
            let of = |row: &Row, i: usize| self.row_response(row, &states, s, i);
            let pairs = (0..self.m).map(|i| (of(row, i) + direct[i], of(integral, i) * s));
            let sizes = pairs.clone().map(|(given, found)| given.norm_sqr() + found.norm_sqr());
            // An input that moves another axis contributes rounding errors.
            let least = sizes.clone().fold(0.0, f64::max) * ROUNDING * ROUNDING;
            let parts = pairs.zip(sizes).filter(|(_, both)| *both > least);
            sum += parts.map(|((given, found), both)| (given - found).norm_sqr() / both).sum::<f64>();
        }
        sum / (FREQUENCIES * self.m) as f64
    }

    /// Returns the states of the rest for a unit input at s (r x m).
    fn rest_response(&self, s: C) -> Option<DMatrix<C>> {
        let (a, b) = self.rest.continuous.as_ref()?;
        let r = a.nrows();
        if r == 0 {
            return Some(DMatrix::zeros(0, self.m));
        }
        (DMatrix::from_diagonal_element(r, r, s) - a.map(C::from)).lu().solve(&b.map(C::from))
    }

    fn row_response(&self, row: &Row, states: &DMatrix<C>, s: C, input: usize) -> C {
        let of_rest: C = row.rest.iter().zip(states.column(input).iter()).map(|(row, x)| x * *row).sum();
        let of_mode = |(row, mode): (&C, &super::Mode)| {
            let residue = row * mode.b[input];
            residue / (s - mode.pole) + residue.conj() / (s - mode.pole.conj())
        };
        of_rest + row.modes.iter().zip(&self.modes).map(of_mode).sum::<C>()
    }
}
