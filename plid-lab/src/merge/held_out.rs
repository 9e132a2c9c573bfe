//! The merged model on a record in which all inputs act.

use nalgebra::DVector;
use ndarray::{Array2, s};
use plid_model::signal::{ErrorMeasures, error_measures};
use plid_model::{Model, estimate_initial_state, simulate};

use crate::data::Record;
use crate::prepare::scaling::Scaling;
use crate::prepare::{Advance, Preparation, prepare};
use crate::run::RunError;

/// Free runs over the part of a record that nothing was learnt from, in the data's units.
#[derive(Clone, Debug)]
pub struct HeldOut {
    /// What the record is called.
    pub record: String,
    /// Rate after preparation.
    pub sample_rate_hz: f64,
    /// Outputs as deviations from their means, K x p.
    pub measured: Array2<f64>,
    /// The model's, from the state that the leading part shows; infinite where it diverges.
    pub free_run: Array2<f64>,
    /// How far they are apart.
    pub errors: ErrorMeasures,
    /// The same for the true plant, for simulated data.
    pub truth_errors: Option<ErrorMeasures>,
}

/// Simulates `model` (canonical, `advanced` as its runs) over what follows the leading `share` of `record`, prepared as the runs were. The leading part
/// gives the state at its beginning and the means, nothing else.
pub(super) fn judge(
    model: &Model,
    advanced: usize,
    name: &str,
    records: Vec<Record>,
    share: f64,
    preparation: &Preparation,
    noise_free: Option<&Array2<f64>>,
) -> Result<HeldOut, RunError> {
    let as_runs = Preparation {
        advance: if advanced == 1 { Advance::Yes } else { Advance::No },
        scaling: Scaling::None,
        ..preparation.clone()
    };
    let shares = vec![share; records.len()];
    let prepared = prepare(records, &shares, &as_runs)?;
    let (record, training) = (&prepared.records[0], prepared.training[0]);
    if (record.sample_rate_hz - model.sample_rate_hz).abs() > 1e-4 * model.sample_rate_hz {
        let reason = format!("{name}: {} Hz, the runs have {} Hz", record.sample_rate_hz, model.sample_rate_hz);
        return Err(RunError::Setting { key: "file", reason });
    }
    let head = s![..training, ..];
    let start = estimate_initial_state(model, record.inputs.slice(head), record.outputs.slice(head), None)?.state;
    let tail = |x0: &DVector<f64>| simulate(model, record.inputs.view(), x0).map(|run| run.outputs.slice_move(s![training.., ..]));
    let measured = record.outputs.slice(s![training.., ..]).to_owned();
    // A free run that diverges is a finding, not an end.
    let free_run = tail(&start).unwrap_or_else(|_| Array2::from_elem(measured.dim(), f64::INFINITY));
    let errors = error_measures(measured.view(), free_run.view())?;
    let truth_errors = match noise_free.filter(|noise_free| prepared.start_s == 0.0 && noise_free.nrows() == record.samples() + advanced) {
        None => None,
        Some(noise_free) => {
            let mut response = noise_free.slice(s![training..training + measured.nrows(), ..]).to_owned();
            for (k, mut row) in response.rows_mut().into_iter().enumerate() {
                let seconds = (training + k) as f64 / record.sample_rate_hz;
                row.iter_mut().zip(&prepared.lines[0][1]).for_each(|(y, line)| *y -= line.offset + line.slope_per_s * seconds);
            }
            Some(error_measures(measured.view(), response.view())?)
        }
    };
    Ok(HeldOut { record: name.into(), sample_rate_hz: record.sample_rate_hz, measured, free_run, errors, truth_errors })
}
