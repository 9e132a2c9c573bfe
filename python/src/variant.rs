//! Variants by name.

use plid::catalogue::{BackendName, CovarianceName, ExpectationName, ScalarName};
use pyo3::prelude::*;
use serde_json::Value;
use serde_json::value::{from_value, to_value};

use crate::errors::value;

/// The kinds of variants in the order of the options, each with its names.
fn known() -> [(&'static str, Vec<String>); 4] {
    let scalars = [ScalarName::F32, ScalarName::F64, ScalarName::DoubleDouble];
    let written = |scalar| to_value(scalar).ok().and_then(|name| name.as_str().map(str::to_owned));
    [
        ("covariance", CovarianceName::all().iter().map(ToString::to_string).collect()),
        ("expectations", ExpectationName::all().iter().map(ToString::to_string).collect()),
        ("backend", BackendName::all().iter().map(ToString::to_string).collect()),
        ("scalar", scalars.into_iter().filter_map(written).collect()),
    ]
}

/// Lists the kinds of variants with their names.
#[pyfunction]
pub fn variants() -> Vec<(&'static str, Vec<String>)> {
    known().into()
}

/// The names that a caller gives; `None` stands for the default.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct Named {
    covariance: Option<String>,
    expectations: Option<String>,
    backend: Option<String>,
    scalar: Option<String>,
}

/// Returns the variant with these names.
#[derive(Clone, Copy)]
pub struct Chosen {
    pub covariance: Option<CovarianceName>,
    pub expectations: ExpectationName,
    pub backend: BackendName,
    pub scalar: ScalarName,
}

impl Named {
    /// # Errors
    /// `ValueError` for a name that is not in the catalogue, with the nearest one that is.
    pub fn chosen(self) -> PyResult<Chosen> {
        let [covariance, expectations, backend, scalar] = known();
        Ok(Chosen {
            covariance: named(&covariance, self.covariance)?,
            expectations: named(&expectations, self.expectations)?.unwrap_or_default(),
            backend: named(&backend, self.backend)?.unwrap_or_default(),
            scalar: named(&scalar, self.scalar)?.unwrap_or_default(),
        })
    }
}

fn named<T: for<'de> serde::Deserialize<'de>>(
    (kind, names): &(&str, Vec<String>),
    name: Option<String>,
) -> PyResult<Option<T>> {
    let Some(name) = name else { return Ok(None) };
    from_value(Value::String(name.clone())).map(Some).map_err(|_| {
        let meant = plid::data::nearest(&name, names).map(|near| format!("; did you mean {near:?}?"));
        value(format!("{kind}: there is no {name:?}{} Known: {}", meant.unwrap_or(".".into()), names.join(", ")))
    })
}
