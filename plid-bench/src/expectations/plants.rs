//! The three kinds of plant: scalar, of moderate order within the model class, and the truss, which is not in it.

use nalgebra::DMatrix;
use ndarray::Array2;
use plid_core::{ImplicitModel, InitialCovariance, NoiseModel, ObservableForm, Settings};
use plid_testbed::{INPUTS, OUTPUTS, TestbedError, TrussConfig, simulate};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::grid::ScalarPrior;
use super::trial::{InClass, Trial, normal, white};
use plid_model::signal::rms;

/// Samples of the record that is not used for estimation.
const HELD_OUT: usize = 1000;
/// Spectral radii of modes.
const RADII: (f64, f64) = (0.90, 0.98);
/// Largest permissible entry of a column a_i. If an entry is larger, the plant is nearly unobservable, and another
/// plant is drawn.
const LARGEST_ENTRY: f64 = 3.0;

/// The level of the noise and the assumptions about it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Loudness {
    /// RMS of the response to the input over RMS of all noise in the outputs.
    pub signal_to_noise: f64,
    /// The share of the noise power in the outputs that is due to state noise. Sensors cause the rest.
    pub state_share: f64,
    /// Ratio of the assumed Sigma to the true one.
    pub told_factor: f64,
}

/// Draws a scalar plant with parameters from the prior and inputs of +-1. The powers of signal and noise are those of
/// the plant at the mean of the prior, so that the noise variances, which are known, contain no information about the
/// parameters.
pub fn scalar(prior: &ScalarPrior, loudness: Loudness, steps: usize, seed: u64) -> Trial {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let (a, b) = prior.draw(|| normal(&mut rng));
    let x0 = prior.state_variance.sqrt() * normal(&mut rng);
    // The power in the output of white noise of unit variance that enters the state.
    let power = 1.0 / (1.0 - prior.a.0.powi(2));
    let noise = prior.b.0.powi(2) * power / loudness.signal_to_noise.powi(2);
    let form = ObservableForm::new(&[1], 1).expect("one output, one state, one input");
    let plant = InClass {
        form: form.clone(),
        parameters: vec![a, b],
        sensor: (1.0 - loudness.state_share) * noise,
        state: loudness.state_share * noise / power,
    };
    let mut signs = |count| Array2::from_shape_simple_fn((count, 1), || if rng.random::<bool>() { 1.0 } else { -1.0 });
    let (inputs, held_out) = (signs(steps), signs(HELD_OUT));
    let outputs = plant.simulate(&inputs, vec![x0], &mut || normal(&mut rng));
    let settings = Settings {
        initial_covariance: InitialCovariance::Diagonal(vec![prior.state_variance, prior.a.1, prior.b.1]),
        initial_estimate: vec![0.0, prior.a.0, prior.b.0],
        ..Settings::new(&form, 1.0, 1.0)
    };
    finish(plant, settings, loudness.told_factor, inputs, outputs, held_out)
}

fn finish(
    plant: InClass,
    settings: Settings,
    told_factor: f64,
    inputs: Array2<f64>,
    outputs: Array2<f64>,
    held_out: Array2<f64>,
) -> Trial {
    Trial {
        form: plant.form.clone(),
        inputs,
        outputs,
        told: plant.noise(told_factor),
        true_noise: Some(plant.noise(1.0)),
        settings,
        held_out: (held_out.clone(), plant.response(&held_out)),
        truth: Some(plant.parameters),
    }
}

/// Returns the solution X of X = A X A^T + Q for a stable A, by doubling.
fn stationary(a: &DMatrix<f64>, q: &DMatrix<f64>) -> DMatrix<f64> {
    let (mut power, mut sum) = (a.clone(), q.clone());
    // A mode that has not settled within 2^40 samples is unstable.
    for _ in 0..40 {
        let more = &power * &sum * power.transpose();
        if more.norm() <= 1e-15 * sum.norm() {
            break;
        }
        sum += more;
        power = &power * &power;
    }
    sum
}

/// Returns A, B and C of a structure in modal form, with outputs of unit variance for white inputs of unit variance.
fn modal(n: usize, m: usize, p: usize, rng: &mut ChaCha8Rng) -> [DMatrix<f64>; 3] {
    let mut a = DMatrix::zeros(n, n);
    let radius = |rng: &mut ChaCha8Rng| RADII.0 + (RADII.1 - RADII.0) * rng.random::<f64>();
    for mode in 0..n / 2 {
        // One mode in each equal part of the band between 0.1 and 0.9 of the Nyquist frequency.
        let place = (mode as f64 + 0.2 + 0.6 * rng.random::<f64>()) / (n / 2) as f64;
        let (r, angle) = (radius(rng), std::f64::consts::PI * (0.1 + 0.8 * place));
        let (re, im, k) = (r * angle.cos(), r * angle.sin(), 2 * mode);
        (a[(k, k)], a[(k, k + 1)], a[(k + 1, k)], a[(k + 1, k + 1)]) = (re, im, -im, re);
    }
    if n % 2 == 1 {
        a[(n - 1, n - 1)] = radius(rng);
    }
    let b = DMatrix::from_fn(n, m, |_, _| normal(rng));
    let mut c = DMatrix::from_fn(p, n, |_, _| normal(rng));
    let power = &c * stationary(&a, &(&b * b.transpose())) * c.transpose();
    for (i, mut row) in c.row_iter_mut().enumerate() {
        row /= power[(i, i)].sqrt();
    }
    [a, b, c]
}

