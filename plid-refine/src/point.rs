//! A point of the optimisation: a model in sections, the initial states of its records, and its simulation error.

use nalgebra::DVector;
use ndarray::Array2;
use plid_model::simulate;
use rayon::prelude::*;

use crate::error::RefineError;
use crate::gram::{gram, places, squares};
use crate::normal::{Free, Normal, Order};
use crate::record::{Data, Scaled, Start};
use crate::sections::Sections;

/// Lower bound of a residual variance, relative to the power of the output; smaller values are rounding.
const FLOOR: f64 = 1e-28;
/// Damping of the linear fits: enough to separate two identical sections, and compensated by the iterations that
/// follow.
const LINEAR_DAMPING: f64 = 1e-10;
/// Iterations of the linear fit; each corrects the remaining effect of damping and rounding.
const ROUNDS: usize = 4;

#[derive(Clone, Debug)]
pub(crate) struct Point {
    pub model: Sections,
    /// The initial state of each record, padded like the sections; `None` at rest.
    pub initial: Vec<Option<DVector<f64>>>,
}

impl Point {
    pub fn new(model: Sections, data: &Data) -> Self {
        let size = 2 * model.poles.len();
        let initial = |start: Start| (start == Start::Unknown).then(|| DVector::zeros(size));
        Self { initial: data.records.iter().map(|r| initial(r.start)).collect(), model }
    }

    /// Returns the mean square simulation error of each output.
    pub fn variances(&self, data: &Data) -> Vec<f64> {
        let sums: Vec<Vec<f64>> = data
            .records
            .par_iter()
            .zip(&self.initial)
            .map(|(record, initial)| squares(record, &self.model, initial.as_ref()))
            .collect();
        let present = data.present();
        (0..data.p()).map(|i| sums.iter().map(|s| s[i]).sum::<f64>() / present[i].max(1) as f64 + FLOOR).collect()
    }

    /// Returns the simulation errors of each record (samples x p); NaN where an output is missing.
    pub fn errors(&self, data: &Data) -> Result<Vec<Array2<f64>>, RefineError> {
        let model = self.model.to_model(1.0)?;
        let error = |(record, initial): (&Scaled, &Option<DVector<f64>>)| {
            let state = initial.as_ref().map_or(model.rest(), |x| x.rows(0, model.n()).into_owned());
            Ok(&record.outputs - &simulate(&model, record.inputs.view(), &state)?.outputs)
        };
        data.records.iter().zip(&self.initial).map(error).collect()
    }

    /// Computes J'WJ and J'We, with each output weighted by the inverse of its entry of `variances`.
    pub fn normal(&self, data: &Data, variances: &[f64], free: Free) -> Normal {
        let mut normal = Normal::new(&self.model);
        let weights: Vec<f64> = variances.iter().map(|v| 1.0 / v).collect();
        for (record, initial) in data.records.iter().zip(&self.initial) {
            let grams = gram(record, &self.model, initial.as_ref());
            let places = places(record, &self.model);
            normal.add(&self.model, initial.as_ref(), &places, &grams, &weights, free);
        }
        normal
    }

    /// Returns the point after a step whose entries are ordered as in [`Normal::step`].
    pub fn moved(&self, step: &DVector<f64>, free: Free) -> Self {
        let mut to = self.clone();
        let order = Order::of(&self.model);
        let (n, m, radius) = (self.model.states, self.model.m(), self.model.radius);
        if free == Free::All {
            for (s, section) in to.model.poles.iter_mut().enumerate() {
                let mut eta = section.coordinates(radius);
                let coordinates = if section.is_pair() { 2 } else { 1 };
                for (coordinate, eta) in eta.iter_mut().enumerate().take(coordinates) {
                    *eta += step[order.pole(s, coordinate)];
                }
                section.place(eta, radius);
            }
            for i in 0..self.model.p() {
                for state in 0..n {
                    to.model.c[(i, state)] += step[order.c(i, state)];
                }
            }
        }
        for j in (0..m).filter(|_| free != Free::States) {
            for state in 0..n {
                to.model.b[(state, j)] += step[order.b(state, j)];
            }
            for i in (0..self.model.p()).filter(|_| self.model.feedthrough) {
                to.model.d[(i, j)] += step[order.d(i, j)];
            }
        }
        for (k, state) in to.initial.iter_mut().flatten().enumerate() {
            let mut state = state.rows_mut(0, n);
            state += step.rows(order.count() + k * n, n);
        }
        to
    }

