//! The part of an explanation's residual that can be predicted from the inputs.
//!
//! The residual of a sound simulation is noise: its own past predicts a part of it, and the inputs add nothing to
//! this prediction. A missing effect is a function of the inputs, so with the inputs the residual is predicted better
//! than from its past alone (Granger, *Econometrica* 37, 1969, 424). Two predictors of the next value are compared by
//! cross-validation over blocks of the records: a linear one of past residuals, and one that also has polynomials of
//! the inputs, the motion of the ports and the simulated outputs, as in a polynomial NARX model (Billings, *Nonlinear
//! System Identification*, 2013, chapter 2). A residual that is sampled much faster than it changes is predicted from
//! its own past, whatever its cause, so the prediction reaches further ahead in that case.

use nalgebra::{DMatrix, DVector};

use crate::case::record::{Channels, Record, rms};
use crate::effects::{Observation, Place};
use crate::fit::free_run::outputs;
use crate::fit::problem::{Fit, Placed, Problem};
use crate::judge::gap;
use crate::judge::growth::{differ, exponent};
use crate::plant::Plant;
use crate::prepare::port_motion;
use crate::settings::JudgeSettings;

/// Smallest and largest number of past values of the residual from which the next one is predicted. Between these
/// limits, the number is the order of the simulation.
const PAST: [usize; 2] = [12, 40];

/// Steps of the prediction, in samples. The first step at which the past leaves enough of the residual is taken.
const STEPS: [usize; 7] = [1, 2, 4, 8, 16, 32, 64];

/// Share of the residual's power that its past must leave unpredicted.
const LEFT_BY_PAST: f64 = 0.1;

/// Delays of the inputs, in steps.
const INPUT_DELAYS: [usize; 2] = [0, 1];

/// Delays of the simulated outputs, in steps.
const OUTPUT_DELAYS: [usize; 4] = [0, 1, 3, 7];

/// Largest number of signals in the polynomials. Without the delayed ones, three inputs with ports and three outputs
/// give twelve signals, which have 258 polynomials. Sixteen signals have 440.
const MOST_SIGNALS: usize = 16;

/// Number of signals up to which delayed ones are added.
const ENOUGH_SIGNALS: usize = 9;

/// Largest number of samples that are used, over all records together.
const MOST_SAMPLES: usize = 8000;

/// Number of blocks. Each is predicted from the others.
const BLOCKS: usize = 8;

/// Smallest number of samples in a block, over the number of past values.
const SAMPLES_PER_PAST: usize = 3;

/// Penalties on the squared coefficients of the polynomials. The one that predicts best is taken.
const PENALTIES: [f64; 6] = [1e-4, 1e-3, 1e-2, 0.1, 1.0, 10.0];

/// Penalty on the other coefficients. It only keeps the equations regular.
const REGULAR: f64 = 1e-10;

/// The share of the innovations of a residual that the inputs predict: the relative reduction of the squared
/// prediction error by the inputs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Predictability {
    /// The share. It is below zero if the inputs only disturb the prediction.
    pub share: f64,
    /// Its standard deviation, from its scatter between the blocks.
    pub std: f64,
}

impl Predictability {
    /// Returns the share that the inputs may predict: the estimate plus two standard deviations.
    pub fn at_most(self) -> f64 {
        self.share.max(0.0) + 2.0 * self.std
    }
}

/// The residual of an explanation that counts as noise because the inputs do not predict it.
#[derive(Debug, Clone, PartialEq)]
pub struct Unpredicted {
    /// The share of its innovations that the inputs may predict: the largest over the outputs, or the mean weighted
    /// by the squared gaps.
    pub at_most: f64,
    /// Its RMS at each output, over all driven records.
    pub rms: Vec<f64>,
}

impl Unpredicted {
    /// Returns the residual of a fit, if the inputs do not predict it at any output and it is not so large that it
    /// would have been noticed as noise.
    pub fn of(problem: &Problem, fit: &Fit) -> Option<Self> {
        Self::if_at_most(problem, fit, |predicted, _| predicted.iter().copied().fold(0.0, f64::max))
    }

