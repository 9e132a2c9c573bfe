//! The quantities, in addition to model.json, that another program needs in order to combine an estimate with others.

use std::collections::BTreeMap;

use nalgebra::{DMatrix, DVector};
use plid_core::{IdentifiedModel, ImplicitModel, InitialCovariance};
use serde::{Deserialize, Serialize};

use super::error::RunError;
use crate::identify::{Plan, innovation_ratio};
use plid_data::prepare::Prepared;
use plid_model::{ChannelScaling, Model, undo_scaling};

/// The key `estimate` of result.json.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Estimate {
    /// Prior variances of [a_1; ..; a_p; b_1; ..; b_m], independent and with zero mean, in the data's units like the
    /// covariance in model.json; `None` if the run started from an earlier model.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub prior_variances: Option<Vec<f64>>,
    /// Mean square of the last innovations, divided by their variance according to P and R at the end and averaged
    /// over the outputs. It is 1 if the noise covariances have the right size. The covariance in model.json is too
    /// small by this factor.
    pub innovation_ratio: f64,
    /// Number of passes over the training data.
    pub passes: usize,
    /// Whether the recursion used forgetting or parameter noise.
    pub forgets: bool,
    /// RMS of every column of the data about its mean, whether the run uses the column or not, in the data's units.
    /// It is the largest value over the records.
    pub channel_rms: BTreeMap<String, f64>,
}

impl Estimate {
    /// Computes the estimate; `innovations` are those of the training parts (K x p) in scaled channels.
    pub(crate) fn new(
        plan: &Plan,
        scaled: &Model,
        identified: &IdentifiedModel,
        innovations: &[ndarray::Array2<f64>],
        prepared: &Prepared,
        channel_rms: BTreeMap<String, f64>,
    ) -> Result<Self, RunError> {
        let settings = &plan.settings;
        let prior_variances = match &settings.initial_covariance {
            InitialCovariance::Full(_) => None,
            InitialCovariance::Diagonal(variances) => {
                let prior = DVector::from_column_slice(&variances[plan.form.states()..]);
                let prior = Model { parameter_covariance: Some(DMatrix::from_diagonal(&prior)), ..scaled.clone() };
                let in_units = undo_scaling(&prior, &scaling(prepared))?.parameter_covariance;
                in_units.map(|covariance| covariance.diagonal().as_slice().to_vec())
            }
        };
        Ok(Self {
            prior_variances,
            innovation_ratio: innovation_ratio(&plan.form, &plan.noise.sensor, identified, innovations),
            passes: plan.passes,
            forgets: settings.forgetting < 1.0 || settings.parameter_noise > 0.0,
            channel_rms,
        })
    }
}

/// Returns the scales of the channels. The means are zero, because a linear model has no constant term.
pub(crate) fn scaling(prepared: &Prepared) -> ChannelScaling {
    ChannelScaling {
        input_mean: vec![0.0; prepared.input_scales.len()],
        input_scale: prepared.input_scales.clone(),
        output_mean: vec![0.0; prepared.output_scales.len()],
        output_scale: prepared.output_scales.clone(),
    }
}
