//! The final fit to all records, including those held out.

use crate::case::Limits;
use crate::fit::free_run::outputs;
use crate::fit::nuisance::Nuisance;
use crate::fit::problem::{Effort, Placed, Problem};
use crate::judge::explained::Explained;
use crate::judge::gap;
use crate::noise::whiten::Whitener;
use crate::simulate::Fineness;

const ALL: Effort = Effort { steps: 8, gain: 0.5, fineness: Fineness::FINE };

/// Fits the best explanation to all records; `None` if nothing was held out, or if the gap with the new fit is larger
/// than with the present one.
pub fn with_all<'a>(explained: &Explained<'a>) -> Option<(Vec<f64>, Vec<Placed<'a>>)> {
    let ready = &explained.ready;
    let fit = explained.predicting();
    if ready.held_out.is_empty() {
        return None;
    }
    let problem = &ready.problem;
    let records: Vec<_> = problem.records.iter().chain(&ready.held_out).cloned().collect();
    let mut whiteners = problem.whiteners.clone();
    whiteners.extend(ready.held_out.iter().map(|record| {
        // Missing samples are masked.
        let missing = |y: &Vec<f64>| (0..y.len()).filter(|&k| !y[k].is_finite()).collect();
        Whitener::new(record, &ready.noise, problem.plant.rate, record.y.iter().map(missing).collect())
    }));
    let modes = problem.nuisance.of_simulation();
    let mut nuisance = Nuisance::new(&problem.plant, &records, &Limits::default());
    nuisance.std[..modes].copy_from_slice(&problem.nuisance.std[..modes]);
    nuisance.ports_follow = problem.nuisance.ports_follow;
    // The fitted initial states come first; those of the added records start at zero.
    let mut eta = fit.eta.clone();
    eta.resize(nuisance.len(), 0.0);
    let all = Problem { records, whiteners, nuisance, ..problem.clone() };
    let jacobian = all.jacobian(&all.nuisance.apply(&all.plant, &eta));
    let refitted = all.fit(&jacobian, &eta, &fit.effects, ALL);
    // The whitened sum of squares may fall although the gap grows, in a band where the noise is weak.
    let gap = |eta: &[f64], effects: &[Placed]| gap::of_driven(&all.records, &outputs(&all, eta, effects));
    let follows = gap(&refitted.eta, &refitted.effects) <= gap(&eta, &fit.effects);
    follows.then(|| (refitted.eta[..fit.eta.len()].to_vec(), refitted.effects))
}
