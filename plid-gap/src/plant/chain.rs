use std::f64::consts::TAU;

use nalgebra::{DMatrix, DVector};

use super::NonModal;
use crate::settings::PlantSettings;
use plid_fourier::C;

/// Singular values of a discrete-time matrix below this value are rounding errors. If the rest consists of a single
/// repeated pole, all singular values are.
const ROUNDING: f64 = 1e-9;

/// Largest number of sweeps of a singular value decomposition: the library's iteration may not terminate if singular
/// values repeat.
const MOST_SWEEPS: usize = 10_000;

/// The pole of one input's actuator.
#[derive(Debug, Clone, PartialEq)]
pub struct Actuator {
    /// Pole in rad/s: a' = pole (u - a).
    pub pole: f64,
    /// The actuator's output: a = row . x_rest (r).
    pub row: DVector<f64>,
}

/// A pole of one output's filter.
#[derive(Debug, Clone, PartialEq)]
pub struct Filter {
    /// Pole in rad/s; of a pair, the upper one.
    pub pole: C,
    /// The direction of the rest's states that this output observes with gain one, and that no other output observes
    /// (r).
    pub column: DVector<C>,
}

/// The actuators before the structure (a real pole for each input) and the filters after it (for each output), as far
/// as they can be found in the simulation.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SignalChain {
    /// For each input, the real pole that only this input drives.
    pub actuator: Vec<Option<Actuator>>,
    /// For each output, the poles that only this output observes.
    pub filter: Vec<Vec<Filter>>,
}

impl SignalChain {
    /// Returns a chain without actuators (m) or filters (p).
    pub(super) fn none(m: usize, p: usize) -> Self {
        Self { actuator: vec![None; m], filter: vec![Vec::new(); p] }
    }

    /// Finds the poles that belong to a single input or output. `lowest` is the magnitude of the lowest mode's pole:
    /// in a free structure, slower poles belong to the rigid-body motion.
    pub(super) fn find(rest: &NonModal, step: f64, lowest: f64, settings: &PlantSettings) -> Self {
        let PlantSettings { repeated_pole, own_channel, integrator, light_damping, .. } = *settings;
        let (r, m, p) = (rest.a.nrows(), rest.b.ncols(), rest.c.nrows());
        let mut chain = Self::none(m, p);
        if r == 0 {
            return chain;
        }
        let matrix = rest.a.map(C::from);
        let poles = clusters(&rest.a, repeated_pole);
        let is_free = poles.iter().any(|(z, _)| z.ln().norm() < integrator);
        for (z, count) in poles {
            if z.norm() < 1e-9 || (z.im == 0.0 && z.re <= 0.0) {
                continue;
            }
            let pole = z.ln() / step;
            // A lightly damped pair here is part of a repeated mode that could not be separated.
            let is_light = z.im != 0.0 && pole.re.abs() < light_damping * pole.norm();
            if is_light || is_free && pole.norm() < lowest {
                continue;
            }
            let shifted = &matrix - DMatrix::from_diagonal_element(r, r, z);
            let left = null_space(&shifted.transpose(), count, own_channel);
            let right = null_space(&shifted, count, own_channel);
            let (Some(left), Some(right)) = (left, right) else { continue };
            // An actuator's pole is real. A resonant amplifier would be part of the structure.
            let mut driven_alone = false;
            if z.im == 0.0 {
                let driven = rest.b.map(C::from).transpose() * &left;
                for i in 0..m {
                    if let Some(x) = alone(&driven, i, own_channel) {
                        // Over a sample, a' = pole (u - a) adds 1 - e^{-pole T} times the held input.
                        let row = (&left * x).map(|x| x.re) * (1.0 - z.re);
                        chain.actuator[i] = Some(Actuator { pole: -pole.re, row });
                        driven_alone = true;
                    }
                }
            }
            let seen = rest.c.map(C::from) * &right;
            for o in 0..p {
                if driven_alone {
                    break;
                }
                if let Some(x) = alone(&seen, o, own_channel) {
                    chain.filter[o].push(Filter { pole, column: &right * x });
                }
            }
        }
        chain
    }

