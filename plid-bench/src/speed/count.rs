//! Operations of a step, counted while the real recursion does them: plain loops over numbers that count.

use std::cell::Cell as Shared;
use std::ops::{Add, AddAssign, Div, DivAssign, Mul, MulAssign, Neg, Rem, RemAssign, Sub, SubAssign};

use num_traits::{Num, One, Zero};
use plid_backends::Plain;
use plid_core::kernels::Kernels;
use plid_core::{Dense, ImplicitModel, InitialCovariance, Scalar, Settings};
use serde::{Deserialize, Serialize};

use super::cell::Cell;
use super::visit::VisitError;
use crate::Workload;

/// Operations on numbers. A fused multiplication and addition is one of each.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Operations {
    /// Additions and subtractions.
    pub additions: u64,
    /// Multiplications.
    pub multiplications: u64,
    /// Divisions.
    pub divisions: u64,
    /// Square roots.
    pub roots: u64,
}

impl Operations {
    /// All of them, each as one.
    pub fn total(self) -> u64 {
        self.additions + self.multiplications + self.divisions + self.roots
    }
}

thread_local! {
    static COUNTED: Shared<Operations> = const {
        Shared::new(Operations { additions: 0, multiplications: 0, divisions: 0, roots: 0 })
    };
}

/// The operations that `work` does on [`Counted`] numbers in this thread.
fn operations<T>(work: impl FnOnce() -> T) -> (T, Operations) {
    COUNTED.set(Operations::default());
    let result = work();
    (result, COUNTED.get())
}

/// The operations of one step of a cell's recursion on plain loops. Those of other libraries do the same products.
///
/// # Errors
/// As a visit.
pub fn count(cell: &Cell, workload: &Workload<'_>) -> Result<Operations, VisitError> {
    let recursion = workload.build(|form, noise, settings| {
        // A P0 without zeros: what skips zeros is not to find them.
        let size = form.joint_states();
        let full = Dense::from_fn(size, size, |i, j| if i == j { 1.0 } else { 0.5 / size as f64 });
        let settings = Settings { initial_covariance: InitialCovariance::Full(full), ..settings.clone() };
        cell.variant.build_on::<Plain<Counted>>(form, noise, &settings)
    })?;
    let mut steps = workload.with(recursion);
    steps.step().map_err(VisitError::Fails)?;
    let (result, operations) = operations(|| steps.step());
    result.map_err(VisitError::Fails)?;
    Ok(operations)
}

/// An `f64` that counts what is done to it.
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd)]
pub struct Counted(f64);

macro_rules! counts {
    ($operation:ident, $method:ident, $assign:ident, $assign_method:ident, $count:ident) => {
        impl $operation for Counted {
            type Output = Self;
            // The sum is the count.
            #[allow(clippy::suspicious_arithmetic_impl)]
            fn $method(self, other: Self) -> Self {
                COUNTED.set(Operations { $count: COUNTED.get().$count + 1, ..COUNTED.get() });
                Self(self.0.$method(other.0))
            }
        }

        impl $assign for Counted {
            fn $assign_method(&mut self, other: Self) {
                *self = self.$method(other);
            }
        }
    };
}

counts!(Add, add, AddAssign, add_assign, additions);
counts!(Sub, sub, SubAssign, sub_assign, additions);
counts!(Mul, mul, MulAssign, mul_assign, multiplications);
counts!(Div, div, DivAssign, div_assign, divisions);
counts!(Rem, rem, RemAssign, rem_assign, divisions);

impl Neg for Counted {
    type Output = Self;
    /// A change of sign is part of the operation beside it.
    fn neg(self) -> Self {
        Self(-self.0)
    }
}

impl Zero for Counted {
    fn zero() -> Self {
        Self(0.0)
    }
    fn is_zero(&self) -> bool {
        self.0 == 0.0
    }
}

impl One for Counted {
    fn one() -> Self {
        Self(1.0)
    }
}

impl Num for Counted {
    type FromStrRadixErr = <f64 as Num>::FromStrRadixErr;
    fn from_str_radix(text: &str, radix: u32) -> Result<Self, Self::FromStrRadixErr> {
        f64::from_str_radix(text, radix).map(Self)
    }
}

impl Scalar for Counted {
    const EPSILON: f64 = <f64 as Scalar>::EPSILON;
    const SMALLEST: f64 = <f64 as Scalar>::SMALLEST;

    fn from_f64(value: f64) -> Self {
        Self(value)
    }
    fn to_f64(self) -> f64 {
        self.0
    }
    fn sqrt(self) -> Self {
        COUNTED.set(Operations { roots: COUNTED.get().roots + 1, ..COUNTED.get() });
        Self(self.0.sqrt())
    }
    fn is_finite(self) -> bool {
        self.0.is_finite()
    }
}

impl Kernels for Counted {}

#[cfg(test)]
mod tests {
    use plid_core::kernels::dot;

    use super::*;

    #[test]
    fn every_operation_counts_once() {
        let (a, b) = (Counted(3.0), Counted(4.0));
        let (result, counted) = operations(|| (a.mul_add(a, b * b) - Counted(0.0)).sqrt() / -a);
        assert_eq!(result, Counted(-5.0 / 3.0));
        assert_eq!(counted, Operations { additions: 2, multiplications: 2, divisions: 1, roots: 1 });
        assert_eq!(counted.total(), 6);
    }

    #[test]
    fn a_dot_product_has_as_many_products_as_entries() {
        let x = vec![Counted(1.0); 100];
        let (sum, counted) = operations(|| dot(&x, &x));
        assert_eq!((sum, counted.multiplications), (Counted(100.0), 100));
        assert!((100..=160).contains(&counted.additions), "{counted:?}");
    }
}
