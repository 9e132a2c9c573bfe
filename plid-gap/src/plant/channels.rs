//! A plant whose inputs or outputs are mixed.

use super::Plant;

impl Plant {
    /// Adds a share of one input to another: u'_to = u_to + share u_from. The share of an input in itself changes its
    /// gain to 1 + share. Inputs that are mixed twice pass through the later mixture first.
    pub(crate) fn mix_inputs(&mut self, from: usize, to: usize, share: f64) {
        for mode in &mut self.modes {
            let added = mode.b[to] * share;
            mode.b[from] += added;
        }
        let held = self.rest.continuous.as_mut().map(|(_, b)| b);
        for matrix in [&mut self.rest.b, &mut self.d].into_iter().chain(held) {
            let added = matrix.column(to) * share;
            let mut column = matrix.column_mut(from);
            column += added;
        }
    }

    /// Adds a share of one output to another: y'_to = y_to + share y_from. The share of an output in itself changes
    /// its gain to 1 + share. What a force at a port adds to the outputs directly is mixed as well.
    pub(crate) fn mix_outputs(&mut self, from: usize, to: usize, share: f64) {
        for mode in &mut self.modes {
            let added = mode.c[from] * share;
            mode.c[to] += added;
        }
        for matrix in [&mut self.rest.c, &mut self.d] {
            let added = matrix.row(from) * share;
            let mut row = matrix.row_mut(to);
            row += added;
        }
        for port in self.ports.iter_mut().filter(|port| !port.output.is_empty()) {
            let added = share * port.output[from];
            port.output[to] += added;
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::plant::Plant;
    use crate::simulate::{Fineness, simulate};
    use crate::testing::{random_input, truss};

    /// The mixed plant responds as the plant does to mixed inputs, and its outputs are the mixed outputs.
    #[test]
    fn a_mixed_plant_has_mixed_channels() {
        let plant = Plant::new(&truss(1)).unwrap();
        let mut mixed = plant.clone();
        for (from, to, share) in [(0, 1, 0.3), (1, 1, -0.2)] {
            mixed.mix_inputs(from, to, share);
            mixed.mix_outputs(from, to, share);
        }
        let run = |plant: &Plant, u: &[Vec<f64>]| simulate(plant, &[], u, 0.0, None, Fineness::FINE);
        let u = random_input(2, 400, 2);
        // Each later mixture acts on the inputs before the earlier one, and on the outputs after it.
        let second: Vec<f64> = u[1].iter().map(|x| 0.8 * x).collect();
        let first = second.iter().zip(&u[0]).map(|(second, first)| second + 0.3 * first).collect();
        let y = run(&plant, &[u[0].clone(), first]);
        let expected: Vec<f64> = y[1].iter().zip(&y[0]).map(|(y1, y0)| 0.8 * (y1 + 0.3 * y0)).collect();
        let found = run(&mixed, &u);
        let size = y[1].iter().fold(0.0, |most: f64, x| most.max(x.abs()));
        for (found, expected) in found[1].iter().zip(&expected).chain(found[0].iter().zip(&y[0])) {
            assert!((found - expected).abs() < 1e-12 * size, "{found} {expected}");
        }
    }
}
