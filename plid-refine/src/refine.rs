//! Output-error refinement by the Levenberg-Marquardt method, which minimises the simulation error.
//!
//! The criterion is the Gaussian likelihood of an error that is white and independent between outputs, with the
//! variance of each output estimated as well: L = sum over the outputs of N_i/2 ln(mean square simulation error of
//! output i). Each output is therefore weighted by its own noise and not by its unit (Ljung, *System Identification*,
//! 2nd ed., section 7.2; the sensitivities are those of section 10.3).

use nalgebra::{DMatrix, DVector};
use plid_lsq::{Damping, Problem, Stop, minimise};
use plid_model::Model;

use crate::error::RefineError;
use crate::normal::{Free, Normal};
use crate::point::Point;
use crate::record::{Data, Record};
use crate::sections::Sections;
use crate::uncertainty::Uncertainty;
use crate::whiten::{Filtered, Whitening};

/// The assumption on the noise in the outputs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Noise {
    /// White noise: the mean square error itself is minimised, with each output weighted by its variance.
    #[default]
    White,
    /// Coloured noise: inputs and outputs are prefiltered so that the error becomes white.
    Coloured,
}

/// The settings of the refinement.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// Largest magnitude of a pole; see [`crate::slowest_radius`].
    pub radius: f64,
    /// Whether D is estimated; otherwise it is zero.
    pub feedthrough: bool,
    /// Largest number of iterations.
    pub iterations: usize,
    /// The assumption on the noise.
    pub noise: Noise,
}

/// A progress callback that receives the iterations done and planned, and returns false to stop the refinement.
pub type Watcher<'a> = &'a (dyn Fn(usize, usize) -> bool + Sync);

/// A refined model.
#[derive(Clone, Debug)]
pub struct Refined {
    /// The model in block-diagonal (modal) coordinates, in the units of the records, with the names and the sample rate
    /// of the starting model.
    pub model: Model,
    /// State at the first sample of each record.
    pub initial_states: Vec<DVector<f64>>,
    /// Mean square simulation error of each output, in the square of its unit.
    pub residual_variances: Vec<f64>,
    /// Number of iterations done.
    pub iterations: usize,
    /// Whether the last iterations gained no significant likelihood.
    pub converged: bool,
    /// Number of poles at the limit of [`Options::radius`].
    pub poles_at_limit: usize,
    /// Covariance of the parameters.
    pub uncertainty: Uncertainty,
}

/// A gain in log-likelihood below this is statistically insignificant.
const SMALL_GAIN: f64 = 1e-2;
/// The iteration ends after this many insignificant gains in a row.
const SMALL_STEPS: usize = 4;
/// Four dampings are tried in parallel, relative to the last successful one.
const DAMPING: Damping =
    Damping { start: 1e-2, shrink: 1.0, grow: 1e3, least: 1e-14, tries: 8, factors: &[0.03, 0.3, 3.0, 30.0] };
/// Number of prefilters, each estimated from the errors of the fit before it.
const ROUNDS: usize = 2;
/// Returns the negative log-likelihood up to a constant.
fn cost(variances: &[f64], present: &[usize]) -> f64 {
    variances.iter().zip(present).map(|(v, &n)| 0.5 * n as f64 * v.ln()).sum()
}

/// Minimises the simulation error of `start` over all records. B, D and the initial states are first fitted to the
/// poles and C of the starting model, so no other part of this model matters. Poles outside the unit circle or slower
/// than the limit are moved inside.
///
/// # Errors
/// Returns a [`RefineError`] for records that are empty, inconsistent or not finite, if there are fewer samples than
/// parameters, for settings out of range, and if the watcher requests a stop.
pub fn refine(
    start: &Model,
    records: &[Record<'_>],
    options: &Options,
    watcher: Watcher<'_>,
) -> Result<Refined, RefineError> {
    start.check("the starting model")?;
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
    // Each row of C is divided by the scale of its output.
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

/// Fits the model with a prefilter that is estimated from the simulation errors before each round.
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
        // The map from filtered and scaled outputs to the records' units.
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

/// Checks that the settings are in range and that there are more samples than parameters.
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

/// The result of a search.
pub(crate) struct Descent {
    point: Point,
    variances: Vec<f64>,
    iterations: usize,
    converged: bool,
}

/// A search over all parameters.
struct Search<'a> {
    data: &'a Data,
    /// Number of samples present for each output.
    present: Vec<usize>,
    iterations: usize,
    done: usize,
    watcher: Watcher<'a>,
}

/// A point and the mean square error of each output there.
#[derive(Clone)]
struct Place {
    point: Point,
    variances: Vec<f64>,
}

impl Problem for Search<'_> {
    type Point = Place;
    type Equations = Normal;
    type Error = RefineError;

    fn equations(&self) -> Normal {
        Normal::default()
    }

    fn linearise(&mut self, at: &Place, normal: &mut Normal) -> Result<(), RefineError> {
        if !(self.watcher)(self.done, self.iterations) {
            return Err(RefineError::Interrupted);
        }
        self.done += 1;
        *normal = at.point.normal(self.data, &at.variances, Free::All);
        Ok(())
    }

    fn advance(&self, from: &Place, step: &DVector<f64>, to: &mut Place) {
        to.point = from.point.moved(step, Free::All);
        to.variances = to.point.variances(self.data);
    }

    fn cost(&self, at: &Place) -> f64 {
        cost(&at.variances, &self.present)
    }

    fn accepted(&mut self, at: &mut Place) {
        at.point.turn();
    }
}

pub(crate) fn descend(
    mut start: Point,
    data: &Data,
    iterations: usize,
    watcher: Watcher<'_>,
) -> Result<Descent, RefineError> {
    let variances = start.variances(data);
    start.turn();
    let mut search = Search { data, present: data.present(), iterations, done: 0, watcher };
    let stop = Stop { steps: iterations, gain: SMALL_GAIN, patience: SMALL_STEPS, ..Stop::default() };
    let found = minimise(&mut search, Place { point: start, variances }, DAMPING, stop)?;
    watcher(iterations, iterations);
    let Place { point, variances } = found.point;
    Ok(Descent { point, variances, iterations: found.steps, converged: found.ended.converged() })
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

/// Returns the model in the records' units, with unchanged states.
pub(crate) fn in_units(model: &Sections, data: &Data, sample_rate_hz: f64) -> Result<Model, RefineError> {
    let mut scaled = model.clone();
    scaled.scale_inputs(&data.input_scale, -1);
    for (i, output) in data.output_scale.iter().enumerate() {
        scaled.c.row_mut(i).scale_mut(*output);
        scaled.d.row_mut(i).scale_mut(*output);
    }
    scaled.to_model(sample_rate_hz)
}

/// Returns the state of each record at its first sample, which is zero at rest.
pub(crate) fn initial_states(point: &Point, data: &Data) -> Vec<DVector<f64>> {
    let n = point.model.states;
    debug_assert_eq!(point.initial.len(), data.records.len());
    let state = |x: &Option<DVector<f64>>| x.as_ref().map_or(DVector::zeros(n), |x| x.rows(0, n).into_owned());
    point.initial.iter().map(state).collect()
}
