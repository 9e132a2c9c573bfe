//! Output-error refinement: Levenberg-Marquardt on the free-run error.
//!
//! The criterion is the Gaussian likelihood of an error that is white and independent over outputs, each output's variance being estimated
//! along: L = sum over outputs of N_i/2 ln(mean square free-run error of i). So every output is weighted by its own noise, none by its unit. (Ljung, *System Identification*,
//! 2nd ed., section 7.2; the sensitivities as in its section 10.3.)

use nalgebra::{DMatrix, DVector};
use plid_model::Model;
use rayon::prelude::*;

use crate::error::RefineError;
use crate::normal::Free;
use crate::point::Point;
use crate::record::{Data, Record};
use crate::sections::Sections;
use crate::uncertainty::Uncertainty;
use crate::whiten::{Filtered, Whitening};

/// What is taken for the free-run error of the true plant.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Noise {
    /// White: the mean square error itself is minimised, an output weighted by its variance.
    #[default]
    White,
    /// Coloured: inputs and outputs are filtered first, so that the error becomes white.
    Coloured,
}

/// What the refinement may do.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// Largest magnitude of a pole: see [`crate::slowest_radius`].
    pub radius: f64,
    /// Whether D is estimated; else it is zero.
    pub feedthrough: bool,
    /// Steps at most.
    pub iterations: usize,
    /// Whether the noise is white.
    pub noise: Noise,
}

/// Told steps done and planned; false asks for an end.
pub type Watcher<'a> = &'a (dyn Fn(usize, usize) -> bool + Sync);

/// A refined model.
#[derive(Clone, Debug)]
pub struct Refined {
    /// In block-diagonal (modal) coordinates, with the channels' units of the records; names and rate of the start.
    pub model: Model,
    /// State at the first sample of each record.
    pub initial_states: Vec<DVector<f64>>,
    /// Mean square free-run error of each output.
    pub residual_variances: Vec<f64>,
    /// Steps taken.
    pub iterations: usize,
    /// Whether the last steps gained nothing that matters.
    pub converged: bool,
    /// Poles that stand at the limit of the slowest decay.
    pub poles_at_limit: usize,
    /// Covariance of the parameters.
    pub uncertainty: Uncertainty,
}

/// A step that gains less than this in log-likelihood changes nothing that the data could tell.
const SMALL_GAIN: f64 = 1e-2;
/// So many small gains in a row are the end.
const SMALL_STEPS: usize = 4;
/// Dampings tried side by side, about the last one that served.
const TRIALS: [f64; 4] = [0.03, 0.3, 3.0, 30.0];
/// Prefilters, each from the errors that the last one has left.
const ROUNDS: usize = 2;
/// Beyond this damping no step is left.
const MOST_DAMPING: f64 = 1e8;

/// The negative log-likelihood, up to a constant.
fn cost(variances: &[f64], present: &[usize]) -> f64 {
    variances.iter().zip(present).map(|(v, &n)| 0.5 * n as f64 * v.ln()).sum()
}

