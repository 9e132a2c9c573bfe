//! The nonlinear regression problems of NIST's Statistical Reference Datasets, with their certified answers.
//!
//! The data files are in the public domain; they are unchanged copies of those at
//! <https://www.itl.nist.gov/div898/strd/nls/nls_main.shtml>, as distributed with the source of lmfit 1.3.4. The
//! certified values were computed by NIST in quadruple precision and have eleven significant digits.

mod data;
mod dual;
mod models;

use std::convert::Infallible;

use data::Certified;
use dual::Dual;
use models::{MODELS, Model};
use nalgebra::{DMatrix, DVector};
use plid_lsq::{Damping, Ended, Normal, Problem, Stop, minimise};

/// A problem of the collection.
struct Regression {
    model: Model,
    certified: Certified,
    equations: fn(usize) -> Normal,
}

#[derive(Clone)]
struct Point {
    b: Vec<f64>,
    residual: DVector<f64>,
}

impl Regression {
    fn new(name: &str, model: Model) -> Self {
        Self { model, certified: Certified::read(name), equations: Normal::new }
    }

    /// The model at one observation.
    fn predicted(&self, b: &[f64], row: usize) -> Dual {
        let b: Vec<Dual> = b.iter().enumerate().map(|(k, &b)| Dual::parameter(b, k)).collect();
        (self.model)(&b, &self.certified.x[row])
    }

    fn at(&self, b: &[f64]) -> Point {
        let of_row = |row: usize| self.certified.y[row] - self.predicted(b, row).value;
        Point { b: b.to_vec(), residual: DVector::from_fn(self.certified.y.len(), |row, _| of_row(row)) }
    }

    /// The standard deviations of the parameters at a point, as NIST defines them.
    fn standard_deviations(&mut self, at: &Point) -> Vec<f64> {
        let mut normal = self.equations();
        let Ok(()) = self.linearise(at, &mut normal);
        let variance = self.cost(at) / (at.residual.len() - at.b.len()) as f64;
        normal.covariance().unwrap().diagonal().iter().map(|v| (v * variance).sqrt()).collect()
    }
}

impl Problem for Regression {
    type Point = Point;
    type Equations = Normal;
    type Error = Infallible;

    fn equations(&self) -> Normal {
        (self.equations)(self.certified.parameters.len())
    }

    fn linearise(&mut self, at: &Point, normal: &mut Normal) -> Result<(), Infallible> {
        let slopes: Vec<_> = (0..at.residual.len()).map(|row| self.predicted(&at.b, row).slope).collect();
        let jacobian = DMatrix::from_fn(slopes.len(), at.b.len(), |row, k| slopes[row][k]);
        normal.clear();
        normal.add(jacobian.as_view(), at.residual.as_view());
        Ok(())
    }

    fn advance(&self, from: &Point, step: &DVector<f64>, to: &mut Point) {
        let b: Vec<f64> = from.b.iter().zip(step.iter()).map(|(b, step)| b + step).collect();
        *to = self.at(&b);
    }

    fn cost(&self, at: &Point) -> f64 {
        at.residual.norm_squared()
    }
}

/// Significant digits in common, of the entry that has the fewest.
fn digits(found: &[f64], certified: &[f64]) -> f64 {
    let of = |(f, c): (&f64, &f64)| -((f - c) / c).abs().max(1e-11).log10();
    found.iter().zip(certified).map(of).fold(f64::INFINITY, f64::min)
}

/// The data and the models are NIST's: at the certified parameters they give the certified sum of squares. Of Lanczos1
/// the sum is 1.4e-25, less than what eleven digits of the parameters determine.
#[test]
fn certified_parameters_give_the_certified_sum_of_squares() {
    for (name, model) in MODELS.into_iter().filter(|(name, _)| *name != "Lanczos1") {
        let problem = Regression::new(name, model);
        let sum = problem.cost(&problem.at(&problem.certified.parameters));
        let found = digits(&[sum], &[problem.certified.sum_of_squares]);
        assert!(found > 9.9, "{name}: {found:.1} digits");
    }
}

/// From both starting points, to seven digits of the parameters and six of the standard deviations. The residuals of
/// Lanczos1 are the rounding of its fourteen-digit data, so that double precision leaves their variance, and with it
/// the standard deviations, three digits.
#[test]
fn certified_values_are_found_from_both_starts() {
    let mut all = true;
    for (name, model) in MODELS {
        let mut problem = Regression::new(name, model);
        for start in 0..2 {
            let point = problem.at(&problem.certified.starts[start]);
            let Ok(found) = minimise(&mut problem, point, Damping::default(), Stop::default());
            let std = problem.standard_deviations(&found.point);
            let parameters = digits(&found.point.b, &problem.certified.parameters);
            let std = digits(&std, &problem.certified.std);
            println!("{name:9} start {} {:5} steps: {parameters:4.1} digits, std {std:4.1}", start + 1, found.steps);
            all &= found.ended == Ended::Stalled && parameters > 7.0;
            all &= std > if name == "Lanczos1" { 2.5 } else { 6.0 };
        }
    }
    assert!(all, "see the table above");
}

/// From the first starting point of MGH17, a long step in a rate leads to a plateau where the model no longer depends
/// on it. Without a memory the damping of that rate vanishes there.
#[test]
fn a_scale_without_memory_ends_on_a_plateau() {
    let (name, model) = *MODELS.iter().find(|(name, _)| *name == "MGH17").unwrap();
    let end = |equations: fn(usize) -> Normal| {
        let mut problem = Regression { equations, ..Regression::new(name, model) };
        let point = problem.at(&problem.certified.starts[0]);
        let Ok(found) = minimise(&mut problem, point, Damping::default(), Stop::default());
        found.cost / problem.certified.sum_of_squares
    };
    let (with, without) = (end(Normal::new), end(Normal::without_memory));
    assert!(with < 1.0 + 1e-9 && without > 2.0, "{with} {without}");
}
