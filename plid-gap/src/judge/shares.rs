//! The share of the gap that each effect of the best explanation closes while the others are in place.

use crate::fit::candidate::same;
use crate::fit::problem::{Effort, Fit, Placed};
use crate::fit::refit::clipped;
use crate::judge::explained::Explained;
use crate::judge::gap::{self, Blocks};
use crate::judge::locate::Estimate;
use crate::judge::shrink::{blocks, floor, opened};
use crate::plant::Plant;
use crate::simulate::Fineness;

/// The effort of a fit without one of the effects.
const WITHOUT: Effort = Effort { steps: 4, gain: 1.0, fineness: Fineness::COARSE };

/// The share of an effect on the opened records.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Share {
    /// Share of the squared gap beyond the noise, relative to the simulation within its limits.
    pub value: f64,
    /// The interval from a bootstrap over blocks of the opened records.
    pub ci95: [f64; 2],
    /// Squared gap that it makes: the one that it closes. In an imperfect simulation, this is at least the smaller of
    /// two squared gaps: the one that it closes by itself in the simulation as given, and the one that opens if it
    /// alone is removed.
    pub made: f64,
    /// Remaining amplitude with the effect, over the amplitude that includes the gap that the effect makes, both
    /// beyond the noise.
    pub left: f64,
}

/// Returns the share of each effect of the best explanation, in order. `with` are the free runs with all of them;
/// `within` is the simulation without effects, within its limits. To remove an effect, the others and the linear
/// parameters are fitted again. The linear parameters stay within their limits: a frequency that is off by more is an
/// effect and must not hide another one.
///
/// If the simulation is imperfect, an effect may make a much larger gap than it closes, because a refit can imitate
/// it: a damping ratio that is off by a quarter, or a joint in records of one level. A small effect that no refit can
/// imitate would then lead. The effects are therefore also compared without any refit: the main cause alone closes most
/// of the gap as given, and its removal alone opens as much of it.
pub fn shares(explained: &Explained, with: &Blocks, within: &Plant) -> Vec<Share> {
    let problem = &explained.ready.problem;
    let fit = explained.fit();
    let named = &explained.found.best.effects;
    let opened = opened(explained);
    let floor = floor(explained, &explained.noise_rms());
    let limits = blocks(&opened, within, &[]);
    let refitted = problem.nuisance.apply(&problem.plant, &fit.eta);
    let jacobian = (named.len() > 1).then(|| problem.jacobian(&refitted));
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
    // Returns the gap that effects leave in the simulation as given.
    let alone = |those: &[usize]| {
        let own: Vec<Placed> = those.iter().map(|&which| named[which].clone()).collect();
        blocks(&opened, &problem.plant, &problem.actions(&own)).gap()
    };
    let given = explained.ready.widened.is_some().then(|| alone(&[]));
    let made = |removed: &[usize], given: f64| {
        let rest = [others(removed), explained.offsets.clone()].concat();
        let opens = blocks(&opened, &refitted, &problem.actions(&rest)).gap().powi(2) - with.gap().powi(2);
        opens.min(given.powi(2) - alone(removed).powi(2))
    };
    let of = |removed: &[usize]| {
        let without = without(removed);
        let (missing, rest) = (without.gap(), with.gap());
        let beyond = |gap: f64| (gap * gap - floor * floor).max(0.0);
        let closed = (missing * missing - rest * rest).max(0.0);
        let made = given.map_or(closed, |given| closed.max(made(removed, given)));
        let Estimate { value, ci95 } = closed_share([&without, with, &limits], floor);
        Share {
            value,
            ci95,
            made,
            left: (beyond(rest) / beyond(missing).max(beyond(rest) + made).max(f64::MIN_POSITIVE)).sqrt(),
        }
    };
    let mut shares: Vec<Share> = (0..named.len()).map(|which| of(&[which])).collect();
    give_to_leaders(&mut shares, named, problem.settings.judge.replaceable, of, |which| alone(&[which]));
    shares
}

