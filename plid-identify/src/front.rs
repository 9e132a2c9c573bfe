//! The main entry point: identification of a model from two arrays.

use nalgebra::{DMatrix, DVector};
use ndarray::{Array2, ArrayView1, ArrayView2, Axis, concatenate};
use plid_catalogue::{BackendName, Conditions, CovarianceName, ExpectationName, ScalarName, Variant, VariantChoice};
use plid_core::{Dense, Health, ImplicitModel, NoiseModel, ObservableForm, Settings, StructureError};
use plid_model::{ChannelScaling, Model, ModelError, Noise, undo_scaling};

use crate::{
    Bank, Ending, IdentifyError, Memory, OrderScan, Plan, RecursionRun, Samples, ScanRow, Search, Split, ToModel,
    Tuned, innovation_ratio, run, run_or_factor, tune,
};

/// Orders that are compared if the number of states is not given.
const ORDERS: [usize; 12] = [1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64];
/// The comparison ends after this number of consecutive orders that do not reduce the error by more than the slack.
const PATIENCE: usize = 2;
/// Relative simulation errors below this value count as equal, because a larger order would then fit only rounding
/// errors.
const EXPLAINED: f64 = 1e-3;
/// The RMS of N independent errors has a relative standard deviation of 1 / sqrt(2 N). Orders whose simulation errors
/// differ by less than this number of standard deviations count as equal.
const CHANCE: f64 = 2.0;
/// Number of samples needed per parameter, of which there are n (p + m). An order with fewer samples is not
/// considered.
const SAMPLES_PER_PARAMETER: usize = 4;
/// Share of the record on which the filters of the bank run; the rest scores them.
const LEARNING_SHARE: f64 = 0.75;

/// Identifies a plant from its inputs (K x m) and outputs (K x p), one row per sample, at the sample rate `rate` in Hz.
///
/// The number of states is the smallest with which the error of a simulation of the last quarter of the record is
/// within 5 % of the smallest error, within the scatter of an error over that number of samples, or below 1e-3 of the
/// output. The noise covariances are chosen by the same error. The operating point is identified together with the
/// plant: the means of a finite record are not exactly an equilibrium of the plant, and the difference would otherwise
/// be mistaken for additional states. [`Identification`] has the options.
///
/// # Errors
/// Returns the errors of [`Identification::run`].
pub fn identify(
    inputs: ArrayView2<'_, f64>,
    outputs: ArrayView2<'_, f64>,
    rate: f64,
) -> Result<Identified, IdentificationError> {
    Identification::default().run(inputs, outputs, rate)
}

/// Callbacks that watch a long identification. Several threads call them at once.
#[derive(Clone, Copy)]
pub struct Watch<'a> {
    /// Receives the number of states, and the numbers of filters done and planned for this order.
    pub progress: &'a (dyn Fn(usize, usize, usize) + Sync),
    /// Returns whether to continue.
    pub may_go_on: &'a (dyn Fn() -> bool + Sync),
}

/// The options of an identification from arrays.
///
/// The model has no direct feedthrough (D = 0): an input acts on the outputs from the next sample on.
#[derive(Clone, Copy, Debug, Default)]
pub struct Identification {
    states: Option<usize>,
    variant: VariantChoice,
    nan_is_missing: bool,
}

impl Identification {
    /// Sets the number of states; by default several are compared.
    pub fn states(mut self, states: usize) -> Self {
        self.states = Some(states);
        self
    }

    /// Sets the covariance form; by default it is the recommended one for the size, the scalar type and the length of
    /// the record.
    pub fn covariance(mut self, covariance: CovarianceName) -> Self {
        self.variant.covariance = Some(covariance);
        self
    }

    /// Sets the conditional expectation.
    pub fn expectations(mut self, expectations: ExpectationName) -> Self {
        self.variant.expectations = expectations;
        self
    }

