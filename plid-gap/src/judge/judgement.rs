//! The judgement of an explanation on all records, including those held out: its gaps, the probabilities of all
//! explanations, and the verdict.

use crate::case::CaseConfig;
use crate::case::levels::loudest;
use crate::case::record::{Channels, Record, rms};
use crate::effects::Action;
use crate::fit::free_run::run;
use crate::fit::refit::clipped;
use crate::judge::crossed::are_like;
use crate::judge::explained::Explained;
use crate::judge::family::with_kin;
use crate::judge::gap::{self, Blocks};
use crate::judge::held_out::{HeldOut, held_out};
use crate::judge::lacking_states::{LackingStates, lacking_states};
use crate::judge::record_scatter::widened;
use crate::judge::shares::{Share, shares};
use crate::judge::shrink::{Gap, blocks, gaps, opened};
use crate::judge::stochastic_gap::{shown, squared_gap};
use crate::judge::verdict::{Verdict, Weighted, outside, weigh};
use crate::judge::written::Follows;
use crate::plant::Plant;
use crate::prepare::STANDS;
use crate::search::rules::Rules;
use crate::search::stochastic::Stochastic;
use crate::settings::JudgeSettings;
use crate::settings::step::Step;

/// A judged explanation.
pub struct Judgement<'j, 'a> {
    /// The linear simulation after the fit of the explanation.
    pub plant: Plant,
    /// The actions of its effects.
    pub actions: Vec<Action>,
    /// Gaps on the records that are opened at the end.
    pub gaps: Gap,
    /// The evidence of the held-out records; `None` if there are none or if the explanation has no effects.
    pub held_out: Option<HeldOut>,
    /// Its free runs of the opened records.
    pub simulated: Blocks,
    /// The share of each of its effects.
    pub shares: Vec<Share>,
    /// Stochastic effects that enter the answer.
    pub shown: Vec<&'j Stochastic<'a>>,
    /// The squared gap that each of them makes.
    pub squared_gaps: Vec<f64>,
    /// All explanations with their probabilities, the most probable first.
    pub weighted: Vec<Weighted<'a>>,
    /// The verdict.
    pub verdict: Verdict,
    /// Probability before calibration that nothing is missing, if that is the verdict; otherwise that of "something
    /// else".
    pub before: f64,
    /// The gap that the simulation as given leaves in the fitted records, if fits of the explanation to some of them
    /// predict the others much worse.
    pub predicted_as_given: Option<f64>,
    /// The model that follows the opened records and is written.
    pub follows: Follows,
    /// The states that the simulation lacks, if no effect explains the records as well as further states do.
    pub lacking: Option<LackingStates>,
}

impl<'j, 'a> Judgement<'j, 'a> {
    /// Judges an explanation. `stochastic` are the stochastic effects that were found.
    pub fn new(
        explained: &Explained<'a>,
        stochastic: &'j [Stochastic<'a>],
        rules: &Rules,
        config: &CaseConfig,
    ) -> Self {
        let Explained { ready, refitted, found, .. } = explained;
        let (problem, best) = (&ready.problem, &found.best.effects);
        let plant = problem.nuisance.apply(&problem.plant, &explained.fit().eta);
        let actions = problem.actions(&explained.predicting().effects);
        // A refit beyond the stated limits may imitate the effect itself.
        let bounded = clipped(problem, &refitted.eta).map(|eta| problem.nuisance.apply(&problem.plant, &eta));
        let bounded = bounded.as_ref().unwrap_or(&refitted.plant);
        let mut gaps = gaps(explained, &plant, &actions, bounded, &config.nuisance);
        let predicted_as_given = predicted_as_given(explained, gaps.crossed_gap);
        let held_out =
            if best.is_empty() { None } else { held_out(&ready.held_out, &ready.noise, bounded, &plant, &actions) };
        let lacking = lacking_states(explained, &gaps, config.material);
        let simulated = blocks(&opened(explained), &plant, &actions);
        let shares = shares(explained, &simulated, bounded);
        // Against a model that the inputs do not determine, several laws may explain the same few harmonics.
        let unsure = predicted_as_given.is_some() || ready.undetermined && !best.is_empty();
        let least = if lacking.is_some() || unsure && gaps.as_given >= config.material {
            problem.settings.judge.most_unknown
        } else {
            0.0
        };
        let unknown = match lacking {
            Some(_) => explained.judged.unknown,
            None => unknown(explained, &gaps, &shares, held_out, config.material),
        };
        let mut weighted = weigh(
            &found.candidates,
            unknown.max(least),
            problem.values(),
            explained.level,
            &problem.settings,
            &ready.off,
        );
        let (shown, squared_gaps) = acting(explained, stochastic, rules, config.material);
        for explanation in weighted.iter_mut().filter(|w| !w.unknown) {
            explanation.effects.extend(shown.iter().map(|u| u.placed.clone()));
        }
        let verdict = verdict(explained, &weighted, &squared_gaps, &gaps, bounded, config.material);
        if verdict == Verdict::None && weighted.first().is_some_and(|top| top.unknown) {
            put_nothing_first(&mut weighted, &problem.settings.judge);
        }
        let explains = is_written(verdict, &weighted) && predicted_as_given.is_none();
        let follows = Follows::chosen(explained, &mut gaps, explains);
        gaps.predicted_ci80 = widened(explained, &gaps, &shown, &squared_gaps);
        let before = before(verdict, &weighted);
        Self {
            plant,
            actions,
            gaps,
            held_out,
            simulated,
            shares,
            shown,
            squared_gaps,
            weighted,
            verdict,
            before,
            predicted_as_given,
            follows,
            lacking,
        }
    }
}

