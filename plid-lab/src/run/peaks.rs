//! Peaks of the identified transfer function beside the true ones.

use serde::Serialize;

use super::error::RunError;
use super::obtain::Truth;
use plid_model::{Model, find_peak};

/// One dominant mode in one input-output pair that shows it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PeakRow {
    /// The mode, Hz.
    pub mode_hz: f64,
    /// Input.
    pub input: String,
    /// Output.
    pub output: String,
    /// Peak of the true plant: Hz, dB.
    pub truth: (f64, f64),
    /// Peak of the model: Hz, dB; `None` if it has none there.
    pub model: Option<(f64, f64)>,
}

impl PeakRow {
    /// Error of the peak's frequency, relative.
    pub fn frequency_error(&self) -> Option<f64> {
        self.model.map(|(hz, _)| (hz - self.truth.0) / self.truth.0)
    }

    /// Error of the peak's height, dB.
    pub fn height_error_db(&self) -> Option<f64> {
        self.model.map(|(_, db)| db - self.truth.1)
    }
}

/// Half the width in which a peak is looked for, relative to the mode's frequency.
const WIDTH: f64 = 0.02;

/// The peaks near the dominant modes, pair by pair. A pair shows a mode if its true response has a maximum there, not at the edge.
pub(crate) fn compare(truth: &Truth, model: &Model) -> Result<Vec<PeakRow>, RunError> {
    let mut rows = Vec::new();
    for &mode_hz in &truth.dominant_hz {
        for (j, input) in truth.model.inputs.iter().enumerate() {
            for (i, output) in truth.model.outputs.iter().enumerate() {
                let peak = find_peak(&truth.model, i, j, mode_hz, WIDTH * mode_hz)?;
                if !peak.interior {
                    continue;
                }
                let found = find_peak(model, i, j, mode_hz, WIDTH * mode_hz)?;
                rows.push(PeakRow {
                    mode_hz,
                    input: input.clone(),
                    output: output.clone(),
                    truth: (peak.hz, peak.db),
                    model: found.interior.then_some((found.hz, found.db)),
                });
            }
        }
    }
    Ok(rows)
}
