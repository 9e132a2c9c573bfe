//! Step 10: how far the gap goes down, on what was held out from all fitting.

use crate::answer::schema::{Gap, ShrinkOver};
use crate::case::record::{Channels, Excitation, Record};
use crate::effects::Action;
use crate::fit::nuisance::{Limits, Nuisance};
use crate::fit::problem::{Effort, Problem, sum_of_squares};
use crate::fit::refit::refit;
use crate::judge::gap::{self, Blocks};
use crate::judge::{crossed, locate};
use crate::noise::whiten::Whitener;
use crate::plant::Plant;
use crate::search::explain::Explained;
use crate::search::stepwise::Search;
use crate::simulate::{Fineness, State, simulate};

/// Steps of the refit without bounds.
const FREE_STEPS: usize = 12;

/// Gaps on held-out records, or on the loudest driven one where nothing is held out. `plant` and `actions` are the simulation with the
/// effects.
pub fn gaps(explained: &Explained, plant: &Plant, actions: &[Action], within: &Plant, limits: &Limits) -> Gap {
    let Explained { ready, quick, refitted, found, .. } = explained;
    let problem = &ready.problem;
    let loudest = loudest(&problem.records);
    let noise = explained.noise_rms();
    // Stated first, from what was fitted.
    let whitened =
        |record: &Record| Whitener::new(record, &ready.noise, problem.plant.rate, vec![Vec::new(); problem.plant.p]);
    let stated = crossed::stated(problem, explained.fit(), loudest.level(), whitened);
    let opened = opened(explained);
    let of = |plant: &Plant, actions: &[Action]| blocks(&opened, plant, actions);
    let given = of(&problem.plant, &[]);
    let refit_blocks = of(&refitted.plant, &[]);
    let with = of(plant, actions);
    let measured: Vec<&[Vec<f64>]> = opened.iter().map(|record| record.y.as_slice()).collect();
    let floor = gap::floor_over(&noise, &measured);
    let (as_given, bounded, with_effect) = (given.gap(), refit_blocks.gap(), with.gap());
    let wide =
        Limits { frequency: 40.0 * limits.frequency, damping: 10.0 * limits.damping, shape: 40.0 * limits.shape };
    let free = Problem { nuisance: Nuisance::new(&quick.plant, &quick.records, &wide), ..quick.clone() };
    let free_blocks = of(&refit(&free, FREE_STEPS).plant, &[]);
    let placebo_blocks = placebo(quick, found).map(|(plant, actions)| of(&plant, &actions));
    let placebo_gap = placebo_blocks.as_ref().map_or(bounded, Blocks::gap);
    // A ceiling model that is worse than what was found is none.
    let ceiling_blocks = ceiling(quick, found)
        .map(|(plant, actions)| of(&plant, &actions))
        .filter(|ceiling| ceiling.gap() < with_effect)
        .unwrap_or_else(|| with.clone());
    let over = |than: &str, before: &Blocks| ShrinkOver {
        than: than.into(),
        gap: before.gap(),
        shrink: gap::shrink(before.gap(), with_effect, floor),
        ci95: gap::drawn([before, &with], |[before, with]| gap::shrink(before, with, floor)),
    };
    let mut shrink_over = vec![over("bounded refit", &refit_blocks), over("free linear refit", &free_blocks)];
    shrink_over.extend(placebo_blocks.as_ref().map(|blocks| over("placebo", blocks)));
    let share = |[given, with, most]: [f64; 3]| {
        let most = gap::shrink(given, most, floor);
        if most > 0.0 { (gap::shrink(given, with, floor) / most).clamp(0.0, 1.0) } else { 1.0 }
    };
    Gap {
        as_given,
        refit: bounded,
        within_limits: of(within, &[]).gap(),
        free_refit: free_blocks.gap(),
        with_effect,
        noise_floor: floor,
        shrink: gap::shrink(as_given, with_effect, floor),
        shrink_ci95: gap::drawn([&given, &with], |[given, with]| gap::shrink(given, with, floor)),
        shrink_over_refit: gap::shrink(bounded, with_effect, floor),
        placebo_shrink: gap::shrink(as_given, placebo_gap, floor) - gap::shrink(as_given, bounded, floor),
        shrink_over,
        share_of_ceiling: share([as_given, with_effect, ceiling_blocks.gap()]),
        share_of_ceiling_ci95: gap::drawn([&given, &with, &ceiling_blocks], share),
        predicted_held_out_gap: stated.gap,
        predicted_ci80: stated.ci80,
        measured_on: opened.iter().map(|r| r.name.clone()).collect(),
    }
}

