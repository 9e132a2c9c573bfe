//! `plid._plid`, the compiled module of the Python package. It converts arrays, errors and interruptions. The
//! documented functions are in `plid/*.py`.

mod arrays;
mod diagnose;
mod errors;
mod fmu;
mod identify;
mod model;
mod patience;
mod predictor;
mod recursion;
mod simulator;
mod table;
mod variant;
mod wait;

use pyo3::prelude::*;

#[pymodule]
fn _plid(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add_class::<model::Model>()?;
    module.add_class::<recursion::Recursion>()?;
    module.add_class::<diagnose::Outcome>()?;
    module.add_class::<fmu::Fmu>()?;
    module.add_function(wrap_pyfunction!(diagnose::diagnose, module)?)?;
    module.add_function(wrap_pyfunction!(identify::identify, module)?)?;
    module.add_function(wrap_pyfunction!(simulator::run, module)?)?;
    module.add_function(wrap_pyfunction!(simulator::check, module)?)?;
    module.add_function(wrap_pyfunction!(simulator::serve, module)?)?;
    module.add_function(wrap_pyfunction!(table::read, module)?)?;
    module.add_function(wrap_pyfunction!(variant::variants, module)?)
}
