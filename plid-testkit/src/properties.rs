//! Properties that hold for any structure, record and noise.

use crate::case::{Case, Options, random_case};
use crate::dense::Mat;
use crate::reference::{Kind, Reference};
use crate::run::{Variant, identified, outcome, relative, take};
use nalgebra::DMatrix;
use plid_backends::Plain;
use plid_core::kernels::Kernels;
use plid_core::{
    Checkpoint, ConditionalExpectations, Dense, Form, IdentifierError, ImplicitModel, InitialCovariance, NoiseModel,
    ObservableForm, Scalar, ScalarOf, Unsupported,
};
use plid_variants::covariance::{BiermanUd, Direct};
use proptest::prelude::*;
use proptest::test_runner::{RngSeed, TestRunner};

const STEPS: usize = 60;

/// Returns cases of random structure, noise level and record, some of them with missing outputs, changing noise or a
/// full P0.
fn cases() -> impl Strategy<Value = Case> {
    let options = (-3.0..0.0_f64, 1..3_usize, prop_oneof![Just(0.0), 0.05..0.4_f64], any::<bool>()).prop_map(
        |(level, noise_models, missing, full_initial)| Options {
            steps: STEPS,
            noise_scale: 10.0_f64.powf(level),
            noise_models,
            missing,
            full_initial,
        },
    );
    (prop::collection::vec(1..4_usize, 1..4), 1..4_usize, options, any::<u64>())
        .prop_map(|(indices, inputs, options, seed)| random_case(&indices, inputs, options, seed))
}

fn config() -> ProptestConfig {
    // Every run has the same cases, because an occasional failure would not help a developer who changed nothing.
    // PROPTEST_RNG_SEED selects other cases, and PROPTEST_CASES sets their number.
    let asked = ProptestConfig::default();
    let rng_seed = match asked.rng_seed {
        RngSeed::Random => RngSeed::Fixed(1995),
        fixed => fixed,
    };
    let cases = if std::env::var_os("PROPTEST_CASES").is_some() { asked.cases } else { 16 };
    ProptestConfig { cases, rng_seed, failure_persistence: None, ..asked }
}

/// Returns the permutation of s for the outputs in the order `order`, from new entry to old entry.
fn permuted_places(indices: &[usize], inputs: usize, order: &[usize]) -> Vec<usize> {
    let n: usize = indices.iter().sum();
    let start = |i: usize| indices[..i].iter().sum::<usize>();
    let states: Vec<usize> = order.iter().flat_map(|&i| start(i)..start(i) + indices[i]).collect();
    let columns =
        std::iter::once(0).chain(order.iter().map(|&i| 1 + i)).chain((0..inputs).map(|j| 1 + order.len() + j));
    columns.flat_map(|column| states.iter().map(move |&x| column * n + x).collect::<Vec<_>>()).collect()
}

fn reorder(m: &Dense<f64>, rows: &[usize], columns: &[usize]) -> Dense<f64> {
    Dense::from_fn(rows.len(), columns.len(), |i, j| m.at(rows[i], columns[j]))
}

fn permuted(case: &Case, order: &[usize]) -> Case {
    let places = permuted_places(&case.indices, case.inputs, order);
    let n = case.states();
    let (states, inputs): (Vec<usize>, Vec<usize>) = (places[..n].to_vec(), (0..case.inputs).collect());
    let mut other = case.clone();
    other.indices = order.iter().map(|&i| case.indices[i]).collect();
    for z in &mut other.z {
        *z = order.iter().map(|&i| z[i]).collect();
    }
    for noise in &mut other.noise {
        *noise = NoiseModel {
            sensor: reorder(&noise.sensor, order, order),
            actuator: noise.actuator.clone(),
            state: reorder(&noise.state, &states, &states),
            actuator_sensor: reorder(&noise.actuator_sensor, &inputs, order),
            sensor_state: reorder(&noise.sensor_state, order, &states),
            actuator_state: reorder(&noise.actuator_state, &inputs, &states),
        };
    }
    other.settings.initial_estimate = places.iter().map(|&i| case.settings.initial_estimate[i]).collect();
    other.settings.initial_covariance = match &case.settings.initial_covariance {
        InitialCovariance::Diagonal(d) => InitialCovariance::Diagonal(places.iter().map(|&i| d[i]).collect()),
        InitialCovariance::Full(p) => InitialCovariance::Full(reorder(p, &places, &places)),
    };
    other
}

