use nalgebra::{DMatrix, DVector};

use super::error::{KeyProblem, ModelError};
use super::state_space::{Model, at};

/// Two sample rates count as equal if they differ by at most this fraction.
const SAME_RATE: f64 = 1e-6;

/// An algebraic loop counts as solvable if the ratio of the smallest to the largest singular value of I - D Dc
/// exceeds this.
const WELL_POSED: f64 = 1e-9;

/// The channels of a plant that its controller reads and drives.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Wiring {
    /// For each input of the controller, the output of the plant that it reads; `None` for a reference.
    pub reads: Vec<Option<usize>>,
    /// For each output of the controller, the input of the plant that it drives.
    pub drives: Vec<usize>,
}

impl Wiring {
    /// Wires a controller to a plant by the names of the channels. An input of the controller that is not an output
    /// of the plant is a reference.
    ///
    /// # Errors
    /// Returns [`ModelError::Key`] if an output of the controller is not an input of the plant, or if the controller
    /// reads no output, and [`ModelError::LoopRates`].
    pub fn new(plant: &Model, controller: &Model) -> Result<Self, ModelError> {
        let (plant_hz, controller_hz) = (plant.sample_rate_hz, controller.sample_rate_hz);
        if (controller_hz / plant_hz - 1.0).abs() > SAME_RATE {
            return Err(ModelError::LoopRates { plant_hz, controller_hz });
        }
        let find = |names: &[String], name: &String| names.iter().position(|other| other == name);
        let reads: Vec<_> = controller.inputs.iter().map(|name| find(&plant.outputs, name)).collect();
        if reads.iter().all(Option::is_none) {
            let expected = "a list with at least one output of the plant";
            return Err(at("the controller", "inputs", KeyProblem::Kind { expected }));
        }
        let drives = controller.outputs.iter().map(|name| {
            let unknown = || at("the controller", "outputs", KeyProblem::NoInput { name: name.clone() });
            find(&plant.inputs, name).ok_or_else(unknown)
        });
        Ok(Self { drives: drives.collect::<Result<_, _>>()?, reads })
    }

    /// Returns the inputs of the controller that are references, from 0.
    pub fn references(&self) -> Vec<usize> {
        (0..self.reads.len()).filter(|&j| self.reads[j].is_none()).collect()
    }
}