    /// Sets the matrix library.
    pub fn backend(mut self, backend: BackendName) -> Self {
        self.variant.backend = backend;
        self
    }

    /// Sets the number type.
    pub fn scalar(mut self, scalar: ScalarName) -> Self {
        self.variant.scalar = scalar;
        self
    }

    /// Treats a NaN among the outputs as a missing sample; by default it is an error.
    pub fn nan_is_missing(mut self) -> Self {
        self.nan_is_missing = true;
        self
    }

    /// Identifies a plant from its inputs (K x m) and outputs (K x p), one row per sample, at the sample rate `rate` in
    /// Hz.
    ///
    /// # Errors
    /// Returns an [`IdentificationError`] for arrays that do not fit each other, channels that are constant or not
    /// finite, records that are too short, and records that no model follows.
    pub fn run(
        &self,
        inputs: ArrayView2<'_, f64>,
        outputs: ArrayView2<'_, f64>,
        rate: f64,
    ) -> Result<Identified, IdentificationError> {
        self.run_watched(inputs, outputs, rate, Watch { progress: &|_, _, _| (), may_go_on: &|| true })
    }

    /// Identifies a plant as [`Identification::run`] does, watched by the caller.
    ///
    /// # Errors
    /// Returns the errors of [`Identification::run`], and [`IdentifyError::Interrupted`] if the identification may not
    /// go on.
    pub fn run_watched(
        &self,
        inputs: ArrayView2<'_, f64>,
        outputs: ArrayView2<'_, f64>,
        rate: f64,
        watch: Watch<'_>,
    ) -> Result<Identified, IdentificationError> {
        if inputs.nrows() != outputs.nrows() {
            return Err(IdentificationError::Lengths { inputs: inputs.nrows(), outputs: outputs.nrows() });
        }
        let (scaled_inputs, input_mean, input_scale) = scaled(inputs, "u", false)?;
        let (scaled_outputs, output_mean, output_scale) = scaled(outputs, "y", self.nan_is_missing)?;
        let mut scaling = ChannelScaling { input_mean, input_scale, output_mean, output_scale };
        let inputs = with_constant(&scaled_inputs);
        let (inputs, outputs) = (inputs.view(), scaled_outputs.view());
        let samples = Samples { inputs, outputs, nan_is_missing: self.nan_is_missing };
        let (found, orders) = self.find_order(samples, watch)?;
        let (plan, done) = self.final_run(samples, found, watch)?;
        let ratio = innovation_ratio(&plan.form, &plan.noise.sensor, &done.identified, &done.innovations);
        let model = in_channel_units(&plan, &done, ratio, rate, &mut scaling)?;
        let diagonal = |dense: &Dense<f64>| (0..dense.rows()).map(|i| dense.at(i, i)).collect::<Vec<f64>>();
        let Plan { noise, variant, .. } = plan;
        Ok(Identified {
            noise: NoiseModel::diagonal(&diagonal(&noise.sensor), &vec![0.0; model.m()], &diagonal(&noise.state)),
            model,
            scaling,
            orders,
            variant,
            innovation_ratio: ratio,
            health: done.health,
        })
    }

