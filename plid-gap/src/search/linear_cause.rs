//! A single wrong number of the simulation, such as a gain, whose error a refit has spread over many parameters.
//!
//! With the refit alone, the linear parameters are distributed about zero, with the stated standard deviations times
//! a common factor tau that the records determine. With a cause of size s, they are distributed about its trace s d,
//! and tau is the factor of the other small errors. Both likelihoods follow from the information that the records
//! contain about the parameters (an empirical Bayes estimate of a hierarchical prior: Gelman et al., Bayesian Data
//! Analysis, 2013, chapter 5). A cause that accounts for most of the refit's changes thus gains, although the refit
//! leaves nothing of the cause in the residual.

use nalgebra::{DMatrix, DMatrixView, DVector};
use rayon::prelude::*;

use crate::effects::{Effect, Place, Range};
use crate::fit::added::Before;
use crate::fit::candidate::same;
use crate::fit::problem::{Effort, Fit, Jacobian, Placed, Problem, sum_of_squares};
use crate::fit::refit::clipped;
use crate::search::rules::Scope;
use crate::search::screen::{Base, Entry, screen};
use crate::simulate::Fineness;

/// Factors tau that are tried.
const FACTORS: [f64; 10] = [0.25, 0.4, 0.6, 1.0, 1.5, 2.3, 3.5, 5.5, 8.5, 13.0];

/// Degrees of freedom of the prior, a t distribution: a few parameters have much larger errors than the others, for
/// other reasons.
const TAILS: f64 = 3.0;

/// Number of iterations of the reweighted least squares.
const ROUNDS: usize = 12;

/// Information on a direction, relative to that of the prior, below which a cause has no trace there.
const FAINT: f64 = 1.0;

/// Effort of the fits with such a cause: the remaining parameters lie along a curved valley.
const ABSORBED: Effort = Effort { steps: 24, gain: 0.5, fineness: Fineness::FINE };

/// Number of causes whose traces are computed at once. The derivatives by the linear parameters are not kept but
/// computed anew for each product, whatever its number of columns.
const AT_ONCE: usize = 8;

/// A cause that a refit may have absorbed.
struct LinearCause<'a> {
    /// The effect with its size.
    placed: Placed<'a>,
    /// Twice the log likelihood ratio of the linear parameters with and without it.
    gain: f64,
    /// The part of the cause that the refit has absorbed.
    taken: Vec<f64>,
}

/// Returns fits, each with one of the numbers of the simulation that best account for the changes of the linear
/// parameters in a fit; empty if no number does. The derivatives are those at this fit.
pub fn fits<'a>(problem: &Problem, from: &Fit<'a>, jacobian: &Jacobian, scope: &Scope<'_, 'a>) -> Vec<Fit<'a>> {
    // A few parameters cannot imitate another number without leaving a residual.
    if problem.few() {
        return Vec::new();
    }
    let settings = &scope.settings;
    let causes = causes(problem, from, jacobian, scope);
    let likely = |cause: &LinearCause| cause.gain > settings.absorbed_gain;
    let fit = |cause: LinearCause<'a>| {
        let mut eta = from.eta.clone();
        eta.iter_mut().zip(&cause.taken).for_each(|(eta, taken)| *eta -= taken);
        let mut effects = from.effects.clone();
        effects.push(cause.placed);
        problem.fit(jacobian, &eta, &effects, problem.far(ABSORBED))
    };
    let likely: Vec<LinearCause> = causes.into_iter().take(settings.absorbed).filter(likely).collect();
    likely.into_par_iter().map(fit).filter(|fit| fit.cost.is_finite()).collect()
}

