//! Gauss-Newton normal equations of the weighted simulation error, assembled from the inner products of the signals.
//!
//! The parameters are, for each section, its coordinates (two, or one for a first-order section) and its rows of B,
//! followed by the rows of C and D for each output. The initial states are separate: that of one record is independent
//! of those of the others, so they are eliminated record by record.

use nalgebra::{Cholesky, DMatrix, DVector};
use plid_lsq::Equations;

use crate::gram::{Gram, Places};
use crate::sections::Sections;

/// The index of each parameter in the parameter vector.
#[derive(Clone, Debug)]
pub(crate) struct Order {
    states: usize,
    m: usize,
    p: usize,
    feedthrough: bool,
}

impl Order {
    pub fn of(model: &Sections) -> Self {
        Self { states: model.states, m: model.m(), p: model.p(), feedthrough: model.feedthrough }
    }

    /// Returns the index of coordinate 0 or 1 of section s.
    pub fn pole(&self, s: usize, coordinate: usize) -> usize {
        2 * s * (1 + self.m) + coordinate
    }

    pub fn b(&self, state: usize, j: usize) -> usize {
        let s = state / 2;
        let coordinates = if 2 * s + 1 < self.states { 2 } else { 1 };
        self.pole(s, coordinates) + (state % 2) * self.m + j
    }

    pub fn c(&self, i: usize, state: usize) -> usize {
        self.states * (1 + self.m) + i * self.row() + state
    }

    pub fn d(&self, i: usize, j: usize) -> usize {
        self.c(i, self.states) + j
    }

    fn row(&self) -> usize {
        self.states + if self.feedthrough { self.m } else { 0 }
    }

    pub fn count(&self) -> usize {
        self.states * (1 + self.m) + self.p * self.row()
    }
}

/// The parameters that are estimated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Free {
    /// All parameters.
    All,
    /// B, D and the initial states, in which the output is linear.
    Inputs,
    /// The initial states only.
    States,
}

/// A linear combination of signals: indices and weights.
type Combination = Vec<(usize, f64)>;

/// A column of the Jacobian: the parameter, and the combination of signals that is its derivative.
struct Column {
    parameter: usize,
    signals: Combination,
}

/// The part of the normal equations that belongs to the initial state of one record (states x states, and states x
/// parameters).
#[derive(Clone, Debug)]
pub(crate) struct InitialPart {
    pub own: DMatrix<f64>,
    pub shared: DMatrix<f64>,
    pub gradient: DVector<f64>,
}

/// The normal matrix J'WJ and the gradient J'We.
#[derive(Clone, Debug, Default)]
pub(crate) struct Normal {
    pub shared: DMatrix<f64>,
    pub gradient: DVector<f64>,
    /// One entry per record; `None` for a start at rest.
    pub initial: Vec<Option<InitialPart>>,
}

impl Normal {
    pub fn new(model: &Sections) -> Self {
        let count = Order::of(model).count();
        Self { shared: DMatrix::zeros(count, count), gradient: DVector::zeros(count), initial: Vec::new() }
    }