/// Returns the parameters [a_1; ..; b_m] of a plant in the form with p equal indices, or `None` if the plant is not
/// observable.
fn canonical(a: &DMatrix<f64>, b: &DMatrix<f64>, c: &DMatrix<f64>, form: &ObservableForm) -> Option<Vec<f64>> {
    let (n, p) = (form.states(), form.outputs());
    let each = n / p;
    let observability = |a: &DMatrix<f64>, c: &DMatrix<f64>| {
        let mut rows = DMatrix::zeros(n, n);
        let mut row = c.clone();
        for power in 0..each {
            rows.view_mut((power * p, 0), (p, n)).copy_from(&row);
            row *= a;
        }
        (rows, row)
    };
    // The equations of the outputs are C A^q = sum_l L_l C A^l, where a_i[block j, l] is entry (j, i) of L_l.
    let (old, next) = observability(a, c);
    let equations = old.transpose().lu().solve(&next.transpose())?.transpose();
    let mut parameters: Vec<f64> = (0..p)
        .flat_map(|i| (0..n).map(move |row| (i, row)))
        .map(|(i, row)| equations[(row / each, row % each * p + i)])
        .collect();
    parameters.resize((p + form.inputs()) * n, 0.0);
    let (a, c) = matrices(form, &parameters);
    let b = observability(&a, &c).0.lu().solve(&(old * b))?;
    parameters[p * n..].copy_from_slice(b.as_slice());
    parameters.iter().all(|x| x.is_finite()).then_some(parameters)
}

/// Returns A and C of the form.
pub fn matrices(form: &ObservableForm, parameters: &[f64]) -> (DMatrix<f64>, DMatrix<f64>) {
    let n = form.states();
    let mut a = DMatrix::from_fn(n, n, |i, j| if form.shift_source(i) == Some(j) { 1.0 } else { 0.0 });
    let mut c = DMatrix::zeros(form.outputs(), n);
    for (i, (&state, column)) in form.output_states().iter().zip(parameters.chunks_exact(n)).enumerate() {
        c[(i, state)] = 1.0;
        a.column_mut(state).iter_mut().zip(column).for_each(|(a, x)| *a += x);
    }
    (a, c)
}

/// Draws a random plant of lightly damped modes in the form with equal indices. The initial estimate scatters about
/// the truth with the covariance P0, so the NEES of a consistent filter is one from the start.
pub fn in_class(form: &ObservableForm, loudness: Loudness, initial_std: f64, steps: usize, seed: u64) -> Trial {
    let (n, m, p) = (form.states(), form.inputs(), form.outputs());
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let parameters = loop {
        let [a, b, c] = modal(n, m, p, &mut rng);
        let found = canonical(&a, &b, &c, form);
        if let Some(found) = found.filter(|x| x[..p * n].iter().all(|a| a.abs() <= LARGEST_ENTRY)) {
            break found;
        }
    };
    let (a, c) = matrices(form, &parameters);
    let b = DMatrix::from_column_slice(n, m, &parameters[p * n..]);
    // The outputs have unit variance without noise.
    let noise = loudness.signal_to_noise.powi(-2);
    let gain = (&c * stationary(&a, &DMatrix::identity(n, n)) * c.transpose()).trace() / p as f64;
    let plant = InClass {
        form: form.clone(),
        parameters,
        sensor: (1.0 - loudness.state_share) * noise,
        state: loudness.state_share * noise / gain,
    };
    let variances: Vec<f64> = stationary(&a, &(&b * b.transpose())).diagonal().iter().copied().collect();
    let x0 = variances.iter().map(|v| v.sqrt() * normal(&mut rng)).collect();
    let initial: Vec<f64> = std::iter::repeat_n(0.0, n)
        .chain(plant.parameters.iter().map(|x| x + initial_std * normal(&mut rng)))
        .collect();
    let (inputs, held_out) = (white(&mut rng, steps, m), white(&mut rng, HELD_OUT, m));
    let outputs = plant.simulate(&inputs, x0, &mut || normal(&mut rng));
    let mut p0 = vec![initial_std.powi(2); form.joint_states()];
    p0[..n].copy_from_slice(&variances);
    let settings = Settings {
        initial_covariance: InitialCovariance::Diagonal(p0),
        initial_estimate: initial,
        ..Settings::new(form, 1.0, 1.0)
    };
    finish(plant, settings, loudness.told_factor, inputs, outputs, held_out)
}