    /// Returns the residual of a fit, if the inputs predict little of it at those outputs that have most of its gap.
    pub fn for_the_most_part(problem: &Problem, fit: &Fit) -> Option<Self> {
        Self::if_at_most(problem, fit, |predicted, squares| {
            let all: f64 = squares.iter().sum();
            predicted.iter().zip(squares).map(|(share, square)| share * square / all.max(f64::MIN_POSITIVE)).sum()
        })
    }

    /// Returns the residual of a fit if the inputs predict little of it over all outputs, as `of_all` combines them.
    /// The arguments of `of_all` are the share that the inputs may predict at each output, and the squared gap of
    /// each output.
    fn if_at_most(problem: &Problem, fit: &Fit, of_all: impl Fn(&[f64], &[f64]) -> f64) -> Option<Self> {
        let settings = &problem.settings.judge;
        let simulated = outputs(problem, &fit.eta, &fit.effects);
        if gap::of_driven(&problem.records, &simulated) > settings.most_noise {
            return None;
        }
        let driven = || problem.records.iter().zip(&simulated).filter(|(record, _)| record.is_driven());
        let left = |o: usize| rms(driven().flat_map(|(record, simulated)| record.measured_error(o, &simulated[o])));
        let size = |o: usize| rms(driven().flat_map(|(record, _)| &record.y[o]).filter(|y| y.is_finite()));
        let sizes: Vec<f64> = (0..problem.plant.p).map(|o| size(o).max(f64::MIN_POSITIVE)).collect();
        let of_record = |(record, simulated): (&Record, &Channels)| {
            let at = |o: usize| rms(record.measured_error(o, &simulated[o])) / sizes[o];
            (record.level(), (0..sizes.len()).map(|o| at(o).powi(2)).sum::<f64>().sqrt())
        };
        let by_level: Vec<(f64, f64)> = driven().map(of_record).collect();
        if grows_with_level(&by_level, problem.settings.search.level_step, settings.noise_follows) {
            return None;
        }
        let plant = problem.nuisance.apply(&problem.plant, &fit.eta);
        let predicted: Vec<f64> =
            predictability(problem, &plant, &simulated)?.into_iter().map(Predictability::at_most).collect();
        let rms: Vec<f64> = (0..problem.plant.p).map(left).collect();
        let squares: Vec<f64> = rms.iter().zip(&sizes).map(|(rms, size)| (rms / size).powi(2)).collect();
        let at_most = of_all(&predicted, &squares);
        (at_most < settings.noise_predicted).then_some(Self { at_most, rms })
    }

    /// Returns the least probability of something else. It rises with the share that the inputs may predict.
    pub fn unknown(&self, settings: &JudgeSettings) -> f64 {
        let JudgeSettings { least_unknown, most_unknown, noise_predicted, .. } = *settings;
        let doubt = self.at_most / (self.at_most + noise_predicted);
        least_unknown + (most_unknown - least_unknown) * doubt
    }

    /// Returns whether this noise hides an effect: the steps of a converter that are smaller than the noise.
    pub fn hides(&self, placed: &Placed) -> bool {
        match (placed.effect.observed_in(), &placed.place) {
            (Observation::Quantisation, Place::Output(o)) => placed.parameters[0] < self.rms[*o],
            _ => false,
        }
    }
}

/// Returns whether a residual grows with the level of the inputs, from the level and the size of the residual in each
/// record: the levels differ by more than the factor `step`, and the exponent of the level is larger than `least`.
/// Noise does not depend on the level.
fn grows_with_level(records: &[(f64, f64)], step: f64, least: f64) -> bool {
    let levels = records.iter().map(|(level, _)| *level);
    let sizes = records.iter().map(|(_, size)| size.max(f64::MIN_POSITIVE));
    differ(levels.clone(), step) && exponent(levels.zip(sizes), 0.0).is_some_and(|exponent| exponent > least)
}

