//! A structure with accelerometers, one of which is at a location where no input acts.

use nalgebra::{DMatrix, dmatrix};
use plid_model::{Model, OutputKind};

use crate::case::record::{Channels, rms};
use crate::judge::verdict::Verdict;
use crate::testing::{self, diagnosed, first_is, held, random_input};

const RATE: f64 = 500.0;

/// Two masses in a row, each on a spring, with the stiffness matrix K and the damping matrix DAMPING K.
const MASSES: [f64; 2] = [1.0, 2.0];
const K: [[f64; 2]; 2] = [[9000.0, -4000.0], [-4000.0, 4000.0]];
const DAMPING: f64 = 5e-4;

/// Number of Runge-Kutta steps per sample, and number of samples over which an input is held.
const STEPS: usize = 8;
const HOLD: usize = 8;

/// Returns the time derivatives of both displacements and both velocities, with one force on each mass.
fn rate(x: [f64; 4], forces: [f64; 2]) -> [f64; 4] {
    let acceleration = |i: usize| {
        let elastic: f64 = (0..2).map(|j| K[i][j] * (x[j] + DAMPING * x[2 + j])).sum();
        (forces[i] - elastic) / MASSES[i]
    };
    [x[2], x[3], acceleration(0), acceleration(1)]
}

/// Returns a model with accelerometers on both masses and a force on the first one, which acts too early by `early_s`.
/// A further spring of stiffness `k` holds the second mass.
pub fn model(k: f64, early_s: f64) -> Model {
    let unit = |j: usize| std::array::from_fn(|i| if i == j { 1.0 } else { 0.0 });
    let a = DMatrix::from_fn(4, 4, |i, j| {
        let x: [f64; 4] = unit(j);
        rate(x, [0.0, -k * x[1]])[i]
    });
    let b = plid_model::exponential(&(&a * early_s)) * dmatrix![0.0; 0.0; 1.0 / MASSES[0]; 0.0];
    let (held_a, held_b) = held(&a, &b, 1.0 / RATE);
    let direct = dmatrix![1.0 / MASSES[0]; 0.0];
    let mut model = Model::new(RATE, held_a, held_b, a.rows(2, 2).into_owned(), direct).unwrap();
    model.output_kinds = vec![Some(OutputKind::Acceleration); 2];
    model
}

/// Returns the accelerations of both masses under a force on the first one, with a cubic spring on the second one, and
/// the RMS of the second displacement.
fn measured(u: &[f64], k: f64) -> (Channels, f64) {
    let h = 1.0 / (RATE * STEPS as f64);
    let (mut x, mut y, mut displacements) = ([0.0; 4], vec![Vec::new(); 2], Vec::new());
    for &u in u {
        let rate = |x: [f64; 4]| rate(x, [u, -k * x[1].powi(3)]);
        let now = rate(x);
        y.iter_mut().zip(&now[2..]).for_each(|(y, a)| y.push(*a));
        displacements.push(x[1]);
        for _ in 0..STEPS {
            let after = |by: [f64; 4], h: f64| std::array::from_fn(|i| x[i] + h * by[i]);
            let k1 = rate(x);
            let k2 = rate(after(k1, h / 2.0));
            let k3 = rate(after(k2, h / 2.0));
            let k4 = rate(after(k3, h));
            x = std::array::from_fn(|i| x[i] + h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]));
        }
    }
    (y, rms(&displacements))
}

/// A cubic spring on the second mass is named there, although the simulation declares no port and no input acts there.
#[test]
fn a_spring_at_an_accelerometer_is_named_there() {
    let input = |k: usize| {
        let drawn = &random_input(40 + k as u64, 1600, 1)[0];
        vec![(0..1600).map(|n| drawn[n / HOLD]).collect::<Vec<f64>>()]
    };
    let (y, d) = measured(&input(1)[0], 0.0);
    let std: Vec<f64> = y.iter().map(|y| 0.005 * rms(y)).collect();
    let strength = 0.05 * K[1][1] / d.powi(2);
    let measure = |k: usize, u: &Channels| {
        let (mut y, _) = measured(&u[0], strength);
        testing::add_noise(&mut y, 60 + k as u64, &std);
        y
    };
    let case = testing::four_records(&model(0.0, 0.0), &std, [1.0, 0.4, 1.0], input, measure);
    let found = diagnosed(&case);
    assert_eq!(found.verdict, Verdict::Effects, "{}", found.sentence);
    let spring = first_is(&found, "cubic-stiffness", "port:y2");
    assert!(found.gap.as_given > 0.1 && found.gap.shrink > 0.9, "{}: {:?}", found.sentence, found.gap);
    // Reciprocity also gives the stiffness of the spring.
    let k = spring.parameters["k"].value;
    assert!((k / strength - 1.0).abs() < 0.02, "{k} for {strength}");
}
