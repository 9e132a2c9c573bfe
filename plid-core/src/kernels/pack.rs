//! Packs of W numbers that a kernel processes together, so that they fill vector registers.

use crate::Scalar;

/// W numbers. All operations are inlined into a kernel that is compiled for the CPU's vector instructions.
#[derive(Clone, Copy, Debug)]
pub struct Pack<S, const W: usize>(pub [S; W]);

impl<S: Scalar, const W: usize> Pack<S, W> {
    /// Returns W zeros.
    #[inline(always)]
    pub fn zero() -> Self {
        Self([S::zero(); W])
    }

    /// Loads the first W entries of `from`.
    #[inline(always)]
    pub fn load(from: &[S]) -> Self {
        let mut pack = Self::zero();
        pack.0.copy_from_slice(&from[..W]);
        pack
    }

    /// Stores the numbers in the first W entries of `to`.
    #[inline(always)]
    pub fn store(self, to: &mut [S]) {
        to[..W].copy_from_slice(&self.0);
    }

    /// Returns self b, entry by entry.
    #[inline(always)]
    pub fn scaled(mut self, b: S) -> Self {
        for x in &mut self.0 {
            *x *= b;
        }
        self
    }

    /// Returns self + a b, entry by entry.
    #[inline(always)]
    pub fn add_scaled(mut self, a: Self, b: S) -> Self {
        for i in 0..W {
            self.0[i] = a.0[i].mul_add(b, self.0[i]);
        }
        self
    }

    /// Returns self + a b, entry by entry.
    #[inline(always)]
    pub fn add_product(mut self, a: Self, b: Self) -> Self {
        for i in 0..W {
            self.0[i] = a.0[i].mul_add(b.0[i], self.0[i]);
        }
        self
    }
}