/// Returns the gap that the simulation as given leaves in the fitted records, if fits of the effects to some of them
/// predict the others much worse. The records do not determine such effects, however well they fit all of them.
fn predicted_as_given(explained: &Explained, crossed_gap: f64) -> Option<f64> {
    let Explained { ready, found, .. } = explained;
    if found.best.effects.is_empty() {
        return None;
    }
    let (records, settings) = (&ready.problem.records, &ready.problem.settings);
    let simulated: Vec<_> = records.iter().map(|record| run(ready.as_given(), &[], record)).collect();
    let as_given = gap::expected(records, &simulated, loudest(records, settings.case.same_level).level());
    (settings.judge.outdone * crossed_gap > as_given).then_some(as_given)
}

/// Returns the stochastic effects that enter the answer, with the squared gap that each of them makes. Quiet records
/// are evidence that is independent of free runs.
fn acting<'j, 'a>(
    explained: &Explained<'a>,
    stochastic: &'j [Stochastic<'a>],
    rules: &Rules,
    material: f64,
) -> (Vec<&'j Stochastic<'a>>, Vec<f64>) {
    let shown = shown(explained, stochastic, rules).into_iter().map(|u| (u, squared_gap(explained, u)));
    // If the simulation is off in many small ways, a stochastic effect as small as these is not a cause.
    let least = if explained.ready.widened.is_some() { material.powi(2) } else { 0.0 };
    shown.filter(|(_, squared)| *squared >= least).unzip()
}

/// Returns the probability that nothing is missing, if that is the verdict; otherwise that of "something else".
fn before(verdict: Verdict, weighted: &[Weighted]) -> f64 {
    let is = |w: &&Weighted| match verdict {
        Verdict::None => !w.unknown && w.effects.is_empty(),
        _ => w.unknown,
    };
    weighted.iter().filter(is).map(|w| w.probability).sum()
}

/// Returns whether the effects of an explanation may be written, provided that they predict well. An effect that causes
/// an immaterial gap is not named, but it is part of the prediction.
fn is_written(verdict: Verdict, weighted: &[Weighted]) -> bool {
    verdict != Verdict::None || weighted.first().is_some_and(|top| !top.effects.is_empty())
}

/// Returns the probability of something else in view of the held-out records. An effect that does not simulate them
/// better than a refit alone does not act there.
fn unknown(explained: &Explained, gaps: &Gap, shares: &[Share], held_out: Option<HeldOut>, material: f64) -> f64 {
    let Explained { ready, found, judged, .. } = explained;
    let settings = &ready.problem.settings.judge;
    let fails = !ready.off.contains(&Step::HeldOutVeto) && held_out.is_some_and(|held_out| held_out.refutes(settings));
    let imperfect = ready.widened.is_some() && !found.best.effects.is_empty();
    // Effects that widen the gap on the held-out records by a material amount explain nothing, however well they fit
    // the other records.
    let grown =
        !found.best.effects.is_empty() && gaps.with_effect.powi(2) - gaps.within_limits.powi(2) > material.powi(2);
    // Held-out records that are as loud as the fitted ones measure the remainder better than these do: in the fitted
    // records, a change over time may hardly have begun.
    let loudest = loudest(&ready.problem.records, ready.problem.settings.case.same_level);
    let told = are_like(&ready.held_out, loudest, ready.problem.settings.case.same_level)
        && explained.refused.is_empty()
        && explained.unpredicted.is_none();
    match (fails || grown, imperfect) {
        (true, _) => settings.most_unknown.max(judged.unknown),
        (false, true) if makes_most(gaps, shares, settings) => {
            judged.unknown.min(outside(gaps.left_of_given(), settings))
        }
        (false, true) if told => outside(gaps.left(), settings),
        (false, true) => judged.unknown.max(outside(gaps.left(), settings)),
        (false, false) => judged.unknown,
    }
}

/// Returns whether one effect by itself makes most of the gap as given, and little of that gap is left. A refit may
/// close as much as a cause that it imitates.
fn makes_most(gaps: &Gap, shares: &[Share], settings: &JudgeSettings) -> bool {
    let least = settings.most_left * gaps.beyond_noise(gaps.as_given);
    gaps.left_of_given() < settings.given_left && shares.iter().any(|share| share.made.sqrt() > least)
}

