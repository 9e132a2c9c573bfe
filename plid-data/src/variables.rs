//! Several named arrays of one file as one table.
use super::DataError;
use super::error::nearest;
use super::table::Content;
use ndarray::{Array2, Ix2};
use std::collections::BTreeMap;
use std::path::Path;

/// A named array of at most two dimensions is a scalar, a column or a matrix; others are only
/// named to the user.
pub(super) struct Variable {
    pub name: String,
    pub shape: Vec<usize>,
    /// Rows are samples; `None` for what cannot be a table (more dimensions, complex, text).
    pub matrix: Option<Array2<f64>>,
}

impl Variable {
    /// A variable from real numbers; a vector lies along its samples, however it is turned.
    pub fn new(name: String, values: ndarray::ArrayD<f64>, row_is_vector: bool) -> Self {
        let shape = values.shape().to_vec();
        let matrix = match shape.as_slice() {
            [] => values.into_shape_with_order((1, 1)).ok(),
            [_] => {
                let samples = values.len();
                values.into_shape_with_order((samples, 1)).ok()
            }
            [1, _] if row_is_vector => values.into_dimensionality::<Ix2>().ok().map(|m| m.reversed_axes()),
            _ => values.into_dimensionality::<Ix2>().ok(),
        };
        Self { name, shape, matrix }
    }

    /// A variable that can only be named.
    pub fn unusable(name: String, shape: Vec<usize>) -> Self {
        Self { name, shape, matrix: None }
    }

    fn describe(&self) -> String {
        let shape: Vec<String> = self.shape.iter().map(usize::to_string).collect();
        let mut notes = vec![shape.join(" x ")];
        notes.retain(|shape| !shape.is_empty());
        if self.matrix.is_none() {
            notes.push("unusable".into());
        }
        if notes.is_empty() {
            notes.push("scalar".into());
        }
        format!("`{}` ({})", self.name, notes.join(", "))
    }
}

/// One table from the variables of a file.
///
/// Variables of one element are scalars. All others, or only the one that is chosen, must have
/// the same number of rows. A lone matrix has numbered columns; else a vector has its own name
/// and a matrix `y` the names `y1`, `y2`, ...
pub(super) fn assemble(path: &Path, variables: &[Variable], choice: Option<&str>) -> Result<Content, DataError> {
    let there = || {
        let all: Vec<String> = variables.iter().map(Variable::describe).collect();
        all.join(", ")
    };
    let mut scalars = BTreeMap::new();
    let mut parts: Vec<(&str, &Array2<f64>)> = Vec::new();
    for variable in variables {
        match &variable.matrix {
            Some(matrix) if matrix.len() == 1 => {
                scalars.insert(variable.name.clone(), matrix[[0, 0]]);
            }
            Some(matrix) if !matrix.is_empty() => parts.push((&variable.name, matrix)),
            _ => {}
        }
    }
    if let Some(choice) = choice {
        parts.retain(|(name, _)| *name == choice);
        if parts.is_empty() {
            return Err(DataError::UnknownVariable {
                file: path.into(),
                variable: choice.into(),
                there: there(),
                suggestion: nearest(choice, variables.iter().map(|v| &v.name)),
            });
        }
    }
    let Some(samples) = parts.first().map(|(_, matrix)| matrix.nrows()) else {
        return Err(DataError::Malformed {
            file: path.into(),
            what: if variables.is_empty() {
                "there is no variable in it".into()
            } else {
                format!("there is no matrix or vector of real numbers in it, only {}", there())
            },
        });
    };
    if parts.iter().any(|(_, matrix)| matrix.nrows() != samples) {
        return Err(DataError::ChooseVariable { file: path.into(), there: there() });
    }
    let alone = parts.len() == 1;
    let names = parts
        .iter()
        .flat_map(|(name, matrix)| {
            let columns = matrix.ncols();
            (1..=columns).map(move |i| match (alone, columns) {
                (_, 1) => (*name).to_string(),
                (true, _) => i.to_string(),
                (false, _) => format!("{name}{i}"),
            })
        })
        .collect();
    let views: Vec<_> = parts.iter().map(|(_, matrix)| matrix.view()).collect();
    let columns = ndarray::concatenate(ndarray::Axis(1), &views)
        .map_err(|e| DataError::Malformed { file: path.into(), what: e.to_string() })?;
    Ok(Content { names, columns, scalars, lines: Vec::new() })
}
