//! The score screen: the part of a bounded refit's residual that each effect would explain, at each location and for
//! each of a few shapes.
//!
//! Each entry takes one run. The change of the simulation by the effect is whitened, and the part that the refit
//! could absorb under its prior is removed (a generalised likelihood ratio). An effect that is linear in a size gets
//! its best size.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use rayon::prelude::*;

use crate::effects::{Action, Effect, Library, Place, Range};
use crate::fit::added::Before;
use crate::fit::problem::{Jacobian, Placed, Problem, dot, sum_of_squares};
use crate::plant::Plant;

/// An entry of the screen: an effect at a location with its best shape.
#[derive(Clone)]
pub struct Entry<'a> {
    /// The effect with its starting values for a fit.
    pub placed: Placed<'a>,
    /// Reduction of the sum of squares.
    pub gain: f64,
    /// Share of the energy of the effect's own trace that a refit absorbs.
    pub absorbed: f64,
    /// Energy (sum of squares) of the remaining trace of the effect, whitened and projected, at its best size.
    pub energy: f64,
    /// The parameters of the run.
    tried: Vec<f64>,
    /// Factor on the trace of the run at the best size.
    size: f64,
}

/// The fit from which the screen starts.
pub struct Base<'p, 'a> {
    /// Records, simulation and noise.
    pub problem: &'p Problem,
    /// Derivatives by the linear parameters.
    pub jacobian: &'p Jacobian,
    /// The linear model.
    pub plant: &'p Plant,
    /// Its linear parameters.
    pub eta: &'p [f64],
    /// Its effects.
    pub effects: &'p [Placed<'a>],
    /// Its whitened residual.
    pub residual: &'p [f64],
    /// Whether effects are tried at several sizes: if a gap is as large as the output, a linear extrapolation of the
    /// size is useless.
    pub bold: bool,
    /// Whether internal forces are tried at several sizes although their traces are scaled: a force that moves a
    /// resonance by more than its width does not change the outputs in proportion.
    pub sized: bool,
}

impl<'p, 'a> Base<'p, 'a> {
    fn before(&self) -> Before<'p, 'a> {
        Before::new(self.problem, self.plant, self.eta, self.effects)
    }
}

/// Returns all entries, the best first: for each effect at each location its best shape.
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
    let now = base.before();
    // At the end of a refit the gradient is zero: an effect may explain the residual, or the change of the linear
    // parameters that imitates the effect.
    let left = factor.solve(&problem.gradient(base.jacobian, base.residual, base.eta));
    let mut entries: Vec<Entry> = pairs
        .par_chunks(PROJECTED_TOGETHER)
        .flat_map_iter(|pairs| {
            let tried: Vec<Vec<Tried>> = pairs.iter().map(|(effect, place)| shapes(base, *effect, place)).collect();
            let traces: Vec<Vec<f64>> =
                tried.iter().flat_map(|tried| now.added(tried.iter().map(|tried| &tried.placed))).collect();
            let mut projected = projected(base, &factor, traces).into_iter();
            let best = |tried: Vec<Tried<'a>>| {
                let own = projected.by_ref().take(tried.len());
                let entries = tried.into_iter().zip(own).filter_map(|(tried, own)| entry(base, own, &left, tried));
                entries.max_by(|a, b| a.gain.total_cmp(&b.gain))
            };
            tried.into_iter().filter_map(best).collect::<Vec<_>>()
        })
        .collect();
    entries.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    entries
}

/// An effect with the parameters of a run.
struct Tried<'a> {
    placed: Placed<'a>,
    /// Whether the trace is scaled to its best size; otherwise the size counts as it is.
    scaled: bool,
}

/// Returns the trials of an effect at a location: each start of its shape, and several sizes of an internal force.
fn shapes<'a>(base: &Base, effect: &'a dyn Effect, place: &Place) -> Vec<Tried<'a>> {
    let setting = &base.problem.setting;
    let mut tried = Vec::new();
    for parameters in effect.starts(setting, place) {
        let placed = Placed { effect, place: place.clone(), parameters };
        tried.extend(sizes(base, &placed));
        tried.push(Tried { placed, scaled: true });
    }
    tried
}

