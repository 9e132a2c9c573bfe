//! The parts of a step of the direct form with the joint EKF, each timed alone and compared with its own limit.

use std::hint::black_box;

use multiversion::multiversion;
use plid_backends::Plain;
use plid_core::kernels::{Kernels, Pack, Shift};
use plid_core::{
    Backend, CovariancePropagation, Dense, ImplicitModel, InitialCovariance, Matrix, ObservableForm, StepSize,
    StructureError,
};
use plid_variants::covariance::Direct;

use super::cell::OUTPUTS;
use super::limits::{Pass, time};

/// Bytes of a number.
const F64: f64 = 8.0;

/// Number of columns of the product with the regressor that a step forms at once.
const AT_ONCE: usize = 32;

/// A part of a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Part {
    /// Its name.
    pub what: &'static str,
    /// Number of operations; a multiplication and an addition are two.
    pub operations: f64,
    /// Number of bytes that it must read and write.
    pub bytes: f64,
    /// The time in s.
    pub seconds: f64,
}

impl Part {
    /// Returns the least time in s in which the machine can do this: that of its operations at the peak (operations
    /// per second), or that of a pass over a matrix of as many bytes, whichever is longer.
    pub fn limit(&self, peak: f64) -> f64 {
        let side = (self.bytes / (2.0 * F64)).sqrt().round() as usize;
        let mut pass = Pass::<f64>::new(side);
        (self.operations / peak).max(time(|| pass.full()))
    }
}

/// The matrices of a step.
struct Step {
    size: StepSize,
    form: ObservableForm,
    shift: Shift,
    p: Dense<f64>,
    /// N x p.
    left: Dense<f64>,
    right: Dense<f64>,
    /// p x p.
    factor: Dense<f64>,
    /// n x n.
    states: Dense<f64>,
    sums: Dense<f64>,
    /// n x c for each of [`AT_ONCE`] columns.
    mirrored: Dense<f64>,
    /// n x p.
    abar: Dense<f64>,
    phi: Vec<f64>,
}

impl Step {
    /// The numbers stay ordinary, however often a part is repeated.
    fn new(n: usize, inputs: usize) -> Result<Self, StructureError> {
        let form = ObservableForm::balanced(n, OUTPUTS, inputs)?;
        let size = StepSize { n: n as f64, p: OUTPUTS as f64, m: inputs as f64, full_noise: false };
        let (columns, joint) = (OUTPUTS + inputs, (OUTPUTS + inputs + 1) * n);
        Ok(Self {
            size,
            shift: Shift::new(&form),
            form,
            p: Dense::from_fn(joint, joint, |i, j| if i >= j { 1.0 } else { 0.0 }),
            left: Dense::from_fn(joint, OUTPUTS, |_, _| 1e-9),
            right: Dense::from_fn(joint, OUTPUTS, |_, _| 1e-9),
            factor: Dense::from_fn(OUTPUTS, OUTPUTS, |i, j| if i >= j { 1.0 } else { 0.0 }),
            states: Dense::zeros(n, n),
            sums: Dense::zeros(n, n),
            mirrored: Dense::zeros(n, AT_ONCE.min(n) * columns),
            abar: Dense::zeros(n, OUTPUTS),
            phi: vec![1e-9; columns],
        })
    }

    fn part(what: &'static str, operations: f64, bytes: f64, work: impl FnMut()) -> Part {
        Part { what, operations, bytes, seconds: time(work) }
    }

    /// The parts of the measurement update.
    fn measurement(&mut self) -> Vec<Part> {
        let StepSize { p, .. } = self.size;
        let (joint, triangle) = (self.size.joint(), self.size.triangle());
        let initial = InitialCovariance::Diagonal(vec![1.0; self.p.rows()]);
        let direct = Direct::<Plain<f64>>::new(&self.form, &initial, &()).expect("a covariance");
        let rows = self.form.output_states().to_vec();
        let thin = 2.0 * F64 * joint * p;
        let Self { p: matrix, left, right, factor, .. } = self;
        vec![
            Self::part("columns of P that the outputs see", 0.0, thin, || {
                direct.output_columns(&rows, left.view_mut());
                black_box(&mut *left);
            }),
            Self::part("gain", 2.0 * joint * p * p, thin, || {
                f64::solve_gain(left.view(), factor.view(), right.view_mut());
                black_box(&mut *right);
            }),
            {
                left.fill(1e-9);
                right.fill(1e-9);
                Self::part("downdate of P", 2.0 * p * triangle, 2.0 * F64 * triangle + thin, || {
                    Plain::<f64>::symmetric_product_lower(matrix.view_mut(), -1.0, left.view(), right.view());
                    black_box(&mut *matrix);
                })
            },
        ]
    }

