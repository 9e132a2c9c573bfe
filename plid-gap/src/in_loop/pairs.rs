//! Pairs of effects that explain the gap together.
//!
//! The effect that explains most on its own need not be one of the two that are present: it may imitate a part of
//! each. The first screen gives a trace of each effect. From the traces it follows, without a run, how much of the
//! gap any two effects explain together. The best pairs are then run and fitted.

use std::collections::HashSet;

use crate::fit::candidate::same;
use crate::fit::problem::{Placed, dot};
use crate::in_loop::problem::{Fit, Problem};
use crate::in_loop::runs::Runs;
use crate::in_loop::screen::{Entry, STRETCHED, is_positive};
use crate::in_loop::search::{Found, Search};

/// Two entries of a screen.
struct Pair {
    /// Their indices.
    of: [usize; 2],
    /// The factors on their traces that together explain most of the gap.
    factors: [f64; 2],
    /// Expected decrease of the sum of squares, less the price of the parameters.
    gain: f64,
}

/// Pairs of effects, the best of which explains most of the gap.
pub(super) struct Paired<'a> {
    /// The effects of each pair, the best first.
    pub pairs: Vec<Vec<Placed<'a>>>,
    /// The effect of the best pair that explains more on its own.
    pub stronger: Placed<'a>,
    /// The entries of the first screen that form a pair with the stronger effect, the best first.
    pub entries: Vec<Entry<'a>>,
}

impl<'a> Search<'_, 'a> {
    /// Returns the best pairs of effects of the first screen, or `None` if even the best one leaves a doubtful gap on
    /// the first samples of the record of that screen.
    pub(super) fn paired(
        &self,
        problem: &Problem<'a>,
        runs: &mut Runs,
        found: &Found<'a>,
        say: &mut dyn FnMut(String),
    ) -> Option<Paired<'a>> {
        let (record, samples) = found.first_head?;
        let entries = found.screens.first()?;
        let quick = problem.head(record, samples);
        let start = quick.on_head(&found.refit, record);
        let pairs = pairs(&quick, &start, entries);
        say(format!("trying {} pairs of effects", pairs.len().min(self.settings.stepped)));
        let mut sized: Vec<Fit> = Vec::new();
        for pair in pairs.iter().take(self.settings.stepped) {
            sized.extend(self.sized_pair(&quick, runs, &start.eta, entries, pair));
        }
        self.best_first(&quick, &mut sized);
        sized.truncate(self.settings.fitted);
        let fit = |fit| quick.fit(runs, fit, self.settings.quick_steps, self.gain(&quick));
        let mut fits: Vec<Fit> = sized.into_iter().map(fit).collect();
        self.best_first(&quick, &mut fits);
        fits.iter()
            .for_each(|fit| say(format!("tried {}, {} runs so far", self.words(&quick, fit), runs.calls().runs)));
        fits.retain(|fit| self.is_sound(&quick, fit));
        let best = fits.first().filter(|best| self.left(&quick, best) < self.doubtful(problem, found))?;
        let mut alone = |k: usize| {
            let fit = self.begun(&quick, runs, vec![best.effects[k].clone()], &best.eta);
            fit.map_or(f64::INFINITY, |fit| fit.cost)
        };
        let stronger = best.effects[usize::from(alone(1) < alone(0))].clone();
        let entries = pairs.iter().filter_map(|pair| pair.beside(&stronger, entries)).collect();
        Some(Paired { pairs: fits.into_iter().map(|fit| fit.effects).collect(), stronger, entries })
    }

    /// Runs a pair at three sizes and returns the best explanation.
    fn sized_pair(
        &self,
        quick: &Problem<'a>,
        runs: &mut Runs,
        eta: &[f64],
        entries: &[Entry<'a>],
        pair: &Pair,
    ) -> Option<Fit<'a>> {
        let sizes = [0, 1].map(|k| Entry { factor: pair.factors[k], ..entries[pair.of[k]].clone() }.sizes(quick));
        let at = |size: usize| {
            let placed = sizes.iter().map(|sizes| sizes[size.min(sizes.len() - 1)].clone());
            (placed.collect(), eta.to_vec())
        };
        let all: Vec<(Vec<Placed>, Vec<f64>)> = (0..sizes[0].len().max(sizes[1].len())).map(at).collect();
        self.best_of(quick, runs, all)
    }
}

impl Pair {
    /// Returns the other entry of the pair, if the pair contains this effect at its location.
    fn beside<'a>(&self, effect: &Placed, entries: &[Entry<'a>]) -> Option<Entry<'a>> {
        let at = self.of.iter().position(|k| same(&entries[*k].placed, effect))?;
        Some(Entry { gain: self.gain, factor: self.factors[1 - at], ..entries[self.of[1 - at]].clone() })
    }
}