/// Minimises the free-run error of `start` over all records. B, D and the initial states are fitted to the start's poles and C first, so that only
/// these two count of it; poles outside the circle or slower than the limit are moved inside.
///
/// # Errors
/// [`RefineError`]: records that are empty, of other channels or not finite; fewer samples than parameters; settings out of range; an end asked for.
pub fn refine(
    start: &Model,
    records: &[Record<'_>],
    options: &Options,
    watcher: Watcher<'_>,
) -> Result<Refined, RefineError> {
    start.check("the start")?;
    let data = Data::new(records)?;
    check(start.n(), &data, options)?;
    if (start.m(), start.p()) != (data.m(), data.p()) {
        let (what, expected, found) = if start.m() == data.m() {
            ("the output", start.p(), data.p())
        } else {
            ("the input", start.m(), data.m())
        };
        return Err(RefineError::Shape { record: 0, what, unit: "channels", expected, found });
    }
    // Scaled outputs: each row of C by its own scale.
    let c = DMatrix::from_fn(start.p(), start.n(), |i, j| start.c[(i, j)] / data.output_scale[i]);
    let sections = Sections::of_poles(&start.a, &c, start.m(), options.radius, options.feedthrough)?;
    let point = Point::new(sections, &data).fit(&data, Free::Inputs)?;
    let rate = start.sample_rate_hz;
    let mut refined = match options.noise {
        Noise::White => {
            let descent = descend(point, &data, options.iterations, watcher)?;
            let uncertainty = descent.uncertainty(&data, &data.output_map(), &data.input_scale, rate)?;
            descent.into_refined(&data, rate, uncertainty)?
        }
        Noise::Coloured => coloured(point, &data, options.iterations, rate, watcher)?,
    };
    refined.model.inputs.clone_from(&start.inputs);
    refined.model.outputs.clone_from(&start.outputs);
    Ok(refined)
}

/// Fits with a prefilter, which is estimated from the free-run errors anew before each round.
fn coloured(
    mut point: Point,
    data: &Data,
    iterations: usize,
    sample_rate_hz: f64,
    watcher: Watcher<'_>,
) -> Result<Refined, RefineError> {
    let each = iterations.div_ceil(ROUNDS);
    let mut found = None;
    for round in 0..ROUNDS {
        let whitening = Whitening::of(&point.errors(data)?)?;
        let filtered: Vec<_> = data.records.iter().map(|r| whitening.apply(&r.record())).collect();
        let records: Vec<Record<'_>> = filtered.iter().map(Filtered::record).collect();
        let filtered = Data::new(&records)?;
        let mixed = whitening.mixed(&point.model, &filtered);
        let start = Point::new(mixed, &filtered).fit(&filtered, Free::States)?;
        let told = |done: usize, _: usize| watcher(round * each + done, ROUNDS * each);
        let descent = descend(start, &filtered, each, &told)?;
        let model = whitening.unmixed(&descent.point.model, &filtered);
        point = Point::new(model, data).fit(data, Free::States)?;
        // From filtered and scaled outputs to the records' own.
        let outputs = data.output_map() * whitening.unmix() * filtered.output_map();
        let inputs: Vec<f64> = filtered.input_scale.iter().zip(&data.input_scale).map(|(a, b)| a * b).collect();
        found = Some((descent, filtered, outputs, inputs));
    }
    let Some((descent, filtered, outputs, inputs)) = found else { return Err(RefineError::NoRecords) };
    let uncertainty = descent.uncertainty(&filtered, &outputs, &inputs, sample_rate_hz)?;
    let Descent { iterations, converged, .. } = descent;
    let variances = point.variances(data);
    Descent { point, variances, iterations, converged }.into_refined(data, sample_rate_hz, uncertainty)
}

/// Settings in range, and more samples than parameters.
pub(crate) fn check(states: usize, data: &Data, options: &Options) -> Result<(), RefineError> {
    if !(options.radius > 0.0 && options.radius < 1.0) {
        let expected = "above 0 and below 1";
        return Err(RefineError::Setting { setting: "radius", value: options.radius, expected });
    }
    if states == 0 {
        return Err(RefineError::Setting { setting: "states", value: 0.0, expected: "at least 1" });
    }
    let (m, p) = (data.m(), data.p());
    let unknown = states * (m + p) + if options.feedthrough { m * p } else { 0 };
    let numbers: usize = data.present().iter().sum();
    if numbers <= unknown {
        return Err(RefineError::TooLittleData {
            purpose: "the refinement",
            unit: "output samples",
            needed: unknown + 1,
            available: numbers,
        });
    }
    Ok(())
}

pub(crate) struct Descent {
    point: Point,
    variances: Vec<f64>,
    iterations: usize,
    converged: bool,
}

pub(crate) fn descend(
    start: Point,
    data: &Data,
    iterations: usize,
    watcher: Watcher<'_>,
) -> Result<Descent, RefineError> {
    let present = data.present();
    let mut variances = start.variances(data);
    let mut point = start.turned();
    let mut damping = 1e-2;
    let (mut small, mut done) = (0, 0);
    while done < iterations && small < SMALL_STEPS {
        if !watcher(done, iterations) {
            return Err(RefineError::Interrupted);
        }
        let normal = point.normal(data, &variances, Free::All);
        let before = cost(&variances, &present);
        let better = loop {
            let trials: Vec<Option<(f64, Point, Vec<f64>)>> = TRIALS
                .par_iter()
                .map(|factor| {
                    let moved = point.moved(&normal.step(factor * damping)?, Free::All);
                    let variances = moved.variances(data);
                    variances.iter().all(|v| v.is_finite()).then_some((factor * damping, moved, variances))
                })
                .collect();
            let best =
                trials.into_iter().flatten().min_by(|a, b| cost(&a.2, &present).total_cmp(&cost(&b.2, &present)));
            match best {
                Some(best) if cost(&best.2, &present) < before => break Some(best),
                _ if damping > MOST_DAMPING => break None,
                _ => damping *= 1e3,
            }
        };
        done += 1;
        let Some((served, moved, found)) = better else {
            small = SMALL_STEPS;
            break;
        };
        let gain = before - cost(&found, &present);
        (point, variances) = (moved.turned(), found);
        damping = served.max(1e-14);
        small = if gain < SMALL_GAIN { small + 1 } else { 0 };
    }
    watcher(iterations, iterations);
    Ok(Descent { point, variances, iterations: done, converged: small >= SMALL_STEPS })
}

impl Descent {
    fn uncertainty(
        &self,
        data: &Data,
        outputs: &DMatrix<f64>,
        inputs: &[f64],
        sample_rate_hz: f64,
    ) -> Result<Uncertainty, RefineError> {
        let normal = self.point.normal(data, &self.variances, Free::All);
        Uncertainty::new(&self.point.model, &normal.information(), outputs, inputs, sample_rate_hz)
    }

    fn into_refined(self, data: &Data, sample_rate_hz: f64, uncertainty: Uncertainty) -> Result<Refined, RefineError> {
        let Self { point, variances, iterations, converged } = self;
        Ok(Refined {
            model: in_units(&point.model, data, sample_rate_hz)?,
            initial_states: initial_states(&point, data),
            residual_variances: variances.iter().zip(&data.output_scale).map(|(v, s)| v * s * s).collect(),
            iterations,
            converged,
            poles_at_limit: point.model.at_limit(),
            uncertainty,
        })
    }
}

/// The model for channels in the records' units; the states stay as they are.
pub(crate) fn in_units(model: &Sections, data: &Data, sample_rate_hz: f64) -> Result<Model, RefineError> {
    let mut scaled = model.clone();
    scaled.scale_inputs(&data.input_scale, -1);
    for (i, output) in data.output_scale.iter().enumerate() {
        scaled.c.row_mut(i).scale_mut(*output);
        scaled.d.row_mut(i).scale_mut(*output);
    }
    scaled.to_model(sample_rate_hz)
}

/// The state of each record at its first sample; zero at rest.
pub(crate) fn initial_states(point: &Point, data: &Data) -> Vec<DVector<f64>> {
    let n = point.model.states;
    debug_assert_eq!(point.initial.len(), data.records.len());
    let state = |x: &Option<DVector<f64>>| x.as_ref().map_or(DVector::zeros(n), |x| x.rows(0, n).into_owned());
    point.initial.iter().map(state).collect()
}