/// Returns the share of the squared gap that an effect closes, with its interval from a bootstrap over blocks. The
/// blocks are those of the runs without the effect, with it, and of the simulation within its limits.
pub(crate) fn closed_share(runs: [&Blocks; 3], floor: f64) -> Estimate {
    let share = |[without, with, limits]: [f64; 3]| {
        let closed = (without * without - with * with).max(0.0);
        let all = (limits * limits - floor * floor).max(closed);
        if all > 0.0 { closed / all } else { 0.0 }
    };
    Estimate { value: share(runs.map(Blocks::gap)), ci95: gap::drawn(runs, share) }
}

/// Assigns the joint share of laws at one place that can replace each other to one of them.
///
/// Two laws at one place may represent one law of another shape. Either of them then replaces most of the other, and
/// neither closes much in addition to the other. The law that the search found first explains most alone, and it
/// receives the share of both together. A linear law does not lead: the part that only the nonlinear law closes shows
/// that the law is nonlinear. If all are linear, such as a gain and a lag, the law that closes most of the gap as given
/// leads.
fn give_to_leaders(
    shares: &mut [Share],
    named: &[Placed],
    replaceable: f64,
    together: impl Fn(&[usize]) -> Share,
    alone: impl Fn(usize) -> f64,
) {
    let leading = |group: &[usize]| -> usize {
        group.iter().copied().min_by(|&a, &b| alone(a).total_cmp(&alone(b))).expect("a group has members")
    };
    for group in groups(named) {
        let sum: f64 = group.iter().map(|&which| shares[which].made).sum();
        let together = together(&group);
        if together.made > replaceable * sum {
            let nonlinear = group.iter().copied().find(|&which| !named[which].effect.is_linear());
            shares[nonlinear.unwrap_or_else(|| leading(&group))] = together;
        }
    }
}

/// Returns the indices of effects at one place on one side of the signal path, for each such group with several
/// members.
fn groups(effects: &[Placed]) -> Vec<Vec<usize>> {
    let alike = |a: &Placed, b: &Placed| a.place == b.place && a.effect.side() == b.effect.side();
    let group = |first: usize| -> Vec<usize> {
        (first..effects.len()).filter(|&other| alike(&effects[first], &effects[other])).collect()
    };
    let is_first = |which: &usize| !effects[..*which].iter().any(|other| alike(other, &effects[*which]));
    (0..effects.len()).filter(is_first).map(group).filter(|group| group.len() > 1).collect()
}

#[cfg(test)]
mod tests {
    use crate::case::record::rms;
    use crate::diagnose::diagnose;
    use crate::effects::Library;
    use crate::testing;

    /// A damping ratio that is off by more than its limit comes before a lag of a twentieth of a sample. The damping
    /// ratio closes less beyond the refit than the lag does, because the refit may change the damping ratio, but not
    /// the lag.
    #[test]
    fn a_cause_that_a_refit_imitates_comes_before_a_small_effect() {
        let sim = testing::truss(1);
        let real = testing::truss_with(1, |modes, _, _| modes[1].1 *= 0.5);
        let mut case = testing::case(&sim, &real);
        case.config.nuisance.damping = 0.3;
        let size: Vec<f64> = case.records[1].y.iter().map(rms).collect();
        for record in &mut case.records {
            testing::add_products(&mut record.y, 0.01, &size);
            let y = &mut record.y[1];
            (1..y.len()).rev().for_each(|k| y[k] += 0.05 * (y[k - 1] - y[k]));
        }
        testing::only(&mut case, &["modal-damping", "sensor-delay"]);
        let diagnosis = diagnose(&case, &Library::standard(), &mut |_| {}).unwrap().diagnosis;
        testing::first_is(&diagnosis, "modal-damping", "mode:137.0");
        let [first, further] = diagnosis.effects.as_slice() else { panic!("{}", diagnosis.sentence) };
        assert_eq!(further.effect, "sensor-delay", "{}", diagnosis.sentence);
        assert!(first.share < further.share, "{:?} {:?}", first.share, further.share);
    }
}