/// Moves the probability of something else, except its least value, to "nothing is missing". This applies if the gap
/// is immaterial.
fn put_nothing_first(weighted: &mut Vec<Weighted>, settings: &JudgeSettings) {
    let Some(unknown) = weighted.iter_mut().find(|explanation| explanation.unknown) else { return };
    let moved = (unknown.probability - settings.least_unknown).max(0.0);
    unknown.probability -= moved;
    match weighted.iter_mut().find(|explanation| !explanation.unknown && explanation.effects.is_empty()) {
        Some(nothing) => nothing.probability += moved,
        None => weighted.push(Weighted { effects: Vec::new(), unknown: false, probability: moved, cost: None }),
    }
    weighted.sort_by(|a, b| b.probability.total_cmp(&a.probability));
}

/// Returns whether the first explanation with effects, together with those that differ from it only in other members
/// of the same families, is more probable than this value.
fn kin_is_more_probable(weighted: &[Weighted], probability: f64) -> bool {
    let first = weighted.iter().find(|w| !w.unknown);
    first.is_some_and(|first| !first.effects.is_empty() && with_kin(&first.effects, weighted) > probability)
}

/// Returns the gap of a simulation beyond the noise on the opened records, relative to the motion of the outputs: both
/// the measured and the simulated outputs are taken without their means. A constant, such as the position about which a
/// valve works, may be much larger than its motion. The noise counts with twice the uncertainty of its level.
fn gap_of_motion(explained: &Explained, plant: &Plant) -> f64 {
    let opened = opened(explained);
    let size = |channels: &dyn Fn(&Record) -> Vec<f64>| {
        rms(opened.iter().flat_map(|record| channels(record)).filter(|y| y.is_finite()))
    };
    // An output that stands still has no motion beside which an error could be small.
    let moves = |o: &usize| {
        let moving = size(&|record| gap::motion(&record.y[*o..=*o], &record.y[*o..=*o]).concat());
        moving > STANDS * size(&|record| record.y[*o].clone())
    };
    let moving: Vec<usize> = (0..plant.p).filter(moves).collect();
    let of = |channels: &[Vec<f64>]| -> Channels { moving.iter().map(|&o| channels[o].clone()).collect() };
    let noise: Vec<f64> = moving.iter().map(|&o| explained.noise_rms()[o]).collect();
    let measured: Vec<Channels> = opened.iter().map(|record| of(&gap::motion(&record.y, &record.y))).collect();
    let of_record =
        |(record, y): (&&Record, &Channels)| Blocks::new(y, &of(&gap::motion(&run(plant, &[], record), &record.y)), 0);
    if moving.is_empty() {
        return 0.0;
    }
    let blocks = Blocks::joined(opened.iter().zip(&measured).map(of_record).collect());
    let channels: Vec<&[Vec<f64>]> = measured.iter().map(Vec::as_slice).collect();
    let floor = gap::floor_over(&noise, &channels).powi(2) * (1.0 + 2.0 * explained.level.uncertainty);
    blocks.map_or(0.0, |blocks| (blocks.gap().powi(2) - floor).max(0.0).sqrt())
}

/// Chooses the verdict. `within` is the simulation within its limits.
fn verdict(
    explained: &Explained,
    weighted: &[Weighted],
    squared_gaps: &[f64],
    gaps: &Gap,
    within: &Plant,
    material: f64,
) -> Verdict {
    let ready = &explained.ready;
    // A gap is immaterial if it is small beside the outputs and beside their motion.
    let is_small = |gap: f64, plant: &Plant| gap < material && gap_of_motion(explained, plant) < material;
    let within = ready.best_linear.as_ref().unwrap_or(within);
    // If the simulation within its limits leaves less than a material gap, and stochastic effects make less than one,
    // nothing material is missing, whatever would close the rest.
    let noise: f64 = squared_gaps.iter().sum();
    let immaterial = ready.widened.is_some()
        && noise < material * material
        && is_small(gaps.beyond_noise(gaps.within_limits), within);
    match weighted.first() {
        Some(_) if immaterial => Verdict::None,
        Some(top) if top.unknown && !kin_is_more_probable(weighted, top.probability) => Verdict::Unknown,
        Some(top) if !top.unknown && top.effects.is_empty() => Verdict::None,
        // Stochastic effects are not part of the gap, so they may matter although the gap is small.
        Some(_) if squared_gaps.is_empty() && is_small(gaps.as_given, ready.as_given()) => Verdict::None,
        Some(_) => Verdict::Effects,
        None => Verdict::Unknown,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_immaterial_gap_is_nothing() {
        let settings = JudgeSettings::default();
        let weighted = |probability: f64, unknown: bool| Weighted { effects: vec![], unknown, probability, cost: None };
        for mut all in [vec![weighted(0.6, true), weighted(0.4, false)], vec![weighted(1.0, true)]] {
            put_nothing_first(&mut all, &settings);
            assert!(!all[0].unknown && (all[0].probability - 1.0 + settings.least_unknown).abs() < 1e-12);
            assert!((all.iter().map(|one| one.probability).sum::<f64>() - 1.0).abs() < 1e-12);
        }
    }
}