/// Records that are opened once all is fitted: those that were held out, or else the loudest.
pub(crate) fn opened<'e>(explained: &'e Explained) -> Vec<&'e Record> {
    let Explained { ready, .. } = explained;
    if ready.held_out.is_empty() { vec![loudest(&ready.problem.records)] } else { ready.held_out.iter().collect() }
}

/// Free runs of records beside what was measured.
pub(crate) fn blocks(records: &[&Record], plant: &Plant, actions: &[Action]) -> Blocks {
    let each = records.iter().map(|record| Blocks::new(&record.y, &run(plant, actions, record), 0));
    Blocks::joined(each.collect()).expect("at least one record is opened")
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

/// The initial state that explains a record best: by least squares on the linear response, first without effects, then corrected by what the run with
/// them leaves. A run from rest would begin with a transient that the record does not have, and that effects may blow up.
fn fitted_start(plant: &Plant, actions: &[Action], record: &Record) -> State {
    let nuisance = Nuisance::new(plant, std::slice::from_ref(record), &Limits::default());
    let first = nuisance.len() - plant.n();
    let mut columns = nalgebra::DMatrix::zeros(record.y.len() * record.samples(), plant.n());
    nuisance.tangents(plant, record, 0, |column, y| {
        if column >= first {
            let flat: Vec<f64> = y.iter().flatten().copied().collect();
            columns.column_mut(column - first).copy_from_slice(&flat);
        }
    });
    let mut normal = columns.tr_mul(&columns);
    let ridge = 1e-9 * normal.trace().max(f64::MIN_POSITIVE);
    (0..plant.n()).for_each(|i| normal[(i, i)] += ridge);
    let Some(factor) = normal.cholesky() else { return State::rest(plant) };
    let state = |eta: &[f64]| nuisance.start(0, eta).unwrap_or_else(|| State::rest(plant));
    let left = |eta: &[f64], actions: &[Action]| -> Vec<f64> {
        let y = simulate(plant, actions, &record.u, record.start_s, Some(&state(eta)), Fineness::FINE);
        locate::error(record, &y).into_iter().flatten().collect()
    };
    let corrected = |eta: &[f64], error: Vec<f64>| -> Vec<f64> {
        let step = factor.solve(&columns.tr_mul(&nalgebra::DVector::from_vec(error)));
        let mut eta = eta.to_vec();
        eta[first..].iter_mut().zip(step.iter()).for_each(|(x, dx)| *x += dx);
        eta
    };
    let rest = vec![0.0; nuisance.len()];
    let linear = corrected(&rest, left(&rest, &[]));
    if actions.is_empty() {
        return state(&linear);
    }
    let error = left(&linear, actions);
    let before = sum_of_squares(&error);
    let second = corrected(&linear, error);
    if sum_of_squares(&left(&second, actions)) < before { state(&second) } else { state(&linear) }
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::{CubicStiffness, Effect, Place};
    use crate::prepare::tests::setting_of;
    use crate::prepare::{Known, prepare};
    use crate::testing;

    /// A truth that is off everywhere, by gains, cross-talk and more than the stated limits, beside one large spring: the spring is named first, and what remains is
    /// said beside it.
    #[test]
    fn a_main_cause_is_named_beside_small_imperfections() {
        use crate::diagnose::diagnose;
        use crate::effects::Library;
        use crate::judge::verdict::Verdict;
        let sim = testing::truss(1);
        let real = testing::truss_with(1, |modes, _, shapes| {
            for (k, (hz, zeta)) in modes.iter_mut().enumerate() {
                *hz *= 1.0 + 0.0012 * f64::from(1 - 2 * (k as i32 % 2));
                *zeta *= 1.05;
            }
            shapes.row_mut(0).scale_mut(1.02);
        });
        let mut case = testing::case(&sim, &real);
        let plant = Plant::new(&real).unwrap();
        let ready = prepare(case.model.as_ref().unwrap(), &case.records, &Known::default()).unwrap();
        let setting = ready.problem.setting;
        let library = Library::standard();
        let act =
            |name: &str, place: Place, parameters: &[f64]| library.get(name).unwrap().act(&setting, &place, parameters);
        let size = 2e-3 * setting.stiffness[0] / setting.d_rms[0].powi(2);
        let small = 2e-4 * setting.stiffness[1];
        for record in &mut case.records {
            let mut actions = act("cubic-stiffness", Place::Port(0), &[size]);
            actions.extend(act("clearance", Place::Port(1), &[small, setting.d_rms[1]]));
            actions.extend(act("actuator-delay", Place::AllInputs, &[0.03]));
            let run = |actions: &[Action]| simulate(&plant, actions, &record.u, record.start_s, None, Fineness::FINE);
            let (with, without) = (run(&actions), run(&[]));
            let changed = with.iter().flatten().zip(without.iter().flatten());
            record.y.iter_mut().flatten().zip(changed).for_each(|(y, (a, b))| *y += a - b);
        }
        let diagnosis = diagnose(&case, &library, &mut |_| {}).unwrap().diagnosis;
        assert_eq!(diagnosis.verdict, Verdict::Effects, "{}", diagnosis.sentence);
        let first = &diagnosis.effects[0];
        assert_eq!(first.effect, "cubic-stiffness", "{}", diagnosis.sentence);
        assert!(first.share.unwrap() > 0.5, "{first:?}");
        let [low, high] = diagnosis.gap.predicted_ci80;
        assert!(low < diagnosis.gap.predicted_held_out_gap && diagnosis.gap.predicted_held_out_gap < high);
        assert!(diagnosis.remainder.gap >= diagnosis.remainder.noise * 0.9, "{:?}", diagnosis.remainder);
    }

    /// A record that begins in motion is followed from its start, though a spring stiffens.
    #[test]
    fn a_start_in_motion_is_found_with_an_effect_too() {
        let model = testing::truss(3);
        let plant = Plant::new(&model).unwrap();
        let setting = setting_of(&plant, &model);
        let u = testing::random_input(5, 1200, 2);
        let linear = simulate(&plant, &[], &u, 0.0, None, Fineness::FINE);
        let far = |a: &Channels, b: &Channels| {
            let square = |(a, b): (&f64, &f64)| (a - b) * (a - b);
            a.iter().flatten().zip(b.iter().flatten()).map(square).sum::<f64>().sqrt()
        };
        // Ever stiffer, until the gap is a fifth.
        let stiffening = (0..).map(|j| {
            let actions = CubicStiffness.act(&setting, &Place::Port(0), &[10_f64.powf(f64::from(j) / 4.0)]);
            let y = simulate(&plant, &actions, &u, 0.0, None, Fineness::FINE);
            (actions, y)
        });
        let (actions, y) =
            { stiffening }.find(|(_, y)| far(y, &linear) > 0.2 * far(&linear, &vec![vec![0.0; 1200]; 2])).unwrap();
        let cut = |channels: &Channels| -> Channels { channels.iter().map(|x| x[600..].to_vec()).collect() };
        let record = Record { from_rest: false, ..crate::testing::record(cut(&u), cut(&y)) };
        let rest = simulate(&plant, &actions, &record.u, 0.0, None, Fineness::FINE);
        let (from_rest, started) = (far(&rest, &record.y), far(&run(&plant, &actions, &record), &record.y));
        assert!(started < 0.1 * from_rest, "{started} of {from_rest}");
    }
}
