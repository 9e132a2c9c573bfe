//! Is it this place with another shape? Beside each effect of an explanation that does not suffice, its flexible sibling.

use rayon::prelude::*;

use crate::effects::{Effect, Flexible};
use crate::problem::{Effort, Fit, Placed, Problem};
use crate::simulate::Fineness;
use crate::thresholds::{MATERIAL, WORTH};

const QUICK: Effort = Effort { steps: 8, gain: 0.5, fineness: Fineness::COARSE };
const WHOLE: Effort = Effort { steps: 10, gain: 0.5, fineness: Fineness::FINE };

/// A fit with one effect's shape set free.
pub struct Bent<'a> {
    /// The fit; its last effect is the sibling.
    pub fit: Fit<'a>,
    /// Which effect it bends.
    pub which: usize,
}

/// Two effects at one place that one of them with another shape explains as well: the fit of that one, and with its shape set free.
pub fn one_for_two<'a>(problem: &Problem, quick: &Problem, best: &Fit<'a>) -> Option<(Fit<'a>, Bent<'a>)> {
    let shared = |k: usize| {
        let place = &best.effects[k].place;
        best.effects.iter().filter(|other| other.place == *place).count() > 1
    };
    // Derivatives cost seconds, and most explanations share no place.
    if !(0..best.effects.len()).any(shared) {
        return None;
    }
    let tangent = quick.tangent(&quick.nuisance.apply(&quick.plant, &best.eta));
    let whole = problem.tangent(&problem.nuisance.apply(&problem.plant, &best.eta));
    let tried = (0..best.effects.len()).filter(|&k| shared(k)).filter_map(|k| {
        let place = &best.effects[k].place;
        let kept = |j: usize| j == k || best.effects[j].place != *place;
        let effects: Vec<Placed> =
            (0..best.effects.len()).filter(|&j| kept(j)).map(|j| best.effects[j].clone()).collect();
        let alone = quick.fit(&tangent, &best.eta, &effects, QUICK);
        let alone = problem.fit(&whole, &alone.eta, &alone.effects, WHOLE);
        let bent = bent(problem, quick, &alone).filter(|bent| alone.effects[bent.which].place == *place)?;
        (bent.fit.cost < best.cost + MATERIAL * problem.rows() as f64).then_some((alone, bent))
    });
    tried.min_by(|a, b| a.1.fit.cost.total_cmp(&b.1.fit.cost))
}

/// The best of all fits with one sibling each; none where no effect has a shape, or where a free one gains nothing on the heads of
/// the records.
pub fn bent<'a>(problem: &Problem, quick: &Problem, best: &Fit<'a>) -> Option<Bent<'a>> {
    let siblings: Vec<(usize, &'static Flexible)> = best
        .effects
        .iter()
        .enumerate()
        .filter_map(|(which, placed)| Some((which, Flexible::of(placed.effect.name())?)))
        .collect();
    if siblings.is_empty() {
        return None;
    }
    let tangent = quick.tangent(&quick.nuisance.apply(&quick.plant, &best.eta));
    let own = quick.fit(&tangent, &best.eta, &best.effects, QUICK);
    let fits: Vec<Bent> = siblings
        .into_par_iter()
        .map(|(which, sibling)| {
            let place = own.effects[which].place.clone();
            let parameters = sibling.starts(&quick.setting, &place).remove(0);
            let mut effects = own.effects.clone();
            effects.push(Placed { effect: sibling, place, parameters });
            Bent { fit: quick.fit(&tangent, &own.eta, &effects, QUICK), which }
        })
        .collect();
    let top = fits.into_iter().min_by(|a, b| a.fit.cost.total_cmp(&b.fit.cost))?;
    if !(own.cost - top.fit.cost > WORTH) {
        return None;
    }
    let tangent = problem.tangent(&problem.nuisance.apply(&problem.plant, &top.fit.eta));
    let fit = problem.fit(&tangent, &top.fit.eta, &top.fit.effects, WHOLE);
    Some(Bent { fit, which: top.which })
}
