//! Plants with direct feedthrough: the input is advanced by one sample.
//!
//! The model of PLID is strictly proper: y_k depends on u_{k-1} and earlier inputs. A plant with direct feedthrough,
//! such as from force to acceleration, takes this form if u_{k+1} replaces u_k. A test decides whether this is needed:
//! does y_k depend on u_k, given the past?
//!
//! y_k is regressed on y_{k-1..k-L} of all outputs and u_{k-1..k-L} of all inputs, without and with u_k; the partial
//! F-test compares the two (Draper and Smith, Applied Regression Analysis). Significance alone is not sufficient. In a
//! long record, any small effect is significant, such as cross-talk between converters, and if the input is measured
//! with noise, u_k contains information on the true u_{k-1}. The feedthrough must therefore also be relevant in one of
//! two ways. Either u_k explains at least [`RELEVANT_SHARE`] of the residual variance (below that, omitting u_k adds
//! less than 2.6 % to the one-step error), or its direct part, coefficient times RMS of the input, is at least
//! [`RELEVANT_WEIGHT`] of the output's RMS. The second criterion matters for smooth inputs. Their present value is
//! almost determined by their past, and the one-step error hides what a free run would show.
//!
//! The test errs towards "no". If the sample rate is far above the band, and input and output are noisy, a feedthrough
//! that accounts for a quarter of the output can be missed, because noise biases the coefficient towards zero. In this
//! case, knowledge of the plant should decide: accelerations respond to forces at once.
use super::Segment;
use crate::{Record, Warning};
use nalgebra::DMatrix;
use ndarray::s;
use plid_model::signal::mean;
use serde::{Deserialize, Serialize};
use statrs::distribution::{ContinuousCDF, FisherSnedecor};

/// Smallest share of the residual variance that u_k must explain.
pub const RELEVANT_SHARE: f64 = 0.05;
/// Smallest ratio of the RMS of an input's direct part to the RMS of the output.
pub const RELEVANT_WEIGHT: f64 = 0.1;
/// Largest p-value, before it is divided by the number of outputs or pairs that are tested.
pub const SIGNIFICANT: f64 = 1e-6;
/// Number of lags of the regression, if the record is long enough.
pub const LAGS: usize = 20;
/// Maximum number of regressors, beyond which the lags are reduced to keep the test fast.
const MOST_REGRESSORS: usize = 400;
/// Relative precision to which an input's present may be known from its past. A more predictable input cannot be
/// tested.
const NOVELTY: f64 = 1e-8;
/// Relative precision below which an output counts as fully predicted by the past.
const PREDICTED: f64 = 1e-8;
/// Number of rows added to the triangular factor at a time.
const BLOCK: usize = 4096;

/// The effect of one input's present sample on one output, given the past and the other inputs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PairTest {
    /// Name of the input.
    pub input: String,
    /// Name of the output.
    pub output: String,
    /// Coefficient of u_k, in output units per input unit.
    pub coefficient: f64,
    /// RMS of coefficient times input over RMS of the output, both about their means.
    pub weight: f64,
    /// Share of the residual variance of the output that this input's sample explains.
    pub partial_r2: f64,
    /// Probability of a share at least this large by chance.
    pub p_value: f64,
}

/// The effect of all inputs' present samples on one output, given the past.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct OutputTest {
    /// Name of the output.
    pub output: String,
    /// Share of the residual variance that the inputs' samples explain together.
    pub partial_r2: f64,
    /// Probability of a share at least this large by chance.
    pub p_value: f64,
}

/// The test for direct feedthrough.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct AdvanceTest {
    /// Whether any output has direct feedthrough.
    pub answers_at_once: bool,
    /// Number of lags L of the past.
    pub lags: usize,
    /// Rows of the regression.
    pub rows: usize,
    /// The tests of each output with all inputs.
    pub outputs: Vec<OutputTest>,
    /// The tests of each output with each input.
    pub pairs: Vec<PairTest>,
}