/// Returns all pairs of entries, those that explain most of the residual first. Each pair of effects at their places
/// occurs only once.
fn pairs(quick: &Problem, start: &Fit, entries: &[Entry]) -> Vec<Pair> {
    let residual = quick.beyond_limits(&start.residual[..quick.rows()]);
    let traces: Vec<Vec<f64>> = entries.iter().map(|entry| quick.beyond_limits(&quick.whiten(&entry.change))).collect();
    let bounds: Vec<[f64; 2]> = entries.iter().map(|entry| bounds(entry, quick)).collect();
    let right: Vec<f64> = traces.iter().map(|trace| dot(&residual, trace)).collect();
    let square: Vec<f64> = traces.iter().map(|trace| dot(trace, trace)).collect();
    let price = (quick.rows() as f64).ln();
    let mut all = Vec::new();
    for i in 0..entries.len() {
        for j in 0..i {
            if same(&entries[i].placed, &entries[j].placed) {
                continue;
            }
            let product = dot(&traces[i], &traces[j]);
            let (factors, gain) =
                together([square[i], square[j]], product, [right[i], right[j]], [bounds[i], bounds[j]]);
            let parameters = entries[i].placed.parameters.len() + entries[j].placed.parameters.len();
            all.push(Pair { of: [i, j], factors, gain: gain - price * parameters as f64 });
        }
    }
    all.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    // The first entry of each effect at its place represents all of its starting values.
    let first = |k: usize| entries.iter().position(|other| same(&other.placed, &entries[k].placed));
    let firsts: Vec<Option<usize>> = (0..entries.len()).map(first).collect();
    let mut seen = HashSet::new();
    all.retain(|pair| {
        let [i, j] = pair.of.map(|k| firsts[k]);
        seen.insert([i.min(j), i.max(j)])
    });
    all
}

/// Returns the range of the factor on an entry's trace.
fn bounds(entry: &Entry, quick: &Problem) -> [f64; 2] {
    if entry.placed.effect.amplitude().is_none() {
        STRETCHED
    } else if is_positive(&entry.placed, quick) {
        [0.0, f64::INFINITY]
    } else {
        [f64::NEG_INFINITY, f64::INFINITY]
    }
}

/// Returns the factors on two traces within their bounds that explain most of a residual, and the decrease of its sum
/// of squares. `square` contains the squared norms of the traces, `product` their inner product, and `right` their
/// inner products with the residual.
fn together(square: [f64; 2], product: f64, right: [f64; 2], bounds: [[f64; 2]; 2]) -> ([f64; 2], f64) {
    let gain = |x: [f64; 2]| {
        let quadratic = square[0] * x[0] * x[0] + square[1] * x[1] * x[1] + 2.0 * product * x[0] * x[1];
        2.0 * (right[0] * x[0] + right[1] * x[1]) - quadratic
    };
    let determinant = square[0] * square[1] - product * product;
    let free = [
        (right[0] * square[1] - right[1] * product) / determinant,
        (right[1] * square[0] - right[0] * product) / determinant,
    ];
    let inside = |k: usize| free[k].is_finite() && (bounds[k][0]..=bounds[k][1]).contains(&free[k]);
    if inside(0) && inside(1) {
        return (free, gain(free));
    }
    // The gain is concave, so the best point otherwise lies on an edge.
    let mut best = ([0.0; 2], f64::NEG_INFINITY);
    for fixed in 0..2 {
        for bound in bounds[fixed].into_iter().filter(|bound| bound.is_finite()) {
            let other = 1 - fixed;
            let mut x = [bound; 2];
            x[other] = ((right[other] - product * bound) / square[other]).clamp(bounds[other][0], bounds[other][1]);
            if gain(x) > best.1 {
                best = (x, gain(x));
            }
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A grid of factors contains no better point, whether or not the bounds are active.
    #[test]
    fn two_traces_explain_most_at_the_best_point_within_the_bounds() {
        let free = [f64::NEG_INFINITY, f64::INFINITY];
        let none = [0.0, f64::INFINITY];
        let stretched = STRETCHED;
        for bounds in [[free, free], [none, free], [none, none], [none, stretched], [stretched, stretched]] {
            for right in [[3.0, 1.0], [-2.0, 4.0], [1.0, -1.0], [-1.0, -2.0], [9.0, 30.0]] {
                let (square, product) = ([2.0, 5.0], 2.5);
                let gain = |x: [f64; 2]| {
                    2.0 * (right[0] * x[0] + right[1] * x[1])
                        - (square[0] * x[0] * x[0] + 2.0 * product * x[0] * x[1] + square[1] * x[1] * x[1])
                };
                let (at, found) = together(square, product, right, bounds);
                assert!(
                    (gain(at) - found).abs() < 1e-12 && (0..2).all(|k| at[k] >= bounds[k][0] && at[k] <= bounds[k][1])
                );
                for step in 0..=400 {
                    for other in 0..=400 {
                        let x = [step, other].map(|step| f64::from(step) * 0.1 - 20.0);
                        let within = (0..2).all(|k| x[k] >= bounds[k][0] && x[k] <= bounds[k][1]);
                        assert!(!within || gain(x) <= found + 1e-9, "{bounds:?} {right:?}: {x:?} beats {at:?}");
                    }
                }
            }
        }
    }

    /// Two identical traces explain no more than one of them.
    #[test]
    fn traces_that_are_the_same_are_no_pair() {
        let free = [f64::NEG_INFINITY, f64::INFINITY];
        let none = [0.0, f64::INFINITY];
        assert_eq!(together([2.0, 2.0], 2.0, [3.0, 3.0], [none, none]).1, 4.5);
        // Without a bound, there is no unique best point.
        assert_eq!(together([2.0, 2.0], 2.0, [3.0, 3.0], [free, free]).1, f64::NEG_INFINITY);
    }
}