/// Returns further sizes of an internal force, if the base asks for them.
fn sizes<'a>(base: &Base, start: &Placed<'a>) -> Vec<Tried<'a>> {
    let (setting, effect) = (&base.problem.setting, start.effect);
    let Some((index, neutral)) = effect.amplitude().filter(|_| base.bold || base.sized) else { return Vec::new() };
    let port = effect.act(setting, &start.place, &start.parameters).iter().find_map(|action| match action {
        Action::Force(port, _) => Some(*port),
        _ => None,
    });
    // On a single mode, a size counts as it is; elsewhere, the trace at a size is scaled.
    let Some((port, scaled)) = port.and_then(|port| match setting.is_on_a_mode(port) {
        true => base.bold.then_some((port, false)),
        false => base.sized.then_some((port, true)),
    }) else {
        return Vec::new();
    };
    let signs = match effect.parameters(setting)[index].range {
        Range::Positive => &[1.0][..],
        _ => &[1.0, -1.0],
    };
    let with = |by: f64| {
        let mut placed = start.clone();
        placed.parameters[index] = neutral + by * (placed.parameters[index] - neutral);
        Tried { placed, scaled }
    };
    setting.bold_sizes(port).into_iter().flat_map(|by| signs.iter().map(move |sign| with(by * sign))).collect()
}

/// Number of pairs of an effect and a location whose traces are projected together. The derivatives by the linear
/// parameters are not kept but computed anew for each product, whatever its number of columns.
const PROJECTED_TOGETHER: usize = 4;

/// The projection r - J (J'J + prior)^{-1} J' r of a trace r. The projection enters only products, so J'r suffices.
struct Projected {
    /// r.
    trace: Vec<f64>,
    /// J' r.
    cross: DVector<f64>,
    /// (J'J + prior)^{-1} J' r.
    solved: DVector<f64>,
}

fn projected(base: &Base, factor: &Cholesky<f64, Dyn>, traces: Vec<Vec<f64>>) -> Vec<Projected> {
    let cross = base.problem.cross_all(base.jacobian, &traces);
    let solved = factor.solve(&cross);
    let column = |(j, trace)| {
        let (cross, solved) = (cross.column(j).into_owned(), solved.column(j).into_owned());
        Projected { trace, cross, solved }
    };
    traces.into_iter().enumerate().map(column).collect()
}

/// Returns an entry from the change of the whitened outputs in a trial.
fn entry<'a>(
    base: &Base<'_, 'a>,
    own: Projected,
    left: &DMatrix<f64>,
    Tried { mut placed, scaled }: Tried<'a>,
) -> Option<Entry<'a>> {
    let (tried, trace) = (placed.parameters.clone(), own.trace);
    let whole = sum_of_squares(&trace);
    if !(whole.is_finite() && whole > 0.0) {
        return None;
    }
    let clear = whole - own.cross.dot(&own.solved);
    let absorbed = 1.0 - clear / whole;
    // Derivatives predict the part that a refit absorbs, but not for a resonance that has moved by more than its
    // width.
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
        // Over a moderate range of sizes, the trace of a nonlinear effect is also nearly proportional to its size, so
        // a start that is several times too strong does not hide the effect.
        None if scaled => {
            let search = &base.problem.settings.search;
            let size = (product / energy.max(1e-12 * whole)).clamp(search.least_size, search.most_size);
            (size * (2.0 * product - size * energy), size * size * energy, size)
        }
        None => (2.0 * product - energy, energy, 1.0),
    };
    gain.is_finite().then_some(Entry { placed, gain, absorbed, energy, tried, size })
}

/// Returns the change of the whitened outputs by each entry at its best size, scaled from its run.
pub fn traces(base: &Base, entries: &[Entry]) -> Vec<Vec<f64>> {
    let now = base.before();
    let trace = |entry: &Entry| -> Vec<f64> {
        let placed = Placed { parameters: entry.tried.clone(), ..entry.placed.clone() };
        let trace = now.added([&placed]).swap_remove(0);
        trace.into_iter().map(|x| entry.size * x).collect()
    };
    entries.par_iter().map(trace).collect()
}