/// Tests whether y_k depends on u_k given the past. Rows with a missing sample are left out.
///
/// # Errors
/// Returns a warning if there are too few samples, or if the inputs are determined by their past.
pub fn test(segments: &[Segment], input_names: &[String], output_names: &[String]) -> Result<AdvanceTest, Warning> {
    let (m, p) = (input_names.len(), output_names.len());
    let untested = |reason: String| Err(Warning::AdvanceUntested { reason });
    let samples: usize = segments.iter().map(|s| s.inputs.nrows()).sum();
    // The regression needs at least five rows per regressor.
    let affordable = (samples / 5).min(MOST_REGRESSORS).saturating_sub(m) / (m + p).max(1);
    let lags = affordable.min(LAGS);
    if lags < 2 {
        return untested(format!("{samples} samples are too few"));
    }
    let past = lags * (m + p);
    let (factor, rows) = triangular_factor(segments, lags);
    if rows < 2 * (past + m) {
        return untested(format!("only {rows} rows have no missing sample"));
    }
    let norm = |j: usize, from: usize| factor.view_range(from..=j, j).norm();
    for (j, name) in input_names.iter().enumerate() {
        if factor[(past + j, past + j)].abs() <= NOVELTY * norm(past + j, 0) {
            return untested(format!("input `{name}` follows from the past samples"));
        }
    }
    // The length of a whole column is its RMS up to a common factor.
    let size = |j: usize| norm(j, 0);
    // The corner of the factor contains the parts that the past leaves unexplained: of u_k, and of y_k along u_k.
    let novel_u = factor.view((past, past), (m, m)).into_owned();
    let along_u = factor.view((past, past + m), (m, p)).into_owned();
    let (Some(inverse), Some(coefficients)) = (novel_u.clone().try_inverse(), novel_u.solve_upper_triangular(&along_u))
    else {
        return untested("the inputs are collinear".into());
    };
    let freedom = (rows - past - m) as f64;
    let mut outputs = Vec::new();
    let mut pairs = Vec::new();
    for (i, output) in output_names.iter().enumerate() {
        let column = past + m + i;
        let explained = along_u.column(i).norm_squared();
        let rest = norm(column, past + m).powi(2);
        let already_known = (explained + rest).sqrt() <= PREDICTED * size(column);
        let share = |gain: f64| {
            if already_known || gain + rest == 0.0 { 0.0 } else { gain / (gain + rest) }
        };
        let joint = share(explained);
        outputs.push(OutputTest {
            output: output.clone(),
            partial_r2: joint,
            p_value: p_value(joint, m as f64, freedom),
        });
        for (j, input) in input_names.iter().enumerate() {
            let coefficient = coefficients[(j, i)];
            let alone = share(coefficient.powi(2) / inverse.row(j).norm_squared());
            pairs.push(PairTest {
                input: input.clone(),
                output: output.clone(),
                coefficient,
                // An output that never moves has no direct part.
                weight: if size(column) > 0.0 { coefficient.abs() * size(past + j) / size(column) } else { 0.0 },
                partial_r2: alone,
                p_value: p_value(alone, 1.0, freedom),
            });
        }
    }
    let by_share = outputs.iter().any(|o| o.partial_r2 >= RELEVANT_SHARE && o.p_value <= SIGNIFICANT / p as f64);
    let by_weight = pairs.iter().any(|t| t.weight >= RELEVANT_WEIGHT && t.p_value <= SIGNIFICANT / (m * p) as f64);
    Ok(AdvanceTest { answers_at_once: by_share || by_weight, lags, rows, outputs, pairs })
}

/// Returns the probability of a partial R^2 at least as large if there is no effect.
fn p_value(partial_r2: f64, effects: f64, freedom: f64) -> f64 {
    let f = partial_r2 / effects / ((1.0 - partial_r2) / freedom);
    if f.is_infinite() {
        return 0.0;
    }
    FisherSnedecor::new(effects, freedom).map_or(1.0, |law| law.sf(f.max(0.0)))
}

