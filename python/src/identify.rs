//! Identification from arrays.

use numpy::PyReadonlyArray2;
use plid::{Identification, IdentificationError, Identified, Watch};
use pyo3::prelude::*;
use serde_json::{Map, json};

use crate::errors::value;
use crate::model::Model;
use crate::variant::Named;
use crate::wait::off_the_interpreter;

/// The names of the channels, for messages and for the model.
type Channels = (Vec<String>, Vec<String>);

/// Identifies a model. Its provenance holds the operating point, the variant and the orders that were compared.
#[pyfunction]
#[pyo3(signature = (u, y, rate, channels, variant, states, nan_is_missing, progress))]
#[allow(clippy::too_many_arguments)]
pub fn identify(
    py: Python<'_>,
    u: PyReadonlyArray2<'_, f64>,
    y: PyReadonlyArray2<'_, f64>,
    rate: f64,
    channels: Channels,
    variant: Named,
    states: Option<usize>,
    nan_is_missing: bool,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<Model> {
    let chosen = variant.chosen()?;
    let mut options =
        Identification::default().expectations(chosen.expectations).backend(chosen.backend).scalar(chosen.scalar);
    if let Some(covariance) = chosen.covariance {
        options = options.covariance(covariance);
    }
    if let Some(states) = states {
        options = options.states(states);
    }
    if nan_is_missing {
        options = options.nan_is_missing();
    }
    // Copies, because Python may change its arrays while other threads run.
    let (u, y) = (u.as_array().to_owned(), y.as_array().to_owned());
    let identified = off_the_interpreter(py, progress, |caller| {
        let tell = |states, done, planned| caller.tell(format!("{states} states: {done} of {planned} filters"));
        let watch = Watch { progress: &tell, may_go_on: &|| caller.may_go_on() };
        options.run_watched(u.view(), y.view(), rate, watch)
    })?;
    let identified = identified.map_err(|error| value(in_names(&error, &channels)))?;
    Ok(Model { model: named(identified, channels) })
}

/// Returns the model with the names of its channels.
fn named(identified: Identified, (inputs, outputs): Channels) -> plid::model::Model {
    let mut provenance = Map::new();
    let Identified { model, scaling, orders, variant, innovation_ratio, .. } = identified;
    let orders = orders.map(|scan| {
        let rows = scan.rows.iter();
        rows.map(|row| json!({"states": row.states, "simulation_error": row.free_run})).collect::<Vec<_>>()
    });
    provenance.insert("program".into(), json!(concat!("plid ", env!("CARGO_PKG_VERSION"), ", from Python")));
    let point = json!({"inputs": scaling.input_mean, "outputs": scaling.output_mean});
    provenance.insert("operating_point".into(), point);
    provenance.insert("variant".into(), json!(variant));
    provenance.insert("innovation_ratio".into(), json!(innovation_ratio));
    provenance.insert("orders".into(), json!(orders));
    plid::model::Model { inputs, outputs, provenance: Some(provenance), ..model }
}

/// Returns the message of an error with the caller's names of the channels.
fn in_names(error: &IdentificationError, (inputs, outputs): &Channels) -> String {
    let text = error.to_string();
    let (IdentificationError::Constant { channel } | IdentificationError::NotFinite { channel, .. }) = error else {
        return text;
    };
    let names = if channel.starts_with('u') { inputs } else { outputs };
    let name = channel[1..].parse::<usize>().ok().and_then(|at| names.get(at - 1));
    name.map_or(text.clone(), |name| text.replace(channel.as_str(), &format!("channel {name:?}")))
}