    /// Fits the actuators and filters to a rest with this number of states; further states have no part in them.
    pub(super) fn resize(&mut self, states: usize) {
        self.actuator.iter_mut().flatten().for_each(|actuator| actuator.row.resize_vertically_mut(states, 0.0));
        let filters = self.filter.iter_mut().flatten();
        filters.for_each(|filter| filter.column.resize_vertically_mut(states, C::ZERO));
    }

    /// Returns the actuator's gain at s relative to zero frequency; one if no actuator is known.
    pub fn before(&self, input: usize, s: C) -> C {
        self.actuator[input].as_ref().map_or(C::ONE, |actuator| C::from(actuator.pole) / (s + actuator.pole))
    }

    /// Returns the filter's gain at s relative to zero frequency; one if no filter is known.
    pub fn behind(&self, output: usize, s: C) -> C {
        self.filter[output].iter().fold(C::ONE, |gain, filter| {
            let section = |q: C| -q / (s - q);
            let pole = filter.pole;
            if pole.im == 0.0 { gain * section(pole) } else { gain * section(pole) * section(pole.conj()) }
        })
    }

    /// Returns the residue of a filter at one of its poles.
    pub fn residue(&self, output: usize, index: usize) -> C {
        let at = self.filter[output][index].pole;
        let mut residue = -at;
        for (k, filter) in self.filter[output].iter().enumerate() {
            let section = |q: C| -q / (at - q);
            if k != index {
                residue *= section(filter.pole);
            }
            if filter.pole.im != 0.0 {
                residue *= section(filter.pole.conj());
            }
        }
        residue
    }

    /// Returns whether any actuator or filter is known.
    pub fn known(&self) -> bool {
        self.actuator.iter().any(Option::is_some) || self.filter.iter().any(|filter| !filter.is_empty())
    }

    /// Returns the actuator's pole in Hz.
    pub fn actuator_hz(&self, input: usize) -> Option<f64> {
        self.actuator[input].as_ref().map(|actuator| actuator.pole / TAU)
    }
}

/// Returns the poles (of a pair, the upper one) with their multiplicities. Poles within the relative distance
/// `repeated_pole` count as one.
fn clusters(a: &DMatrix<f64>, repeated_pole: f64) -> Vec<(C, usize)> {
    let mut found: Vec<(C, usize)> = Vec::new();
    for value in plid_model::eigenvalues(a).unwrap_or_default() {
        let size = value.norm().max(1e-12);
        let value = if value.im.abs() < repeated_pole * size { C::from(value.re) } else { value };
        if value.im < 0.0 {
            continue;
        }
        match found.iter_mut().find(|(other, _)| (*other - value).norm() < repeated_pole * size) {
            Some((mean, count)) => {
                *mean = (*mean * *count as f64 + value) / (*count + 1) as f64;
                *count += 1;
            }
            None => found.push((value, 1)),
        }
    }
    found
}

/// Returns a basis of the `count` directions in which a matrix is zero up to a relative tolerance, if there are that
/// many.
fn null_space(matrix: &DMatrix<C>, count: usize, tolerance: f64) -> Option<DMatrix<C>> {
    let svd = matrix.clone().try_svd(false, true, f64::EPSILON, MOST_SWEEPS)?;
    let v = svd.v_t?.adjoint();
    let mut order: Vec<usize> = (0..svd.singular_values.len()).collect();
    order.sort_by(|&i, &j| svd.singular_values[i].total_cmp(&svd.singular_values[j]));
    let scale = svd.singular_values.max();
    let last = *order.get(count - 1)?;
    (svd.singular_values[last] < (tolerance * scale).max(ROUNDING))
        .then(|| DMatrix::from_fn(v.nrows(), count, |i, j| v[(i, order[j])]))
}

/// Returns the combination of the columns that is one in row `channel` and zero elsewhere, up to the square root of the
/// tolerance, if there is one.
fn alone(columns: &DMatrix<C>, channel: usize, tolerance: f64) -> Option<DVector<C>> {
    let mut wanted = DVector::zeros(columns.nrows());
    wanted[channel] = C::ONE;
    let svd = columns.clone().try_svd(true, true, f64::EPSILON, MOST_SWEEPS)?;
    let floor = 1e-6 * svd.singular_values.max();
    if !(floor > 0.0) {
        return None;
    }
    let x = svd.solve(&wanted, floor).ok()?;
    ((columns * &x - wanted).norm() < tolerance.sqrt()).then_some(x)
}