/// Returns the factors of the states and of s for outputs in units that are alpha_i times smaller, and for inputs in
/// units that are beta_j times smaller.
fn factors(case: &Case, alpha: &[f64], beta: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let states: Vec<f64> = case.indices.iter().zip(alpha).flat_map(|(&n, &a)| vec![a; n]).collect();
    let columns = std::iter::once(1.0).chain(alpha.iter().map(|a| 1.0 / a)).chain(beta.iter().map(|b| 1.0 / b));
    let joint = columns.flat_map(|c| states.iter().map(move |x| c * x).collect::<Vec<_>>()).collect();
    (states, joint)
}

fn scale_entries(m: &Dense<f64>, rows: &[f64], columns: &[f64]) -> Dense<f64> {
    Dense::from_fn(m.rows(), m.columns(), |i, j| rows[i] * m.at(i, j) * columns[j])
}

fn rescaled(case: &Case, alpha: &[f64], beta: &[f64]) -> Case {
    let (states, joint) = factors(case, alpha, beta);
    let mut other = case.clone();
    for (z, u) in other.z.iter_mut().zip(&mut other.u) {
        z.iter_mut().zip(alpha).for_each(|(z, a)| *z *= a);
        u.iter_mut().zip(beta).for_each(|(u, b)| *u *= b);
    }
    for noise in &mut other.noise {
        *noise = NoiseModel {
            sensor: scale_entries(&noise.sensor, alpha, alpha),
            actuator: scale_entries(&noise.actuator, beta, beta),
            state: scale_entries(&noise.state, &states, &states),
            actuator_sensor: scale_entries(&noise.actuator_sensor, beta, alpha),
            sensor_state: scale_entries(&noise.sensor_state, alpha, &states),
            actuator_state: scale_entries(&noise.actuator_state, beta, &states),
        };
    }
    other.settings.initial_estimate.iter_mut().zip(&joint).for_each(|(s, f)| *s *= f);
    other.settings.initial_covariance = match &case.settings.initial_covariance {
        InitialCovariance::Diagonal(d) => {
            InitialCovariance::Diagonal(d.iter().zip(&joint).map(|(d, f)| d * f * f).collect())
        }
        InitialCovariance::Full(p) => InitialCovariance::Full(scale_entries(p, &joint, &joint)),
    };
    other
}

/// Returns |found - factors x original| over |original|, for s and for P.
fn transformed_difference<S: Kernels>(
    variant: &Variant<S>,
    original: &Case,
    other: &Case,
    places: &[usize],
    factors: &[f64],
) -> (f64, f64) {
    let ((s, p), (s_other, p_other)) = (outcome(&variant.finish(original)), outcome(&variant.finish(other)));
    let f = |x: f64| qd::Quad::from_f64(x);
    let back = |i: usize| places.iter().position(|&place| place == i).unwrap();
    let undone_s = Mat::from_fn(s.rows, 1, |i, _| s_other[(back(i), 0)] / f(factors[i]));
    let undone_p = Mat::from_fn(p.rows, p.rows, |i, j| p_other[(back(i), back(j))] / f(factors[i]) / f(factors[j]));
    (relative(&undone_s, &s), relative(&undone_p, &p))
}

fn smallest_eigenvalue(p: &Dense<f64>) -> (f64, f64) {
    let eigenvalues = DMatrix::from_fn(p.rows(), p.rows(), |i, j| p.at(i, j)).symmetric_eigenvalues();
    (eigenvalues.min(), eigenvalues.max())
}

