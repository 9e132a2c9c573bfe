//! The fit that everything else asks for: linear parameters and effects together, on whitened free-run residuals.

use std::sync::Arc;

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use crate::case::record::{Channels, Record};
use crate::effects::{Action, Effect, Place, Range, Setting};
use crate::fit::nuisance::Nuisance;
use crate::fit::robust::widened;
use crate::noise::NoiseModel;
use crate::noise::whiten::Whitener;
use crate::plant::Plant;
use crate::settings::GapSettings;
use crate::simulate::{Fineness, simulate};

/// An effect at a place with its parameters.
#[derive(Clone)]
pub struct Placed<'a> {
    /// The effect.
    pub effect: &'a dyn Effect,
    /// Where.
    pub place: Place,
    /// As [`Effect::parameters`] orders them.
    pub parameters: Vec<f64>,
}

/// Records, simulation and noise: what a fit starts from.
#[derive(Clone)]
pub struct Problem {
    /// The simulation as given.
    pub plant: Plant,
    /// Those that are fitted.
    pub records: Vec<Record>,
    /// Of each record.
    pub whiteners: Vec<Whitener>,
    /// The linear parameters.
    pub nuisance: Nuisance,
    /// What effects may know.
    pub setting: Setting,
    /// Thresholds of the diagnosis.
    pub settings: Arc<GapSettings>,
}

/// Derivatives of the whitened outputs (rows x nuisance) at one linear model, with the normal matrix and its factor.
#[derive(Clone)]
pub struct Tangent {
    rows: usize,
    columns: usize,
    values: Vec<f64>,
    /// J'J + 1/std^2.
    pub normal: DMatrix<f64>,
}

/// A fit of linear parameters and effects.
#[derive(Clone)]
pub struct Fit<'a> {
    /// Linear parameters.
    pub eta: Vec<f64>,
    /// Effects with fitted parameters.
    pub effects: Vec<Placed<'a>>,
    /// Whitened residual.
    pub residual: Vec<f64>,
    /// Sum of squares of the residual and of eta / std.
    pub cost: f64,
    /// Covariance of the effects' parameters, in their own units.
    pub covariance: DMatrix<f64>,
    /// Whether the last step was small.
    pub converged: bool,
}

impl Fit<'_> {
    /// Number of effect parameters.
    pub fn parameters(&self) -> usize {
        self.effects.iter().map(|placed| placed.parameters.len()).sum()
    }
}

/// How firmly, as one over a relative standard deviation, a length is held that no data tell.
const HELD: f64 = 1e4;

/// Damping of a fit's first step (Marquardt 1963).
const UNDAMPED: f64 = 1e-3;

/// Steps after which derivatives are taken anew where effects move modes.
const RENEWED: usize = 3;

/// The last steps of a fit.
const SETTLED: Effort = Effort { steps: 6, gain: 0.05, fineness: Fineness::FINE };

/// How far a fit goes.
#[derive(Debug, Clone, Copy)]
pub struct Effort {
    /// Gauss-Newton steps at most.
    pub steps: usize,
    /// A step that lowers the cost by less than this ends the fit.
    pub gain: f64,
    /// Of forces within a sample.
    pub fineness: Fineness,
}

impl Problem {
    /// The same with the first samples of each record only: a search costs in proportion, and a record from rest stays one.
    pub fn head(&self, samples: usize, noise: &NoiseModel) -> Self {
        let cut = |channels: &Channels| channels.iter().map(|x| x[..x.len().min(samples)].to_vec()).collect();
        let records: Vec<Record> = self
            .records
            .iter()
            .map(|record| Record { u: cut(&record.u), y: cut(&record.y), simulated: None, ..record.clone() })
            .collect();
        let whiteners = records
            .iter()
            .zip(&self.whiteners)
            .map(|(record, whole)| Whitener::new(record, noise, self.plant.rate, whole.masked.clone()))
            .collect();
        Self {
            plant: self.plant.clone(),
            whiteners,
            nuisance: self.nuisance.clone(),
            setting: self.setting.clone(),
            settings: self.settings.clone(),
            records,
        }
    }

    /// The same without one of the records; its initial state keeps its place among the linear parameters.
    pub fn without(&self, record: usize) -> Self {
        let mut others = self.clone();
        others.records.remove(record);
        others.whiteners.remove(record);
        others.nuisance.forget(record);
        others
    }

