//! Comparison of every variant with the dense recursion in double-double over 200 random steps with a full noise
//! model.

use std::sync::LazyLock;

use crate::case::{Case, Options, random_case, record, rng};
use crate::dense::Mat;
use crate::reference::{KINDS, Kind, Reference};
use crate::run::{Variant, outcome, quad, relative};
use plid_core::kernels::Kernels;
use plid_core::{NoiseModel, Scalar};
use qd::Quad;

/// The cases, with n = 4..12, p and m = 1..3 and unequal indices. Some have changing noise, missing outputs or a full
/// P0.
static CASES: LazyLock<Vec<Case>> = LazyLock::new(|| {
    let plain = Options::default();
    let changing = Options { noise_models: 3, ..plain };
    let missing = Options { missing: 0.2, ..plain };
    let all = Options { noise_models: 2, missing: 0.3, full_initial: true, ..plain };
    vec![
        random_case(&[4], 1, plain, 1),
        random_case(&[1, 3], 3, all, 2),
        random_case(&[2, 3], 1, changing, 3),
        random_case(&[1, 4, 2], 2, missing, 4),
        random_case(&[5, 3], 3, plain, 5),
        random_case(&[2, 6, 1], 1, all, 6),
        random_case(&[3, 7], 2, missing, 7),
        random_case(&[5, 3, 4], 3, changing, 8),
        without_sensor_noise(),
    ]
});

/// Returns a case with R = 0 and without state noise at the beginning of a block. These states are then known
/// exactly, and P is singular in every step.
fn without_sensor_noise() -> Case {
    let mut case = random_case(&[2, 3, 2], 1, Options::default(), 9);
    case.noise = vec![NoiseModel::diagonal(&[0.0; 3], &[0.0], &[0.0, 0.1, 0.0, 0.2, 0.1, 0.0, 0.3])];
    (case.z, case.u) = record(&case.plant, &case.noise, 200, &mut rng(10));
    case
}

/// Estimate and covariance.
type Outcome = (Mat<Quad>, Mat<Quad>);

/// The results after the last step, one for each case and kind.
static REFERENCE: LazyLock<Vec<Vec<Outcome>>> = LazyLock::new(|| {
    let run = |case: &Case, kind: Kind| {
        let mut reference = Reference::<Quad>::new(kind, &case.indices, case.inputs, &case.settings);
        for (k, (z, u)) in case.z.iter().zip(&case.u).enumerate() {
            reference.step(z, u, case.noise_at(k));
        }
        (reference.s, reference.p)
    };
    CASES.iter().map(|case| KINDS.iter().map(|&kind| run(case, kind)).collect()).collect()
});

/// The tolerance for a run of 200 steps in f32. It is the number of roundoffs that was observed in f64 (at most 50,
/// see the printed figures), with a factor of 4 for the data, which f32 also rounds, and another factor of 5 as a
/// margin.
const F32: f64 = 1000.0 * 6e-8;

/// Returns the largest permissible relative difference of s and P.
fn tolerance<S: Scalar>() -> f64 {
    if S::EPSILON < 1e-20 {
        1e-25
    } else if S::EPSILON < 1e-10 {
        1e-11
    } else {
        F32
    }
}

pub fn agrees_with_the_dense_recursion<S: Kernels>(variant: &Variant<S>) {
    let kind = KINDS.iter().position(|&kind| kind == variant.kind()).unwrap();
    for (case, reference) in CASES.iter().zip(&*REFERENCE) {
        let (s, p) = outcome(&variant.finish(case));
        let (ds, dp) = (relative(&s, &reference[kind].0), relative(&p, &reference[kind].1));
        let name = variant.label();
        println!("{name} {:?} m = {}: s {ds:.1e}, P {dp:.1e}", case.indices, case.inputs);
        let limit = tolerance::<S>();
        assert!(ds <= limit && dp <= limit, "{name} {:?}: s {ds:.2e}, P {dp:.2e}", case.indices);
    }
}

/// Checks that two phases are equivalent to one (section 4), by a single step from a full P0 and the dense recursion
/// in the same scalar.
pub fn one_step_is_eq_8_to_10<S: Kernels>(variant: &Variant<S>) {
    for (seed, missing) in [(31, 0.0), (32, 0.0), (33, 0.4)] {
        let options = Options { steps: 1, full_initial: true, missing, ..Options::default() };
        let case = random_case(&[3, 1, 2], 2, options, seed);
        let mut reference = Reference::<S>::new(variant.kind(), &case.indices, case.inputs, &case.settings);
        reference.step(&case.z[0], &case.u[0], case.noise_at(0));
        let (s, p) = outcome(&variant.finish(&case));
        let widened = |m: &Mat<S>| Mat::from_fn(m.rows, m.columns, |i, j| quad(m[(i, j)]));
        let (ds, dp) = (relative(&s, &widened(&reference.s)), relative(&p, &widened(&reference.p)));
        let limit = if S::EPSILON < 1e-20 { 1e-28 } else { 1e-13 };
        let name = variant.label();
        println!("{name}: s {ds:.1e}, P {dp:.1e}");
        assert!(ds <= limit && dp <= limit, "{name}: s {ds:.2e}, P {dp:.2e}");
    }
}
