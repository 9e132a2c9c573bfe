//! The score screen: how much would each effect, at each place and for each of a few shapes, explain of what a bounded refit leaves?
//!
//! One run an entry: the difference that the effect makes to the simulation, whitened, with what the refit could absorb projected
//! out under its prior (a generalised likelihood ratio). Effects that are linear in a size are given the best size.

use nalgebra::{Cholesky, DMatrix, Dyn};
use rayon::prelude::*;

use crate::effects::{Effect, Library, Place, Range};
use crate::fit::problem::{Placed, Problem, Jacobian, dot, sum_of_squares};
use crate::plant::Plant;
use crate::simulate::Fineness;

/// An entry of the screen: an effect at a place with the shape that does best.
#[derive(Clone)]
pub struct Entry<'a> {
    /// With the start for a fit.
    pub placed: Placed<'a>,
    /// By how much the sum of squares would fall.
    pub gain: f64,
    /// Share of the effect's own trace that a refit absorbs.
    pub absorbed: f64,
    /// What is left of the effect's trace, whitened and projected, at the best size: its energy.
    pub energy: f64,
    /// The parameters with which it was simulated.
    tried: Vec<f64>,
    /// By how much that trace is multiplied at the best size.
    size: f64,
}

/// What the screen starts from: a fit so far.
pub struct Base<'p, 'a> {
    /// Records, simulation, noise.
    pub problem: &'p Problem,
    /// Derivatives of the linear parameters.
    pub jacobian: &'p Jacobian,
    /// The linear model.
    pub plant: &'p Plant,
    /// Its parameters.
    pub eta: &'p [f64],
    /// Effects that are in it already.
    pub effects: &'p [Placed<'a>],
    /// What it leaves.
    pub residual: &'p [f64],
    /// Whether effects are tried at several sizes: where a gap is as large as the output, a linear guess of the size is none.
    pub bold: bool,
}

/// All entries, best first: of each effect at each place the best shape.
pub fn screen<'a>(base: &Base<'_, 'a>, library: &'a Library, skip: impl Fn(&Placed) -> bool + Sync) -> Vec<Entry<'a>> {
    let problem = base.problem;
    let Some(factor) = base.jacobian.normal.clone().cholesky() else { return Vec::new() };
    let setting = &problem.setting;
    let pairs: Vec<(&dyn Effect, _)> = library
        .effects()
        .flat_map(|effect| effect.places(setting).into_iter().map(move |place| (effect, place)))
        .filter(|(effect, place)| {
            let placed = Placed { effect: *effect, place: place.clone(), parameters: Vec::new() };
            !skip(&placed)
        })
        .collect();
    // As the runs make it, so that what a coarse run does differently cancels.
    let now = problem.residual(base.plant, base.eta, base.effects, Fineness::COARSE);
    // At a refit's end that is nothing: what an effect explains there may be the residual, or what linear parameters were bent for.
    let left = factor.solve(&problem.gradient(base.jacobian, base.residual, base.eta));
    let mut entries: Vec<Entry> = pairs
        .par_iter()
        .filter_map(|(effect, place)| {
            let starts = effect.starts(setting, place);
            let tried = starts.into_iter().filter_map(|start| {
                let placed = Placed { effect: *effect, place: place.clone(), parameters: start };
                let linear = entry(base, &factor, &now, &left, placed.clone(), true);
                let &Place::Port(port) = place else { return linear };
                let bold = base.bold && setting.is_on_a_mode(port);
                let (true, Some((index, neutral))) = (bold, effect.amplitude()) else { return linear };
                let signs = match effect.parameters(setting)[index].range {
                    Range::Positive => &[1.0][..],
                    _ => &[1.0, -1.0],
                };
                let bolder = setting.bold_sizes(port).into_iter().flat_map(|by| signs.iter().map(move |s| by * s));
                let tried = bolder.filter_map(|by| {
                    let mut placed = placed.clone();
                    placed.parameters[index] = neutral + by * (placed.parameters[index] - neutral);
                    entry(base, &factor, &now, &left, placed, false)
                });
                tried.chain(linear).max_by(|a, b| a.gain.total_cmp(&b.gain))
            });
            tried.max_by(|a, b| a.gain.total_cmp(&b.gain))
        })
        .collect();
    entries.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    entries
}

