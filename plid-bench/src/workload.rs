//! The workload of the benches and of the speed study: the simulated truss, and a recursion that processes its record
//! repeatedly.
//!
//! The time of a step does not depend on the numbers, provided that they are normal. The noise covariances are
//! therefore not those of the truss but chosen to keep every form sound in every scalar: R and P0 have similar
//! magnitudes, and Sigma keeps P from vanishing.

use plid_catalogue::{Recursion, Variant, VariantError};
use plid_core::{Dense, NoiseModel, ObservableForm, Settings};
use plid_testbed::{INPUTS, InputConfig, OUTPUTS, TestbedError, TrussConfig, WhiteNoise, simulate};
use serde::{Deserialize, Serialize};

/// Variances of sensor and actuator noise in V^2, and of state noise in the unit of the output squared.
const VARIANCES: [f64; 3] = [1e-2, 1e-3, 1e-4];
/// Correlation between any two noises if all covariances are full. The sum over a row is below 1, so the matrix is
/// positive definite.
const CORRELATION: f64 = 0.01;

/// The shape of the noise covariances.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Noise {
    /// R, Q and Sigma are diagonal, without covariances between them.
    #[default]
    Diagonal,
    /// All six covariances are full, without a zero.
    Full,
}

impl Noise {
    /// Returns the noise model of p outputs, m inputs and n states.
    pub fn model(self, p: usize, m: usize, n: usize) -> NoiseModel {
        let [sensor, actuator, state] = VARIANCES;
        let diagonal = NoiseModel::diagonal(&vec![sensor; p], &vec![actuator; m], &vec![state; n]);
        if self == Self::Diagonal {
            return diagonal;
        }
        let within = |size: usize, variance: f64| {
            Dense::from_fn(size, size, |i, j| if i == j { variance } else { CORRELATION * variance })
        };
        let between = |rows: usize, columns: usize, a: f64, b: f64| {
            Dense::from_fn(rows, columns, |_, _| CORRELATION * (a * b).sqrt())
        };
        NoiseModel {
            sensor: within(p, sensor),
            actuator: within(m, actuator),
            state: within(n, state),
            actuator_sensor: between(m, p, actuator, sensor),
            sensor_state: between(p, n, sensor, state),
            actuator_state: between(m, n, actuator, state),
        }
    }
}

/// A record of the truss with 1 to 3 inputs and 3 outputs.
#[derive(Clone, Debug)]
pub struct Record {
    inputs: usize,
    /// The m inputs in V, sample by sample.
    u: Vec<f64>,
    /// The p outputs in V, sample by sample.
    z: Vec<f64>,
}

impl Record {
    /// Simulates `duration_s` seconds of the default truss, driven by its first `inputs` inputs.
    ///
    /// # Errors
    /// Returns an error if the truss cannot be simulated.
    ///
    /// # Panics
    /// Panics if the truss has fewer inputs.
    pub fn truss(inputs: usize, duration_s: f64) -> Result<Self, TestbedError> {
        assert!((1..=INPUTS).contains(&inputs), "the truss has {INPUTS} inputs");
        let level_rms_v = std::array::from_fn(|j| if j < inputs { 1.0 } else { 0.0 });
        let input = InputConfig::WhiteNoise(WhiteNoise { level_rms_v, ..WhiteNoise::default() });
        let simulation = simulate(&TrussConfig { duration_s, input, ..TrussConfig::default() })?;
        let rows = simulation.commands.rows();
        Ok(Self {
            inputs,
            u: rows.into_iter().flat_map(|row| row.into_iter().take(inputs).copied()).collect(),
            z: simulation.outputs[0].iter().copied().collect(),
        })
    }

    /// Returns the number of samples K.
    pub fn samples(&self) -> usize {
        self.z.len() / OUTPUTS
    }
}

/// A record, and the starting point of its identification.
#[derive(Clone, Debug)]
pub struct Workload<'a> {
    record: &'a Record,
    form: ObservableForm,
    noise: NoiseModel,
    settings: Settings,
}

impl<'a> Workload<'a> {
    /// Prepares the identification of `record` with `states` states.
    ///
    /// # Errors
    /// Returns an error if there are fewer states than outputs.
    pub fn new(record: &'a Record, states: usize, noise: Noise) -> Result<Self, plid_core::StructureError> {
        let form = ObservableForm::balanced(states, OUTPUTS, record.inputs)?;
        let noise = noise.model(OUTPUTS, record.inputs, states);
        let settings = Settings::new(&form, 1.0, 1.0);
        Ok(Self { record, form, noise, settings })
    }