/// Returns fits of this model with one more number of the simulation. The fits start at the simulation as given,
/// because the linear parameters of the model may have ended so far from it that no step leads back to a cause. A fit
/// is returned only if it removes most of the residual that the model leaves within the limits, and if its linear
/// parameters have to change less. `informed` are the derivatives by which it is decided which parameters the records
/// determine.
pub fn from_given<'a>(problem: &Problem, model: &Fit<'a>, informed: &Jacobian, scope: &Scope<'_, 'a>) -> Vec<Fit<'a>> {
    let Some(within) = clipped(problem, &model.eta).filter(|_| !problem.few()) else { return Vec::new() };
    let (settings, rows, effects) = (&scope.settings, problem.values(), &model.effects);
    let excess = |residual: &[f64]| sum_of_squares(residual) - rows;
    let plant = problem.nuisance.apply(&problem.plant, &within);
    let most = settings.absorbed_left.powi(2) * excess(&problem.residual(&plant, &within, effects, Fineness::COARSE));
    let eta = vec![0.0; problem.nuisance.len()];
    let jacobian = problem.jacobian(&problem.plant);
    let residual = problem.residual(&problem.plant, &eta, effects, Fineness::COARSE);
    let base = Base {
        problem,
        jacobian: &jacobian,
        plant: &problem.plant,
        eta: &eta,
        effects,
        residual: &residual,
        bold: false,
        sized: false,
    };
    let there = |placed: &Placed| effects.iter().any(|other| same(other, placed)) || !scope.admits(placed);
    let entries = screen(&base, scope.library, |placed| !placed.effect.is_number() || there(placed));
    let likely = entries.into_iter().filter(|entry| entry.gain > settings.absorbed_gain).take(settings.absorbed);
    let fit = |entry: Entry<'a>| {
        problem.fit(&jacobian, &eta, &[&effects[..], &[entry.placed]].concat(), problem.far(ABSORBED))
    };
    let prior = |eta: &[f64]| problem.nuisance.prior_cost(eta, informed, problem.settings.fit.determined);
    let spread = prior(&model.eta) - settings.absorbed_gain;
    let closes = |fit: &Fit| fit.cost.is_finite() && excess(&fit.residual) < most && prior(&fit.eta) < spread;
    likely.collect::<Vec<_>>().into_par_iter().map(fit).filter(closes).collect()
}

