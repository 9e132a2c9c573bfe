//! Runs over cases, and the quantities that are compared.

use plid_core::kernels::{BadPivot, Kernels};
use plid_core::{
    AnyForm, Backend, ConditionalExpectations, Form, IdentifiedModel, Identifier, IdentifierError, ImplicitModel,
    InitialCovariance, NoiseModel, ObservableForm, Scalar, ScalarOf, Settings,
};
use plid_variants::{covariance, expectations};

use crate::case::Case;
use crate::dense::Mat;
use crate::reference::Kind;

/// An expectation that has a dense reference.
trait HasKind {
    const KIND: Kind;
}

impl<S> HasKind for expectations::Prior<S> {
    const KIND: Kind = Kind::Prior;
}
impl<S> HasKind for expectations::Posterior<S> {
    const KIND: Kind = Kind::Posterior;
}
impl<S> HasKind for expectations::CertaintyEquivalent<S> {
    const KIND: Kind = Kind::CertaintyEquivalent;
}
impl<S> HasKind for expectations::MomentMatched<S> {
    const KIND: Kind = Kind::MomentMatched;
}
impl<S> HasKind for expectations::JointEkf<S> {
    const KIND: Kind = Kind::JointEkf;
}

/// A run whose form and expectation are type-erased.
pub type Run<S> = Identifier<dyn AnyForm<Scalar = S>, dyn ConditionalExpectations<Scalar = S>>;

type StartForm<S> = fn(&dyn ImplicitModel, &InitialCovariance) -> Result<Box<dyn AnyForm<Scalar = S>>, BadPivot>;

fn start_form<C: Form>() -> StartForm<ScalarOf<C>> {
    |model, initial| Ok(Box::new(C::new(model, initial, &C::Options::default())?))
}

/// A covariance form with a conditional expectation.
///
/// Their types are erased, so that the compiler generates each check once per scalar and not once per form,
/// expectation and backend.
#[derive(Clone, Debug)]
pub struct Variant<S: Kernels> {
    form_name: String,
    expectation_name: String,
    kind: Option<Kind>,
    form: StartForm<S>,
    expectation: fn(&dyn ImplicitModel) -> Box<dyn ConditionalExpectations<Scalar = S>>,
}

impl<S: Kernels> Variant<S> {
    /// Returns form `C` with expectation `E`.
    pub fn of<C: Form<Scalar = S>, E: ConditionalExpectations<Scalar = S>>() -> Self {
        Self {
            form_name: short_name::<C>(),
            expectation_name: short_name::<E>(),
            kind: None,
            form: start_form::<C>(),
            expectation: |model| Box::new(E::new(model, &E::Options::default())),
        }
    }

    fn built_in<C: Form<Scalar = S>, E: ConditionalExpectations<Scalar = S> + HasKind>() -> Self {
        Self { kind: Some(E::KIND), ..Self::of::<C, E>() }
    }

    /// Returns the expectation of this variant with form `C`.
    pub fn with_form<C: Form<Scalar = S>>(&self) -> Self {
        Self { form_name: short_name::<C>(), form: start_form::<C>(), ..self.clone() }
    }

    /// Returns the kind of dense reference with which it must agree.
    ///
    /// # Panics
    /// Panics if there is none, because the expectation is not one of plid's own.
    pub fn kind(&self) -> Kind {
        self.kind.expect("a built-in expectation")
    }

    /// Returns the names of form and expectation for messages.
    pub fn label(&self) -> String {
        format!("{} {}", self.form_name, self.expectation_name)
    }

    /// Returns a run before its first sample.
    ///
    /// # Errors
    /// Returns the errors of [`Identifier::begin`].
    pub fn begin(
        &self,
        form: ObservableForm,
        noise: &NoiseModel,
        settings: &Settings,
    ) -> Result<Run<S>, IdentifierError> {
        let expectation = (self.expectation)(&form);
        Run::begin(form, noise, settings, self.form, expectation)
    }

