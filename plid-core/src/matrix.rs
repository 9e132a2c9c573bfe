//! Column-major views and storage, the only layout of data that the kernels of the backends accept.

use crate::Scalar;

/// A read-only view of a column-major matrix: entry (i, j) is `data[i + j * stride]`.
#[derive(Clone, Copy, Debug)]
pub struct View<'a, S> {
    data: &'a [S],
    rows: usize,
    columns: usize,
    stride: usize,
}

/// A mutable view of a column-major matrix.
#[derive(Debug)]
pub struct ViewMut<'a, S> {
    data: &'a mut [S],
    rows: usize,
    columns: usize,
    stride: usize,
}

/// Implements what both views have in common: `$data` is the type of their data, `$column` that of a column to be
/// read.
macro_rules! shape_and_entries {
    ($view:ident<$a:lifetime>, $data:ty, $column:ty) => {
        impl<$a, S: Scalar> $view<$a, S> {
            /// Creates a `rows` x `columns` view of `data`, with columns `stride` apart. Panics if `data` is too
            /// short or `stride` is less than `rows`.
            pub fn new(data: $data, rows: usize, columns: usize, stride: usize) -> Self {
                assert!(stride >= rows && (columns == 0 || data.len() >= (columns - 1) * stride + rows));
                Self { data, rows, columns, stride }
            }

            /// Returns the number of rows.
            pub fn rows(&self) -> usize {
                self.rows
            }

            /// Returns the number of columns.
            pub fn columns(&self) -> usize {
                self.columns
            }

            /// Returns the distance from one column to the next, in entries.
            pub fn stride(&self) -> usize {
                self.stride
            }

            /// Returns entry (i, j).
            #[inline]
            pub fn at(&self, i: usize, j: usize) -> S {
                self.data[i + j * self.stride]
            }

            /// Returns column `j`.
            #[inline]
            pub fn column(&self, j: usize) -> $column {
                &self.data[j * self.stride..j * self.stride + self.rows]
            }
        }
    };
}

shape_and_entries!(View<'a>, &'a [S], &'a [S]);
shape_and_entries!(ViewMut<'a>, &'a mut [S], &[S]);

impl<'a, S: Scalar> View<'a, S> {
    /// Returns the entries from (0, 0) on, including the gaps between columns.
    pub fn data(&self) -> &'a [S] {
        self.data
    }

    /// Returns the `rows` x `columns` block whose first entry is (row, column).
    pub fn block(&self, row: usize, column: usize, rows: usize, columns: usize) -> View<'a, S> {
        assert!(row + rows <= self.rows && column + columns <= self.columns);
        let start = if rows == 0 || columns == 0 { 0 } else { row + column * self.stride };
        View { data: &self.data[start..], rows, columns, stride: self.stride }
    }
}

impl<'a, S: Scalar> ViewMut<'a, S> {
    /// Returns the entries from (0, 0) on, including the gaps between columns, for writing.
    pub fn data_mut(&mut self) -> &mut [S] {
        self.data
    }

    /// Returns a read-only view of the same data for as long as the borrow lasts.
    #[inline]
    pub fn view(&self) -> View<'_, S> {
        View { data: self.data, rows: self.rows, columns: self.columns, stride: self.stride }
    }

    /// Reborrows the view.
    pub fn reborrow(&mut self) -> ViewMut<'_, S> {
        ViewMut { data: self.data, rows: self.rows, columns: self.columns, stride: self.stride }
    }

    /// Returns column `j` for writing.
    #[inline]
    pub fn column_mut(&mut self, j: usize) -> &mut [S] {
        &mut self.data[j * self.stride..j * self.stride + self.rows]
    }

    /// Returns columns j .. j + 4 for writing.
    #[inline(always)]
    pub fn four_columns_mut(&mut self, j: usize) -> [&mut [S]; 4] {
        let (stride, rows) = (self.stride, self.rows);
        let (c0, rest) = self.data[j * stride..].split_at_mut(stride);
        let (c1, rest) = rest.split_at_mut(stride);
        let (c2, c3) = rest.split_at_mut(stride);
        [&mut c0[..rows], &mut c1[..rows], &mut c2[..rows], &mut c3[..rows]]
    }

    /// Returns column `from` for reading and another column, `to`, for writing.
    #[inline]
    pub fn column_pair(&mut self, from: usize, to: usize) -> (&[S], &mut [S]) {
        assert_ne!(from, to);
        let (stride, rows) = (self.stride, self.rows);
        if from < to {
            let (head, tail) = self.data.split_at_mut(to * stride);
            (&head[from * stride..from * stride + rows], &mut tail[..rows])
        } else {
            let (head, tail) = self.data.split_at_mut(from * stride);
            (&tail[..rows], &mut head[to * stride..to * stride + rows])
        }
    }

    /// Returns entry (i, j) for writing.
    #[inline]
    pub fn at_mut(&mut self, i: usize, j: usize) -> &mut S {
        &mut self.data[i + j * self.stride]
    }

    /// Returns the `rows` x `columns` block whose first entry is (row, column), for writing.
    pub fn block_mut(&mut self, row: usize, column: usize, rows: usize, columns: usize) -> ViewMut<'_, S> {
        assert!(row + rows <= self.rows && column + columns <= self.columns);
        let start = if rows == 0 || columns == 0 { 0 } else { row + column * self.stride };
        ViewMut { data: &mut self.data[start..], rows, columns, stride: self.stride }
    }

    /// Splits the view into its first `columns` columns and the others.
    pub fn split_at_column(self, columns: usize) -> (ViewMut<'a, S>, ViewMut<'a, S>) {
        let (first, second) = self.data.split_at_mut((columns * self.stride).min(self.data.len()));
        let rest = self.columns - columns;
        (
            ViewMut { data: first, rows: self.rows, columns, stride: self.stride },
            ViewMut { data: second, rows: self.rows, columns: rest, stride: self.stride },
        )
    }

    /// Sets every entry to `value`.
    pub fn fill(&mut self, value: S) {
        for j in 0..self.columns {
            self.column_mut(j).fill(value);
        }
    }
}