    /// Rows of the whitened residual.
    pub fn rows(&self) -> usize {
        self.whiteners.iter().map(Whitener::rows).sum()
    }

    /// Rows of one record.
    pub fn rows_of(&self, record: usize) -> std::ops::Range<usize> {
        let start = self.whiteners[..record].iter().map(Whitener::rows).sum();
        start..start + self.whiteners[record].rows()
    }

    /// What the effects do.
    pub fn actions(&self, effects: &[Placed]) -> Vec<Action> {
        effects.iter().flat_map(|placed| placed.effect.act(&self.setting, &placed.place, &placed.parameters)).collect()
    }

    /// Free run of one record.
    pub fn outputs(
        &self,
        plant: &Plant,
        eta: &[f64],
        actions: &[Action],
        index: usize,
        fineness: Fineness,
    ) -> Channels {
        let record = &self.records[index];
        let start = self.nuisance.start(index, eta);
        simulate(plant, actions, &record.u, record.start_s, start.as_ref(), fineness)
    }

    /// Whitened residual of a linear model with effects.
    pub fn residual(&self, plant: &Plant, eta: &[f64], effects: &[Placed], fineness: Fineness) -> Vec<f64> {
        let actions = self.actions(effects);
        let mut to = vec![0.0; self.rows()];
        for index in 0..self.records.len() {
            let outputs = self.outputs(plant, eta, &actions, index, fineness);
            let range = self.rows_of(index);
            self.whitened_error(index, &outputs, &mut to[range]);
        }
        to
    }

    fn whitened_error(&self, index: usize, outputs: &[Vec<f64>], to: &mut [f64]) {
        self.whiteners[index].apply(&self.records[index].error(outputs), to);
    }

    /// Derivatives at a linear model.
    pub fn tangent(&self, plant: &Plant) -> Tangent {
        let (rows, columns) = (self.rows(), self.nuisance.len());
        let mut values = vec![0.0; rows * columns];
        let blocks: Vec<Vec<(usize, Vec<f64>)>> = (0..self.records.len())
            .into_par_iter()
            .map(|index| {
                let mut found = Vec::new();
                self.nuisance.tangents(plant, &self.records[index], index, |column, outputs| {
                    let mut white = vec![0.0; self.whiteners[index].rows()];
                    self.whiteners[index].apply(outputs, &mut white);
                    found.push((column, white));
                });
                found
            })
            .collect();
        for (index, found) in blocks.into_iter().enumerate() {
            let range = self.rows_of(index);
            for (column, white) in found {
                values[column * rows + range.start..column * rows + range.end].copy_from_slice(&white);
            }
        }
        Tangent::new(values, rows, &self.nuisance.std)
    }

    /// Where a refit goes from a residual: J' r less the pull of the prior on what the linear parameters are at.
    pub fn gradient(&self, tangent: &Tangent, residual: &[f64], eta: &[f64]) -> DMatrix<f64> {
        let mut gradient = tangent.cross(residual, 1);
        for ((g, x), std) in gradient.iter_mut().zip(eta).zip(&self.nuisance.std) {
            *g -= x / (std * std);
        }
        gradient
    }

    /// Sum of squares of eta / std.
    pub fn penalty(&self, eta: &[f64]) -> f64 {
        eta.iter().zip(&self.nuisance.std).map(|(x, std)| (x / std).powi(2)).sum()
    }

    /// The largest change of a parameter of the simulation, in standard deviations of its prior.
    pub fn bent(&self, eta: &[f64]) -> f64 {
        let z = |index: usize| (eta[index] / self.nuisance.std[index]).abs();
        (0..self.nuisance.of_simulation()).map(z).fold(0.0, f64::max)
    }

