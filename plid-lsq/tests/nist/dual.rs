//! Numbers that carry their derivatives, so that each model is written once.

use std::ops::{Add, Div, Mul, Neg, Sub};

/// Largest number of parameters.
pub const MOST: usize = 9;

/// A value and its derivatives by the parameters.
#[derive(Clone, Copy)]
pub struct Dual {
    pub value: f64,
    pub slope: [f64; MOST],
}

impl Dual {
    pub fn parameter(value: f64, index: usize) -> Self {
        let mut slope = [0.0; MOST];
        slope[index] = 1.0;
        Self { value, slope }
    }

    /// A function of this number, from its value and its derivative.
    fn chain(self, value: f64, derivative: f64) -> Self {
        Self { value, slope: self.slope.map(|s| s * derivative) }
    }

    /// A function of two numbers, from its value and its partial derivatives.
    fn combined(self, other: Self, value: f64, by_self: f64, by_other: f64) -> Self {
        Self { value, slope: std::array::from_fn(|k| by_self * self.slope[k] + by_other * other.slope[k]) }
    }

    pub fn exp(self) -> Self {
        self.chain(self.value.exp(), self.value.exp())
    }

    pub fn atan(self) -> Self {
        self.chain(self.value.atan(), 1.0 / (1.0 + self.value * self.value))
    }

    pub fn sin(self) -> Self {
        self.chain(self.value.sin(), self.value.cos())
    }

    pub fn cos(self) -> Self {
        self.chain(self.value.cos(), -self.value.sin())
    }

    pub fn square(self) -> Self {
        self * self
    }

    /// self^exponent = e^(exponent ln self), for a positive number.
    pub fn power(self, exponent: Dual) -> Self {
        (exponent * self.chain(self.value.ln(), 1.0 / self.value)).exp()
    }
}

impl From<f64> for Dual {
    fn from(value: f64) -> Self {
        Self { value, slope: [0.0; MOST] }
    }
}

impl Neg for Dual {
    type Output = Dual;

    fn neg(self) -> Dual {
        self.chain(-self.value, -1.0)
    }
}

/// An operator, given as its value and its two partial derivatives, with a plain number on either side as well.
macro_rules! operator {
    ($trait:ident, $method:ident, $parts:expr) => {
        impl $trait for Dual {
            type Output = Dual;

            fn $method(self, other: Dual) -> Dual {
                let parts: fn(f64, f64) -> [f64; 3] = $parts;
                let [value, by_self, by_other] = parts(self.value, other.value);
                self.combined(other, value, by_self, by_other)
            }
        }

        impl $trait<f64> for Dual {
            type Output = Dual;

            fn $method(self, other: f64) -> Dual {
                $trait::$method(self, Dual::from(other))
            }
        }

        impl $trait<Dual> for f64 {
            type Output = Dual;

            fn $method(self, other: Dual) -> Dual {
                $trait::$method(Dual::from(self), other)
            }
        }
    };
}

operator!(Add, add, |a, b| [a + b, 1.0, 1.0]);
operator!(Sub, sub, |a, b| [a - b, 1.0, -1.0]);
operator!(Mul, mul, |a, b| [a * b, b, a]);
operator!(Div, div, |a, b| [a / b, 1.0 / b, -a / (b * b)]);
