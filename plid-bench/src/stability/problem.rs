//! The prepared problem of a group, with record, form, noise and start, and its recursions.

use std::sync::Arc;

use plid_catalogue::{BackendName, CovarianceName, Recursion, ScalarName, Variant, VariantError};
use plid_core::{IdentifierError, NoiseModel, ObservableForm, Settings, StructureError};
use plid_testbed::{INPUTS, OUTPUTS};

use super::group::Group;
use super::record::{Record, single};

/// The common part of the cells of a group.
#[derive(Clone, Debug)]
pub struct Problem {
    /// The group.
    pub group: Group,
    /// The data.
    pub record: Arc<Record>,
    /// The canonical form.
    pub form: ObservableForm,
    noise: NoiseModel,
    settings: Settings,
}

impl Problem {
    /// Prepares the problem of `group` on its record.
    ///
    /// # Errors
    /// Returns an error for an impossible number of states.
    pub fn new(group: Group, record: Arc<Record>) -> Result<Self, StructureError> {
        let form = ObservableForm::balanced(group.states, OUTPUTS, INPUTS)?;
        let unit = if group.start_over_sensor { record.sensor } else { 1.0 };
        let p0 = single(group.initial_variance * unit);
        let settings = Settings {
            parameter_noise: single(group.parameter_noise),
            forgetting: group.forgetting,
            ..Settings::new(&form, p0, p0)
        };
        Ok(Self { noise: record.noise(&form), group, record, form, settings })
    }

    /// Returns a recursion on plain loops before its first sample.
    ///
    /// # Errors
    /// Returns a [`VariantError`].
    pub fn recursion(
        &self,
        covariance: CovarianceName,
        scalar: ScalarName,
    ) -> Result<Box<dyn Recursion>, VariantError> {
        let expectations = self.group.expectations;
        let variant = Variant { covariance, expectations, backend: BackendName::Plain, scalar };
        variant.build(self.form.clone(), &self.noise, &self.settings)
    }

    /// Whether a form has this scalar and the operations that the group requires. A form that the program has added
    /// may lack forgetting or parameter noise, which its first step then reports.
    pub fn is_offered(&self, covariance: CovarianceName, scalar: ScalarName) -> bool {
        match self.recursion(covariance, scalar) {
            Ok(mut recursion) => !matches!(self.step(recursion.as_mut(), 0), Err(IdentifierError::Unsupported(_))),
            Err(error) => !matches!(error, VariantError::Absent { .. }),
        }
    }

    /// Passes sample `k` to `recursion`.
    ///
    /// # Errors
    /// Returns the errors of [`plid_core::Identifier::step`].
    pub fn step(&self, recursion: &mut dyn Recursion, k: usize) -> Result<(), IdentifierError> {
        recursion.step(&self.record.outputs[k], &self.record.inputs[k], false)
    }
}
