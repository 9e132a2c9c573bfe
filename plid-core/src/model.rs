//! The implicit model s_{k+1} = F s_k + G eta_k, z_k = H s_k + w_k. Its matrices F, G and H are never formed.

use serde::{Deserialize, Serialize};

use crate::Scalar;

/// The structure of F, G and H.
///
/// The plant is x+ = A x + B u with A = J + sum_i a_i e_{c_i}^T. J is known and has at most a single one per row, the
/// p columns a_i and the m columns b_j of B are unknown, and output i reads state c_i. The joint state is
/// s = [x; a_1 .. a_p; b_1 .. b_m], with N = (p + m + 1) n entries.
pub trait ImplicitModel: Send + Sync {
    /// Returns the number of plant states n.
    fn states(&self) -> usize;

    /// Returns the number of inputs m.
    fn inputs(&self) -> usize;

    /// Returns the states c_i that the p outputs read, from 0.
    fn output_states(&self) -> &[usize];

    /// Returns the column in which row `i` of J has its one, if it has any. The column is less than `i`, so that J x
    /// can be formed in place.
    fn shift_source(&self, i: usize) -> Option<usize>;

    /// Returns the number of outputs p.
    fn outputs(&self) -> usize {
        self.output_states().len()
    }

    /// Returns the number of unknown columns, p + m.
    fn parameter_columns(&self) -> usize {
        self.outputs() + self.inputs()
    }

    /// Returns the number of entries of the joint state, N = (p + m + 1) n.
    fn joint_states(&self) -> usize {
        (self.parameter_columns() + 1) * self.states()
    }

    /// Computes x <- J x.
    #[inline]
    fn shift<S: Scalar>(&self, x: &mut [S])
    where
        Self: Sized,
    {
        for i in (0..self.states()).rev() {
            x[i] = self.shift_source(i).map_or(S::zero(), |from| x[from]);
        }
    }
}

/// The MIMO observable canonical form (Eq. 1): J consists of p lower-shift blocks of sizes n_1 .. n_p, and output i
/// reads the last state of block i.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ObservableForm {
    indices: Vec<usize>,
    inputs: usize,
    output_states: Vec<usize>,
    block_starts: Vec<bool>,
}

/// The reasons why a structure is rejected.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum StructureError {
    /// There is no output.
    #[error("at least one output is needed")]
    NoOutput,
    /// There is no input.
    #[error("at least one input is needed")]
    NoInput,
    /// An observability index is zero.
    #[error("observability index {0} (counted from 1) is 0: every output needs at least one state")]
    ZeroIndex(usize),
    /// n exceeds [`ObservableForm::MAX_STATES`].
    #[error("{0} states asked for; at most {max} are supported", max = ObservableForm::MAX_STATES)]
    TooManyStates(usize),
    /// n is less than p.
    #[error("{states} states are too few for {outputs} outputs: each needs at least one")]
    TooFewStates {
        /// n
        states: usize,
        /// p
        outputs: usize,
    },
}

impl ObservableForm {
    /// The largest number of states n.
    pub const MAX_STATES: usize = 128;

    /// Returns the form with observability indices n_1 .. n_p and `inputs` inputs.
    ///
    /// # Errors
    /// Returns a [`StructureError`] for an invalid structure.
    pub fn new(indices: &[usize], inputs: usize) -> Result<Self, StructureError> {
        if indices.is_empty() {
            return Err(StructureError::NoOutput);
        }
        if inputs == 0 {
            return Err(StructureError::NoInput);
        }
        if let Some(i) = indices.iter().position(|&n| n == 0) {
            return Err(StructureError::ZeroIndex(i + 1));
        }
        let states = indices.iter().copied().fold(0, usize::saturating_add);
        if states > Self::MAX_STATES {
            return Err(StructureError::TooManyStates(states));
        }
        let mut block_starts = vec![false; states];
        let mut output_states = Vec::with_capacity(indices.len());
        let mut start = 0;
        for &n in indices {
            block_starts[start] = true;
            start += n;
            output_states.push(start - 1);
        }
        Ok(Self { indices: indices.to_vec(), inputs, output_states, block_starts })
    }

