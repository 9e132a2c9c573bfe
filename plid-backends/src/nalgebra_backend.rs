//! Storage and products of nalgebra.

use std::marker::PhantomData;

use nalgebra::{DMatrix, DMatrixView, DMatrixViewMut, Dyn, MatrixView, RealField};
use plid_core::kernels::Kernels;
use plid_core::{Backend, Matrix, Scalar, View, ViewMut};

/// nalgebra, for `f32` and `f64`.
///
/// Its general matrix product allocates packing buffers on every call, which a step must not do. Its matrix-vector
/// product is used instead, for one column of the result at a time.
#[derive(Clone, Copy, Debug)]
pub struct Nalgebra<S>(PhantomData<S>);

/// An nalgebra matrix as storage.
#[derive(Clone, Debug)]
pub struct NalgebraMatrix<S: RealField>(pub DMatrix<S>);

impl<S: Scalar + RealField> Matrix<S> for NalgebraMatrix<S> {
    fn zeros(rows: usize, columns: usize) -> Self {
        Self(DMatrix::zeros(rows, columns))
    }

    fn view(&self) -> View<'_, S> {
        View::new(self.0.as_slice(), self.0.nrows(), self.0.ncols(), self.0.nrows())
    }

    fn view_mut(&mut self) -> ViewMut<'_, S> {
        let (rows, columns) = self.0.shape();
        ViewMut::new(self.0.as_mut_slice(), rows, columns, rows)
    }
}

fn view<S: Scalar + RealField>(v: View<'_, S>) -> DMatrixView<'_, S, nalgebra::U1, Dyn> {
    DMatrixView::from_slice_with_strides_generic(
        v.data(),
        Dyn(v.rows()),
        Dyn(v.columns()),
        nalgebra::Const::<1>,
        Dyn(v.stride()),
    )
}

/// Returns row `j` as a column. nalgebra's own transpose of a view would allocate.
fn row_as_column<S: Scalar + RealField>(v: View<'_, S>, j: usize) -> MatrixView<'_, S, Dyn, nalgebra::U1, Dyn, Dyn> {
    let strides = (Dyn(v.stride()), Dyn(v.data().len()));
    MatrixView::from_slice_with_strides_generic(&v.data()[j..], Dyn(v.columns()), nalgebra::U1, strides.0, strides.1)
}

impl<S: Kernels + RealField> Backend for Nalgebra<S> {
    type Scalar = S;
    type Matrix = NalgebraMatrix<S>;

    fn symmetric_product_lower(mut c: ViewMut<'_, S>, alpha: S, a: View<'_, S>, b: View<'_, S>) {
        let a = view(a);
        let (rows, columns) = (c.rows(), c.columns());
        for j in 0..columns {
            let column = &mut c.column_mut(j)[j..];
            let mut column = DMatrixViewMut::from_slice(column, rows - j, 1);
            column.column_mut(0).gemv(alpha, &a.rows(j, rows - j), &row_as_column(b, j), S::one());
        }
    }
}
