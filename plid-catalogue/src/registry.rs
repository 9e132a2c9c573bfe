//! The catalogue of this process: the built-in variants, and those that the program has added at its start.
//!
//! Types are erased here, at the interfaces between the loop, the form and the expectation. A form is therefore
//! compiled once for each backend and scalar, and an expectation and the loop once for each scalar. No combination of
//! them is compiled.

use std::sync::{LazyLock, PoisonError, RwLock, RwLockReadGuard};

use plid_backends::*;
use plid_core::kernels::{BadPivot, Kernels};
use plid_core::{
    AnyForm, Backend, ConditionalExpectations, Expectation, Form, FormFacts, ImplicitModel, InitialCovariance,
    StepSize, Term,
};
use plid_variants::covariance::*;
use plid_variants::expectations::*;

use crate::count::Counted;

/// A form of scalar `S`.
pub type BoxedForm<S> = Box<dyn AnyForm<Scalar = S>>;
/// A conditional expectation of scalar `S`.
pub type BoxedExpectation<S> = Box<dyn ConditionalExpectations<Scalar = S>>;
type StartForm<S> = fn(&dyn ImplicitModel, &InitialCovariance) -> Result<BoxedForm<S>, BadPivot>;
type StartExpectation<S> = fn(&dyn ImplicitModel) -> BoxedExpectation<S>;

/// One of the scalars that a catalogue knows.
#[derive(Clone, Copy)]
pub enum ByScalar<A, B, C, D> {
    /// Single precision.
    F32(A),
    /// Double precision.
    F64(B),
    /// Double-double.
    DoubleDouble(C),
    /// Double precision that counts its operations.
    Counted(D),
}

type AnyStart = ByScalar<StartForm<f32>, StartForm<f64>, StartForm<qd::Quad>, StartForm<Counted>>;
type AnyExpectation =
    ByScalar<StartExpectation<f32>, StartExpectation<f64>, StartExpectation<qd::Quad>, StartExpectation<Counted>>;

/// A scalar that a catalogue knows.
pub trait Number: Kernels {
    #[doc(hidden)]
    fn form(start: StartForm<Self>) -> AnyStart;
    #[doc(hidden)]
    fn expectation(start: StartExpectation<Self>) -> AnyExpectation;
    #[doc(hidden)]
    fn of_form(start: &AnyStart) -> Option<StartForm<Self>>;
    #[doc(hidden)]
    fn of_expectation(start: &AnyExpectation) -> Option<StartExpectation<Self>>;
}

macro_rules! number {
    ($($scalar:ty = $name:ident;)*) => {$(
        impl Number for $scalar {
            fn form(start: StartForm<Self>) -> AnyStart {
                ByScalar::$name(start)
            }
            fn expectation(start: StartExpectation<Self>) -> AnyExpectation {
                ByScalar::$name(start)
            }
            fn of_form(start: &AnyStart) -> Option<StartForm<Self>> {
                if let ByScalar::$name(start) = start { Some(*start) } else { None }
            }
            fn of_expectation(start: &AnyExpectation) -> Option<StartExpectation<Self>> {
                if let ByScalar::$name(start) = start { Some(*start) } else { None }
            }
        }
    )*};
}

number! { f32 = F32; f64 = F64; qd::Quad = DoubleDouble; Counted = Counted; }

/// A form over any backend. [`forms!`](crate::forms) creates it from the name of a type.
pub trait FormFamily {
    /// The form on a backend.
    type On<B: Backend>: Form<Scalar = B::Scalar>;
}

/// A conditional expectation over any scalar. [`expectations!`](crate::expectations) creates it from the name of a
/// type.
pub trait ExpectationFamily {
    /// The expectation in a scalar.
    type In<S: Kernels>: Expectation<Scalar = S>;
}

