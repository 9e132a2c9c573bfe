//! Free shapes: if an explanation does not suffice, each of its effects is fitted with its free shape, to check
//! whether the location is right.

use rayon::prelude::*;

use crate::effects::{Effect, Flexible, Place};
use crate::fit::problem::{Effort, Fit, Jacobian, Placed, Problem};
use crate::simulate::Fineness;

const QUICK: Effort = Effort { steps: 8, gain: 0.5, fineness: Fineness::COARSE };
const WHOLE: Effort = Effort { steps: 10, gain: 0.5, fineness: Fineness::FINE };

/// A fit in which the shape of one effect is free.
pub struct FreeShapeFit<'a> {
    /// The fit; its last effect is the free shape.
    pub fit: Fit<'a>,
    /// The number of the effect that has the shape.
    pub which: usize,
}

/// Returns an explanation with fewer effects, one of them with a free shape, that explains as much as all of them.
/// Two effects at one location may be one effect with another shape, and an effect may only compensate for a law that
/// does not quite fit. The result is the fit of the fewer effects and the fit with the free shape.
pub fn fewer<'a>(problem: &Problem, quick: &Problem, best: &Fit<'a>) -> Option<(Fit<'a>, FreeShapeFit<'a>)> {
    if best.effects.len() < 2 {
        return None;
    }
    let jacobian = quick.jacobian(&quick.nuisance.apply(&quick.plant, &best.eta));
    let own = quick.fit(&jacobian, &best.eta, &best.effects, QUICK);
    let slack = |problem: &Problem| problem.settings.search.material_power * problem.values();
    let fits = subsets(&best.effects).into_iter().filter_map(|effects| {
        let alone = quick.fit(&jacobian, &best.eta, &effects, QUICK);
        let free = freed(quick, &jacobian, &alone)?;
        // The first samples distinguish the explanations less well than whole records do.
        if free.fit.cost > own.cost + slack(problem) {
            return None;
        }
        let whole = problem.jacobian(&problem.nuisance.apply(&problem.plant, &best.eta));
        let alone = problem.fit(&whole, &alone.eta, &alone.effects, WHOLE);
        let free = on_whole(problem, free);
        (free.fit.cost < best.cost + slack(problem)).then_some((alone, free))
    });
    let fewest = |(alone, free): &(Fit, FreeShapeFit)| (alone.effects.len(), free.fit.cost);
    fits.min_by(|a, b| {
        let (a, b) = (fewest(a), fewest(b));
        a.0.cmp(&b.0).then(a.1.total_cmp(&b.1))
    })
}

/// Returns the explanations without one of the effects, or without all but one at a location.
fn subsets<'a>(effects: &[Placed<'a>]) -> Vec<Vec<Placed<'a>>> {
    let without = |left: &dyn Fn(usize) -> bool| {
        (0..effects.len()).filter(|&j| left(j)).map(|j| effects[j].clone()).collect::<Vec<Placed>>()
    };
    let mut all: Vec<Vec<Placed>> = (0..effects.len()).map(|k| without(&|j| j != k)).collect();
    for k in 0..effects.len() {
        let left = without(&|j| j == k || effects[j].place != effects[k].place);
        if left.len() + 1 < effects.len() {
            all.push(left);
        }
    }
    all
}

/// Returns the best of all fits with one free shape each, together with its effect or in its place; `None` if no
/// effect has a free shape, or if none gains enough on the first samples.
pub fn free_shape<'a>(problem: &Problem, quick: &Problem, best: &Fit<'a>) -> Option<FreeShapeFit<'a>> {
    // The derivatives take seconds to compute.
    if siblings(&best.effects).is_empty() {
        return None;
    }
    let jacobian = quick.jacobian(&quick.nuisance.apply(&quick.plant, &best.eta));
    let own = quick.fit(&jacobian, &best.eta, &best.effects, QUICK);
    Some(on_whole(problem, freed(quick, &jacobian, &own)?))
}

/// Returns the same explanation with another law for the free shape: its fit, and its fit with a free shape.
pub fn renamed<'a>(
    problem: &Problem,
    quick: &Problem,
    best: &Fit<'a>,
    present: &FreeShapeFit<'a>,
    law: Placed<'a>,
) -> Option<(Fit<'a>, FreeShapeFit<'a>)> {
    let mut effects = best.effects.clone();
    effects[present.which] = law;
    let jacobian = quick.jacobian(&quick.nuisance.apply(&quick.plant, &best.eta));
    let alone = quick.fit(&jacobian, &best.eta, &effects, QUICK);
    let free = freed(quick, &jacobian, &alone).filter(|free| free.which == present.which)?;
    let whole = problem.jacobian(&problem.nuisance.apply(&problem.plant, &best.eta));
    let alone = problem.fit(&whole, &alone.eta, &alone.effects, WHOLE);
    let free = on_whole(problem, free);
    (free.fit.cost < present.fit.cost + problem.settings.search.material_power * problem.values())
        .then_some((alone, free))
}

fn on_whole<'a>(problem: &Problem, free: FreeShapeFit<'a>) -> FreeShapeFit<'a> {
    let jacobian = problem.jacobian(&problem.nuisance.apply(&problem.plant, &free.fit.eta));
    FreeShapeFit { fit: problem.fit(&jacobian, &free.fit.eta, &free.fit.effects, WHOLE), ..free }
}

/// Returns, for each effect with a free shape, its number, the free shape, and whether this shape replaces the
/// effect.
fn siblings(effects: &[Placed]) -> Vec<(usize, &'static Flexible, bool)> {
    // Inside a loop, the path of the command has no free shape.
    let outside = |(_, placed): &(usize, &Placed)| !matches!(placed.place, Place::Loop(_));
    let shaped = effects.iter().enumerate().filter(outside).filter_map(|(k, e)| Some((k, e.effect.free_shape()?)));
    shaped
        .flat_map(|(which, sibling)| {
            let alone = sibling.stands_alone().then_some((which, sibling, true));
            [Some((which, sibling, false)), alone].into_iter().flatten()
        })
        .collect()
}

/// Returns the best fit with a free shape on the first samples, if it gains enough.
fn freed<'a>(quick: &Problem, jacobian: &Jacobian, own: &Fit<'a>) -> Option<FreeShapeFit<'a>> {
    let fits: Vec<FreeShapeFit> = siblings(&own.effects)
        .into_par_iter()
        .map(|(which, sibling, alone)| {
            let place = own.effects[which].place.clone();
            let parameters = sibling.starts(&quick.setting, &place).remove(0);
            let mut effects = own.effects.clone();
            if alone {
                effects.remove(which);
            }
            effects.push(Placed { effect: sibling, place, parameters });
            FreeShapeFit { fit: quick.fit(jacobian, &own.eta, &effects, QUICK), which }
        })
        .collect();
    let top = fits.into_iter().min_by(|a, b| a.fit.cost.total_cmp(&b.fit.cost))?;
    (own.cost - top.fit.cost > quick.settings.search.shape_gain).then_some(top)
}
