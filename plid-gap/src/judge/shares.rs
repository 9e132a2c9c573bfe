//! The share of the gap that each effect of the best explanation closes while the others are in place.

use crate::fit::candidate::same;
use crate::fit::problem::{Effort, Fit, Placed};
use crate::fit::refit::clipped;
use crate::judge::explained::Explained;
use crate::judge::gap::{self, Blocks};
use crate::judge::shrink::{blocks, floor, opened};
use crate::plant::Plant;
use crate::simulate::Fineness;

/// A fit without one of the effects.
const WITHOUT: Effort = Effort { steps: 4, gain: 1.0, fineness: Fineness::COARSE };

/// The share of an effect on the opened records.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Share {
    /// Share of the squared gap beyond noise and the simulation within its limits.
    pub value: f64,
    /// Interval from draws of blocks of the opened records.
    pub ci95: [f64; 2],
    /// Squared gap that it closes.
    pub closed: f64,
    /// Remaining amplitude with the effect, over that without it, both beyond the noise.
    pub left: f64,
}

/// Returns the share of each effect of the best explanation, in order. `plant` and `actions` are the simulation with
/// all of them; `within` is the simulation without any, within its limits. Without an effect, the others and the linear
/// parameters are fitted again. The linear parameters stay within their limits: a frequency that is off by more is an
/// effect and must not hide another one.
///
/// Two laws at one place may be one law of another shape. Either of them then replaces most of the other, and neither
/// closes much beside it. The one that the search found first explains most alone, and its share is that of both
/// together. A linear one does not lead: what it leaves beside a nonlinear law shows that the law is nonlinear. Of
/// linear ones only, such as a gain and a lag, the one leads that closes most of the gap as given.
pub fn shares(explained: &Explained, with: &Blocks, within: &Plant) -> Vec<Share> {
    let problem = &explained.ready.problem;
    let fit = explained.fit();
    let named = &explained.found.best.effects;
    let opened = opened(explained);
    let floor = floor(explained, &explained.noise_rms());
    let limits = blocks(&opened, within, &[]);
    let jacobian = (named.len() > 1).then(|| problem.jacobian(&problem.nuisance.apply(&problem.plant, &fit.eta)));
    let sibling = explained.free_shape.as_ref().map(|free| (free.which, fit.effects.len() - 1));
    let others = |removed: &[usize]| -> Vec<Placed> {
        let is_removed = |placed: &Placed| removed.iter().any(|&which| same(placed, &named[which]));
        let is_sibling = |at: usize| sibling.is_some_and(|(which, own)| own == at && removed.contains(&which));
        let stays = |(at, placed): &(usize, &Placed)| !is_sibling(*at) && !is_removed(placed);
        fit.effects.iter().enumerate().filter(stays).map(|(_, placed)| placed.clone()).collect()
    };
    let without = |removed: &[usize]| -> Blocks {
        let others = others(removed);
        let Some(jacobian) = jacobian.as_ref().filter(|_| !others.is_empty()) else { return limits.clone() };
        let Fit { eta, mut effects, .. } = problem.fit(jacobian, &fit.eta, &others, WITHOUT);
        effects.extend(explained.offsets.iter().cloned());
        let eta = clipped(problem, &eta).unwrap_or(eta);
        blocks(&opened, &problem.nuisance.apply(&problem.plant, &eta), &problem.actions(&effects))
    };
    let share = |[without, with, limits]: [f64; 3]| {
        let closed = (without * without - with * with).max(0.0);
        let all = (limits * limits - floor * floor).max(closed);
        if all > 0.0 { closed / all } else { 0.0 }
    };
    let of = |removed: &[usize]| {
        let without = without(removed);
        let (missing, rest) = (without.gap(), with.gap());
        let beyond = |gap: f64| (gap * gap - floor * floor).max(0.0);
        Share {
            value: share([missing, rest, limits.gap()]),
            ci95: gap::drawn([&without, with, &limits], share),
            closed: (missing * missing - rest * rest).max(0.0),
            left: (beyond(rest) / beyond(missing).max(f64::MIN_POSITIVE)).sqrt(),
        }
    };
    // The gap that an effect leaves in the simulation as given.
    let alone = |which: usize| blocks(&opened, &problem.plant, &problem.actions(&named[which..=which])).gap();
    let leading = |group: &[usize]| -> usize {
        group.iter().copied().min_by(|&a, &b| alone(a).total_cmp(&alone(b))).expect("a group has members")
    };
    let mut shares: Vec<Share> = (0..named.len()).map(|which| of(&[which])).collect();
    for group in groups(named) {
        let sum: f64 = group.iter().map(|&which| shares[which].closed).sum();
        let together = of(&group);
        if together.closed > problem.settings.judge.replaceable * sum {
            let nonlinear = group.iter().copied().find(|&which| !named[which].effect.is_linear());
            shares[nonlinear.unwrap_or_else(|| leading(&group))] = together;
        }
    }
    shares
}

/// Returns the numbers of the effects of one side of the signal path that are at one place, where there are several.
fn groups(effects: &[Placed]) -> Vec<Vec<usize>> {
    let alike = |a: &Placed, b: &Placed| a.place == b.place && a.effect.side() == b.effect.side();
    let group = |first: usize| -> Vec<usize> {
        (first..effects.len()).filter(|&other| alike(&effects[first], &effects[other])).collect()
    };
    let is_first = |which: &usize| !effects[..*which].iter().any(|other| alike(other, &effects[*which]));
    (0..effects.len()).filter(is_first).map(group).filter(|group| group.len() > 1).collect()
}
