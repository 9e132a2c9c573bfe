//! The operations of a step, counted in the real recursion with plain loops over a counting number type.

pub use plid_catalogue::count::Operations;
use plid_catalogue::count::operations;
use plid_core::{Dense, ImplicitModel, InitialCovariance, Settings};

use super::cell::Cell;
use super::visit::VisitError;
use crate::Workload;

/// Returns the operations of one step of a cell's recursion on plain loops. Other libraries compute the same
/// products.
///
/// # Errors
/// Returns the errors of a visit.
pub fn count(cell: &Cell, workload: &Workload<'_>) -> Result<Operations, VisitError> {
    let recursion = workload.build(|form, noise, settings| {
        // P0 contains no zeros, so kernels that skip zeros skip nothing.
        let size = form.joint_states();
        let full = Dense::from_fn(size, size, |i, j| if i == j { 1.0 } else { 0.5 / size as f64 });
        let settings = Settings { initial_covariance: InitialCovariance::Full(full), ..settings.clone() };
        cell.variant.build_counted(form, noise, &settings)
    })?;
    let mut steps = workload.with(recursion);
    steps.step().map_err(VisitError::Fails)?;
    let (result, operations) = operations(|| steps.step());
    result.map_err(VisitError::Fails)?;
    Ok(operations)
}

#[cfg(test)]
mod tests {
    use super::count;
    use plid_catalogue::{CovarianceName, ExpectationName};

    use crate::speed::cell::Cell;
    use crate::{Noise, Record, Workload};

    const LESS: f64 = 0.01;

    /// Returns the permitted relative excess of the count. The kernels of the factored forms process whole registers,
    /// even beyond the edge or diagonal of a matrix.
    fn more(form: CovarianceName) -> f64 {
        if form.is_factored() { 0.25 } else { 0.05 }
    }

    /// The counts agree with the formulas that the forms and expectations state.
    #[test]
    fn formulas_are_what_is_counted() {
        let mut off = Vec::new();
        for (inputs, noise) in [(1, Noise::Diagonal), (3, Noise::Diagonal), (3, Noise::Full)] {
            let record = Record::truss(inputs, 0.01).unwrap();
            let workload = Workload::new(&record, 48, noise).unwrap();
            for (form, expectations) in
                CovarianceName::BUILT_IN.into_iter().flat_map(|f| ExpectationName::BUILT_IN.map(|e| (f, e)))
            {
                let cell = Cell { inputs, noise, ..Cell::plain(48, form, expectations) };
                let counted = count(&cell, &workload).unwrap().total() as f64;
                let formula: f64 = cell.variant.flops(&cell.size()).iter().map(|term| term.flops).sum();
                let ratio = counted / formula;
                if !(1.0 - LESS..1.0 + more(form)).contains(&ratio) {
                    off.push(format!("{ratio:.3} {}: {counted} for {formula}", cell.key()));
                }
            }
        }
        assert!(off.is_empty(), "{off:#?}");
    }
}
