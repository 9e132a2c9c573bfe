//! The reduction of the gap on held-out records.

use serde::{Deserialize, Serialize};

use crate::case::Limits;
use crate::case::levels::loudest;
use crate::case::record::Record;
use crate::effects::Action;
use crate::fit::free_run::run;
use crate::fit::nuisance::Nuisance;
use crate::fit::problem::{Effort, Problem};
use crate::fit::refit::refit;
use crate::judge::crossed::{Crossed, are_long};
use crate::judge::explained::Explained;
use crate::judge::gap::{self, Blocks};
use crate::noise::whiten::Whitener;
use crate::plant::Plant;
use crate::search::stepwise::Search;
use crate::settings::JudgeSettings;
use crate::simulate::Fineness;

/// Largest number of steps of the refit without bounds.
const FREE_STEPS: usize = 12;

/// The reduction of the gap by the effects relative to another model, on the same samples.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ShrinkOver {
    /// The other model.
    pub than: String,
    /// Its gap.
    pub gap: f64,
    /// 1 - with_effect / gap, both beyond the floor.
    pub shrink: f64,
    /// Its 95 % interval.
    pub ci95: [f64; 2],
}

/// The gaps and their reductions.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Gap {
    /// Gap of the simulation as given.
    pub as_given: f64,
    /// Gap after the bounded refit.
    pub refit: f64,
    /// Gap after the bounded refit with its parameters clipped to the limits.
    #[serde(default)]
    pub within_limits: f64,
    /// Gap after a linear refit without bounds.
    pub free_refit: f64,
    /// Gap after the fit with the effects.
    pub with_effect: f64,
    /// Gap of noise alone.
    pub noise_floor: f64,
    /// Shrink: 1 - `with_effect` / `as_given`, both beyond `noise_floor`.
    pub shrink: f64,
    /// Its 95 % interval.
    pub shrink_ci95: [f64; 2],
    /// Shrink relative to the bounded refit: 1 - `with_effect` / `refit`, both beyond `noise_floor`.
    pub shrink_over_refit: f64,
    /// Shrink by a reference effect (a wrong effect with as many parameters), minus the shrink by the bounded refit.
    pub placebo_shrink: f64,
    /// Shrink by the effects relative to the bounded refit, to a linear refit without bounds and, if there is one, to
    /// the reference effect.
    #[serde(default)]
    pub shrink_over: Vec<ShrinkOver>,
    /// Gap that the effects close, as a share of the gap that a flexible model closes.
    pub share_of_ceiling: f64,
    /// Its 95 % interval.
    #[serde(default)]
    pub share_of_ceiling_ci95: [f64; 2],
    /// Gap with which the fitted records are predicted from one another, at full level. No held-out record enters
    /// this figure, but the explanation that predicts may have been chosen with held-out records.
    #[serde(default)]
    pub crossed_gap: f64,
    /// Gap to expect on a further record like the last one at full level. If the held-out records are long enough,
    /// this is `crossed_gap` times the ratio of the gap that they left to the gap expected at their level; otherwise
    /// `crossed_gap`. If effects were found and are not written, or if the simulation is written as given, it is the
    /// gap that the simulation that is written leaves in all records.
    pub predicted_held_out_gap: f64,
    /// Its 80 % interval.
    #[serde(default)]
    pub predicted_ci80: [f64; 2],
    /// Names of the records on which the gaps were measured: the held-out ones, or the loudest fitted one if none was
    /// held out. The verdict uses held-out records, and the choice between explanations may use them.
    pub measured_on: Vec<String>,
    /// Whether `measured_on` is a fitted record.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub measured_on_fitted: bool,
}

/// The other model of [`Gap::reference`].
const REFERENCE: &str = "reference effect";

impl Gap {
    /// Returns the comparison with the reference effect, if there is one whose free runs stay bounded.
    pub fn reference(&self) -> Option<&ShrinkOver> {
        self.shrink_over.iter().find(|over| over.than == REFERENCE)
    }

    /// Returns the part of a gap that noise does not explain, in amplitude.
    pub fn beyond_noise(&self, gap: f64) -> f64 {
        (gap * gap - self.noise_floor * self.noise_floor).max(0.0).sqrt()
    }

