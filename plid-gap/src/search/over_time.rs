//! Changes over time that the fitted records hardly show.
//!
//! The refit absorbs the mean of a drift as a wrong gain or frequency, and the rest of the drift may be smaller than
//! other errors of the simulation. A later record reveals the drift.

use crate::effects::Side;
use crate::fit::candidate::Candidate;
use crate::fit::problem::{Fit, Placed, Problem};
use crate::fit::refit::Refit;
use crate::search::course::not_of_time;
use crate::search::price::Price;
use crate::search::rules::Scope;
use crate::search::stage::SearchStage;

/// Returns the fits of single changes over time that explain the fitted records better than the refit, each with its
/// price.
pub(crate) fn over_time<'a>(
    problem: &Problem,
    quick: &Problem,
    refitted: &Refit,
    scope: &Scope<'_, 'a>,
) -> Vec<(Fit<'a>, Candidate<'a>)> {
    let price = Price::new(problem, scope);
    let left_out = |placed: &Placed| placed.effect.side() != Side::Time || !scope.admits(placed);
    let counts = [scope.settings.fitted, scope.settings.polished];
    let (_, fits) = SearchStage::new(problem, quick, &refitted.as_fit(), None, &left_out, &price, counts)
        .without(problem, quick, &left_out, &price);
    let gains = |fit: &Fit| refitted.cost - price.of(fit) > scope.settings.accept_gain;
    let stand = fits.into_iter().filter(|fit| gains(fit) && not_of_time(problem, refitted, fit).is_none());
    stand
        .map(|fit| {
            let candidate = price.candidate(&fit);
            (fit, candidate)
        })
        .collect()
}
