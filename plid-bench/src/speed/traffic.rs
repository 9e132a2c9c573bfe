//! The number of bytes that a step must read or write, derived from the algorithm.

use super::cell::{Cell, OUTPUTS, scalar_bytes};

/// Returns the number of bytes that a step must read or write, whatever the order of its operations, if only the sums
/// of the last step stay in registers:
///
/// - P, or its factor, one triangle with its diagonal: read once and written once, 2 N (N + 1) / 2;
/// - the estimate s: read once and written once, 2 N;
/// - the gain, N x p: written by the measurement update and then read, 2 N p.
///
/// Arrays of size n x n (Qbar, the array of a factorisation) stay in the nearest cache and are not counted.
pub fn bytes(cell: &Cell) -> f64 {
    let joint = cell.joint_states();
    let entries = joint * (joint + 1) + 2 * joint + 2 * joint * OUTPUTS;
    (entries * scalar_bytes(cell.variant.scalar)) as f64
}

#[cfg(test)]
mod tests {
    use plid_catalogue::{CovarianceName, ExpectationName, ScalarName};

    use super::*;

    #[test]
    fn a_triangle_is_read_and_written() {
        let mut cell = Cell::plain(64, CovarianceName::Direct, ExpectationName::Prior);
        assert_eq!(bytes(&cell), 8.0 * (448.0 * 449.0 + 8.0 * 448.0));
        cell.variant.scalar = ScalarName::F32;
        assert_eq!(bytes(&cell), 4.0 * (448.0 * 449.0 + 8.0 * 448.0));
    }
}