    /// Fits the linear parameters and the effects from the given start. Their derivatives are those of the linear simulation, as far as effects do not move its
    /// modes.
    pub fn fit<'a>(&self, tangent: &Tangent, eta: &[f64], effects: &[Placed<'a>], effort: Effort) -> Fit<'a> {
        self.fitted(tangent, true, eta, effects, effort)
    }

    /// The last steps of a fit, with the derivatives of the simulation with its effects: without a force that acts inside the structure they are off by as
    /// much as it changes the motion, and the fit ends beside its minimum, with intervals that are too narrow.
    pub fn settled<'a>(&self, fit: &Fit<'a>) -> Fit<'a> {
        if fit.effects.is_empty() {
            return fit.clone();
        }
        let plant = self.nuisance.apply(&self.plant, &fit.eta);
        let residual = self.residual(&plant, &fit.eta, &fit.effects, SETTLED.fineness);
        let start = Fit { residual, ..fit.clone() };
        let tangent = self.exact_tangent(&start);
        let mut settled = self.fitted(&tangent, false, &fit.eta, &fit.effects, SETTLED);
        settled.covariance = self.covariance(&tangent, &settled);
        settled
    }

    /// Of the effects' parameters, as wide as the residuals say, and no narrower than the noise model does.
    fn covariance(&self, tangent: &Tangent, fit: &Fit) -> DMatrix<f64> {
        let plant = self.nuisance.apply(&self.plant, &fit.eta);
        let scales = self.scales(&fit.effects);
        let columns = self.effect_columns(&plant, &fit.eta, &fit.effects, &fit.residual, &scales, SETTLED.fineness);
        let (normal, _) = self.normal(tangent, &columns, &fit.residual, &fit.eta);
        let lengths = self.lengths(&fit.effects, &scales);
        let model = effect_covariance(&normal, &lengths, &scales, &fit.effects);
        let (rows, first) = (fit.residual.len() + lengths.len(), self.nuisance.len());
        // One row more for each length that says nothing.
        let mut jacobian = vec![0.0; rows * (first + columns.len())];
        let all = tangent.values.chunks(fit.residual.len()).chain(columns.iter().map(Vec::as_slice));
        for (to, from) in jacobian.chunks_mut(rows).zip(all) {
            to[..from.len()].copy_from_slice(from);
        }
        for (k, length) in lengths.iter().enumerate() {
            length.iter().enumerate().for_each(|(j, x)| jacobian[(first + j) * rows + fit.residual.len() + k] = *x);
        }
        let residual = [fit.residual.as_slice(), &vec![0.0; lengths.len()]].concat();
        let prior: Vec<f64> =
            self.nuisance.std.iter().map(|std| std.powi(-2)).chain(columns.iter().map(|_| 0.0)).collect();
        match widened(&jacobian, &prior, &residual, columns.len()) {
            Some(by) => DMatrix::from_fn(by.len(), by.len(), |i, j| by[i] * by[j] * model[(i, j)]),
            None => model,
        }
    }

    /// Derivatives by the linear parameters, by differences of whole simulations.
    fn exact_tangent(&self, fit: &Fit) -> Tangent {
        // In standard deviations of the prior.
        const STEP: f64 = 1e-2;
        let rows = self.rows();
        let mut values = vec![0.0; rows * self.nuisance.len()];
        values.par_chunks_mut(rows).enumerate().for_each(|(k, column)| {
            let step = STEP * self.nuisance.std[k];
            let mut eta = fit.eta.clone();
            eta[k] += step;
            let plant = self.nuisance.apply(&self.plant, &eta);
            let moved = self.residual(&plant, &eta, &fit.effects, SETTLED.fineness);
            column.iter_mut().zip(&moved).zip(&fit.residual).for_each(|((to, m), r)| *to = (r - m) / step);
        });
        Tangent::new(values, rows, &self.nuisance.std)
    }

    /// `renewed`: the derivatives by linear parameters are taken anew where effects move modes.
    fn fitted<'a>(
        &self,
        tangent: &Tangent,
        renewed: bool,
        eta: &[f64],
        effects: &[Placed<'a>],
        effort: Effort,
    ) -> Fit<'a> {
        let mut eta = eta.to_vec();
        let mut effects = effects.to_vec();
        let mut plant = self.nuisance.apply(&self.plant, &eta);
        let mut residual = self.residual(&plant, &eta, &effects, effort.fineness);
        let mut cost = sum_of_squares(&residual) + self.penalty(&eta);
        let mut damping = UNDAMPED;
        let mut converged = false;
        let mut covariance = DMatrix::zeros(0, 0);
        let scales = self.scales(&effects);
        let mut own: Option<Tangent> = None;
        for step in 0..effort.steps {
            // Effects that move modes move what the modes' parameters do.
            if renewed
                && step % RENEWED == 0
                && let Some(changed) = self.changed(&plant, &effects)
            {
                own = Some(self.tangent(&changed));
            }
            let tangent = own.as_ref().unwrap_or(tangent);
            let columns = self.effect_columns(&plant, &eta, &effects, &residual, &scales, effort.fineness);
            let (normal, gradient) = self.normal(tangent, &columns, &residual, &eta);
            covariance = effect_covariance(&normal, &self.lengths(&effects, &scales), &scales, &effects);
            let mut moved = false;
            for _ in 0..6 {
                let Some(step) = solve_damped(&normal, &gradient, columns.len(), damping) else {
                    damping *= 10.0;
                    continue;
                };
                let trial_eta: Vec<f64> = eta.iter().zip(step.iter()).map(|(x, dx)| x + dx).collect();
                let trial = self.stepped(&effects, &step.as_slice()[eta.len()..], &scales);
                let trial_plant = self.nuisance.apply(&self.plant, &trial_eta);
                let trial_residual = self.residual(&trial_plant, &trial_eta, &trial, effort.fineness);
                let trial_cost = sum_of_squares(&trial_residual) + self.penalty(&trial_eta);
                if trial_cost < cost {
                    let gain = cost - trial_cost;
                    (eta, effects, plant, residual, cost) = (trial_eta, trial, trial_plant, trial_residual, trial_cost);
                    damping = (damping * 0.1).max(1e-9);
                    converged = gain < effort.gain;
                    moved = true;
                    break;
                }
                damping = (damping * 10.0).min(1e6);
            }
            if !moved {
                converged = true;
            }
            if converged {
                break;
            }
        }
        Fit { eta, effects, residual, cost, covariance, converged }
    }

    /// What the records tell of a fit's linear parameters and effect parameters (each in the fit's own scale): the normal matrix with the
    /// prior, and J' residual without it.
    pub fn information(&self, fit: &Fit, residual: &[f64]) -> (DMatrix<f64>, DVector<f64>) {
        let plant = self.nuisance.apply(&self.plant, &fit.eta);
        let tangent = self.tangent(&self.changed(&plant, &fit.effects).unwrap_or_else(|| plant.clone()));
        let scales = self.scales(&fit.effects);
        let columns = self.effect_columns(&plant, &fit.eta, &fit.effects, residual, &scales, Fineness::COARSE);
        self.normal(&tangent, &columns, residual, &vec![0.0; self.nuisance.len()])
    }

    /// The plant with effects that change it, if there are any.
    fn changed(&self, plant: &Plant, effects: &[Placed]) -> Option<Plant> {
        let mut changed = None;
        for action in self.actions(effects) {
            if let Action::Plant(change) = action {
                change(changed.get_or_insert_with(|| plant.clone()));
            }
        }
        changed
    }

    /// How each effect parameter is stepped.
    fn scales(&self, effects: &[Placed]) -> Vec<Scale> {
        let mut scales = Vec::new();
        for placed in effects {
            for (parameter, &start) in placed.effect.parameters(&self.setting).iter().zip(&placed.parameters) {
                scales.push(match parameter.range {
                    Range::Signed | Range::Direction => Scale::Linear(if start == 0.0 { 1.0 } else { start.abs() }),
                    Range::Positive => Scale::Logarithm,
                    Range::Hz => Scale::Linear(0.2 / self.setting.duration_s.max(1e-9)),
                    Range::Angle => Scale::Linear(1.0),
                });
            }
        }
        scales
    }

    /// Of each vector of which only the direction counts, what its length depends on, over all parameters of the effects: no data tell it, and it is held where it
    /// is.
    fn lengths(&self, effects: &[Placed], scales: &[Scale]) -> Vec<Vec<f64>> {
        let mut lengths = Vec::new();
        let mut first = 0;
        for placed in effects {
            let mut length = vec![0.0; scales.len()];
            for (k, parameter) in placed.effect.parameters(&self.setting).iter().enumerate() {
                if parameter.range == Range::Direction {
                    let value = placed.parameters[k];
                    length[first + k] = value * scales[first + k].slope(value);
                }
            }
            first += placed.parameters.len();
            let size = dot(&length, &length).sqrt();
            if size > 0.0 {
                lengths.push(length.iter().map(|x| HELD * x / size).collect());
            }
        }
        lengths
    }

    fn stepped<'a>(&self, effects: &[Placed<'a>], step: &[f64], scales: &[Scale]) -> Vec<Placed<'a>> {
        let mut stepped = effects.to_vec();
        let parameters = stepped.iter_mut().flat_map(|placed| placed.parameters.iter_mut());
        for ((value, step), scale) in parameters.zip(step).zip(scales) {
            *value = scale.moved(*value, *step);
        }
        stepped
    }

    /// Derivatives of the whitened outputs by each effect parameter (in its scale), by differences.
    fn effect_columns(
        &self,
        plant: &Plant,
        eta: &[f64],
        effects: &[Placed],
        residual: &[f64],
        scales: &[Scale],
        fineness: Fineness,
    ) -> Vec<Vec<f64>> {
        const STEP: f64 = 1e-3;
        (0..scales.len())
            .map(|j| {
                let mut step = vec![0.0; scales.len()];
                step[j] = STEP;
                let mut moved = self.residual(plant, eta, &self.stepped(effects, &step, scales), fineness);
                moved.iter_mut().zip(residual).for_each(|(m, r)| *m = (r - *m) / STEP);
                moved
            })
            .collect()
    }

    fn normal(
        &self,
        tangent: &Tangent,
        columns: &[Vec<f64>],
        residual: &[f64],
        eta: &[f64],
    ) -> (DMatrix<f64>, DVector<f64>) {
        let (n, k) = (tangent.columns, columns.len());
        let mut flat: Vec<f64> = columns.iter().flatten().copied().collect();
        flat.extend_from_slice(residual);
        let cross = tangent.cross(&flat, k + 1);
        let mut normal = DMatrix::zeros(n + k, n + k);
        let mut gradient = DVector::zeros(n + k);
        normal.view_mut((0, 0), (n, n)).copy_from(&tangent.normal);
        for j in 0..k {
            for i in 0..n {
                normal[(i, n + j)] = cross[(i, j)];
                normal[(n + j, i)] = cross[(i, j)];
            }
            for i in 0..=j {
                let product = dot(&columns[i], &columns[j]);
                normal[(n + i, n + j)] = product;
                normal[(n + j, n + i)] = product;
            }
            gradient[n + j] = dot(&columns[j], residual);
        }
        for i in 0..n {
            gradient[i] = cross[(i, k)] - eta[i] / self.nuisance.std[i].powi(2);
        }
        (normal, gradient)
    }
}

