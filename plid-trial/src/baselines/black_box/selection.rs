//! The choice of the regressors of the black box and of their coefficients: forward selection of whole banks by
//! orthogonal matching pursuit, and ridge regression. A record to which the coefficients were not fitted selects
//! their number.

use nalgebra::{Cholesky, DMatrix, Dyn};
use plid_gap::case::Channels;
use plid_gap::research::Plant;

use super::Term;
use super::bank::Bank;
use super::regressors::{Extent, Regressor, Run, all};

/// Largest number of regressors.
const MOST: usize = 12;
/// Number of rows on which the choice of the regressors is based.
const SCREENED: usize = 3000;
/// Stride of the samples that are rows of the regression.
const STRIDE: usize = 2;
/// Ridges on columns of unit RMS.
const RIDGES: [f64; 4] = [1e-8, 1e-6, 1e-4, 1e-2];
/// Ridge on columns of unit length for the choice.
const SCREEN_RIDGE: f64 = 1e-6;

/// A record: the signals of its linear run, and the residual of this run at each output (p channels).
pub(super) struct Lesson {
    pub run: Run,
    pub left: Channels,
}

impl Lesson {
    /// Returns the indices of every `stride`-th sample, except those at which an output was not measured.
    fn rows(&self, stride: usize) -> Vec<usize> {
        let measured = |k: &usize| self.left.iter().all(|left| left[*k].is_finite());
        (0..self.run.times.len()).step_by(stride).filter(measured).collect()
    }
}

/// The regressors and the filters of a plant.
struct Library<'a> {
    bank: Bank,
    extents: &'a [Extent],
}

impl Library<'_> {
    /// Returns the filtered values of one regressor in some rows of a record.
    fn columns(&self, lesson: &Lesson, regressor: &Regressor, rows: &[usize]) -> Vec<Vec<f64>> {
        let filtered = self.bank.filtered(&regressor.values(&lesson.run, self.extents));
        filtered.iter().map(|column| rows.iter().map(|k| column[*k]).collect()).collect()
    }
}

/// Chooses regressors by some records and their number by others, and fits their coefficients to all records.
pub(super) fn terms(
    learnt: &[Lesson],
    selecting: &[Lesson],
    extents: &[Extent],
    plant: &Plant,
    scale: &[f64],
) -> Vec<Term> {
    let library = Library { bank: Bank::new(plant), extents };
    let chosen = chosen(learnt, &library, &all(plant, extents));
    let width = library.bank.width();
    let (fit, judge) = (Normal::of(learnt, &library, &chosen), Normal::of(selecting, &library, &chosen));
    // Without any regressor, the simulation stays as it is.
    let mut best = (judge.squares, 0, RIDGES[0]);
    for count in 1..=chosen.len() {
        for ridge in RIDGES {
            let Some(coefficients) = fit.solved(count * width, ridge) else { continue };
            let squares = judge.squares_with(&coefficients);
            if squares < best.0 {
                best = (squares, count, ridge);
            }
        }
    }
    let (_, count, ridge) = best;
    let Some(coefficients) = fit.with(&judge).solved(count * width, ridge) else { return Vec::new() };
    let of_term = |k: usize| {
        let of_output = |(o, scale): (usize, &f64)| {
            coefficients.view((k * width, o), (width, 1)).iter().map(|x| x * scale).collect()
        };
        Term { regressor: chosen[k], coefficients: scale.iter().enumerate().map(of_output).collect() }
    };
    (0..count).map(of_term).collect()
}

/// A regressor with the columns of its bank, which have unit length, and the Cholesky factor of their products.
struct Candidate {
    regressor: Regressor,
    columns: DMatrix<f64>,
    factor: Cholesky<f64, Dyn>,
}

impl Candidate {
    fn new(lessons: &[Lesson], rows: &[Vec<usize>], library: &Library, regressor: Regressor) -> Option<Self> {
        let width = library.bank.width();
        let total = rows.iter().map(Vec::len).sum();
        let mut columns = DMatrix::zeros(total, width);
        let mut at = 0;
        for (lesson, rows) in lessons.iter().zip(rows) {
            for (j, column) in library.columns(lesson, &regressor, rows).iter().enumerate() {
                columns.view_mut((at, j), (rows.len(), 1)).copy_from_slice(column);
            }
            at += rows.len();
        }
        for mut column in columns.column_iter_mut() {
            let length = column.norm();
            column /= length.max(f64::MIN_POSITIVE);
        }
        let mut products = columns.transpose() * &columns;
        (0..width).for_each(|j| products[(j, j)] += SCREEN_RIDGE);
        Some(Self { regressor, columns, factor: products.cholesky()? })
    }

    /// Returns the part of the sum of squares of the residual that the bank explains.
    fn gain(&self, left: &DMatrix<f64>) -> f64 {
        let cross = self.columns.transpose() * left;
        cross.dot(&self.factor.solve(&cross))
    }
}

