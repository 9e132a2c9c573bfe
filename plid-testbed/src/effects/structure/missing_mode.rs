//! A mode that the truss has, but that its list of modes lacks.

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::config::{finite, positive};
use crate::effects::law::{Law, Limits, Plant};
use crate::effects::{At, Described, Draw, Family, On};
use crate::error::TestbedError;
use crate::structure::{Mode, ModeGroup};
use crate::{INPUTS, OUTPUTS};

/// One additional mode: q" + 2 zeta w q' + w^2 q = b . a, which adds c q" at the accelerometers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MissingMode {
    /// w / (2 pi), Hz.
    pub frequency_hz: f64,
    /// zeta.
    pub damping_ratio: f64,
    /// b: modal force per volt at each actuator.
    pub input_shape: [f64; INPUTS],
    /// c: volts at each accelerometer per unit of modal acceleration.
    pub output_shape: [f64; OUTPUTS],
}

impl Law for MissingMode {
    fn check(&self, _limits: &Limits) -> Result<(), TestbedError> {
        positive("frequency_hz", self.frequency_hz)?;
        positive("damping_ratio", self.damping_ratio)?;
        self.input_shape.iter().try_for_each(|b| finite("input_shape", *b))?;
        self.output_shape.iter().try_for_each(|c| finite("output_shape", *c))
    }

    fn alter(&self, plant: &mut Plant) {
        plant.modes.push(Mode {
            frequency_hz: self.frequency_hz,
            damping_ratio: self.damping_ratio,
            input_shape: self.input_shape,
            output_shape: self.output_shape,
            group: ModeGroup::Truncated,
        });
    }

    fn strengthen(&mut self, factor: f64) {
        // Both shapes are scaled alike, as for a mode that is nearer to the platform.
        self.input_shape.iter_mut().for_each(|b| *b *= factor.sqrt());
        self.output_shape.iter_mut().for_each(|c| *c *= factor.sqrt());
    }

    /// Returns 0, because the mode is in no list. A label gives its rank by frequency instead.
    fn place(&self) -> usize {
        0
    }

    fn parameters(&self) -> Vec<f64> {
        vec![self.frequency_hz]
    }
}

impl Described for MissingMode {
    const FAMILY: Family = Family::LinearStructure;
    const AT: At = At::NewMode;
    const ON: &'static [On] = &[On::Structure];
    const PARAMETERS: &'static [&'static str] = &["f"];

    fn start(draw: &mut Draw<'_>) -> Value {
        let mode = draw.left_out.expect("the plant was drawn for it");
        json!({
            "frequency_hz": mode.frequency_hz,
            "damping_ratio": mode.damping_ratio,
            "input_shape": mode.input_shape,
            "output_shape": mode.output_shape,
        })
    }
}