impl Tangent {
    /// Of derivatives, column after column, of parameters with a prior of these standard deviations.
    pub fn new(values: Vec<f64>, rows: usize, std: &[f64]) -> Self {
        let columns = std.len();
        let mut tangent = Self { rows, columns, values, normal: DMatrix::zeros(columns, columns) };
        tangent.normal = tangent.cross(&tangent.values, columns);
        for (j, std) in std.iter().enumerate() {
            tangent.normal[(j, j)] += 1.0 / (std * std);
        }
        tangent
    }

    /// J' V for V of `count` columns.
    pub fn cross(&self, v: &[f64], count: usize) -> DMatrix<f64> {
        let mut product = DMatrix::zeros(self.columns, count);
        if self.columns == 0 || count == 0 {
            return product;
        }
        let j = MatRef::from_column_major_slice(&self.values, self.rows, self.columns);
        let v = MatRef::from_column_major_slice(v, self.rows, count);
        let to = MatMut::from_column_major_slice_mut(product.as_mut_slice(), self.columns, count);
        matmul(to, Accum::Replace, j.transpose(), v, 1.0, Par::Seq);
        product
    }
}

/// How a step in a fit changes a parameter.
#[derive(Debug, Clone, Copy)]
enum Scale {
    /// value + step * scale.
    Linear(f64),
    /// value * e^step.
    Logarithm,
}