/// P is exactly symmetric and positive semidefinite, and its health states this.
fn stays_a_covariance<S: Kernels>(variant: &Variant<S>, case: &Case) {
    let run = variant.finish(case);
    let p = run.covariance().own_dense();
    for j in 0..p.rows() {
        for i in 0..j {
            assert_eq!(p.at(i, j), p.at(j, i), "the triangles of `dense_in` differ at ({i}, {j})");
        }
    }
    let (smallest, largest) = smallest_eigenvalue(&p.cast());
    assert!(smallest > -1e-14 * largest, "{}: eigenvalue {smallest:.1e} of {largest:.1e}", variant.label());
    let health = run.covariance().own_health();
    assert!(health.smallest_pivot > 0.0 && health.condition >= 1.0 && health.symmetry_defect == 0.0, "{health:?}");
    assert!(health.index < p.rows());
}

/// Returns a limit on the effect of rounding on a run. The matrix forms subtract, so the remaining P has the roundoff
/// of the largest earlier P, and the gain divides by R.
fn rounding<S: Kernels>(variant: &Variant<S>, case: &Case) -> f64 {
    let mut run = variant.with_form::<BiermanUd<Plain<S>>>().on(case);
    let mut largest = outcome(&run).1.norm();
    for k in 0..STEPS {
        take(&mut run, case, k).unwrap();
        largest = largest.max(outcome(&run).1.norm());
    }
    let least = case.noise.iter().map(|noise| smallest_eigenvalue(&noise.sensor).0).fold(f64::INFINITY, f64::min);
    1e-12 + 1e-14 * largest / least
}

fn agrees_with<S: Kernels>(variant: &Variant<S>, case: &Case) {
    let (s, p) = outcome(&variant.finish(case));
    let (s_ud, p_ud) = outcome(&variant.with_form::<BiermanUd<Plain<S>>>().finish(case));
    let (ds, dp, limit) = (relative(&s, &s_ud), relative(&p, &p_ud), rounding(variant, case));
    assert!(ds < limit && dp < limit, "{}: s {ds:.1e}, P {dp:.1e}, not {limit:.1e}", variant.label());
}

/// A run continued from a checkpoint, through JSON, is bit-identical to the run that was not interrupted.
fn continues_from_a_checkpoint<S: Kernels>(variant: &Variant<S>, case: &Case) {
    let whole = variant.finish(case);
    let mut first = variant.on(case);
    for k in 0..23 {
        take(&mut first, case, k).unwrap();
    }
    let text = serde_json::to_string(&first.checkpoint()).unwrap();
    let checkpoint: Checkpoint = serde_json::from_str(&text).unwrap();
    assert_eq!(checkpoint.step(), 23);
    let mut second = variant.on(case);
    second.restore(&checkpoint).unwrap();
    for k in 23..STEPS {
        take(&mut second, case, k).unwrap();
    }
    assert_eq!(second.checkpoint(), whole.checkpoint(), "{}", variant.label());
    assert_eq!(second.innovation().iter().map(|e| e.to_bits()).collect::<Vec<_>>(), bits(whole.innovation()));
}

fn bits(x: &[f64]) -> Vec<u64> {
    x.iter().map(|e| e.to_bits()).collect()
}

/// The results are bit-identical whether the same noise model is given before each step or once.
fn same_noise_changes_nothing<S: Kernels>(variant: &Variant<S>, case: &Case) {
    let mut constant = case.clone();
    constant.noise.truncate(1);
    let mut run = variant.on(&constant);
    for k in 0..STEPS {
        run.set_noise(&constant.noise[0]).unwrap();
        take(&mut run, &constant, k).unwrap();
    }
    assert_eq!(run.checkpoint(), variant.finish(&constant).checkpoint(), "{}", variant.label());
}