    /// Changes the coordinates so that the outputs observe the first state of every pair of real poles at least as
    /// well as the second.
    ///
    /// The sign of the eigenvector of a real pole is arbitrary, so either state may be the sum of the two poles'
    /// contributions and the other their difference. If the outputs observe mainly the difference, the section loses
    /// observability as the poles meet, and the poles cannot become complex; if the outputs observe the sum, the
    /// poles can.
    pub fn turn(&mut self) {
        for (s, section) in
            self.model.poles.iter().enumerate().filter(|(_, section)| section.is_pair() && section.d > 0.0)
        {
            let at = 2 * s;
            let ratio = section.d.sqrt() / section.up;
            let (first, second) = (self.model.c.column(at).norm(), self.model.c.column(at + 1).norm());
            if first >= ratio * second {
                continue;
            }
            // The change of coordinates is x1' = x2 / ratio, x2' = ratio x1.
            self.model.c.swap_columns(at, at + 1);
            self.model.c.column_mut(at).scale_mut(ratio);
            self.model.c.column_mut(at + 1).scale_mut(1.0 / ratio);
            self.model.b.swap_rows(at, at + 1);
            self.model.b.row_mut(at).scale_mut(1.0 / ratio);
            self.model.b.row_mut(at + 1).scale_mut(ratio);
            for state in self.initial.iter_mut().flatten() {
                state.swap_rows(at, at + 1);
                state[at] /= ratio;
                state[at + 1] *= ratio;
            }
        }
    }