/// r - J (J'J + prior)^{-1} J' r enters all sums of products: only J'r is needed.
struct Projected {
    /// J' r.
    cross: DMatrix<f64>,
    /// (J'J + prior)^{-1} J' r.
    solved: DMatrix<f64>,
}

fn projected(jacobian: &Jacobian, factor: &Cholesky<f64, Dyn>, v: &[f64]) -> Projected {
    let cross = jacobian.cross(v, 1);
    let solved = factor.solve(&cross);
    Projected { cross, solved }
}

/// `scaled`: with the size that is best if the trace is proportional to it; otherwise with the size as it is.
fn entry<'a>(
    base: &Base<'_, 'a>,
    factor: &Cholesky<f64, Dyn>,
    now: &[f64],
    left: &DMatrix<f64>,
    mut placed: Placed<'a>,
    scaled: bool,
) -> Option<Entry<'a>> {
    let trace = added(base, now, &placed);
    let tried = placed.parameters.clone();
    let whole = sum_of_squares(&trace);
    if !(whole.is_finite() && whole > 0.0) {
        return None;
    }
    let own = projected(base.jacobian, factor, &trace);
    let clear = whole - own.cross.dot(&own.solved);
    let absorbed = 1.0 - clear / whole;
    // What a refit absorbs is told by derivatives, which say nothing of a resonance that has gone further than its width.
    let (energy, product) = if base.bold {
        (whole, dot(&trace, base.residual))
    } else {
        (clear, dot(&trace, base.residual) - own.cross.dot(left))
    };
    let (gain, energy, size) = match placed.effect.amplitude().filter(|_| scaled) {
        Some((index, neutral)) => {
            let size = product / energy.max(1e-12 * whole);
            let positive = placed.effect.parameters(&base.problem.setting)[index].range == Range::Positive;
            if positive && !(size > 0.0) {
                return None;
            }
            let parameter = &mut placed.parameters[index];
            *parameter = neutral + size * (*parameter - neutral);
            (size * product, size * size * energy, size)
        }
        // Along a bend of its own the trace grows nearly in proportion too: a start that is some times too strong must not hide it.
        None if scaled => {
            let search = &base.problem.settings.search;
            let size = (product / energy.max(1e-12 * whole)).clamp(search.least_size, search.most_size);
            (size * (2.0 * product - size * energy), size * size * energy, size)
        }
        None => (2.0 * product - energy, energy, 1.0),
    };
    gain.is_finite().then_some(Entry { placed, gain, absorbed, energy, tried, size })
}

/// What each entry adds to the whitened outputs at its best size, in proportion to what it was simulated with.
pub fn traces(base: &Base, entries: &[Entry]) -> Vec<Vec<f64>> {
    let now = base.problem.residual(base.plant, base.eta, base.effects, Fineness::COARSE);
    let trace = |entry: &Entry| -> Vec<f64> {
        let tried = Placed { parameters: entry.tried.clone(), ..entry.placed.clone() };
        added(base, &now, &tried).into_iter().map(|x| entry.size * x).collect()
    };
    entries.par_iter().map(trace).collect()
}

/// What an effect adds to the whitened outputs, whose residual is `now` without it.
fn added(base: &Base, now: &[f64], placed: &Placed) -> Vec<f64> {
    let mut effects = base.effects.to_vec();
    effects.push(placed.clone());
    let with = base.problem.residual(base.plant, base.eta, &effects, Fineness::COARSE);
    now.iter().zip(&with).map(|(a, b)| a - b).collect()
}
