//! The parts of the search, on problems with known answers.

use std::convert::Infallible;

use nalgebra::{DMatrix, DVector, dvector};
use plid_lsq::{Damping, Ended, Equations, Normal, Problem, Stop, minimise};

/// Rosenbrock's valley: residuals 1 - x and 10 (y - x^2), with the minimum at (1, 1); NaN left of `wall`.
#[derive(Clone)]
struct Valley {
    wall: f64,
    /// Linearisations before an error.
    patience: usize,
    accepted: usize,
    /// Steps after which the search may not go on.
    bound: usize,
}

const VALLEY: Valley = Valley { wall: f64::NEG_INFINITY, patience: usize::MAX, accepted: 0, bound: usize::MAX };

impl Problem for Valley {
    type Point = [f64; 2];
    type Equations = Normal;
    type Error = &'static str;

    fn equations(&self) -> Normal {
        Normal::new(2)
    }

    fn linearise(&mut self, &[x, y]: &[f64; 2], normal: &mut Normal) -> Result<(), &'static str> {
        self.patience = self.patience.checked_sub(1).ok_or("out of patience")?;
        normal.clear();
        // The derivatives of the model are those of the residuals with the other sign.
        let jacobian = nalgebra::Matrix2::new(1.0, 0.0, 20.0 * x, -10.0);
        let residual = nalgebra::Vector2::new(1.0 - x, 10.0 * (y - x * x));
        normal.matrix.gemm_tr(1.0, &jacobian, &jacobian, 1.0);
        normal.right.gemv_tr(1.0, &jacobian, &residual, 1.0);
        Ok(())
    }

    fn advance(&self, from: &[f64; 2], step: &DVector<f64>, to: &mut [f64; 2]) {
        *to = [from[0] + step[0], from[1] + step[1]];
    }

    fn cost(&self, &[x, y]: &[f64; 2]) -> f64 {
        if x < self.wall { f64::NAN } else { (1.0 - x).powi(2) + 100.0 * (y - x * x).powi(2) }
    }

    fn may_go_on(&self, _at: &[f64; 2]) -> bool {
        self.accepted < self.bound
    }

    fn accepted(&mut self, _at: &mut [f64; 2]) {
        self.accepted += 1;
    }
}

const START: [f64; 2] = [-1.2, 1.0];

#[test]
fn a_search_says_why_it_ended() {
    let run = |stop: Stop| minimise(&mut VALLEY.clone(), START, Damping::default(), stop).unwrap();
    let stalled = run(Stop::default());
    assert_eq!(stalled.ended, Ended::Stalled);
    assert!(stalled.ended.converged() && (stalled.point[0] - 1.0).abs() < 1e-7, "{:?}", stalled.point);
    let early = run(Stop { steps: 3, ..Stop::default() });
    assert_eq!((early.ended, early.steps), (Ended::Steps, 3));
    assert!(!early.ended.converged());
    // The first steps are small, because the damping starts high.
    let [impatient, patient] = [1, 4].map(|patience| run(Stop { gain: 0.5, patience, ..Stop::default() }));
    assert_eq!((impatient.ended, patient.ended), (Ended::Gain, Ended::Gain));
    assert!(patient.steps > impatient.steps && patient.cost < impatient.cost);
    let nothing = run(Stop { steps: 0, ..Stop::default() });
    assert_eq!((nothing.point, nothing.cost, nothing.ended), (START, VALLEY.cost(&START), Ended::Steps));
}

/// A search that its problem stops has the point at which it was, and no further linearisation.
#[test]
fn a_problem_may_stop_the_search() {
    let whole = minimise(&mut VALLEY.clone(), START, Damping::default(), Stop { steps: 3, ..Stop::default() }).unwrap();
    let mut problem = Valley { bound: 3, patience: 3, ..VALLEY };
    let found = minimise(&mut problem, START, Damping::default(), Stop::default()).unwrap();
    assert_eq!((found.ended, found.steps, found.point), (Ended::Stopped, 3, whole.point));
    assert!(!found.ended.converged() && found.cost < VALLEY.cost(&START));
    let mut problem = Valley { bound: 0, patience: 0, ..VALLEY };
    let nothing = minimise(&mut problem, START, Damping::default(), Stop::default()).unwrap();
    assert_eq!((nothing.ended, nothing.steps, nothing.point), (Ended::Stopped, 0, START));
}

#[test]
fn an_error_of_the_problem_ends_the_search() {
    let mut problem = Valley { patience: 2, ..VALLEY };
    let error = minimise(&mut problem, START, Damping::default(), Stop::default()).map(|found| found.steps);
    assert_eq!(error, Err("out of patience"));
}

