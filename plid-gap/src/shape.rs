//! Is it this place with another shape? Beside each effect of an explanation that does not suffice, its flexible sibling.

use rayon::prelude::*;

use crate::effects::Flexible;
use crate::problem::{Effort, Fit, Placed, Problem};
use crate::simulate::Fineness;

static SIBLINGS: [Flexible; 8] = [
    Flexible::Stiffness,
    Flexible::Damping,
    Flexible::Joint,
    Flexible::Command,
    Flexible::Hysteresis,
    Flexible::Path,
    Flexible::Sensor,
    Flexible::SensorPath,
];

const QUICK: Effort = Effort { steps: 8, gain: 0.5, fineness: Fineness::COARSE };
const WHOLE: Effort = Effort { steps: 4, gain: 0.5, fineness: Fineness::FINE };

/// A fit with one effect's shape set free.
pub struct Bent<'a> {
    /// The fit; its last effect is the sibling.
    pub fit: Fit<'a>,
    /// Which effect it bends.
    pub which: usize,
}

/// The best of all fits with one sibling each, or none where no effect has a shape.
pub fn bent<'a>(problem: &Problem, quick: &Problem, best: &Fit<'a>) -> Option<Bent<'a>> {
    let fits: Vec<Bent> = best
        .effects
        .par_iter()
        .enumerate()
        .filter_map(|(which, placed)| {
            let kind = Flexible::of(placed.effect.name())?;
            let sibling = SIBLINGS.iter().find(|sibling| **sibling == kind)?;
            let start = crate::effects::Effect::starts(sibling, &problem.setting, &placed.place).pop()?;
            let mut effects = best.effects.clone();
            effects.push(Placed { effect: sibling, place: placed.place.clone(), parameters: start });
            let tangent = quick.tangent(&quick.nuisance.apply(&quick.plant, &best.eta));
            let fit = quick.fit(&tangent, &best.eta, &effects, QUICK);
            Some(Bent { fit, which })
        })
        .collect();
    let best = fits.into_iter().min_by(|a, b| a.fit.cost.total_cmp(&b.fit.cost))?;
    let tangent = problem.tangent(&problem.nuisance.apply(&problem.plant, &best.fit.eta));
    let fit = problem.fit(&tangent, &best.fit.eta, &best.fit.effects, WHOLE);
    Some(Bent { fit, which: best.which })
}
