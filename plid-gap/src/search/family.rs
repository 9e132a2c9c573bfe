//! Families of laws. If no law of the vocabulary follows the records, one of them may still act with a shape of its
//! own. A free shape at each place then tells which family acts and where; its name is that of the family's nearest
//! law.

use rayon::prelude::*;

use crate::effects::{Effect, Flexible};
use crate::fit::problem::{Effort, Fit, Jacobian, Placed, Problem};
use crate::search::closest_law::closest_law;
use crate::search::rules::Scope;
use crate::search::shape::FreeShapeFit;
use crate::search::stepwise::polish;
use crate::simulate::Fineness;

/// One step shows how much a shape gains where it is small.
const SCREEN: Effort = Effort { steps: 1, gain: 0.0, fineness: Fineness::COARSE };
const QUICK: Effort = Effort { steps: 24, gain: 0.5, fineness: Fineness::COARSE };

/// Returns the free shape that explains most without any law beside it, and the law that names it, fitted alone; `None`
/// if no effect has a shape. `windows` are short windows of the records of `problem`, in which a fit finds parameters
/// that are far from where it starts. `from` is the linear model from which the fits start.
pub fn family<'a>(
    problem: &Problem,
    windows: &Problem,
    from: &Fit<'a>,
    scope: &Scope<'_, 'a>,
) -> Option<(Fit<'a>, FreeShapeFit<'a>)> {
    let laws = laws(windows, scope);
    let begun = Begun::new(windows, from);
    let mut screened: Vec<Fit> = shapes(windows, &laws).par_iter().map(|shape| begun.fit(shape, SCREEN)).collect();
    sort(&mut screened);
    for f in &screened {}
    screened.truncate(scope.settings.families);
    let mut fits: Vec<Fit> = screened.par_iter().map(|of| begun.fit(&of.effects[0], QUICK)).collect();
    sort(&mut fits);
    for f in &fits {
        eprintln!(f.effects[0].effect.name(), f.effects[0].place, f.cost, f.effects[0].parameters);
    }
    let shape = fits.into_iter().next()?;
    let law = name(problem, &shape.effects[0], &laws, scope, &begun)?;
    let free = FreeShapeFit { fit: polish(problem, shape), which: 0 };
    Some((polish(problem, law), free))
}

/// A linear model from which fits start, with its derivatives.
struct Begun<'p> {
    problem: &'p Problem,
    eta: Vec<f64>,
    jacobian: Jacobian,
}

impl<'p> Begun<'p> {
    fn new(problem: &'p Problem, from: &Fit) -> Self {
        let jacobian = problem.jacobian(&problem.nuisance.apply(&problem.plant, &from.eta));
        // Windows have initial states in addition.
        let eta = problem.fit(&jacobian, &from.eta, &[], SCREEN).eta;
        Self { problem, eta, jacobian }
    }

    fn fit<'a>(&self, placed: &Placed<'a>, effort: Effort) -> Fit<'a> {
        self.problem.fit(&self.jacobian, &self.eta, std::slice::from_ref(placed), effort)
    }
}

/// Returns the free shapes of laws, each place of a shape once.
fn shapes<'a>(problem: &Problem, laws: &[(Placed<'a>, &'static Flexible)]) -> Vec<Placed<'a>> {
    let mut shapes: Vec<Placed<'a>> = Vec::new();
    for (law, effect) in laws {
        let known = |other: &Placed| other.effect.name() == effect.name() && other.place == law.place;
        if !shapes.iter().any(known) {
            let parameters = effect.starts(&problem.setting, &law.place).remove(0);
            shapes.push(Placed { effect: *effect, place: law.place.clone(), parameters });
        }
    }
    shapes
}

/// Returns each law of the library that has a free shape, at each of its places.
fn laws<'a>(problem: &Problem, scope: &Scope<'_, 'a>) -> Vec<(Placed<'a>, &'static Flexible)> {
    let shaped = scope.library.effects().filter_map(|effect| Some((effect, effect.free_shape()?)));
    let at_places = |(effect, sibling): (&'a dyn Effect, &'static Flexible)| {
        let starts = move |place| {
            let starts = effect.starts(&problem.setting, &place);
            starts.into_iter().map(move |parameters| (Placed { effect, place: place.clone(), parameters }, sibling))
        };
        effect.places(&problem.setting).into_iter().flat_map(starts)
    };
    shaped.flat_map(at_places).filter(|(placed, _)| scope.allows(placed)).collect()
}

/// Returns the law that is nearest to a shape: by its curve, or for a loop by its own fit.
fn name<'a>(
    problem: &Problem,
    shape: &Placed<'a>,
    laws: &[(Placed<'a>, &'static Flexible)],
    scope: &Scope<'_, 'a>,
    begun: &Begun,
) -> Option<Fit<'a>> {
    let of_family =
        |(law, sibling): &&(Placed, &Flexible)| sibling.name() == shape.effect.name() && law.place == shape.place;
    let mut fits: Vec<Fit> = laws.iter().filter(of_family).map(|(law, _)| begun.fit(law, QUICK)).collect();
    sort(&mut fits);
    let best = fits.into_iter().next().filter(|fit| fit.cost.is_finite())?;
    let curve = std::slice::from_ref(shape);
    let nearer = closest_law(problem, curve, &best.effects[0], scope.library, &|law| scope.allows(law));
    Some(nearer.map_or(best, |law| begun.fit(&law, QUICK)))
}

/// Sorts fits by cost; those without a finite cost come last.
fn sort(fits: &mut [Fit]) {
    let cost = |fit: &Fit| if fit.cost.is_finite() { fit.cost } else { f64::INFINITY };
    fits.sort_by(|a, b| cost(a).total_cmp(&cost(b)));
}