/// Returns a trial of the truss without converters, whose three sources of noise are scaled by one factor. It is
/// identified with fewer states than it has. R and Q are the true ones; `ratio` is the assumed Sigma over R.
///
/// # Errors
/// Returns the error of the testbed.
pub fn truss(
    states: usize,
    signal_to_noise: f64,
    ratio: f64,
    duration_s: [f64; 2],
    seed: u64,
) -> Result<Trial, TestbedError> {
    let [learnt_s, held_out_s] = duration_s;
    let mut config = TrussConfig { duration_s: learnt_s, seed, ..TrussConfig::default() };
    config.converters.step_v = 0.0;
    config.converters.range_v = f64::INFINITY;
    let loud = |config: &TrussConfig| -> Result<f64, TestbedError> {
        let truth = plid_testbed::truss(config)?;
        let (a, b, c) = (&truth.discrete.a, &truth.discrete.b, &truth.discrete.c);
        let states = stationary(a, &(b * &truth.noise.actuator * b.transpose() + &truth.noise.state));
        Ok(((c * states * c.transpose() + &truth.noise.sensor).trace() / OUTPUTS as f64).sqrt())
    };
    let factor = rms(&simulate(&config)?.noise_free) / signal_to_noise / loud(&config)?;
    for level in [&mut config.noise.sensor_rms_v, &mut config.noise.amplifier_rms_v, &mut config.noise.ambient_rms_v] {
        *level *= factor;
    }
    let learnt = simulate(&config)?;
    // Studies use small seeds, so this one is not used elsewhere.
    let other = simulate(&TrussConfig { duration_s: held_out_s, seed: seed + (1 << 40), ..config })?;
    let form = ObservableForm::balanced(states, OUTPUTS, INPUTS).expect("a config has been checked");
    let sensor = learnt.truth.noise.sensor.diagonal();
    let actuator = learnt.truth.noise.actuator.diagonal();
    Ok(Trial {
        told: NoiseModel::diagonal(sensor.as_slice(), actuator.as_slice(), &vec![ratio * sensor.mean(); states]),
        true_noise: None,
        settings: Settings::new(&form, 1.0, 1.0),
        truth: None,
        inputs: learnt.commands,
        outputs: learnt.outputs.into_iter().next().expect("one repeat"),
        held_out: (other.commands, other.noise_free),
        form,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_canonical_form_has_the_modes_and_the_response_of_the_modal_one() {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        for (n, m, p) in [(4, 1, 2), (9, 2, 3), (12, 3, 3)] {
            let form = ObservableForm::balanced(n, p, m).unwrap();
            let [a, b, c] = modal(n, m, p, &mut rng);
            let parameters = canonical(&a, &b, &c, &form).unwrap();
            let (ac, cc) = matrices(&form, &parameters);
            let bc = DMatrix::from_column_slice(n, m, &parameters[p * n..]);
            let (mut x, mut xc) = (b, bc);
            for _ in 0..30 {
                assert!((&c * &x - &cc * &xc).norm() < 1e-8 * (1.0 + (&c * &x).norm()));
                (x, xc) = (&a * x, &ac * xc);
            }
        }
    }

    #[test]
    fn signal_and_noise_are_what_was_asked_for() {
        let form = ObservableForm::new(&[2, 2], 1).unwrap();
        let loudness = |state_share| Loudness { signal_to_noise: 2.0, state_share, told_factor: 1.0 };
        for share in [0.0, 0.5, 1.0] {
            let trial = in_class(&form, loudness(share), 0.1, 40_000, 5);
            let noise = trial.true_noise.as_ref().unwrap();
            let plant = InClass {
                form: form.clone(),
                parameters: trial.truth.clone().unwrap(),
                sensor: noise.sensor.at(0, 0),
                state: noise.state.at(0, 0),
            };
            let response = plant.response(&trial.inputs);
            let (signal, rest) = (rms(&response), rms(&(&trial.outputs - &response)));
            assert!((signal - 1.0).abs() < 0.06 && (rest - 0.5).abs() < 0.04, "{share}: {signal}, {rest}");
        }
        assert_eq!(
            in_class(&form, loudness(0.2), 0.1, 50, 5).outputs,
            in_class(&form, loudness(0.2), 0.1, 50, 5).outputs
        );
    }

    #[test]
    fn the_trusss_noise_is_scaled_to_the_signal() {
        let trial = truss(12, 3.0, 1e-3, [1.0, 0.1], 1).unwrap();
        let clean = simulate(&TrussConfig { duration_s: 1.0, ..TrussConfig::default() }).unwrap().noise_free;
        let noise = rms(&(&trial.outputs - &clean));
        // The narrow-band motion due to the ambient force has few independent samples per second.
        assert!((rms(&clean) / noise / 3.0 - 1.0).abs() < 0.2, "{}", rms(&clean) / noise);
    }
}
