//! Runs over cases, and what is compared of them.

use plid_core::{ConditionalExpectations, Form, Identifier, IdentifierError, ObservableForm, Scalar, ScalarOf};
use plid_variants::expectations::{CertaintyEquivalent, JointEkf, MomentMatched, Posterior, Prior};

use crate::case::Case;
use crate::dense::Mat;
use crate::reference::Kind;

/// An expectation of which there is a dense reference.
pub trait HasKind {
    /// Which one.
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

/// The double-double value of a scalar, exactly.
pub fn quad<S: Scalar>(x: S) -> qd::Quad {
    let [high, low] = x.to_parts();
    qd::Quad(high, low)
}

/// A run about to begin.
pub fn identifier<C, E>(case: &Case) -> Identifier<C, E>
where
    C: Form,
    E: ConditionalExpectations<Scalar = ScalarOf<C>>,
{
    let form = ObservableForm::new(&case.indices, case.inputs).unwrap();
    Identifier::new(form, &case.noise[0], &case.settings).unwrap()
}

/// The step `k` of a case.
pub fn take<C, E>(run: &mut Identifier<C, E>, case: &Case, k: usize) -> Result<(), IdentifierError>
where
    C: Form,
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
    C: Form,
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
    C: Form,
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

/// The names of a form and an expectation, for messages.
pub fn label<C, E>() -> String {
    let short = |name: &str| -> String {
        name.split_inclusive(['<', ',', '>', ' ']).map(|part| part.rsplit("::").next().unwrap_or(part)).collect()
    };
    format!("{} {}", short(std::any::type_name::<C>()), short(std::any::type_name::<E>()))
}