    /// Adds the next record; `initial` is its initial state, or `None` at rest.
    pub fn add(
        &mut self,
        model: &Sections,
        initial: Option<&DVector<f64>>,
        places: &Places,
        grams: &[Gram],
        weights: &[f64],
        free: Free,
    ) {
        let order = Order::of(model);
        let count = order.count();
        let n = model.states;
        let mut part = initial.map(|_| InitialPart {
            own: DMatrix::zeros(n, n),
            shared: DMatrix::zeros(n, count),
            gradient: DVector::zeros(n),
        });
        for gram in grams {
            for &i in &gram.outputs {
                let columns = columns(model, &order, initial, places, i, free);
                // Inner products of every signal with every column of the Jacobian.
                let mut moved = DMatrix::zeros(places.residual(0), columns.len());
                for (column, mut to) in columns.iter().zip(moved.column_iter_mut()) {
                    for &(signal, weight) in &column.signals {
                        to.axpy(weight, &gram.products.column(signal).rows(0, places.residual(0)), 1.0);
                    }
                }
                let errors = gram.products.column(places.residual(i));
                for left in &columns {
                    let of_errors: f64 = left.signals.iter().map(|&(s, w)| w * errors[s]).sum::<f64>() * weights[i];
                    match (left.parameter.checked_sub(count), &mut part) {
                        (None, _) => self.gradient[left.parameter] += of_errors,
                        (Some(x), Some(part)) => part.gradient[x] += of_errors,
                        (Some(_), None) => {}
                    }
                    for (right, moved) in columns.iter().zip(moved.column_iter()) {
                        let value = weights[i] * left.signals.iter().map(|&(s, w)| w * moved[s]).sum::<f64>();
                        match (left.parameter.checked_sub(count), right.parameter.checked_sub(count), &mut part) {
                            (None, None, _) => self.shared[(left.parameter, right.parameter)] += value,
                            (Some(x), None, Some(part)) => part.shared[(x, right.parameter)] += value,
                            (Some(x), Some(y), Some(part)) => part.own[(x, y)] += value,
                            _ => {}
                        }
                    }
                }
            }
        }
        self.initial.push(part);
    }

    /// Solves (J'WJ + damping diag J'WJ) step = J'We, or returns `None` if the matrix is not positive definite. The
    /// initial states that are estimated follow the shared parameters, record after record. A parameter without
    /// influence is unchanged.
    pub fn step(&self, damping: f64) -> Option<DVector<f64>> {
        let scale = |h: &DMatrix<f64>| h.diagonal().map(|x| if x > 0.0 { 1.0 / x.sqrt() } else { 0.0 });
        let scaled = |h: &DMatrix<f64>, rows: &DVector<f64>, columns: &DVector<f64>| {
            DMatrix::from_fn(h.nrows(), h.ncols(), |i, j| h[(i, j)] * rows[i] * columns[j])
        };
        let damped = |mut h: DMatrix<f64>| {
            for i in 0..h.nrows() {
                h[(i, i)] = if h[(i, i)] > 0.0 { 1.0 + damping } else { 1.0 };
            }
            h
        };
        let size = scale(&self.shared);
        let mut reduced = damped(scaled(&self.shared, &size, &size));
        let mut right = self.gradient.component_mul(&size);
        let mut parts = Vec::new();
        for part in &self.initial {
            parts.push(match part {
                None => None,
                Some(part) => {
                    let own_size = scale(&part.own);
                    let own = Cholesky::new(damped(scaled(&part.own, &own_size, &own_size)))?;
                    let across = scaled(&part.shared, &own_size, &size);
                    let gradient = part.gradient.component_mul(&own_size);
                    reduced -= across.transpose() * own.solve(&across);
                    right -= across.transpose() * own.solve(&gradient);
                    Some((own, own_size, across, gradient))
                }
            });
        }
        let shared = Cholesky::new(reduced)?.solve(&right);
        let mut step = shared.component_mul(&size).as_slice().to_vec();
        for (own, own_size, across, gradient) in parts.into_iter().flatten() {
            step.extend(own.solve(&(gradient - across * &shared)).component_mul(&own_size).iter());
        }
        Some(DVector::from_vec(step))
    }

    /// Returns the Fisher information of the shared parameters, with the initial states eliminated as unknowns.
    pub fn information(&self) -> DMatrix<f64> {
        let mut reduced = self.shared.clone();
        for part in self.initial.iter().flatten() {
            // Directions of an initial state that the record does not determine cost the other parameters no
            // information.
            if let Ok(inverse) = part.own.clone().pseudo_inverse(part.own.amax() * 1e-13) {
                reduced -= part.shared.transpose() * inverse * &part.shared;
            }
        }
        (&reduced + reduced.transpose()) / 2.0
    }
}

