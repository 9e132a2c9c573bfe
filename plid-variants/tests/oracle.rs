//! Every variant against the dense recursion in double-double: 200 random steps, full noise model.

#[macro_use]
mod common;

use std::sync::LazyLock;

use common::case::{Case, Options, random_case};
use common::dense::Mat;
use common::reference::{KINDS, Kind, Reference};
use common::{HasForm, HasKind, finish, label, outcome, relative};
use plid_core::{ConditionalExpectations, CovariancePropagation, Scalar, ScalarOf};
use qd::Quad;

/// n = 4..12, p and m = 1..3, unequal indices; noise that changes, missing outputs and a full P0 among them.
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
    ]
});

/// The estimate and the covariance after the last step, one a case and kind.
static REFERENCE: LazyLock<Vec<Vec<(Mat<Quad>, Mat<Quad>)>>> = LazyLock::new(|| {
    let run = |case: &Case, kind: Kind| {
        let mut reference = Reference::<Quad>::new(kind, &case.indices, case.inputs, &case.settings);
        for (k, (z, u)) in case.z.iter().zip(&case.u).enumerate() {
            reference.step(z, u, case.noise_at(k));
        }
        (reference.s, reference.p)
    };
    CASES.iter().map(|case| KINDS.iter().map(|&kind| run(case, kind)).collect()).collect()
});

/// The largest relative differences of s and P that are let pass.
fn tolerance<C: CovariancePropagation>() -> f64 {
    if ScalarOf::<C>::EPSILON < 1e-20 { 1e-25 } else { 1e-11 }
}

fn agrees_with_the_dense_recursion<C, E>()
where
    C: CovariancePropagation + HasForm,
    E: ConditionalExpectations<C> + HasKind,
{
    let kind = KINDS.iter().position(|&kind| kind == E::KIND).unwrap();
    for (case, reference) in CASES.iter().zip(&*REFERENCE) {
        let (s, p) = outcome(&finish::<C, E>(case));
        let (ds, dp) = (relative(&s, &reference[kind].0), relative(&p, &reference[kind].1));
        let name = label::<C, E>();
        println!("{name} {:?} m = {}: s {ds:.1e}, P {dp:.1e}", case.indices, case.inputs);
        let limit = tolerance::<C>();
        assert!(ds <= limit && dp <= limit, "{name} {:?}: s {ds:.2e}, P {dp:.2e}", case.indices);
    }
}

test_every_variant!(agrees_with_the_dense_recursion:
    plain_f64 = Plain<f64>,
    nalgebra_f64 = Nalgebra<f64>,
    faer_f64 = Faer<f64>,
    plain_double_double = Plain<qd::Quad>,
);
