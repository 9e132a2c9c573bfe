//! Arrays from the values of a file.

use ndarray::{ArrayD, IxDyn, ShapeBuilder};

/// Returns the number of values of an array.
pub(super) fn count(shape: &[usize]) -> Result<usize, String> {
    let product = shape.iter().try_fold(1_usize, |product, &size| product.checked_mul(size));
    product.ok_or_else(|| format!("{} is too large", dimensions(shape)))
}

/// Makes an array from its values, which the file stores by columns (MATLAB, Fortran) or by rows.
pub(super) fn array(shape: &[usize], values: Vec<f64>, by_columns: bool) -> Result<ArrayD<f64>, String> {
    let there = values.len();
    if count(shape)? != there {
        return Err(format!("{there} values are present for an array of {}", dimensions(shape)));
    }
    ArrayD::from_shape_vec(IxDyn(shape).set_f(by_columns), values).map_err(|e| e.to_string())
}

fn dimensions(shape: &[usize]) -> String {
    shape.iter().map(usize::to_string).collect::<Vec<_>>().join(" x ")
}
