//! Separability: whether these records can distinguish two explanations.
//!
//! [`crate::search::overlap`] answers to first order, before any fit. Here each rival is fitted, together with the
//! linear parameters, to the noise-free prediction of the same records by the best explanation. The part that the
//! rival cannot follow gives the difference in log likelihood that these records are expected to make ([`rivals`]).
//!
//! A cosine alone is misleading, because the product of the energy and the remaining share counts. The energy of a
//! gap of a few per cent is some ten thousand times that of the noise of a sample.

use rayon::prelude::*;

use crate::case::record::Record;
use crate::fit::candidate::{Candidate, all_same};
use crate::fit::problem::{Effort, Fit, Jacobian, Placed, Problem};
use crate::settings::JudgeSettings;
use crate::simulate::Fineness;

/// The effort of a fit of a rival. The fit need not be more accurate than the comparison.
const NEARLY: Effort = Effort { steps: 6, gain: 0.2, fineness: Fineness::COARSE };

/// Records as an explanation predicts them, without noise, and the fit of the explanation to them.
pub struct Predicted<'a> {
    /// The problem with simulated outputs.
    pub problem: Problem,
    /// The explanation as it was fitted to the measured records.
    pub truth: Fit<'a>,
    jacobian: Jacobian,
    /// The explanation's own cost on its prediction.
    own: f64,
}

impl<'a> Predicted<'a> {
    /// Predicts the records by `truth`, which is a fit to `problem`.
    pub fn new(problem: &Problem, truth: &Fit<'a>) -> Self {
        let problem = predicted(problem, &truth.eta, &truth.effects);
        let jacobian = problem.jacobian(&problem.nuisance.apply(&problem.plant, &truth.eta));
        // The linear parameters of the truth are pulled towards their prior, as those of a rival are.
        let own = problem.fit(&jacobian, &truth.eta, &truth.effects, NEARLY).cost;
        Self { problem, truth: truth.clone(), jacobian, own }
    }

