use nalgebra::{DMatrix, DVector};
use ndarray::{Array2, ArrayView2, Axis};

use super::error::{ModelError, expect_shape};
use super::state_space::{Continuous, Model, Noise, Port};

/// The scaling applied to the channels before identification: scaled = (value - mean) / scale.
#[derive(Debug, Clone, PartialEq)]
pub struct ChannelScaling {
    /// Means of the inputs (m), in the channels' units.
    pub input_mean: Vec<f64>,
    /// Scales of the inputs (m), positive, in the channels' units.
    pub input_scale: Vec<f64>,
    /// Means of the outputs (p), in the channels' units.
    pub output_mean: Vec<f64>,
    /// Scales of the outputs (p), positive, in the channels' units.
    pub output_scale: Vec<f64>,
}

impl ChannelScaling {
    /// Subtracts the means from inputs (samples x m). The result keeps the channels' units and is the input of a model
    /// from [`undo_scaling`].
    pub fn input_deviations(&self, inputs: ArrayView2<f64>) -> Array2<f64> {
        shifted(inputs, &self.input_mean, -1.0)
    }

    /// Adds the means to the outputs (samples x p) of a model from [`undo_scaling`].
    pub fn with_output_means(&self, outputs: ArrayView2<f64>) -> Array2<f64> {
        shifted(outputs, &self.output_mean, 1.0)
    }

    fn check(&self, model: &Model) -> Result<(), ModelError> {
        let sizes = [
            ("input_scale", self.input_scale.len(), model.m()),
            ("input_mean", self.input_mean.len(), model.m()),
            ("output_scale", self.output_scale.len(), model.p()),
            ("output_mean", self.output_mean.len(), model.p()),
        ];
        for (what, found, expected) in sizes {
            expect_shape(what, (expected, 1), (found, 1))?;
        }
        let inputs = model.inputs.iter().zip(&self.input_scale);
        let outputs = model.outputs.iter().zip(&self.output_scale);
        let bad = inputs.chain(outputs).find(|(_, s)| !(s.is_finite() && **s > 0.0));
        bad.map_or(Ok(()), |(channel, &value)| {
            let channel = channel.clone();
            Err(ModelError::Scale { channel, value })
        })
    }
}

fn shifted(values: ArrayView2<f64>, means: &[f64], sign: f64) -> Array2<f64> {
    let mut shifted = values.to_owned();
    for (mut column, mean) in shifted.axis_iter_mut(Axis(1)).zip(means) {
        column += sign * mean;
    }
    shifted
}

/// Converts a model of scaled channels to the channels' units. Its inputs and outputs are deviations from the means,
/// because a linear model has no constant term.
///
/// If the model has observability indices, the states of block i are multiplied by the scale s_i of output i, so that C
/// and A keep their canonical form. In block i the entries of a_j are multiplied by s_i / s_j and those of b_j by s_i /
/// (scale of input j), and the parameter covariance is multiplied accordingly. Without indices the states are
/// unchanged.
///
/// # Errors
/// Returns [`ModelError::Shape`] if the scaling does not fit the model, and [`ModelError::Scale`] for a scale that is
/// not positive and finite.
pub fn undo_scaling(model: &Model, scaling: &ChannelScaling) -> Result<Model, ModelError> {
    scaling.check(model)?;
    let s_in = DVector::from_column_slice(&scaling.input_scale);
    let s_out = DVector::from_column_slice(&scaling.output_scale);
    let states = state_scale(model, &s_out);
    let scaled = |matrix: &DMatrix<f64>, rows: &DVector<f64>, columns: &DVector<f64>| {
        DMatrix::from_fn(matrix.nrows(), matrix.ncols(), |i, j| matrix[(i, j)] * (rows[i] / columns[j]))
    };
    let times =
        |list: &[f64], by: &DVector<f64>| -> Vec<f64> { list.iter().zip(by.iter()).map(|(x, s)| x * s).collect() };
    let over = states.map(f64::recip);
    Ok(Model {
        a: scaled(&model.a, &states, &states),
        b: scaled(&model.b, &states, &s_in),
        c: scaled(&model.c, &s_out, &states),
        d: scaled(&model.d, &s_out, &s_in),
        noise: Noise {
            sensor_std: model.noise.sensor_std.as_ref().map(|x| times(x, &s_out)),
            actuator_std: model.noise.actuator_std.as_ref().map(|x| times(x, &s_in)),
        },
        predictor_gain: model.predictor_gain.as_ref().map(|k| scaled(k, &states, &s_out)),
        parameter_covariance: model.parameter_covariance.as_ref().map(|covariance| {
            let factors = parameter_factors(&states, &s_out, &s_in);
            scaled(covariance, &factors, &factors.map(f64::recip))
        }),
        initial_state: model.initial_state.as_ref().map(|x| x.component_mul(&states)),
        continuous: model.continuous.as_ref().map(|continuous| Continuous {
            a: scaled(&continuous.a, &states, &states),
            b: scaled(&continuous.b, &states, &s_in),
        }),
        ports: model
            .ports
            .iter()
            .map(|port| Port {
                force: times(&port.force, &states),
                displacement: times(&port.displacement, &over),
                velocity: times(&port.velocity, &over),
                output: port.output.as_ref().map(|x| times(x, &s_out)),
                ..port.clone()
            })
            .collect(),
        ..model.clone()
    })
}

