//! What the integration tests share: a dense reference, random cases, and lists of all variants.
#![allow(dead_code, unused_macros, reason = "each test binary uses its own part")]

pub mod case;
pub mod dense;
pub mod reference;

use plid_core::{
    Backend, ConditionalExpectations, CovariancePropagation, Identifier, IdentifierError, ObservableForm, Scalar,
    ScalarOf,
};
use plid_variants::covariance::{ArraySqrt, BiermanUd, Direct, Joseph};
use plid_variants::expectations::{CertaintyEquivalent, JointEkf, MomentMatched, Posterior, Prior};

use case::Case;
use dense::Mat;
use reference::Kind;

/// Which recursion of the reference a type stands for.
pub trait HasKind {
    const KIND: Kind;
}

impl<S> HasKind for Prior<S> {
    const KIND: Kind = Kind::Prior;
}
impl<S> HasKind for Posterior<S> {
    const KIND: Kind = Kind::Posterior;
}
impl<S> HasKind for CertaintyEquivalent<S> {
    const KIND: Kind = Kind::CertaintyEquivalent;
}
impl<S> HasKind for MomentMatched<S> {
    const KIND: Kind = Kind::MomentMatched;
}
impl<S> HasKind for JointEkf<S> {
    const KIND: Kind = Kind::JointEkf;
}

/// The name of a form, for messages, and whether it carries a factor of P.
pub trait HasForm {
    const FORM: &'static str;
    const FACTORED: bool;
}

impl<B: Backend> HasForm for Direct<B> {
    const FORM: &'static str = "direct";
    const FACTORED: bool = false;
}
impl<B: Backend> HasForm for Joseph<B> {
    const FORM: &'static str = "joseph";
    const FACTORED: bool = false;
}
impl<B: Backend> HasForm for BiermanUd<B> {
    const FORM: &'static str = "bierman-ud";
    const FACTORED: bool = true;
}
impl<B: Backend> HasForm for ArraySqrt<B> {
    const FORM: &'static str = "array-sqrt";
    const FACTORED: bool = true;
}

/// `check::<form, expectation>(arguments)` for every form and expectation over one backend.
macro_rules! every_variant {
    ($check:ident, $backend:ident < $scalar:ty > $(, $argument:expr)*) => {{
        use plid_variants::covariance::*;
        every_variant!(@form $check, $scalar, Direct<plid_backends::$backend<$scalar>> $(, $argument)*);
        every_variant!(@form $check, $scalar, Joseph<plid_backends::$backend<$scalar>> $(, $argument)*);
        every_variant!(@form $check, $scalar, BiermanUd<plid_backends::$backend<$scalar>> $(, $argument)*);
        every_variant!(@form $check, $scalar, ArraySqrt<plid_backends::$backend<$scalar>> $(, $argument)*);
    }};
    (@form $check:ident, $scalar:ty, $form:ty $(, $argument:expr)*) => {{
        use plid_variants::expectations::*;
        $check::<$form, Prior<$scalar>>($($argument),*);
        $check::<$form, Posterior<$scalar>>($($argument),*);
        $check::<$form, CertaintyEquivalent<$scalar>>($($argument),*);
        $check::<$form, MomentMatched<$scalar>>($($argument),*);
        $check::<$form, JointEkf<$scalar>>($($argument),*);
    }};
}

/// One `#[test]` a backend and scalar, each for every form and expectation.
macro_rules! test_every_variant {
    ($check:ident: $($name:ident = $backend:ident < $scalar:ty >),* $(,)?) => {
        mod $check {
            use super::$check;
            $(
                #[test]
                fn $name() {
                    every_variant!($check, $backend<$scalar>);
                }
            )*
        }
    };
}

/// The double-double value of a scalar, exactly.
pub fn quad<S: Scalar>(x: S) -> qd::Quad {
    let [high, low] = x.to_parts();
    qd::Quad(high, low)
}

/// A run about to begin.
pub fn identifier<C, E>(case: &Case) -> Identifier<C, E>
where
    C: Inspect + Checkpointed,
    E: ConditionalExpectations<Scalar = ScalarOf<C>>,
{
    let form = ObservableForm::new(&case.indices, case.inputs).unwrap();
    Identifier::new(form, &case.noise[0], &case.settings).unwrap()
}

/// The step `k` of a case.
pub fn take<C, E>(run: &mut Identifier<C, E>, case: &Case, k: usize) -> Result<(), IdentifierError>
where
    C: Inspect + Checkpointed,
    E: ConditionalExpectations<Scalar = ScalarOf<C>>,
{
    if case.noise.len() > 1 {
        run.set_noise(case.noise_at(k))?;
    }
    run.step_with_missing(&case.z[k], &case.u[k])
}

/// The whole of a case.
pub fn finish<C, E>(case: &Case) -> Identifier<C, E>
where
    C: Inspect + Checkpointed,
    E: ConditionalExpectations<Scalar = ScalarOf<C>>,
{
    let mut run = identifier(case);
    for k in 0..case.z.len() {
        take(&mut run, case, k).unwrap();
    }
    run
}

/// Estimate and covariance of a run in double-double.
pub fn outcome<C, E>(run: &Identifier<C, E>) -> (Mat<qd::Quad>, Mat<qd::Quad>)
where
    C: Inspect + Checkpointed,
    E: ConditionalExpectations<Scalar = ScalarOf<C>>,
{
    let s = Mat::column(&run.estimate().iter().map(|&x| quad(x)).collect::<Vec<_>>());
    (s, widen(&run.covariance().dense()))
}

/// The same matrix in double-double.
pub fn widen<S: Scalar>(p: &plid_core::Dense<S>) -> Mat<qd::Quad> {
    Mat::from_fn(p.rows(), p.columns(), |i, j| quad(p.at(i, j)))
}

/// |a - b| / |b| in the Frobenius norm.
pub fn relative(a: &Mat<qd::Quad>, b: &Mat<qd::Quad>) -> f64 {
    (a - b).norm() / b.norm()
}

/// Name of a pair, for messages.
pub fn label<C: Inspect + Checkpointed + HasForm, E: HasKind>() -> String {
    let scalar = std::any::type_name::<ScalarOf<C>>();
    let backend = std::any::type_name::<C>();
    let short = |name: &str| name.split('<').next().and_then(|n| n.rsplit("::").next()).unwrap_or("").to_owned();
    format!("{} {:?} {}<{}>", C::FORM, E::KIND, short(backend), short(scalar))
}