impl Scale {
    fn moved(self, value: f64, step: f64) -> f64 {
        match self {
            Scale::Linear(scale) => value + step * scale,
            // No step goes further than a factor e: a shape that far off says little about the slope there.
            Scale::Logarithm => value * step.clamp(-1.0, 1.0).exp(),
        }
    }

    fn slope(self, value: f64) -> f64 {
        match self {
            Scale::Linear(scale) => scale,
            Scale::Logarithm => value,
        }
    }
}

fn solve_damped(normal: &DMatrix<f64>, gradient: &DVector<f64>, effects: usize, damping: f64) -> Option<DVector<f64>> {
    let mut damped = normal.clone();
    let n = normal.nrows();
    // Linear parameters are held back only where a whole step led astray.
    for i in 0..n {
        let damping = if i < n - effects && damping <= UNDAMPED { 0.0 } else { damping };
        damped[(i, i)] = damped[(i, i)] * (1.0 + damping) + f64::MIN_POSITIVE;
    }
    let step = damped.cholesky()?.solve(gradient);
    step.iter().all(|x| x.is_finite()).then_some(step)
}

/// The effects' block of the inverse, in the parameters' own units.
fn effect_covariance(normal: &DMatrix<f64>, lengths: &[Vec<f64>], scales: &[Scale], placed: &[Placed]) -> DMatrix<f64> {
    let (n, effects) = (normal.nrows(), scales.len());
    let mut held = normal.clone();
    for length in lengths {
        for i in 0..effects {
            (0..effects).for_each(|j| held[(n - effects + i, n - effects + j)] += length[i] * length[j]);
        }
    }
    let Some(inverse) = held.cholesky().map(|c| c.inverse()) else {
        return DMatrix::from_diagonal_element(effects, effects, f64::INFINITY);
    };
    let values: Vec<f64> = placed.iter().flat_map(|p| p.parameters.iter().copied()).collect();
    let slope: Vec<f64> = scales.iter().zip(&values).map(|(scale, value)| scale.slope(*value)).collect();
    DMatrix::from_fn(effects, effects, |i, j| inverse[(n - effects + i, n - effects + j)] * slope[i] * slope[j])
}

