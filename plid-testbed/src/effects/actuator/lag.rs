//! A slower actuator, whose pole moves.

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::ACTUATOR_POLE_HZ;
use crate::config::positive;
use crate::effects::law::{Law, Limits, Plant};
use crate::effects::place::Input;
use crate::effects::{At, Described, Draw, Family, On};
use crate::error::TestbedError;

/// The pole of the actuator moves to fp, or the actuator gets a pole at fp if it had none. Its static gain stays 1.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ActuatorLag {
    /// The input.
    pub at: Input,
    /// fp, Hz; positive.
    pub pole_hz: f64,
    /// The original pole, Hz, from which the strength is measured. `None` if the actuator had no pole.
    #[serde(default = "usual_pole_hz", skip_serializing_if = "is_usual")]
    pub from_hz: Option<f64>,
}

#[allow(clippy::unnecessary_wraps)] // serde wants the type of the key.
fn usual_pole_hz() -> Option<f64> {
    Some(ACTUATOR_POLE_HZ)
}

fn is_usual(pole_hz: &Option<f64>) -> bool {
    *pole_hz == usual_pole_hz()
}

impl Law for ActuatorLag {
    fn check(&self, _limits: &Limits) -> Result<(), TestbedError> {
        positive("pole_hz", self.pole_hz)?;
        self.from_hz.map_or(Ok(()), |from_hz| positive("from_hz", from_hz))
    }

    fn alter(&self, plant: &mut Plant) {
        plant.poles_hz[self.at.0] = self.pole_hz;
    }

    fn strengthen(&mut self, factor: f64) {
        self.pole_hz = match self.from_hz {
            // The strength acts on the ratio of the two poles, so that the pole stays positive.
            Some(from_hz) => from_hz * (self.pole_hz / from_hz).powf(factor),
            None => self.pole_hz / factor,
        };
    }

    fn place(&self) -> usize {
        self.at.0
    }

    fn parameters(&self) -> Vec<f64> {
        vec![self.pole_hz]
    }
}

impl Described for ActuatorLag {
    const FAMILY: Family = Family::LinearActuator;
    const AT: At = At::Input;
    const ON: &'static [On] = &[On::Structure, On::Command];
    const PARAMETERS: &'static [&'static str] = &["fp"];
    const IMPERFECTION: bool = true;

    fn start(draw: &mut Draw<'_>) -> Value {
        let from_hz = draw.truss.actuator_poles_hz[draw.channel];
        if from_hz.is_finite() {
            json!({ "pole_hz": from_hz * (200.0 / ACTUATOR_POLE_HZ), "from_hz": from_hz })
        } else {
            json!({ "pole_hz": 0.25 * draw.truss.sample_rate_hz, "from_hz": null })
        }
    }
}