/// Every accepted point is announced, and the one that is inadmissible is not.
#[test]
fn inadmissible_points_are_rejected() {
    let mut problem = Valley { wall: 1.5, ..VALLEY };
    let found = minimise(&mut problem, [3.0, 2.0], Damping::default(), Stop::default()).unwrap();
    assert!(found.point[0] >= 1.5 && found.point[0] < 1.6, "{:?}", found.point);
    assert!(problem.accepted > 3);
}

#[test]
fn the_best_of_several_dampings_is_taken() {
    let one = Damping { start: 1.0, shrink: 1.0, grow: 10.0, factors: &[1.0], ..Damping::default() };
    let several = Damping { factors: &[0.01, 1.0, 100.0], ..one };
    let stop = Stop { steps: 1, ..Stop::default() };
    let first = |damping: Damping| minimise(&mut VALLEY.clone(), START, damping, stop).unwrap().cost;
    let single = [0.01, 1.0, 100.0].map(|start| first(Damping { start, tries: 1, ..one }));
    let best = single.into_iter().fold(f64::INFINITY, f64::min);
    assert_eq!(first(several), best, "{single:?}");
    let end = minimise(&mut VALLEY.clone(), START, several, Stop::default()).unwrap();
    assert!((end.point[1] - 1.0).abs() < 1e-7, "{:?}", end.point);
}

/// A straight line y = a + b t with prior knowledge of its slope.
struct Line {
    block: usize,
}

const ROWS: usize = 40;

impl Line {
    fn data() -> (DMatrix<f64>, DVector<f64>) {
        let jacobian = DMatrix::from_fn(ROWS, 2, |row, k| if k == 0 { 1.0 } else { row as f64 / 10.0 });
        let y = DVector::from_fn(ROWS, |row, _| 2.0 + 0.5 * (row as f64 / 10.0) + (row as f64).sin());
        (jacobian, y)
    }
}

impl Problem for Line {
    type Point = DVector<f64>;
    type Equations = Normal;
    type Error = Infallible;

    fn equations(&self) -> Normal {
        Normal::without_memory(2)
    }

    fn linearise(&mut self, at: &DVector<f64>, normal: &mut Normal) -> Result<(), Infallible> {
        let (jacobian, y) = Self::data();
        let residual = y - &jacobian * at;
        normal.clear();
        for from in (0..ROWS).step_by(self.block) {
            let height = self.block.min(ROWS - from);
            normal.add(jacobian.rows(from, height), residual.rows(from, height));
        }
        normal.add_prior(1, at[1] - 1.0, 0.01);
        Ok(())
    }

    fn advance(&self, from: &DVector<f64>, step: &DVector<f64>, to: &mut DVector<f64>) {
        *to = from + step;
    }

    fn cost(&self, at: &DVector<f64>) -> f64 {
        let (jacobian, y) = Self::data();
        (y - jacobian * at).norm_squared() + (at[1] - 1.0).powi(2) / 0.01
    }
}

/// The posterior mean and covariance of a linear problem, as a textbook has them: (J'J + P^-1)^-1, whatever the blocks.
#[test]
fn a_prior_counts_as_data_and_blocks_do_not_matter() {
    let (jacobian, y) = Line::data();
    let precision = DMatrix::from_diagonal(&dvector![0.0, 100.0]);
    let covariance = (jacobian.tr_mul(&jacobian) + &precision).try_inverse().unwrap();
    let mean = &covariance * (jacobian.tr_mul(&y) + precision * dvector![0.0, 1.0]);
    for block in [1, 7, ROWS] {
        let found = minimise(&mut Line { block }, DVector::zeros(2), Damping::default(), Stop::default()).unwrap();
        assert!((found.point - &mean).norm() < 1e-9);
        assert!((found.equations.covariance().unwrap() - &covariance).norm() < 1e-12);
    }
}

/// A parameter that influences nothing keeps its value, and has no finite variance.
#[test]
fn a_parameter_without_influence_stays() {
    let mut normal = Normal::new(2);
    normal.add(DMatrix::from_row_slice(1, 2, &[2.0, 0.0]).as_view(), dvector![6.0].as_view());
    let mut step = DVector::zeros(2);
    assert!(normal.solve(0.0, &mut DMatrix::default(), &mut step));
    assert_eq!(step, dvector![3.0, 0.0]);
    assert_eq!(normal.covariance(), None);
}

#[test]
fn nothing_is_allocated_in_a_step() {
    let allocated = |steps: usize| {
        let run =
            || minimise(&mut VALLEY.clone(), START, Damping::default(), Stop { steps, ..Stop::default() }).unwrap();
        let mut found = None;
        let count = allocation_counter::measure(|| found = Some(run())).count_total;
        (count, found.unwrap().steps)
    };
    let [(few, first), (many, last)] = [5, 25].map(allocated);
    assert_eq!((few, first, last), (many, 5, 25));
}