/// A form of the catalogue.
pub struct FormEntry {
    pub(crate) name: &'static str,
    pub(crate) facts: FormFacts,
    pub(crate) cells: Vec<(&'static str, AnyStart)>,
}

fn start<C: Form<Scalar: Number>>() -> AnyStart {
    C::Scalar::form(|model, initial| Ok(Box::new(C::new(model, initial, &C::Options::default())?)))
}

macro_rules! on_every_backend {
    ($family:ident $cells:ident
     $($(#[$doc:meta])* $word:literal = $backend:ident: [$($scalar:ty),+], feature [$($feature:tt)*];)*) => {
        $(
            #[cfg(all($($feature)*))]
            {
                $($cells.push(($word, start::<$family::On<$backend<$scalar>>>()));)+
            }
        )*
    };
}

impl FormEntry {
    /// Creates the entry of a form on every built-in backend.
    pub fn of<F: FormFamily>(name: &'static str) -> Self {
        let mut cells = Vec::new();
        #[cfg(feature = "count")]
        cells.push(("plain", start::<F::On<Plain<Counted>>>()));
        plid_backends::every_backend!(on_every_backend, F, cells);
        Self { name, facts: F::On::<Plain<f64>>::FACTS, cells }
    }

    /// Creates the entry of a form of one scalar with its own storage, which is listed under the backend "plain".
    pub fn only<C: Form<Scalar: Number>>(name: &'static str) -> Self {
        Self { name, facts: C::FACTS, cells: vec![("plain", start::<C>())] }
    }
}

/// A conditional expectation of the catalogue.
pub struct ExpectationEntry {
    pub(crate) name: &'static str,
    pub(crate) flops: fn(&StepSize, &FormFacts) -> Vec<Term>,
    pub(crate) cells: Vec<AnyExpectation>,
}

fn expectation<E: Expectation<Scalar: Number>>() -> AnyExpectation {
    E::Scalar::expectation(|model| Box::new(E::new(model, &E::Options::default())))
}

impl ExpectationEntry {
    /// Creates the entry of an expectation in every scalar.
    pub fn of<F: ExpectationFamily>(name: &'static str) -> Self {
        let cells = vec![
            expectation::<F::In<f32>>(),
            expectation::<F::In<f64>>(),
            expectation::<F::In<qd::Quad>>(),
            #[cfg(feature = "count")]
            expectation::<F::In<Counted>>(),
        ];
        Self { name, flops: F::In::<f64>::FLOPS, cells }
    }

    /// Creates the entry of an expectation of one scalar.
    pub fn only<E: Expectation<Scalar: Number>>(name: &'static str) -> Self {
        Self { name, flops: E::FLOPS, cells: vec![expectation::<E>()] }
    }
}

/// A backend of the catalogue.
pub struct BackendEntry {
    pub(crate) name: &'static str,
    cells: Vec<(&'static str, AnyStart)>,
}

macro_rules! on_one_backend {
    ($backend:ident $($(#[$doc:meta])* $word:literal = $form:ident;)*) => {
        vec![$(($word, start::<$form<$backend>>())),*]
    };
}

impl BackendEntry {
    /// Creates the entry of a backend with every built-in form.
    pub fn of<B: Backend<Scalar: Number>>(name: &'static str) -> Self {
        Self { name, cells: plid_variants::every_form!(on_one_backend, B) }
    }

    /// Adds the backend in another scalar: `BackendEntry::of::<Mine<f64>>("mine").and::<Mine<f32>>().add()`.
    #[must_use]
    pub fn and<B: Backend<Scalar: Number>>(mut self) -> Self {
        self.cells.extend(Self::of::<B>(self.name).cells);
        self
    }
}

/// A user-defined form on a user-defined backend, under the names of both. Both must be added first.
pub struct PairEntry {
    form: &'static str,
    backend: &'static str,
    start: AnyStart,
}

impl PairEntry {
    /// Creates the entry of a pair of a named form and a named backend: `PairEntry::of::<Form<Backend>>("form",
    /// "backend").add()`.
    pub fn of<C: Form<Scalar: Number>>(form: &'static str, backend: &'static str) -> Self {
        Self { form, backend, start: start::<C>() }
    }
}

/// All entries.
pub struct Registry {
    pub(crate) forms: Vec<FormEntry>,
    pub(crate) expectations: Vec<ExpectationEntry>,
    pub(crate) backends: Vec<BackendEntry>,
}

macro_rules! backend_entries {
    ($($(#[$doc:meta])* $word:literal = $backend:ident: [$($scalar:ty),+], feature [$($feature:tt)*];)*) => {
        vec![$(#[cfg(all($($feature)*))] BackendEntry { name: $word, cells: Vec::new() }),*]
    };
}

static REGISTRY: LazyLock<RwLock<Registry>> = LazyLock::new(|| {
    use crate::{expectations, forms};
    RwLock::new(Registry {
        forms: plid_variants::every_form!(forms),
        expectations: plid_variants::every_expectation!(expectations),
        backends: plid_backends::every_backend!(backend_entries),
    })
});

/// The current catalogue.
pub(crate) fn registry() -> RwLockReadGuard<'static, Registry> {
    REGISTRY.read().unwrap_or_else(PoisonError::into_inner)
}

/// An entry that a program adds to the catalogue at its start.
pub trait Entry {
    /// Adds the entry. From then on configs may name it, and studies list it.
    ///
    /// # Panics
    /// Panics if the name is taken, or if a part of a pair has no entry yet.
    fn add(self);
}

fn check_free<'a>(mut names: impl Iterator<Item = &'a str>, name: &str) {
    assert!(names.all(|taken| taken != name), "the catalogue has a `{name}` already");
}

impl Entry for FormEntry {
    fn add(self) {
        let mut registry = REGISTRY.write().unwrap_or_else(PoisonError::into_inner);
        check_free(registry.forms.iter().map(|entry| entry.name), self.name);
        registry.forms.push(self);
    }
}

impl Entry for ExpectationEntry {
    fn add(self) {
        let mut registry = REGISTRY.write().unwrap_or_else(PoisonError::into_inner);
        check_free(registry.expectations.iter().map(|entry| entry.name), self.name);
        registry.expectations.push(self);
    }
}

impl Entry for BackendEntry {
    fn add(mut self) {
        let mut registry = REGISTRY.write().unwrap_or_else(PoisonError::into_inner);
        check_free(registry.backends.iter().map(|entry| entry.name), self.name);
        for (form, start) in self.cells.drain(..) {
            let entry = registry.forms.iter_mut().find(|entry| entry.name == form);
            entry.expect("a built-in form").cells.push((self.name, start));
        }
        registry.backends.push(self);
    }
}

impl Entry for PairEntry {
    fn add(self) {
        let Self { form, backend, start } = self;
        let mut registry = REGISTRY.write().unwrap_or_else(PoisonError::into_inner);
        assert!(registry.backends.iter().any(|entry| entry.name == backend), "there is no backend `{backend}` yet");
        let entry = registry.forms.iter_mut().find(|entry| entry.name == form);
        let cells = &mut entry.unwrap_or_else(|| panic!("there is no form `{form}` yet")).cells;
        // The variants differ by scalar.
        let same = |(name, there): &(&str, AnyStart)| {
            *name == backend && std::mem::discriminant(there) == std::mem::discriminant(&start)
        };
        assert!(!cells.iter().any(same), "the catalogue has `{form}` on `{backend}` already");
        cells.push((backend, start));
    }
}

impl<T: Entry> Entry for Vec<T> {
    fn add(self) {
        self.into_iter().for_each(Entry::add);
    }
}

/// Entries for covariance forms that are generic over the backend: `forms! { "carlson" = filters::Carlson; }.add()`.
#[macro_export]
macro_rules! forms {
    ($($(#[$doc:meta])* $name:literal = $($form:ident)::+;)*) => {
        vec![$({
            struct Family;
            impl $crate::FormFamily for Family {
                type On<B: $crate::Backend> = $($form)::+<B>;
            }
            $crate::FormEntry::of::<Family>($name)
        }),*]
    };
}

/// Entries for conditional expectations that are generic over the scalar:
/// `expectations! { "mine" = filters::Mine; }.add()`.
#[macro_export]
macro_rules! expectations {
    ($($(#[$doc:meta])* $name:literal = $($expectation:ident)::+;)*) => {
        vec![$({
            struct Family;
            impl $crate::ExpectationFamily for Family {
                type In<S: $crate::Kernels> = $($expectation)::+<S>;
            }
            $crate::ExpectationEntry::of::<Family>($name)
        }),*]
    };
}