    /// Returns the form whose `states` are distributed over the outputs as evenly as possible. If they do not divide
    /// evenly, the first outputs have one more each.
    ///
    /// # Errors
    /// Returns a [`StructureError`] for an invalid structure.
    pub fn balanced(states: usize, outputs: usize, inputs: usize) -> Result<Self, StructureError> {
        if outputs == 0 {
            return Err(StructureError::NoOutput);
        }
        if states < outputs {
            return Err(StructureError::TooFewStates { states, outputs });
        }
        let indices: Vec<usize> = (0..outputs).map(|i| states / outputs + usize::from(i < states % outputs)).collect();
        Self::new(&indices, inputs)
    }

    /// Returns the observability indices n_1 .. n_p.
    pub fn indices(&self) -> &[usize] {
        &self.indices
    }

    /// Returns whether entry `row` of the column a_i of `output` i can take any value without a change of the plant's
    /// input-output behaviour.
    ///
    /// Block j of the form is the equation q^{n_j} y_j = sum_i (sum_l a_i\[j, l\] q^{l-1}) y_i + ..; if n_j > n_i,
    /// equation i times any q^d with n_i + d < n_j may be added to it. If the redundant entries are fixed at zero,
    /// the form is unique (Guidorzi 1975). Redundant entries exist only if the indices differ.
    pub fn is_redundant(&self, row: usize, output: usize) -> bool {
        let (mut block, mut power) = (0, row);
        while power >= self.indices[block] {
            power -= self.indices[block];
            block += 1;
        }
        block != output && power >= self.indices[output]
    }
}

impl ImplicitModel for ObservableForm {
    fn states(&self) -> usize {
        self.block_starts.len()
    }

    fn inputs(&self) -> usize {
        self.inputs
    }

    fn output_states(&self) -> &[usize] {
        &self.output_states
    }

    #[inline]
    fn shift_source(&self, i: usize) -> Option<usize> {
        (!self.block_starts[i]).then(|| i - 1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unequal_indices_shift_within_their_blocks() {
        let form = ObservableForm::new(&[1, 3, 2], 2).unwrap();
        assert_eq!(form.output_states(), [0, 3, 5]);
        assert_eq!(form.joint_states(), 6 * 6);
        let mut x = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0];
        form.shift(&mut x);
        assert_eq!(x, [0.0, 0.0, 2.0, 3.0, 0.0, 5.0]);
    }

    #[test]
    fn balanced_gives_the_remainder_to_the_first() {
        assert_eq!(ObservableForm::balanced(11, 3, 1).unwrap().indices(), [4, 4, 3]);
        assert_eq!(ObservableForm::balanced(2, 3, 1), Err(StructureError::TooFewStates { states: 2, outputs: 3 }));
    }

    #[test]
    fn only_unequal_indices_leave_entries_open() {
        let form = ObservableForm::new(&[3, 1], 1).unwrap();
        // Equation 2, of order one, times 1 or q may be added to equation 1, so the entries of a_2 in equation 1 are
        // redundant from the power q on.
        let open: Vec<(usize, usize)> =
            (0..2).flat_map(|i| (0..4).map(move |r| (r, i))).filter(|&(r, i)| form.is_redundant(r, i)).collect();
        assert_eq!(open, [(1, 1), (2, 1)]);
        let equal = ObservableForm::new(&[3, 3], 1).unwrap();
        assert!((0..2).all(|i| (0..6).all(|r| !equal.is_redundant(r, i))));
    }

    #[test]
    fn impossible_structures_are_refused() {
        assert_eq!(ObservableForm::new(&[], 1), Err(StructureError::NoOutput));
        assert_eq!(ObservableForm::new(&[2], 0), Err(StructureError::NoInput));
        assert_eq!(ObservableForm::new(&[2, 0], 1), Err(StructureError::ZeroIndex(2)));
        assert_eq!(ObservableForm::new(&[129], 1), Err(StructureError::TooManyStates(129)));
        assert_eq!(ObservableForm::new(&[usize::MAX, 3], 1), Err(StructureError::TooManyStates(usize::MAX)));
    }
}