    /// Tunes the noise covariances for the given order, or for each order until larger orders no longer reduce the
    /// error.
    fn find_order(
        &self,
        samples: Samples<'_>,
        watch: Watch<'_>,
    ) -> Result<(Found, Option<OrderScan>), IdentificationError> {
        let (m, p) = (samples.inputs.ncols(), samples.outputs.ncols());
        if let Some(states) = self.states {
            return Ok((self.tuned(samples, states, watch)?, None));
        }
        let most = samples.len() / (SAMPLES_PER_PARAMETER * (p + m));
        let scored = Split::new(&[samples], LEARNING_SHARE).score.len() * p;
        let slack = OrderScan::SLACK.max(1.0 + CHANCE / (2.0 * scored as f64).sqrt());
        let mut found: Vec<Found> = Vec::new();
        let mut rows: Vec<ScanRow> = Vec::new();
        let (mut best, mut idle, mut failure) = (f64::INFINITY, 0, None);
        for states in ORDERS.into_iter().filter(|&states| states >= p && states <= most) {
            match self.tuned(samples, states, watch) {
                Ok(next) => {
                    let error = next.tuned.best.free_run.unwrap_or(f64::INFINITY).max(EXPLAINED);
                    idle = if slack * error < best { 0 } else { idle + 1 };
                    best = best.min(error);
                    rows.push(ScanRow { states, indices: next.form.indices().to_vec(), free_run: Some(error) });
                    found.push(next);
                }
                Err(IdentificationError::Identify(error @ IdentifyError::NoSetting { .. })) => {
                    idle += usize::from(best.is_finite());
                    failure = Some(error);
                }
                Err(other) => return Err(other),
            }
            if idle >= PATIENCE {
                break;
            }
        }
        let Some(scan) = OrderScan::of(rows, slack) else {
            return Err(failure.map_or(IdentificationError::TooShort { samples: samples.len() }, Into::into));
        };
        let place = found.iter().position(|found| found.form.states() == scan.recommended);
        Ok((found.swap_remove(place.expect("the recommended order is one of those tried")), Some(scan)))
    }

    /// Finds the noise covariances of the model with `states` states.
    fn tuned(&self, samples: Samples<'_>, states: usize, watch: Watch<'_>) -> Result<Found, IdentificationError> {
        let (m, p) = (samples.inputs.ncols(), samples.outputs.ncols());
        let form = ObservableForm::balanced(states, p, m)?;
        let settings = Settings::of_unique_form(&form, 1.0, 1.0);
        let expectations = self.variant.expectations;
        let bank = Bank { form: form.clone(), settings, expectations, sensor: None, actuator: vec![0.0; m] };
        let progress = |done, planned| (watch.progress)(states, done, planned);
        // The lifetime of the views is shortened to that of the callbacks.
        let samples = Samples { inputs: samples.inputs.view(), outputs: samples.outputs.view(), ..samples };
        let split = Split::new(&[samples], LEARNING_SHARE);
        let memory = Memory::default();
        let tuned =
            tune(&bank, &mut Search { split, progress: &progress, may_go_on: &|| (watch.may_go_on)(), memory })?;
        Ok(Found { form, settings: bank.settings, tuned })
    }

    /// Runs the recursion over the whole record.
    fn final_run(
        &self,
        samples: Samples<'_>,
        found: Found,
        watch: Watch<'_>,
    ) -> Result<(Plan, Box<RecursionRun>), IdentificationError> {
        let Found { form, settings, tuned } = found;
        let noise = tuned.noise;
        let conditions = Conditions::of(self.variant.scalar, &settings, &noise, samples.len());
        let variant = self.variant.settle(&conditions);
        let mut plan = Plan { form, noise, settings, variant, passes: 1 };
        let ending = if self.variant.covariance.is_some() {
            run(&plan, &[samples], None, &mut |_, _| (watch.may_go_on)())
        } else {
            run_or_factor(&mut plan, &[samples], None, &mut |_, _| (watch.may_go_on)()).0
        };
        match ending? {
            Ending::Done(done) => Ok((plan, done)),
            Ending::Paused(_) => Err(IdentifyError::Interrupted.into()),
        }
    }
}

/// An order with its noise covariances.
struct Found {
    form: ObservableForm,
    settings: Settings,
    tuned: Tuned,
}