    /// Returns the recursion of `variant` before its first sample.
    ///
    /// # Errors
    /// Returns a [`VariantError`].
    pub fn recursion(&self, variant: Variant) -> Result<Loop<'a>, VariantError> {
        Ok(self.with(variant.build(self.form.clone(), &self.noise, &self.settings)?))
    }

    /// Returns a recursion of other types before its first sample. `build` receives the form, the noise and the
    /// start.
    pub fn build<R>(&self, build: impl FnOnce(ObservableForm, &NoiseModel, &Settings) -> R) -> R {
        build(self.form.clone(), &self.noise, &self.settings)
    }

    /// Returns the loop of a recursion over the record.
    pub fn with(&self, recursion: Box<dyn Recursion>) -> Loop<'a> {
        Loop { record: self.record, recursion, next: 0 }
    }
}

/// A recursion that restarts the record with its current estimate whenever it reaches the end.
pub struct Loop<'a> {
    record: &'a Record,
    recursion: Box<dyn Recursion>,
    next: usize,
}

impl Loop<'_> {
    /// Takes the next sample.
    ///
    /// # Errors
    /// Returns the errors of [`plid_core::Identifier::step`].
    pub fn step(&mut self) -> Result<(), plid_core::IdentifierError> {
        let (k, m) = (self.next, self.record.inputs);
        self.next = (k + 1) % self.record.samples();
        let z = &self.record.z[k * OUTPUTS..][..OUTPUTS];
        self.recursion.step(z, &self.record.u[k * m..][..m], false)
    }

    /// Returns the recursion.
    pub fn recursion(&self) -> &dyn Recursion {
        self.recursion.as_ref()
    }
}

#[cfg(test)]
mod tests {
    use plid_catalogue::{CovarianceName, ExpectationName, ScalarName};

    use super::*;

    #[test]
    fn the_loop_goes_on_over_the_records_end() {
        let record = Record::truss(3, 0.05).unwrap();
        assert_eq!(record.samples(), 80);
        let mut steps = Workload::new(&record, 12, Noise::Diagonal).unwrap().recursion(Variant::default()).unwrap();
        for _ in 0..81 {
            steps.step().unwrap();
        }
        // Sample 0 has been processed twice. The first innovation is the output itself, and the second is the output
        // minus a prediction.
        let innovation = steps.recursion().innovation()[0];
        assert!(innovation.is_finite() && innovation != record.z[0]);
        assert!(steps.recursion().health().smallest_pivot > 0.0);
    }

    #[test]
    fn the_full_noise_model_is_a_covariance_without_a_zero() {
        for (m, n) in [(1, 12), (3, 64)] {
            let noise = Noise::Full.model(OUTPUTS, m, n);
            noise.check(OUTPUTS, m, n).unwrap();
            let all = [&noise.sensor, &noise.actuator, &noise.state, &noise.actuator_sensor, &noise.actuator_state];
            assert!(all.iter().all(|matrix| matrix.data().iter().all(|&x| x != 0.0)));
        }
    }

    #[test]
    fn fewer_states_than_outputs_are_refused() {
        assert!(Workload::new(&Record::truss(1, 0.05).unwrap(), 2, Noise::Diagonal).is_err());
    }

    #[test]
    fn every_form_and_expectation_stays_sound_in_single_precision() {
        use {CovarianceName as C, ExpectationName as E};
        for inputs in [1, 3] {
            let record = Record::truss(inputs, 1.0).unwrap();
            for noise in [Noise::Diagonal, Noise::Full] {
                let workload = Workload::new(&record, 12, noise).unwrap();
                for covariance in C::BUILT_IN {
                    for expectations in E::BUILT_IN {
                        let variant =
                            Variant { covariance, expectations, scalar: ScalarName::F32, ..Variant::default() };
                        let mut steps = workload.recursion(variant).unwrap();
                        for _ in 0..record.samples() {
                            steps.step().unwrap_or_else(|error| panic!("{variant:?} {inputs} {noise:?}: {error}"));
                        }
                    }
                }
            }
        }
    }
}
