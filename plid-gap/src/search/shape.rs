//! Is it this place with another shape? Each effect of an explanation that does not suffice is fitted with its flexible sibling.

use rayon::prelude::*;

use crate::effects::{Effect, Flexible};
use crate::fit::problem::{Effort, Fit, Placed, Problem, Jacobian};
use crate::simulate::Fineness;

const QUICK: Effort = Effort { steps: 8, gain: 0.5, fineness: Fineness::COARSE };
const WHOLE: Effort = Effort { steps: 10, gain: 0.5, fineness: Fineness::FINE };

/// A fit with one effect's shape set free.
pub struct FreeShapeFit<'a> {
    /// The fit; its last effect is the sibling.
    pub fit: Fit<'a>,
    /// Which effect of the explanation has the shape.
    pub which: usize,
}

/// Several effects of which fewer, one of them with another shape, explain as much: two at one place may be one with another shape, and what was put beside
/// a law that does not quite fit may be there for its sake. The fit of the fewer, and with the shape set free.
pub fn fewer<'a>(problem: &Problem, quick: &Problem, best: &Fit<'a>) -> Option<(Fit<'a>, FreeShapeFit<'a>)> {
    if best.effects.len() < 2 {
        return None;
    }
    let jacobian = quick.jacobian(&quick.nuisance.apply(&quick.plant, &best.eta));
    let own = quick.fit(&jacobian, &best.eta, &best.effects, QUICK);
    let slack = |problem: &Problem| problem.settings.search.material_power * problem.rows() as f64;
    let fits = subsets(&best.effects).into_iter().filter_map(|effects| {
        let alone = quick.fit(&jacobian, &best.eta, &effects, QUICK);
        let free = freed(quick, &jacobian, &alone)?;
        // On the heads there is less to tell them apart by.
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

/// Explanations without one of the effects, or without all at a place but one.
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

/// The best of all fits with one sibling each, beside its effect or in its place; none where no effect has a shape, or where a free one gains nothing on the
/// heads of the records.
pub fn free_shape<'a>(problem: &Problem, quick: &Problem, best: &Fit<'a>) -> Option<FreeShapeFit<'a>> {
    // Derivatives cost seconds.
    if siblings(&best.effects).is_empty() {
        return None;
    }
    let jacobian = quick.jacobian(&quick.nuisance.apply(&quick.plant, &best.eta));
    let own = quick.fit(&jacobian, &best.eta, &best.effects, QUICK);
    Some(on_whole(problem, freed(quick, &jacobian, &own)?))
}

/// The same explanation with another law in place of the one whose shape is free: its fit, and its fit with a free shape.
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
    (free.fit.cost < present.fit.cost + problem.settings.search.material_power * problem.rows() as f64)
        .then_some((alone, free))
}

fn on_whole<'a>(problem: &Problem, free: FreeShapeFit<'a>) -> FreeShapeFit<'a> {
    let jacobian = problem.jacobian(&problem.nuisance.apply(&problem.plant, &free.fit.eta));
    FreeShapeFit { fit: problem.fit(&jacobian, &free.fit.eta, &free.fit.effects, WHOLE), ..free }
}

/// Of each effect that has one: its number, the sibling, and whether that takes its place.
fn siblings(effects: &[Placed]) -> Vec<(usize, &'static Flexible, bool)> {
    let shaped = effects.iter().enumerate().filter_map(|(k, e)| Some((k, e.effect.free_shape()?)));
    shaped
        .flat_map(|(which, sibling)| {
            let alone = sibling.stands_alone().then_some((which, sibling, true));
            [Some((which, sibling, false)), alone].into_iter().flatten()
        })
        .collect()
}

/// The best on the heads of the records.
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
