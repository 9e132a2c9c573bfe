//! Conversions between [`Dense`] and the matrices of other libraries, each behind the feature of the library's name.

use crate::{Dense, Scalar};

#[cfg(feature = "nalgebra")]
mod nalgebra {
    use ::nalgebra::DMatrix;

    use super::{Dense, Scalar};

    impl<S: Scalar> From<&Dense<S>> for DMatrix<S> {
        fn from(matrix: &Dense<S>) -> Self {
            DMatrix::from_fn(matrix.rows(), matrix.columns(), |i, j| matrix.at(i, j))
        }
    }

    impl<S: Scalar> From<&DMatrix<S>> for Dense<S> {
        fn from(matrix: &DMatrix<S>) -> Self {
            Dense::from_fn(matrix.nrows(), matrix.ncols(), |i, j| matrix[(i, j)])
        }
    }
}

#[cfg(feature = "ndarray")]
mod ndarray {
    use ::ndarray::{Array2, ArrayView2};

    use super::{Dense, Scalar};

    impl<S: Scalar> From<&Dense<S>> for Array2<S> {
        fn from(matrix: &Dense<S>) -> Self {
            Array2::from_shape_fn((matrix.rows(), matrix.columns()), |(i, j)| matrix.at(i, j))
        }
    }

    impl<S: Scalar> From<&Array2<S>> for Dense<S> {
        fn from(matrix: &Array2<S>) -> Self {
            matrix.view().into()
        }
    }

    impl<S: Scalar> From<ArrayView2<'_, S>> for Dense<S> {
        fn from(matrix: ArrayView2<'_, S>) -> Self {
            Dense::from_fn(matrix.nrows(), matrix.ncols(), |i, j| matrix[(i, j)])
        }
    }
}

#[cfg(all(test, feature = "nalgebra", feature = "ndarray"))]
mod tests {
    use super::Dense;

    #[test]
    fn matrices_keep_their_shape_and_entries_both_ways() {
        let matrix = Dense::from_fn(2, 3, |i, j| (10 * i + j) as f64);
        let by_columns = ::nalgebra::DMatrix::from(&matrix);
        assert_eq!(by_columns, ::nalgebra::DMatrix::from_row_slice(2, 3, &[0.0, 1.0, 2.0, 10.0, 11.0, 12.0]));
        let by_rows = ::ndarray::Array2::from(&matrix);
        assert_eq!(by_rows, ::ndarray::array![[0.0, 1.0, 2.0], [10.0, 11.0, 12.0]]);
        assert_eq!(Dense::from(&by_columns), matrix);
        assert_eq!(Dense::from(&by_rows), matrix);
        assert_eq!(Dense::from(by_rows.t()), Dense::from(&by_columns.transpose()));
    }
}