    /// Returns a run before the first sample of a case.
    pub fn on(&self, case: &Case) -> Run<S> {
        let form = ObservableForm::new(&case.indices, case.inputs).unwrap();
        self.begin(form, &case.noise[0], &case.settings).unwrap()
    }

    /// Returns the run after the last sample of a case.
    pub fn finish(&self, case: &Case) -> Run<S> {
        let mut run = self.on(case);
        for k in 0..case.z.len() {
            take(&mut run, case, k).unwrap();
        }
        run
    }
}

macro_rules! with_every_expectation {
    ([$form:ty] $($(#[$doc:meta])* $word:literal = $expectation:ident;)*) => {
        vec![$(Variant::built_in::<$form, expectations::$expectation<ScalarOf<$form>>>()),*]
    };
}

/// Returns form `C` with each of plid's expectations.
pub fn with_every_expectation<C: Form>() -> Vec<Variant<ScalarOf<C>>> {
    plid_variants::every_expectation!(with_every_expectation, [C])
}

macro_rules! every_variant {
    ([$backend:ty] $($(#[$doc:meta])* $word:literal = $form:ident;)*) => {
        [$(with_every_expectation::<covariance::$form<$backend>>()),*].concat()
    };
}

/// Returns each of plid's forms on backend `B` with each of plid's expectations.
pub fn every_variant<B: Backend>() -> Vec<Variant<B::Scalar>> {
    plid_variants::every_form!(every_variant, [B])
}

/// Returns the run with form `C` and this expectation after the last sample of a case.
pub(crate) fn finish_with<C: Form>(
    case: &Case,
    expectation: impl FnOnce(&dyn ImplicitModel) -> Box<dyn ConditionalExpectations<Scalar = ScalarOf<C>>>,
) -> Run<ScalarOf<C>> {
    let form = ObservableForm::new(&case.indices, case.inputs).unwrap();
    let expectation = expectation(&form);
    let mut run = Run::begin(form, &case.noise[0], &case.settings, start_form::<C>(), expectation).unwrap();
    for k in 0..case.z.len() {
        take(&mut run, case, k).unwrap();
    }
    run
}

/// Takes step `k` of a case.
///
/// # Errors
/// Returns the errors of [`Identifier::step`].
pub fn take<S: Kernels>(run: &mut Run<S>, case: &Case, k: usize) -> Result<(), IdentifierError> {
    if case.noise.len() > 1 {
        run.set_noise(case.noise_at(k))?;
    }
    run.step_with_missing(&case.z[k], &case.u[k])
}

/// Returns the plant of a run's estimate.
pub fn identified<S: Kernels>(run: &Run<S>) -> IdentifiedModel {
    IdentifiedModel::from_estimate(run.model(), run.estimate(), &run.covariance().own_dense())
}

/// Returns the exact value of a scalar in double-double.
pub fn quad<S: Scalar>(x: S) -> qd::Quad {
    let [high, low] = x.to_parts();
    qd::Quad(high, low)
}

/// Returns estimate and covariance of a run in double-double.
pub fn outcome<S: Kernels>(run: &Run<S>) -> (Mat<qd::Quad>, Mat<qd::Quad>) {
    let s = Mat::column(&run.estimate().iter().map(|&x| quad(x)).collect::<Vec<_>>());
    (s, widen(&run.covariance().own_dense()))
}

/// Converts a matrix to double-double.
pub fn widen<S: Scalar>(p: &plid_core::Dense<S>) -> Mat<qd::Quad> {
    Mat::from_fn(p.rows(), p.columns(), |i, j| quad(p.at(i, j)))
}

/// Returns |a - b| / |b| in the Frobenius norm.
pub fn relative(a: &Mat<qd::Quad>, b: &Mat<qd::Quad>) -> f64 {
    (a - b).norm() / b.norm()
}

/// Returns the name of a type without its modules.
fn short_name<T>() -> String {
    let name = std::any::type_name::<T>();
    name.split_inclusive(['<', ',', '>', ' ']).map(|part| part.rsplit("::").next().unwrap_or(part)).collect()
}
