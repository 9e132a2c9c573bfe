//! The known part J of A, laid out for kernels.

use crate::{ImplicitModel, Scalar};

/// J, which has at most a single one per row: the column of this one for each row, and the rows as runs that move
/// together.
#[derive(Clone, Debug)]
pub struct Shift {
    sources: Vec<Option<usize>>,
    /// The first row read, the first row written and the length of each run. The last rows come first.
    runs: Vec<(usize, usize, usize)>,
    empty: Vec<usize>,
}

impl Shift {
    /// Creates the layout of a model's J.
    pub fn new(model: &dyn ImplicitModel) -> Self {
        let sources: Vec<_> = (0..model.states()).map(|i| model.shift_source(i)).collect();
        let mut runs: Vec<(usize, usize, usize)> = Vec::new();
        let mut empty = Vec::new();
        for (to, source) in sources.iter().enumerate().rev() {
            match *source {
                None => empty.push(to),
                Some(from) => match runs.last_mut() {
                    Some(run) if run.0 == from + 1 && run.1 == to + 1 => *run = (from, to, run.2 + 1),
                    _ => runs.push((from, to, 1)),
                },
            }
        }
        Self { sources, runs, empty }
    }

    /// Returns the column in which row `i` of J has its one.
    pub fn source(&self, i: usize) -> Option<usize> {
        self.sources[i]
    }

    /// Computes x <- J x.
    #[inline(always)]
    pub fn apply<S: Scalar>(&self, x: &mut [S]) {
        // Each row is read from a row above it. The last rows are written first, so that nothing is overwritten
        // before it is read.
        for &(from, to, length) in &self.runs {
            x.copy_within(from..from + length, to);
        }
        for &i in &self.empty {
            x[i] = S::zero();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ObservableForm;

    #[test]
    fn shifts_as_the_model_does() {
        for indices in [&[1][..], &[5], &[1, 3, 2], &[2, 1, 1, 4]] {
            let form = ObservableForm::new(indices, 1).unwrap();
            let mut expected: Vec<f64> = (1..=form.states()).map(|i| i as f64).collect();
            let mut found = expected.clone();
            form.shift(&mut expected);
            Shift::new(&form).apply(&mut found);
            assert_eq!(found, expected, "{indices:?}");
        }
    }
}