/// Returns the closed loop of a plant with m inputs, n states and p outputs, and a controller with k states. The
/// inputs of the loop are the signals added to each input of the plant (m, with the names of these inputs), followed
/// by the references. Its outputs are those of the plant, and its states are those of the plant, followed by those of
/// the controller (n + k). If both have feedthrough, the algebraic loop is solved.
///
/// The controller acts only at the samples, so the loop has no continuous form, and ports are not carried over.
///
/// # Errors
/// Returns the errors of [`Wiring::new`], [`ModelError::AlgebraicLoop`], and [`ModelError::Key`] if a reference has
/// the name of an input.
pub fn close_loop(plant: &Model, controller: &Model) -> Result<Model, ModelError> {
    let wiring = Wiring::new(plant, controller)?;
    let (n, k, m, p) = (plant.n(), controller.n(), plant.m(), plant.p());
    let references = wiring.references();
    // The selection from the plant's outputs and the references to the controller's inputs, and from the controller's
    // outputs to the plant's inputs.
    let reading = |j: usize, o: usize| wiring.reads[j] == Some(o);
    let driving = |i: usize, l: usize| wiring.drives[l] == i;
    let from_outputs = DMatrix::from_fn(controller.m(), p, |j, o| f64::from(reading(j, o)));
    let from_references = DMatrix::from_fn(controller.m(), references.len(), |j, r| f64::from(references[r] == j));
    let to_inputs = DMatrix::from_fn(m, controller.p(), |i, l| f64::from(driving(i, l)));
    let (seen, driven) = (&to_inputs * &controller.c, &to_inputs * &controller.d);
    let feedthrough = &driven * &from_outputs;

    let solved = solved(&plant.d, &feedthrough)?;
    // y = of_states (x; xc) + of_inputs (v; r).
    let of_states = &solved * side_by_side(&plant.c, &(&plant.d * &seen));
    let of_inputs = &solved * side_by_side(&plant.d, &(&plant.d * &driven * &from_references));
    // The plant's inputs in the same form.
    let command_of_states = side_by_side(&DMatrix::zeros(m, n), &seen) + &feedthrough * &of_states;
    let command_of_inputs =
        side_by_side(&DMatrix::identity(m, m), &(&driven * &from_references)) + &feedthrough * &of_inputs;

    let read = &controller.b * &from_outputs;
    let (mut a, mut b) = (DMatrix::zeros(n + k, n + k), DMatrix::zeros(n + k, m + references.len()));
    a.rows_mut(0, n).copy_from(&(side_by_side(&plant.a, &DMatrix::zeros(n, k)) + &plant.b * &command_of_states));
    a.rows_mut(n, k).copy_from(&(side_by_side(&DMatrix::zeros(k, n), &controller.a) + &read * &of_states));
    b.rows_mut(0, n).copy_from(&(&plant.b * &command_of_inputs));
    let referred = side_by_side(&DMatrix::zeros(k, m), &(&controller.b * &from_references));
    b.rows_mut(n, k).copy_from(&(referred + &read * &of_inputs));

    let mut closed = Model::new(plant.sample_rate_hz, a, b, of_states, of_inputs)?;
    closed.inputs = plant.inputs.iter().chain(references.iter().map(|&j| &controller.inputs[j])).cloned().collect();
    closed.outputs.clone_from(&plant.outputs);
    closed.output_kinds.clone_from(&plant.output_kinds);
    closed.initial_state = started(plant, controller);
    closed.check("the closed loop")?;
    Ok(closed)
}

/// Returns (I - D Dc)^-1 (p x p), which solves the algebraic loop for the outputs.
fn solved(d: &DMatrix<f64>, feedthrough: &DMatrix<f64>) -> Result<DMatrix<f64>, ModelError> {
    let p = d.nrows();
    let matrix = DMatrix::identity(p, p) - d * feedthrough;
    let sizes = matrix.singular_values();
    let ratio = sizes.min() / sizes.max();
    // The comparison also rejects NaN.
    let inverse = if ratio > WELL_POSED { matrix.try_inverse() } else { None };
    inverse.ok_or(ModelError::AlgebraicLoop { ratio })
}

fn side_by_side(left: &DMatrix<f64>, right: &DMatrix<f64>) -> DMatrix<f64> {
    let mut both = DMatrix::zeros(left.nrows(), left.ncols() + right.ncols());
    both.columns_mut(0, left.ncols()).copy_from(left);
    both.columns_mut(left.ncols(), right.ncols()).copy_from(right);
    both
}

