//! Numbers that count the operations on them, so that the operations of a step are counted in the real recursion.

use std::cell::Cell as Shared;
use std::ops::{Add, AddAssign, Div, DivAssign, Mul, MulAssign, Neg, Rem, RemAssign, Sub, SubAssign};

use num_traits::{Num, One, Zero};
use plid_core::Scalar;
use plid_core::kernels::Kernels;
use serde::{Deserialize, Serialize};

/// Operations on numbers. A fused multiply-add counts as one multiplication and one addition.
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
    /// The total number of operations.
    pub fn total(self) -> u64 {
        self.additions + self.multiplications + self.divisions + self.roots
    }
}

thread_local! {
    static COUNTED: Shared<Operations> = const {
        Shared::new(Operations { additions: 0, multiplications: 0, divisions: 0, roots: 0 })
    };
}

/// Returns the result of `work`, and the operations that it does on [`Counted`] numbers in this thread.
pub fn operations<T>(work: impl FnOnce() -> T) -> (T, Operations) {
    COUNTED.set(Operations::default());
    let result = work();
    (result, COUNTED.get())
}

/// An `f64` that counts the operations on it.
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd)]
pub struct Counted(pub f64);

macro_rules! counts {
    ($operation:ident, $method:ident, $assign:ident, $assign_method:ident, $count:ident) => {
        impl $operation for Counted {
            type Output = Self;
            // The `+` counts the operation.
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
    /// A change of sign counts as part of the neighbouring operation.
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