/// Returns the factor of each state (n).
fn state_scale(model: &Model, outputs: &DVector<f64>) -> DVector<f64> {
    let Some(indices) = &model.observability_indices else {
        return DVector::from_element(model.n(), 1.0);
    };
    let blocks = indices.iter().zip(outputs.iter());
    let scales = blocks.flat_map(|(&size, &scale)| std::iter::repeat_n(scale, size));
    DVector::from_iterator(model.n(), scales)
}

/// Returns the factor of each entry of [a_1; ..; a_p; b_1; ..; b_m].
fn parameter_factors(states: &DVector<f64>, outputs: &DVector<f64>, inputs: &DVector<f64>) -> DVector<f64> {
    let n = states.len();
    DVector::from_fn(n * (outputs.len() + inputs.len()), |t, _| {
        let vector = t / n;
        let unit = if vector < outputs.len() { outputs[vector] } else { inputs[vector - outputs.len()] };
        states[t % n] / unit
    })
}

#[cfg(test)]
mod tests {
    use super::super::predict::one_step_prediction;
    use super::super::simulate::simulate;
    use super::super::testing::{canonical, covariance, random, record, two_modes};
    use super::super::uncertainty::{mode_deviations, response_variance};
    use super::*;
    use approx::assert_relative_eq;

    fn scaling() -> ChannelScaling {
        ChannelScaling {
            input_mean: vec![3.0, -7.0],
            input_scale: vec![20.0, 0.3],
            output_mean: vec![100.0, 1e-4],
            output_scale: vec![5.0, 1e-3],
        }
    }

    fn prepared(values: &Array2<f64>, mean: &[f64], scale: &[f64]) -> Array2<f64> {
        Array2::from_shape_fn(values.dim(), |(k, i)| (values[(k, i)] - mean[i]) / scale[i])
    }

    fn agree(model: &Model) {
        let scaling = scaling();
        let (u, y) = (record(1, 60, 2) * 30.0, record(2, 60, 2));
        let small_u = prepared(&u, &scaling.input_mean, &scaling.input_scale);
        let small_y = prepared(&y, &scaling.output_mean, &scaling.output_scale);
        let start = model.initial_state.as_ref().unwrap();
        let in_units = undo_scaling(model, &scaling).unwrap();
        let other = in_units.initial_state.as_ref().unwrap();

        let deviations = scaling.input_deviations(u.view());
        let small = simulate(model, small_u.view(), start).unwrap().outputs;
        let large = simulate(&in_units, deviations.view(), other).unwrap().outputs;
        let large = scaling.with_output_means(large.view());
        let back = prepared(&large, &scaling.output_mean, &scaling.output_scale);
        for (a, b) in small.iter().zip(&back) {
            assert_relative_eq!(a, b, epsilon = 1e-10);
        }

        let y = shifted(y.view(), &scaling.output_mean, -1.0);
        let small = one_step_prediction(model, small_u.view(), small_y.view(), start).unwrap();
        let large = one_step_prediction(&in_units, deviations.view(), y.view(), other).unwrap();
        for ((k, i), e) in small.innovations.indexed_iter() {
            let e = e * scaling.output_scale[i];
            assert_relative_eq!(large.innovations[(k, i)], e, max_relative = 1e-9, epsilon = 1e-12);
        }
    }

    fn full(mut model: Model) -> Model {
        let n = model.n();
        model.d = random(8, 2, 2);
        model.predictor_gain = Some(random(9, n, 2) * 0.1);
        model.initial_state = Some(random(10, n, 1).column(0).into_owned());
        model.parameter_covariance = Some(covariance(11, 4 * n) * 1e-6);
        model
    }

    #[test]
    fn runs_and_predictions_agree() {
        agree(&full(canonical(4, &[3, 2], 2)));
        agree(&full(two_modes()));
    }

    /// The uncertainty functions reject a model that is not canonical, and the correct figures are known in both units.
    #[test]
    fn the_canonical_form_and_its_covariance_are_kept() {
        let scaling = scaling();
        let mut model = full(canonical(4, &[3, 2], 2));
        model.d.fill(0.0);
        let in_units = undo_scaling(&model, &scaling).unwrap();
        let small = response_variance(&model, &[11.0], 0).unwrap()[0].magnitude_std();
        let large = response_variance(&in_units, &[11.0], 0).unwrap()[0].magnitude_std();
        for i in 0..2 {
            for j in 0..2 {
                let ratio = scaling.output_scale[i] / scaling.input_scale[j];
                assert_relative_eq!(large[(i, j)], small[(i, j)] * ratio, max_relative = 1e-9);
            }
        }
        let (small, large) = (mode_deviations(&model), mode_deviations(&in_units));
        for (a, b) in small.unwrap().iter().zip(&large.unwrap()) {
            assert_relative_eq!(a.mode.hz, b.mode.hz, max_relative = 1e-9);
            assert_relative_eq!(a.hz_std.unwrap(), b.hz_std.unwrap(), max_relative = 1e-7);
        }
    }

    #[test]
    fn a_scale_of_zero_is_refused_by_channel() {
        let mut bad = scaling();
        bad.output_scale[1] = 0.0;
        let error = undo_scaling(&two_modes(), &bad).unwrap_err();
        assert!(matches!(error, ModelError::Scale { channel, value: 0.0 } if channel == "y2"));
    }
}