/// Returns the predictability of the residual of each output in the driven records; `None` if these are
/// too short.
fn predictability(problem: &Problem, plant: &Plant, simulated: &[Channels]) -> Option<Vec<Predictability>> {
    let past = problem.plant.seen_states().clamp(PAST[0], PAST[1]);
    let driven: Vec<Driven> = problem
        .records
        .iter()
        .zip(simulated)
        .filter(|(record, _)| record.is_driven())
        .map(|(record, simulated)| {
            let motion = port_motion(plant, &record.u);
            Driven { record, residual: record.error(simulated), motion, simulated }
        })
        .collect();
    (0..problem.plant.p).map(|o| of_output(&driven, o, past)).collect()
}

fn of_output(driven: &[Driven], output: usize, past: usize) -> Option<Predictability> {
    let each = MOST_SAMPLES / driven.len().max(1);
    let rows = |step: usize, all: bool| -> Vec<Row> {
        driven.iter().flat_map(|driven| driven.rows((output, past, step), each, all)).collect()
    };
    let (step, alone) = STEPS.into_iter().find_map(|step| {
        let blocks = blocks(&rows(step, false), past)?;
        let power: f64 = blocks.iter().map(|block| block.power).sum();
        let errors = errors(&blocks, past + 1, 0.0);
        (errors.iter().sum::<f64>() > LEFT_BY_PAST * power).then_some((step, errors))
    })?;
    compared(&alone, &blocks(&rows(step, true), past)?, past + 1)
}

/// A driven record with its simulation.
struct Driven<'r> {
    record: &'r Record,
    simulated: &'r Channels,
    /// Displacement and velocity at each port.
    motion: Channels,
    residual: Channels,
}

/// A value of the residual and its regressors: past values, a constant, and the polynomials.
struct Row {
    value: f64,
    regressors: Vec<f64>,
}

impl Driven<'_> {
    /// Returns the signals of the polynomials, each with its delay. Those without delay come first.
    fn signals(&self) -> Vec<(&[f64], usize)> {
        let mut signals: Vec<(&[f64], usize)> = Vec::new();
        for turn in 0..INPUT_DELAYS.len().max(OUTPUT_DELAYS.len()) {
            let inputs = INPUT_DELAYS.get(turn).map(|&delay| (&self.record.u, delay));
            let motion = (turn == 0).then_some((&self.motion, 0));
            let outputs = OUTPUT_DELAYS.get(turn).map(|&delay| (self.simulated, delay));
            let most = if turn == 0 { MOST_SIGNALS } else { ENOUGH_SIGNALS.max(signals.len()) };
            for (channels, delay) in inputs.into_iter().chain(motion).chain(outputs) {
                signals.extend(channels.iter().map(|channel| (channel.as_slice(), delay)));
            }
            signals.truncate(most);
        }
        signals
    }

    /// Returns the polynomials at each of the first samples: the signals, their magnitudes, their directions, the
    /// products of two signals, and the products of three of which at least two are equal. The signals are scaled to
    /// unit RMS, and continued backwards with their first value.
    fn polynomials(&self, samples: usize, step: usize) -> Vec<Vec<f64>> {
        let signals: Vec<Vec<f64>> = self
            .signals()
            .into_iter()
            .map(|(signal, delay)| {
                let size = rms(signal).max(f64::MIN_POSITIVE);
                let samples = samples.min(signal.len());
                (0..samples).map(|k| signal[k.saturating_sub(step * delay)] / size).collect()
            })
            .collect();
        let count = signals.first().map_or(0, Vec::len);
        (0..count)
            .map(|k| {
                let now: Vec<f64> = signals.iter().map(|signal| signal[k]).collect();
                let direction = |signal: &Vec<f64>| (signal[k] - signal[k.saturating_sub(step)]).signum();
                let mut all = now.clone();
                all.extend(now.iter().map(|x| x.abs()));
                all.extend(signals.iter().map(direction));
                for (i, x) in now.iter().enumerate() {
                    for (j, y) in now.iter().enumerate().skip(i) {
                        all.extend([x * y, x * x * y]);
                        all.extend((i < j).then_some(x * y * y));
                    }
                }
                all
            })
            .collect()
    }

    /// Returns the rows of an output for the first samples. Each has `past` past values at intervals of `step`, and
    /// the polynomials if `all`. Rows that need a missing sample are left out.
    fn rows(&self, (output, past, step): (usize, usize, usize), samples: usize, all: bool) -> Vec<Row> {
        let (measured, residual) = (&self.record.y[output], &self.residual[output]);
        let polynomials = if all { self.polynomials(samples, step) } else { Vec::new() };
        let there = |k: &usize| (0..=past).all(|delay| measured[k - step * delay].is_finite());
        let row = |k: usize| {
            let before = (1..=past).map(|delay| residual[k - step * delay]);
            let further = polynomials.get(k).into_iter().flatten().copied();
            Row { value: residual[k], regressors: before.chain([1.0]).chain(further).collect() }
        };
        (past * step..samples.min(residual.len())).filter(there).map(row).collect()
    }
}