/// The result of an identification from arrays.
#[derive(Clone, Debug)]
pub struct Identified {
    /// The model in the channels' units, with its parameter covariance. Its inputs and outputs are deviations from the
    /// operating point in `scaling`. The covariance is multiplied by `innovation_ratio`; standard deviations derived
    /// from the covariance are correct to within a factor of about two, because the innovations determine only a
    /// common factor of the noise covariances.
    pub model: Model,
    /// The operating point and the RMS values of the channels. The operating point consists of the means of the inputs
    /// and the outputs of the plant at rest under these inputs.
    pub scaling: ChannelScaling,
    /// The orders that were compared; `None` if the number of states was given.
    pub orders: Option<OrderScan>,
    /// The covariance form, conditional expectation, matrix library and number type of the recursion.
    pub variant: Variant,
    /// The noise covariances of the scaled channels.
    pub noise: NoiseModel,
    /// Mean square of the last innovations over their variance according to `noise` and the covariance of the estimate:
    /// the factor by which the noise covariances were too small.
    pub innovation_ratio: f64,
    /// The numerical condition of the covariance at the end.
    pub health: Health,
}

/// Appends an input that is always one.
///
/// The mean of an output over a finite record is not the plant's response to the mean of the inputs. The difference is
/// a constant that the plant does not explain. Without an input of its own, this constant takes an additional state
/// for each output, and the order selected from a record with little noise would include these states.
fn with_constant(inputs: &Array2<f64>) -> Array2<f64> {
    concatenate![Axis(1), inputs.view(), Array2::ones((inputs.nrows(), 1))]
}

/// Removes the constant input of [`with_constant`]. Returns the outputs (p) of the plant at rest under this input;
/// `None` if the plant has no equilibrium, for example because of a pole at 1.
fn take_constant(model: &mut Model) -> Option<DVector<f64>> {
    let last = model.m() - 1;
    let constant = model.b.column(last).into_owned();
    model.b = model.b.columns(0, last).into_owned();
    model.d = model.d.columns(0, last).into_owned();
    model.inputs.truncate(last);
    let size = (model.p() + last) * model.n();
    model.parameter_covariance =
        model.parameter_covariance.take().map(|all| all.view((0, 0), (size, size)).into_owned());
    let at_rest = (DMatrix::identity(model.n(), model.n()) - &model.a).lu().solve(&constant)?;
    Some(&model.c * at_rest).filter(|outputs| outputs.iter().all(|y| y.is_finite()))
}

/// Converts the estimate to a model in the channels' units, with all covariances multiplied by `ratio`, and moves the
/// operating point of the outputs to the equilibrium of the plant.
fn in_channel_units(
    plan: &Plan,
    done: &RecursionRun,
    ratio: f64,
    rate: f64,
    scaling: &mut ChannelScaling,
) -> Result<Model, ModelError> {
    let mut model = done.identified.to_model(rate)?;
    if let Some(offsets) = take_constant(&mut model) {
        let means = scaling.output_mean.iter_mut().zip(&scaling.output_scale);
        means.zip(offsets.iter()).for_each(|((mean, scale), offset)| *mean += scale * offset);
    }
    model.parameter_covariance = model.parameter_covariance.map(|covariance| covariance * ratio);
    let sensor = &plan.noise.sensor;
    let sensor_std = (0..sensor.rows()).map(|i| (ratio * sensor.at(i, i)).sqrt()).collect();
    model.noise = Noise { sensor_std: Some(sensor_std), actuator_std: None };
    undo_scaling(&model, scaling)
}

/// Returns the deviations of the channels from their means, divided by their RMS, and the means and RMS values.
#[allow(clippy::type_complexity)]
fn scaled(
    channels: ArrayView2<'_, f64>,
    letter: &str,
    nan_is_missing: bool,
) -> Result<(Array2<f64>, Vec<f64>, Vec<f64>), IdentificationError> {
    if channels.ncols() == 0 {
        return Err(IdentificationError::NoChannels);
    }
    let mut scaled = channels.to_owned();
    let (mut means, mut scales) = (Vec::new(), Vec::new());
    for (i, mut column) in scaled.columns_mut().into_iter().enumerate() {
        let channel = || format!("{letter}{}", i + 1);
        let is_bad = |x: &f64| !(x.is_finite() || nan_is_missing && x.is_nan());
        if let Some(sample) = column.iter().position(is_bad) {
            return Err(IdentificationError::NotFinite { channel: channel(), sample });
        }
        let mean = mean(column.view(), |x| x);
        column.mapv_inplace(|x| x - mean);
        let rms = self::mean(column.view(), |x| x * x).sqrt();
        // In a constant channel, rounding leaves a small remainder of the mean.
        if !(rms > 1e-12 * mean.abs()) {
            return Err(IdentificationError::Constant { channel: channel() });
        }
        column.mapv_inplace(|x| x / rms);
        means.push(mean);
        scales.push(rms);
    }
    Ok((scaled, means, scales))
}