/// Returns the numbers of the simulation that account for these changes, the best first.
fn causes<'a>(problem: &Problem, from: &Fit<'a>, jacobian: &Jacobian, scope: &Scope<'_, 'a>) -> Vec<LinearCause<'a>> {
    let Some(known) = Known::new(problem, from, jacobian) else { return Vec::new() };
    let Some(without) = known.best(None) else { return Vec::new() };
    let setting = &problem.setting;
    let plant = problem.nuisance.apply(&problem.plant, &from.eta);
    let now = Before::new(problem, &plant, &from.eta, &from.effects);
    let cause = |mut placed: Placed<'a>, cross: DMatrixView<f64>| {
        let (index, neutral) = placed.effect.amplitude()?;
        let pulls = known.scaled(cross)?;
        let imitation = known.imitation(&pulls)?;
        let with = known.best(Some(&imitation))?;
        let parameter = &mut placed.parameters[index];
        *parameter = neutral + with.size * (*parameter - neutral);
        if placed.effect.parameters(setting)[index].range == Range::Positive && *parameter <= 0.0 {
            return None;
        }
        let taken = (imitation * with.size).component_mul(&known.std).as_slice().to_vec();
        Some(LinearCause { placed, gain: 2.0 * (without.cost - with.cost), taken })
    };
    let at = |effect: &'a dyn Effect| effect.places(setting).into_iter().map(move |place| (effect, place));
    let placed = |(effect, place): (&'a dyn Effect, Place)| {
        let parameters = effect.starts(setting, &place).into_iter().next()?;
        Some(Placed { effect, place, parameters })
    };
    let numbers = scope.library.effects().filter(|effect| effect.is_number()).flat_map(at).filter_map(placed);
    let is_new = |placed: &Placed| !from.effects.iter().any(|other| same(other, placed));
    let all: Vec<Placed> = numbers.filter(|placed| scope.admits(placed) && is_new(placed)).collect();
    let of_chunk = |chunk: &[Placed<'a>]| -> Vec<LinearCause<'a>> {
        let cross = problem.cross_all(jacobian, &now.added(chunk));
        let own = |(j, placed): (usize, &Placed<'a>)| cause(placed.clone(), cross.columns(j, 1));
        chunk.iter().enumerate().filter_map(own).collect()
    };
    let mut causes: Vec<LinearCause> = all.par_chunks(AT_ONCE).flat_map_iter(of_chunk).collect();
    causes.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    causes
}

/// The information of the records on the simulation's linear parameters, in standard deviations of their prior. The
/// other parameters, such as initial states, are eliminated.
struct Known {
    std: DVector<f64>,
    /// H_so H_oo^-1, with the normal matrix H of the simulation's parameters s and of the others o.
    eliminated: DMatrix<f64>,
    /// J'J after the elimination.
    information: DMatrix<f64>,
    /// The pull of the records on the parameters at zero: the right-hand side of the normal equations.
    pull: DVector<f64>,
}

/// The best size of a cause at a factor on the limits.
#[derive(Clone, Copy)]
struct Sized {
    /// Minus the log likelihood, up to a constant.
    cost: f64,
    size: f64,
}

impl Known {
    fn new(problem: &Problem, from: &Fit, jacobian: &Jacobian) -> Option<Self> {
        let (n, all) = (problem.nuisance.of_simulation(), problem.nuisance.len());
        let normal = &jacobian.normal;
        let eta = DVector::from_column_slice(&from.eta);
        let pull = normal * eta + problem.gradient(jacobian, &from.residual, &from.eta).column(0);
        let others = normal.view((n, n), (all - n, all - n)).into_owned();
        let across = normal.view((0, n), (n, all - n)).into_owned();
        let eliminated =
            if all > n { others.cholesky()?.solve(&across.transpose()).transpose() } else { across.clone() };
        let std = DVector::from_column_slice(&problem.nuisance.std[..n]);
        let mut own = normal.view((0, 0), (n, n)) - &eliminated * across.transpose();
        for i in 0..n {
            own[(i, i)] -= std[i].powi(-2);
        }
        let information = DMatrix::from_fn(n, n, |i, j| std[i] * own[(i, j)] * std[j]);
        let mut known = Self { std, eliminated, information, pull: DVector::zeros(n) };
        known.pull = known.scaled(DMatrixView::from_slice(pull.as_slice(), all, 1))?;
        Some(known)
    }

    /// Returns J' v after the elimination, in standard deviations; `None` if it is not finite.
    fn scaled(&self, cross: DMatrixView<f64>) -> Option<DVector<f64>> {
        let (n, all) = (self.std.len(), cross.nrows());
        let own = cross.view((0, 0), (n, 1)) - &self.eliminated * cross.view((n, 0), (all - n, 1));
        let scaled = DVector::from_fn(n, |i, _| self.std[i] * own[(i, 0)]);
        scaled.iter().all(|x| x.is_finite()).then_some(scaled)
    }

    /// Returns the parameters that imitate a cause with these pulls.
    fn imitation(&self, pulls: &DVector<f64>) -> Option<DVector<f64>> {
        let mut information = self.information.clone();
        (0..self.std.len()).for_each(|i| information[(i, i)] += FAINT);
        Some(information.cholesky()?.solve(pulls))
    }

    /// Returns the best size of a cause that `imitation` imitates, at the best factor on the limits.
    fn best(&self, imitation: Option<&DVector<f64>>) -> Option<Sized> {
        let all = FACTORS.iter().filter_map(|&factor| self.at(factor, imitation));
        all.min_by(|a, b| a.cost.total_cmp(&b.cost))
    }

    /// Returns the best size at a factor on the limits, by reweighted least squares and with Laplace's approximation
    /// of the likelihood.
    fn at(&self, factor: f64, imitation: Option<&DVector<f64>>) -> Option<Sized> {
        let n = self.std.len();
        let mut weights = DVector::from_element(n, 1.0);
        let seen = imitation.map(|d| &self.information * d);
        let mut found = None;
        for _ in 0..ROUNDS {
            let mut both = self.information.clone();
            (0..n).for_each(|i| both[(i, i)] += weights[i] / (factor * factor));
            let solved = both.cholesky()?;
            let mut off = solved.solve(&self.pull);
            let mut size = 0.0;
            if let (Some(d), Some(seen)) = (imitation, &seen) {
                let back = solved.solve(seen);
                size = (d.dot(&self.pull) - seen.dot(&off)) / (d.dot(seen) - seen.dot(&back)).max(f64::MIN_POSITIVE);
                off -= back * size;
            }
            let whole = imitation.map_or_else(|| off.clone(), |d| &off + d * size);
            let misfit = 0.5 * whole.dot(&(&self.information * &whole)) - self.pull.dot(&whole);
            let square = |x: f64| (x / factor).powi(2);
            let prior: f64 = off.iter().map(|&x| 0.5 * (TAILS + 1.0) * (square(x) / TAILS).ln_1p()).sum();
            let volume: f64 = (0..n).map(|i| solved.l_dirty()[(i, i)].ln()).sum();
            weights = off.map(|x| (TAILS + 1.0) / (TAILS + square(x)));
            found = Some(Sized { cost: misfit + prior + n as f64 * factor.ln() + volume, size });
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::Library;
    use crate::fit::refit::{Refit, STEPS, refit};
    use crate::prepare::{Known as Stated, prepare};
    use crate::search::rules::Rules;
    use crate::testing;

    /// Returns the problem of a plant whose shapes have errors of up to half a per cent and whose first output is
    /// multiplied by `gain`, with its refit.
    fn refitted(gain: f64) -> (Problem, Refit) {
        let sim = testing::truss(1);
        let real = testing::truss_with(1, |_, input, output| {
            let off = |k: usize| 1.0 + 0.005 * if k.is_multiple_of(3) { 1.0 } else { -0.6 };
            input.iter_mut().enumerate().for_each(|(k, x)| *x *= off(k));
            output.iter_mut().enumerate().for_each(|(k, x)| *x *= off(k + 1));
            output.row_mut(0).scale_mut(gain);
        });
        let case = testing::case(&sim, &real);
        let problem = prepare(case.model.as_ref().unwrap(), &case.records, &Stated::default()).unwrap().problem;
        let refitted = refit(&problem, STEPS);
        (problem, refitted)
    }

    /// Calls a function with the whole vocabulary.
    fn with_all<T>(problem: &Problem, then: impl FnOnce(&Scope) -> T) -> T {
        let library = Library::standard();
        let rules = Rules { suspects: &[], exclude: &[], without: &[] };
        let (settings, names) = (problem.settings.search.clone(), problem.setting.names.clone());
        let scope =
            Scope { library: &library, rules: &rules, settings, names, off: Vec::new(), bold: false, imperfect: true };
        then(&scope)
    }

    /// Returns the first causes (effect, place, value, gain) and the mean square of what the refit leaves.
    fn found(gain: f64) -> (Vec<(&'static str, Place, f64, f64)>, f64) {
        let (problem, refitted) = refitted(gain);
        let told = |cause: &LinearCause| {
            let placed = &cause.placed;
            (placed.effect.name(), placed.place.clone(), placed.parameters[0], cause.gain)
        };
        let first = with_all(&problem, |scope| {
            causes(&problem, &refitted.as_fit(), &refitted.jacobian, scope).iter().take(3).map(told).collect()
        });
        (first, sum_of_squares(&refitted.residual) / problem.rows() as f64)
    }

    /// A gain is found from the simulation as given, and with it the linear parameters hardly change. Nothing is found
    /// if the simulation is within its limits.
    #[test]
    fn a_gain_is_found_from_the_simulation_as_given() {
        for gain in [1.0, 1.4] {
            let (problem, refitted) = refitted(gain);
            let first = with_all(&problem, |scope| {
                let fits = from_given(&problem, &refitted.as_fit(), &refitted.jacobian, scope);
                let first = fits.iter().min_by(|a, b| a.cost.total_cmp(&b.cost));
                first.map(|fit| {
                    let [placed] = fit.effects.as_slice() else { panic!("one effect") };
                    let z = problem.max_prior_z(&fit.eta);
                    (placed.effect.name(), placed.place.clone(), placed.parameters[0], z)
                })
            });
            if gain == 1.0 {
                assert_eq!(first, None);
                continue;
            }
            let (name, place, value, z) = first.unwrap();
            assert_eq!((name, place), ("sensor-gain", Place::Output(0)));
            assert!((value / gain - 1.0).abs() < 0.02, "{value}");
            assert!(z < 0.5 * problem.max_prior_z(&refitted.eta), "{z} of {}", problem.max_prior_z(&refitted.eta));
        }
    }

    /// The refit accounts for the gain with the shapes of all modes and leaves only noise.
    #[test]
    fn a_gain_that_a_refit_has_spread_is_found() {
        let (causes, left) = found(1.3);
        let (name, place, value, gain) = &causes[0];
        println!("{causes:?}, left {left}");
        assert!(left < 1.2, "the refit leaves {left}");
        assert_eq!((*name, place), ("sensor-gain", &Place::Output(0)));
        assert!((value - 1.3).abs() < 0.05 && *gain > 20.0 && causes[1].3 < 0.5 * gain, "{causes:?}");
    }

    /// Many small errors are not a cause.
    #[test]
    fn small_errors_everywhere_are_no_cause() {
        let (causes, _) = found(1.0);
        assert!(causes[0].3 < 10.0, "{causes:?}");
    }
}