/// Of all entries.
pub fn sum_of_squares(x: &[f64]) -> f64 {
    dot(x, x)
}

/// Of two vectors.
pub fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::Library;
    use crate::prepare::{Known, prepare};
    use crate::testing;

    /// A spring that stiffens, and a simulation whose resonances are off within the limits: with the linear simulation's derivatives the fit ends beside its
    /// minimum, from where the cost still falls along the linear parameters; and what is stated of the spring is too sure.
    #[test]
    fn the_last_steps_end_where_no_linear_parameter_lowers_the_cost() {
        let sim = testing::truss(1);
        let real = testing::truss_with(1, |modes, _, _| modes.iter_mut().for_each(|(hz, _)| *hz *= 1.0008));
        let mut case = testing::case(&sim, &real);
        let library = Library::standard();
        let ready = prepare(case.model.as_ref().unwrap(), &case.records, &Known::default()).unwrap();
        let setting = ready.problem.setting;
        let size = 1e-3 * setting.stiffness[0] / setting.d_rms[0].powi(2);
        let effect = library.get("cubic-stiffness").unwrap();
        let spring = Placed { effect, place: Place::Input(0), parameters: vec![size] };
        let plant = Plant::new(&real).unwrap();
        for record in &mut case.records {
            let run = |actions: &[Action]| simulate(&plant, actions, &record.u, record.start_s, None, Fineness::FINE);
            let (with, without) = (run(&effect.act(&setting, &spring.place, &[size])), run(&[]));
            let changed = with.iter().flatten().zip(without.iter().flatten());
            record.y.iter_mut().flatten().zip(changed).for_each(|(y, (a, b))| *y += a - b);
        }
        let problem = prepare(case.model.as_ref().unwrap(), &case.records, &Known::default()).unwrap().problem;
        let tangent = problem.tangent(&problem.plant);
        let effort = Effort { steps: 20, gain: 1e-3, fineness: Fineness::FINE };
        let fit = problem.fit(&tangent, &vec![0.0; problem.nuisance.len()], &[spring], effort);
        let settled = problem.settled(&fit);
        let still = |fit: &Fit| fit.cost - problem.settled(fit).cost;
        assert!(
            still(&settled) < 0.1 && still(&fit) > 10.0 * still(&settled).max(0.1),
            "{} {}",
            still(&fit),
            still(&settled)
        );
        assert!(settled.covariance[(0, 0)] > 1.2 * fit.covariance[(0, 0)]);
        let off = (settled.effects[0].parameters[0] - size) / settled.covariance[(0, 0)].sqrt();
        assert!(off.abs() < 4.0, "{off} standard deviations");
    }
}