/// Returns the mean of `f` over the samples that are not missing.
fn mean(column: ArrayView1<'_, f64>, f: impl Fn(f64) -> f64) -> f64 {
    let present = column.iter().filter(|x| !x.is_nan());
    let (sum, count) = present.fold((0.0, 0), |(sum, count), &x| (sum + f(x), count + 1));
    sum / f64::from(count.max(1))
}

/// The reasons why an identification from arrays fails.
#[derive(Debug, thiserror::Error)]
pub enum IdentificationError {
    /// Inputs and outputs have different numbers of rows.
    #[error("there are {inputs} rows of inputs and {outputs} of outputs; each sample needs a row of both")]
    Lengths {
        /// Rows of the inputs.
        inputs: usize,
        /// Rows of the outputs.
        outputs: usize,
    },
    /// An array has no columns.
    #[error("at least one input and one output are needed")]
    NoChannels,
    /// A channel has a sample that is not finite.
    #[error("sample {sample} of {channel} is not a finite number (samples count from 0)")]
    NotFinite {
        /// The channel: u1, u2, ... or y1, y2, ...
        channel: String,
        /// The index of the sample, counted from 0.
        sample: usize,
    },
    /// A channel never changes.
    #[error("{channel} is constant")]
    Constant {
        /// The channel: u1, u2, ... or y1, y2, ...
        channel: String,
    },
    /// The record is too short for any order.
    #[error("{samples} samples are too few to identify a model")]
    TooShort {
        /// Number of samples.
        samples: usize,
    },
    /// The number of states does not suit the outputs.
    #[error(transparent)]
    Structure(#[from] StructureError),
    /// The recursion failed, or no noise covariances gave a model.
    #[error(transparent)]
    Identify(#[from] IdentifyError),
    /// The result is not a valid model.
    #[error(transparent)]
    Model(#[from] ModelError),
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::dmatrix;
    use plid_model::{mode_deviations, modes, simulate};
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    const RATE: f64 = 50.0;

    /// Returns a plant with two modes, two inputs and two outputs.
    fn plant() -> Model {
        plant_of(4, 2)
    }

    /// Returns a plant with two or three modes, and with one or two inputs and as many outputs.
    fn plant_of(states: usize, channels: usize) -> Model {
        let mut a = DMatrix::zeros(6, 6);
        for (at, radius, angle) in [(0, 0.97_f64, 0.6_f64), (2, 0.95, 1.3), (4, 0.98, 2.0)] {
            let (sin, cos) = angle.sin_cos();
            a.view_mut((at, at), (2, 2)).copy_from_slice(&[radius * cos, radius * sin, -radius * sin, radius * cos]);
        }
        let b = dmatrix![0.3, 0.0; 0.1, -0.4; 0.2, 0.5; 0.0, 0.3; 0.3, 0.1; -0.2, 0.3];
        let c = dmatrix![1.0, 0.2, 0.5, -0.3, 0.4, 0.3; -0.4, 1.0, 0.8, 0.1, -0.5, 0.6];
        let part = |of: &DMatrix<f64>, rows, columns| of.view((0, 0), (rows, columns)).into_owned();
        let d = DMatrix::zeros(channels, channels);
        Model::new(RATE, part(&a, states, states), part(&b, states, channels), part(&c, channels, states), d).unwrap()
    }

    /// Returns inputs and noisy outputs of [`plant`].
    fn record(seed: u64, samples: usize, noise: f64) -> (Array2<f64>, Array2<f64>) {
        record_of(&plant(), seed, samples, noise)
    }

    fn record_of(plant: &Model, seed: u64, samples: usize, noise: f64) -> (Array2<f64>, Array2<f64>) {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
        let inputs = Array2::from_shape_simple_fn((samples, plant.m()), &mut normal);
        let mut outputs = simulate(plant, inputs.view(), &plant.rest()).unwrap().outputs;
        outputs.mapv_inplace(|y| y + noise * normal());
        (inputs, outputs)
    }

    #[test]
    fn the_order_the_modes_and_their_deviations_are_found() {
        let truth = modes(&plant()).unwrap();
        let (mut sum, mut count) = (0.0, 0);
        for seed in 0..8 {
            let (u, y) = record(seed, 1500, 0.05);
            let identified = identify(u.view(), y.view(), RATE).unwrap();
            assert_eq!(identified.model.n(), 4, "{:?}", identified.orders);
            for (found, truth) in mode_deviations(&identified.model).unwrap().iter().zip(&truth) {
                let std = found.hz_std.unwrap();
                assert!(std < 0.01 * truth.hz && (found.mode.hz - truth.hz).abs() < 5.0 * std, "{found:?} {truth:?}");
                sum += ((found.mode.hz - truth.hz) / std).powi(2);
                count += 1;
            }
        }
        // The standard deviations are correct to within a factor of two; the mean squared ratio was 2.0 when this test
        // was written.
        let ratio = sum / f64::from(count);
        assert!((0.25..4.0).contains(&ratio), "{ratio}");
    }

    /// The remainder after removal of the means requires no additional states, whether noise hides it or not.
    #[test]
    fn the_order_is_found_without_noise_with_little_and_with_much() {
        for (states, channels) in [(4, 1), (4, 2), (6, 1), (6, 2)] {
            let plant = plant_of(states, channels);
            for (seed, noise) in [(1, 0.0), (1, 1e-4), (2, 0.01), (3, 0.1)] {
                let (u, y) = record_of(&plant, seed, 600, noise);
                let (u, y) = (u.mapv(|u| u + 3.0), y.mapv(|y| y - 20.0));
                let identified = identify(u.view(), y.view(), RATE).unwrap();
                assert_eq!(identified.model.n(), states, "{channels} channels, noise {noise}: {:?}", identified.orders);
                let (truth, found) = (modes(&plant).unwrap(), modes(&identified.model).unwrap());
                assert!(
                    truth.iter().zip(&found).all(|(t, f)| (f.hz / t.hz - 1.0).abs() < 1e-6 + 0.3 * noise),
                    "{found:?}"
                );
            }
        }
    }

    /// At the operating point, the outputs are the means of the inputs times the plant's gain at zero frequency.
    #[test]
    fn the_plant_is_at_rest_at_the_operating_point() {
        let plant = plant();
        let (u, _) = record(6, 600, 0.0);
        let u = u.mapv(|u| u + 2.0);
        let y = simulate(&plant, u.view(), &plant.rest()).unwrap().outputs;
        let identified = Identification::default().states(4).run(u.view(), y.view(), RATE).unwrap();
        let gain = |model: &Model| &model.c * (DMatrix::identity(4, 4) - &model.a).try_inverse().unwrap() * &model.b;
        let expected = gain(&plant) * DVector::from_column_slice(&identified.scaling.input_mean);
        for (found, expected) in identified.scaling.output_mean.iter().zip(expected.iter()) {
            assert!((found - expected).abs() < 1e-6 * expected.abs(), "{found} {expected}");
        }
        assert!((gain(&identified.model) - gain(&plant)).norm() < 1e-6);
        assert_eq!((identified.model.m(), identified.noise.actuator.rows()), (2, 2));
    }

    #[test]
    fn a_watched_run_reports_and_can_be_stopped() {
        let (u, y) = record(3, 600, 0.05);
        let told = std::sync::atomic::AtomicUsize::new(0);
        let tell = |states, _, _| told.store(states, std::sync::atomic::Ordering::Relaxed);
        let options = Identification::default().states(4);
        let watch = |may_go_on| Watch { progress: &tell, may_go_on };
        assert!(options.run_watched(u.view(), y.view(), RATE, watch(&|| true)).is_ok());
        assert_eq!(told.into_inner(), 4);
        let quiet = Watch { progress: &|_, _, _| (), may_go_on: &|| false };
        let stopped = options.run_watched(u.view(), y.view(), RATE, quiet).unwrap_err();
        assert!(matches!(stopped, IdentificationError::Identify(IdentifyError::Interrupted)), "{stopped}");
    }

    #[test]
    fn units_and_offsets_do_not_change_the_modes() {
        let (u, y) = record(3, 1500, 0.05);
        let (other_u, other_y) = (u.mapv(|u| 1e-3 * u + 7.0), y.mapv(|y| 200.0 * y - 1e4));
        let options = Identification::default().states(4);
        let one = options.run(u.view(), y.view(), RATE).unwrap();
        let two = options.run(other_u.view(), other_y.view(), RATE).unwrap();
        let (first, second) = (mode_deviations(&one.model).unwrap(), mode_deviations(&two.model).unwrap());
        for (a, b) in first.iter().zip(&second) {
            assert!((a.mode.hz - b.mode.hz).abs() < 1e-6 * a.mode.hz, "{a:?} {b:?}");
            assert!((a.hz_std.unwrap() / b.hz_std.unwrap() - 1.0).abs() < 1e-3);
        }
        assert!((two.model.b[(0, 0)] / one.model.b[(0, 0)] / 2e5 - 1.0).abs() < 1e-4);
        assert!((two.scaling.input_mean[1] - 7.0).abs() < 1e-3);
    }

    #[test]
    fn another_variant_and_missing_outputs_give_nearly_the_same_model() {
        let (u, mut y) = record(4, 1500, 0.05);
        let plain = Identification::default().states(4);
        let reference = plain.run(u.view(), y.view(), RATE).unwrap();
        y[(700, 1)] = f64::NAN;
        let error = plain.run(u.view(), y.view(), RATE).unwrap_err();
        assert!(
            matches!(&error, IdentificationError::NotFinite { channel, sample: 700 } if channel == "y2"),
            "{error}"
        );
        let other = plain.covariance(CovarianceName::ArraySqrt).nan_is_missing().run(u.view(), y.view(), RATE).unwrap();
        assert_eq!(other.variant.covariance, CovarianceName::ArraySqrt);
        for (a, b) in modes(&reference.model).unwrap().iter().zip(&modes(&other.model).unwrap()) {
            assert!((a.hz / b.hz - 1.0).abs() < 1e-3, "{a:?} {b:?}");
        }
    }

    #[test]
    fn arrays_that_cannot_be_used_are_refused() {
        let (u, y) = record(5, 200, 0.05);
        let failure = |u: ArrayView2<'_, f64>, y: ArrayView2<'_, f64>| identify(u, y, RATE).unwrap_err().to_string();
        assert!(failure(u.slice(ndarray::s![..100, ..]), y.view()).contains("100 rows of inputs and 200"));
        assert!(failure(Array2::from_elem((200, 1), 0.1).view(), y.view()).contains("u1 is constant"));
        assert!(failure(u.slice(ndarray::s![.., ..0]), y.view()).contains("at least one input"));
        assert!(failure(u.slice(ndarray::s![..20, ..]), y.slice(ndarray::s![..20, ..])).contains("20 samples"));
        assert!(identify(u.view(), y.view(), 0.0).unwrap_err().to_string().contains("sample_rate_hz"));
    }
}
