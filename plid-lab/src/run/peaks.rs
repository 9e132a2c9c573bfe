//! Peaks of the identified frequency response compared with the true ones.

use serde::Serialize;

use super::error::RunError;
use super::obtain::Truth;
use plid_model::{Model, find_peak};

/// The peak of one dominant mode in one input-output pair.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PeakRow {
    /// The frequency of the mode in Hz.
    pub mode_hz: f64,
    /// The name of the input.
    pub input: String,
    /// The name of the output.
    pub output: String,
    /// Peak of the true plant: frequency in Hz and magnitude in dB.
    pub truth: (f64, f64),
    /// Peak of the model: frequency in Hz and magnitude in dB; `None` if it has no peak there.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub model: Option<(f64, f64)>,
}

impl PeakRow {
    /// Returns the relative error of the peak frequency.
    pub fn frequency_error(&self) -> Option<f64> {
        self.model.map(|(hz, _)| (hz - self.truth.0) / self.truth.0)
    }

    /// Returns the error of the peak magnitude in dB.
    pub fn height_error_db(&self) -> Option<f64> {
        self.model.map(|(_, db)| db - self.truth.1)
    }
}

/// Half-width of the search interval, relative to the frequency of the mode.
const WIDTH: f64 = 0.02;

/// Compares the peaks near the dominant modes pair by pair. A pair is included if its true response has a maximum
/// inside the search interval.
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
