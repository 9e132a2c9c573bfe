//! The gaps on records that were not used for any fit, and the choice of the simulation that is written.

use plid_report::percent;

use crate::case::Case;
use crate::case::levels::loudest;
use crate::case::record::{Channels, Record};
use crate::error::GapError;
use crate::fit::candidate::in_words;
use crate::fit::problem::Placed;
use crate::in_loop::LoopGap;
use crate::in_loop::judge::Judged;
use crate::in_loop::noise::Noise;
use crate::in_loop::problem::{Fit, Problem};
use crate::in_loop::runs::Runs;
use crate::in_loop::search::Found;
use crate::judge::crossed::{Crossed, Stated};
use crate::judge::gap::{self, Blocks};
use crate::judge::locate::Estimate;
use crate::judge::shares::closed_share;
use crate::judge::verdict::Verdict;

/// The case and its records, as they are known after the search.
pub(super) struct Opened<'o, 'a> {
    /// The case.
    pub case: &'o Case,
    /// The fitted records.
    pub problem: &'o Problem<'a>,
    /// The noise of the fitted records.
    pub noise: &'o Noise,
    /// The records that were held out.
    pub held_out: &'o [Record],
}

/// Runs on the records on which the gap is measured.
pub(super) struct Measured<'a> {
    /// The held-out records, or the loudest fitted one if nothing is held out.
    pub records: Vec<Record>,
    /// Outputs of the simulator as given.
    pub given: Vec<Channels>,
    /// Outputs of the simulator with the best explanation.
    pub with: Vec<Channels>,
    /// The gaps.
    pub gap: LoopGap,
    /// For each effect, the share of the squared gap that it closes in the presence of the others.
    pub shares: Vec<Estimate>,
    /// The simulation that is written and predicts.
    pub written: Fit<'a>,
    /// The evidence in sentences.
    pub evidence: Vec<String>,
}

impl<'a> Opened<'_, 'a> {
    /// Measures the gaps and chooses the simulation that is written. An explanation that predicts these records worse
    /// than the simulator without it is refused.
    pub fn measure(
        &self,
        runs: &mut Runs,
        found: &Found<'a>,
        judged: &mut Judged<'a>,
    ) -> Result<Measured<'a>, GapError> {
        let best = &found.fits[0];
        let records = self.opened();
        let mut run = |effects: &[Placed<'a>], eta: &[f64]| -> Result<Vec<Channels>, GapError> {
            let all = self.problem.with_nuisances(effects, eta);
            let asked: Vec<(&[Placed], &Record)> = records.iter().map(|record| (all.as_slice(), record)).collect();
            let done = runs.simulate_all(&self.problem.setting, &asked);
            Ok(done.into_iter().collect::<Result<_, _>>()?)
        };
        let given = run(&[], &vec![0.0; self.problem.nuisances.len()])?;
        let refit = run(&[], &found.refit.eta)?;
        let with = if judged.verdict == Verdict::None { refit.clone() } else { run(&best.effects, &best.eta)? };
        let gaps = [&given, &refit, &with].map(|y| gap_of(&records, y));
        let mut evidence = Vec::new();
        if judged.verdict == Verdict::Effects && !self.follows(gaps) {
            judged.refuse(self.case.config.settings.judge.most_unknown);
            evidence.push(refusal(&in_words(&best.effects, &self.problem.setting.names), &records, gaps));
        }
        let mut without = Vec::new();
        if judged.verdict == Verdict::Effects {
            for k in 0..best.effects.len() {
                let others: Vec<Placed> = [&best.effects[..k], &best.effects[k + 1..]].concat();
                // Without any effect, the parameters are those of the refit.
                without.push(if others.is_empty() { refit.clone() } else { run(&others, &best.eta)? });
            }
        }
        let written = self.written(runs, found, judged, gaps)?;
        let (stated, said) = self.stated(runs, &written);
        evidence.extend(said);
        let measured: Vec<&[Vec<f64>]> = records.iter().map(|record| record.y.as_slice()).collect();
        let floor = gap::floor_over(&self.noise.std, &measured);
        let gap = loop_gap(&records, [&given, &refit, &with], floor, stated);
        let shares = without.iter().filter_map(|y| share(&records, [y, &with, &refit], floor)).collect();
        Ok(Measured { records, given, with, gap, shares, written, evidence })
    }

    /// Returns the records on which the gaps are measured.
    fn opened(&self) -> Vec<Record> {
        let driven: Vec<Record> = self.held_out.iter().filter(|record| record.is_driven()).cloned().collect();
        let loud = || loudest(&self.problem.records, self.case.config.settings.case.same_level).clone();
        if driven.is_empty() { vec![loud()] } else { driven }
    }

    /// Returns whether the effects predict no worse than the simulator as given and than its refit.
    fn follows(&self, [given, refit, with]: [f64; 3]) -> bool {
        with <= self.case.config.settings.judge.no_worse * given.min(refit)
    }

    /// Returns the simulation that is written: the best explanation if it is the answer, and otherwise the refit or the
    /// simulator as given, whichever predicts better.
    fn written(
        &self,
        runs: &mut Runs,
        found: &Found<'a>,
        judged: &Judged,
        [given, refit, _]: [f64; 3],
    ) -> Result<Fit<'a>, GapError> {
        if judged.verdict == Verdict::Effects {
            return Ok(found.fits[0].clone());
        }
        if refit <= given {
            return Ok(found.refit.clone());
        }
        let none = vec![0.0; self.problem.nuisances.len()];
        let simulated = self.problem.simulate(runs, &[], &none)?;
        Ok(self.problem.as_is(Vec::new(), none, simulated))
    }

    /// Returns the gap to expect of a simulation on a record as loud as the loudest fitted one, and how it was found.
    /// Only fitted records enter.
    fn stated(&self, runs: &mut Runs, fit: &Fit<'a>) -> (Stated, Option<String>) {
        let (settings, records) = (&self.case.config.settings, &self.problem.records);
        let level = loudest(records, settings.case.same_level).level();
        // As given, no parameter was fitted to these records.
        if fit.effects.is_empty() && fit.eta.iter().all(|eta| *eta == 0.0) {
            return (Crossed::new(records, fit.simulated.clone(), None, &settings.judge).at(level), None);
        }
        let before = runs.calls().runs;
        if let Some(simulated) = self.problem.crossed(runs, fit, settings) {
            let count = runs.calls().runs - before;
            let said = format!(
                "The gap to expect on a further record follows from predictions of each fitted record by a fit to the \
                others ({count} runs); a record that is louder than all others is predicted in parts."
            );
            return (Crossed::new(records, simulated, None, &settings.judge).at(level), Some(said));
        }
        let (gap, width) = (gap::expected(records, &fit.simulated, level), settings.in_loop.prediction_width);
        let said = format!(
            "The gap to expect on a further record is that of the fitted records themselves, because predictions of \
            each by a fit to the others would take more runs than `crossed_calls` = {} and the bounds on all runs \
            allow. Its interval is therefore {} to either side.",
            settings.in_loop.crossed_calls,
            percent(width)
        );
        (Stated { gap, ci80: [(1.0 - width) * gap, (1.0 + width) * gap] }, Some(said))
    }
}