/// Returns the upper triangular factor of [past | u_k | y_k], with one row per sample, and the number of rows.
///
/// The factor is updated block by block (R of [R; rows] by Householder QR), so that a long record needs little memory.
fn triangular_factor(segments: &[Segment], lags: usize) -> (DMatrix<f64>, usize) {
    let m = segments.first().map_or(0, |s| s.inputs.ncols());
    let p = segments.first().map_or(0, |s| s.outputs.ncols());
    let columns = (lags + 1) * (m + p);
    let u_mean: Vec<f64> = (0..m).map(|j| mean(segments.iter().flat_map(|s| s.inputs.column(j)))).collect();
    let y_mean: Vec<f64> = (0..p).map(|j| mean(segments.iter().flat_map(|s| s.outputs.column(j)))).collect();
    let mut factor = DMatrix::zeros(columns, columns);
    let mut block = Vec::with_capacity(BLOCK * columns);
    let mut rows = 0;
    for segment in segments {
        for k in lags..segment.inputs.nrows() {
            if segment.outputs.slice(s![k - lags..=k, ..]).iter().any(|v| v.is_nan()) {
                continue;
            }
            for lag in 1..=lags {
                block.extend((0..p).map(|j| segment.outputs[[k - lag, j]] - y_mean[j]));
                block.extend((0..m).map(|j| segment.inputs[[k - lag, j]] - u_mean[j]));
            }
            block.extend((0..m).map(|j| segment.inputs[[k, j]] - u_mean[j]));
            block.extend((0..p).map(|j| segment.outputs[[k, j]] - y_mean[j]));
            rows += 1;
            if block.len() >= BLOCK * columns {
                factor = append(&factor, &block);
                block.clear();
            }
        }
    }
    if !block.is_empty() {
        factor = append(&factor, &block);
    }
    (factor, rows)
}

fn append(factor: &DMatrix<f64>, block: &[f64]) -> DMatrix<f64> {
    let columns = factor.ncols();
    let rows = DMatrix::from_row_slice(block.len() / columns, columns, block);
    let mut stacked = DMatrix::zeros(columns + rows.nrows(), columns);
    stacked.rows_mut(0, columns).copy_from(factor);
    stacked.rows_mut(columns, rows.nrows()).copy_from(&rows);
    stacked.qr().unpack_r()
}

