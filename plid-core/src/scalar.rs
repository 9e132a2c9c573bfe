//! The number type of the recursion: `f32`, `f64`, or double-double ([`qd::Quad`], about 31 digits).

use std::fmt::Debug;

use num_traits::NumAssign;

/// A real number that the recursion can run in.
///
/// The trait requires only what the recursion uses, so that a type without `Display` or `num_traits::Float` (such as
/// `qd::Quad`) qualifies.
pub trait Scalar: NumAssign + std::ops::Neg<Output = Self> + PartialOrd + Copy + Debug + Send + Sync + 'static {
    /// Unit roundoff: the largest relative error of one rounded operation, as an `f64`.
    const EPSILON: f64;

    /// The smallest positive number of full precision, as an `f64`.
    const SMALLEST: f64;

    /// Returns the nearest number of this type.
    fn from_f64(value: f64) -> Self;

    /// Returns the nearest `f64`.
    fn to_f64(self) -> f64;

    /// Returns the square root, or NaN for a number below zero.
    fn sqrt(self) -> Self;

    /// Returns whether the number is neither infinite nor NaN.
    fn is_finite(self) -> bool;

    /// Returns self a + b, rounded once if the type supports this. Only the kernels use this method, because they are
    /// compiled for CPUs that have the instruction; elsewhere it would be a call of a library function.
    fn mul_add(self, a: Self, b: Self) -> Self {
        self * a + b
    }

    /// Returns the number exactly, as an unevaluated sum of two `f64`. Checkpoints store numbers in this form.
    fn to_parts(self) -> [f64; 2] {
        [self.to_f64(), 0.0]
    }

    /// Restores a number from the result of [`Scalar::to_parts`].
    fn from_parts(parts: [f64; 2]) -> Self {
        Self::from_f64(parts[0])
    }

    /// Returns the absolute value.
    fn abs(self) -> Self {
        if self < Self::zero() { -self } else { self }
    }

    /// Returns the larger of two numbers, or `self` if either is NaN.
    fn max(self, other: Self) -> Self {
        if other > self { other } else { self }
    }
}

impl Scalar for f64 {
    const EPSILON: f64 = f64::EPSILON / 2.0;
    const SMALLEST: f64 = f64::MIN_POSITIVE;

    fn from_f64(value: f64) -> Self {
        value
    }

    fn to_f64(self) -> f64 {
        self
    }

    fn sqrt(self) -> Self {
        f64::sqrt(self)
    }

    fn is_finite(self) -> bool {
        f64::is_finite(self)
    }

    #[inline(always)]
    fn mul_add(self, a: Self, b: Self) -> Self {
        f64::mul_add(self, a, b)
    }
}

impl Scalar for f32 {
    const EPSILON: f64 = (f32::EPSILON / 2.0) as f64;
    const SMALLEST: f64 = f32::MIN_POSITIVE as f64;

    fn from_f64(value: f64) -> Self {
        value as f32
    }

    fn to_f64(self) -> f64 {
        self as f64
    }

    fn sqrt(self) -> Self {
        f32::sqrt(self)
    }

    fn is_finite(self) -> bool {
        f32::is_finite(self)
    }

    #[inline(always)]
    fn mul_add(self, a: Self, b: Self) -> Self {
        f32::mul_add(self, a, b)
    }
}

impl Scalar for qd::Quad {
    const EPSILON: f64 = f64::EPSILON * f64::EPSILON / 4.0;
    // The low part of the sum must have full precision too.
    const SMALLEST: f64 = f64::MIN_POSITIVE / f64::EPSILON;

    fn from_f64(value: f64) -> Self {
        qd::Quad::from_f64(value)
    }

    fn to_f64(self) -> f64 {
        self.0 + self.1
    }

    fn sqrt(self) -> Self {
        // The library divides by the root, so that the root of zero would be NaN.
        if self == qd::Quad::from_f64(0.0) { self } else { qd::Quad::sqrt(self) }
    }

    fn is_finite(self) -> bool {
        qd::Quad::is_finite(self)
    }

    fn to_parts(self) -> [f64; 2] {
        [self.0, self.1]
    }

    fn from_parts(parts: [f64; 2]) -> Self {
        qd::Quad(parts[0], parts[1])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn double_double_keeps_thirty_digits() {
        let third = qd::Quad::from_f64(1.0) / qd::Quad::from_f64(3.0);
        let error = (third * qd::Quad::from_f64(3.0) - qd::Quad::from_f64(1.0)).abs();
        assert!(error.to_f64() < 1e-31, "{error:?}");
        let root = Scalar::sqrt(qd::Quad::from_f64(2.0));
        assert!((root * root - qd::Quad::from_f64(2.0)).abs().to_f64() < 1e-30);
    }

    #[test]
    fn root_of_zero_is_zero_in_every_scalar() {
        assert_eq!(Scalar::sqrt(qd::Quad::from_f64(0.0)).to_f64(), 0.0);
        assert_eq!(Scalar::sqrt(0.0_f32), 0.0);
    }

    #[test]
    fn parts_restore_every_bit() {
        let x = qd::Quad::from_f64(1.0) / qd::Quad::from_f64(7.0);
        assert_eq!(qd::Quad::from_parts(x.to_parts()), x);
        assert_eq!(f32::from_parts(0.1_f32.to_parts()).to_bits(), 0.1_f32.to_bits());
    }
}