/// Returns the regressors in order. Each explains most of the residual that those before it leave.
fn chosen(lessons: &[Lesson], library: &Library, all: &[Regressor]) -> Vec<Regressor> {
    let samples: usize = lessons.iter().map(|lesson| lesson.run.times.len()).sum();
    let rows: Vec<Vec<usize>> = lessons.iter().map(|lesson| lesson.rows(samples.div_ceil(SCREENED).max(1))).collect();
    let mut candidates: Vec<Candidate> =
        all.iter().filter_map(|regressor| Candidate::new(lessons, &rows, library, *regressor)).collect();
    let mut left = residual(lessons, &rows);
    let mut basis: Option<DMatrix<f64>> = None;
    let mut chosen = Vec::new();
    while chosen.len() < MOST && !candidates.is_empty() {
        let gains: Vec<f64> = candidates.iter().map(|candidate| candidate.gain(&left)).collect();
        let Some(best) = (0..gains.len()).max_by(|a, b| gains[*a].total_cmp(&gains[*b])) else { break };
        let Candidate { regressor, mut columns, .. } = candidates.swap_remove(best);
        chosen.push(regressor);
        if let Some(basis) = &basis {
            columns -= basis * (basis.transpose() * &columns);
        }
        if columns.nrows() < columns.ncols() {
            break;
        }
        let new = columns.qr().q();
        left -= &new * (new.transpose() * &left);
        basis = Some(match basis {
            None => new,
            Some(basis) => {
                let mut wider = basis.clone().insert_columns(basis.ncols(), new.ncols(), 0.0);
                wider.columns_mut(basis.ncols(), new.ncols()).copy_from(&new);
                wider
            }
        });
    }
    chosen
}

/// Returns the residuals of the linear runs in these rows, with a column for each output.
fn residual(lessons: &[Lesson], rows: &[Vec<usize>]) -> DMatrix<f64> {
    let outputs = lessons.first().map_or(0, |lesson| lesson.left.len());
    let of_output = |o: usize| {
        lessons.iter().zip(rows).flat_map(move |(lesson, rows)| rows.iter().map(move |k| lesson.left[o][*k]))
    };
    DMatrix::from_iterator(rows.iter().map(Vec::len).sum(), outputs, (0..outputs).flat_map(of_output))
}

/// The normal equations of a regression on the banks of some regressors.
struct Normal {
    products: DMatrix<f64>,
    cross: DMatrix<f64>,
    squares: f64,
    rows: usize,
}

impl Normal {
    fn of(lessons: &[Lesson], library: &Library, chosen: &[Regressor]) -> Self {
        let width = chosen.len() * library.bank.width();
        let outputs = lessons.first().map_or(0, |lesson| lesson.left.len());
        let mut normal = Self {
            products: DMatrix::zeros(width, width),
            cross: DMatrix::zeros(width, outputs),
            squares: 0.0,
            rows: 0,
        };
        for lesson in lessons {
            let rows = lesson.rows(STRIDE);
            let columns: Vec<f64> =
                chosen.iter().flat_map(|regressor| library.columns(lesson, regressor, &rows)).flatten().collect();
            let columns = DMatrix::from_vec(rows.len(), width, columns);
            let left = residual(std::slice::from_ref(lesson), std::slice::from_ref(&rows));
            let across = columns.transpose();
            normal.products.gemm(1.0, &across, &columns, 1.0);
            normal.cross.gemm(1.0, &across, &left, 1.0);
            normal.squares += left.norm_squared();
            normal.rows += rows.len();
        }
        normal
    }

    /// Returns the equations of both sets of records.
    fn with(&self, other: &Self) -> Self {
        Self {
            products: &self.products + &other.products,
            cross: if other.rows == 0 { self.cross.clone() } else { &self.cross + &other.cross },
            squares: self.squares + other.squares,
            rows: self.rows + other.rows,
        }
    }

    /// Returns the coefficients of the first columns, with one column of coefficients for each output.
    fn solved(&self, count: usize, ridge: f64) -> Option<DMatrix<f64>> {
        // Columns of unit RMS; one that is always zero gets no coefficient.
        let size = |j: usize| (self.products[(j, j)] / self.rows as f64).sqrt();
        let by: Vec<f64> = (0..count).map(size).map(|size| if size > 0.0 { 1.0 / size } else { 0.0 }).collect();
        let mut products = self.products.view((0, 0), (count, count)).into_owned() / self.rows as f64;
        for (j, mut column) in products.column_iter_mut().enumerate() {
            column.iter_mut().zip(&by).for_each(|(x, other)| *x *= by[j] * other);
            column[j] += ridge;
        }
        let scaled = |mut x: DMatrix<f64>| {
            x.row_iter_mut().zip(&by).for_each(|(mut row, by)| row *= *by);
            x
        };
        let cross = scaled(self.cross.rows(0, count).into_owned() / self.rows as f64);
        Some(scaled(products.cholesky()?.solve(&cross)))
    }

    /// Returns the sum of squares that remains with these coefficients of the first columns.
    fn squares_with(&self, coefficients: &DMatrix<f64>) -> f64 {
        let count = coefficients.nrows();
        let products = self.products.view((0, 0), (count, count));
        self.squares - 2.0 * coefficients.dot(&self.cross.rows(0, count)) + coefficients.dot(&(products * coefficients))
    }
}