/// Replaces u_k by u_{k+1} and drops the last sample.
pub fn advance(record: &Record) -> Record {
    let last = record.samples().saturating_sub(1);
    Record {
        inputs: record.inputs.slice(s![1.., ..]).to_owned(),
        outputs: record.outputs.slice(s![..last, ..]).to_owned(),
        sample_rate_hz: record.sample_rate_hz,
        input_names: record.input_names.clone(),
        output_names: record.output_names.clone(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prepare::test_plants::Gaussian;
    use nalgebra::{Matrix3, Vector3};
    use ndarray::{Array2, array};
    use std::f64::consts::PI;

    fn names(prefix: &str, count: usize) -> Vec<String> {
        (1..=count).map(|i| format!("{prefix}{i}")).collect()
    }

    fn run(u: &Array2<f64>, y: &Array2<f64>) -> Result<AdvanceTest, Warning> {
        let segment = Segment { inputs: u.view(), outputs: y.view() };
        test(&[segment], &names("u", u.ncols()), &names("y", y.ncols()))
    }

    #[derive(Clone, Copy, PartialEq, Debug)]
    enum Input {
        White,
        /// White noise filtered by two poles at 0.8.
        Smooth,
        /// White noise filtered by six zeros at the Nyquist frequency and four poles, as an anti-alias filter shapes
        /// it. No finite past whitens it.
        BandLimited,
    }

    fn input(g: &mut Gaussian, samples: usize, kind: Input) -> Vec<f64> {
        let white: Vec<f64> = (0..samples).map(|_| g.draw()).collect();
        let pole = |x: Vec<f64>, a: f64| {
            let mut last = 0.0;
            x.iter()
                .map(|v| {
                    last = a * last + v;
                    last
                })
                .collect::<Vec<f64>>()
        };
        let zero = |x: Vec<f64>| (0..x.len()).map(|k| x[k] + if k > 0 { x[k - 1] } else { 0.0 }).collect::<Vec<f64>>();
        match kind {
            Input::White => white,
            Input::Smooth => (0..2).fold(white, |x, _| pole(x, 0.8)),
            Input::BandLimited => {
                let shaped = (0..6).fold(white, |x, _| zero(x));
                (0..4).fold(shaped, |x, _| pole(x, 0.4))
            }
        }
    }

    /// Tests a plant with a lightly damped pole pair, y = b(q) / a(q) u + direct * u, with white noise of `noise` times
    /// the output's RMS, either on the output or within the recursion.
    fn plant(seed: u64, kind: Input, direct: f64, noise: f64, on_output: bool) -> AdvanceTest {
        let samples = 8000;
        let mut g = Gaussian::new(seed);
        let u = input(&mut g, samples, kind);
        let respond = |disturbance: &[f64]| {
            let mut x = vec![0.0; samples];
            for k in 2..samples {
                x[k] = 1.6 * x[k - 1] - 0.95 * x[k - 2] + 0.5 * u[k - 1] + 0.3 * u[k - 2] + disturbance[k];
            }
            x
        };
        let clean = respond(&vec![0.0; samples]);
        let size = (clean.iter().map(|v| v * v).sum::<f64>() / samples as f64).sqrt();
        let white: Vec<f64> = (0..samples).map(|_| g.draw()).collect();
        let y: Vec<f64> = if on_output {
            clean.iter().zip(&white).map(|(x, e)| x + noise * size * e).collect()
        } else {
            // The resonance amplifies noise within the recursion about sixfold.
            respond(&white.iter().map(|e| noise * size / 6.0 * e).collect::<Vec<_>>())
        };
        let y: Vec<f64> = y.iter().zip(&u).map(|(y, u)| y + direct * u).collect();
        run(&Array2::from_shape_vec((samples, 1), u).unwrap(), &Array2::from_shape_vec((samples, 1), y).unwrap())
            .unwrap()
    }

    #[test]
    fn without_feed_through_nothing_is_advanced() {
        for kind in [Input::White, Input::Smooth, Input::BandLimited] {
            for (noise, on_output) in NOISES {
                for seed in 0..20 {
                    let found = plant(seed, kind, 0.0, noise, on_output);
                    let case = format!("{kind:?} {noise} {on_output} {seed}: {found:?}");
                    assert!(!found.answers_at_once, "{case}");
                    assert!(found.outputs[0].partial_r2 < 0.5 * RELEVANT_SHARE, "{case}");
                }
            }
        }
    }

    #[test]
    fn feed_through_is_found() {
        for kind in [Input::White, Input::Smooth, Input::BandLimited] {
            for (noise, on_output) in NOISES {
                // In that case, the standard error of the coefficient is larger than the coefficient itself.
                if kind == Input::BandLimited && noise > 0.1 {
                    continue;
                }
                for seed in 0..20 {
                    let found = plant(seed, kind, 1.0, noise, on_output);
                    let case = format!("{kind:?} {noise} {on_output} {seed}: {found:?}");
                    assert!(found.answers_at_once, "{case}");
                    let off = (found.pairs[0].coefficient - 1.0).abs();
                    assert!(off < 0.25, "{case}");
                }
            }
        }
    }

    /// The ratio of the noise to the output's RMS, and whether the noise is on the output or within the recursion.
    const NOISES: [(f64, bool); 5] = [(0.0, true), (0.01, true), (0.3, true), (0.01, false), (0.3, false)];

    #[test]
    fn a_trace_is_significant_but_not_relevant() {
        // The direct part is a twentieth of the input, which explains 0.25 % of the residual variance.
        let mut g = Gaussian::new(1);
        let u = Array2::from_shape_simple_fn((50_000, 1), || g.draw());
        let mut y = Array2::zeros((50_000, 1));
        for k in 1..50_000 {
            y[[k, 0]] = 0.5 * y[[k - 1, 0]] + u[[k - 1, 0]] + 0.05 * u[[k, 0]] + g.draw();
        }
        let found = run(&u, &y).unwrap();
        assert!(found.outputs[0].p_value < 1e-15, "{found:?}");
        assert!(!found.answers_at_once, "{found:?}");
    }

    #[test]
    fn the_pair_that_answers_is_named() {
        let mut g = Gaussian::new(9);
        let u = Array2::from_shape_simple_fn((4000, 2), || g.draw());
        let mut y = Array2::zeros((4000, 2));
        for k in 1..4000 {
            y[[k, 0]] = 0.9 * y[[k - 1, 0]] + u[[k - 1, 0]] + 0.1 * g.draw();
            y[[k, 1]] = 0.5 * y[[k - 1, 1]] + u[[k - 1, 0]] + 2.0 * u[[k, 1]] + 0.1 * g.draw();
        }
        let found = run(&u, &y).unwrap();
        assert!(found.answers_at_once);
        for pair in &found.pairs {
            let answers = pair.input == "u2" && pair.output == "y2";
            assert_eq!(pair.p_value < 1e-6, answers, "{pair:?}");
            if answers {
                assert!((pair.coefficient - 2.0).abs() < 0.02);
                // The exact share is 2^2 over 2^2 + 0.1^2.
                assert!((pair.partial_r2 - 4.0 / 4.01).abs() < 1e-3);
            }
        }
    }

    #[test]
    fn what_cannot_be_tested_is_a_warning() {
        let mut g = Gaussian::new(2);
        let y = Array2::from_shape_simple_fn((500, 1), || g.draw());
        let sine = Array2::from_shape_fn((500, 1), |(k, _)| (0.3 * k as f64).sin());
        let said = run(&sine, &y).unwrap_err().to_string();
        assert!(said.contains("`u1` follows from the past"), "{said}");
        let few = |a: &Array2<f64>| a.slice(s![..15, ..]).to_owned();
        assert!(run(&few(&y), &few(&y)).unwrap_err().to_string().contains("15 samples"));
        let u = Array2::from_shape_simple_fn((500, 1), || g.draw());
        let mut gaps = y.clone();
        gaps.slice_mut(s![..;20, ..]).fill(f64::NAN);
        assert!(run(&u, &gaps).unwrap_err().to_string().contains("0 rows"));
    }

    #[test]
    fn the_input_moves_one_sample_ahead() {
        let record = Record {
            sample_rate_hz: 1.0,
            input_names: names("u", 1),
            output_names: names("y", 1),
            inputs: array![[1.0], [2.0], [3.0]],
            outputs: array![[4.0], [5.0], [6.0]],
        };
        let moved = advance(&record);
        assert_eq!(moved.inputs, array![[2.0], [3.0]]);
        assert_eq!(moved.outputs, array![[4.0], [5.0]]);
    }

    /// Tests an oversampled plant. A multisine of 2 to 15 Hz at 400 Hz, held over each sample, excites three modes.
    /// Input and output are measured with noise, relative to their RMS.
    fn oversampled(seed: u64, velocity: bool, input_noise: f64, output_noise: f64) -> AdvanceTest {
        let (samples, period) = (16_384, 8192);
        let mut g = Gaussian::new(seed);
        let lines: Vec<(f64, f64)> = (41..=306).map(|l| (f64::from(l), 1e3 * g.draw())).collect();
        let one: Vec<f64> = (0..period)
            .map(|k| {
                let turn = 2.0 * PI * k as f64 / period as f64;
                lines.iter().map(|(l, phase)| (l * turn + phase).cos()).sum()
            })
            .collect();
        let mut u = Array2::from_shape_fn((samples, 1), |(k, _)| one[k % period]);
        let mut y = Array2::<f64>::zeros((samples, 1));
        for hz in [5.0, 7.3, 11.0] {
            let w = 2.0 * PI * hz;
            let continuous = Matrix3::new(0.0, 1.0, 0.0, -w * w, -0.02 * w, 1.0, 0.0, 0.0, 0.0);
            let step = (continuous / 400.0).exp();
            let mut state = Vector3::zeros();
            for k in 0..samples {
                y[[k, 0]] += if velocity { w * state[1] } else { w * w * state[0] };
                state[2] = u[[k, 0]];
                state = step * state;
            }
        }
        u /= u.std(0.0);
        y /= y.std(0.0);
        u.mapv_inplace(|v| v + input_noise * g.draw());
        y.mapv_inplace(|v| v + output_noise * g.draw());
        run(&u, &y).unwrap()
    }

    #[test]
    fn noise_on_an_oversampled_input_does_not_look_like_an_answer() {
        // A noisy u_k improves the estimate of the true u_{k-1}: it is significant, but has no direct part.
        for velocity in [false, true] {
            for (input_noise, output_noise) in [(0.001, 0.001), (0.01, 0.001), (0.03, 0.003)] {
                for seed in 200..203 {
                    let found = oversampled(seed, velocity, input_noise, output_noise);
                    assert!(!found.answers_at_once, "{seed} {input_noise}: {found:?}");
                }
            }
        }
    }
}