/// Says that an explanation is refused.
fn refusal(effects: &str, records: &[Record], [given, refit, with]: [f64; 3]) -> String {
    let names: Vec<&str> = records.iter().map(|record| record.name.as_str()).collect();
    format!(
        "{effects} explains the fitted records, but predicts {} with a gap of {}, where the simulator has {} as given \
        and {} with its parameters within their limits. It is therefore not written into sim-with-effect.json.",
        names.join(", "),
        percent(with),
        percent(given),
        percent(refit)
    )
}

/// Returns the blocks of the squared errors of runs, joined over all records.
pub(super) fn blocks(records: &[Record], y: &[Channels]) -> Option<Blocks> {
    Blocks::joined(records.iter().zip(y).map(|(record, y)| Blocks::new(&record.y, y, 0)).collect())
}

fn gap_of(records: &[Record], y: &[Channels]) -> f64 {
    blocks(records, y).map_or(0.0, |blocks| blocks.gap())
}

/// Returns the share of the squared gap that an effect closes, from runs without it, with it, and of the refit.
fn share(records: &[Record], runs: [&Vec<Channels>; 3], floor: f64) -> Option<Estimate> {
    let [without, with, refit] = runs.map(|y| blocks(records, y));
    Some(closed_share([&without?, &with?, &refit?], floor))
}

/// Returns the gaps of the simulator as given, after the refit and with the effects.
fn loop_gap(records: &[Record], [given, refit, with]: [&[Channels]; 3], floor: f64, stated: Stated) -> LoopGap {
    let [as_given, refit, with_effect] = [given, refit, with].map(|y| gap_of(records, y));
    let shrink_ci95 = match (blocks(records, given), blocks(records, with)) {
        (Some(given), Some(with)) => gap::drawn([&given, &with], |[given, with]| gap::shrink(given, with, floor)),
        _ => [0.0; 2],
    };
    LoopGap {
        as_given,
        refit,
        with_effect,
        noise_floor: floor,
        shrink: gap::shrink(as_given, with_effect, floor),
        shrink_ci95,
        shrink_over_refit: gap::shrink(refit, with_effect, floor),
        predicted_held_out_gap: stated.gap,
        predicted_ci80: stated.ci80,
        measured_on: records.iter().map(|record| record.name.clone()).collect(),
    }
}