    /// Returns the remaining amplitude beyond the noise with the effects, over that of the simulation within its
    /// limits.
    pub fn left(&self) -> f64 {
        self.beyond_noise(self.with_effect) / self.beyond_noise(self.within_limits).max(f64::MIN_POSITIVE)
    }

    /// Returns the remaining amplitude beyond the noise with the effects, over that of the simulation as given.
    pub fn left_of_given(&self) -> f64 {
        self.beyond_noise(self.with_effect) / self.beyond_noise(self.as_given).max(f64::MIN_POSITIVE)
    }
}

/// Measures the gaps on the held-out records, or on the loudest fitted one if none is held out. `plant` and `actions`
/// are the simulation with the effects. The gap to expect on a further record is that with the effects.
pub fn gaps(explained: &Explained, plant: &Plant, actions: &[Action], within: &Plant, limits: &Limits) -> Gap {
    let Explained { ready, quick, refitted, found, .. } = explained;
    let problem = &ready.problem;
    let loudest = loudest(&problem.records, problem.settings.case.same_level);
    let noise = explained.noise_rms();
    // The prediction uses the fitted records only. The held-out records then show by how much it was wrong.
    let whitened =
        |record: &Record, masked: Vec<Vec<usize>>| Whitener::new(record, &ready.noise, problem.plant.rate, masked);
    let crossed = Crossed::of(problem, &explained.predicting(), whitened);
    let opened = opened(explained);
    let of = |plant: &Plant, actions: &[Action]| blocks(&opened, plant, actions);
    let given = of(ready.as_given(), &[]);
    // A model that was identified together with a law says little without that law. A refit of the best linear model
    // is that model.
    let linear = |refit: &dyn Fn() -> Blocks| if ready.best_linear.is_some() { given.clone() } else { refit() };
    let refit_blocks = linear(&|| of(&refitted.plant, &[]));
    let with = of(plant, actions);
    let floor = floor(explained, &noise);
    let (as_given, bounded, with_effect) = (given.gap(), refit_blocks.gap(), with.gap());
    // Without bounds, a refit may be unstable. It is then no better than the one with bounds.
    let free = || unless_diverged(of(&free_refit(quick, limits), &[])).unwrap_or_else(|| refit_blocks.clone());
    let free_blocks = linear(&free);
    let reference_blocks =
        reference_effect(quick, found).and_then(|(plant, actions)| unless_diverged(of(&plant, &actions)));
    let reference_gap = reference_blocks.as_ref().map_or(bounded, Blocks::gap);
    // A flexible model that is worse than the explanation is not an upper bound.
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
    shrink_over.extend(reference_blocks.as_ref().map(|blocks| over(REFERENCE, blocks)));
    let share = |gaps: [f64; 3]| share_of_ceiling(gaps, floor);
    let at_full_level = crossed.at(loudest.level());
    let expected = if are_long(&ready.held_out, loudest) {
        crossed.in_view_of(&ready.held_out, with_effect, loudest.level())
    } else {
        at_full_level
    };
    Gap {
        as_given,
        refit: bounded,
        within_limits: linear(&|| of(within, &[])).gap(),
        free_refit: free_blocks.gap(),
        with_effect,
        noise_floor: floor,
        shrink: gap::shrink(as_given, with_effect, floor),
        shrink_ci95: gap::drawn([&given, &with], |[given, with]| gap::shrink(given, with, floor)),
        shrink_over_refit: gap::shrink(bounded, with_effect, floor),
        placebo_shrink: gap::shrink(as_given, reference_gap, floor) - gap::shrink(as_given, bounded, floor),
        shrink_over,
        share_of_ceiling: share([as_given, with_effect, ceiling_blocks.gap()]),
        share_of_ceiling_ci95: gap::drawn([&given, &with, &ceiling_blocks], share),
        crossed_gap: at_full_level.gap,
        predicted_held_out_gap: expected.gap,
        predicted_ci80: expected.ci80,
        measured_on: opened.iter().map(|r| r.name.clone()).collect(),
        measured_on_fitted: ready.held_out.is_empty(),
    }
}

/// Returns the gaps of free runs, unless a run diverged.
fn unless_diverged(blocks: Blocks) -> Option<Blocks> {
    blocks.gap().is_finite().then_some(blocks)
}