    /// The parts of the time update on the states' covariances.
    fn states(&mut self) -> Vec<Part> {
        let StepSize { n, p, .. } = self.size;
        let c = self.size.columns();
        let square = F64 * n * n;
        let rows = self.form.output_states().to_vec();
        let states = self.abar.rows();
        let joint = self.p.rows();
        let Self { p: matrix, states: x, sums, abar, left, shift, phi, .. } = self;
        let mut work = [0.0; OUTPUTS];
        vec![
            Self::part("P_xx through Abar from both sides", 4.0 * (p + 1.0) * n * n, 4.0 * square, || {
                let mut kept = left.view_mut();
                f64::advance_rows(x.view_mut(), shift, &rows, abar.view(), kept.block_mut(0, 0, states, OUTPUTS));
                f64::advance_columns(x.view_mut(), shift, &rows, abar.view(), &mut work);
                black_box(&mut *x);
            }),
            Self::part("mirror images in P_xx", 2.0 * n * n, 6.0 * square, || {
                f64::add_mirrored(sums.view(), 1, 0, 0, x.view_mut());
                f64::add_mirrored(sums.view(), 1, 0, 0, x.view_mut());
                black_box(&mut *x);
            }),
            Self::part("P_theta x through Abar", 2.0 * (p + 1.0) * c * n * n, 2.0 * c * square, || {
                let mut cross = matrix.view_mut();
                let cross = cross.block_mut(states, 0, joint - states, states);
                let mut kept = left.view_mut();
                let kept = kept.block_mut(states, 0, joint - states, OUTPUTS);
                f64::advance_rows(cross, shift, &rows, abar.view(), kept);
                black_box(&mut *matrix);
            }),
            Self::part("sums of the blocks of P_theta x, twice", 4.0 * c * n * n, 2.0 * (c + 2.0) * square, || {
                for _ in 0..2 {
                    let cross = matrix.view().block(states, 0, joint - states, states);
                    f64::add_block_sums(sums.view_mut(), cross, phi);
                }
                black_box(&mut *sums);
            }),
        ]
    }

    /// The product with the regressor, without and with the mirror images of the triangle.
    fn regressor(&mut self) -> Vec<Part> {
        let StepSize { n, .. } = self.size;
        let c = self.size.columns();
        let block = F64 * c * n * n;
        let theta = F64 * c * n * (c * n + 1.0) / 2.0;
        let (states, joint) = (self.abar.rows(), self.p.rows());
        let Self { p: matrix, mirrored, phi, .. } = self;
        let mut matrix = matrix.view_mut();
        let (mut left, mut right) = matrix.reborrow().split_at_column(states);
        let mut cross = left.block_mut(states, 0, joint - states, states);
        let triangle = right.block_mut(states, 0, joint - states, joint - states);
        let (k, starts) = (phi.len(), (0..states).step_by(AT_ONCE));
        vec![
            Self::part("product with the regressor", 2.0 * c * c * n * n, theta + 3.0 * block, || {
                for from in starts.clone() {
                    let count = AT_ONCE.min(states - from);
                    let mut work = mirrored.view_mut();
                    let (work, y) =
                        (work.block_mut(0, 0, states, k * count), cross.block_mut(0, from, k * states, count));
                    f64::block_product_lower(triangle.view(), phi, from, y, work);
                }
                black_box(&mut *mirrored);
            }),
            Self::part("mirror images of that product", c * n * n, 3.0 * block, || {
                for from in starts.clone() {
                    let work = mirrored.view().block(0, 0, states, k * AT_ONCE.min(states - from));
                    f64::add_mirrored(work, k, from, 0, cross.reborrow());
                }
                black_box(&mut *mirrored);
            }),
        ]
    }
}

/// Returns the parts of a step with n states, three outputs and these inputs. Copies, the zeroing of scratch and the
/// loop of the identifier are what a whole step takes beyond them.
///
/// # Errors
/// Returns an error if there are fewer states than outputs.
pub fn parts(n: usize, inputs: usize) -> Result<Vec<Part>, StructureError> {
    let mut step = Step::new(n, inputs)?;
    Ok([step.measurement(), step.regressor(), step.states()].concat())
}

/// The lower triangle of an N x N matrix in panels of W columns. A panel begins at its first diagonal entry, and the W
/// numbers of each row are side by side.
struct Panels<const W: usize> {
    rows: Vec<[f64; W]>,
    size: usize,
}

impl<const W: usize> Panels<W> {
    /// # Panics
    /// Panics if W does not divide N.
    fn new(size: usize) -> Self {
        assert_eq!(size % W, 0, "panels of {W} columns do not fill {size}");
        let rows = (0..size).step_by(W).map(|first| size - first).sum();
        Self { rows: vec![[1.0; W]; rows], size }
    }
}

