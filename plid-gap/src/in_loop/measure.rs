//! The gaps on records that were not used for any fit.

use crate::case::Case;
use crate::case::levels::loudest;
use crate::case::record::{Channels, Record};
use crate::error::GapError;
use crate::fit::problem::Placed;
use crate::in_loop::LoopGap;
use crate::in_loop::judge::Judged;
use crate::in_loop::noise::Noise;
use crate::in_loop::problem::Problem;
use crate::in_loop::runs::Runs;
use crate::in_loop::search::Found;
use crate::judge::crossed::Stated;
use crate::judge::gap::{self, Blocks};
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
pub(super) struct Measured {
    /// The held-out records, or the loudest fitted one if nothing is held out.
    pub records: Vec<Record>,
    /// Outputs of the simulator as given.
    pub given: Vec<Channels>,
    /// Outputs of the simulator with the best explanation.
    pub with: Vec<Channels>,
    /// The gaps.
    pub gap: LoopGap,
    /// For each effect, the share of the squared gap that it closes in the presence of the others.
    pub shares: Vec<Option<f64>>,
}

impl<'a> Opened<'_, 'a> {
    /// Measures the gaps.
    pub fn measure(&self, runs: &mut Runs, found: &Found<'a>, judged: &Judged) -> Result<Measured, GapError> {
        let best = &found.fits[0];
        let loud = loudest(&self.problem.records, self.case.config.settings.case.same_level);
        // The gap is predicted from the fitted records before any other record is used.
        let stated = gap::expected(&self.problem.records, &best.simulated, loud.level());
        let mut records: Vec<Record> = self.held_out.iter().filter(|record| record.is_driven()).cloned().collect();
        if records.is_empty() {
            records = vec![loud.clone()];
        }
        let mut run = |effects: &[Placed<'a>], eta: &[f64]| -> Result<Vec<Channels>, GapError> {
            let all = self.problem.with_nuisances(effects, eta);
            let asked: Vec<(&[Placed], &Record)> = records.iter().map(|record| (all.as_slice(), record)).collect();
            let done = runs.simulate_all(&self.problem.setting, &asked);
            Ok(done.into_iter().collect::<Result<_, _>>()?)
        };
        let given = run(&[], &vec![0.0; self.problem.nuisances.len()])?;
        let refit = run(&[], &found.refit.eta)?;
        let with = if judged.verdict == Verdict::None { refit.clone() } else { run(&best.effects, &best.eta)? };
        let mut without = Vec::new();
        if judged.verdict == Verdict::Effects {
            for k in 0..best.effects.len() {
                let others: Vec<Placed> = [&best.effects[..k], &best.effects[k + 1..]].concat();
                without.push(run(&others, &best.eta)?);
            }
        }
        let measured: Vec<&[Vec<f64>]> = records.iter().map(|record| record.y.as_slice()).collect();
        let floor = gap::floor_over(&self.noise.std, &measured);
        let width = self.case.config.settings.in_loop.prediction_width;
        let stated = Stated { gap: stated, ci80: [(1.0 - width) * stated, (1.0 + width) * stated] };
        let gap = gaps(&records, [&given, &refit, &with], floor, stated);
        let beyond = |gap: f64| (gap * gap - floor * floor).max(0.0);
        let whole = beyond(gap.refit).max(f64::MIN_POSITIVE);
        let of = |y: &Vec<Channels>| blocks(&records, y).map_or(0.0, |blocks| blocks.gap());
        let share = |y: &Vec<Channels>| Some(((beyond(of(y)) - beyond(gap.with_effect)) / whole).clamp(0.0, 1.0));
        let shares = without.iter().map(share).collect();
        Ok(Measured { records, given, with, gap, shares })
    }
}

/// Returns the blocks of the squared errors of runs, joined over all records.
pub(super) fn blocks(records: &[Record], y: &[Channels]) -> Option<Blocks> {
    Blocks::joined(records.iter().zip(y).map(|(record, y)| Blocks::new(&record.y, y, 0)).collect())
}

/// Returns the gaps of the simulator as given, after the refit and with the effects.
fn gaps(records: &[Record], [given, refit, with]: [&[Channels]; 3], floor: f64, stated: Stated) -> LoopGap {
    let of = |y: &[Channels]| blocks(records, y).map_or(0.0, |blocks| blocks.gap());
    let (as_given, refit, with_effect) = (of(given), of(refit), of(with));
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