    /// Fits those of B, D and the initial states that are `free` by least squares with the given poles and C. The
    /// simulation is linear in these parameters.
    ///
    /// # Errors
    /// Returns an error if the normal equations cannot be solved.
    pub fn fit(mut self, data: &Data, free: Free) -> Result<Self, RefineError> {
        let mut best = f64::INFINITY;
        for _ in 0..ROUNDS {
            let ones = vec![1.0; data.p()];
            let normal = self.normal(data, &ones, free);
            let failed = RefineError::Decomposition { what: "the least-squares fit of B and D" };
            let next = self.moved(&normal.step(LINEAR_DAMPING).ok_or(failed)?, free);
            let error: f64 = next.variances(data).iter().sum();
            if !(error < best) {
                break;
            }
            (self, best) = (next, error);
        }
        Ok(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, Dyn, OMatrix};
    use proptest::prelude::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use crate::record::Record;
    use crate::sections::{Section, Sections};

    fn uniform(seed: u64) -> impl FnMut() -> f64 {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        move || 2.0 * random.random::<f64>() - 1.0
    }

    /// Returns a point with random sections of every kind, and random data; `states` may be odd.
    fn point(seed: u64, states: usize, starts: &[Start], feedthrough: bool) -> (Point, Data) {
        let mut next = uniform(seed);
        let (m, p, samples) = (2, 2, 700);
        let radius = 0.995;
        let count = states.div_ceil(2);
        let poles: Vec<Section> = (0..count)
            .map(|s| {
                let mut section = Section { c: 0.0, d: 0.0, up: if 2 * s + 1 < states { 0.3 } else { 0.0 } };
                section.place([2.0 * next(), 2.0 * next()], radius);
                section
            })
            .collect();
        let mut matrix = |rows: usize, columns: usize| -> OMatrix<f64, Dyn, Dyn> {
            DMatrix::from_fn(rows, columns, |i, j| if i.max(j) < states { next() } else { 0.0 })
        };
        let (b, c, d) = (matrix(2 * count, m), matrix(p, 2 * count), matrix(p, m));
        let d = if feedthrough { d } else { d * 0.0 };
        let model = Sections { states, poles, radius, b, c, d, feedthrough };
        let inputs: Vec<Array2<f64>> =
            starts.iter().map(|_| Array2::from_shape_simple_fn((samples, m), &mut next)).collect();
        let mut outputs: Vec<Array2<f64>> =
            starts.iter().map(|_| Array2::from_shape_simple_fn((samples, p), &mut next)).collect();
        // One output is missing over a range that spans the end of a block.
        outputs[0].slice_mut(ndarray::s![500..520, 1]).fill(f64::NAN);
        let records: Vec<Record<'_>> = inputs
            .iter()
            .zip(&outputs)
            .zip(starts)
            .map(|((u, y), &start)| Record { inputs: u.view(), outputs: y.view(), start })
            .collect();
        let data = Data::new(&records).unwrap();
        let mut point = Point::new(model, &data);
        for state in point.initial.iter_mut().flatten() {
            state.rows_mut(0, states).iter_mut().for_each(|x| *x = next());
        }
        (point, data)
    }

    /// Returns half the weighted sum of squares, whose gradient is -J'We.
    fn half_squares(point: &Point, data: &Data, variances: &[f64]) -> f64 {
        let own = point.variances(data);
        data.present().iter().zip(own.iter().zip(variances)).map(|(&n, (v, w))| 0.5 * n as f64 * (v - FLOOR) / w).sum()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(12))]
        #[test]
        fn gradients_are_those_of_differences(
            seed in 0_u64..1 << 40,
            states in 1_usize..6,
            feedthrough in any::<bool>(),
        ) {
            let starts = [Start::Unknown, Start::Rest, Start::Unknown];
            let (point, data) = point(seed, states, &starts, feedthrough);
            let variances = [0.7, 2.0];
            let normal = point.normal(&data, &variances, Free::All);
            let count = normal.gradient.len();
            let unknown = point.initial.iter().flatten().count();
            let derivative = |axis: usize| {
                // Fourth-order differences. Poles near the unit circle make the function strongly curved, so the step
                // is small, and rounding limits the agreement to 1e-9.
                let at = |h: f64| {
                    let mut step = DVector::zeros(count + unknown * states);
                    step[axis] = h;
                    half_squares(&point.moved(&step, Free::All), &data, &variances)
                };
                let h = 1e-4;
                (8.0 * (at(h) - at(-h)) - (at(2.0 * h) - at(-2.0 * h))) / (12.0 * h)
            };
            let size = normal.gradient.amax();
            for k in 0..count {
                let found = derivative(k);
                prop_assert!((found + normal.gradient[k]).abs() < 1e-6 * size, "{k}: {found} {}", -normal.gradient[k]);
            }
            for (r, part) in normal.initial.iter().flatten().enumerate() {
                for k in 0..states {
                    let found = derivative(count + r * states + k);
                    prop_assert!((found + part.gradient[k]).abs() < 1e-6 * size, "x0 {k}: {found}");
                }
            }
        }
    }

    #[test]
    fn a_turned_section_is_the_same_model() {
        let (mut point, data) = point(5, 4, &[Start::Unknown, Start::Rest], true);
        point.model.poles[0] = Section { c: 0.6, d: 0.04, up: 0.3 };
        point.model.c.column_mut(0).fill(0.01);
        let mut turned = point.clone();
        turned.turn();
        assert!(turned.model != point.model);
        for (a, b) in turned.variances(&data).iter().zip(point.variances(&data)) {
            assert!((a / b - 1.0).abs() < 1e-12);
        }
        let mut again = turned.clone();
        again.turn();
        assert_eq!(again.model, turned.model);
    }

    /// Compares J'WJ with a Jacobian from finite differences of the simulated outputs.
    #[test]
    fn the_normal_matrix_is_that_of_differences() {
        let (point, data) = point(3, 5, &[Start::Unknown], true);
        let variances = [0.7, 2.0];
        let normal = point.normal(&data, &variances, Free::All);
        let count = normal.gradient.len();
        let output = |point: &Point| -> Vec<f64> {
            let model = point.model.to_model(1.0).unwrap();
            let state = point.initial[0].as_ref().unwrap().rows(0, 5).into_owned();
            let run = plid_model::simulate(&model, data.records[0].inputs.view(), &state).unwrap().outputs;
            let there = run.indexed_iter().filter(|(at, _)| !data.records[0].outputs[*at].is_nan());
            there.map(|((_, i), y)| y / variances[i].sqrt()).collect()
        };
        let column = |k: usize| -> DVector<f64> {
            let at = |h: f64| {
                let mut step = DVector::zeros(count + 5);
                step[k] = h;
                DVector::from_vec(output(&point.moved(&step, Free::All)))
            };
            let h = 1e-3;
            ((at(h) - at(-h)) * 8.0 - (at(2.0 * h) - at(-2.0 * h))) / (12.0 * h)
        };
        let jacobian = DMatrix::from_columns(&(0..count + 5).map(column).collect::<Vec<_>>());
        let wanted = jacobian.transpose() * &jacobian;
        let size = wanted.amax();
        let part = normal.initial[0].as_ref().unwrap();
        assert!((&normal.shared - wanted.view((0, 0), (count, count))).amax() < 1e-7 * size);
        assert!((&part.own - wanted.view((count, count), (5, 5))).amax() < 1e-7 * size);
        assert!((&part.shared - wanted.view((count, 0), (5, count))).amax() < 1e-7 * size);
    }
}