/// Computes P <- P - sum_k l_k l_k^T.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+fma", "x86_64+avx2+fma"))]
fn downdate<const W: usize>(rows: &mut [[f64; W]], size: usize, left: &[Vec<f64>; OUTPUTS]) {
    let mut rest = rows;
    for first in (0..size).step_by(W) {
        let (panel, after) = rest.split_at_mut(size - first);
        let weights: [Pack<f64, W>; OUTPUTS] = std::array::from_fn(|k| Pack::load(&left[k][first..]).scaled(-1.0));
        for (i, row) in (first..).zip(panel) {
            let mut sum = Pack(*row);
            for k in 0..OUTPUTS {
                sum = sum.add_scaled(weights[k], left[k][i]);
            }
            *row = sum.0;
        }
        rest = after;
    }
}

/// Computes x <- a x + b for every entry.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+fma", "x86_64+avx2+fma"))]
fn sweep<const W: usize>(rows: &mut [[f64; W]], a: f64, b: f64) {
    for x in rows.as_flattened_mut() {
        *x = a.mul_add(*x, b);
    }
}

/// Returns the downdate of a triangle in panels of W columns for n states, and a pass over the same triangle.
///
/// # Panics
/// Panics if W does not divide N.
pub fn in_panels<const W: usize>(n: usize, inputs: usize) -> [Part; 2] {
    let size = StepSize { n: n as f64, p: OUTPUTS as f64, m: inputs as f64, full_noise: false };
    let mut panels = Panels::<W>::new((OUTPUTS + inputs + 1) * n);
    let left: [Vec<f64>; OUTPUTS] = std::array::from_fn(|_| vec![1e-9; panels.size]);
    let entries = (panels.rows.len() * W) as f64;
    let downdate_s = time(|| {
        downdate(&mut panels.rows, panels.size, &left);
        black_box(&mut panels.rows);
    });
    let pass_s = time(|| {
        sweep(&mut panels.rows, 0.9, 0.1);
        black_box(&mut panels.rows);
    });
    let bytes = 2.0 * F64 * entries;
    [
        Part {
            what: "downdate of P in panels",
            operations: 2.0 * size.p * size.triangle(),
            bytes: bytes + F64 * size.joint() * size.p,
            seconds: downdate_s,
        },
        Part { what: "pass over the panels", operations: 2.0 * entries, bytes, seconds: pass_s },
    ]
}

#[cfg(test)]
mod tests {
    use plid_catalogue::{CovarianceName, ExpectationName};

    use super::super::cell::Cell;
    use super::*;

    /// The operations of the parts are those that the form states.
    #[test]
    fn the_parts_are_those_of_the_form() {
        let cell = Cell { inputs: 2, ..Cell::plain(12, CovarianceName::Direct, ExpectationName::JointEkf) };
        let (size, terms) = (cell.size(), cell.variant.flops(&cell.size()));
        let stated = |what: &str| terms.iter().find(|term| term.what == what).unwrap().flops;
        let parts = parts(12, 2).unwrap();
        let found = |names: &[&str]| -> f64 {
            let of = |name: &&str| parts.iter().find(|part| part.what == *name).unwrap().operations;
            names.iter().map(of).sum()
        };
        assert_eq!(found(&["gain"]), stated("gain"));
        // The form counts the computation of the two factors of the downdate, too.
        let factors = size.joint() * size.p * (size.p + 1.0);
        assert_eq!(found(&["downdate of P"]) + factors, stated("measurement update of P"));
        let mirrored = ["product with the regressor", "mirror images of that product"];
        assert_eq!(found(&mirrored), stated("phi on P_{theta theta}"));
        assert_eq!(found(&["sums of the blocks of P_theta x, twice"]), stated("phi on P_{theta x}"));
        let through = ["P_xx through Abar from both sides", "P_theta x through Abar"];
        assert_eq!(found(&through), stated("Abar on the states' rows"));
        assert!(parts.iter().all(|part| part.seconds > 0.0 && part.limit(1e9) >= part.operations / 1e9));
    }

    /// The downdate in panels is that of the kernel, to the last bit.
    #[test]
    fn panels_hold_the_triangle() {
        fn differ<const W: usize>() -> usize {
            let size = 48;
            let left: [Vec<f64>; OUTPUTS] =
                std::array::from_fn(|k| (0..size).map(|i| (i * (k + 2)) as f64 / 7.0 - 1.5).collect());
            let mut panels = Panels::<W>::new(size);
            downdate(&mut panels.rows, size, &left);
            let mut whole = Dense::from_fn(size, size, |_, _| 1.0);
            let factor = Dense::from_fn(size, OUTPUTS, |i, k| left[k][i]);
            Plain::<f64>::symmetric_product_lower(whole.view_mut(), -1.0, factor.view(), factor.view());
            let begin = |panel: usize| (0..panel).map(|before| size - before * W).sum::<usize>();
            let at = |i: usize, j: usize| panels.rows[begin(j / W) + i - j / W * W][j % W];
            let pairs = (0..size).flat_map(|j| (j..size).map(move |i| (i, j)));
            pairs.filter(|&(i, j)| at(i, j) != whole.at(i, j)).count()
        }
        assert_eq!((differ::<8>(), differ::<16>()), (0, 0));
    }
}