/// Owned column-major storage of a backend.
pub trait Matrix<S>: Clone + std::fmt::Debug + Send + Sync + 'static {
    /// Creates a matrix of zeros.
    fn zeros(rows: usize, columns: usize) -> Self;

    /// Returns a read-only view of the whole matrix.
    fn view(&self) -> View<'_, S>;

    /// Returns a view of the whole matrix for writing.
    fn view_mut(&mut self) -> ViewMut<'_, S>;
}

/// A column-major matrix in a `Vec`. Its first entry is at the start of a cache line, because a vector register
/// whose entries span two lines takes two loads.
#[derive(Debug)]
pub struct Dense<S> {
    storage: Vec<S>,
    /// The index in `storage` of the first entry.
    start: usize,
    rows: usize,
    columns: usize,
}

/// The size of a cache line and of the widest registers, in bytes.
const LINE: usize = 64;

/// Returns the index at which the first cache line begins, or 0 if it is unknown, which only costs speed.
fn line_start<S>(storage: &[S]) -> usize {
    match storage.as_ptr().align_offset(LINE) {
        start if start <= line_entries::<S>() => start,
        _ => 0,
    }
}

fn line_entries<S>() -> usize {
    LINE / size_of::<S>().clamp(1, LINE)
}

impl<S: Clone> Clone for Dense<S> {
    fn clone(&self) -> Self {
        let mut storage = self.storage.clone();
        let start = line_start(&storage);
        // The rotations move only padding from one end of the storage to the other.
        storage.rotate_left(self.start);
        storage.rotate_right(start);
        Self { storage, start, rows: self.rows, columns: self.columns }
    }
}

impl<S: Scalar> PartialEq for Dense<S> {
    fn eq(&self, other: &Self) -> bool {
        self.rows == other.rows && self.columns == other.columns && self.data() == other.data()
    }
}

impl<S: Scalar> Dense<S> {
    /// Creates the matrix with the entries `f(i, j)`.
    pub fn from_fn(rows: usize, columns: usize, mut f: impl FnMut(usize, usize) -> S) -> Self {
        let mut matrix = Self::zeros(rows, columns);
        for j in 0..columns {
            for i in 0..rows {
                *matrix.at_mut(i, j) = f(i, j);
            }
        }
        matrix
    }

    /// Creates the matrix with `diagonal` on its diagonal and zeros elsewhere.
    pub fn from_diagonal(diagonal: &[S]) -> Self {
        Self::from_fn(diagonal.len(), diagonal.len(), |i, j| if i == j { diagonal[i] } else { S::zero() })
    }

    /// Returns the number of rows.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Returns the number of columns.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// Returns entry (i, j).
    #[inline]
    pub fn at(&self, i: usize, j: usize) -> S {
        self.data()[i + j * self.rows]
    }

    /// Returns entry (i, j) for writing.
    #[inline]
    pub fn at_mut(&mut self, i: usize, j: usize) -> &mut S {
        let at = i + j * self.rows;
        &mut self.data_mut()[at]
    }

    /// Returns column `j`.
    #[inline]
    pub fn column(&self, j: usize) -> &[S] {
        &self.data()[j * self.rows..(j + 1) * self.rows]
    }

    /// Returns column `j` for writing.
    #[inline]
    pub fn column_mut(&mut self, j: usize) -> &mut [S] {
        let rows = self.rows;
        &mut self.data_mut()[j * rows..(j + 1) * rows]
    }

    /// Returns the entries, column by column.
    #[inline]
    pub fn data(&self) -> &[S] {
        &self.storage[self.start..self.start + self.rows * self.columns]
    }

    #[inline]
    fn data_mut(&mut self) -> &mut [S] {
        &mut self.storage[self.start..self.start + self.rows * self.columns]
    }

    /// Sets every entry to `value`.
    pub fn fill(&mut self, value: S) {
        self.data_mut().fill(value);
    }

    /// Converts the matrix to another scalar by way of `f64`, so that a double-double loses its low part.
    pub fn cast<T: Scalar>(&self) -> Dense<T> {
        Dense::from_fn(self.rows, self.columns, |i, j| T::from_f64(self.at(i, j).to_f64()))
    }
}

impl<S: Scalar> Matrix<S> for Dense<S> {
    fn zeros(rows: usize, columns: usize) -> Self {
        let storage = vec![S::zero(); rows * columns + line_entries::<S>()];
        Self { start: line_start(&storage), storage, rows, columns }
    }

    fn view(&self) -> View<'_, S> {
        View { data: self.data(), rows: self.rows, columns: self.columns, stride: self.rows }
    }

    fn view_mut(&mut self) -> ViewMut<'_, S> {
        let (rows, columns) = (self.rows, self.columns);
        ViewMut { data: self.data_mut(), rows, columns, stride: rows }
    }
}
