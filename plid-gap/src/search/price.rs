//! The price of parameters and choices, and the conditions under which an effect is accepted.

use crate::fit::candidate::Candidate;
use crate::fit::problem::{Fit, Placed, Problem, sum_of_squares};
use crate::search::rules::Scope;

/// The price of parameters and choices, and the options of a stage.
pub(super) struct Price<'p, 'a> {
    rows: f64,
    /// Price of an effect that the bounded refit has as a parameter.
    release: f64,
    /// Whether the parameters of the refit include every number of the simulation.
    has_numbers: bool,
    pub scope: &'p Scope<'p, 'a>,
}

impl<'p, 'a> Price<'p, 'a> {
    pub fn new(problem: &Problem, scope: &'p Scope<'p, 'a>) -> Self {
        let release = scope.settings.release_price - fewer(problem, scope);
        Self { rows: problem.values(), release, has_numbers: problem.has_numbers(), scope }
    }

    pub fn of(&self, fit: &Fit) -> f64 {
        let settings = &self.scope.settings;
        let one = |placed: &Placed| {
            let own = if placed.effect.is_in_refit() || self.has_numbers && placed.effect.is_number() {
                self.release
            } else {
                settings.choice_price + placed.parameters.len() as f64 * self.rows.ln()
            };
            own - self.scope.bonus(placed)
        };
        fit.cost + fit.effects.iter().map(one).sum::<f64>()
    }

    pub fn candidate(&self, fit: &Fit<'a>) -> Candidate<'a> {
        Candidate { effects: fit.effects.clone(), cost: fit.cost, priced: self.of(fit) }
    }
}

/// Returns whether an explanation leaves so much beyond the noise that it may only imitate the cause.
pub(super) fn imitates(fit: &Fit, price: &Price) -> bool {
    sum_of_squares(&fit.residual) > price.scope.settings.imitation_left * price.rows
}

/// Returns the reduction of the price of releasing a linear parameter if these are few: twice the logarithm of the
/// factor by which they are fewer than `released_of`.
fn fewer(problem: &Problem, scope: &Scope) -> f64 {
    let share = problem.nuisance.of_simulation().max(1) as f64 / scope.settings.released_of;
    -2.0 * share.min(1.0).ln()
}

/// Returns whether a further effect removes so much of the linear parameters' penalty that, given their number, this
/// is unlikely to be chance.
pub(super) fn straightens(problem: &Problem, scope: &Scope, before: &Fit, after: &Fit) -> bool {
    let removed = problem.penalty(&before.eta) - problem.penalty(&after.eta);
    removed >= least_straightened(problem, scope)
}

/// Returns the least penalty of the linear parameters that a further effect must remove.
pub(super) fn least_straightened(problem: &Problem, scope: &Scope) -> f64 {
    scope.settings.straightened_penalty - fewer(problem, scope)
}

/// Returns whether a further effect explains enough of the residual, or of the changes of the linear parameters.
pub(super) fn material(problem: &Problem, scope: &Scope, before: &Fit, after: &Fit) -> bool {
    let (search, rows) = (&problem.settings.search, problem.values());
    let left = |fit: &Fit| sum_of_squares(&fit.residual);
    let explained = left(before) - left(after);
    // If the residual is smaller than the assumed noise, the records do not show how much of the residual is noise.
    // The same holds if an earlier residual is assumed as noise: a further effect at the same place may then only
    // correct the law of the first.
    let corrects =
        after.effects.split_last().is_some_and(|(last, others)| others.iter().any(|e| e.place == last.place));
    let unknown = scope.imperfect && corrects || left(before) < search.overstated * rows;
    let excess = if unknown { left(before) } else { left(before) - rows };
    let share = explained / excess.max(search.material_power * rows);
    let visible =
        explained > search.material_power * rows && (before.effects.is_empty() || share > search.further_share);
    visible || (straightens(problem, scope, before, after) && explained > -search.straightened_penalty)
}
