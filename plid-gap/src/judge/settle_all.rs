//! The final fit to all records, including those held out.

use crate::case::Limits;
use crate::fit::free_run::outputs;
use crate::fit::nuisance::Nuisance;
use crate::fit::problem::{Effort, Fit, Placed, Problem};
use crate::judge::gap;
use crate::noise::whiten::Whitener;
use crate::prepare::Prepared;
use crate::simulate::Fineness;

const ALL: Effort = Effort { steps: 8, gain: 0.5, fineness: Fineness::FINE };

/// Repeats a fit with all records; `None` if nothing was held out, or if the gap with the new fit is larger than with
/// the present one.
pub fn with_all<'a>(ready: &Prepared, fit: &Fit<'a>) -> Option<(Vec<f64>, Vec<Placed<'a>>)> {
    if ready.held_out.is_empty() {
        return None;
    }
    let all = of_all(ready);
    let (eta, refitted) = again(&all, fit);
    // The whitened sum of squares may fall although the gap grows, in a band where the noise is weak.
    let gap = |eta: &[f64], effects: &[Placed]| gap::of_driven(&all.records, &outputs(&all, eta, effects));
    let follows = gap(&refitted.eta, &refitted.effects) <= gap(&eta, &fit.effects);
    follows.then(|| (refitted.eta[..fit.eta.len()].to_vec(), refitted.effects))
}

/// Repeats a fit to the first of these records with all of them. Returns the linear parameters from which it starts,
/// too.
fn again<'a>(all: &Problem, fit: &Fit<'a>) -> (Vec<f64>, Fit<'a>) {
    // The fitted initial states come first; those of the added records start at zero.
    let mut eta = fit.eta.clone();
    eta.resize(all.nuisance.len(), 0.0);
    let jacobian = all.jacobian(&all.nuisance.apply(&all.plant, &eta));
    let refitted = all.fit(&jacobian, &eta, &fit.effects, ALL);
    (eta, refitted)
}

/// Returns the problem with the held-out records after the fitted ones.
fn of_all(ready: &Prepared) -> Problem {
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
    nuisance.measure_as(&problem.nuisance);
    Problem { records, whiteners, nuisance, ..problem.clone() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::case::record::rms;
    use crate::effects::{Library, Place};
    use crate::fit::refit::{STEPS, refit};
    use crate::prepare::{Known, prepare};
    use crate::testing::{self, laws::at};

    /// Limits that leave the simulation as it is.
    const EXACT: Limits = Limits { frequency: 1e-7, damping: 1e-7, shape: 1e-7 };

    /// Prepares records of a truss with noise of these shares of each output, with a simulation that is exact except
    /// that the first actuator appears to have another gain in each output of a record.
    fn prepared(noise: [f64; 2], gain: fn(&str) -> [f64; 2]) -> Prepared {
        let sim = testing::truss(1);
        let mut case = testing::case(&sim, &sim);
        let std: Vec<f64> = case.records[1].y.iter().zip(noise).map(|(y, share)| share * rms(y)).collect();
        for (k, record) in case.records.iter_mut().enumerate() {
            for (o, gain) in gain(&record.name).into_iter().enumerate() {
                let mut u = record.u.clone();
                u[0].iter_mut().for_each(|u| *u *= gain);
                record.y[o] = testing::run(&sim, &u).swap_remove(o);
            }
            testing::add_noise(&mut record.y, 70 + k as u64, &std);
        }
        let mut model = case.model.unwrap();
        model.noise.sensor_std = Some(std);
        prepare(&model, &case.records, &Known { limits: EXACT, ..Known::default() }).unwrap()
    }

    /// Returns the fit of a gain of the first actuator that has this value.
    fn with_gain<'a>(library: &'a Library, ready: &Prepared, gain: f64) -> Fit<'a> {
        let effects = vec![at(library, "actuator-gain", Place::Input(0), vec![gain])];
        Fit { effects, ..refit(&ready.problem, STEPS).as_fit() }
    }

    #[test]
    fn held_out_records_are_fitted_as_well() {
        let library = Library::standard();
        let last = |name: &str| [if name == "random-3" { 1.03 } else { 1.02 }; 2];
        let mut ready = prepared([0.002; 2], last);
        assert_eq!(ready.held_out.iter().map(|record| record.name.as_str()).collect::<Vec<_>>(), ["random-3"]);
        let fit = with_gain(&library, &ready, 1.02);
        let (eta, effects) = with_all(&ready, &fit).unwrap();
        // The levels of the driven records are 1, 0.5 and 1.
        let wanted = (1.02 * 1.25 + 1.03) / 2.25;
        let found = effects[0].parameters[0];
        assert!((found - wanted).abs() < 5e-4 && eta.len() == fit.eta.len(), "{found} instead of {wanted}");
        ready.held_out.clear();
        assert!(with_all(&ready, &fit).is_none());
    }

    /// The first output, which has little noise, decides the new fit, but the gap counts both outputs alike.
    #[test]
    fn a_fit_to_all_records_with_a_larger_gap_is_not_taken() {
        let library = Library::standard();
        let differs = |_: &str| [1.02, 1.0];
        let ready = prepared([0.0002, 0.02], differs);
        let fit = with_gain(&library, &ready, 1.01);
        let (_, refitted) = again(&of_all(&ready), &fit);
        assert!((refitted.effects[0].parameters[0] - 1.02).abs() < 1e-3);
        assert!(with_all(&ready, &fit).is_none());
    }
}