/// Returns the normal equations of all blocks; `None` if there are too few rows.
fn blocks(rows: &[Row], past: usize) -> Option<Vec<Normal>> {
    let each = rows.len() / BLOCKS;
    (each >= SAMPLES_PER_PAST * past).then(|| rows.chunks(each).take(BLOCKS).map(Normal::of).collect())
}

/// Compares the errors of the predictor from the past with those of the predictor that also has the polynomials. The
/// first `known` coefficients belong to both.
fn compared(alone: &[f64], blocks: &[Normal], known: usize) -> Option<Predictability> {
    let total = |errors: &[f64]| errors.iter().sum::<f64>();
    let with = PENALTIES.map(|penalty| errors(blocks, known, penalty));
    let best = with.iter().min_by(|a, b| total(a).total_cmp(&total(b)))?;
    let mean = total(alone) / BLOCKS as f64;
    let shares: Vec<f64> = alone.iter().zip(best).map(|(alone, with)| (alone - with) / mean).collect();
    let share = total(&shares) / BLOCKS as f64;
    let variance = shares.iter().map(|x| (x - share).powi(2)).sum::<f64>() / (BLOCKS - 1) as f64;
    Some(Predictability { share, std: (variance / BLOCKS as f64).sqrt() })
}

/// The normal equations of a block.
struct Normal {
    /// Sum of x xᵀ over the rows.
    square: DMatrix<f64>,
    /// Sum of x y.
    product: DVector<f64>,
    /// Sum of y².
    power: f64,
}

impl Normal {
    fn of(rows: &[Row]) -> Self {
        let x = DMatrix::from_fn(rows[0].regressors.len(), rows.len(), |i, k| rows[k].regressors[i]);
        let y = DVector::from_fn(rows.len(), |k, _| rows[k].value);
        Self { square: &x * x.transpose(), product: &x * &y, power: y.norm_squared() }
    }

    /// Returns the sum of squared errors with these coefficients.
    fn error(&self, coefficients: &DVector<f64>) -> f64 {
        self.power - 2.0 * self.product.dot(coefficients) + coefficients.dot(&(&self.square * coefficients))
    }
}