/// A step without measurements gives x <- A^ x + B^ u (plus the covariance of a_i and x_{c_i} if moments are
/// matched). The parameters do not change. Their covariance changes only by rounding, because a form may transform
/// its whole factor. A step whose outputs are all missing leaves no innovation.
fn nothing_measured_is_a_time_update<S: Kernels>(variant: &Variant<S>, case: &Case) {
    let mut run = variant.finish(case);
    let before = identified(&run);
    let s_before: Vec<f64> = run.estimate().iter().map(|x| x.to_f64()).collect();
    let u: Vec<f64> = (0..case.inputs).map(|j| 0.7 - j as f64).collect();
    run.step_with_missing(&vec![f64::NAN; case.indices.len()], &u).unwrap();
    let (n, size) = (case.states(), s_before.len());
    let after: Vec<f64> = run.estimate().iter().map(|x| x.to_f64()).collect();
    for i in 0..n {
        let mut expected: f64 = (0..n).map(|j| before.a.at(i, j) * before.state[j]).sum();
        expected += (0..case.inputs).map(|j| before.b.at(i, j) * u[j]).sum::<f64>();
        if variant.kind() == Kind::MomentMatched {
            let outputs = run.model().output_states();
            expected += outputs.iter().enumerate().map(|(t, &c)| before.covariance.at((1 + t) * n + i, c)).sum::<f64>();
        }
        assert!((after[i] - expected).abs() < 1e-12 * (1.0 + expected.abs()), "{}", variant.label());
    }
    assert_eq!(after[n..], s_before[n..]);
    let covariance = identified(&run).covariance;
    for j in n..size {
        for i in n..size {
            let change = (covariance.at(i, j) - before.covariance.at(i, j)).abs();
            let scale = (before.covariance.at(i, i) * before.covariance.at(j, j)).sqrt();
            assert!(change <= 1e-13 * scale, "{} ({i}, {j}): {change:.1e} of {scale:.1e}", variant.label());
        }
    }
    assert!(run.innovation().iter().all(|e| e.is_nan()));
}

/// Permuting and rescaling the channels permutes and rescales the estimate.
fn follows_the_channels<S: Kernels>(variant: &Variant<S>, case: &Case, order: &[usize], alpha: &[f64], beta: &[f64]) {
    let limit = rounding(variant, case);
    let places = permuted_places(&case.indices, case.inputs, order);
    let ones = vec![1.0; places.len()];
    let (ds, dp) = transformed_difference(variant, case, &permuted(case, order), &places, &ones);
    assert!(ds < limit && dp < limit, "{} permuted: s {ds:.1e}, P {dp:.1e}", variant.label());
    let own: Vec<usize> = (0..places.len()).collect();
    let (_, joint) = factors(case, alpha, beta);
    let (ds, dp) = transformed_difference(variant, case, &rescaled(case, alpha, beta), &own, &joint);
    assert!(ds < limit && dp < limit, "{} rescaled: s {ds:.1e}, P {dp:.1e}", variant.label());
}

/// Compares the division of P by lambda at each step with the dense recursion. A form that reports that it cannot
/// forget is skipped.
fn forgets<S: Kernels>(variant: &Variant<S>, case: &Case, forgetting: f64) {
    let limit = rounding(variant, case);
    let mut case = case.clone();
    case.settings.forgetting = forgetting;
    case.z.truncate(20);
    let mut reference = Reference::<qd::Quad>::new(variant.kind(), &case.indices, case.inputs, &case.settings);
    for (k, (z, u)) in case.z.iter().zip(&case.u).enumerate() {
        reference.step(z, u, case.noise_at(k));
    }
    let mut run = variant.on(&case);
    for k in 0..case.z.len() {
        match take(&mut run, &case, k) {
            Err(IdentifierError::Unsupported(_)) => return,
            step => step.unwrap(),
        }
    }
    let (s, p) = outcome(&run);
    let (ds, dp) = (relative(&s, &reference.s), relative(&p, &reference.p));
    assert!(ds < limit && dp < limit, "{}: s {ds:.1e}, P {dp:.1e}, not {limit:.1e}", variant.label());
}

