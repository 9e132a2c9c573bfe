//! Step 10: how far the gap goes down, on what was held out from all fitting.

use crate::diagnosis::Gap;
use crate::effects::Action;
use crate::explain::Explained;
use crate::gap::{self, Blocks};
use crate::locate;
use crate::nuisance::{Limits, Nuisance};
use crate::plant::Plant;
use crate::problem::{Effort, Problem};
use crate::record::{Channels, Excitation, Record};
use crate::refit::refit;
use crate::simulate::{Fineness, State, simulate};
use crate::stepwise::Search;

/// Steps of the refit without bounds.
const FREE_STEPS: usize = 12;

/// Gaps on held-out records, or on the loudest driven one where nothing is held out. `plant` and `actions` are the simulation with the
/// effects.
pub(crate) fn gaps(explained: &Explained, plant: &Plant, actions: &[Action], limits: &Limits) -> Gap {
    let Explained { ready, quick, refitted, found, .. } = explained;
    let problem = &ready.problem;
    let loudest = loudest(&problem.records);
    let noise = explained.noise_rms();
    // Stated first, from what was fitted.
    let fitted: Vec<Channels> = problem.records.iter().map(|record| run(plant, actions, record)).collect();
    let stated = gap::expected(&problem.records, &fitted, loudest.level());
    let opened: Vec<&Record> = if ready.held_out.is_empty() { vec![loudest] } else { ready.held_out.iter().collect() };
    let of = |plant: &Plant, actions: &[Action]| {
        let each = opened.iter().map(|record| Blocks::new(&record.y, &run(plant, actions, record), 0));
        Blocks::joined(each.collect()).expect("at least one record is opened")
    };
    let given = of(&problem.plant, &[]);
    let refit_blocks = of(&refitted.plant, &[]);
    let with = of(plant, actions);
    let measured: Vec<&[Vec<f64>]> = opened.iter().map(|record| record.y.as_slice()).collect();
    let floor = gap::floor_over(&noise, &measured);
    let (as_given, bounded, with_effect) = (given.gap(), refit_blocks.gap(), with.gap());
    let wide =
        Limits { frequency: 40.0 * limits.frequency, damping: 10.0 * limits.damping, shape: 40.0 * limits.shape };
    let free = Problem { nuisance: Nuisance::new(&quick.plant, &quick.records, &wide), ..quick.clone() };
    let free_refit = of(&refit(&free, FREE_STEPS).plant, &[]).gap();
    let placebo = placebo(quick, found);
    let placebo_gap = placebo.map_or(bounded, |(plant, actions)| of(&plant, &actions).gap());
    let ceiling = ceiling(quick, found);
    let ceiling_gap = ceiling.map_or(with_effect, |(plant, actions)| of(&plant, &actions).gap()).min(with_effect);
    let shrink = gap::shrink(as_given, with_effect, floor);
    let most = gap::shrink(as_given, ceiling_gap, floor);
    Gap {
        as_given,
        refit: bounded,
        free_refit,
        with_effect,
        noise_floor: floor,
        shrink,
        shrink_ci95: gap::shrink_interval(&given, &with, floor),
        shrink_over_refit: gap::shrink(bounded, with_effect, floor),
        placebo_shrink: gap::shrink(as_given, placebo_gap, floor) - gap::shrink(as_given, bounded, floor),
        share_of_ceiling: if most > 0.0 { (shrink / most).clamp(0.0, 1.0) } else { 1.0 },
        predicted_held_out_gap: stated,
        measured_on: opened.iter().map(|r| r.name.clone()).collect(),
    }
}

/// The last of the loudest records, a random one if there is any: a drift shows there as it will in what follows.
pub(crate) fn loudest(records: &[Record]) -> &Record {
    let most = records.iter().map(Record::level).fold(0.0, f64::max);
    let random = records.iter().rev().find(|r| r.excitation == Excitation::Random && r.level() > 0.9 * most);
    random.or(records.iter().rev().find(|r| r.level() > 0.9 * most)).unwrap_or(&records[0])
}

/// Free run of a record; an unknown start is fitted to it first.
pub(crate) fn run(plant: &Plant, actions: &[Action], record: &Record) -> Channels {
    let start = (!record.from_rest).then(|| fitted_start(plant, actions, record));
    simulate(plant, actions, &record.u, record.start_s, start.as_ref(), Fineness::FINE)
}

/// The initial state that explains a record best, by least squares on the linear response.
fn fitted_start(plant: &Plant, actions: &[Action], record: &Record) -> State {
    let nuisance = Nuisance::new(plant, std::slice::from_ref(record), &Limits::default());
    let from_rest = simulate(plant, actions, &record.u, record.start_s, None, Fineness::FINE);
    let error: Vec<f64> = locate::error(record, &from_rest).into_iter().flatten().collect();
    let first = nuisance.len() - plant.n();
    let mut columns = nalgebra::DMatrix::zeros(error.len(), plant.n());
    nuisance.tangents(plant, record, 0, |column, y| {
        if column >= first {
            let flat: Vec<f64> = y.iter().flatten().copied().collect();
            columns.column_mut(column - first).copy_from_slice(&flat);
        }
    });
    let mut normal = columns.tr_mul(&columns);
    let ridge = 1e-9 * normal.trace().max(f64::MIN_POSITIVE);
    (0..plant.n()).for_each(|i| normal[(i, i)] += ridge);
    let gradient = columns.tr_mul(&nalgebra::DVector::from_vec(error));
    let solved = normal.cholesky().map_or_else(|| nalgebra::DVector::zeros(plant.n()), |c| c.solve(&gradient));
    let mut eta = vec![0.0; nuisance.len()];
    eta[first..].copy_from_slice(solved.as_slice());
    nuisance.start(0, &eta).unwrap_or_else(|| State::rest(plant))
}

/// Fits for comparison only.
const ROUGH: Effort = Effort { steps: 4, gain: 1.0, fineness: Fineness::COARSE };

/// A wrong effect with as many parameters: from the lower half of the screen, on another side of the chain.
fn placebo(problem: &Problem, found: &Search) -> Option<(Plant, Vec<Action>)> {
    let first = found.best.effects.first()?;
    let wanted = first.parameters.len();
    let entries = found.stages.first()?;
    let entry = entries
        .iter()
        .skip(entries.len() / 2)
        .find(|entry| entry.placed.effect.side() != first.effect.side() && entry.placed.parameters.len() == wanted)?;
    let tangent = problem.tangent(&problem.plant);
    let fit = problem.fit(&tangent, &vec![0.0; problem.nuisance.len()], std::slice::from_ref(&entry.placed), ROUGH);
    Some((problem.nuisance.apply(&problem.plant, &fit.eta), problem.actions(&fit.effects)))
}

/// The flexible model: the best explanation and, beside it, the three entries that would explain most of the rest.
fn ceiling(problem: &Problem, found: &Search) -> Option<(Plant, Vec<Action>)> {
    let mut effects = found.best.effects.clone();
    let entries = found.stages.last()?;
    effects.extend(entries.iter().filter(|e| e.gain > 20.0).take(3).map(|entry| entry.placed.clone()));
    let tangent = problem.tangent(&problem.nuisance.apply(&problem.plant, &found.best.eta));
    let fit = problem.fit(&tangent, &found.best.eta, &effects, ROUGH);
    Some((problem.nuisance.apply(&problem.plant, &fit.eta), problem.actions(&fit.effects)))
}
