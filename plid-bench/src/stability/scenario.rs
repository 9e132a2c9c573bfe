//! The data of a group, by name.

use plid_testbed::TestbedError;
use serde::{Deserialize, Serialize};

use super::adversarial;
use super::plant::{Plant, PlantError};
use super::record::{Record, truss};

/// The source of the data.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Scenario {
    /// The default truss with sensor noise of 0.005 V RMS.
    Truss,
    /// The truss with this sensor noise in V RMS.
    TrussWithSensorNoise(f64),
    /// A random plant of the model's class.
    InClass,
    /// Inputs that nearly depend on each other.
    DependentInputs,
    /// A mode that no input excites.
    UnexcitedMode,
    /// Converters that clip.
    SaturatedConverters,
    /// A long time without input, with forgetting.
    WindUp,
    /// A plant of the model's class in which a column of B increases by half in the middle of the record, with
    /// forgetting.
    Jump,
}

/// The reasons why a record cannot be created.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    /// The truss cannot be simulated.
    #[error(transparent)]
    Testbed(#[from] TestbedError),
    /// The plant of the model's class cannot be created.
    #[error(transparent)]
    Plant(#[from] PlantError),
}

impl Scenario {
    /// The difficult scenarios.
    pub const HARD: [Self; 5] =
        [Self::DependentInputs, Self::UnexcitedMode, Self::SaturatedConverters, Self::WindUp, Self::Jump];

    /// Returns the name of the scenario in words.
    pub fn name(self) -> &'static str {
        match self {
            Self::Truss => "truss",
            Self::TrussWithSensorNoise(_) => "truss, more sensor noise",
            Self::InClass => "plant in class",
            Self::DependentInputs => "dependent inputs",
            Self::UnexcitedMode => "unexcited mode",
            Self::SaturatedConverters => "saturated converters",
            Self::WindUp => "wind-up",
            Self::Jump => "jump of a parameter",
        }
    }

    /// Whether the scenario concerns forgetting.
    pub fn needs_forgetting(self) -> bool {
        matches!(self, Self::WindUp | Self::Jump)
    }

    /// Whether the data determine the response to each input separately. Nearly dependent inputs determine only the
    /// response to their sum, and rounding may change what nothing determines.
    pub fn tells_every_response(self) -> bool {
        self != Self::DependentInputs
    }

    /// Whether the record depends on the number of states.
    pub fn depends_on_states(self) -> bool {
        matches!(self, Self::InClass | Self::Jump)
    }

    /// Returns the record. The same arguments always give the same record. Only plants of the model's class depend on
    /// `states`.
    ///
    /// # Errors
    /// Returns an error if the record cannot be simulated.
    pub fn record(self, states: usize, samples: usize) -> Result<Record, RecordError> {
        Ok(match self {
            Self::Truss => truss(samples, 0.005)?,
            Self::TrussWithSensorNoise(rms_v) => truss(samples, rms_v)?,
            Self::InClass => {
                let plant = Plant::random(states)?;
                plant.record(samples, samples, &plant)
            }
            Self::DependentInputs => adversarial::dependent_inputs(samples)?,
            Self::UnexcitedMode => adversarial::unexcited_mode(samples)?,
            Self::SaturatedConverters => adversarial::saturated_converters(samples)?,
            Self::WindUp => adversarial::wind_up(samples)?,
            Self::Jump => {
                let plant = Plant::random(states)?;
                plant.record(samples, samples / 2, &plant.jumped())
            }
        })
    }
}