impl Equations for Normal {
    type Work = ();

    fn solve(&self, damping: f64, (): &mut (), step: &mut DVector<f64>) -> bool {
        self.step(damping).map(|found| *step = found).is_some()
    }
}

/// Returns the Jacobian of output i, with a column for every parameter that affects it.
fn columns(
    model: &Sections,
    order: &Order,
    initial: Option<&DVector<f64>>,
    places: &Places,
    i: usize,
    free: Free,
) -> Vec<Column> {
    let m = model.m();
    let mut columns = Vec::new();
    let mut add = |parameter: usize, signals: Vec<(usize, f64)>| columns.push(Column { parameter, signals });
    for (s, section) in model.poles.iter().enumerate() {
        let (at, up, down) = (2 * s, section.up, section.down());
        let (c1, c2) = (model.c[(i, at)], model.c[(i, at + 1)]);
        let pair = section.is_pair();
        // The responses C_s (zI - A_s)^{-1} e_1 v and C_s (zI - A_s)^{-1} e_2 v for a driver v.
        let first = |v: usize| [(v, c1), (v + 1, c2 * down)];
        let second = |v: usize| [(v + 1, c1 * up), (v, c2)];
        if free == Free::All {
            let (x1, x2) = (places.of(s, m), places.of(s, m + 1));
            let of_c: Vec<(usize, f64)> = first(x1).into_iter().chain(second(x2)).collect();
            let of_d = if pair { second(x1).map(|(v, w)| (v, w / up)).to_vec() } else { Vec::new() };
            let slope = section.slope(model.radius);
            for coordinate in 0..model.order(s) {
                let chain = |part: &[(usize, f64)], row: usize| -> Vec<(usize, f64)> {
                    part.iter().map(|&(v, w)| (v, w * slope[row][coordinate])).collect()
                };
                let mut all = chain(&of_c, 0);
                all.extend(chain(&of_d, 1));
                add(order.pole(s, coordinate), all);
            }
        }
        for j in (0..m).filter(|_| free != Free::States) {
            add(order.b(at, j), first(places.of(s, j)).to_vec());
            if pair {
                add(order.b(at + 1, j), second(places.of(s, j)).to_vec());
            }
        }
        if let Some(x0) = initial {
            let impulse = places.of(s, m + 2);
            add(order.count() + at, first(impulse).to_vec());
            if pair {
                add(order.count() + at + 1, second(impulse).to_vec());
            }
            if free == Free::All {
                let (mut of_c1, mut of_c2) = states(model, places, s);
                of_c1.extend([(impulse, x0[at]), (impulse + 1, up * x0[at + 1])]);
                of_c2.extend([(impulse, x0[at + 1]), (impulse + 1, down * x0[at])]);
                add(order.c(i, at), of_c1);
                if pair {
                    add(order.c(i, at + 1), of_c2);
                }
            }
        } else if free == Free::All {
            let (of_c1, of_c2) = states(model, places, s);
            add(order.c(i, at), of_c1);
            if pair {
                add(order.c(i, at + 1), of_c2);
            }
        }
    }
    if model.feedthrough && free != Free::States {
        for j in 0..m {
            add(order.d(i, j), vec![(places.input(j), 1.0)]);
        }
    }
    columns
}

/// Returns the two states of section s as combinations of the signals driven by the inputs.
fn states(model: &Sections, places: &Places, s: usize) -> (Combination, Combination) {
    let (up, down) = (model.poles[s].up, model.poles[s].down());
    let mut both = (Vec::new(), Vec::new());
    for j in 0..model.m() {
        let (b1, b2) = (model.b[(2 * s, j)], model.b[(2 * s + 1, j)]);
        let v = places.of(s, j);
        both.0.extend([(v, b1), (v + 1, up * b2)]);
        both.1.extend([(v + 1, down * b1), (v, b2)]);
    }
    both
}