fn started(plant: &Model, controller: &Model) -> Option<DVector<f64>> {
    if plant.initial_state.is_none() && controller.initial_state.is_none() {
        return None;
    }
    let of = |model: &Model| model.initial_state.clone().unwrap_or_else(|| model.rest());
    let (x, xc) = (of(plant), of(controller));
    Some(DVector::from_iterator(x.len() + xc.len(), x.iter().chain(&xc).copied()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulate;
    use crate::testing::{canonical, random, record};
    use nalgebra::dmatrix;

    /// Returns a plant with two inputs, two outputs and some feedthrough, and a controller with small gains from y2,
    /// a reference and y1 to u2 and u1.
    fn pair(seed: u64) -> (Model, Model) {
        let mut plant = canonical(seed, &[2, 1], 2);
        plant.d = random(seed + 5, 2, 2) * 0.3;
        let (a, b) = (dmatrix![0.7, 0.1; 0.0, 0.5], random(seed + 1, 2, 3) * 0.3);
        let mut controller = Model::new(100.0, a, b, random(seed + 2, 2, 2), random(seed + 3, 2, 3) * 0.3).unwrap();
        controller.inputs = ["y2", "r", "y1"].map(String::from).to_vec();
        controller.outputs = ["u2", "u1"].map(String::from).to_vec();
        (plant, controller)
    }

    /// Simulates the two systems sample by sample, and solves the algebraic loop by a fixed-point iteration.
    fn by_hand(plant: &Model, controller: &Model, v: &[[f64; 3]]) -> Vec<[f64; 2]> {
        let (mut x, mut xc) = (plant.rest(), controller.rest());
        let mut seen = Vec::new();
        for &[v1, v2, r] in v {
            let (mut y, mut u) = (DVector::zeros(2), DVector::zeros(2));
            for _ in 0..400 {
                let k = &controller.c * &xc + &controller.d * DVector::from_vec(vec![y[1], r, y[0]]);
                u = DVector::from_vec(vec![v1 + k[1], v2 + k[0]]);
                y = &plant.c * &x + &plant.d * &u;
            }
            seen.push([y[0], y[1]]);
            x = &plant.a * x + &plant.b * u;
            xc = &controller.a * xc + &controller.b * DVector::from_vec(vec![y[1], r, y[0]]);
        }
        seen
    }

    #[test]
    fn a_closed_loop_is_its_two_systems_sample_by_sample() {
        for seed in 0..5 {
            let (plant, controller) = pair(seed);
            let closed = close_loop(&plant, &controller).unwrap();
            assert_eq!(closed.inputs, ["u1", "u2", "r"]);
            let inputs = record(seed + 9, 80, 3);
            let rows: Vec<[f64; 3]> = inputs.outer_iter().map(|row| [row[0], row[1], row[2]]).collect();
            let found = simulate(&closed, inputs.view(), &closed.rest()).unwrap().outputs;
            let expected = by_hand(&plant, &controller, &rows);
            let far = (0..80).flat_map(|k| (0..2).map(move |o| (k, o)));
            let far = far.map(|(k, o)| (found[(k, o)] - expected[k][o]).abs()).fold(0.0, f64::max);
            assert!(far < 1e-10, "seed {seed}: {far}");
        }
    }

    #[test]
    fn an_unstable_plant_is_stabilised() {
        let plant = Model::new(1.0, dmatrix![1.2], dmatrix![1.0], dmatrix![1.0], dmatrix![0.0]).unwrap();
        let mut gain = Model::new(1.0, dmatrix![0.0], dmatrix![0.0], dmatrix![0.0], dmatrix![-0.5]).unwrap();
        (gain.inputs, gain.outputs) = (vec!["y1".into()], vec!["u1".into()]);
        let closed = close_loop(&plant, &gain).unwrap();
        assert!((crate::stability(&closed).unwrap().spectral_radius - 0.7).abs() < 1e-12);
    }

    #[test]
    fn what_makes_no_loop_is_refused() {
        let (plant, sound) = pair(1);
        let says = |plant: &Model, controller: &Model| close_loop(plant, controller).unwrap_err().to_string();
        let mut other = sound.clone();
        other.sample_rate_hz = 50.0;
        assert!(says(&plant, &other).contains("50 Hz"), "{}", says(&plant, &other));
        let mut other = sound.clone();
        other.outputs[1] = "u7".into();
        assert!(says(&plant, &other).contains("`u7`, which is not an input of the plant"), "{}", says(&plant, &other));
        let mut other = sound.clone();
        other.inputs = ["a", "b", "c"].map(String::from).to_vec();
        assert!(says(&plant, &other).contains("at least one output of the plant"), "{}", says(&plant, &other));
        // y = u and u = y + ... has no solution.
        let straight =
            |c: f64, d: f64| Model::new(1.0, dmatrix![0.5], dmatrix![1.0], dmatrix![c], dmatrix![d]).unwrap();
        let mut gain = straight(0.0, 1.0);
        (gain.inputs, gain.outputs) = (vec!["y1".into()], vec!["u1".into()]);
        let error = close_loop(&straight(1.0, 1.0), &gain).unwrap_err();
        assert!(matches!(error, ModelError::AlgebraicLoop { .. }), "{error}");
    }
}