    /// Fits another explanation to the prediction.
    pub fn fit(&self, effects: &[Placed<'a>]) -> Fit<'a> {
        self.problem.fit(&self.jacobian, &self.truth.eta, effects, NEARLY)
    }

    /// Returns the difference in log likelihood that the records are expected to make between the explanation that
    /// predicted them and another one that was fitted to the prediction.
    pub fn expected(&self, fit: &Fit) -> f64 {
        (0.5 * (fit.cost - self.own)).max(0.0)
    }
}

/// Returns the problem with the outputs of a linear model with effects in place of the measured ones. Missing samples
/// stay missing.
pub(crate) fn predicted(problem: &Problem, eta: &[f64], effects: &[Placed]) -> Problem {
    let plant = problem.nuisance.apply(&problem.plant, eta);
    let actions = problem.actions(effects);
    let simulated = |(index, record): (usize, &Record)| {
        let mut y = problem.outputs(&plant, eta, &actions, index, Fineness::COARSE);
        for (to, measured) in y.iter_mut().flatten().zip(record.y.iter().flatten()) {
            if !measured.is_finite() {
                *to = *measured;
            }
        }
        Record { y, ..record.clone() }
    };
    let records = problem.records.iter().enumerate().map(simulated).collect();
    Problem { records, ..problem.clone() }
}

/// An explanation that is compared with the best one.
pub struct Rival<'a> {
    /// Its effects as they were fitted to the records.
    pub effects: Vec<Placed<'a>>,
    /// Its fit to the prediction of the best explanation.
    pub fit: Fit<'a>,
    /// Expected difference in log likelihood on the records in hand, if the best explanation is true.
    pub expected: f64,
    /// The difference on the measured records.
    pub realised: f64,
}

/// Returns the candidates that are nearest to the best explanation, compared with it. The explanation without effects
/// has no rivals, because each candidate contains it. `best` are the effects of the best explanation, without a free
/// shape.
pub fn rivals<'a>(predicted: &Predicted<'a>, best: &[Placed], candidates: &[Candidate<'a>]) -> Vec<Rival<'a>> {
    let Some(own) = candidates.iter().find(|candidate| all_same(&candidate.effects, best)) else { return Vec::new() };
    if best.is_empty() {
        return Vec::new();
    }
    let JudgeSettings { compared_within, compared, .. } = predicted.problem.settings.judge;
    let realised = |candidate: &Candidate| 0.5 * (candidate.cost - own.cost);
    let mut near: Vec<&Candidate> = Vec::new();
    for candidate in candidates {
        let seen = near.iter().chain([&own]).any(|other| all_same(&other.effects, &candidate.effects));
        if !seen && !candidate.effects.is_empty() && realised(candidate) < compared_within && near.len() < compared {
            near.push(candidate);
        }
    }
    near.into_par_iter()
        .map(|candidate| {
            let fit = predicted.fit(&candidate.effects);
            Rival {
                effects: candidate.effects.clone(),
                expected: predicted.expected(&fit),
                realised: realised(candidate),
                fit,
            }
        })
        .collect()
}

/// Returns the rivals that the records cannot separate from the best explanation: neither the expected nor the
/// realised difference is large enough. A rival with fewer effects has been refuted by the search, and one with more
/// is not another cause.
pub fn open<'r, 'a>(
    rivals: &'r [Rival<'a>],
    best: &[Placed],
    settings: &JudgeSettings,
) -> impl Iterator<Item = &'r Rival<'a>> {
    let effects = best.len();
    // An expected difference D scatters by the root of 2 D.
    let separable = settings.separable;
    let refuted = separable + 2.0 * (2.0 * separable).sqrt();
    rivals
        .iter()
        .filter(move |rival| rival.effects.len() == effects)
        .filter(move |rival| rival.expected < separable && rival.realised < refuted)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::case::Limits;
    use crate::effects::{Clearance, CubicStiffness, Effect, Place, SensorDrift, SensorOffset};
    use crate::fit::problem::{dot, sum_of_squares};
    use crate::noise::NoiseModel;
    use crate::prepare::{Known, prepare};
    use crate::search::overlap::{Overlap, overlap};
    use crate::testing;

    /// Returns a problem with white noise and records of a sound simulation, and the standard deviation of the noise.
    fn problem(limits: &Limits, samples: usize) -> (Problem, f64) {
        let model = testing::truss(8);
        let case = testing::case(&model, &model);
        let known = Known { limits: *limits, ..Known::default() };
        let mut records = case.records[1..].to_vec();
        records.iter_mut().for_each(|record| record.start_s -= case.records[1].start_s);
        let ready = prepare(case.model.as_ref().unwrap(), &records, &known).unwrap();
        let std = case.model.unwrap().noise.sensor_std.unwrap();
        let noise = NoiseModel::declared(&ready.problem.plant, &std, &[0.0; 2]);
        (ready.problem.head(samples, &noise), std[0])
    }

    fn at<'a>(effect: &'a dyn Effect, place: Place, parameters: &[f64]) -> Placed<'a> {
        Placed { effect, place, parameters: parameters.to_vec() }
    }

    fn fit<'a>(problem: &Problem, placed: &Placed<'a>) -> Fit<'a> {
        let jacobian = problem.jacobian(&problem.plant);
        problem.fit(&jacobian, &vec![0.0; problem.nuisance.len()], std::slice::from_ref(placed), NEARLY)
    }

    /// Returns the change of the whitened outputs of the simulation as given that an effect causes.
    fn trace(problem: &Problem, placed: &Placed) -> Vec<f64> {
        let zero = vec![0.0; problem.nuisance.len()];
        let run = |effects: &[Placed]| problem.residual(&problem.plant, &zero, effects, Fineness::COARSE);
        run(&[]).iter().zip(&run(std::slice::from_ref(placed))).map(|(a, b)| a - b).collect()
    }

    /// A constant follows a straight line except for its slope: the remaining squares sum to N (N^2 - 1) / 12 samples
    /// squared.
    #[test]
    fn an_offset_follows_a_drift_as_far_as_a_mean_follows_a_line() {
        const N: usize = 2048;
        let (mut problem, std) = problem(&Limits { frequency: 1e-9, damping: 1e-9, shape: 1e-9 }, N);
        problem.records.truncate(1);
        problem.whiteners.truncate(1);
        let per_sample = 1e-4 * std;
        let drift = at(&SensorDrift, Place::Output(0), &[per_sample * testing::RATE]);
        let offset = at(&SensorOffset, Place::Output(0), &[std]);
        let truth = fit(&problem, &drift);
        let truth = Fit { effects: vec![drift.clone()], ..truth };
        let predicted = Predicted::new(&problem, &truth);
        let n = N as f64;
        let expected = 0.5 * (per_sample / std).powi(2) * n * (n * n - 1.0) / 12.0;
        let found = predicted.expected(&predicted.fit(std::slice::from_ref(&offset)));
        assert!((found / expected - 1.0).abs() < 1e-3, "{found} for {expected}");
        // Both are linear in their sizes, so the result is known before any fit.
        let traces = [trace(&problem, &drift), trace(&problem, &offset)];
        let before = overlap(&problem, &problem.jacobian(&problem.plant), &traces).unwrap();
        assert!((before.expected[(0, 1)] / expected - 1.0).abs() < 1e-3, "{:?} for {expected}", before.expected);
        // Nothing is expected to separate a truth from itself.
        assert!(predicted.expected(&predicted.fit(&[drift])) < 1e-6);
    }

    /// Compares a cubic stiffness that makes this relative gap with a clearance. Returns the cosine, the expected
    /// difference to first order and after a fit, and whether the question is open.
    fn cubic_and_clearance(gap: f64) -> (f64, f64, f64, bool) {
        let (mut problem, _) = problem(&Limits::default(), 2000);
        let input = Place::Input(0);
        let mut cubic = at(&CubicStiffness, input.clone(), &CubicStiffness.starts(&problem.setting, &input)[0]);
        let zero = vec![0.0; problem.nuisance.len()];
        let bare = predicted(&problem, &zero, &[]);
        let share = |with: &Problem| {
            let (mut error, mut output) = (0.0, 0.0);
            for (a, b) in bare.records.iter().zip(&with.records) {
                for (a, b) in a.y.iter().flatten().zip(b.y.iter().flatten()) {
                    error += (a - b) * (a - b);
                    output += a * a;
                }
            }
            f64::sqrt(error / output)
        };
        for _ in 0..4 {
            cubic.parameters[0] *= gap / share(&predicted(&problem, &zero, std::slice::from_ref(&cubic)));
        }
        let with = predicted(&problem, &zero, std::slice::from_ref(&cubic));
        for ((record, bare), with) in problem.records.iter_mut().zip(&bare.records).zip(&with.records) {
            let each = record.y.iter_mut().flatten().zip(bare.y.iter().flatten()).zip(with.y.iter().flatten());
            each.for_each(|((y, bare), with)| *y += with - bare);
        }
        let best = fit(&problem, &cubic);
        // Clearances of all initial widths, with the size adapted to the cubic stiffness.
        let jacobian = problem.jacobian(&problem.plant);
        let starts = Clearance.starts(&problem.setting, &input);
        let own = trace(&problem, &cubic);
        let mut fits: Vec<(Overlap, Fit)> = starts
            .iter()
            .map(|start| {
                let mut clearance = at(&Clearance, input.clone(), start);
                let other = trace(&problem, &clearance);
                clearance.parameters[0] *= dot(&own, &other) / sum_of_squares(&other);
                let overlap = overlap(&problem, &jacobian, &[own.clone(), other]).unwrap();
                (overlap, fit(&problem, &clearance))
            })
            .collect();
        fits.sort_by(|a, b| a.1.cost.total_cmp(&b.1.cost));
        let (overlap, rival) = fits.remove(0);
        let candidate =
            |fit: &Fit<'static>| Candidate { effects: fit.effects.clone(), cost: fit.cost, priced: fit.cost };
        let held = Predicted::new(&problem, &best);
        let near = rivals(&held, &best.effects, &[candidate(&best), candidate(&rival)]);
        let is_open = open(&near, &best.effects, &JudgeSettings::default()).next().is_some();
        let expected = held.expected(&held.fit(&rival.effects));
        (overlap.cosine[(0, 1)], overlap.expected[(0, 1)], expected, is_open)
    }

    /// The two are close in angle at any size, and only a large gap separates them.
    #[test]
    fn a_gap_parts_what_a_cosine_does_not() {
        for (gap, parted) in [(0.0003, false), (0.01, true)] {
            let (cosine, before, expected, is_open) = cubic_and_clearance(gap);
            // A clearance of free width comes nearer than one with the width from the screen.
            assert!(before > expected, "{gap}: {before} {expected}");
            assert!(cosine > 0.9, "{gap}: {cosine}");
            assert_eq!(
                (is_open, expected > JudgeSettings::default().separable),
                (!parted, parted),
                "{gap}: {expected} expected"
            );
        }
    }
}