/// Checks `property` on random cases, which are the same on every run.
fn for_all<T: Strategy>(inputs: T, property: impl Fn(T::Value)) {
    let outcome = TestRunner::new(config()).run(&inputs, |input| {
        property(input);
        Ok(())
    });
    if let Err(failure) = outcome {
        panic!("{failure}");
    }
}

/// Checks all properties of plid's own expectations with a form.
pub fn check<S: Kernels>(variants: &[Variant<S>]) {
    for_all(cases(), |case| {
        for variant in variants {
            stays_a_covariance(variant, &case);
            agrees_with(variant, &case);
            continues_from_a_checkpoint(variant, &case);
            same_noise_changes_nothing(variant, &case);
            nothing_measured_is_a_time_update(variant, &case);
        }
    });
    let factors = || prop::collection::vec(0.01..100.0_f64, 3);
    for_all((cases(), any::<bool>(), factors(), factors()), |(case, reverse, alpha, beta)| {
        let p = case.indices.len();
        let order: Vec<usize> = if reverse { (0..p).rev().collect() } else { (0..p).map(|i| (i + 1) % p).collect() };
        let (alpha, beta) = (&alpha[..p], &beta[..case.inputs]);
        variants.iter().for_each(|variant| follows_the_channels(variant, &case, &order, alpha, beta));
    });
    for_all((cases(), 0.95..1.0_f64), |(case, forgetting)| {
        variants.iter().for_each(|variant| forgets(variant, &case, forgetting));
    });
}

/// Checks the properties of any expectation.
pub fn check_expectation<E: ConditionalExpectations<Scalar = f64>>() {
    let direct = &Variant::of::<Direct<Plain<f64>>, E>();
    for_all(cases(), |case| {
        stays_a_covariance(&direct.with_form::<BiermanUd<Plain<f64>>>(), &case);
        agrees_with(direct, &case);
        continues_from_a_checkpoint(direct, &case);
        same_noise_changes_nothing(direct, &case);
    });
    let factors = || prop::collection::vec(0.01..100.0_f64, 3);
    for_all((cases(), factors(), factors()), |(case, alpha, beta)| {
        let p = case.indices.len();
        let order: Vec<usize> = (0..p).rev().collect();
        follows_the_channels(direct, &case, &order, &alpha[..p], &beta[..case.inputs]);
    });
}

/// Checks checkpoints in any scalar.
pub fn checkpoints<S: Kernels>(variants: &[Variant<S>]) {
    let case = random_case(&[2, 1], 1, Options { steps: STEPS, ..Options::default() }, 4);
    variants.iter().for_each(|variant| continues_from_a_checkpoint(variant, &case));
}

/// Over as many steps as there are parameters, every form must add a variance of q per step to each parameter. A form
/// that reports that it cannot do so is skipped.
pub fn parameter_noise_adds_up<C: Form>() {
    let form = ObservableForm::new(&[2, 1], 1).unwrap();
    let case = random_case(&[2, 1], 1, Options { full_initial: true, ..Options::default() }, 8);
    let mut covariance = C::new(&form, &case.settings.initial_covariance, &C::Options::default()).unwrap();
    let (n, size) = (form.states(), form.joint_states());
    let before = covariance.dense();
    let q = 0.01;
    for step in 0..(size - n) as u64 {
        if let Err(Unsupported(_)) = covariance.add_parameter_noise(ScalarOf::<C>::from_f64(q), 100 + step) {
            return;
        }
    }
    let after = covariance.dense();
    for j in 0..size {
        for i in 0..size {
            let added = if i == j && i >= n { q * (size - n) as f64 } else { 0.0 };
            let difference = (after.at(i, j) - before.at(i, j)).to_f64() - added;
            assert!(difference.abs() < 1e-14, "{} ({i}, {j}): {difference:.1e}", std::any::type_name::<C>());
        }
    }
}
