//! faer's products on plain column-major storage. A faer matrix provides each column as a slice, but not the whole
//! matrix as one.

use std::marker::PhantomData;

use faer::linalg::matmul::triangular::{BlockStructure, matmul};
use faer::traits::RealField;
use faer::{Accum, MatMut, MatRef, Par};
use plid_core::kernels::Kernels;
use plid_core::{Backend, Dense, View, ViewMut};

/// faer, for `f32` and `f64`, on one thread.
#[derive(Clone, Copy, Debug)]
pub struct Faer<S>(PhantomData<S>);

/// With fewer terms than this, a product is faster as a few additions of columns than as faer's blocked product.
const FEW_TERMS: usize = 12;

impl<S: Kernels + RealField> Backend for Faer<S> {
    type Scalar = S;
    type Matrix = Dense<S>;

    fn symmetric_product_lower(mut c: ViewMut<'_, S>, alpha: S, a: View<'_, S>, b: View<'_, S>) {
        if a.columns() < FEW_TERMS {
            return S::symmetric_product_lower(c, alpha, a, b);
        }
        let (rows, columns, stride) = (c.rows(), c.columns(), c.stride());
        let c = MatMut::from_column_major_slice_with_stride_mut(c.data_mut(), rows, columns, stride);
        let a = MatRef::from_column_major_slice_with_stride(a.data(), a.rows(), a.columns(), a.stride());
        let b = MatRef::from_column_major_slice_with_stride(b.data(), b.rows(), b.columns(), b.stride());
        let (lower, whole) = (BlockStructure::TriangularLower, BlockStructure::Rectangular);
        matmul(c, lower, Accum::Add, a, whole, b.transpose(), whole, alpha, Par::Seq);
    }
}