/// Returns the squared error of each block, predicted with coefficients that are fitted to the other blocks. All but
/// the first `known` coefficients are penalised, each in the scale of its regressor.
fn errors(blocks: &[Normal], known: usize, penalty: f64) -> Vec<f64> {
    let count = blocks[0].product.len();
    let mut whole = (DMatrix::zeros(count, count), DVector::zeros(count));
    for block in blocks {
        whole.0 += &block.square;
        whole.1 += &block.product;
    }
    let without = |block: &Normal| {
        let mut square = &whole.0 - &block.square;
        let product = &whole.1 - &block.product;
        for i in 0..count {
            let scale = square[(i, i)].max(f64::MIN_POSITIVE);
            square[(i, i)] += scale * if i < known { REGULAR } else { penalty.max(REGULAR) };
        }
        let coefficients = square.cholesky().map(|factor| factor.solve(&product));
        // Without a solution, nothing is predicted.
        coefficients.map_or(block.power, |coefficients| block.error(&coefficients))
    };
    blocks.iter().map(without).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::Action;
    use crate::fit::refit::refit;
    use crate::prepare::{Known, prepare};
    use crate::simulate::{Fineness, simulate};
    use crate::testing;

    /// The residual of a missing law grows with the level of the inputs, and noise does not. Records of about one
    /// level do not show whether a residual grows.
    #[test]
    fn noise_does_not_grow_with_the_level() {
        for (records, grows) in [
            ([(1.0, 0.11), (2.0, 0.1), (3.0, 0.09)], false),
            ([(1.0, 0.1), (2.0, 0.2), (3.0, 0.3)], true),
            ([(1.0, 0.1), (1.1, 0.2), (1.2, 0.3)], false),
            ([(1.0, 0.0), (2.0, 0.2), (3.0, 0.3)], true),
        ] {
            assert_eq!(grows_with_level(&records, 1.4, 0.5), grows, "{records:?}");
        }
    }

    /// The residual of a sound simulation with noise counts as noise. If the same noise is larger at a higher level, it
    /// does not.
    #[test]
    fn what_grows_with_the_level_is_no_noise() {
        let sim = testing::truss(1);
        let plant = Plant::new(&sim).unwrap();
        for grows in [false, true] {
            let mut case = testing::case(&sim, &sim);
            for (k, record) in case.records.iter_mut().enumerate().skip(1) {
                let level = k as f64;
                record.u = testing::random_input(80 + k as u64, record.samples(), record.u.len());
                record.u.iter_mut().flatten().for_each(|u| *u *= level);
                record.y = simulate(&plant, &[], &record.u, 0.0, None, Fineness::FINE);
                let size = 0.1 * rms(record.y.iter().flatten()) / if grows { 1.0 } else { level };
                let noise = testing::random_input(90 + k as u64, record.samples(), record.y.len());
                record.y.iter_mut().zip(noise).for_each(|(y, e)| y.iter_mut().zip(e).for_each(|(y, e)| *y += size * e));
            }
            let problem = prepare(case.model.as_ref().unwrap(), &case.records, &Known::default()).unwrap().problem;
            assert_eq!(Unpredicted::of(&problem, &refit(&problem, 0).as_fit()).is_none(), grows);
        }
    }

    /// The inputs predict a force that is the square of the displacement at another port. They do not predict a random
    /// force of the same size.
    #[test]
    fn the_motion_predicts_a_force_that_follows_it_and_no_random_force() {
        let sim = testing::truss(1);
        let plant = Plant::new(&sim).unwrap();
        for follows in [true, false] {
            let mut case = testing::case(&sim, &sim);
            for (k, record) in case.records.iter_mut().enumerate().skip(1) {
                let square: Vec<f64> = port_motion(&plant, &record.u)[2].iter().map(|d| d * d).collect();
                let random = testing::random_input(70 + k as u64, record.samples(), 1).remove(0);
                let force = if follows { square } else { random };
                let scale = 0.05 / rms(&force);
                let at = move |t: f64| scale * force[((t * testing::RATE).round() as usize).min(force.len() - 1)];
                let pushed = [Action::Disturbance(0, Box::new(at))];
                record.y = simulate(&plant, &pushed, &record.u, 0.0, None, Fineness::FINE);
            }
            let ready = prepare(case.model.as_ref().unwrap(), &case.records, &Known::default()).unwrap();
            let given = vec![0.0; ready.problem.nuisance.len()];
            let simulated = outputs(&ready.problem, &given, &[]);
            let all = predictability(&ready.problem, &plant, &simulated).unwrap();
            let most = all.iter().map(|one| one.share).fold(0.0, f64::max);
            let limit = ready.problem.settings.judge.noise_predicted;
            assert!(if follows { most > 2.0 * limit } else { most < 0.5 * limit }, "{follows}: {all:?}");
        }
    }
}
