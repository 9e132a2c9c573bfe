//! Dense matrices by plain loops in any scalar. Only the number trait of the library under test is used.

use std::ops::{Add, Index, IndexMut, Mul, Sub};

use plid_core::Scalar;

/// A dense matrix in row-major order.
#[derive(Clone, Debug)]
pub struct Mat<S> {
    pub rows: usize,
    pub columns: usize,
    data: Vec<S>,
}

impl<S: Scalar> Mat<S> {
    pub fn zeros(rows: usize, columns: usize) -> Self {
        Self { rows, columns, data: vec![S::zero(); rows * columns] }
    }

    pub fn from_fn(rows: usize, columns: usize, f: impl Fn(usize, usize) -> S) -> Self {
        let data = (0..rows * columns).map(|k| f(k / columns, k % columns)).collect();
        Self { rows, columns, data }
    }

    pub fn identity(n: usize) -> Self {
        Self::from_fn(n, n, |i, j| if i == j { S::one() } else { S::zero() })
    }

    pub fn column(entries: &[S]) -> Self {
        Self::from_fn(entries.len(), 1, |i, _| entries[i])
    }

    pub fn from_f64(m: &plid_core::Dense<f64>) -> Self {
        Self::from_fn(m.rows(), m.columns(), |i, j| S::from_f64(m.at(i, j)))
    }

    pub fn t(&self) -> Self {
        Self::from_fn(self.columns, self.rows, |i, j| self[(j, i)])
    }

    pub fn scaled(&self, factor: S) -> Self {
        Self::from_fn(self.rows, self.columns, |i, j| factor * self[(i, j)])
    }

    pub fn block(&self, row: usize, column: usize, rows: usize, columns: usize) -> Self {
        Self::from_fn(rows, columns, |i, j| self[(row + i, column + j)])
    }

    /// Adds `m` to the block that starts at (row, column).
    pub fn add_block(&mut self, row: usize, column: usize, m: &Self) {
        for i in 0..m.rows {
            for j in 0..m.columns {
                self[(row + i, column + j)] += m[(i, j)];
            }
        }
    }

    /// Returns the inverse by Gauss-Jordan elimination with row pivoting.
    pub fn inverse(&self) -> Self {
        let n = self.rows;
        let (mut a, mut b) = (self.clone(), Self::identity(n));
        for k in 0..n {
            let best = (k..n).fold(k, |best, i| if a[(i, k)].abs() > a[(best, k)].abs() { i } else { best });
            for j in 0..n {
                a.data.swap(k * n + j, best * n + j);
                b.data.swap(k * n + j, best * n + j);
            }
            let pivot = a[(k, k)];
            for j in 0..n {
                a[(k, j)] /= pivot;
                b[(k, j)] /= pivot;
            }
            for i in (0..n).filter(|&i| i != k) {
                let factor = a[(i, k)];
                for j in 0..n {
                    let (x, y) = (a[(k, j)], b[(k, j)]);
                    a[(i, j)] -= factor * x;
                    b[(i, j)] -= factor * y;
                }
            }
        }
        b
    }

    /// Returns the Frobenius norm.
    pub fn norm(&self) -> f64 {
        self.data.iter().map(|x| x.to_f64() * x.to_f64()).sum::<f64>().sqrt()
    }

    pub fn to_f64(&self) -> Vec<f64> {
        self.data.iter().map(|x| x.to_f64()).collect()
    }
}

impl<S> Index<(usize, usize)> for Mat<S> {
    type Output = S;
    fn index(&self, (i, j): (usize, usize)) -> &S {
        assert!(i < self.rows && j < self.columns);
        &self.data[i * self.columns + j]
    }
}

impl<S> IndexMut<(usize, usize)> for Mat<S> {
    fn index_mut(&mut self, (i, j): (usize, usize)) -> &mut S {
        assert!(i < self.rows && j < self.columns);
        &mut self.data[i * self.columns + j]
    }
}

impl<S: Scalar> Mul for &Mat<S> {
    type Output = Mat<S>;
    fn mul(self, other: &Mat<S>) -> Mat<S> {
        assert_eq!(self.columns, other.rows);
        let mut product = Mat::zeros(self.rows, other.columns);
        for i in 0..self.rows {
            for k in 0..self.columns {
                let a = self[(i, k)];
                // F is mostly zeros, and double-double is slow.
                if a != S::zero() {
                    for j in 0..other.columns {
                        product[(i, j)] += a * other[(k, j)];
                    }
                }
            }
        }
        product
    }
}

impl<S: Scalar> Add for &Mat<S> {
    type Output = Mat<S>;
    fn add(self, other: &Mat<S>) -> Mat<S> {
        assert_eq!((self.rows, self.columns), (other.rows, other.columns));
        Mat::from_fn(self.rows, self.columns, |i, j| self[(i, j)] + other[(i, j)])
    }
}

impl<S: Scalar> Sub for &Mat<S> {
    type Output = Mat<S>;
    fn sub(self, other: &Mat<S>) -> Mat<S> {
        assert_eq!((self.rows, self.columns), (other.rows, other.columns));
        Mat::from_fn(self.rows, self.columns, |i, j| self[(i, j)] - other[(i, j)])
    }
}