/// Returns the ratio of the gap that the effects close to the gap that a flexible model closes. The arguments are the
/// gaps as given, with the effects and of the flexible model.
fn share_of_ceiling([given, with, most]: [f64; 3], floor: f64) -> f64 {
    let most = gap::shrink(given, most, floor);
    if most > 0.0 { (gap::shrink(given, with, floor) / most).clamp(0.0, 1.0) } else { 1.0 }
}

/// Fits the linear simulation again with limits so wide that they hardly matter.
fn free_refit(quick: &Problem, limits: &Limits) -> Plant {
    let wide =
        Limits { frequency: 40.0 * limits.frequency, damping: 10.0 * limits.damping, shape: 40.0 * limits.shape };
    let free = Problem { nuisance: Nuisance::new(&quick.plant, &quick.records, &wide), ..quick.clone() };
    refit(&free, FREE_STEPS).plant
}

/// Returns the records that are opened after all fits: the held-out ones, or else the loudest.
pub(crate) fn opened<'e>(explained: &'e Explained) -> Vec<&'e Record> {
    let Explained { ready, .. } = explained;
    let Problem { records, settings, .. } = &ready.problem;
    if ready.held_out.is_empty() {
        vec![loudest(records, settings.case.same_level)]
    } else {
        ready.held_out.iter().collect()
    }
}

/// Returns the gap of noise with these RMS values on the opened records.
pub(crate) fn floor(explained: &Explained, rms: &[f64]) -> f64 {
    let opened = opened(explained);
    let measured: Vec<&[Vec<f64>]> = opened.iter().map(|record| record.y.as_slice()).collect();
    gap::floor_over(rms, &measured)
}

/// Returns the blocks of the measured outputs of records and of their free runs.
pub(crate) fn blocks(records: &[&Record], plant: &Plant, actions: &[Action]) -> Blocks {
    let each = records.iter().map(|record| Blocks::new(&record.y, &run(plant, actions, record), 0));
    Blocks::joined(each.collect()).expect("at least one record is opened")
}

/// The effort of fits for comparison only.
const ROUGH: Effort = Effort { steps: 4, gain: 1.0, fineness: Fineness::COARSE };

/// Fits a wrong effect with as many parameters, from the lower half of the screen, in another part of the signal path.
fn reference_effect(problem: &Problem, found: &Search) -> Option<(Plant, Vec<Action>)> {
    let first = found.best.effects.first()?;
    let wanted = first.parameters.len();
    let entries = found.stages.first()?;
    let entry = entries
        .iter()
        .skip(entries.len() / 2)
        .find(|entry| entry.placed.effect.side() != first.effect.side() && entry.placed.parameters.len() == wanted)?;
    let jacobian = problem.jacobian(&problem.plant);
    let fit = problem.fit(&jacobian, &vec![0.0; problem.nuisance.len()], std::slice::from_ref(&entry.placed), ROUGH);
    Some((problem.nuisance.apply(&problem.plant, &fit.eta), problem.actions(&fit.effects)))
}

/// Fits the flexible model: the best explanation with the entries that would explain most of the remainder.
fn ceiling(problem: &Problem, found: &Search) -> Option<(Plant, Vec<Action>)> {
    let JudgeSettings { ceiling_gain, ceiling_effects, .. } = problem.settings.judge;
    let mut effects = found.best.effects.clone();
    let more = found.stages.last()?.iter().filter(|entry| entry.gain > ceiling_gain).take(ceiling_effects);
    effects.extend(more.map(|entry| entry.placed.clone()));
    let jacobian = problem.jacobian(&problem.nuisance.apply(&problem.plant, &found.best.eta));
    let fit = problem.fit(&jacobian, &found.best.eta, &effects, ROUGH);
    Some((problem.nuisance.apply(&problem.plant, &fit.eta), problem.actions(&fit.effects)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::case::record::Channels;
    use crate::effects::{CubicStiffness, Effect, Place};
    use crate::prepare::tests::setting_of;
    use crate::prepare::{Known, prepare};
    use crate::simulate::simulate;
    use crate::testing;

    /// With a real plant that deviates in many small ways (frequencies, damping ratios, a sensor gain, a clearance
    /// and a delay) in addition to one large spring, the spring is named first and the remainder is stated as well.
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

    /// The free run follows a record that begins in motion from its start, even with a stiffening spring.
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
        // The spring stiffens until the gap exceeds one fifth.
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
